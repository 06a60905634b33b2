"""Walks along the rings: one of the two one-dimensional halves of the curved Gabor filter.

The curved region of the paper (Sec. 3.2) is a bundle of contours that follow the local orientation. Its sum over a
contour depends only on the contour's mid point, so the bundle separates: smooth once along the contours
(`smooth_along`), then look at that image along the path across them (`woodfit.wave_fit`).

All walks take steps of one pixel. The heading of a step is extrapolated from the last two (Adams-Bashforth of
second order), which costs no additional look-up and keeps a walk on a circle of ten pixels' radius from drifting.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit, prange

FloatArray = npt.NDArray[np.float32]

#: Pixels off the wood that are smoothed as well, so that slopes are known up to its edge.
MARGIN_PX = 10


@njit(inline="always")
def advance(dir_x: FloatArray, dir_y: FloatArray, x: Any, y: Any, px: Any, py: Any) -> tuple[Any, Any, Any, Any]:
    """A step of one px from (x, y), last direction (px, py): the new place and the direction it was taken in."""
    # Unsigned indices: numba needs no test for negative ones.
    col = np.uint32(np.int32(x + np.float32(0.5)))
    row = np.uint32(np.int32(y + np.float32(0.5)))
    dx = dir_x[row, col]
    dy = dir_y[row, col]
    sign = np.float32(1.0) if dx * px + dy * py >= np.float32(0.0) else np.float32(-1.0)
    dx *= sign
    dy *= sign
    x += np.float32(1.5) * dx - np.float32(0.5) * px
    y += np.float32(1.5) * dy - np.float32(0.5) * py
    return x, y, dx, dy


@njit(inline="always")
def inside(x: Any, y: Any, right: Any, bottom: Any) -> bool:
    """Whether (x, y) is on the image, whose last pixel is (right, bottom)."""
    return bool(x >= np.float32(0.0) and y >= np.float32(0.0) and x <= right and y <= bottom)


@njit(inline="always")
def sample(image: FloatArray, x: Any, y: Any) -> Any:
    """Bilinear."""
    left = min(np.uint32(np.int32(x)), np.uint32(image.shape[1] - 2))
    top = min(np.uint32(np.int32(y)), np.uint32(image.shape[0] - 2))
    fx = x - np.float32(left)
    fy = y - np.float32(top)
    right = left + np.uint32(1)
    below = top + np.uint32(1)
    upper = image[top, left] + fx * (image[top, right] - image[top, left])
    lower = image[below, left] + fx * (image[below, right] - image[below, left])
    return upper + fy * (lower - upper)


def room(whole: npt.NDArray[np.bool_]) -> npt.NDArray[np.int16]:
    """Steps of one pixel that a walk can take from each pixel and surely stay on the image and where it is `whole`.

    Within them a walk needs to ask neither for the border nor for the weight.
    """
    framed = np.pad(whole.astype(np.uint8), 1)
    distance = cv2.distanceTransform(framed, cv2.DIST_C, 3)[1:-1, 1:-1]
    # The extrapolated heading adds up to one pixel over the whole walk, the bilinear sample another.
    return np.asarray(np.clip(distance - 3.0, -1.0, 32000.0), dtype=np.int16)


@njit(inline="always")
def _two_free(
    image: FloatArray, tan_x: FloatArray, tan_y: FloatArray, taper: FloatArray, row: Any, col: Any
) -> tuple[Any, Any]:
    """Weighted sums along the rings through a pixel and the one right of it, where nothing is in the way.

    Four walks at once: each waits for its own last step, and the processor fills the wait with the others.
    """
    one = np.float32(1.0)
    first, second = taper[0] * image[row, col], taper[0] * image[row, col + 1]
    ax, ay, apx, apy = np.float32(col), np.float32(row), tan_x[row, col], tan_y[row, col]
    bx, by, bpx, bpy = ax, ay, -apx, -apy
    cx, cy, cpx, cpy = ax + one, ay, tan_x[row, col + 1], tan_y[row, col + 1]
    dx, dy, dpx, dpy = cx, cy, -cpx, -cpy
    for j in range(1, taper.shape[0]):
        ax, ay, apx, apy = advance(tan_x, tan_y, ax, ay, apx, apy)
        bx, by, bpx, bpy = advance(tan_x, tan_y, bx, by, bpx, bpy)
        cx, cy, cpx, cpy = advance(tan_x, tan_y, cx, cy, cpx, cpy)
        dx, dy, dpx, dpy = advance(tan_x, tan_y, dx, dy, dpx, dpy)
        first += taper[j] * (sample(image, ax, ay) + sample(image, bx, by))
        second += taper[j] * (sample(image, cx, cy) + sample(image, dx, dy))
    return first, second


@njit(inline="always")
def _one_way(
    weighted: FloatArray,
    weight: FloatArray,
    tan_x: FloatArray,
    tan_y: FloatArray,
    taper: FloatArray,
    row: Any,
    col: Any,
    sign: Any,
) -> tuple[Any, Any]:
    """Weighted sum and mass of the steps from a pixel along or against its tangent, as far as the image reaches."""
    right, bottom = np.float32(weight.shape[1] - 1), np.float32(weight.shape[0] - 1)
    acc = mass = np.float32(0.0)
    x, y = np.float32(col), np.float32(row)
    px, py = sign * tan_x[row, col], sign * tan_y[row, col]
    for j in range(1, taper.shape[0]):
        x, y, px, py = advance(tan_x, tan_y, x, y, px, py)
        if not inside(x, y, right, bottom):
            break
        acc += taper[j] * sample(weighted, x, y)
        mass += taper[j] * sample(weight, x, y)
    return acc, mass


@njit(parallel=True, cache=True)
def _smooth_along(
    weighted: FloatArray,
    weight: FloatArray,
    wanted: npt.NDArray[np.bool_],
    free: npt.NDArray[np.int16],
    tan_x: FloatArray,
    tan_y: FloatArray,
    taper: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """`weighted` is image times weight; `free` is the `room` where the weight is 1."""
    height, width = weighted.shape
    smooth = np.zeros((height, width), np.float32)
    support = np.zeros((height, width), np.float32)
    steps = taper.shape[0] - 1
    # One after the other: a sum shared among threads would depend on their number.
    total = taper[0]
    for j in range(1, taper.shape[0]):
        total += np.float32(2.0) * taper[j]
    for row in prange(height):
        done = 0
        for col in range(width):
            if col < done or not wanted[row, col]:
                continue
            if col + 1 < width and free[row, col] >= steps and free[row, col + 1] >= steps:
                first, second = _two_free(weighted, tan_x, tan_y, taper, row, col)
                smooth[row, col], smooth[row, col + 1] = first / total, second / total
                support[row, col] = support[row, col + 1] = np.float32(1.0)
                done = col + 2
                continue
            ahead, mass_ahead = _one_way(weighted, weight, tan_x, tan_y, taper, row, col, np.float32(1.0))
            behind, mass_behind = _one_way(weighted, weight, tan_x, tan_y, taper, row, col, np.float32(-1.0))
            mass = taper[0] * weight[row, col] + mass_ahead + mass_behind
            if mass > np.float32(1e-6):
                smooth[row, col] = (taper[0] * weighted[row, col] + ahead + behind) / mass
                support[row, col] = mass / total
    return smooth, support


def smooth_along(
    image: npt.NDArray[Any],
    weight: npt.NDArray[Any],
    orientation: npt.NDArray[Any],
    q: int,
    sigma_px: float,
) -> tuple[FloatArray, FloatArray]:
    """Gaussian mean of an image along the ring through each pixel.

    Parameters
    ----------
    image : array of shape (M, N)
        Grey values.
    weight : array of shape (M, N)
        0 where a pixel must not count (background, crack), 1 where it does.
    orientation : array of shape (M, N)
        Tangent of the rings in radians, image frame (from +x towards +y); only defined up to pi.
    q : int
        Most steps of one pixel in each of the two directions; the walk ends at 2.5 standard deviations.
    sigma_px : float
        Standard deviation of the Gaussian along the ring.

    Returns
    -------
    smooth, support : arrays of shape (M, N), float32
        The weighted mean, and the share of the Gaussian's mass that it rests on; both 0 at pixels more than
        `MARGIN_PX` from any of weight.
    """
    steps = int(min(q, np.ceil(2.5 * sigma_px)))
    taper = np.exp(-0.5 * (np.arange(steps + 1) / sigma_px) ** 2).astype(np.float32)
    theta = np.asarray(orientation)
    mass = np.ascontiguousarray(weight, np.float32)
    return _smooth_along(
        np.ascontiguousarray(np.asarray(image, np.float32) * mass),
        mass,
        grown(mass > 0.0, MARGIN_PX),
        room(mass == 1.0),
        np.cos(theta).astype(np.float32),
        np.sin(theta).astype(np.float32),
        taper,
    )


def grown(mask: npt.NDArray[np.bool_], margin_px: int) -> npt.NDArray[np.bool_]:
    """The mask and the pixels up to `margin_px` from it along either axis."""
    side = 2 * margin_px + 1
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
