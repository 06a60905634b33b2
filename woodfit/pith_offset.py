"""How far it is from the innermost boundary of a core to the pith, and how many rings are missing on the way.

As with Duncan's arcs, the curvature of the innermost rings tells. All of them are fitted at once as circles about one
pith. The unknown is the curvature of the innermost and not its radius: it passes smoothly through zero when the rings
are straight, and its error is nearly normal.

References
----------
Duncan (1989), "An evaluation of errors in tree age estimates based on increment cores in kahikatea", New Zealand
Natural Sciences 16.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

FloatArray = npt.NDArray[np.float64]

#: Boundaries are wavy: so many independent looks at the circle does one of them give, however many vertices it has.
LOOKS_PER_BOUNDARY = 4.0

#: The curvature must be so many standard deviations from zero.
SURE = 2.0


@dataclass(frozen=True)
class PithOffset:
    """Estimated way from the innermost boundary to the pith.

    Parameters
    ----------
    x, y
        The pith, scan px.
    distance_px, least_px, most_px
        Way to it from the innermost boundary at the path, and the range of one standard deviation.
    """

    x: float
    y: float
    distance_px: float
    least_px: float
    most_px: float


def _beyond_circle(unknown: FloatArray, arcs: Sequence[FloatArray], origin: FloatArray) -> list[FloatArray]:
    """Way of each point outside the circle through `origin` with this curvature (px-1) and outward normal (rad)."""
    curvature, angle = unknown
    outward = np.array([np.cos(angle), np.sin(angle)])
    ways = []
    for arc in arcs:
        offset = arc - origin
        square, along = (offset**2).sum(axis=1), offset @ outward
        # |p - c| - r, in a form that stays exact as the curvature vanishes.
        root = np.sqrt(np.maximum(1.0 + 2.0 * curvature * along + curvature**2 * square, 0.0))
        ways.append((curvature * square + 2.0 * along) / (root + 1.0))
    return ways


def pith_offset(arcs: Sequence[FloatArray], origin: FloatArray, outward_rad: float) -> PithOffset | None:
    """Pith of concentric arcs.

    Parameters
    ----------
    arcs : sequence of arrays of shape (K, 2)
        Vertices of the innermost boundaries near the path, scan px; the innermost first.
    origin : array of shape (2,)
        Where the path crosses the innermost boundary.
    outward_rad : float
        Outward normal there.

    Returns
    -------
    PithOffset or None
        None when the arcs are too straight to tell, or bend the other way.
    """
    arcs = [np.asarray(arc, np.float64) for arc in arcs if len(arc) >= 5]
    if not arcs:
        return None
    count = sum(len(arc) for arc in arcs)
    # Every boundary weighs the same, and each has its own unknown radius: its mean is taken out.
    share = [1.0 / np.sqrt(len(arc)) for arc in arcs]

    def misfit(unknown: FloatArray) -> FloatArray:
        ways = _beyond_circle(unknown, arcs, origin)
        return np.concatenate([(way - way.mean()) * part for way, part in zip(ways, share, strict=True)])

    span = max(float(np.ptp(arc, axis=0).max()) for arc in arcs)
    if span <= 0.0:
        return None
    start = np.array([0.0, outward_rad])
    fit = least_squares(misfit, start, x_scale=[1.0 / span, 0.1], loss="soft_l1", f_scale=0.5, max_nfev=200)
    curvature, angle = (float(value) for value in fit.x)
    looks = LOOKS_PER_BOUNDARY * len(arcs)
    freedom = looks - len(arcs) - 2.0
    if freedom <= 0.0 or count < 10:
        return None
    # Mean square misfit per boundary is one look's variance.
    variance = float((misfit(fit.x) ** 2).sum()) / len(arcs) * looks / freedom
    # Half a px is the least that a traced boundary is off by.
    variance = max(variance, 0.3**2)
    information = fit.jac.T @ fit.jac * LOOKS_PER_BOUNDARY
    if np.linalg.cond(information * np.outer([1.0 / span, 0.1], [1.0 / span, 0.1])) > 1e10:
        return None
    spread = float(np.sqrt(np.linalg.inv(information)[0, 0] * variance))
    if not curvature > SURE * spread:
        return None
    radius = 1.0 / curvature
    return PithOffset(
        x=float(origin[0] - radius * np.cos(angle)),
        y=float(origin[1] - radius * np.sin(angle)),
        distance_px=radius,
        least_px=1.0 / (curvature + spread),
        most_px=1.0 / (curvature - spread),
    )


def rings_missing(distance_px: float, innermost_widths_px: FloatArray) -> int | None:
    """Rings in a distance, at the mean width of the innermost measured ones; None without any."""
    known = innermost_widths_px[np.isfinite(innermost_widths_px) & (innermost_widths_px > 0.0)]
    return round(distance_px / float(known.mean())) if len(known) else None
