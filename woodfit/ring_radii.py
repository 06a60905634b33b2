"""Ideal radii of the ring boundaries around a fitted pith, and what their indices count from."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from woodfit.cylinder_grid import cylindrical
from woodfit.inner_rings import false_innermost, widths_inside
from woodfit.pith import Pith, board_to_tree
from woodfit.pith_energy import RingPoints, radii

FloatArray = npt.NDArray[np.float64]

#: Vertices of other groups that each vertex is compared with.
NEIGHBOURS = 6

#: Share of those pairs, the nearest ones, that tells how groups are tied.
NEAREST = 0.05


def ring_radii(
    rings: RingPoints, pith: Pith, smallest_share: float = 0.25, stem: npt.ArrayLike | None = None
) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray, int]:
    """Ideal radius of every boundary from the pith out.

    Groups that no vote ties to the largest (of other faces of a block too) are shifted by the whole number of rings
    that fits their vertices to those near them in the wood. Boundaries that were not traced lie evenly between their
    neighbours; those inside the innermost continue evenly with about the width of the innermost ones to the pith,
    whose age is 0.

    Parameters
    ----------
    rings, pith
        The sampled boundaries and the fitted line.
    smallest_share : float
        Least width of a ring, as a share of the mean width.
    stem : array of shape (3,), optional
        Bend and taper of the stem in the tree frame at the foot of the rings' centre, 1/px.

    Returns
    -------
    radius : array of shape (N,)
        Increasing; entry n is the radius at ring age n, entry 0 is 0.
    shift : int array of shape (G,)
        For each group, what to add to a ring index to get the age of that boundary.
    width : float
        Mean ring width, px (shape ()).
    innermost : int
        Age of the innermost boundary that is believed: lines inside of it are grain, not rings.
    """
    if stem is None or not np.any(stem):
        r = radii(rings.points, pith.point, pith.direction)
    else:
        centre = rings.centre if pith.centre is None else pith.centre
        r = np.asarray(cylindrical(rings.points, board_to_tree(pith, centre), stem)[0], np.float64)
    count = len(rings.index)
    mass = np.bincount(rings.ring, rings.weight, minlength=count)
    mean = np.array([_weighted_median(r[rings.ring == i], rings.weight[rings.ring == i]) for i in range(count)])
    index, group = rings.index, rings.group
    seen = mass > 0.0
    order = np.argsort(-np.bincount(group, mass), kind="stable")
    largest = (group == order[0]) & seen
    width = _mean_width(index[largest], mean[largest], r)
    shift = np.zeros(int(group.max()) + 1, np.int64)
    known: dict[int, list[tuple[float, float]]] = {}
    placed = np.zeros(len(r), bool)
    for number in order:
        members = np.flatnonzero((group == number) & seen)
        mine = group[rings.ring] == number
        if placed.any() and len(members):
            ages = np.array(sorted(known))
            age = _age_at(r, ages, _mean_radii(known, ages), width)
            own = index[rings.ring]
            shift[number] = _shift_to(rings, age, own, own + shift[group[rings.ring]], mine, placed)
        placed |= mine
        for i in members:
            known.setdefault(int(index[i] + shift[number]), []).append((float(mean[i]), float(mass[i])))
    ages = np.array(sorted(known))
    weights = np.array([sum(m for _, m in known[a]) for a in ages])
    table = _mean_radii(known, ages)
    false = false_innermost(ages, table, weights, width)
    ages, weights, table = ages[false:], weights[false:], table[false:]
    outside = _monotone(ages, table, weights, width, smallest_share)
    inside = widths_inside(np.diff(outside), float(outside[0]), width)
    innermost = len(inside)
    shift += innermost - int(ages[0])
    radius = np.concatenate([[0.0], np.cumsum(inside[:-1]), outside])
    return radius, shift, np.asarray(width), innermost


def _mean_width(index: npt.NDArray[np.int64], mean: FloatArray, r: FloatArray) -> float:
    """Mean ring width, px, from the mean radii of boundaries with these indices."""
    span = int(np.ptp(index))
    if span == 0:
        return float(max(np.ptp(r), 1.0))
    slope = np.polyfit(index, mean, 1)[0]
    return float(max(abs(slope), 0.3 * np.ptp(mean) / span, 1e-3))


def _shift_to(
    rings: RingPoints,
    age: FloatArray,
    index: npt.NDArray[np.int64],
    placed_age: npt.NDArray[np.int64],
    mine: npt.NDArray[np.bool_],
    placed: npt.NDArray[np.bool_],
) -> int:
    """Whole number that takes the indices of a group's vertices to ages that continue those of vertices near them.

    `age` (K,) is the age by the radius alone. It is off where growth was not round, but by about as much at two
    vertices near one another, so only its difference is used.
    """
    there = np.flatnonzero(placed)
    here = np.flatnonzero(mine)
    way, near = cKDTree(rings.points[there]).query(rings.points[here], k=min(NEIGHBOURS, len(there)))
    way, near = way.reshape(len(here), -1), there[near.reshape(len(here), -1)]
    wanted = placed_age[near] + age[here][:, None] - age[near] - index[here][:, None]
    # Only what is nearest tells: farther on, growth that is not round puts ages off by whole rings.
    weight = rings.weight[here][:, None] * rings.weight[near] * (way <= np.quantile(way, NEAREST))
    return round(_weighted_median(wanted.ravel(), weight.ravel()))


def _mean_radii(known: dict[int, list[tuple[float, float]]], ages: npt.NDArray[Any]) -> FloatArray:
    """Mass-weighted mean radius at each age."""
    return np.array([sum(r * m for r, m in known[a]) / sum(m for _, m in known[a]) for a in ages])


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    if len(values) == 0:
        return 0.0
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _age_at(radius: FloatArray, ages: npt.NDArray[Any], table: FloatArray, width: float) -> FloatArray:
    """Ring age at a radius, continued with the mean width beyond the table."""
    inside = np.interp(radius, np.maximum.accumulate(table), ages)
    below, above = np.minimum(radius - table[0], 0.0), np.maximum(radius - table[-1], 0.0)
    return np.asarray(inside + (below + above) / width)


def _monotone(
    ages: npt.NDArray[Any], table: FloatArray, weights: FloatArray, width: float, smallest_share: float
) -> FloatArray:
    """Increasing radii at all ages from the first to the last through a noisy table (pool adjacent violators)."""
    least = smallest_share * width
    values = table - least * ages
    blocks: list[list[float]] = []
    for value, weight in zip(values, weights, strict=True):
        blocks.append([value, weight, 1.0])
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            v, w, n = blocks.pop()
            blocks[-1] = [
                (blocks[-1][0] * blocks[-1][1] + v * w) / (blocks[-1][1] + w),
                blocks[-1][1] + w,
                blocks[-1][2] + n,
            ]
    level = np.concatenate([np.full(int(n), v) for v, _, n in blocks])
    fitted = level + least * ages
    # The pith lies inside of all.
    fitted = fitted + max(0.0, 0.2 * least - fitted[0])
    every = np.arange(int(ages[0]), int(ages[-1]) + 1)
    return np.asarray(np.interp(every, ages, fitted))
