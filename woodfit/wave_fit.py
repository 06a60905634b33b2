"""Waves fitted to the profile across the rings: the other half of the curved Gabor filter.

The image smoothed along the rings is sampled along the path across them, and ``c + Re(z exp(2j pi f d))`` is fitted
to it under a Gaussian window of so many wavelengths. Inside the image this is the Gabor response with its mean
removed; at a border, where only one side exists, the fit stays unbiased where a convolution would not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from woodfit.streamlines import advance, inside, room, sample

FloatArray = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
ComplexArray = npt.NDArray[np.complex64]

#: A one-sided or nearly empty window cannot tell the wave from its mean: it is damped instead of blowing up.
_DAMPING = 0.02


@njit(inline="always")
def solve_wave(w: Any, c: Any, s: Any, cc: Any, cs: Any, z: Any, zc: Any, zs: Any, zz: Any) -> tuple[Any, Any]:
    """Least squares of z = mean + a cos + b sin from its weighted sums; the wave and the explained share.

    w is the window's mass, c and s are the sums of cos and sin, z that of the signal, pairs those of products.
    """
    if w <= 1e-6:
        return np.complex64(0.0), np.float32(0.0)
    ss = w - cc - s * s / w
    cc = cc - c * c / w
    cs = cs - c * s / w
    zc = zc - z * c / w
    zs = zs - z * s / w
    zz = zz - z * z / w
    cc += _DAMPING * w
    ss += _DAMPING * w
    det = cc * ss - cs * cs
    a = (zc * ss - zs * cs) / det
    b = (zs * cc - zc * cs) / det
    explained = (a * zc + b * zs) / (zz + 1e-12)
    # cos(2 pi f d + phase) = cos(phase) cos - sin(phase) sin
    # The damping of a full window is taken back: unit gain.
    gain = 1.0 + 2.0 * _DAMPING
    return np.complex64(complex(gain * a, -gain * b)), np.float32(min(max(explained, 0.0), 1.0))


@njit(parallel=True, cache=True)
def _fit_across(
    frequency: FloatArray,
    p: int,
    cycles: float,
    smooth: FloatArray,
    supported: FloatArray,
    support: FloatArray,
    free: npt.NDArray[np.int16],
    nor_x: FloatArray,
    nor_y: FloatArray,
    rows: IntArray,
    cols: IntArray,
) -> tuple[ComplexArray, FloatArray]:
    """`supported` is the smooth image times its support; `free` is the `room` where the support is full."""
    right, bottom = np.float32(smooth.shape[1] - 1), np.float32(smooth.shape[0] - 1)
    response = np.zeros(rows.shape[0], np.complex64)
    explained = np.zeros(rows.shape[0], np.float32)
    for i in prange(rows.shape[0]):
        row, col = rows[i], cols[i]
        center = smooth[row, col]
        f = float(frequency[i])
        sigma = cycles / f
        # Long waves are walked as finely as short ones: in longer steps fine fibres pass for a ripple of the phase.
        extent = min(p, int(3.0 * sigma) + 1)
        # The window and the wave by recurrence: no transcendental function in the inner loop.
        turn_c = np.cos(2.0 * np.pi * f)
        turn_s = np.sin(2.0 * np.pi * f)
        shrink = np.exp(-1.0 / (sigma * sigma))
        fall = np.exp(-0.5 / (sigma * sigma))
        gauss = 1.0
        c = 1.0
        s = 0.0
        m_w = m_c = m_cc = float(support[row, col])
        m_s = m_cs = m_z = m_zc = m_zs = m_zz = 0.0
        x = u = np.float32(col)
        y = v = np.float32(row)
        px, py = nor_x[row, col], nor_y[row, col]
        pu, pv = -px, -py
        if free[row, col] >= extent:
            for _ in range(extent):
                x, y, px, py = advance(nor_x, nor_y, x, y, px, py)
                u, v, pu, pv = advance(nor_x, nor_y, u, v, pu, pv)
                gauss *= fall
                fall *= shrink
                c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
                z_ahead = sample(smooth, x, y) - center
                z_behind = sample(smooth, u, v) - center
                both = gauss * (z_ahead + z_behind)
                m_w += 2.0 * gauss
                m_c += 2.0 * gauss * c
                m_cc += 2.0 * gauss * c * c
                m_z += both
                m_zc += both * c
                m_zs += gauss * (z_ahead - z_behind) * s
                m_zz += gauss * (z_ahead * z_ahead + z_behind * z_behind)
            response[i], explained[i] = solve_wave(m_w, m_c, m_s, m_cc, m_cs, m_z, m_zc, m_zs, m_zz)
            continue
        on_ahead = True
        on_behind = True
        for _ in range(extent):
            ahead = np.float32(0.0)
            behind = np.float32(0.0)
            z_ahead = np.float32(0.0)
            z_behind = np.float32(0.0)
            if on_ahead:
                x, y, px, py = advance(nor_x, nor_y, x, y, px, py)
                on_ahead = inside(x, y, right, bottom)
                if on_ahead:
                    ahead = sample(support, x, y)
                    if ahead > np.float32(1e-6):
                        z_ahead = sample(supported, x, y) / ahead - center
            if on_behind:
                u, v, pu, pv = advance(nor_x, nor_y, u, v, pu, pv)
                on_behind = inside(u, v, right, bottom)
                if on_behind:
                    behind = sample(support, u, v)
                    if behind > np.float32(1e-6):
                        z_behind = sample(supported, u, v) / behind - center
            if not (on_ahead or on_behind):
                break
            gauss *= fall
            fall *= shrink
            c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
            even = gauss * (ahead + behind)
            odd = gauss * (ahead - behind)
            both = gauss * (ahead * z_ahead + behind * z_behind)
            m_w += even
            m_c += even * c
            m_s += odd * s
            m_cc += even * c * c
            m_cs += odd * c * s
            m_z += both
            m_zc += both * c
            m_zs += gauss * (ahead * z_ahead - behind * z_behind) * s
            m_zz += gauss * (ahead * z_ahead * z_ahead + behind * z_behind * z_behind)
        response[i], explained[i] = solve_wave(m_w, m_c, m_s, m_cc, m_cs, m_z, m_zc, m_zs, m_zz)
    return response, explained


def prepared(
    smooth: npt.NDArray[Any], support: npt.NDArray[Any], normal: npt.NDArray[Any], rows: Any, cols: Any
) -> tuple[Any, ...]:
    """What both kernels take: image, image times support, support, `room`, unit normals and pixels."""
    angle = np.asarray(normal)
    image = np.ascontiguousarray(smooth, np.float32)
    mass = np.ascontiguousarray(support, np.float32)
    return (
        image,
        image * mass,
        mass,
        room(mass > 0.999),
        np.cos(angle).astype(np.float32),
        np.sin(angle).astype(np.float32),
        np.ascontiguousarray(rows, np.int64),
        np.ascontiguousarray(cols, np.int64),
    )


def fit_across(
    smooth: npt.NDArray[Any],
    support: npt.NDArray[Any],
    normal: npt.NDArray[Any],
    rows: npt.NDArray[Any],
    cols: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    p: int,
    cycles: float,
) -> tuple[ComplexArray, FloatArray]:
    """Fit a wave of known frequency to the profile across the rings at chosen pixels.

    Parameters
    ----------
    smooth, support : arrays of shape (M, N)
        From `woodfit.streamlines.smooth_along`.
    normal : array of shape (M, N)
        Direction across the rings in radians, image frame; the phase grows along it.
    rows, cols : integer arrays of shape (K,)
        Pixels to fit at.
    frequency : array of shape (K,)
        Frequency at each pixel in cycles per pixel.
    p : int
        Longest reach of the path, in steps of one pixel, to each side; it ends at three standard deviations.
    cycles : float
        Standard deviation of the window in wavelengths.

    Returns
    -------
    response : complex64 array of shape (K,)
        ``z``: its magnitude is the wave's amplitude, its phase grows along `normal`.
    explained : float32 array of shape (K,)
        Share of the windowed variance that the wave explains, 0..1.
    """
    fields = prepared(smooth, support, normal, rows, cols)
    return _fit_across(np.ascontiguousarray(frequency, np.float32), p, cycles, *fields)
