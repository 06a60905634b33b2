"""Blocks whose rings are known: the faces of a drawn log as the stages before `pose` would give them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from skimage.measure import find_contours

from stages import variables as v
from stages.faces import Faces, join_faces
from woodfit.synthetic import Log, photograph, plane_points, srgb_decode

Vectors = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


def box(side: int) -> dict[str, Vectors]:
    """Pixel (0, 0), right and down of the six faces of a cube, each seen from outside, px."""
    end = float(side - 1)
    return {
        "front": ((0, 0, 0), (1, 0, 0), (0, 1, 0)),
        "right": ((end, 0, 0), (0, 0, 1), (0, 1, 0)),
        "back": ((end, 0, end), (-1, 0, 0), (0, 1, 0)),
        "left": ((0, 0, end), (0, 0, -1), (0, 1, 0)),
        "top": ((0, 0, end), (1, 0, 0), (0, 0, -1)),
        "bottom": ((0, end, 0), (1, 0, 0), (0, 0, 1)),
    }


def seen_face(
    log: Log, plane: Vectors, side: int, ring_px: float, seed: int, sign: int = 1, first: int = 1
) -> xr.Dataset:
    """What the stages up to `ring_tracing` would find on a face whose rings they trace without fault.

    Boundaries are numbered from `first` on: outwards, or inwards where `sign` is -1.
    """
    origin, right, down = (np.array(vector, float) for vector in plane)
    age = log.age(plane_points((side, side), origin, right, down))
    rgb = srgb_decode(
        photograph(log, (side, side), origin, right, down, rng=np.random.default_rng(seed)).rgb_encoded / 255.0
    )
    rings = np.arange(int(np.ceil(age.min())), int(np.floor(age.max())) + 1)
    lines = [(ring, line) for ring in rings for line in find_contours(age, float(ring)) if len(line) > 8]
    number = rings[0] if sign > 0 else rings[-1]
    points = np.concatenate([line for _, line in lines])
    counts = np.array([len(line) for _, line in lines])
    image = {
        v.RGB: rgb.astype(np.float32),
        v.VALID: np.ones((side, side), bool),
        v.ANOMALY: np.zeros((side, side), np.uint8),
        v.RING_PHASE: np.angle(np.exp(2j * np.pi * sign * age)).astype(np.float32),
        v.PHASE_CONFIDENCE: np.ones((side, side), np.float32),
    }
    rest = {
        v.RING_X: points[:, 1],
        v.RING_Y: points[:, 0],
        v.VERTEX_CONFIDENCE: np.ones(len(points)),
        v.VERTEX_COUNT: counts,
        v.RING_INDEX: np.array([sign * (ring - number) + first for ring, _ in lines]),
        v.RING_GROUP: np.zeros(len(lines), int),
        v.RING_SCALE: np.float64(ring_px),
        v.REDUCTION: np.int64(1),
        v.GRAIN_RATIO: np.float64(1.0),
        v.BRIGHT_OUTWARDS: np.bool_(True),
        v.GROWTH_SURENESS: np.float64(0.9),
        v.PIXEL_SIZE: np.float64(np.nan),
    }
    coords = {"y": np.arange(side, dtype=float), "x": np.arange(side, dtype=float)}
    return xr.Dataset({k.name: k.array(values) for k, values in (image | rest).items()}, coords=coords)


def seen_block(log: Log, names: Sequence[str], side: int, ring_px: float, backwards: Sequence[str] = ()) -> xr.Dataset:
    """Faces of a cube cut from a log, joined; those named in `backwards` are numbered inwards."""
    planes = box(side)
    parts = [
        seen_face(log, planes[name], side, ring_px, i, -1 if name in backwards else 1, first=1 + 3 * i)
        for i, name in enumerate(names)
    ]
    faces = Faces(tuple(planes[name] for name in names), ((side, side),) * len(names), 1.0, "px")
    return join_faces(parts, faces)
