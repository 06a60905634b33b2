"""PNG slices through the block along its three axes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.export.registry import Options
from pipeline.report.pictures import Bytes, srgb_bytes
from woodfit.block_extent import block_extent

if TYPE_CHECKING:
    from woodfit import SolidTexture

#: For each axis that a slice lies across: the axes along its picture's rows and columns.
_ALONG = {"x": (2, 1), "y": (0, 2), "z": (0, 1)}

_BATCH = 1 << 20


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME_x_1.png`` … at even steps, `slices` across each axis; x runs right, y down, z into the wood."""
    extent = block_extent(texture)
    step = float(extent.size.max()) / options.cells
    files = []
    for axis, (across, down) in _ALONG.items():
        fixed = "xyz".index(axis)
        width, height = (max(1, round(float(extent.size[one]) / step)) for one in (across, down))
        for number in range(options.slices):
            corner, right, below = extent.low.copy(), np.zeros(3), np.zeros(3)
            corner[fixed] += (number + 0.5) / options.slices * extent.size[fixed]
            right[across], below[down] = extent.size[across], extent.size[down]
            path = folder / f"{options.name}_{axis}_{number + 1}.png"
            write_png(path, plane(texture, (corner, right, below), (width, height), options.detail))
            files.append(path)
    return files


def plane(
    texture: SolidTexture,
    at: tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]],
    size: tuple[int, int],
    detail: bool,
) -> Bytes:
    """The wood on a rectangle, as sRGB (H, W, 3): corner, way to the right, way down, in the texture's unit."""
    (corner, right, down), (width, height) = at, size
    u = (np.arange(width) + 0.5) / width
    picture = np.empty((height, width, 3), np.uint8)
    rows = max(1, _BATCH // width)
    for top in range(0, height, rows):
        v = (np.arange(top, min(height, top + rows)) + 0.5) / height
        points = corner + u[None, :, None] * right + v[:, None, None] * down
        picture[top : top + rows] = srgb_bytes(texture.evaluate(points, detail).rgb)
    return picture


def write_png(path: Path, rgb: Bytes) -> None:
    """Write sRGB bytes."""
    done, data = cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))
    if not done:
        raise OSError(f"{path} cannot be encoded")
    path.write_bytes(data.tobytes())
