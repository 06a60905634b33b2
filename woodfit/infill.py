"""Boundaries that the phase missed: narrow rings beside wide ones, where one frequency cannot serve both.

Between each traced boundary and the next one outwards the strongest continuous edge is sought. It becomes a boundary
when it is about as strong as the two it lies between, along most of its length. One missed ring shifts every date
beyond it, so this look is worth its time. Where many seem to be missed, it is streaks of the grain.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.boundary import edge_offsets, sample_image
from woodfit.grids import nearest
from woodfit.ring_belief import believe, without_doubtful
from woodfit.ring_walks import Surroundings, distance_outwards, draw_labels
from woodfit.tracing import Trace

FloatArray = npt.NDArray[np.float32]


#: Strength that is needed, as a share of that of the two boundaries around, and the share of the length where it is.
LEAST_SHARE, LEAST_LENGTH = 0.5, 0.75

#: How often the space between boundaries is halved at most: a run of narrow rings among wide ones needs it.
_LOOKS = 5

#: Length that may be found between the boundaries, as a share of theirs: up to 0.09 on cores and discs. Where there is
#: more (0.4 to 2.4 on walnut and birch boards), streaks of the grain are as strong as the rings.
MOST_MISSED = 0.2


def missed_boundaries(
    traces: list[Trace],
    strength: FloatArray,
    growth: FloatArray,
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    mean_slope: FloatArray,
) -> list[Trace]:
    """Additional boundaries between the traced ones; none if they are so many that they must be grain.

    Parameters
    ----------
    traces : list of Trace
        Boundaries on their edges.
    strength : array of shape (M, N)
        From `woodfit.boundary.edge_strength`.
    growth, frequency : arrays of shape (M, N)
        Outward direction in rad, rings per pixel.
    valid : bool array of shape (M, N)
        The wood.
    mean_slope : array of shape (M, N)
        From `woodfit.ring_belief.mean_slope`.

    Returns
    -------
    list of Trace
    """
    found: list[Trace] = []
    for _ in range(_LOOKS):
        between = _one_look(traces + found, strength, growth, frequency, valid)
        believed = without_doubtful(believe(between, strength, mean_slope, frequency))
        found += believed
        if not believed:
            break
    return found if _length(found) <= MOST_MISSED * _length(traces) else []


def _length(traces: list[Trace]) -> int:
    return sum(len(trace.points) for trace in traces)


def _one_look(
    traces: list[Trace],
    strength: FloatArray,
    growth: FloatArray,
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
) -> list[Trace]:
    """Strongest edge between each boundary and the next one outwards, where it is strong enough."""
    labels = draw_labels([t.points for t in traces], [t.closed for t in traces], strength.shape)
    around = Surroundings.of(labels, growth, frequency, valid)
    found = []
    for number, trace in enumerate(traces, start=1):
        met, way = distance_outwards(trace.points, number, around)
        found += [
            inner
            for start, end in _stretches(met > 0)
            if (inner := _between(trace, way, start, end, strength, growth)) is not None
        ]
    return found


def _stretches(mask: npt.NDArray[np.bool_], shortest: int = 12) -> list[tuple[int, int]]:
    """Runs of True at least `shortest` long; gaps of up to four are bridged."""
    closed = mask.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[1], mask.astype(np.int8), [1]])))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if start > 0 and end < len(mask) and end - start <= 4:
            closed[start:end] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[0], closed.astype(np.int8), [0]])))
    return [(int(s), int(e)) for s, e in zip(edges[::2], edges[1::2], strict=True) if e - s >= shortest]


def _between(
    trace: Trace,
    way: npt.NDArray[np.float64],
    start: int,
    end: int,
    strength: FloatArray,
    growth: FloatArray,
) -> Trace | None:
    points, width = trace.points[start:end], way[start:end].copy()
    known = width > 0
    width = np.interp(np.arange(len(width)), np.flatnonzero(known), width[known])
    if float(np.median(width)) < 7.0:
        return None
    angle = nearest(growth, points)
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offset, _ = edge_offsets(strength, points, angle, width, 0.5, 0.16, False)
    here = points + step * offset[:, None]
    edges = [np.maximum(_bilinear(strength, p), 0.0) for p in (points, here, points + step * width[:, None])]
    around = np.minimum(edges[0], edges[2])
    typical = float(np.median(around))
    # The darkening of latewood on either side must not be mistaken for a step: it has to brighten here.
    strong = edges[1] >= LEAST_SHARE * np.maximum(around, 0.7 * typical)
    clear = (offset > 0.2 * width) & (offset < 0.8 * width)
    if typical <= 0.0 or (strong & clear).mean() < LEAST_LENGTH:
        return None
    belief = trace.confidence[start:end] * np.clip(edges[1] / np.maximum(around, 1e-9), 0.0, 1.0)
    return Trace(here, belief, trace.closed and end - start == len(trace.points))


def _bilinear(image: FloatArray, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return sample_image(image, points[:, 0:1], points[:, 1:2])[:, 0]
