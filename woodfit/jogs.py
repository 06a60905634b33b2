"""Where a traced boundary jumps from one ring to another: cut there, so that each part gets its own index.

Where rings are torn (a wound, a crack, sawdust), or where the wave counts one ring less on one side than on the other,
a trace is led across the rings. A boundary does not cross rings: what gets half a ring onward on a way of a ring and a
half is not one boundary but two, and the way between them is none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from woodfit.grids import block_mean, enlarged, grid_step, nearest
from woodfit.tracing import Trace

FloatArray = npt.NDArray[np.float64]

#: A jog gets this many rings onward on a way along the rings of that many rings.
_ONWARD, _WAY = 0.5, 1.5

#: Slope against the rings of what is taken out, and over how many rings it is averaged.
_SLOPE, _AVERAGED = 0.2, 0.3

#: Where the axes of growth within a ring differ more than this (length of their mean, angles doubled), none is known.
_ONE_AXIS = 0.7


def without_jogs(
    traces: list[Trace],
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    ring_scale_px: float,
    shortest_rings: float,
) -> list[Trace]:
    """Traces cut where they cross from one ring to another.

    Parameters
    ----------
    traces : list of Trace
    growth, frequency : arrays of shape (M, N)
        Outward direction in rad, rings per pixel.
    ring_scale_px : float
        Characteristic ring width.
    shortest_rings : float
        Parts shorter than this many local ring widths are left out.

    Returns
    -------
    list of Trace
        Those without a jog are the same objects.
    """
    step = grid_step(ring_scale_px)
    # Of axes, since growth turns round at the pith and where it is not known.
    doubled = [
        enlarged(
            np.asarray(gaussian_filter(block_mean(part.astype(np.float32), step), ring_scale_px / step), np.float32),
            step,
            growth.shape,
        )
        for part in (np.cos(2.0 * growth), np.sin(2.0 * growth))
    ]
    kept: list[Trace] = []
    for trace in traces:
        cos, sin = (nearest(part, trace.points).astype(np.float64) for part in doubled)
        axis = 0.5 * np.arctan2(sin, cos)
        across = np.where(np.hypot(cos, sin) < _ONE_AXIS, 0.0, np.stack([np.cos(axis), np.sin(axis)])).T
        kept += _cut(trace, across, nearest(frequency, trace.points).astype(np.float64), shortest_rings)
    return kept


def _cut(trace: Trace, across: FloatArray, frequency: FloatArray, shortest_rings: float) -> list[Trace]:
    """Parts of a trace between its jogs, by the axes across the rings (K, 2) and rings per px (K,) at its vertices."""
    count = len(trace.points)
    # Once round and once more: a jog may lie where a closed trace begins.
    around = np.arange(2 * count if trace.closed else count) % count
    moves = np.diff(trace.points[around], axis=0)
    axes = across[around]
    # From vertex to vertex an axis keeps its direction.
    kept = np.where((axes[1:] * axes[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    axes[1:] *= np.cumprod(kept)[:, None]
    onward = (moves * axes[:-1]).sum(axis=1) * frequency[around[:-1]]
    passed = np.hypot(*moves.T) * frequency[around[:-1]]
    at, height = (np.concatenate([[0.0], np.cumsum(of)]) for of in (passed, onward))
    begin = np.arange(len(around))
    end = np.searchsorted(at, at + _WAY) - 1
    jogs = np.flatnonzero(np.abs(height[end] - height) > _ONWARD)
    if not len(jogs):
        return [trace]
    ends = np.zeros(len(around) + 1, np.int64)
    np.add.at(ends, begin[jogs], 1)
    np.add.at(ends, end[jogs] + 1, -1)
    near = np.cumsum(ends)[:-1] > 0
    sigma = max(0.5 * _AVERAGED / max(float(np.median(passed)), 1e-9), 1e-3)
    slope = gaussian_filter1d(onward, sigma) / np.maximum(gaussian_filter1d(passed, sigma), 1e-9)
    steep = near & (np.abs(np.append(slope, slope[-1])) > _SLOPE)
    out = np.zeros(count, bool)
    out[around[steep]] = True
    if not out.any():
        return [trace]
    order = np.arange(count)
    if trace.closed:
        order = np.roll(order, -int(np.flatnonzero(out)[0]))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (~out[order]).astype(np.int8), [0]])))
    parts = [order[first:last] for first, last in zip(edges[::2], edges[1::2], strict=True)]
    along = np.hypot(*np.diff(trace.points, axis=0, append=trace.points[:1]).T) * frequency
    return [
        Trace(trace.points[part], trace.confidence[part], False)
        for part in parts
        if len(part) >= 4 and along[part[:-1]].sum() >= shortest_rings
    ]
