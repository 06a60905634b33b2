"""Small drawings of the trunk with the board in it: across the stem, and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.report.block_place import block_rows, block_words, place_in_block
from pipeline.report.placing import Place, cut_of, open_words, place_of, pose_rows
from pipeline.report.plots import ACCENT, INK, MUTED, RULE, WOOD, svg
from pipeline.report.reading import Scan
from pipeline.report.solid import box_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[Any]

_MOST_RINGS = 90


def pose_section(scan: Scan, names: Sequence[str] = ()) -> dict[str, Any] | None:
    """Drawings, numbers and words about the pose; ``None`` when it was not found.

    Parameters
    ----------
    scan
        A scan, or a block.
    names
        Of the block's faces.
    """
    place = place_of(scan)
    if place is None:
        return None
    outline = _corners(scan, place)
    if scan.block is None:
        cut, rows, words = cut_of(place), pose_rows(place, scan.pixel_size), open_words(place)
    else:
        place = place_in_block(place, scan.block)
        cut, words = f"a block of {len(names)} face{'s' * (len(names) > 1)}", block_words(place, scan.block)
        rows = block_rows(place, scan.block, names, scan.pixel_size, scan.unit)
    return {
        "across": svg(
            "across",
            f"The trunk seen along the pith, with the board in it: {cut}.",
            (300, 300),
            _across(place, *outline),
        ),
        "along": svg("along", "The trunk and the board seen from the side.", (300, 300), _along(place, *outline)),
        "rows": rows,
        "words": words,
        "cut": cut,
        "widths": _widths(place, scan.pixel_size, scan.unit),
    }


def _section_axes(place: Place) -> Array:
    """Right and down of the view along the pith, tree frame, shape (2, 3).

    The photograph is not mirrored in the view of an end grain; other faces lie on the upper side of their block.
    """
    board = place.board_to_tree[:3, :3]
    right = board[:, 0] if np.hypot(board[0, 0], board[1, 0]) > 0.4 else board[:, 1]
    right = np.array([right[0], right[1], 0.0]) / np.hypot(right[0], right[1])
    into = np.array([0.0, 0.0, 1.0])
    views = [np.stack([right, np.cross(sign * into, right)]) for sign in (1.0, -1.0)]
    scores = [view[1] @ board[:, 2] + sign * board[2, 2] for sign, view in zip((1.0, -1.0), views, strict=True)]
    return views[int(np.argmax(scores))]


def _corners(scan: Scan, place: Place) -> tuple[Array, Array]:
    """Corners of the faces, in order around each, (F, 4, 3), and of their block, (8, 3), tree frame, px."""
    box = box_of(scan, place.frame)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    size = box.high - box.low
    front, back = box.low + square * size, box.low + (square + np.array([0, 0, 1])) * size
    faces = front[None] if scan.block is None else scan.block.corners
    return place.tree(faces), place.tree(np.concatenate([front, back]))


def _hull(points: Array) -> Array:
    return np.asarray(cv2.convexHull(points.astype(np.float32))[:, 0])


def _board(axes: Axes, faces: Array, block: Array) -> None:
    axes.fill(*_hull(block).T, facecolor=WOOD, edgecolor=MUTED, linewidth=0.8, alpha=0.55, zorder=3)
    width = 2.2 if len(faces) == 1 else 1.3
    for face in faces:
        axes.fill(*face.T, facecolor="none", edgecolor=ACCENT, linewidth=width, zorder=4, joinstyle="round")


def _across(place: Place, faces: Array, block: Array) -> Any:
    view = _section_axes(place)
    faces, block = faces @ view.T, block @ view.T
    radii = place.radii[place.radii > 0]
    stride = max(1, int(np.ceil(len(radii) / _MOST_RINGS)))
    outer = max(float(radii.max()) if len(radii) else 0.0, float(np.hypot(*block.T).max()) if not len(radii) else 0.0)

    def draw(axes: Axes) -> None:
        turn = np.linspace(0.0, 2 * np.pi, 121)
        for number, radius in enumerate(radii[::stride]):
            bold = number % 10 == 0
            axes.plot(
                radius * np.cos(turn), radius * np.sin(turn), color=MUTED, linewidth=0.9 if bold else 0.4, alpha=0.75
            )
        axes.plot(0, 0, marker="+", color=INK, markersize=8, zorder=5)
        _board(axes, faces, block)
        reach = np.concatenate([*faces, [[-outer, -outer], [outer, outer]]])
        _frame(axes, reach)

    return draw


def _along(place: Place, faces: Array, block: Array) -> Any:
    board = place.board_to_tree[:3, :3]
    normal, middle = board[:, 2], place.tree(place.centre)
    across = normal if np.hypot(normal[0], normal[1]) > 0.3 else middle
    length = float(np.hypot(across[0], across[1]))
    right = np.array([across[0], across[1], 0.0]) / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    down = np.array([0.0, 0.0, -1.0 if board[2, 1] < 0 else 1.0])
    faces, block = (corners @ np.stack([right, down]).T for corners in (faces, block))
    outer = float(place.radii.max()) if len(place.radii) else float(np.abs(block[:, 0]).max())

    def draw(axes: Axes) -> None:
        # As much of the trunk as is wide, so that both drawings have one scale.
        middle, half = 0.5 * float(block[:, 1].min() + block[:, 1].max()), 0.56 * float(np.ptp(block[:, 1]))
        low, high = middle - max(outer, half), middle + max(outer, half)
        axes.fill([-outer, outer, outer, -outer], [low, low, high, high], facecolor=RULE, alpha=0.35, linewidth=0)
        axes.plot([0, 0], [low, high], color=INK, linewidth=1.0, linestyle=(0, (6, 3, 1.5, 3)))
        _board(axes, faces, block)
        _frame(axes, np.array([[-outer, low], [outer, high]]))

    return draw


def _frame(axes: Axes, reach: Array) -> None:
    axes.set_aspect("equal")
    axes.set_axis_off()
    low, high = reach.min(axis=0), reach.max(axis=0)
    rim = 0.02 * float((high - low).max())
    axes.set(xlim=(low[0] - rim, high[0] + rim), ylim=(high[1] + rim, low[1] - rim))


def _widths(place: Place, pixel_size: float | None, length: str) -> str | None:
    """Ring widths of the fitted tree over the ring's number."""
    if len(place.radii) < 3:
        return None
    unit, factor = ("px", 1.0) if pixel_size is None else (length, pixel_size)
    widths = np.diff(place.radii) * factor

    def draw(axes: Axes) -> None:
        axes.plot(np.arange(len(widths)) + 1, widths, color=ACCENT, linewidth=1.4, drawstyle="steps-mid")
        axes.set(xlim=(0.5, len(widths) + 0.5), ylim=(0, 1.06 * float(widths.max())))
        axes.set(xlabel="ring, from the pith", ylabel=f"width, {unit}")

    alt = f"Widths of {len(widths)} rings of the fitted tree, {widths.min():.3g} to {widths.max():.3g} {unit}."
    return svg("widths", alt, (400, 180), draw)
