"""Traced rings as points in the wood, and small geometry of lines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from woodfit.planes import Planes

FloatArray = npt.NDArray[np.float64]

#: Points this much thinner than long lie on one plane, and a photograph does not tell its two sides apart.
FLAT_SHARE = 0.03


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
        Length of boundary that a vertex stands for times its confidence, mean 1.
    index, group : int arrays of shape (R,)
        Ring index (growing outwards) and group of each boundary; pieces of one boundary share an entry.
    piece : int array of shape (K,), optional
        Number of the traced polyline; without it each boundary is one.
    belief : array of shape (K,), optional
        Confidence, 0..1; without it 1.
    facing : array of shape (K, 3), optional
        Unit normal of the photographed plane; without it z.
    """

    points: FloatArray
    tangents: FloatArray
    ring: npt.NDArray[np.int64]
    weight: FloatArray
    index: npt.NDArray[np.int64]
    group: npt.NDArray[np.int64]
    piece: npt.NDArray[np.int64] | None = None
    belief: FloatArray | None = None
    facing: FloatArray | None = None

    @property
    def pieces(self) -> npt.NDArray[np.int64]:
        """Number of the polyline of each vertex, shape (K,)."""
        return self.ring if self.piece is None else self.piece

    @property
    def beliefs(self) -> FloatArray:
        """Confidence of each vertex, shape (K,), 0..1."""
        return np.ones(len(self.points)) if self.belief is None else self.belief

    @property
    def facings(self) -> FloatArray:
        """Normal of the plane of each vertex, shape (K, 3)."""
        return np.tile([0.0, 0.0, 1.0], (len(self.points), 1)) if self.facing is None else self.facing

    @property
    def solid(self) -> bool:
        """Whether the points lie on several planes, so that no mirror image explains them as well."""
        size = np.linalg.svd(self.points - self.points.mean(axis=0), compute_uv=False)
        return bool(size[2] > FLAT_SHARE * size[0])

    @property
    def centre(self) -> FloatArray:
        """Weighted mean of the points, shape (3,), px."""
        return np.asarray(np.average(self.points, axis=0, weights=self.weight))

    def some(self, keep: npt.NDArray[np.int64]) -> RingPoints:
        """Return those vertices only; the table of boundaries stays."""
        return RingPoints(
            self.points[keep],
            self.tangents[keep],
            self.ring[keep],
            self.weight[keep],
            self.index,
            self.group,
            self.pieces[keep],
            self.beliefs[keep],
            self.facings[keep],
        )

    def thinned(self, most: int) -> RingPoints:
        """At most `most` vertices, evenly along all boundaries in a row."""
        if len(self.points) <= most:
            return self
        total = np.cumsum(self.weight)
        slot = np.floor(total / total[-1] * (most - 1)).astype(int)
        return self.some(np.flatnonzero(np.diff(slot, prepend=-1) > 0))


def sample_rings(
    polylines: list[FloatArray],
    confidence: list[FloatArray],
    index: npt.NDArray[Any],
    group: npt.NDArray[Any],
    per_ring: int = 24,
    planes: Planes | None = None,
) -> RingPoints:
    """Evenly spaced vertices of each boundary with tangents; pieces of one boundary are merged.

    Parameters
    ----------
    polylines, confidence : lists of arrays of shape (K, 2) and (K,)
        Boundaries (x, y in px, of the atlas if there are several faces) and the confidence of their vertices.
    index, group : int arrays of shape (R,)
        From `woodfit.ring_order`.
    per_ring : int
        Most vertices taken from one polyline.
    planes : Planes, optional
        Where the photographs lie; without it there is one, at z = 0.

    Returns
    -------
    RingPoints
    """
    planes = planes or Planes.single()
    keys = np.stack([np.asarray(group), np.asarray(index)], axis=1)
    table, inverse = np.unique(keys, axis=0, return_inverse=True)
    places, chords, ring, weight, trust = [], [], [], [], []
    piece: list[npt.NDArray[np.int64]] = []
    for number, (line, belief) in enumerate(zip(polylines, confidence, strict=True)):
        if len(line) < 8:
            continue
        pick = np.unique(np.linspace(3, len(line) - 4, min(per_ring, len(line))).round().astype(int))
        places.append(line[pick])
        chords.append(line[np.minimum(pick + 3, len(line) - 1)] - line[np.maximum(pick - 3, 0)])
        ring.append(np.full(len(pick), inverse.ravel()[number]))
        piece.append(np.full(len(pick), len(piece)))
        trust.append(belief[pick])
        weight.append(np.maximum(belief[pick], 0.02) * len(line) / len(pick))
    if not places:
        raise ValueError("no traced ring boundary is long enough to place the pith (at least 8 vertices are needed)")
    place, chord, mass = np.concatenate(places), np.concatenate(chords), np.concatenate(weight)
    tangents = planes.turn(chord[:, 0], chord[:, 1], place[:, 1])
    facing = np.cross(planes.plane[:, 1], planes.plane[:, 2])[planes.face_of(place[:, 1])]
    return RingPoints(
        planes.lift(place[:, 0], place[:, 1]),
        tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-9),
        np.concatenate(ring),
        mass / mass.mean(),
        table[:, 1].astype(np.int64),
        table[:, 0].astype(np.int64),
        np.concatenate(piece),
        np.concatenate(trust),
        facing / np.linalg.norm(facing, axis=1, keepdims=True),
    )


def spacing_px(rings: RingPoints) -> float:
    """Typical distance between neighbouring boundaries as they appear on the faces, px."""
    found = {(g, i): k for k, (g, i) in enumerate(zip(rings.group.tolist(), rings.index.tolist(), strict=True))}
    gaps = []
    for (group, index), number in found.items():
        after = found.get((group, index + 1))
        if after is not None and (rings.ring == number).any() and (rings.ring == after).any():
            way, _ = cKDTree(rings.points[rings.ring == after]).query(rings.points[rings.ring == number])
            gaps.append(float(np.median(way)))
    return float(np.median(gaps)) if gaps else max(float(np.ptp(rings.points, axis=0).max()) / 8.0, 1.0)


def frame_of(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors across `direction`: the first lies in the face, the second points into the wood."""
    across, inward = frames_of(direction[None])
    return across[0], inward[0]


def frames_of(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """As `frame_of`, for directions of shape (L, 3)."""
    across = np.stack([-direction[:, 1], direction[:, 0], np.zeros(len(direction))], axis=1)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length < 1e-9, [1.0, 0.0, 0.0], across / np.maximum(length, 1e-9))
    inward = np.cross(direction, across)
    return across, np.where(inward[:, 2:] < 0.0, -inward, inward)


def radii(points: npt.NDArray[Any], origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Distance of points (..., 3) from a line."""
    away = np.asarray(points) - origin
    along = away @ direction
    return np.asarray(np.sqrt(np.maximum((away * away).sum(axis=-1) - along * along, 0.0)))


def feet(origin: FloatArray, direction: FloatArray, centre: FloatArray) -> FloatArray:
    """Points nearest to `centre` (3,) of lines through `origin` along unit vectors `direction`, shape (..., 3)."""
    along = ((origin - centre) * direction).sum(axis=-1, keepdims=True)
    return np.asarray(origin - along * direction)


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
