"""Where in the log a carved piece sits: across the stem and along it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.carve.carving import Carved
    from woodfit import SolidTexture

Array = npt.NDArray[Any]

_PIECE, _FACE, _RING, _PITH = "#b5651d", "#1f5fa8", "#c9b79c", "#7a1f1f"
_MOST_TRIANGLES = 20_000
_MOST_RINGS = 60


def draw_placement(texture: SolidTexture, carved: Carved, path: Path) -> None:
    """Write the picture as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scale = texture.pixel_size or 1.0
    every = max(1, len(carved.mesh.faces) // _MOST_TRIANGLES)
    corners = carved.placement.apply(carved.mesh.vertices)[carved.mesh.faces[::every]]
    piece = _in_tree(texture, corners)
    faces = [_in_tree(texture, outline * scale) for outline in _outlines(texture)]
    figure = Figure(figsize=(11, 5), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    _across(left, texture, piece, faces)
    _along(right, texture, piece, faces)
    figure.suptitle(f"{carved.mesh.name}: where it is cut from the log", fontsize=12)
    figure.savefig(path)


def _in_tree(texture: SolidTexture, points: Array) -> Array:
    """Tree-frame coordinates (..., 3) of board-frame points, both in the texture's unit."""
    scale = texture.pixel_size or 1.0
    matrix = texture.board_to_tree
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3] * scale)


def _outlines(texture: SolidTexture) -> list[Array]:
    """Corners (4, 3) of the photographed rectangles, px."""
    ends = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    return [
        corner + ends[:, :1] * width * right + ends[:, 1:] * height * down
        for (corner, right, down), (width, height) in zip(texture.seen.plane, texture.seen.size, strict=True)
    ]


def _across(axes: Axes, texture: SolidTexture, piece: Array, faces: list[Array]) -> None:
    scale = texture.pixel_size or 1.0
    radii = texture.ring_radius[1:] * scale
    angle = np.linspace(0.0, 2 * np.pi, 361)
    for radius in radii[:: max(1, len(radii) // _MOST_RINGS)]:
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), color=_RING, linewidth=0.6, zorder=1)
    _draw(axes, piece[..., :2], [face[:, :2] for face in faces])
    axes.plot(0, 0, "+", color=_PITH, markersize=10, zorder=4, label="pith")
    every = np.concatenate([piece.reshape(-1, 3), *faces, np.zeros((1, 3))])[:, :2]
    _limits(axes, every, texture.unit)
    axes.set_title("across the stem", fontsize=10)
    axes.legend(loc="upper right", fontsize=8)


def _along(axes: Axes, texture: SolidTexture, piece: Array, faces: list[Array]) -> None:
    # Height to the right, the tree's x (towards the board) upwards.
    _draw(axes, piece[..., [2, 0]], [face[:, [2, 0]] for face in faces])
    axes.axhline(0.0, color=_PITH, linewidth=1.2, linestyle="-.", zorder=2)
    every = np.concatenate([piece.reshape(-1, 3), *faces])[:, [2, 0]]
    _limits(axes, np.concatenate([every, [[every[:, 0].mean(), 0.0]]]), texture.unit)
    axes.set_title("along the stem", fontsize=10)


def _draw(axes: Axes, triangles: Array, faces: list[Array]) -> None:
    from matplotlib.collections import PolyCollection

    axes.add_collection(
        PolyCollection(list(triangles), facecolor=_PIECE, edgecolor="none", alpha=0.35, zorder=2, rasterized=True)
    )
    for number, face in enumerate(faces):
        closed = np.concatenate([face, face[:1]])
        label = "photographed" if number == 0 else None
        axes.plot(closed[:, 0], closed[:, 1], color=_FACE, linewidth=1.6, zorder=3, label=label)


def _limits(axes: Axes, points: Array, unit: str) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    rim = 0.06 * float((high - low).max())
    axes.set(xlim=(low[0] - rim, high[0] + rim), ylim=(low[1] - rim, high[1] + rim), aspect="equal")
    axes.set_xlabel(unit, fontsize=8)
    axes.tick_params(labelsize=8)
