"""Noise on lattices in the tree: one impulse to each cell, long along an axis, by hashing alone.

Nothing is stored: cell (i, j, k) of a lattice gets its impulse from a hash of its numbers, so the noise is the same
wherever and whenever it is asked for, and never comes again. Across the long axis impulses are round bumps at random
places; along it one fades into the next, each column of cells out of step with its neighbours, so that no plane of the
lattice shows. (Lagae et al., "A survey of procedural noise functions", CGF 2010: sparse convolution.)
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

#: Kinds of noise: what its long axis is.
FIBRE, PORE, RAY, LAYER = 0, 1, 2, 3

#: Brings the signed noises to a standard deviation of about 1 (measured over many cells).
_UNIT = 10.0

#: Fewest cells around the tree: nearer to the pith their number stays, and they narrow.
_FEWEST_AROUND = 8.0

# 32 bits, so that a shader can do the same: unsigned products of two fit into 64 and are cut off again.
_A, _B, _C = np.uint64(0x9E3779B1), np.uint64(0x85EBCA77), np.uint64(0xC2B2AE3D)
_M1, _M2 = np.uint64(0x85EBCA6B), np.uint64(0xC2B2AE35)
_S11, _S13, _S16, _S22 = np.uint64(11), np.uint64(13), np.uint64(16), np.uint64(22)
_LOW11, _LOW24, _LOW32 = np.uint64(0x7FF), np.uint64(0xFFFFFF), np.uint64(0xFFFFFFFF)
_TO_10, _TO_11, _TO_24 = 1.0 / 1024.0, 1.0 / 2048.0, 1.0 / 16777216.0


def pore_spread(density: float) -> float:
    """Standard deviation of pores of depth 1 (fitted to what was measured)."""
    return float(np.sqrt(0.47 * density - 0.32 * density**2))


@njit(inline="always")
def _hash(i: Any, j: Any, k: Any, seed: Any) -> Any:
    """32 well mixed bits (in a uint64) of three cell numbers (int64) and a seed (uint64 below 2³²)."""
    bits = ((np.uint64(i) * _A) ^ (np.uint64(j) * _B) ^ (np.uint64(k) * _C) ^ seed) & _LOW32
    bits = ((bits ^ (bits >> _S16)) * _M1) & _LOW32
    bits = ((bits ^ (bits >> _S13)) * _M2) & _LOW32
    return bits ^ (bits >> _S16)


@njit(inline="always")
def _around(number: Any, period: Any) -> Any:
    """Cell number on an axis that closes after `period` cells; 0 for one that does not."""
    if period > 0:
        number %= period
    return number


@njit(inline="always")
def _impulses(i: Any, j: Any, a: Any, p: Any, q: Any, reach: Any, period_a: Any, density: Any, seed: Any) -> Any:
    """What the column of cells (i, j) gives at p, q from its corner, and a along; in cells.

    Signed impulses, or with a `density` above 0 dark ones in that share of the cells.
    """
    step = a + np.float64(_hash(i, j, 7919, seed) & _LOW24) * _TO_24
    k = np.int64(np.floor(step))
    part = step - k
    later = part * part * (3.0 - 2.0 * part)
    total = 0.0
    for end in range(2):
        bits = _hash(i, j, _around(k + end, period_a), (seed + _C) & _LOW32)
        # Across q, places within the cell keep a margin, so that bumps of radius `reach` end within the next cell.
        dx = p - np.float64(bits & _LOW11) * _TO_11
        dy = q - 0.5 - (np.float64((bits >> _S11) & _LOW11) * _TO_11 - 0.5) * (2.0 * reach - 1.0)
        near = reach * reach - dx * dx - dy * dy
        if near > 0.0:
            chance = np.float64(bits >> _S22) * _TO_10
            depth = (-1.0 if chance < density else 0.0) if density > 0.0 else 2.0 * chance - 1.0
            total += (later if end else 1.0 - later) * depth * near * near
    return total


@njit(inline="always")
def _columns(p: Any, q: Any, a: Any, period_p: Any, period_a: Any, seed: Any) -> Any:
    """Sum of the impulses near a place given in cells, p and q across and a along: four to six columns reach it.

    Impulses lie anywhere along p, and cells are shifted along q from row to row: on no plane through the lattice is
    the noise stronger than on another.
    """
    total = 0.0
    for i in range(np.int64(np.floor(p - 0.75)), np.int64(np.floor(p + 0.75)) + 1):
        row = _around(i, period_p)
        place = q + np.float64(_hash(row, 104729, 7919, seed) & _LOW24) * _TO_24
        above = np.int64(np.floor(place - 0.5))
        for j in range(above, above + 2):
            total += _impulses(row, j, a, p - i, place - j, 0.75, period_a, 0.0, seed)
    return _UNIT * total


@njit(inline="always")
def _pores(p: Any, q: Any, a: Any, density: Any, seed: Any) -> Any:
    """As `_columns`, of dark impulses anywhere in their cells, which nine columns can reach."""
    ip, iq = np.int64(np.floor(p)), np.int64(np.floor(q))
    total = 0.0
    for i in range(ip - 1, ip + 2):
        for j in range(iq - 1, iq + 2):
            total += _impulses(i, j, a, p - i, q - j, 1.0, 0, density, seed)
    return total


@njit(inline="always")
def _sectors(circumference: Any) -> Any:
    """Cells around the tree at a circumference given in cells: their number, and how far on to twice as many, 0..1."""
    level = np.log2(max(circumference / _FEWEST_AROUND, 1.0))
    whole = np.floor(level)
    return np.int64(_FEWEST_AROUND * 2.0**whole), level - whole


@njit(inline="always")
def noise_at(
    kind: Any, cells: Any, density: Any, seed: Any, radius: Any, turn: Any, x: Any, y: Any, height: Any
) -> Any:
    """One noise at one place; see `render`. `turn` is the azimuth in turns, 0..1."""
    c0, c1, c2 = cells
    if kind == FIBRE:
        return _columns(x / c0, y / c1, height / c2, 0, 0, seed)
    if kind == PORE:
        return _pores(x / c0, y / c1, height / c2, density, seed)
    # Cells around the tree double in number from shell to shell, and each shell fades into the next.
    arc = c0 if kind == RAY else c2
    around, part = _sectors(2.0 * np.pi * radius / arc)
    total = 0.0
    for end in range(2):
        fade = np.sin(0.5 * np.pi * part) if end else np.cos(0.5 * np.pi * part)
        if fade > 1e-9:
            place = turn * around
            if kind == RAY:
                value = _columns(place, height / c1, radius / c2, around, 0, (seed + np.uint64(around)) & _LOW32)
            else:
                value = _columns(radius / c0, height / c1, place, 0, around, (seed + np.uint64(around)) & _LOW32)
            total += fade * value
        around *= 2
    return total


@njit(parallel=True, cache=True)
def render(
    kind: int,
    cells: npt.NDArray[np.float64],
    density: float,
    seed: np.uint64,
    radius: npt.NDArray[np.float64],
    azimuth: npt.NDArray[np.float64],
    height: npt.NDArray[np.float64],
) -> npt.NDArray[np.float32]:
    """One noise at N points.

    Parameters
    ----------
    kind : int
        FIBRE and PORE: long along the stem; cells (x, y, height). RAY: long along the radius; cells (arc, height,
        radius). LAYER: long around the tree; cells (radius, height, arc).
    cells : array of shape (3,)
        Size of the lattice's cells in px.
    density : float
        Share of the cells of a PORE lattice that hold one.
    seed : uint64
        Another seed, another noise.
    radius, azimuth, height : float64 arrays of shape (N,)
        Where, in the tree: ideal radius of the growth layer (px), rad, px.

    Returns
    -------
    float32 array of shape (N,)
    """
    out = np.empty(radius.size, np.float32)
    for n in prange(radius.size):
        r = max(radius[n], 0.0)
        turn = (azimuth[n] / (2.0 * np.pi)) % 1.0
        x, y = r * np.cos(azimuth[n]), r * np.sin(azimuth[n])
        out[n] = noise_at(kind, (cells[0], cells[1], cells[2]), density, seed, r, turn, x, y, height[n])
    return out


@njit(parallel=True, cache=True)
def log_color(
    kind: npt.NDArray[np.int64],
    cells: npt.NDArray[np.float64],
    density: npt.NDArray[np.float64],
    amplitude: npt.NDArray[np.float64],
    color: npt.NDArray[np.float64],
    seed: npt.NDArray[np.uint64],
    radius: npt.NDArray[np.float64],
    azimuth: npt.NDArray[np.float64],
    height: npt.NDArray[np.float64],
    lateness: npt.NDArray[np.float32],
) -> npt.NDArray[np.float32]:
    """Sum of K noises at N points, by channel; (N, 3). Amplitudes (K, 2) are of early- and latewood, colors (K, 3)."""
    out = np.zeros((radius.size, 3), np.float32)
    for n in prange(radius.size):
        r = max(radius[n], 0.0)
        turn = (azimuth[n] / (2.0 * np.pi)) % 1.0
        x, y = r * np.cos(azimuth[n]), r * np.sin(azimuth[n])
        late = np.float64(lateness[n])
        red, green, blue = 0.0, 0.0, 0.0
        for k in range(kind.size):
            strength = amplitude[k, 0] + late * (amplitude[k, 1] - amplitude[k, 0])
            if strength != 0.0:
                at = (cells[k, 0], cells[k, 1], cells[k, 2])
                value = strength * noise_at(kind[k], at, density[k], seed[k], r, turn, x, y, height[n])
                red += color[k, 0] * value
                green += color[k, 1] * value
                blue += color[k, 2] * value
        out[n, 0], out[n, 1], out[n, 2] = red, green, blue
    return out
