"""Who is whose neighbour among traced boundaries, and how many rings lie between: walks across the rings.

From points along each boundary a walk goes outwards and inwards until it meets the next one and counts the cycles of
the frequency field on its way; the edges seen there correct the count (`woodfit.rings_apart`). Each meeting is a vote
"index of b = index of a + n".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from woodfit.rings_apart import rings_apart

#: Stands for a phase that is not known.
_UNKNOWN = 1e6


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
    polylines: Sequence[npt.NDArray[np.float64]],
    closed: Sequence[bool],
    shape: tuple[int, ...],
    which: npt.NDArray[np.bool_] | None = None,
) -> npt.NDArray[np.int32]:
    """Image of `shape` with the number of each boundary, or of `which` (R,), counted from 1, on its line; else 0."""
    labels = np.zeros(shape, np.int32)
    for number, (points, loop) in enumerate(zip(polylines, closed, strict=True), start=1):
        if which is not None and not which[number - 1]:
            continue
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
        phase: npt.NDArray[Any] | None = None,
    ) -> Surroundings:
        """From labels of `draw_labels`, outward direction in rad, rings per pixel, the wood, and ring phase in rad."""
        return cls(
            labels,
            np.cos(growth).astype(np.float32),
            np.sin(growth).astype(np.float32),
            np.ascontiguousarray(frequency, np.float32),
            np.ascontiguousarray(valid),
            np.full(labels.shape, _UNKNOWN, np.float32) if phase is None else np.ascontiguousarray(phase, np.float32),
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
class Votes:
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


def votes_of(
    polylines: Sequence[npt.NDArray[np.float64]],
    which: npt.NDArray[np.bool_],
    around: Surroundings,
    strength: npt.NDArray[Any] | None,
) -> Votes:
    """Ask along every boundary of `which` (R,) which other one of `around` comes next, outwards and inwards."""
    height, width = around.labels.shape
    fields = (around.labels, around.grow_x, around.grow_y, around.frequency, around.phase, around.valid)
    votes = Votes({}, {})
    met_at: list[tuple[int, int]] = []
    passed: list[tuple[float, float]] = []
    ends: list[tuple[float, float, float, float]] = []
    for number in (1 + np.flatnonzero(which)).tolist():
        points = polylines[number - 1]
        for x, y in points[:: max(1, min(4, len(points) // 12))]:
            x, y = float(np.clip(x, 0, width - 1)), float(np.clip(y, 0, height - 1))
            for outwards in (1.0, -1.0):
                met, cycles, way, turned, end_x, end_y = _meet(*fields, x, y, number, outwards, 4.6)
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
        # A way of one ring is certain, one of several less and less so; and what halves a ring may be a streak.
        rings = max(cycles, 0.1)
        votes.cast(a, b, apart, min(rings, 1.0 / rings) ** 2)
    return votes
