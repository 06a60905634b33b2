"""Normals of a triangle mesh that are smooth where the surface is, and sharp at its edges."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

#: A vertex where more corners meet is the tip of a fan; it gets one normal.
_MOST_CORNERS = 48


def corner_normals(vertices: Array, faces: Array, crease_deg: float = 40.0) -> npt.NDArray[np.float64]:
    """Unit normal at every corner of every face, (F, 3, 3): the mean of the faces there that turn less than a crease.

    Parameters
    ----------
    vertices : array of shape (V, 3)
        Vertices at one place count as one.
    faces : int array of shape (F, 3)
        Counter-clockwise from outside.
    crease_deg : float
        Faces that meet at a larger angle meet at an edge.
    """
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    scaled = np.cross(b - a, c - a)
    flat = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-300)
    _, place = np.unique(vertices, axis=0, return_inverse=True)
    at = place.reshape(-1)[faces].ravel()
    face = np.repeat(np.arange(len(faces)), 3)
    order = np.argsort(at, kind="stable")
    start = np.searchsorted(at[order], np.arange(at.max() + 2))
    count = np.diff(start)[at]
    total = np.zeros((len(at), 3))
    limit = np.cos(np.radians(crease_deg))
    for step in range(int(min(count.max(), _MOST_CORNERS))):
        some = np.flatnonzero((count > step) & (count <= _MOST_CORNERS))
        other = face[order[start[at[some]] + step]]
        near = np.einsum("ij,ij->i", flat[face[some]], flat[other]) > limit
        total[some[near]] += scaled[other[near]]
    fans = np.flatnonzero(count > _MOST_CORNERS)
    if len(fans):
        tips = np.stack([np.bincount(at, scaled[face, axis], minlength=len(start)) for axis in range(3)], axis=-1)
        total[fans] = tips[at[fans]]
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    normals = np.where(lengths > 1e-300, total / np.maximum(lengths, 1e-300), flat[face])
    return np.asarray(normals.reshape(-1, 3, 3), np.float64)
