"""Curved Gabor filter, literal form: the reference for `woodfit.curved_gabor` (paper, Sec. 3.2).

For every pixel the whole curved region is built and summed: (2p+1) x (2q+1) samples. Nothing is shared between
pixels and nothing is separated, so it is slow and easy to believe.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from woodfit.curved_gabor import ComplexArray, FloatArray, Region

Doubles = npt.NDArray[np.float64]


@njit(cache=True)
def _walk(toward_x: FloatArray, toward_y: FloatArray, x: float, y: float, path: Doubles) -> None:
    """Fill `path`, shape (2n+1, 2), with points one pixel apart on both sides of (x, y); NaN outside of the image."""
    height, width = toward_x.shape
    middle = path.shape[0] // 2
    path[:] = np.nan
    path[middle, 0] = x
    path[middle, 1] = y
    for side in (-1, 1):
        at_x, at_y = x, y
        before_x = side * toward_x[round(y), round(x)]
        before_y = side * toward_y[round(y), round(x)]
        for n in range(1, middle + 1):
            here_x = toward_x[round(at_y), round(at_x)]
            here_y = toward_y[round(at_y), round(at_x)]
            if here_x * before_x + here_y * before_y < 0.0:
                here_x, here_y = -here_x, -here_y
            # Second-order Adams-Bashforth step of length 1.
            at_x += 1.5 * here_x - 0.5 * before_x
            at_y += 1.5 * here_y - 0.5 * before_y
            before_x, before_y = here_x, here_y
            if not (0.0 <= at_x <= width - 1 and 0.0 <= at_y <= height - 1):
                break
            path[middle + side * n, 0] = at_x
            path[middle + side * n, 1] = at_y


@njit(cache=True)
def _bilinear(image: FloatArray, x: float, y: float) -> float:
    col = min(int(x), image.shape[1] - 2)
    row = min(int(y), image.shape[0] - 2)
    right = x - col
    below = y - row
    upper = (1.0 - right) * image[row, col] + right * image[row, col + 1]
    lower = (1.0 - right) * image[row + 1, col] + right * image[row + 1, col + 1]
    return float((1.0 - below) * upper + below * lower)


@njit(parallel=True, cache=True)
def _respond(
    wood_value: FloatArray,
    wood: FloatArray,
    tangent_x: FloatArray,
    tangent_y: FloatArray,
    frequency: FloatArray,
    rows: npt.NDArray[np.int64],
    cols: npt.NDArray[np.int64],
    p: int,
    q: int,
    sigma_along_px: float,
    cycles: float,
) -> ComplexArray:
    response = np.zeros(rows.size, np.complex64)
    normal_x, normal_y = -tangent_y, tangent_x
    window_along = np.exp(-0.5 * (np.arange(-q, q + 1) / sigma_along_px) ** 2)
    for i in prange(rows.size):
        f = float(frequency[i])
        across = np.empty((2 * p + 1, 2))
        contour = np.empty((2 * q + 1, 2))
        mass, value_sum = 0.0, 0.0
        wave_sum, product_sum = 0.0j, 0.0j
        _walk(normal_x, normal_y, float(cols[i]), float(rows[i]), across)
        for m in range(2 * p + 1):
            if np.isnan(across[m, 0]):
                continue
            d = m - p
            window_across = np.exp(-0.5 * (d * f / cycles) ** 2)
            wave = np.exp(-2.0j * np.pi * f * d)
            _walk(tangent_x, tangent_y, across[m, 0], across[m, 1], contour)
            for n in range(2 * q + 1):
                x, y = contour[n]
                if np.isnan(x):
                    continue
                window = window_across * window_along[n]
                weight = window * _bilinear(wood, x, y)
                value = window * _bilinear(wood_value, x, y)
                mass += weight
                value_sum += value
                wave_sum += weight * wave
                product_sum += value * wave
        if mass > 1e-6:
            # Mean removed; half of a real wave's amplitude is in the other, negative frequency.
            response[i] = 2.0 * (product_sum - wave_sum * value_sum / mass) / mass
    return response


def respond(
    value: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    orientation: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    region: Region,
    rows: npt.NDArray[Any] | None = None,
    cols: npt.NDArray[Any] | None = None,
) -> ComplexArray:
    r"""Centre response of the literal curved Gabor filter.

    With :math:`v` the bilinear sample `d` steps across and `s` steps along the rings from the pixel,

    .. math:: z = \frac{2}{\sum w} \sum_{d=-p}^{p} \sum_{s=-q}^{q} w\,(v - \bar v)\, e^{-2 \pi i f d}, \quad
        w = e^{-d^2 / 2 \sigma_d^2 - s^2 / 2 \sigma_s^2}

    so that the profile across the rings is near :math:`c + \mathrm{Re}(z\, e^{2 \pi i f d})`. Samples outside of
    the image or the wood have no weight.

    Parameters
    ----------
    value, valid, orientation, frequency : arrays of shape (M, N)
        Grey values, wood mask, ring tangent in rad (the phase grows towards tangent + 90 degrees), cycles per pixel.
    region : Region
        The curved region.
    rows, cols : integer arrays of shape (K,), optional
        Pixels to respond at; all when not given.

    Returns
    -------
    complex64 array of shape (K,), or (M, N) for all pixels
        Unit gain for a sinusoid of unit amplitude.
    """
    shape = np.shape(value)
    everywhere = rows is None or cols is None
    at_rows, at_cols = np.indices(shape).reshape(2, -1) if everywhere else (np.asarray(rows), np.asarray(cols))
    wood = np.ascontiguousarray(valid, np.float32)
    angle = np.asarray(orientation)
    response = _respond(
        np.where(wood > 0.0, value, 0.0).astype(np.float32),
        wood,
        np.cos(angle).astype(np.float32),
        np.sin(angle).astype(np.float32),
        np.asarray(frequency, np.float32)[at_rows, at_cols],
        at_rows.astype(np.int64),
        at_cols.astype(np.int64),
        region.p,
        region.q,
        region.sigma_along_px,
        region.cycles,
    )
    return np.asarray(response.reshape(shape) if everywhere else response, dtype=np.complex64)
