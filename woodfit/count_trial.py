"""Polishing by whichever count of rings fits a face best.

How far a phase is to be believed where it is faint is not known beforehand: counted across, it can carry a wrong number
to everything behind, and left out it leaves the numbers to the tracing, which can be wrong as well. So several counts
are tried, each at few of the pixels, and the best one is polished at all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.cylinder_grid import CylinderGrid, sample
from woodfit.displacement import Observations, Polished, age_of_radius, polish
from woodfit.ring_count import count_rings
from woodfit.rings import wrap

Array = npt.NDArray[Any]

#: Pixels are confident from here on; a 95 % residual above the second (rad), or a share of the traced boundaries above
#: the third that lie a ring off, says that the count of the phase may be wrong.
SURE, TORN_RAD, CONTRADICTED = 0.5, 0.7, 0.01

#: Pixels that are believed less do not count at all. From which belief on the phase counts rings, in the order of
#: trial: through doubtful wood, which leaves few numbers to the tracing; through less and less of it; and, with
#: infinity, nowhere. Every how many pixels a count is tried.
LEAST_BELIEF, COUNTED_FROM, TRIED_EVERY = 0.05, (0.2, 0.35, 0.5, np.inf), 2


def polish_by_best_count(
    grid: CylinderGrid,
    start: Array,
    phase: Array,
    belief: Array,
    start_age: Array,
    face: Array,
    pixels: Observations,
    boundaries: Observations,
    ring_radius: Array,
    stiffness_px: Sequence[float],
    along_stem: float,
    boundary_share: float,
) -> Polished:
    """`woodfit.displacement.polish` by the count of rings that leaves least.

    Parameters
    ----------
    grid, start, boundaries, ring_radius, stiffness_px, along_stem, boundary_share
        As in `woodfit.displacement.polish`.
    phase, belief, start_age : arrays of shape (H, W)
        Ring phase on the face (rad), its confidence, and the ring ages that `start` gives.
    face : int array of shape (H,)
        Face of each row.
    pixels : Observations
        Of the pixels of `phase` that are believed more than `LEAST_BELIEF`, in their order.

    Returns
    -------
    Polished
    """
    rows, columns = np.nonzero(belief > LEAST_BELIEF)
    counted = count_rings(phase, belief, COUNTED_FROM[0], face)

    def polished(least_belief: float, places: Array, each: float) -> Polished:
        count = counted.numbered(belief > least_belief, start_age, belief**2)[rows, columns][places]
        some = pixels.at(places).weighing(each)
        return polish(grid, start, some, boundaries, ring_radius, stiffness_px, along_stem, boundary_share, count)

    few = (rows % TRIED_EVERY == 0) & (columns % TRIED_EVERY == 0)
    some, sure = pixels.at(few), belief[rows, columns][few]
    tried: list[tuple[float, float]] = []
    for least_belief in COUNTED_FROM:
        found = polished(least_belief, few, TRIED_EVERY**2)
        tried.append((found.worth, least_belief))
        moved, _, _ = sample(grid, found.displacement, some.radius, some.azimuth, some.height)
        left = wrap(some.target - 2.0 * np.pi * age_of_radius(some.radius + moved, ring_radius)[0])
        if found.contradicted <= CONTRADICTED and worst_residual(left, sure) <= TORN_RAD:
            break
    return polished(min(tried)[1], np.ones(len(rows), bool), 1.0)


def worst_residual(residual_rad: Array, belief: Array) -> float:
    """Residual that 95 % of the confident pixels keep to, rad; 0 without any."""
    sure = np.abs(residual_rad[belief > SURE])
    return float(np.percentile(sure, 95)) if sure.size else 0.0
