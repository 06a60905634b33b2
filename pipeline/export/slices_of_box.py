"""The six faces of the block, and their net to cut out and fold."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.export.registry import Options
from pipeline.export.slices import plane, write_png
from pipeline.report.pictures import Bytes
from woodfit.block_extent import Extent, block_extent

if TYPE_CHECKING:
    from woodfit import SolidTexture

#: Corner, right and down of each face seen from outside, in shares of the block (docs/block.md).
FACES = {
    "front": ((0, 0, 0), (1, 0, 0), (0, 1, 0)),
    "right": ((1, 0, 0), (0, 0, 1), (0, 1, 0)),
    "back": ((1, 0, 1), (-1, 0, 0), (0, 1, 0)),
    "left": ((0, 0, 1), (0, 0, -1), (0, 1, 0)),
    "top": ((0, 0, 1), (1, 0, 0), (0, 0, -1)),
    "bottom": ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
}


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME_front.png`` … of the six faces, and ``NAME_net.png``, in which neighbours meet at their edges."""
    extent = block_extent(texture)
    step = float(extent.size.max()) / options.cells
    pictures = {name: face_picture(texture, extent, name, step, options.detail) for name in FACES}
    files = []
    for name, picture in {**pictures, "net": net(pictures)}.items():
        path = folder / f"{options.name}_{name}.png"
        write_png(path, picture)
        files.append(path)
    return files


def face_picture(texture: SolidTexture, extent: Extent, name: str, step: float, detail: bool) -> Bytes:
    """One face of the block, `step` units of the texture to a px."""
    corner, right, down = (np.array(part, float) for part in FACES[name])
    width, height = (max(1, round(float(np.abs(way) @ extent.size) / step)) for way in (right, down))
    at = (extent.low + corner * extent.size, right * extent.size, down * extent.size)
    return plane(texture, at, (width, height), detail)


def net(pictures: dict[str, Bytes]) -> Bytes:
    """A cross: the top above the front, left, front, right and back in a row, the bottom below the front."""
    deep, wide = pictures["left"].shape[1], pictures["front"].shape[1]
    high = pictures["front"].shape[0]
    sheet = np.full((high + 2 * deep, 2 * (deep + wide), 3), 255, np.uint8)
    places = {
        "top": (0, deep),
        "left": (deep, 0),
        "front": (deep, deep),
        "right": (deep, deep + wide),
        "back": (deep, 2 * deep + wide),
        "bottom": (deep + high, deep),
    }
    for name, (top, left) in places.items():
        height, width = pictures[name].shape[:2]
        sheet[top : top + height, left : left + width] = pictures[name]
    return sheet
