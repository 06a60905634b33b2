"""The picture of ``woodpipe ablate``: for each variant the front, the false-color volume, and figures below."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.ablation import Face, Variant, lateness_of_block
from pipeline.report.pictures import fit, srgb_bytes
from woodfit.volume_view import Medium, View, cut_corner, draw_volume, extinction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[Any]

_LONGER_VOXELS = 320
_PICTURE_PX = 560
_DPI = 100


def draw(variants: Sequence[Variant], face: Face, path: Path) -> None:
    """Write the side-by-side picture as PNG.

    Parameters
    ----------
    variants
        From left to right; the photograph stands before them.
    face
        What they were fitted to.
    path
        File to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    fronts = [fit(np.clip(image, 0.0, None), _PICTURE_PX) for image in (face.rgb, *(one.front for one in variants))]
    volumes = [volume_picture(one, face) for one in variants]
    columns, text_px = len(fronts), 150
    heights = [max(part.shape[0] for part in row) for row in (fronts, volumes)]
    width = max(part.shape[1] for part in (*fronts, *volumes)) + 20
    size = (columns * width / _DPI, (sum(heights) + text_px + 60) / _DPI)
    figure = Figure(figsize=size, dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    edges = {"left": 0.005, "right": 0.995, "top": 0.95, "bottom": 0.005, "hspace": 0.03, "wspace": 0.02}
    grid = figure.add_gridspec(3, columns, height_ratios=[*heights, text_px], **edges)
    for column, front in enumerate(fronts):
        title = "photograph" if column == 0 else variants[column - 1].title
        _show(figure, grid[0, column], front, title)
    for column, volume in enumerate(volumes):
        _show(figure, grid[1, column + 1], volume)
        _write(figure, grid[2, column + 1], figures_text(variants[column]))
    _write(figure, grid[1, 0], _legend(), 0.9)
    figure.savefig(path, dpi=_DPI)


def volume_picture(variant: Variant, face: Face) -> Array:
    """False-color picture (P, Q, 3), linear RGB, of a variant's block with a corner cut away."""
    medium = Medium()
    sigma = extinction(lateness_of_block(variant.texture, face, _LONGER_VOXELS), medium)
    return draw_volume(cut_corner(sigma), _PICTURE_PX, medium, View())


def figures_text(variant: Variant) -> str:
    """Figures of a variant, one a line."""
    return "\n".join(f"{name}: {value:.3g}" for name, value in variant.figures.items())


def _legend() -> str:
    medium = Medium()
    text = (
        "Above, each fit seen from the front; below, the block behind the face with a corner cut away, as a "
        f"translucent volume: extinction {medium.late:g} where lateness is above {medium.threshold:g}, else "
        f"{medium.early:g}, per tenth of the face's longer side. Image loss: displacement and colors fitted together "
        "to the photograph by Adam. Phase loss: rings first, colors after."
    )
    return textwrap.fill(text, 52)


def _show(figure: Figure, place: Any, linear: Array, title: str = "") -> None:
    axes = figure.add_subplot(place)
    axes.imshow(srgb_bytes(linear), interpolation="nearest")
    axes.set_axis_off()
    axes.set_title(title, fontsize=12)


def _write(figure: Figure, place: Any, text: str, top: float = 1.0) -> None:
    axes = figure.add_subplot(place)
    axes.set_axis_off()
    axes.text(0.06, top, text, va="top", ha="left", fontsize=11, linespacing=1.4, transform=axes.transAxes)
