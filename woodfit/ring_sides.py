"""The two sides of the pith on a face along the stem, which show the same rings.

Between them lies the wide middle, where one ring covers much of the face: a streak of the grain may be traced there, or
a ring on one side only, and the count from side to side is then a ring off. But rings lie as far from the pith on the
one side as on the other, so that their widths on the face agree, as those of two cores of one tree do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from woodfit.grids import nearest
from woodfit.tracing import Trace

#: Way to the next boundary outwards in px, by the index of a boundary.
Widths = dict[int, float]

#: Cosine to the axis of growth from which on a boundary belongs to a side.
_OF_A_SIDE = 0.8

#: Edges this much fainter than those of the face's boundaries are streaks where one ring covers the middle.
_FAINT = 0.25

#: How many rings the count may be off, by how much less likely (log) each makes another count than the counted one, and
#: by how much likelier another must be in the end.
_MOST, _PER_RING, _SURE = 3, 1.5, 1.0

#: Log widths of one ring on both sides differ by about this, known no better than from so many widths; their mean by
#: this, as growth is uneven; those of unrelated rings by this. No difference counts as more than the last.
_SCATTER, _KNOWN, _MEAN, _UNRELATED, _LARGEST = 0.07, 4.0, 0.2, 0.35, 0.7


def sides_of(polylines: Sequence[npt.NDArray[np.float64]], growth: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Side of the pith on which each boundary lies.

    Parameters
    ----------
    polylines : sequence of arrays of shape (K, 2)
        x, y of the boundaries in px.
    growth : array of shape (M, N)
        Outward direction, rad.

    Returns
    -------
    int array of shape (R,)
        1 and -1; 0 where a boundary lies on both (an arch) or across them, and everywhere on faces with one side.
    """
    means, length = np.zeros((len(polylines), 2)), np.zeros(len(polylines))
    for number, points in enumerate(polylines):
        column, row = (np.clip(np.round(points[:, i]).astype(int), 0, growth.shape[1 - i] - 1) for i in (0, 1))
        angle = growth[row, column]
        means[number], length[number] = (np.cos(angle).mean(), np.sin(angle).mean()), len(points)
    if not len(means):
        return np.zeros(0, np.int64)
    # The axis of growth has no sign, as the two sides grow against one another.
    _, _, axes = np.linalg.svd(means * np.sqrt(length)[:, None], full_matrices=False)
    along = means @ axes[0]
    side = np.where(np.abs(along) > _OF_A_SIDE, np.sign(along), 0.0).astype(np.int64)
    return side if (side > 0).any() and (side < 0).any() else np.zeros_like(side)


def without_streaks(
    traces: list[Trace],
    index: npt.NDArray[np.int64],
    growth: npt.NDArray[Any],
    strength: npt.NDArray[Any],
    ring_scale_px: float,
) -> list[Trace]:
    """Traces without streaks of the grain between the two sides, and without ends of the innermost that run on as such.

    Beside its surroundings a streak in the wide middle is as clear as a boundary elsewhere, so it is judged by the
    boundaries of the whole face. Farther out faint boundaries stay.

    Parameters
    ----------
    traces : list of Trace
    index : int array of shape (R,)
        Index of each, from `woodfit.ring_order`.
    growth, strength : arrays of shape (M, N)
        Outward direction, rad, and strength of the edges, from `woodfit.boundary.edge_strength`.
    ring_scale_px : float
        Characteristic ring width.

    Returns
    -------
    list of Trace
        `traces` itself where nothing is left out.
    """
    side = sides_of([trace.points for trace in traces], growth)
    if not side.any():
        return traces
    edges = [nearest(strength, trace.points).astype(np.float64) for trace in traces]
    clear = np.array([float(np.median(edge)) for edge in edges])
    order = np.argsort(clear)
    length = np.array([len(edge) for edge in edges], np.float64)[order]
    least = _FAINT * clear[order][np.searchsorted(np.cumsum(length), 0.5 * length.sum())]
    kept = []
    for number, trace in enumerate(traces):
        beside = (clear >= least) & (side == side[number] if side[number] else side != 0)
        if index[number] > index[beside].min(initial=np.iinfo(np.int64).max):
            kept.append(trace)
            continue
        good = np.flatnonzero(gaussian_filter1d(edges[number], ring_scale_px) >= least)
        faint_by_nature = clear[number] >= least and side[number] == 0  # the tip of an arch
        if trace.closed or faint_by_nature or len(good) == len(trace.points):
            kept.append(trace)
        elif len(good) >= 2.0 * ring_scale_px:
            part = slice(int(good[0]), int(good[-1]) + 1)
            kept.append(Trace(trace.points[part], trace.confidence[part], False))
    same = len(kept) == len(traces) and all(one is other for one, other in zip(kept, traces, strict=True))
    return traces if same else kept


def matched_shift(one: Widths, other: Widths, shift: int) -> int:
    """How many rings more the other side is to be shifted, so that the widths of both agree.

    Parameters
    ----------
    one, other : dict of int to float
        Widths of either side.
    shift : int
        By which the indices of the other side become those of the one, as counted.

    Returns
    -------
    int
        0 where the count agrees as well, or the widths do not tell.
    """
    gains = {}
    for more in range(-_MOST, _MOST + 1):
        pairs = [(one[index + shift + more], width) for index, width in other.items() if index + shift + more in one]
        gains[more] = _likeness(np.array(pairs).reshape(-1, 2)) - _PER_RING * abs(more)
    best = max(gains, key=lambda more: (gains[more], -abs(more)))
    return best if gains[best] > max(gain for more, gain in gains.items() if more != best) + _SURE else 0


def _likeness(pairs: npt.NDArray[np.float64]) -> float:
    """Log of how much likelier the widths in `pairs` (N, 2) are of the same rings than of unrelated ones."""
    count = len(pairs)
    off = np.clip(np.diff(np.log(pairs), axis=1).ravel(), -_LARGEST, _LARGEST)
    if not count:
        return 0.0
    # Student's t of all differences together, their common mean integrated out.
    spread = 1.0 + count * (_MEAN / _SCATTER) ** 2
    square = float(((off - off.mean()) ** 2).sum() + count * off.mean() ** 2 / spread) / (_KNOWN * _SCATTER**2)
    same = math.lgamma(0.5 * (_KNOWN + count)) - math.lgamma(0.5 * _KNOWN) - 0.5 * math.log(spread)
    same -= 0.5 * count * math.log(_KNOWN * math.pi * _SCATTER**2) + 0.5 * (_KNOWN + count) * math.log1p(square)
    unrelated = -0.5 * float((off * off).sum()) / _UNRELATED**2 - count * math.log(
        _UNRELATED * math.sqrt(2.0 * math.pi)
    )
    return same - unrelated
