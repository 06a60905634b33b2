"""Rings of a disc as closed curves: gaps bridged where what lies on both sides agrees, and places that do not flagged.

Around a pith that is seen every ring is closed. Where stain, saw marks or a crack hide it, its pieces are joined along
the neighbouring rings, onto the edge where there is one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.boundary import edge_offsets
from woodfit.grids import nearest
from woodfit.ring_order import Order
from woodfit.tracing import Trace

FloatArray = npt.NDArray[np.float64]

#: Directions in which a ring's radius is kept: half a degree.
_BINS = 720
#: Belief given to a bridge that lies on no edge of its own.
_BRIDGED = 0.5


@dataclass
class _Ring:
    """All pieces of one index: their radius by direction, NaN where there is none."""

    members: list[int]
    radius: FloatArray


def close_rings(
    traces: list[Trace],
    order: Order,
    pith: tuple[float, float],
    strength: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    widest_gap_rad: float = 1.4,
) -> tuple[list[Trace], Order]:
    """Join the pieces of each ring of the largest group around the pith.

    Parameters
    ----------
    traces : list of Trace
        With probabilities as confidence.
    order : Order
        Their indices.
    pith : x, y in pixels
        The pith.
    strength, frequency : arrays of shape (M, N)
        Edge strength and rings per pixel.
    valid : bool array of shape (M, N)
        The wood.
    widest_gap_rad : float
        Widest gap bridged.

    Returns
    -------
    traces : list of Trace
        Pieces joined; a bridge is believed 0.5 at most. Doubtful fragments in the way of a bridge are gone.
    order : Order
        Theirs.
    """
    rings = _by_index(traces, order, np.asarray(pith))
    gone: set[int] = set()
    new: list[tuple[Trace, int]] = []
    # The most complete rings first: they guide the others.
    for index in sorted(rings, key=lambda k: (int(np.isnan(rings[k].radius).sum()), k)):
        ring = rings[index]
        if gone.intersection(ring.members):
            left = [i for i in ring.members if i not in gone]
            ring = rings[index] = _ring_of(left, traces, np.asarray(pith)) or ring
        if len(ring.members) == 1 and traces[ring.members[0]].closed:
            continue
        bridge = _bridged(ring, rings.get(index - 1), rings.get(index + 1), widest_gap_rad)
        if bridge is None:
            continue
        others = {i: trace for i, trace in enumerate(traces) if i not in gone and i not in ring.members}
        others |= {len(traces) + number: trace for number, (trace, _) in enumerate(new)}
        in_the_way = _in_the_way(bridge, np.isnan(ring.radius), others, np.asarray(pith), frequency)
        if in_the_way is None:
            continue
        joined = _joined(ring, bridge, traces, np.asarray(pith), strength, frequency, valid)
        if joined is None:
            continue
        gone |= in_the_way | set(ring.members)
        ring.radius = bridge
        new.append((joined, index))
    kept = [i for i in range(len(traces)) if i not in gone]
    lines = [traces[i] for i in kept] + [trace for trace, _ in new]
    numbers = np.array([i for _, i in new], np.int64)
    agreement = np.array([order.agreement[rings[i].members].mean() for _, i in new], np.float64)
    merged = Order(
        np.concatenate([order.index[kept], numbers]),
        np.concatenate([order.group[kept], np.zeros(len(new), np.int64)]),
        np.concatenate([order.agreement[kept], agreement]),
    )
    return lines, merged


def _polar(points: FloatArray, pith: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction (rad, continuous along the line) and radius of points around the pith."""
    away = points - pith
    return np.unwrap(np.arctan2(away[:, 1], away[:, 0])), np.hypot(away[:, 0], away[:, 1])


def _radii(trace: Trace, pith: FloatArray) -> FloatArray | None:
    """Radius by direction, shape (`_BINS`,); None for a line that does not go round the pith one way."""
    theta, radius = _polar(_round(trace), pith)
    if len(theta) < 4 or abs(theta[-1] - theta[0]) < 0.8 * np.abs(np.diff(theta)).sum():
        return None
    if theta[-1] < theta[0]:
        theta, radius = theta[::-1], radius[::-1]
    theta = np.maximum.accumulate(theta)
    grid = np.arange(np.ceil(theta[0] / _step()), np.floor(theta[-1] / _step()) + 1)
    if len(grid) > 1.02 * _BINS:
        return None
    found = np.full(_BINS, np.nan)
    found[grid.astype(int) % _BINS] = np.interp(grid * _step(), theta, radius)
    return found


def _round(trace: Trace) -> FloatArray:
    """Points of a trace; of a closed one with the first repeated at the end."""
    return np.concatenate([trace.points, trace.points[:1]]) if trace.closed else trace.points


def _step() -> float:
    return 2.0 * np.pi / _BINS


def _by_index(traces: list[Trace], order: Order, pith: FloatArray) -> dict[int, _Ring]:
    """Rings of the largest group whose pieces do not overlap."""
    members: dict[int, list[int]] = {}
    for i in np.flatnonzero(order.group == 0).tolist():
        members.setdefault(int(order.index[i]), []).append(i)
    found = {index: _ring_of(pieces, traces, pith) for index, pieces in members.items()}
    return {index: ring for index, ring in found.items() if ring is not None}


def _ring_of(members: list[int], traces: list[Trace], pith: FloatArray) -> _Ring | None:
    """The ring of some pieces; None where one does not go round the pith or they overlap."""
    ring = _Ring(members, np.full(_BINS, np.nan))
    for radius in (_radii(traces[i], pith) for i in members):
        if radius is None or (np.isfinite(radius) & np.isfinite(ring.radius)).sum() > 4:
            return None
        ring.radius = np.where(np.isfinite(ring.radius), ring.radius, radius)
    return ring


def _bridged(ring: _Ring, inner: _Ring | None, outer: _Ring | None, widest_rad: float) -> FloatArray | None:
    """Radius in all directions, along the neighbours where they are known; None where a gap is too wide."""
    known = np.flatnonzero(np.isfinite(ring.radius))
    if len(known) < 0.4 * _BINS:
        return None
    gaps = np.diff(np.concatenate([known, [known[0] + _BINS]]))
    if gaps.max() * _step() > widest_rad:
        return None
    cyclic = np.concatenate([known - _BINS, known, known + _BINS])

    def across(values: FloatArray) -> FloatArray:
        return np.asarray(np.interp(np.arange(_BINS), cyclic, np.tile(values[known], 3)))

    guides = [g.radius for g in (inner, outer) if g is not None and np.isfinite(g.radius).all()]
    if not guides:
        return across(ring.radius)
    # The share of the way between its neighbours changes slowly along a ring, its radius need not.
    return np.asarray(np.mean([guide + across(ring.radius - guide) for guide in guides], axis=0))


def _in_the_way(
    bridge: FloatArray,
    gap: npt.NDArray[np.bool_],
    others: dict[int, Trace],
    pith: FloatArray,
    frequency: npt.NDArray[Any],
) -> set[int] | None:
    """Doubtful lines that a bridge would meet; None when it would meet one that is not doubtful."""
    met = set()
    for i, trace in others.items():
        theta, radius = _polar(trace.points, pith)
        column = np.round(theta / _step()).astype(int) % _BINS
        if (gap[column] & (np.abs(radius - bridge[column]) < 0.3 / nearest(frequency, trace.points))).any():
            if float(trace.confidence.mean()) > 0.9 or gap[column].mean() < 0.9:
                return None
            met.add(i)
    return met


def _joined(
    ring: _Ring,
    bridge: FloatArray,
    traces: list[Trace],
    pith: FloatArray,
    strength: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
) -> Trace | None:
    """One closed line through the pieces and over the gaps; None when a bridge would leave the wood."""
    pieces = []
    for i in ring.members:
        theta, _ = _polar(traces[i].points, pith)
        trace = (
            traces[i]
            if theta[-1] > theta[0]
            else replace(traces[i], points=traces[i].points[::-1], confidence=traces[i].confidence[::-1])
        )
        theta, _ = _polar(trace.points, pith)
        pieces.append((float(theta[0] % (2.0 * np.pi)), float(theta[-1] - theta[0]), trace))
    pieces.sort(key=lambda piece: piece[0])
    parts: list[Trace] = []
    for number, (start, sweep, trace) in enumerate(pieces):
        following = pieces[(number + 1) % len(pieces)][0]
        gap = (following - (start + sweep)) % (2.0 * np.pi)
        if gap > 6.0:
            # They overlap a little: the line must not turn back.
            theta, _ = _polar(trace.points, pith)
            ahead = theta - theta[0] < sweep + gap - 2.0 * np.pi
            parts.append(Trace(trace.points[ahead], trace.confidence[ahead], False))
            continue
        parts.append(trace)
        over = _bridge(start + sweep, gap, bridge, pith, strength, frequency)
        cols, rows = (np.round(over.points[:, k]).astype(int) for k in (0, 1))
        inside = (cols >= 0) & (rows >= 0) & (cols < valid.shape[1]) & (rows < valid.shape[0])
        if not inside.all() or (len(over.points) and valid[rows, cols].mean() < 0.7):
            return None
        parts.append(over)
    return Trace(np.concatenate([p.points for p in parts]), np.concatenate([p.confidence for p in parts]), True)


def _bridge(
    start_rad: float,
    gap_rad: float,
    bridge: FloatArray,
    pith: FloatArray,
    strength: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
) -> Trace:
    """Line over one gap, about a pixel from vertex to vertex, drawn to an edge but not at its ends."""
    typical = float(bridge.mean())
    count = max(0, round(gap_rad * typical) - 1)
    theta = start_rad + gap_rad * (np.arange(count) + 1.0) / (count + 1.0)
    radius = np.interp(theta % (2.0 * np.pi), np.arange(_BINS + 1) * _step(), np.append(bridge, bridge[0]))
    outwards = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    points = pith + outwards * radius[:, None]
    if count < 8:
        return Trace(points, np.full(count, _BRIDGED), False)
    width = 1.0 / nearest(frequency, points)
    offset, contrast = edge_offsets(np.asarray(strength, np.float32), points, theta, width, 0.0, 0.1, False)
    taper = np.minimum(1.0, np.minimum(np.arange(count) + 1.0, count - np.arange(count)) / np.maximum(width, 1.0))
    belief = _BRIDGED * np.clip(contrast / 2.0, 0.2, 1.0)
    return Trace(points + outwards * (offset * taper)[:, None], belief, False)


def uneven_counts(traces: list[Trace], order: Order, pith: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """Directions (half degrees) in which the count of boundaries crossed is not what the indices say.

    Returns
    -------
    bool array of shape (720,)
        True where a ring between the innermost and the outermost crossed is missing, crossed twice, or out of order.
    """
    crossed: list[list[tuple[float, int]]] = [[] for _ in range(_BINS)]
    for i, trace in enumerate(traces):
        if order.group[i] != 0:
            continue
        theta, radius = _polar(_round(trace), np.asarray(pith))
        place = np.floor(theta / _step()).astype(int)
        for j in np.flatnonzero(np.diff(place) != 0):
            # Near the pith one step passes several directions.
            for direction in range(min(place[j], place[j + 1]) + 1, max(place[j], place[j + 1]) + 1):
                crossed[direction % _BINS].append((float(radius[j]), int(order.index[i])))
    uneven = np.zeros(_BINS, bool)
    for direction, met in enumerate(crossed):
        indices = [index for _, index in sorted(met)]
        uneven[direction] = any(b - a != 1 for a, b in pairwise(indices))
    return uneven


def describe_uneven(traces: list[Trace], order: Order, pith: tuple[float, float]) -> list[str]:
    """Where the count of rings along a radius is not that of its neighbours, in words."""
    uneven = uneven_counts(traces, order, pith)
    if not uneven.any():
        return []
    steps = np.diff(np.concatenate([[0], uneven.astype(np.int8), [0]]))
    spans = sorted(zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1), strict=True), key=lambda s: s[0] - s[1])
    widest = ", ".join(f"{start // 2} to {(end + 1) // 2}" for start, end in spans[:3])
    return [
        f"In {100 * float(uneven.mean()):.0f} % of the directions around the pith a ring is not traced, or wedges out "
        f"(widest, degrees from right towards down: {widest})."
    ]
