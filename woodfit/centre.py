"""The pith in the picture: the point that the rings of a disc go round.

Where a face shows it, it tells the direction of growth everywhere, and what runs radially (saw marks, cracks, stain,
rays) from what runs along the rings.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

#: A ring's tangent may differ this much (sine of the angle) from a circle's around the pith and still speak for it.
_TOLERANCE = 0.35
#: Sectors around the pith that are looked at one by one, and in how many of them most tangents must agree.
_SECTORS, _AGREEING = 12, 10


def find_centre(
    orientation: npt.NDArray[Any], weight: npt.NDArray[Any], rounds: int = 25
) -> tuple[float, float, float] | None:
    """Point that the contours of an orientation field go round, if there is one inside the picture.

    Every pixel's normal passes near the pith. The best of a lattice of candidates is improved by reweighted least
    squares on the sine of the angle between normal and radius, which is robust to whatever is not a ring.

    Parameters
    ----------
    orientation : array of shape (M, N)
        Ring tangent in rad.
    weight : array of shape (M, N)
        How much each pixel's orientation is believed; 0 off the wood.
    rounds : int
        Rounds of reweighting.

    Returns
    -------
    x, y, share : float, or None
        Pith in pixels, and the weighted share of the wood whose tangents agree with it. None where contours do not
        close around a point of the picture.
    """
    height, width = orientation.shape
    step = max(1, int(np.sqrt(height * width / 40_000)))
    rows, cols = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    believed = np.asarray(weight, np.float64)[rows, cols]
    chosen = believed > 0.0
    if chosen.sum() < 100:
        return None
    points = np.stack([cols[chosen], rows[chosen]], axis=1).astype(np.float64)
    believed = believed[chosen] / believed[chosen].sum()
    angle = np.asarray(orientation, np.float64)[rows, cols][chosen]
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    lattice = np.stack(
        np.meshgrid((np.arange(24) + 0.5) * width / 24, (np.arange(24) + 0.5) * height / 24), axis=-1
    ).reshape(-1, 2)
    few = slice(None, None, max(1, len(points) // 5_000))
    scores = [float((believed[few] * _agrees(points[few], tangent[few], centre)).sum()) for centre in lattice]
    centre = lattice[int(np.argmax(scores))]
    reach = float(np.hypot(height, width))
    for turn in range(rounds):
        away = points - centre
        distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), 2.0 * step)
        sine = (tangent * away).sum(axis=1) / distance
        # Outer rings of an eccentric stem go round another point than the pith: the inner ones have the last word.
        near = np.exp(-((distance / (reach * max(0.06, 0.85**turn))) ** 2))
        pull = near * believed / distance**2 / (1.0 + (sine / (0.5 * _TOLERANCE)) ** 2) ** 2
        met = normals_meet(points, tangent, pull)
        if met is None:
            return None
        centre = met
    if not (0 <= centre[0] < width and 0 <= centre[1] < height):
        return None
    agrees = _agrees(points, tangent, centre)
    away = points - centre
    sector = ((np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi)) % 1.0 * _SECTORS).astype(int) % _SECTORS
    total = np.bincount(sector, believed, _SECTORS)
    share = np.bincount(sector, believed * agrees, _SECTORS) / np.maximum(total, 1e-12)
    # Chance agreement is 0.23; sectors without wood do not speak.
    around = (share > 0.5) & (total > 0.1 / _SECTORS)
    if around.sum() < _AGREEING:
        return None
    return float(centre[0]), float(centre[1]), float((believed * agrees).sum())


def normals_meet(
    points: npt.NDArray[np.float64], tangent: npt.NDArray[np.float64], weight: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64] | None:
    """Point nearest to the normals of contours in the weighted least squares sense.

    Parameters
    ----------
    points, tangent : arrays of shape (K, 2)
        Places on contours and unit tangents there.
    weight : array of shape (K,)
        Of each normal's squared distance.

    Returns
    -------
    array of shape (2,) or None
        In the frame of the points; None where the normals are parallel.
    """
    scatter = np.einsum("n,ni,nj->ij", weight, tangent, tangent)
    if not np.linalg.cond(scatter) < 1e8:
        return None
    place: npt.NDArray[np.float64] = np.linalg.solve(scatter, (weight * (tangent * points).sum(axis=1)) @ tangent)
    return place


def _agrees(
    points: npt.NDArray[np.float64], tangent: npt.NDArray[np.float64], centre: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    away = points - centre
    distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)
    return np.asarray(np.abs((tangent * away).sum(axis=1)) < _TOLERANCE * distance)
