"""Ring widths of a clicked measurement path: borders, earlywood/latewood borders and gaps, from bark to pith."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from woodfit.dendro.series import FloatArray

Point = tuple[float, float]


@dataclass(frozen=True)
class PathPoint:
    """One point of a path.

    Parameters
    ----------
    xy_mm : pair of float
        Position.
    second_xy_mm : pair of float, optional
        Where the next ring starts, when the path shifts along a ring border.
    kind : {"border", "latewood", "gap"}
        Ring border, border between earlywood and latewood, or edge of a crack.
    label : str
        Free word.
    zeros : int
        Absent rings between this border and the next, next to this one.
    """

    xy_mm: Point
    second_xy_mm: Point | None = None
    kind: Literal["border", "latewood", "gap"] = "border"
    label: str = ""
    zeros: int = 0

    def __post_init__(self) -> None:
        if self.kind != "border" and (self.zeros or self.second_xy_mm is not None):
            raise ValueError(f"a {self.kind} point has neither a second position nor absent rings")


@dataclass(frozen=True)
class Ring:
    """Widths of one ring, NaN for the parts when their border is not marked or marked twice."""

    width_mm: float
    earlywood_mm: float = math.nan
    latewood_mm: float = math.nan
    remarks: tuple[str, ...] = ()


def ring_widths(points: Sequence[PathPoint]) -> list[Ring]:
    """Rings from bark to pith.

    Earlywood/latewood points behind the last border go to the ring whose straight line they are nearest to, since
    CooRecorder writes points there that were added later; those nearest to an end of the path belong to no ring.

    Parameters
    ----------
    points : sequence of PathPoint
        From bark to pith.

    Returns
    -------
    list of Ring
    """
    borders = [index for index, point in enumerate(points) if point.kind == "border"]
    between = [list(points[first + 1 : after]) for first, after in pairwise(borders)]
    if borders:
        late = [point for point in points[borders[-1] + 1 :] if point.kind == "latewood"]
        _insert([points[index] for index in borders], between, late)
    rings: list[Ring] = []
    for (first, after), inner in zip(pairwise(borders), between, strict=True):
        rings += [Ring(0.0)] * points[first].zeros
        rings.append(_ring(points[first], inner, points[after]))
    if rings and (last := points[borders[-1]]):
        rings += [Ring(0.0)] * last.zeros
        if last.label:
            rings[-1] = Ring(rings[-1].width_mm, rings[-1].earlywood_mm, rings[-1].latewood_mm,
                             (*rings[-1].remarks, last.label))  # fmt: skip
    return rings


def _ring(outer: PathPoint, inner: Sequence[PathPoint], inside: PathPoint) -> Ring:
    way = [outer.second_xy_mm or outer.xy_mm, *(point.xy_mm for point in inner), inside.xy_mm]
    kinds = ["border", *(point.kind for point in inner), "border"]
    late, total = 0.0, 0.0
    woods = kinds.count("latewood")
    skipping = False
    for (start, end), kind in zip(pairwise(way), kinds, strict=False):
        if kind == "latewood":
            late = total
        skipping = not skipping if kind == "gap" else skipping
        total += 0.0 if skipping else math.dist(start, end)
    remarks = tuple(point.label for point in (outer, *inner) if point.label)
    if "gap" in kinds and "crack" not in remarks:
        remarks += ("crack",)
    if woods == 1:
        return Ring(total, total - late, late, remarks)
    return Ring(total, remarks=(*remarks, f"{woods} earlywood/latewood borders") if woods else remarks)


def _insert(borders: Sequence[PathPoint], between: list[list[PathPoint]], late: Sequence[PathPoint]) -> None:
    """Put latewood points that stand after all borders into their rings, in the order of the way.

    A point clicked beside a thin ring may be nearest to its neighbor. When there is one point for each ring that has
    none, their order along the way tells.
    """
    if not between or not late:
        return
    start = np.array([point.second_xy_mm or point.xy_mm for point in borders[:-1]])
    step = np.array([point.xy_mm for point in borders[1:]]) - start
    placed: list[tuple[int, float, PathPoint]] = []
    for point, (ring, along) in zip(late, _nearest([point.xy_mm for point in late], start, step), strict=True):
        if not (ring == 0 and along < 0) and not (ring == len(step) - 1 and along > 1):
            placed.append((ring, along, point))
    placed.sort(key=lambda one: one[:2])
    free = [ring for ring, inner in enumerate(between) if all(point.kind != "latewood" for point in inner)]
    if len(free) == len(placed) and all(abs(to - one[0]) <= 1 for to, one in zip(free, placed, strict=True)):
        placed = [(to, along, point) for to, (_, along, point) in zip(free, placed, strict=True)]
    for ring, _, point in placed:
        between[ring].append(point)
    for ring in {ring for ring, *_ in placed}:
        inner = between[ring]
        order = np.argsort((np.array([point.xy_mm for point in inner]) - start[ring]) @ step[ring], kind="stable")
        between[ring] = [inner[index] for index in order]


def _nearest(points: Sequence[Point], start: FloatArray, step: FloatArray) -> list[tuple[int, float]]:
    """For each point the straight piece that it is nearest to, and how far along it lies (0 start, 1 end).

    Only pieces whose midpoint is near enough are looked at closely: files may hold thousands of both.
    """
    middle_x, middle_y = (start + step / 2).T.copy()
    half = np.hypot(*step.T) / 2
    found = []
    for x, y in points:
        distance = np.hypot(middle_x - x, middle_y - y)
        near = np.flatnonzero(distance - half <= (distance + half).min())
        to_point = np.array([x, y]) - start[near]
        along = (to_point * step[near]).sum(1) / np.maximum((step[near] ** 2).sum(1), 1e-12)
        off = ((to_point - np.clip(along, 0, 1)[:, None] * step[near]) ** 2).sum(1)
        best = int(off.argmin())
        found.append((int(near[best]), float(along[best])))
    return found
