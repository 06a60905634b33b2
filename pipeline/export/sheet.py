"""A veneer sheet to print at true scale: PDF pages of one sheet, with a ruler."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.export.registry import Options, mm_per_unit
from pipeline.export.slices import plane
from pipeline.problems import Problem, UsageError
from woodfit.block_extent import block_extent

if TYPE_CHECKING:
    from woodfit import SolidTexture

_MARGIN_MM, _RULER_MM = 10.0, 50.0
_MM_PER_INCH = 25.4

#: A sheet of more pixels is refused rather than left to fill the memory.
_MOST_PIXELS = 400_000_000


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME_sheet.pdf``: the wood on a plane parallel to the face, `depth_mm` behind it, on one page."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.figure import Figure

    scale = mm_per_unit(texture, options, "a sheet at true scale")
    extent = block_extent(texture)
    if options.depth_mm > extent.size[2] * scale:
        what = f"found {options.depth_mm:g} mm, but the block is {extent.size[2] * scale:.4g} mm deep"
        raise UsageError("The command cannot be followed", [Problem("--depth", what)])
    width_mm, height_mm = extent.size[:2] * scale
    size = tuple(max(1, round(side * options.dpi / _MM_PER_INCH)) for side in (width_mm, height_mm))
    if size[0] * size[1] > _MOST_PIXELS:
        what = f"{size[0]} x {size[1]} px are too many; give a lower --dpi"
        raise UsageError("The command cannot be followed", [Problem("--dpi", what)])
    corner = extent.low + np.array([0.0, 0.0, options.depth_mm / scale])
    right, down = np.array([extent.size[0], 0.0, 0.0]), np.array([0.0, extent.size[1], 0.0])
    picture = plane(texture, (corner, right, down), (size[0], size[1]), options.detail)
    page = np.array([width_mm + 2 * _MARGIN_MM, height_mm + 3 * _MARGIN_MM])
    figure = Figure(figsize=tuple(page / _MM_PER_INCH), dpi=options.dpi)
    FigureCanvasPdf(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, page[0]), ylim=(0, page[1]))
    axes.set_axis_off()
    bottom = 2 * _MARGIN_MM
    axes.imshow(
        picture,
        extent=(_MARGIN_MM, _MARGIN_MM + width_mm, bottom, bottom + height_mm),
        interpolation="none",
        aspect="auto",
    )
    ruler = min(_RULER_MM, width_mm)
    for place in np.arange(0.0, ruler + 1e-6, 10.0):
        axes.plot([_MARGIN_MM + place] * 2, [8.0, 11.0], color="black", linewidth=0.6)
    axes.plot([_MARGIN_MM, _MARGIN_MM + ruler], [8.0, 8.0], color="black", linewidth=0.6)
    words = f"{width_mm:.1f} x {height_mm:.1f} mm, {options.depth_mm:g} mm deep. Print at 100 %: a tick is 10 mm."
    axes.text(_MARGIN_MM, 3.0, words, fontsize=6)
    path = folder / f"{options.name}_sheet.pdf"
    # Without a date, so that equal sheets are equal files.
    figure.savefig(path, format="pdf", metadata={"CreationDate": None, "Title": options.name})
    return [path]
