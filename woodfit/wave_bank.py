"""A bank of waves fitted to the profile across the rings: `woodfit.wave_fit` where all pixels share the frequencies.

Each profile is walked once, and the window and the waves come from tables.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from woodfit.streamlines import advance, inside, sample
from woodfit.wave_fit import ComplexArray, FloatArray, IntArray, prepared, solve_wave

#: Pixels whose profiles one thread takes at a time.
_BLOCK = 64


@njit(inline="always")
def _profile(
    profile: FloatArray,
    weight: FloatArray,
    smooth: FloatArray,
    supported: FloatArray,
    support: FloatArray,
    free: Any,
    nor_x: FloatArray,
    nor_y: FloatArray,
    row: Any,
    col: Any,
) -> None:
    """Fill (2, reach + 1) arrays: the profile less its centre, ahead and behind, and its weight."""
    right, bottom = np.float32(smooth.shape[1] - 1), np.float32(smooth.shape[0] - 1)
    center = smooth[row, col]
    profile[:] = np.float32(0.0)
    weight[:] = np.float32(0.0)
    weight[:, 0] = np.float32(0.5) * support[row, col]
    whole = free >= profile.shape[1] - 1
    for side in range(2):
        x, y = np.float32(col), np.float32(row)
        px, py = nor_x[row, col], nor_y[row, col]
        if side == 1:
            px, py = -px, -py
        for j in range(1, profile.shape[1]):
            x, y, px, py = advance(nor_x, nor_y, x, y, px, py)
            if whole:
                weight[side, j] = np.float32(1.0)
                profile[side, j] = sample(smooth, x, y) - center
                continue
            if not inside(x, y, right, bottom):
                break
            weight[side, j] = sample(support, x, y)
            if weight[side, j] > np.float32(1e-6):
                profile[side, j] = sample(supported, x, y) / weight[side, j] - center


@njit(parallel=True, cache=True)
def _fit_bank(
    smooth: FloatArray,
    supported: FloatArray,
    support: FloatArray,
    free: npt.NDArray[np.int16],
    nor_x: FloatArray,
    nor_y: FloatArray,
    rows: IntArray,
    cols: IntArray,
    gauss: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
) -> tuple[ComplexArray, FloatArray]:
    """The window and the waves of the bank are given as arrays of shape (reach + 1, F)."""
    count, (length, bank) = rows.shape[0], gauss.shape
    response = np.zeros((count, bank), np.complex64)
    explained = np.zeros((count, bank), np.float32)
    for block in prange(-(-count // _BLOCK)):
        profile = np.empty((2, length), np.float32)
        weight = np.empty((2, length), np.float32)
        m = np.empty((9, bank), np.float32)
        for i in range(block * _BLOCK, min((block + 1) * _BLOCK, count)):
            row, col = rows[i], cols[i]
            _profile(profile, weight, smooth, supported, support, free[row, col], nor_x, nor_y, row, col)
            m[:] = np.float32(0.0)
            for j in range(length):
                ahead, behind = weight[0, j], weight[1, j]
                z_ahead, z_behind = ahead * profile[0, j], behind * profile[1, j]
                even, odd = ahead + behind, ahead - behind
                z_even, z_odd = z_ahead + z_behind, z_ahead - z_behind
                power = z_ahead * profile[0, j] + z_behind * profile[1, j]
                # Over the bank, not over the profile: neighbouring sums that the processor takes side by side.
                for k in range(bank):
                    g = gauss[j, k]
                    gc = g * cosine[j, k]
                    gs = g * sine[j, k]
                    m[0, k] += even * g
                    m[1, k] += even * gc
                    m[2, k] += odd * gs
                    m[3, k] += even * gc * cosine[j, k]
                    m[4, k] += odd * gs * cosine[j, k]
                    m[5, k] += z_even * g
                    m[6, k] += z_even * gc
                    m[7, k] += z_odd * gs
                    m[8, k] += power * g
            for k in range(bank):
                response[i, k], explained[i, k] = solve_wave(
                    m[0, k], m[1, k], m[2, k], m[3, k], m[4, k], m[5, k], m[6, k], m[7, k], m[8, k]
                )
    return response, explained


def fit_bank(
    smooth: npt.NDArray[Any],
    support: npt.NDArray[Any],
    normal: npt.NDArray[Any],
    rows: npt.NDArray[Any],
    cols: npt.NDArray[Any],
    bank: npt.NDArray[Any],
    p: int,
    cycles: float,
) -> tuple[ComplexArray, FloatArray]:
    """Fit each wave of a bank at chosen pixels: `woodfit.wave_fit.fit_across` for F shared frequencies.

    Parameters
    ----------
    smooth, support, normal, rows, cols, p, cycles
        As in `fit_across`.
    bank : array of shape (F,)
        Frequencies in cycles per pixel.

    Returns
    -------
    response, explained : complex64 and float32 arrays of shape (K, F)
        As in `fit_across`.
    """
    f = np.asarray(bank, np.float64)
    sigma = cycles / f
    extent = np.minimum(p, (3.0 * sigma).astype(int) + 1)
    steps = np.arange(extent.max() + 1)[:, None]
    gauss = np.exp(-0.5 * (steps / sigma) ** 2) * (steps <= extent)
    wave = 2.0 * np.pi * f * steps
    tables = (np.ascontiguousarray(a, np.float32) for a in (gauss, np.cos(wave), np.sin(wave)))
    return _fit_bank(*prepared(smooth, support, normal, rows, cols), *tables)
