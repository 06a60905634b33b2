"""Ideal radii of the ring boundaries around a fitted pith, and what their indices count from."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.pith import Pith
from woodfit.pith_energy import RingPoints, radii

FloatArray = npt.NDArray[np.float64]


def ring_radii(
    rings: RingPoints, pith: Pith, smallest_share: float = 0.25
) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray]:
    """Ideal radius of every boundary from the pith out.

    Groups that no vote ties to the largest are shifted by the whole number of rings that fits their radii best.
    Boundaries that were not traced lie evenly between their neighbours; those inside the innermost continue with the
    mean width down to the pith, whose age is 0.

    Parameters
    ----------
    rings, pith
        The sampled boundaries and the fitted line.
    smallest_share : float
        Least width of a ring, as a share of the mean width.

    Returns
    -------
    radius : array of shape (N,)
        Increasing; entry n is the radius at ring age n, entry 0 is 0.
    shift : int array of shape (G,)
        For each group, what to add to a ring index to get the age of that boundary.
    width : float
        Mean ring width, px (shape ()).
    """
    r = radii(rings.points, pith.point, pith.direction)
    of_ring = [rings.ring == i for i in range(len(rings.index))]
    mean = np.array([_weighted_median(r[mine], rings.weight[mine]) for mine in of_ring])
    index, group = rings.index, rings.group
    main = group == 0
    span = int(np.ptp(index[main]))
    if span > 0:
        width = float((mean[main].max() - mean[main].min()) / span)
        slope = np.polyfit(index[main], mean[main], 1)[0]
        width = float(max(abs(slope), 0.3 * width, 1e-3))
    else:
        width = float(max(np.ptp(r), 1.0))
    innermost = int(index[main].min())
    first = max(1, round(float(mean[main][index[main] == innermost][0]) / width))
    shift = np.zeros(int(group.max()) + 1, np.int64)
    shift[0] = first - innermost
    known: dict[int, list[tuple[float, float]]] = {}
    mass = np.bincount(rings.ring, rings.weight, minlength=len(index))
    for number in range(len(shift)):
        members = np.flatnonzero(group == number)
        if number > 0:
            ages = np.array(sorted(known))
            table = _mean_radii(known, ages)
            guess = _age_at(mean[members], ages, table, width)
            shift[number] = round(float(np.average(guess - index[members], weights=mass[members])))
        for i in members:
            known.setdefault(int(index[i] + shift[number]), []).append((float(mean[i]), float(mass[i])))
    least = min(known)
    if least < 1:
        shift += 1 - least
        known = {age + 1 - least: value for age, value in known.items()}
    ages = np.array(sorted(known))
    table = _mean_radii(known, ages)
    weights = np.array([sum(m for _, m in known[a]) for a in ages])
    return _monotone(ages, table, weights, width, smallest_share), shift, np.asarray(width)


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
    """Increasing radii at ages 0, 1, ... through a noisy table of some of them (pool adjacent violators)."""
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
    fitted = fitted + max(0.0, 0.2 * least * ages[0] - fitted[0])
    every = np.arange(int(ages[-1]) + 1)
    return np.asarray(np.interp(every, np.concatenate([[0], ages]), np.concatenate([[0.0], fitted])))
