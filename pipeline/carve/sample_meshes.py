"""Meshes made here, for trying things out: turned and knotted pieces with smooth, finely divided surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

SAMPLES = ("ball", "bowl", "knot", "pawn")

_Surface = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]


def sample_mesh(name: str, fineness: int = 128) -> _Surface:
    """Vertices (V, 3), y up, and faces (F, 3) of a sample; closed, about 4 `fineness`² triangles.

    Raises
    ------
    KeyError
        When there is no such sample.
    """
    makers = {"ball": _ball, "bowl": _bowl, "knot": _knot, "pawn": _pawn}
    return makers[name](fineness)


def _closed_grid(points: npt.NDArray[Any]) -> _Surface:
    """Faces of a grid (M, N, 3) that closes along both axes, turned outwards."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    below, right = np.roll(index, -1, axis=0), np.roll(index, -1, axis=1)
    both = np.roll(below, -1, axis=1)
    faces = np.concatenate(
        [np.stack([index, right, both], -1).reshape(-1, 3), np.stack([index, both, below], -1).reshape(-1, 3)]
    )
    vertices = points.reshape(-1, 3)
    return _outwards(vertices, faces)


def _outwards(vertices: npt.NDArray[Any], faces: npt.NDArray[Any]) -> _Surface:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    if float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) < 0.0:
        faces = faces[:, ::-1]
    return np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int64)


def _turned(profile: npt.NDArray[Any], around: int) -> _Surface:
    """A lathe's work: a profile (M, 2) of radius and height from axis to axis, without its two ends, and two poles."""
    turn = np.arange(around) * (2 * np.pi / around)
    radius, height = profile[1:-1, 0, None], profile[1:-1, 1, None]
    ring = np.stack([radius * np.cos(turn), np.broadcast_to(height, (len(height), around)), radius * np.sin(turn)], -1)
    vertices = np.concatenate([ring.reshape(-1, 3), [[0, profile[0, 1], 0], [0, profile[-1, 1], 0]]])
    rows = len(ring)
    index = np.arange(rows * around).reshape(rows, around)
    right = np.roll(index, -1, axis=1)
    sides = np.concatenate(
        [
            np.stack([index[:-1], index[1:], right[1:]], -1).reshape(-1, 3),
            np.stack([index[:-1], right[1:], right[:-1]], -1).reshape(-1, 3),
        ]
    )
    first, last = rows * around, rows * around + 1
    caps = np.concatenate(
        [
            np.stack([np.full(around, first), index[0], right[0]], -1),
            np.stack([np.full(around, last), right[-1], index[-1]], -1),
        ]
    )
    return _outwards(vertices, np.concatenate([sides, caps]))


def _smooth(corners: list[tuple[float, float]], count: int) -> npt.NDArray[np.float64]:
    """Points at even steps along a smooth curve through corners (radius, height)."""
    from scipy.interpolate import PchipInterpolator

    known = np.array(corners)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(known, axis=0), axis=1))])
    curve = PchipInterpolator(way, known)(np.linspace(0.0, way[-1], 20 * count))
    steps = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    wanted = np.linspace(0.0, steps[-1], count)
    return np.stack([np.interp(wanted, steps, curve[:, axis]) for axis in range(2)], axis=-1)


def _ball(fineness: int) -> _Surface:
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, fineness + 1)
    return _turned(np.stack([np.cos(angle), np.sin(angle)], -1), 2 * fineness)


def _bowl(fineness: int) -> _Surface:
    outside = [(0.0, 0.0), (0.34, 0.0), (0.36, 0.03), (0.33, 0.07), (0.62, 0.17), (0.88, 0.38), (0.985, 0.62)]
    rim = [(1.0, 0.655), (0.975, 0.665), (0.945, 0.645)]
    inside = [(0.83, 0.40), (0.58, 0.225), (0.28, 0.145), (0.0, 0.13)]
    return _turned(_smooth(outside + rim + inside, 2 * fineness), fineness)


def _pawn(fineness: int) -> _Surface:
    foot = [(0.0, 0.0), (0.40, 0.0), (0.42, 0.06), (0.40, 0.12), (0.33, 0.17), (0.31, 0.22)]
    body = [(0.20, 0.42), (0.15, 0.66), (0.155, 0.74), (0.26, 0.79), (0.26, 0.82), (0.16, 0.86)]
    head = [(0.215, 0.93), (0.25, 1.03), (0.215, 1.14), (0.12, 1.22), (0.0, 1.25)]
    return _turned(_smooth(foot + body + head, 2 * fineness), fineness)


def _knot(fineness: int) -> _Surface:
    t = np.arange(4 * fineness) * (2 * np.pi / (4 * fineness))

    def middle(t: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        wide = 1.0 + 0.42 * np.cos(3 * t)
        return np.stack([wide * np.cos(2 * t), 0.46 * np.sin(3 * t), wide * np.sin(2 * t)], -1)

    step = 1e-4
    ahead = middle(t + step) - middle(t - step)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.cross(ahead, np.stack([np.cos(2 * t), np.zeros_like(t), np.sin(2 * t)], -1))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, ahead)
    turn = np.arange(fineness // 2) * (2 * np.pi / (fineness // 2))
    circle = np.cos(turn)[None, :, None] * side[:, None] + np.sin(turn)[None, :, None] * up[:, None]
    return _closed_grid(middle(t)[:, None] + 0.2 * circle)
