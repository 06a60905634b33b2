"""A pith that bends slowly and a stem that tapers, where the face shows it.

In the tree's frame x and y of a point lose ``bend * height**2`` and its radius grows by the factor
``1 + taper * height``; then rings are round again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from woodfit.pith import Pith, board_to_tree
from woodfit.pith_energy import RingPoints, feet, spacing_px
from woodfit.pith_evidence import Evidence, Growth

FloatArray = npt.NDArray[np.float64]

#: Straight and cylindrical.
STRAIGHT = np.zeros(3)

#: Standard deviations from zero that a bend or a taper must reach to be kept, and the least height of the face, in
#: ring widths.
SURE, LEAST_HEIGHT = 3.0, 12.0

#: Vertices used, and how far they lie off in ring widths.
_VERTICES, _GROWTH = 400, Growth()


@dataclass(frozen=True)
class Stem:
    """A fitted stem.

    Attributes
    ----------
    values : array of shape (3,)
        Bend along tree x and y, and taper, 1/px; 0 where the face does not show it.
    spread : array of shape (3,)
        One standard deviation of each, 1/px.
    origin, direction : arrays of shape (3,)
        The pith's tangent at the foot of the faces' centre, which moves a little when the pith may bend.
    """

    values: FloatArray
    spread: FloatArray
    origin: FloatArray
    direction: FloatArray


def fit_stem(rings: RingPoints, matrix: FloatArray) -> Stem:
    """Bend and taper about a fitted pith line, with small corrections of the line itself.

    Linear least squares for the radii of the vertices, with the same irregular growth as in `pith_evidence`; what
    does not stand out from its spread is zero.

    Parameters
    ----------
    rings : RingPoints
        Sampled boundaries.
    matrix : array of shape (4, 4)
        From the board to the tree, px.

    Returns
    -------
    Stem
    """
    rings = rings.thinned(_VERTICES)
    turn, back = matrix[:3, :3], matrix[:3, :3].T
    direction, origin = turn[2], -back @ matrix[:3, 3]
    tree = rings.points @ turn.T + matrix[:3, 3]
    # Its own tree frame: the line is the z axis.
    evidence = Evidence(replace(rings, points=tree, facing=rings.facings @ turn.T), spacing_px(rings), _GROWTH)
    zero, along = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    width = evidence.rounded(zero, along)[2]
    x, y, up = tree.T
    r = np.hypot(x, y) + 1e-9
    # Taper is asked for here, so it is no nuisance.
    basis = evidence.shapes(zero, along)
    wanted = np.stack([-(up**2) * x / r, -(up**2) * y / r, r * up], axis=1)
    moved = np.stack([-x / r, -y / r, -up * x / r, -up * y / r], axis=1)
    columns = np.concatenate([wanted, moved, basis[0, :, :8]], axis=1) / width[0]
    size = np.linalg.norm(columns, axis=0) + 1e-12
    scaled = columns / size
    information = scaled.T @ evidence.precision @ scaled
    # Unit priors for the shapes, in their own units; hardly any for the line and the stem.
    information[np.diag_indices(len(size))] += np.where(np.arange(len(size)) < 7, 1e-9, 1.0 / size**2)
    covariance = np.linalg.inv(information)
    found = -covariance @ (scaled.T @ (evidence.precision @ (r / width[0]))) / size
    spread = np.sqrt(np.diag(covariance)) / size
    values = found[:3]
    shows = np.ptp(up) > LEAST_HEIGHT * width[0]
    sure = np.abs(values) > SURE * spread[:3] if shows else np.zeros(3, bool)
    if not sure.any():
        return Stem(STRAIGHT.copy(), spread[:3], origin, direction)
    kept = np.concatenate([sure, np.ones(len(size) - 3, bool)])
    part = np.linalg.inv(information[np.ix_(kept, kept)])
    again = np.zeros(len(size))
    again[kept] = -part @ (scaled[:, kept].T @ (evidence.precision @ (r / width[0]))) / size[kept]
    shift = np.array([again[3], again[4], 0.0])
    tilt = np.array([again[5], again[6], 1.0])
    line = back @ (tilt / np.linalg.norm(tilt))
    return Stem(again[:3], spread[:3], origin + back @ shift, line)


def with_stem(
    rings: RingPoints,
    pith: Pith,
    centre: FloatArray,
    fitted: bool,
    given: tuple[float | None, float | None, float | None],
) -> tuple[Pith, FloatArray]:
    """Pith line at the foot of `centre` (3,) and its stem (3,): fitted or straight, then as far as `given`."""
    stem = STRAIGHT.copy()
    if fitted:
        found = fit_stem(rings, board_to_tree(pith, centre))
        if found.values.any():
            moved = replace(pith, point=feet(found.origin, found.direction, centre), direction=found.direction)
            # The frame turns a little with the line; bends are small, so that they are not turned with it.
            pith, stem = moved, found.values
    return pith, np.array([s if g is None else g for s, g in zip(stem, given, strict=True)], np.float64)
