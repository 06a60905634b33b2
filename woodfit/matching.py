"""Ring boundaries along a line: where polylines and a known ring age cross it, and which belong together.

Positions are distances along the line in px. A polyline is an array (n, 2) of x, y in the image frame; a closed
one repeats its first point at the end.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Counts:
    """Matched, missed and false ring boundaries; adds up over paths."""

    matched: int = 0
    missed: int = 0
    false: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(self.matched + other.matched, self.missed + other.missed, self.false + other.false)

    def scores(self) -> dict[str, float]:
        """``sensitivity``, ``precision`` and ``f`` (their harmonic mean), and the counts themselves."""
        return {
            "sensitivity": share(self.matched, self.matched + self.missed),
            "precision": share(self.matched, self.matched + self.false),
            "f": share(2 * self.matched, 2 * self.matched + self.missed + self.false),
            "matched": float(self.matched),
            "missed": float(self.missed),
            "false": float(self.false),
        }


def share(part: float, whole: float) -> float:
    """Part of a whole; NaN when there is no whole."""
    return part / whole if whole > 0 else float("nan")


# --- one-to-one matching along a line -----------------------------------------------------------------------
def match_ordered(
    truth: Floats, found: Floats, tolerance: Floats, weight: Floats | None = None
) -> list[tuple[int, int]]:
    """Pairs (truth index, found index) of the best one-to-one matching that keeps the order.

    A pair is allowed within the truth's own `tolerance`. The best matching has the largest total `weight` of the
    truth (all 1 if None), and among those the smallest total distance. Dynamic programming over prefixes.

    Parameters
    ----------
    truth, found
        Ascending positions along one line, px, shapes (m,) and (n,).
    tolerance, weight
        Of each truth position, shape (m,).
    """
    m, n = len(truth), len(found)
    weights = np.ones(m) if weight is None else weight
    # A distance can never outweigh a match: all of them together stay below the smallest weight.
    scale = 0.5 * float(weights.min(initial=1.0)) / (m + 1)
    best = np.zeros((m + 1, n + 1))
    step = np.zeros((m + 1, n + 1), dtype=np.uint8)
    for i in range(m):
        distance = np.abs(found - truth[i])
        gain = np.where(distance <= tolerance[i], weights[i] - scale * distance / max(tolerance[i], 1e-12), -np.inf)
        for j in range(n):
            options = (best[i, j + 1], best[i + 1, j], best[i, j] + gain[j])
            choice = max(range(3), key=options.__getitem__)
            best[i + 1, j + 1], step[i + 1, j + 1] = options[choice], choice
    pairs = []
    i, j = m, n
    while i > 0 and j > 0:
        if step[i, j] == 2:
            pairs.append((i - 1, j - 1))
            i, j = i - 1, j - 1
        elif step[i, j] == 0:
            i -= 1
        else:
            j -= 1
    return pairs[::-1]


@dataclass(frozen=True)
class Matching:
    """Which boundaries belong together along one line; indices into the positions given.

    Parameters
    ----------
    pairs
        (truth, found) of the truths that are certain and found.
    missed
        Truths that are certain and not found.
    false
        Finds that belong to no truth and are not excused.
    """

    pairs: list[tuple[int, int]]
    missed: list[int]
    false: list[int]

    @property
    def counts(self) -> Counts:
        """How many of each."""
        return Counts(len(self.pairs), len(self.missed), len(self.false))


def match_boundaries(
    truth: Floats, found: Floats, tolerance: Floats, uncertain: Bools | None = None, excused: Bools | None = None
) -> Matching:
    """Order-preserving one-to-one matching, with the boundaries that are missed and false.

    An `uncertain` truth counts neither as missed nor, when something is found at it, as matched or false; an
    `excused` find is not false when nothing is there.
    """
    doubtful = np.zeros(len(truth), bool) if uncertain is None else np.asarray(uncertain, bool)
    pardoned = np.zeros(len(found), bool) if excused is None else np.asarray(excused, bool)
    weight = np.where(doubtful, 0.5 / (len(truth) + 1), 1.0)
    pairs = match_ordered(truth, found, tolerance, weight)
    missing, free = ~doubtful, ~pardoned
    missing[[i for i, _ in pairs]] = False
    free[[j for _, j in pairs]] = False
    certain = [(i, j) for i, j in pairs if not doubtful[i]]
    return Matching(certain, np.flatnonzero(missing).tolist(), np.flatnonzero(free).tolist())


def count_matches(
    truth: Floats, found: Floats, tolerance: Floats, uncertain: Bools | None = None, excused: Bools | None = None
) -> Counts:
    """Counts of :func:`match_boundaries`."""
    return match_boundaries(truth, found, tolerance, uncertain, excused).counts


def neighbour_tolerance(truth: Floats, tolerance_px: float, ring_share: float = 0.25, least_px: float = 0.0) -> Floats:
    """The smaller of `tolerance_px` and `ring_share` of the smaller neighbouring gap, at each position (m,); never
    under `least_px`.
    """
    gaps = np.diff(truth, prepend=-np.inf, append=np.inf)
    return np.maximum(least_px, np.minimum(tolerance_px, ring_share * np.minimum(gaps[:-1], gaps[1:])))


# --- crossings ----------------------------------------------------------------------------------------------
def level_crossings(age: ArrayLike) -> Floats:
    """Fractional indices at which a sampled ring age (n,) passes a whole number from 1 on, ascending.

    Where several boundaries lie between two samples each one counts.
    """
    values = np.asarray(age, dtype=float)
    before, after = values[:-1], values[1:]
    with np.errstate(invalid="ignore"):
        hit = np.flatnonzero(np.floor(before) != np.floor(after))
    found = []
    for i in hit[np.isfinite(before[hit]) & np.isfinite(after[hit])]:
        low, high = sorted((np.floor(before[i]), np.floor(after[i])))
        levels = np.arange(max(low + 1.0, 1.0), high + 1.0)
        found.extend(i + (levels - before[i]) / (after[i] - before[i]))
    return np.sort(np.asarray(found, dtype=float))


@dataclass(frozen=True)
class Crossings:
    """Where polylines cross a line, in the order along it.

    Parameters
    ----------
    position
        Distance from the start of the line, px, shape (n,), ascending.
    polyline
        Which polyline crosses there, shape (n,).
    vertex
        Where on that polyline, as a fractional index of its vertices, shape (n,).
    """

    position: Floats
    polyline: NDArray[np.int64]
    vertex: Floats


def locate_crossings(polylines: Iterable[ArrayLike], start: ArrayLike, end: ArrayLike) -> Crossings:
    """Where polylines cross the straight segment `start`-`end` (x, y), and which of them."""
    origin = np.asarray(start, dtype=float)
    along = np.asarray(end, dtype=float) - origin
    length = float(np.hypot(*along))
    along = along / length
    found: list[tuple[float, int, float]] = []
    for number, polyline in enumerate(polylines):
        offset = np.asarray(polyline, dtype=float).reshape(-1, 2) - origin
        position = offset @ along
        side = along[0] * offset[:, 1] - along[1] * offset[:, 0]
        # Half-open: a vertex on the line belongs to one side, so that it gives one crossing and not two or none.
        for i in np.flatnonzero((side[:-1] < 0) != (side[1:] < 0)):
            t = side[i] / (side[i] - side[i + 1])
            found.append((float(position[i] + t * (position[i + 1] - position[i])), number, float(i + t)))
    inside = sorted(item for item in found if 0.0 <= item[0] <= length)
    return Crossings(
        np.array([item[0] for item in inside], dtype=float),
        np.array([item[1] for item in inside], dtype=np.int64),
        np.array([item[2] for item in inside], dtype=float),
    )


def line_crossings(polylines: Iterable[ArrayLike], start: ArrayLike, end: ArrayLike) -> Floats:
    """Distances from `start`, ascending, px, at which polylines cross the straight segment `start`-`end` (x, y)."""
    return locate_crossings(polylines, start, end).position
