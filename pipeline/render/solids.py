"""Bodies that presets cut from the wood, as triangles with vertices of their own on every flat face."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.block_extent import Extent

Array = npt.NDArray[Any]
Surface = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]


def cells_surface(edges: tuple[Array, Array, Array], filled: npt.NDArray[np.bool_]) -> Surface:
    """Outside of the filled cells of a rectilinear grid, turned outwards.

    Parameters
    ----------
    edges : tuple of three increasing arrays
        Planes between cells along x, y and z: nx + 1, ny + 1, nz + 1 of them.
    filled : bool array of shape (nx, ny, nz)
        Which cells are wood.

    Returns
    -------
    vertices : array of shape (V, 3)
        Four for each face of a cell.
    faces : array of shape (F, 3)
        Counter-clockwise from outside.
    """
    padded = np.pad(filled, 1)
    vertices: list[Array] = []
    faces: list[Array] = []
    for i, j, k in np.argwhere(filled):
        place = np.array([i, j, k])
        for axis in range(3):
            for side in (0, 1):
                beside = place + 1
                beside[axis] += 2 * side - 1
                if padded[tuple(beside)]:
                    continue
                u, v = (axis + 1) % 3, (axis + 2) % 3
                quad = np.zeros((4, 3))
                quad[:, axis] = edges[axis][place[axis] + side]
                quad[:, u] = [edges[u][place[u] + one] for one in (0, 1, 1, 0)]
                quad[:, v] = [edges[v][place[v] + one] for one in (0, 0, 1, 1)]
                start = 4 * len(vertices)
                order = (0, 1, 2, 0, 2, 3) if side else (0, 2, 1, 0, 3, 2)
                faces.append(np.reshape([start + corner for corner in order], (2, 3)))
                vertices.append(quad)
    return np.concatenate(vertices), np.concatenate(faces).astype(np.int64)


def box(extent: Extent) -> Surface:
    """A whole block."""
    x, y, z = (np.array([low, high]) for low, high in zip(extent.low, extent.high, strict=True))
    return cells_surface((x, y, z), np.ones((1, 1, 1), bool))


def notched(extent: Extent, share: tuple[float, float, float] = (0.46, 0.42, 0.55)) -> Surface:
    """A block without its corner at the front, above and to the right; shares of its shorter front side and depth."""
    low, high = extent.low, extent.high
    shorter = float(extent.size[:2].min())
    x = high[0] - max(share[0] * shorter, 0.2 * extent.size[0])
    y = low[1] + max(share[1] * shorter, 0.2 * extent.size[1])
    z = low[2] + share[2] * extent.size[2]
    edges = (np.array([low[0], x, high[0]]), np.array([low[1], y, high[1]]), np.array([low[2], z, high[2]]))
    filled = np.ones((2, 2, 2), bool)
    filled[1, 0, 0] = False
    return cells_surface(edges, filled)


def shell(profile: Array, thickness: float, around: int = 256) -> Surface:
    """A turned shell about the y axis: outer radius over height by `profile` (M, 2), `thickness` inwards; closed."""
    outer = np.asarray(profile, float)
    inner = outer[::-1] - [thickness, 0.0]
    ring = np.concatenate([outer, inner])
    turn = np.arange(around) * (2 * np.pi / around)
    vertices = np.stack(
        [
            ring[:, :1] * np.cos(turn),
            np.broadcast_to(ring[:, 1:], (len(ring), around)),
            ring[:, :1] * np.sin(turn),
        ],
        axis=-1,
    ).reshape(-1, 3)
    index = np.arange(len(ring) * around).reshape(len(ring), around)
    up, right = np.roll(index, -1, axis=0), np.roll(index, -1, axis=1)
    both = np.roll(up, -1, axis=1)
    faces = np.concatenate(
        [np.stack([index, up, both], -1).reshape(-1, 3), np.stack([index, both, right], -1).reshape(-1, 3)]
    )
    return vertices, (faces if volume(vertices, faces) > 0.0 else faces[:, ::-1])


def volume(vertices: Array, faces: Array) -> float:
    """Signed volume; positive when faces are counter-clockwise from outside."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def subdivided(vertices: Array, faces: Array, longest: float, most: int) -> Surface:
    """Faces halved in four until no edge is longer than `longest`, or there are more than `most`."""
    while len(faces) * 4 <= most:
        corners = vertices[faces]
        if np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max() <= longest:
            break
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        known, number = np.unique(edges[:, 0] * np.int64(len(vertices)) + edges[:, 1], return_inverse=True)
        ends = np.stack([known // len(vertices), known % len(vertices)], axis=-1)
        a, b, c = (number.reshape(-1, 3) + len(vertices)).T
        vertices = np.concatenate([vertices, vertices[ends].mean(axis=1)])
        first, second, third = faces.T
        faces = np.concatenate(
            [np.stack(part, -1) for part in ((first, a, c), (a, second, b), (c, b, third), (a, b, c))]
        )
    return np.asarray(vertices, float), np.asarray(faces, np.int64)
