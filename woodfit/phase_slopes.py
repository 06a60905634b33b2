"""Displacement with as many rings as the phase counts: fitted to the slopes of the phase, not to the phase itself.

The cyclic loss of `woodfit.displacement.polish` sees the phase modulo one ring. Where the start is a ring off (a line
was traced that is no boundary, a boundary was not traced, or nothing was traced and the ideal radii stand for the
rings) it stays off, and a wall is left between two counts. Differences of the phase over a part of a ring leave no such
choice: they say how many rings lie on the way from one place to another. Traced boundaries that contradict them fade.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from woodfit.cylinder_grid import CylinderGrid, without_fold
from woodfit.displacement import (
    Array,
    Difference,
    Interpolation,
    Membrane,
    Observations,
    age_of_radius,
    one_thread,
    radius_of_age,
    solve,
    tensor,
)

#: Smoothing length of the first step and of those after it, px.
_STIFFNESS = (1.0, 0.3)

#: How far a slope, in parts of a ring over its pair, and a boundary, in rings, may miss before they fade, step by step:
#: at first all slopes count in full, so that a start which contradicts them is left.
_SLOPE_MISSES, _BOUNDARY_MISS = (1e3, 4.0, 2.0, 1.0, 0.5, 0.25), 0.25

#: Weight of all boundary vertices together, relative to all slopes: they hold what the phase does not reach.
_BOUNDARY_SHARE = 1e-4

_ITERATIONS = 120


@dataclass(frozen=True)
class Slopes:
    """Pairs of places on the face and the ring phase between them.

    Attributes
    ----------
    ahead, behind : Observations
        The places; `target` is not used, `weight` is that of the pair (both the same).
    turn : array of shape (N,)
        Ring age of the places ahead less that of those behind, by the phase: less than half a ring either way.
    """

    ahead: Observations
    behind: Observations
    turn: Array


@one_thread()
def follow_slopes(
    grid: CylinderGrid,
    start: Array,
    slopes: Sequence[Slopes],
    boundaries: Observations,
    ring_radius: Array,
    along_stem: float,
) -> npt.NDArray[np.float32]:
    """Fit the displacement to slopes of the phase.

    Parameters
    ----------
    grid : CylinderGrid
        Of the texture.
    start : array of the grid's shape
        Initial displacement, px.
    slopes : sequence of Slopes
        Pairs along x and along y.
    boundaries : Observations
        Boundary vertices with their ring age.
    ring_radius : array of shape (N,)
        Ideal radii at ages 0, 1, ...
    along_stem : float
        How much stiffer the field is along the stem.

    Returns
    -------
    float32 array of the grid's shape
        ``r + m_r`` increases with r; `start` where there are no slopes.
    """
    total = sum(float(part.ahead.weight.sum()) for part in slopes)
    field = base = tensor(start).reshape(-1)
    if total <= 0.0:
        return np.asarray(start, np.float32)
    membrane, at_vertices = Membrane(grid, along_stem), Interpolation(grid, boundaries)
    ends = [(Interpolation(grid, part.ahead), Interpolation(grid, part.behind)) for part in slopes]
    pairs = [Difference(ahead, behind) for ahead, behind in ends]
    heavy = _BOUNDARY_SHARE * total / max(float(boundaries.weight.sum()), 1e-9)
    vertex_wanted = tensor(radius_of_age(boundaries.target, ring_radius) - boundaries.radius)
    for step, slope_miss in enumerate(_SLOPE_MISSES):
        vertex_age, vertex_width = age_of_radius(boundaries.radius + at_vertices.at(field).numpy(), ring_radius)
        # In rings, not px: wide and narrow rings count alike.
        scale = float(np.median(vertex_width)) if len(vertex_width) else 1.0
        miss = (boundaries.target - vertex_age) / _BOUNDARY_MISS
        weight = heavy * boundaries.weight * (scale / vertex_width) ** 2 / (1.0 + miss**2)
        terms = [(at_vertices, tensor(weight), vertex_wanted)]
        for part, (ahead, behind), pair in zip(slopes, ends, pairs, strict=True):
            here, there = ahead.at(field).numpy(), behind.at(field).numpy()
            age_here, width_here = age_of_radius(part.ahead.radius + here, ring_radius)
            age_there, width_there = age_of_radius(part.behind.radius + there, ring_radius)
            width, off = 0.5 * (width_here + width_there), part.turn - (age_here - age_there)
            weight = part.ahead.weight * (scale / width) ** 2 / (1.0 + (off / slope_miss) ** 2)
            terms.append((pair, tensor(weight), tensor(here - there + off * width)))
        stiffness = _STIFFNESS[min(step, 1)]
        free = solve(terms, membrane, stiffness, field, _ITERATIONS, base)
        field = tensor(without_fold(free.view(grid.shape).numpy(), grid.radius)).reshape(-1)
    return np.asarray(field.view(grid.shape).numpy(), np.float32)
