"""Walks along and across the rings: the two one-dimensional halves of the curved Gabor filter.

The curved region of the paper (Sec. 3.2) is a bundle of contours that follow the local orientation. Its sum over a
contour depends only on the contour's mid point, so the bundle separates: smooth once along the contours
(`smooth_along`), then look at that image along the path across them (`fit_across`).

All walks take steps of one pixel. The heading of a step is extrapolated from the last two (Adams-Bashforth of
second order), which costs no additional look-up and keeps a walk on a circle of ten pixels' radius from drifting.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

FloatArray = npt.NDArray[np.float32]


@njit(inline="always")
def _advance(
    dir_x: FloatArray, dir_y: FloatArray, x: Any, y: Any, px: Any, py: Any
) -> tuple[Any, Any, Any, Any]:  # pragma: no cover - compiled
    """One step from (x, y) with the last direction (px, py): the new place and the direction it was taken in."""
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
def _inside(x: Any, y: Any, right: Any, bottom: Any) -> bool:  # pragma: no cover - compiled
    return bool(x >= np.float32(0.0) and y >= np.float32(0.0) and x <= right and y <= bottom)


@njit(inline="always")
def _sample(image: FloatArray, x: Any, y: Any) -> Any:  # pragma: no cover - compiled
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


@njit(parallel=True, cache=True)
def _smooth_along(
    weighted: FloatArray, weight: FloatArray, whole: bool, tan_x: FloatArray, tan_y: FloatArray, taper: FloatArray
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """`weighted` is image times weight; `whole` says that the weight is 1 everywhere."""
    height, width = weighted.shape
    smooth = np.zeros((height, width), np.float32)
    support = np.zeros((height, width), np.float32)
    right, bottom = np.float32(width - 1), np.float32(height - 1)
    total = taper[0] + np.float32(2.0) * taper[1:].sum()
    for row in prange(height):
        for col in range(width):
            acc = taper[0] * weighted[row, col]
            mass = taper[0] * weight[row, col]
            x = u = np.float32(col)
            y = v = np.float32(row)
            px, py = tan_x[row, col], tan_y[row, col]
            pu, pv = -px, -py
            ahead = True
            behind = True
            # Both ways at once: each walk waits for its own last step, and the processor fills the wait with the other.
            for j in range(1, taper.shape[0]):
                if ahead:
                    x, y, px, py = _advance(tan_x, tan_y, x, y, px, py)
                    ahead = _inside(x, y, right, bottom)
                    if ahead:
                        acc += taper[j] * _sample(weighted, x, y)
                        mass += taper[j] if whole else taper[j] * _sample(weight, x, y)
                if behind:
                    u, v, pu, pv = _advance(tan_x, tan_y, u, v, pu, pv)
                    behind = _inside(u, v, right, bottom)
                    if behind:
                        acc += taper[j] * _sample(weighted, u, v)
                        mass += taper[j] if whole else taper[j] * _sample(weight, u, v)
                if not (ahead or behind):
                    break
            if mass > np.float32(1e-6):
                smooth[row, col] = acc / mass
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
        Steps of one pixel in each of the two directions.
    sigma_px : float
        Standard deviation of the Gaussian along the ring.

    Returns
    -------
    smooth, support : arrays of shape (M, N), float32
        The weighted mean, and the share of the Gaussian's mass that it rests on.
    """
    taper = np.exp(-0.5 * (np.arange(q + 1) / sigma_px) ** 2).astype(np.float32)
    theta = np.asarray(orientation)
    mass = np.ascontiguousarray(weight, np.float32)
    return _smooth_along(
        np.ascontiguousarray(np.asarray(image, np.float32) * mass),
        mass,
        bool((mass == 1.0).all()),
        np.cos(theta).astype(np.float32),
        np.sin(theta).astype(np.float32),
        taper,
    )


@njit(inline="always")
def _solve_wave(m: Any, cycles_power: float) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Least squares of s = c + a cos + b sin from its moments; returns a, b and the explained share.

    m: 0 W, 1 C, 2 S, 3 CC, 4 CS, 5 SS, 6 Z, 7 ZC, 8 ZS, 9 ZZ (weighted sums; Z the signal).
    """
    w = m[0]
    if w <= 1e-6:
        return 0.0, 0.0, 0.0
    cc = m[3] - m[1] * m[1] / w
    ss = m[5] - m[2] * m[2] / w
    cs = m[4] - m[1] * m[2] / w
    zc = m[7] - m[6] * m[1] / w
    zs = m[8] - m[6] * m[2] / w
    zz = m[9] - m[6] * m[6] / w
    # A one-sided or nearly empty window cannot tell the wave from its mean: damp instead of blowing up.
    damp = cycles_power * w
    cc += damp
    ss += damp
    det = cc * ss - cs * cs
    a = (zc * ss - zs * cs) / det
    b = (zs * cc - zc * cs) / det
    explained = (a * zc + b * zs) / (zz + 1e-12)
    return a, b, min(max(explained, 0.0), 1.0)


@njit(parallel=True, cache=True)
def _fit_across(
    smooth: FloatArray,
    supported: FloatArray,
    support: FloatArray,
    nor_x: FloatArray,
    nor_y: FloatArray,
    rows: npt.NDArray[np.int64],
    cols: npt.NDArray[np.int64],
    frequency: FloatArray,
    p: int,
    cycles: float,
) -> tuple[npt.NDArray[np.complex64], FloatArray]:  # pragma: no cover - compiled
    height, width = smooth.shape
    right, bottom = np.float32(width - 1), np.float32(height - 1)
    count = rows.shape[0]
    bank = frequency.shape[1]
    response = np.zeros((count, bank), np.complex64)
    explained = np.zeros((count, bank), np.float32)
    for i in prange(count):
        profile = np.zeros(2 * p + 1, np.float64)
        weight = np.zeros(2 * p + 1, np.float64)
        row = rows[i]
        col = cols[i]
        profile[p] = smooth[row, col]
        weight[p] = support[row, col]
        lowest = frequency[i, 0]
        for k in range(1, bank):
            lowest = min(lowest, frequency[i, k])
        reach = min(p, int(3.0 * cycles / lowest) + 1)
        x = u = np.float32(col)
        y = v = np.float32(row)
        px, py = nor_x[row, col], nor_y[row, col]
        pu, pv = -px, -py
        ahead = True
        behind = True
        for j in range(1, reach + 1):
            if ahead:
                x, y, px, py = _advance(nor_x, nor_y, x, y, px, py)
                ahead = _inside(x, y, right, bottom)
                if ahead:
                    weight[p + j] = _sample(support, x, y)
                    if weight[p + j] > 1e-6:
                        profile[p + j] = _sample(supported, x, y) / weight[p + j]
            if behind:
                u, v, pu, pv = _advance(nor_x, nor_y, u, v, pu, pv)
                behind = _inside(u, v, right, bottom)
                if behind:
                    weight[p - j] = _sample(support, u, v)
                    if weight[p - j] > 1e-6:
                        profile[p - j] = _sample(supported, u, v) / weight[p - j]
            if not (ahead or behind):
                break
        moments = np.zeros(10, np.float64)
        for k in range(bank):
            f = float(frequency[i, k])
            sigma = cycles / f
            extent = min(p, int(3.0 * sigma) + 1)
            # The window and the wave by recurrence: no transcendental function in the inner loop.
            turn_c = np.cos(2.0 * np.pi * f)
            turn_s = np.sin(2.0 * np.pi * f)
            shrink = np.exp(-1.0 / (sigma * sigma))
            fall = np.exp(-0.5 / (sigma * sigma))
            gauss = 1.0
            c = 1.0
            s = 0.0
            moments[:] = 0.0
            moments[0] = weight[p]
            moments[1] = weight[p]
            moments[3] = weight[p]
            for j in range(1, extent + 1):
                gauss *= fall
                fall *= shrink
                c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
                ahead = gauss * weight[p + j]
                behind = gauss * weight[p - j]
                if ahead + behind <= 0.0:
                    continue
                z_ahead = profile[p + j] - profile[p]
                z_behind = profile[p - j] - profile[p]
                even = ahead + behind
                odd = ahead - behind
                moments[0] += even
                moments[1] += even * c
                moments[2] += odd * s
                moments[3] += even * c * c
                moments[4] += odd * c * s
                moments[5] += even * s * s
                z_even = ahead * z_ahead + behind * z_behind
                moments[6] += z_even
                moments[7] += z_even * c
                moments[8] += (ahead * z_ahead - behind * z_behind) * s
                moments[9] += ahead * z_ahead * z_ahead + behind * z_behind * z_behind
            a, b, share = _solve_wave(moments, 0.02)
            # cos(2 pi f d + phase) = cos(phase) cos - sin(phase) sin
            # The damping of a full window, 2 x 0.02, is taken back: unit gain.
            response[i, k] = 1.04 * complex(a, -b)
            explained[i, k] = share
    return response, explained


def fit_across(
    smooth: npt.NDArray[Any],
    support: npt.NDArray[Any],
    normal: npt.NDArray[Any],
    rows: npt.NDArray[Any],
    cols: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    p: int,
    cycles: float,
) -> tuple[npt.NDArray[np.complex64], FloatArray]:
    """Fit waves of given frequencies to the profile across the rings at chosen pixels.

    At each pixel the contour-smoothed image is sampled along the path across the rings, and
    ``c + Re(z exp(2j pi f d))`` is fitted to it under a Gaussian window of ``cycles / f``. Inside the image this is
    the Gabor response with its mean removed; at a border, where only one side exists, the fit stays unbiased where
    a convolution would not.

    Parameters
    ----------
    smooth, support : arrays of shape (M, N)
        From `smooth_along`.
    normal : array of shape (M, N)
        Direction across the rings in radians, image frame; the phase grows along it.
    rows, cols : integer arrays of shape (K,)
        Pixels to fit at.
    frequency : array of shape (K, F)
        Frequencies in cycles per pixel.
    p : int
        Longest reach of the path, in steps of one pixel, to each side.
    cycles : float
        Standard deviation of the window in wavelengths.

    Returns
    -------
    response : complex64 array of shape (K, F)
        ``z``: its magnitude is the wave's amplitude, its phase grows along `normal`.
    explained : float32 array of shape (K, F)
        Share of the windowed variance that the wave explains, 0..1.
    """
    angle = np.asarray(normal)
    mass = np.ascontiguousarray(support, np.float32)
    return _fit_across(
        np.ascontiguousarray(smooth, np.float32),
        np.ascontiguousarray(np.asarray(smooth, np.float32) * mass),
        mass,
        np.cos(angle).astype(np.float32),
        np.sin(angle).astype(np.float32),
        np.ascontiguousarray(rows, np.int64),
        np.ascontiguousarray(cols, np.int64),
        np.ascontiguousarray(frequency, np.float32),
        p,
        cycles,
    )
