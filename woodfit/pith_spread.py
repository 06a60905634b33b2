"""How far a pith may lie from the likeliest one because trees are not round.

The walkers of `pith_samples` tell how well the rings fix a pith in a tree that is nearly round. What the shape of a
real stem adds to that no photograph shows, so it follows from how trees usually are.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from woodfit.pith_energy import RingPoints, frame_of, radii

FloatArray = npt.NDArray[np.float64]

#: By what share of the radius trees usually grow wider one way than another.
OFF_ROUND = 0.07

#: Size of distortion, in usual ones, below which a tree counts as round as a whole in proportion.
TURNED = 0.1


def with_short_arc(
    spread: FloatArray, point: FloatArray, along: FloatArray, centre: FloatArray, rings: RingPoints
) -> FloatArray:
    """Spread (4,) with what a short arc leaves open: growth that is not round moves its centre of curvature.

    Parameters
    ----------
    spread : array of shape (4,)
        As that of `woodfit.pith.Pith`.
    point, along : arrays of shape (3,)
        The line, board frame, px.
    centre : array of shape (3,)
        Of the face, px.
    rings : RingPoints
    """
    axes = np.stack(frame_of(along))
    x, y = axes @ (rings.points - point).T
    towards_x, towards_y = axes @ (centre - point)
    turned = np.arctan2(x * towards_y - y * towards_x, x * towards_x + y * towards_y)
    half_arc = min(0.5 * float(np.ptp(np.quantile(turned, [0.02, 0.98]))), 0.5 * math.pi)
    away = OFF_ROUND * math.cos(half_arc) * np.abs(axes @ (point - centre))
    return np.concatenate([spread[:2], np.hypot(spread[2:], away)])


def with_shape(
    spread: FloatArray, point: FloatArray, along: FloatArray, rings: RingPoints, distortion: float
) -> FloatArray:
    """Spread (4,) with what a stem that is not round leaves open on a face that is not square to it.

    On a face that crosses the stem at an angle, a stem wider one way than another shows the same rings as a round one
    at another angle. And the centre of rings drifts from the pith the wider they are, of which the growth of those that
    are seen tells about half. A tree as round in the small as if turned on a lathe is taken to be so as a whole.

    Parameters
    ----------
    spread, point, along, rings
        As for `with_short_arc`; the face lies in the plane of the board frame's x and y.
    distortion : float
        Size of the tree's distortion, in usual ones.
    """
    share = OFF_ROUND * min(1.0, distortion / TURNED)
    steep = min(abs(float(along[2])), 0.99)
    turned = share * steep / math.sqrt(1.0 - steep**2)
    moved = 0.5 * share * float(np.quantile(radii(rings.points, point, along), 0.02))
    return np.hypot(spread, [turned, turned, moved, moved])
