"""Where the board sat in the tree: the pith line that makes the traced rings round (paper, Sec. 3.4).

One model serves every cut. On a plane, the squared distance from a line is a quadratic whose second-order part is
fixed by the line's direction alone, so level sets of the ring age are ellipses, parabolas-like arcs or straight lines
depending on nothing but the tilt. For a given direction the tangents of the traced rings give the line's position by
linear least squares; what tangents cannot see (the depth of a pith parallel to the face) the regularity of the ring
widths decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from woodfit.pith_energy import Energy, RingPoints, along_face_evidence, direction_of, frame_of

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Pith:
    """A pith line in the board frame.

    Attributes
    ----------
    point : array of shape (3,)
        The line's point nearest to the face's centre, px.
    direction : array of shape (3,)
        Unit vector.
    energy : float
        What the fit minimised.
    spread : array of shape (4,)
        One standard deviation of two direction angles (rad) and two offsets (px).
    """

    point: FloatArray
    direction: FloatArray
    energy: float
    spread: FloatArray


@dataclass(frozen=True)
class Fixed:
    """What the user knows of the pith: coordinates of its nearest point (px), tilt and azimuth (degrees)."""

    point: tuple[float | None, float | None, float | None]
    tilt_deg: float | None
    azimuth_deg: float | None

    def overrule(self, point: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Put the known values in place of fitted ones."""
        chosen = np.array([p if k is None else k for p, k in zip(point, self.point, strict=True)], np.float64)
        tilt = math.acos(min(1.0, abs(float(direction[2])))) if self.tilt_deg is None else math.radians(self.tilt_deg)
        upright = direction if direction[2] >= 0.0 else -direction
        azimuth = math.atan2(upright[1], upright[0]) if self.azimuth_deg is None else math.radians(self.azimuth_deg)
        if self.tilt_deg is None and self.azimuth_deg is None:
            return chosen, direction
        return chosen, direction_of(tilt, azimuth)


def fit_pith(
    rings: RingPoints,
    size_px: float,
    pith_behind: bool = True,
    grain_ratio: float = 1.08,
    aspect: float = 1.0,
    fixed: Fixed | None = None,
) -> Pith:
    """Pith line by brute force over directions and depths, then simplex refinement of the best few.

    Parameters
    ----------
    rings : RingPoints
        Sampled boundaries.
    size_px : float
        Longer side of the face.
    pith_behind : bool
        Which of the two mirror solutions to take: the pith behind the face (z >= 0 at the face's centre) or in
        front of it. The image does not tell.
    grain_ratio, aspect : float
        Slope of the fine texture across over along the rings; longer over shorter side of the face.
    fixed : Fixed, optional
        What the user knows; it overrules the fit.

    Returns
    -------
    Pith
    """
    energy = Energy(rings, size_px, along_face_evidence(grain_ratio, aspect))
    depths = size_px * np.concatenate([[0.0], np.geomspace(0.03, 4.0, 15)])
    starts: list[tuple[float, FloatArray]] = []
    for tilt in np.deg2rad([0.0, 5.0, 12.0, 22.0, 35.0, 50.0, 62.0, 72.0, 80.0, 85.0, 88.0, 90.0]):
        turns = 1 if tilt == 0.0 else 24
        for azimuth in np.arange(turns) * 2.0 * np.pi / turns:
            if tilt == np.pi / 2 and azimuth >= np.pi:
                continue
            direction = direction_of(float(tilt), float(azimuth))
            across, inward = frame_of(direction)
            # On end grain the second offset lies in the face too and takes either sign.
            signed = depths if tilt > 1.2 else np.concatenate([-depths[:0:-1], depths])
            for depth in signed[:: 1 if tilt > 1.2 else 2]:
                lateral = energy.lateral(direction, float(depth))
                if lateral is None or abs(lateral) > 20.0 * size_px:
                    continue
                origin = energy.centre + lateral * across + depth * inward
                starts.append((energy(origin, direction), np.array([tilt, azimuth, lateral, depth])))
    if not starts:
        raise ValueError("the traced rings do not constrain the pith: no direction fits their tangents")
    starts.sort(key=lambda item: item[0])
    best: tuple[float, FloatArray, FloatArray] | None = None
    for _, start in _distinct(starts, 4, size_px):
        candidate = _refine(energy, start, size_px)
        if best is None or candidate[0] < best[0]:
            best = candidate
    assert best is not None
    value, origin, direction = best
    spread = _spread(energy, origin, direction, size_px)
    origin = origin - ((origin - energy.centre) @ direction) * direction
    if (origin[2] < 0.0) == pith_behind and origin[2] != 0.0:
        # Mirror in the face: the photograph is the same.
        origin, direction = origin * [1.0, 1.0, -1.0], direction * [1.0, 1.0, -1.0]
    main = int(np.argmax(np.abs(direction)))
    if direction[main] < 0.0:
        direction = -direction
    if fixed is not None:
        origin, direction = fixed.overrule(origin, direction)
    return Pith(origin, direction, value, spread)


def _distinct(starts: list[tuple[float, FloatArray]], count: int, size_px: float) -> list[tuple[float, FloatArray]]:
    """The best starts that do not repeat one another."""
    kept: list[tuple[float, FloatArray]] = []
    for value, start in starts:
        away = [
            abs(start[0] - other[0]) > 0.25
            or abs(np.sin(start[1] - other[1])) * np.sin(start[0]) > 0.3
            or abs(start[3] - other[3]) > 0.25 * size_px
            for _, other in kept
        ]
        if all(away):
            kept.append((value, start))
        if len(kept) == count:
            break
    return kept


def _chart(
    origin: FloatArray, direction: FloatArray, step: npt.NDArray[Any], size_px: float
) -> tuple[FloatArray, FloatArray]:
    """Line reached from another by small steps: two tilts (rad) and two offsets (in face sizes)."""
    across, inward = frame_of(direction)
    turned = direction + step[0] * across + step[1] * inward
    return origin + size_px * (step[2] * across + step[3] * inward), turned / np.linalg.norm(turned)


def _refine(energy: Energy, start: FloatArray, size_px: float) -> tuple[float, FloatArray, FloatArray]:
    direction = direction_of(start[0], start[1])
    across, inward = frame_of(direction)
    origin = energy.centre + start[2] * across + start[3] * inward
    reach = 0.1
    for _ in range(3):
        # Restarts of the simplex on a fresh chart: it stalls in the long valley between distance and scale.
        found = minimize(
            lambda step, o=origin, d=direction: energy(*_chart(o, d, step, size_px)),
            np.zeros(4),
            method="Nelder-Mead",
            options={
                "initial_simplex": np.vstack([np.zeros(4), np.diag([reach, reach, reach, reach])]),
                "maxfev": 500,
                "xatol": 1e-5,
                "fatol": 1e-4,
            },
        )
        origin, direction = _chart(origin, direction, found.x, size_px)
        origin = origin - ((origin - energy.centre) @ direction) * direction
        reach *= 0.4
    return float(found.fun), origin, direction


def _spread(energy: Energy, origin: FloatArray, direction: FloatArray, size_px: float) -> FloatArray:
    """Standard deviations from the curvature of the energy (a negative log-likelihood); large where it is flat."""
    h = np.array([0.02, 0.02, 0.02, 0.02])
    hessian = np.empty((4, 4))
    for i in range(4):
        for j in range(i, 4):
            total = 0.0
            for si in (-1, 1):
                for sj in (-1, 1):
                    step = np.zeros(4)
                    step[i] += si * h[i]
                    step[j] += sj * h[j]
                    total += si * sj * energy(*_chart(origin, direction, step, size_px))
            hessian[i, j] = hessian[j, i] = total / (4.0 * h[i] * h[j])
    values, vectors = np.linalg.eigh(hessian)
    variance = (vectors**2 / np.maximum(values, 0.05)[None, :]).sum(axis=1)
    return np.asarray(np.sqrt(variance) * [1.0, 1.0, size_px, size_px])


def board_to_tree(pith: Pith, centre: FloatArray) -> FloatArray:
    """Rigid 4x4 transform from the board frame to the tree frame, px to px.

    z runs along the pith, with height 0 at the foot of `centre` (board frame, px); azimuth 0 points towards `centre`,
    so that the branch cut of the azimuth lies on the far side of the tree.
    """
    z = pith.direction
    foot = pith.point + ((centre - pith.point) @ z) * z
    return _rigid(foot, centre - foot, z)


def _rigid(origin: FloatArray, x: FloatArray, z: FloatArray) -> FloatArray:
    if np.linalg.norm(x) < 1e-6:
        x = np.cross([0.0, 1.0, 0.0], z) if abs(z[1]) < 0.9 else np.cross([1.0, 0.0, 0.0], z)
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ origin
    return matrix
