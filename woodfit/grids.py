"""Between an image and coarser grids of it; blocks and grids start at the first pixel, so that aligned tiles agree."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float32]

#: ``window(row, col, rows, cols, step)`` gives grey values and wood mask of a part of a scan, reduced by `step` by
#: averaging: so a gigapixel scan is looked at without being read whole.
Window = Callable[[int, int, int, int, int], tuple[FloatArray, npt.NDArray[np.bool_]]]


def nearest(image: npt.NDArray[Any], points: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Values of an image (M, N) at the pixels nearest to x, y points (K, 2); beyond the edge, of the pixels at it."""
    cols = np.clip(np.round(points[:, 0]).astype(int), 0, image.shape[1] - 1)
    rows = np.clip(np.round(points[:, 1]).astype(int), 0, image.shape[0] - 1)
    return np.asarray(image[rows, cols])


def block_mean(image: npt.NDArray[Any], step: int) -> FloatArray:
    """Mean over blocks of `step` x `step` pixels; blocks beyond the edge are filled up with its pixels."""
    if step == 1:
        return np.asarray(image, dtype=np.float32)
    bottom, right = (-n % step for n in image.shape)
    full = cv2.copyMakeBorder(image, 0, bottom, 0, right, cv2.BORDER_REPLICATE)
    size = (full.shape[1] // step, full.shape[0] // step)
    return np.asarray(cv2.resize(full, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def enlarged(coarse: FloatArray, step: int, shape: tuple[int, ...]) -> FloatArray:
    """Linear interpolation between the centres of blocks, for an image of `shape`."""
    if step == 1:
        return coarse
    size = (coarse.shape[1] * step, coarse.shape[0] * step)
    full = cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(full[: shape[0], : shape[1]], dtype=np.float32)


def between(grid: FloatArray, step: int, shape: tuple[int, ...]) -> FloatArray:
    """Linear interpolation between pixels 0, step, 2 step, ... of an image of `shape`."""
    shrink = np.array([[1.0 / step, 0.0, 0.0], [0.0, 1.0 / step, 0.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    full = cv2.warpAffine(grid, shrink, (shape[1], shape[0]), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(full, dtype=np.float32)


def grid_step(ring_scale_px: float) -> int:
    """Spacing in pixels of the grid on which the frequency is sought: a power of two, so that tiles align."""
    return int(2 ** np.clip(round(math.log2(ring_scale_px / 5.0)), 0, 4))
