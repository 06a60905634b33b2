"""What a pith line costs: how far from round it leaves the traced rings, and how irregular their widths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: Expected scatter: a boundary about its circle (in rings), a ring width from one year to the next and from the
#: face's mean (in log width), the distance of the pith from the face's centre (in log of the face's size, about
#: USUAL_DISTANCE of it).
SCATTER_RINGS, YEAR_TO_YEAR, FROM_MEAN, DISTANCE, USUAL_DISTANCE = 0.35, 0.30, 0.45, 1.0, 0.5

#: Independent looks at a boundary. Few: neighbouring vertices, and neighbouring rings too, share their distortion,
#: so that an oval tree must not pass for a tilted one.
LOOKS_PER_RING = 1.5

#: Boards are sawn along or across the stem: departures from both cost, gently for large ones.
SAWN_WITHIN_RAD, SAWN_COST = 0.08, 3.0


@dataclass(frozen=True)
class RingPoints:
    """Sampled vertices of traced boundaries.

    Attributes
    ----------
    points : array of shape (K, 3)
        Board frame, px.
    tangents : array of shape (K, 3)
        Unit tangents of the boundaries, board frame.
    ring : int array of shape (K,)
        Position in the table of boundaries below.
    weight : array of shape (K,)
        Confidence.
    index, group : int arrays of shape (R,)
        Ring index (growing outwards) and group of each boundary; pieces of one boundary share an entry.
    """

    points: FloatArray
    tangents: FloatArray
    ring: npt.NDArray[np.int64]
    weight: FloatArray
    index: npt.NDArray[np.int64]
    group: npt.NDArray[np.int64]


def sample_rings(
    polylines: list[FloatArray],
    confidence: list[FloatArray],
    index: npt.NDArray[Any],
    group: npt.NDArray[Any],
    per_ring: int = 24,
) -> RingPoints:
    """Evenly spaced vertices of each boundary with tangents; pieces of one boundary are merged.

    Parameters
    ----------
    polylines, confidence : lists of arrays of shape (K, 2) and (K,)
        Boundaries (x, y in px) and the confidence of their vertices.
    index, group : int arrays of shape (R,)
        From `woodfit.ring_order`.
    per_ring : int
        Most vertices taken from one polyline.

    Returns
    -------
    RingPoints
    """
    keys = np.stack([np.asarray(group), np.asarray(index)], axis=1)
    table, inverse = np.unique(keys, axis=0, return_inverse=True)
    points, tangents, ring, weight = [], [], [], []
    for number, (line, belief) in enumerate(zip(polylines, confidence, strict=True)):
        if len(line) < 8:
            continue
        pick = np.unique(np.linspace(3, len(line) - 4, min(per_ring, len(line))).round().astype(int))
        chord = line[np.minimum(pick + 3, len(line) - 1)] - line[np.maximum(pick - 3, 0)]
        length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)
        points.append(np.column_stack([line[pick], np.zeros(len(pick))]))
        tangents.append(np.column_stack([chord / length[:, None], np.zeros(len(pick))]))
        ring.append(np.full(len(pick), inverse.ravel()[number]))
        weight.append(np.maximum(belief[pick], 0.02) * len(line) / len(pick))
    if not points:
        raise ValueError("no traced ring boundary is long enough to place the pith (at least 8 vertices are needed)")
    mass = np.concatenate(weight)
    return RingPoints(
        np.concatenate(points),
        np.concatenate(tangents),
        np.concatenate(ring),
        mass / mass.mean(),
        table[:, 1].astype(np.int64),
        table[:, 0].astype(np.int64),
    )


def frame_of(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors across `direction`: the first lies in the face, the second points into the wood."""
    across = np.array([-direction[1], direction[0], 0.0])
    if np.hypot(across[0], across[1]) < 1e-9:
        across = np.array([1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    inward = np.cross(direction, across)
    if inward[2] < 0.0:
        inward = -inward
    return across, inward


def radii(points: npt.NDArray[Any], origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Distance of points (..., 3) from a line."""
    away = np.asarray(points) - origin
    along = away @ direction
    return np.asarray(np.sqrt(np.maximum((away * away).sum(axis=-1) - along * along, 0.0)))


class Energy:
    """Misfit of a pith line: how far the rings are from round, and their widths from regular."""

    def __init__(self, rings: RingPoints, size_px: float, along_face: float = 0.0) -> None:
        self.rings = rings
        self.along_face = along_face
        self.size_px = size_px
        self.centre = np.array([*np.average(rings.points[:, :2], axis=0, weights=rings.weight), 0.0])
        count = len(rings.index)
        self.count = count
        self.mass = np.bincount(rings.ring, rings.weight, minlength=count)
        self.looks = LOOKS_PER_RING * np.minimum(1.0, self.mass / np.maximum(np.median(self.mass), 1e-9))
        order = np.lexsort((rings.index, rings.group))
        inner, outer = order[:-1], order[1:]
        same = rings.group[inner] == rings.group[outer]
        self.inner, self.outer = inner[same], outer[same]
        self.apart = (rings.index[self.outer] - rings.index[self.inner]).astype(float)

    def __call__(self, origin: FloatArray, direction: FloatArray) -> float:
        """Cost of the line through `origin` along the unit vector `direction`, both of shape (3,), board frame."""
        rings = self.rings
        r = radii(rings.points, origin, direction)
        mean = np.bincount(rings.ring, rings.weight * r, minlength=self.count) / np.maximum(self.mass, 1e-9)
        distance = float(np.linalg.norm(origin - self.centre))
        far = math.log((distance / self.size_px + 0.02) / USUAL_DISTANCE) / DISTANCE
        off_saw = min(math.acos(min(1.0, abs(float(direction[2])))), math.asin(min(1.0, abs(float(direction[2])))))
        prior = 0.5 * max(far, 0.0) ** 2 + SAWN_COST * math.log1p((off_saw / SAWN_WITHIN_RAD) ** 2)
        prior -= self.along_face * (0.5 - float(direction[2]) ** 2)
        if len(self.inner) == 0:
            width = max(float(np.ptp(r)), 1.0)
            scatter = self._scatter(r - mean[rings.ring], width)
            return scatter + prior
        widths = (mean[self.outer] - mean[self.inner]) / self.apart
        typical = float(np.average(np.abs(widths), weights=self.apart)) + 1e-9
        # Widths must grow outwards: a width that vanishes or turns negative costs, but without a cliff.
        logs = np.log(np.maximum(widths / typical, 0.02))
        backwards = float((np.minimum(widths / typical - 0.02, 0.0) ** 2).sum())
        share = 1.0 / self.apart
        level = float((share * np.minimum((logs / FROM_MEAN) ** 2, 9.0)).sum()) / 2.0
        step = np.diff(logs)
        year = float(np.minimum((step / (YEAR_TO_YEAR * 1.5)) ** 2, 9.0).sum()) / 2.0
        return self._scatter(r - mean[rings.ring], typical) + level + year + 20.0 * backwards + prior

    def _scatter(self, residual: FloatArray, width: float) -> float:
        square = (residual / (SCATTER_RINGS * width)) ** 2
        robust = 2.0 * (np.sqrt(1.0 + square) - 1.0)
        per_ring = np.bincount(self.rings.ring, self.rings.weight * robust, minlength=self.count)
        return float((self.looks * per_ring / np.maximum(self.mass, 1e-9)).sum()) / 2.0

    def lateral(self, direction: FloatArray, depth_px: float) -> float | None:
        """Offset across the face at which the tangents are best at right angles to the radii."""
        rings = self.rings
        across, inward = frame_of(direction)
        away = rings.points - self.centre
        across_all = away - np.outer(away @ direction, direction) - depth_px * inward
        # The radius, seen on the face, must be at right angles to the tangent: t . (away - offset across) = 0.
        left = rings.tangents @ across
        right = (rings.tangents * across_all).sum(axis=1)
        size = np.linalg.norm(across_all, axis=1) + 0.1 * self.size_px
        for _ in range(3):
            weight = rings.weight / size
            power = float((weight * left * left).sum())
            if power < 1e-6 * float(weight.sum()):
                return None
            offset = float((weight * left * right).sum() / power)
            size = np.linalg.norm(across_all - offset * across, axis=1) + 0.1 * self.size_px
        return offset


def direction_of(tilt: float, azimuth: float) -> FloatArray:
    """Unit vector `tilt` rad away from the face's normal, towards `azimuth` in the face."""
    return np.array(
        [math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt)], np.float64
    )


def along_face_evidence(grain_ratio: float, aspect: float) -> float:
    """Energy by which a face along the stem is likelier than one across it.

    Fibres make the fine texture run along the rings of a longitudinal face, rays and tracheid rows make it run across
    them on end grain. A long narrow strip is a core, sanded across the stem.
    """
    grain = 6.0 * math.log(max(grain_ratio, 1e-3) / 1.08)
    return float(np.clip(grain, -4.0, 6.0)) - (3.0 if aspect > 5.0 else 0.0)
