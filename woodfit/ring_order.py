"""Consecutive indices for traced boundaries: who is whose neighbour, and how many rings lie between.

From points along each boundary a walk goes outwards until it meets the next one and counts the cycles of the
frequency field on its way; the edges seen there correct the count (`woodfit.rings_apart`). Each meeting is a vote
"index of b = index of a + n"; votes are joined from the strongest down. A gap in one place is bridged by another, and
where a boundary was missed, the index says so too. Across the pith of a board the count is least sure, but there both
sides show the same rings: see `woodfit.ring_sides`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from woodfit.ring_sides import Widths, matched_shift, sides_of
from woodfit.rings_apart import rings_apart
from woodfit.tied_numbers import TiedNumbers

#: Stands for a phase that is not known.
_UNKNOWN = 1e6


@dataclass(frozen=True)
class Order:
    """Indices of traced boundaries.

    Attributes
    ----------
    index : int array of shape (R,)
        Growing outwards, smallest 1; boundaries that are pieces of one ring share it.
    group : int array of shape (R,)
        Boundaries of one group are tied by votes; between groups the index is a guess. 0 is the largest.
    agreement : float array of shape (R,)
        Share of a boundary's votes that the result satisfies, 0..1 (0.5 without votes).
    """

    index: npt.NDArray[np.int64]
    group: npt.NDArray[np.int64]
    agreement: npt.NDArray[np.float64]


@njit(cache=True)
def _meet(
    labels: npt.NDArray[np.int32],
    grow_x: npt.NDArray[np.float32],
    grow_y: npt.NDArray[np.float32],
    frequency: npt.NDArray[np.float32],
    phase: npt.NDArray[np.float32],
    valid: npt.NDArray[np.bool_],
    x: float,
    y: float,
    own: int,
    outwards: float,
    most_cycles: float,
) -> tuple[int, float, float, bool, float, float]:
    """Walk across the rings to the next boundary.

    Returns the boundary met (0 for none), the cycles and the way passed, whether growth reversed, and where (x, y) the
    walk ended. The cycles are those of the phase, unless they contradict the frequency.
    """
    height, width = labels.shape
    ix, iy = int(x + 0.5), int(y + 0.5)
    hx, hy = outwards * grow_x[iy, ix], outwards * grow_y[iy, ix]
    cycles = 0.0
    turns = 0.0
    before = phase[iy, ix]
    way = 0.0
    reversed_growth = False
    step = 0.7
    for _ in range(4000):
        way += step
        x += step * hx
        y += step * hy
        if not (x >= -0.49 and y >= -0.49 and x < width - 0.51 and y < height - 0.51):
            return 0, cycles, way, reversed_growth, x, y
        ix, iy = int(x + 0.5), int(y + 0.5)
        if not valid[iy, ix]:
            return 0, cycles, way, reversed_growth, x, y
        cycles += step * frequency[iy, ix]
        change = (phase[iy, ix] - before) / (2.0 * np.pi)
        turns += outwards * (change - np.round(change))
        before = phase[iy, ix]
        met = labels[iy, ix]
        if met > 0 and (met != own or reversed_growth):
            if before < 0.5 * _UNKNOWN and abs(turns - cycles) < 0.8:
                cycles = turns
            return met, cycles, way, reversed_growth, x, y
        gx, gy = outwards * grow_x[iy, ix], outwards * grow_y[iy, ix]
        if reversed_growth:
            gx, gy = -gx, -gy
        turn = gx * hx + gy * hy
        if turn < -0.2:
            # Only an inward walk may pass the pith and come out on the other side.
            if outwards > 0.0 or reversed_growth:
                return 0, cycles, way, reversed_growth, x, y
            reversed_growth = True
            gx, gy = -gx, -gy
        if turn < -0.2 or turn > 0.2:
            hx, hy = 0.7 * hx + 0.3 * gx, 0.7 * hy + 0.3 * gy
            norm = np.sqrt(hx * hx + hy * hy)
            hx, hy = hx / norm, hy / norm
        if cycles > most_cycles:
            return 0, cycles, way, reversed_growth, x, y
    return 0, cycles, way, reversed_growth, x, y


@njit(cache=True)
def _meet_outwards(
    labels: npt.NDArray[np.int32],
    grow_x: npt.NDArray[np.float32],
    grow_y: npt.NDArray[np.float32],
    frequency: npt.NDArray[np.float32],
    phase: npt.NDArray[np.float32],
    valid: npt.NDArray[np.bool_],
    points: npt.NDArray[np.float64],
    own: int,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Boundary met outwards from each point (K, 2), 0 for none, and the way there."""
    met = np.zeros(len(points), np.int64)
    way = np.zeros(len(points), np.float64)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        number, _, passed, turned, _, _ = _meet(labels, grow_x, grow_y, frequency, phase, valid, x, y, own, 1.0, 3.0)
        if number > 0 and not turned:
            met[i], way[i] = number, passed
    return met, way


def draw_labels(
    polylines: Sequence[npt.NDArray[np.float64]], closed: Sequence[bool], shape: tuple[int, ...]
) -> npt.NDArray[np.int32]:
    """Image of `shape` with each boundary's number, counted from 1, on its line and 0 elsewhere."""
    labels = np.zeros(shape, np.int32)
    for number, (points, loop) in enumerate(zip(polylines, closed, strict=True), start=1):
        # Two pixels thick, so that no walk slips through diagonally.
        cv2.polylines(labels, [np.round(points * 16).astype(np.int32)], loop, number, thickness=2, shift=4)
    return labels


@dataclass(frozen=True)
class Surroundings:
    """Drawn boundaries and the fields that a walk between them follows, all of shape (M, N)."""

    labels: npt.NDArray[np.int32]
    grow_x: npt.NDArray[np.float32]
    grow_y: npt.NDArray[np.float32]
    frequency: npt.NDArray[np.float32]
    valid: npt.NDArray[np.bool_]
    phase: npt.NDArray[np.float32]

    @classmethod
    def of(
        cls,
        labels: npt.NDArray[np.int32],
        growth: npt.NDArray[Any],
        frequency: npt.NDArray[Any],
        valid: npt.NDArray[np.bool_],
    ) -> Surroundings:
        """From labels of `draw_labels`, outward direction in rad, rings per pixel, and the wood; phase unknown."""
        return cls(
            labels,
            np.cos(growth).astype(np.float32),
            np.sin(growth).astype(np.float32),
            np.ascontiguousarray(frequency, np.float32),
            np.ascontiguousarray(valid),
            np.full(labels.shape, _UNKNOWN, np.float32),
        )


def distance_outwards(
    points: npt.NDArray[np.float64], own: int, around: Surroundings
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Next boundary outwards from each point of boundary `own` (its number, 0 for none) and the way there in pixels."""
    inside = np.clip(points, 0, np.array(around.labels.shape[::-1]) - 1)
    return _meet_outwards(
        around.labels, around.grow_x, around.grow_y, around.frequency, around.phase, around.valid, inside, own
    )


@dataclass(frozen=True)
class _Votes:
    """What the walks between boundaries, numbered from 1, have met.

    Attributes
    ----------
    weight : dict
        Weight of each vote (a, b, n), a < b: the index of b is n more than that of a.
    way : dict
        Ways in px from a boundary outwards to the next, (a, b).
    """

    weight: dict[tuple[int, int, int], float]
    way: dict[tuple[int, int], list[float]]

    def cast(self, a: int, b: int, apart: int, weight: float) -> None:
        """Say that the index of b is `apart` more than that of a."""
        key = (a, b, apart) if a < b else (b, a, -apart)
        self.weight[key] = self.weight.get(key, 0.0) + weight


def _votes(
    polylines: Sequence[npt.NDArray[np.float64]],
    closed: Sequence[bool],
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    phase: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    strength: npt.NDArray[Any] | None,
) -> _Votes:
    """Ask along every boundary which one comes next, outwards and inwards."""
    labels = draw_labels(polylines, closed, growth.shape)
    grow_x, grow_y = np.cos(growth).astype(np.float32), np.sin(growth).astype(np.float32)
    freq = np.ascontiguousarray(frequency, np.float32)
    wave = np.ascontiguousarray(phase, np.float32)
    height, width = growth.shape
    votes = _Votes({}, {})
    met_at: list[tuple[int, int]] = []
    passed: list[tuple[float, float]] = []
    ends: list[tuple[float, float, float, float]] = []
    for number, points in enumerate(polylines, start=1):
        for x, y in points[:: max(1, min(4, len(points) // 12))]:
            x, y = float(np.clip(x, 0, width - 1)), float(np.clip(y, 0, height - 1))
            for outwards in (1.0, -1.0):
                met, cycles, way, turned, end_x, end_y = _meet(
                    labels, grow_x, grow_y, freq, wave, valid, x, y, number, outwards, 4.6
                )
                if met == 0 or met == number:
                    continue
                a, b = (number, met) if outwards > 0 else (met, number)
                if turned:
                    votes.cast(a, b, 0, 0.3)
                else:
                    met_at.append((a, b))
                    passed.append((cycles, way))
                    ends.append((x, y, end_x, end_y))
    counted = rings_apart(np.array([cycles for cycles, _ in passed]), np.array(ends), np.array(met_at), strength)
    for (a, b), (cycles, way), apart in zip(met_at, passed, counted.tolist(), strict=True):
        if apart == 1:
            votes.way.setdefault((a, b), []).append(way)
        # Counting one ring is certain, counting several less and less so.
        votes.cast(a, b, apart, 1.0 / max(1.0, cycles) ** 2)
    return votes


def _clearest(votes: dict[tuple[int, int, int], float]) -> list[tuple[int, int, int]]:
    """The strongest vote of each pair, the clearest majority first."""
    # A pair's rival votes weaken each other: a clear majority joins first.
    best: dict[tuple[int, int], tuple[float, int]] = {}
    total: dict[tuple[int, int], float] = {}
    for (a, b, apart), weight in votes.items():
        total[a, b] = total.get((a, b), 0.0) + weight
        if weight > best.get((a, b), (0.0, 0))[0]:
            best[a, b] = (weight, apart)
    ranked = sorted(best, key=lambda pair: (-(2.0 * best[pair][0] - total[pair]), pair))
    return [(a, b, best[a, b][1]) for a, b in ranked]


def _matched_sides(counted: TiedNumbers, votes: _Votes, side: npt.NDArray[np.int64]) -> TiedNumbers:
    """`counted`, or where widths contradict its count across the pith, indices whose two sides these have tied."""
    indices = TiedNumbers(len(side))
    one_side = {key: weight for key, weight in votes.weight.items() if side[key[0] - 1] * side[key[1] - 1] > 0}
    for a, b, apart in _clearest(one_side):
        indices.tie(a - 1, b - 1, apart)
    widths: dict[int, dict[int, list[float]]] = {}
    for (a, b), ways in votes.way.items():
        (root_a, above_a), (root_b, above_b) = indices.find(a - 1), indices.find(b - 1)
        if root_a == root_b and above_b - above_a == 1 and side[a - 1] != 0:
            widths.setdefault(root_a, {}).setdefault(above_a, []).extend(ways)
    middle: dict[int, Widths] = {
        root: {index: float(np.median(ways)) for index, ways in of.items()} for root, of in widths.items()
    }
    roots = sorted(middle, key=lambda root: -len(middle[root]))
    contradicted = False
    for one, other in ((a, b) for a in roots for b in roots if side[a] > 0 > side[b]):
        shift = counted.difference(one, other)
        more = 0 if shift is None else matched_shift(middle[one], middle[other], shift)
        if shift is not None and more != 0:
            contradicted = True
            indices.tie(one, other, shift + more)
    if not contradicted:
        return counted
    for a, b, apart in _clearest(votes.weight):
        indices.tie(a - 1, b - 1, apart)
    return indices


def order_rings(
    polylines: Sequence[npt.NDArray[np.float64]],
    closed: Sequence[bool],
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    phase: npt.NDArray[Any] | None = None,
    strength: npt.NDArray[Any] | None = None,
) -> Order:
    """Give every boundary its index.

    Parameters
    ----------
    polylines : sequence of arrays of shape (K, 2)
        x, y of the boundaries in pixels.
    closed : sequence of bool
        Whether each returns to its start.
    growth, frequency : arrays of shape (M, N)
        Outward direction in rad, rings per pixel.
    valid : bool array of shape (M, N)
        The wood.
    phase : array of shape (M, N), optional
        Ring phase in rad; counts the rings between boundaries better than the frequency alone.
    strength : array of shape (M, N), optional
        From `woodfit.boundary.edge_strength`: shows whether a ring is missing between two boundaries.

    Returns
    -------
    Order
    """
    count = len(polylines)
    wave = np.full(growth.shape, _UNKNOWN, np.float32) if phase is None else phase
    votes = _votes(polylines, closed, growth, frequency, wave, valid, strength)
    indices = TiedNumbers(count)
    for a, b, apart in _clearest(votes.weight):
        indices.tie(a - 1, b - 1, apart)
    side = sides_of(polylines, growth)
    if side.any():
        indices = _matched_sides(indices, votes, side)
    roots, index = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for node in range(count):
        roots[node], index[node] = indices.find(node)
    length = np.array([len(points) for points in polylines], np.float64)
    names, inverse = np.unique(roots, return_inverse=True) if count else (np.zeros(0), np.zeros(0, int))
    mass = np.bincount(inverse, weights=length, minlength=len(names)) if count else np.zeros(0)
    rank = np.empty(len(names), np.int64)
    rank[np.argsort(-mass, kind="stable")] = np.arange(len(names))
    group = rank[inverse] if count else np.zeros(0, np.int64)
    for number in range(len(names)):
        members = group == number
        index[members] += 1 - index[members].min()
    return Order(index, group, _agreement(votes.weight, index, group))


def _agreement(
    votes: dict[tuple[int, int, int], float], index: npt.NDArray[np.int64], group: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """Share of each boundary's votes that the indices satisfy."""
    kept, cast = np.full(len(index), 0.5), np.ones(len(index))
    for (a, b, apart), weight in votes.items():
        right = group[a - 1] == group[b - 1] and index[b - 1] - index[a - 1] == apart
        for node in (a - 1, b - 1):
            cast[node] += weight
            kept[node] += weight * right
    return np.asarray(kept / cast)
