"""Rings between the pith and the innermost boundary that was seen.

Nobody saw them, but trees do not grow at random: the rings of the first years are the widest, and widths fall off
towards a level that changes slowly (the "age trend" that dendrochronologists take out of a series [1]_). Widths that
were seen tell the level, and how much of that trend this tree has.

References
----------
.. [1] Fritts, "Tree Rings and Climate", Academic Press 1976, chapter 6.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: Widths at the pith over those of an old tree, less one, and the years over which that fades by a factor of e.
YOUNG, YEARS = 1.0, 10.0

#: How much of that trend a tree has, and its scatter over trees.
USUAL, SCATTER = 1.0, 0.5

#: Scatter of log widths: of the level over `LEVEL_YEARS`, and from year to year, of which `MEMORY` is kept.
LEVEL, LEVEL_YEARS, YEARLY, MEMORY = 0.25, 30.0, 0.2, 0.5

#: How many years the usual scatter counts for against that of the tree; error of a width over the scatter of years.
USUAL_YEARS, MEASURED = 4.0, 0.6

#: From so many rings on the pith is too far away for what was seen to tell how wide the first ones were.
MOST = 400

#: Boundaries inside of which growth layers lie on top of one another: gaps below `CROWDED` mean widths, and shorter
#: than `SHORT` of the usual length. Such lines are grain in the wide middle of a flat-sawn face.
CROWDED, SHORT = 0.3, 0.35


def age_trend(year: npt.NDArray[np.floating]) -> FloatArray:
    """Usual log width of a ring at a ring age (any shape), over that of an old tree."""
    return np.asarray(np.log1p(YOUNG * np.exp(-year / YEARS)), np.float64)


def false_innermost(ages: npt.NDArray[np.int64], radii: FloatArray, mass: FloatArray, width_px: float) -> int:
    """How many of the innermost boundaries cannot be rings: short lines without room for a ring between them.

    Parameters
    ----------
    ages, radii, mass : arrays of shape (N,)
        Ring age (increasing), radius in px and length times confidence of the boundaries.
    width_px : float
        Mean ring width.

    Returns
    -------
    int
        0 where the pith is near, whose rings are short by nature.
    """
    usual = SHORT * float(np.median(mass))
    count = 0
    while count < len(ages) - 3 and radii[count] > 2.0 * width_px and mass[count] < usual:
        ahead = slice(count + 1, count + 3)
        room = (radii[ahead] - radii[count]) / (ages[ahead] - ages[count])
        if room.min() > CROWDED * width_px:
            break
        count += 1
    return count


def widths_inside(seen_px: FloatArray, radius_px: float, width_px: float) -> FloatArray:
    """Likely widths of the rings inside the innermost boundary.

    Parameters
    ----------
    seen_px : array of shape (N,)
        Widths of the rings from that boundary outwards, px; may be empty.
    radius_px : float
        Radius of that boundary.
    width_px : float
        Mean ring width.

    Returns
    -------
    array of shape (K,)
        Widths from the pith outwards, px; they sum up to `radius_px`. There is at least one ring.
    """
    seen = np.maximum(np.asarray(seen_px, np.float64), 0.05 * width_px)
    count = max(1, round(radius_px / width_px))
    if count > MOST:
        return np.full(count, radius_px / count)
    for _ in range(6):
        widths = _expected(seen, count, width_px)
        reached = np.cumsum(widths[::-1])
        if reached[-1] < radius_px - 0.5 * widths[0]:
            needed = count + max(1, round((radius_px - float(reached[-1])) / float(widths[0])))
        else:
            needed = int(np.argmin(np.abs(reached - radius_px))) + 1
        if needed == count:
            break
        count = needed
    # The ring at the pith takes up what is left, so that those next to what was seen keep their likely widths.
    widths[0] = radius_px - float(widths[1:].sum())
    return widths if widths[0] > 0.0 else np.full(count, radius_px / count)


def _expected(seen: FloatArray, count: int, width_px: float) -> FloatArray:
    """Mean widths (count,) of the rings inside, given those seen outside of them: a Gaussian process of log widths."""
    year = np.arange(count + len(seen), dtype=float)
    trend = age_trend(year)
    apart = np.abs(year[:, None] - year[None])
    far = math.sqrt(5.0) * apart / LEVEL_YEARS
    yearly = _yearly(seen)
    covariance = SCATTER**2 * np.outer(trend, trend) + yearly**2 * MEMORY**apart
    covariance += (LEVEL * yearly / YEARLY) ** 2 * (1.0 + far + far * far / 3.0) * np.exp(-far)
    bonus = 0.5 * yearly**2 * (1.0 + (LEVEL / YEARLY) ** 2)
    if len(seen) == 0:
        return np.asarray(width_px * np.exp(USUAL * (trend - trend.mean())))
    inside, outside = slice(0, count), slice(count, None)
    # The height of the level is not known beforehand.
    covariance += 1.0
    level = math.log(float(np.median(seen)))
    miss = np.log(seen) - level - USUAL * trend[outside]
    trust = np.ones(len(seen))
    for _ in range(3):
        inner = covariance[outside, outside] + np.diag((MEASURED * yearly) ** 2 / trust)
        share = np.linalg.solve(inner, miss)
        left = miss - covariance[outside, outside] @ share
        # A boundary that was missed doubles a width.
        trust = 1.0 / (1.0 + (left / (2.0 * MEASURED * yearly)) ** 2)
    log_width = level + USUAL * trend[inside] + covariance[inside, outside] @ share
    # Radii are sums of widths, so it is their mean that counts, not their median.
    return np.asarray(np.exp(log_width + bonus))


def _yearly(seen: FloatArray) -> float:
    """Scatter of log widths from year to year: of this tree, and the usual one where few rings were seen."""
    steps = np.abs(np.diff(np.log(seen)))
    if len(steps) == 0:
        return YEARLY
    # Median step of a normal variable with that memory.
    own = float(np.median(steps)) / (0.6745 * math.sqrt(2.0 * (1.0 - MEMORY)))
    return math.sqrt((USUAL_YEARS * YEARLY**2 + len(steps) * own**2) / (USUAL_YEARS + len(steps)))
