"""Texture coordinates: a mesh's own where they can be used, otherwise charts made by xatlas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipeline.carve.mesh_files import Mesh
from pipeline.extras import need
from woodfit.baking import rasterize

#: xatlas takes a time that grows faster than the mesh: larger ones are cut into pieces of at most so many triangles.
_PIECE = 8_000

#: Own coordinates are used when they cover their atlas at most this many times.
_MOST_OVERLAP = 1.08

_CHECKED_PX = 512


@dataclass(frozen=True)
class Atlas:
    """Texture coordinates of every corner.

    Attributes
    ----------
    uv : float64 array of shape (F, 3, 2)
        v up, inside of 0..1.
    own : bool
        Whether they are the mesh's own.
    note : str
        How they came about.
    """

    uv: npt.NDArray[np.float64]
    own: bool
    note: str


def atlas_of(mesh: Mesh, size: int) -> Atlas:
    """Coordinates for an atlas of size x size texels."""
    reason = "the mesh has no texture coordinates"
    if mesh.uv is not None:
        uv = mesh.uv[mesh.faces]
        reason = _unusable(uv)
        if not reason:
            return Atlas(uv, True, "the mesh's own texture coordinates")
    return Atlas(_unwrapped(mesh, size), False, f"new charts: {reason}")


def _unusable(uv: npt.NDArray[np.float64]) -> str:
    """Why coordinates (F, 3, 2) cannot be used; empty when they can."""
    if uv.min() < -1e-6 or uv.max() > 1.0 + 1e-6:
        return "its texture coordinates leave 0..1"
    first, second = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    if float(np.mean(area < 1e-12)) > 0.01:
        return "many of its triangles have no area in its texture coordinates"
    covered = float((rasterize(uv, _CHECKED_PX).triangle >= 0).mean())
    # The border that texels beyond a chart get makes the covered part too large, never too small.
    if float(area.sum()) > _MOST_OVERLAP * covered:
        return "its texture coordinates overlap"
    return ""


def _unwrapped(mesh: Mesh, size: int) -> npt.NDArray[np.float64]:
    xatlas = need("xatlas", "carve", "to make texture coordinates")
    atlas = xatlas.Atlas()
    pieces = _pieces(mesh.vertices, mesh.faces)
    span = float(np.ptp(mesh.vertices, axis=0).max())
    for piece in pieces:
        used, corners = np.unique(mesh.faces[piece], return_inverse=True)
        # Of one size whatever the unit of the mesh, since xatlas has absolute tolerances.
        atlas.add_mesh((mesh.vertices[used] / span).astype(np.float32), corners.reshape(-1, 3).astype(np.uint32))
    options = xatlas.PackOptions()
    options.resolution, options.bilinear = 1024, True
    options.padding = int(np.ceil(6 * 1024 / size)) + 1
    atlas.generate(xatlas.ChartOptions(), options)
    uv = np.zeros((len(mesh.faces), 3, 2))
    for number, piece in enumerate(pieces):
        _, corners, places = atlas[number]
        uv[piece] = np.asarray(places, np.float64)[np.asarray(corners, np.int64)]
    return np.clip(uv, 0.0, 1.0)


def _pieces(vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]) -> list[npt.NDArray[np.int64]]:
    """Numbers of the faces of compact pieces, halved at the middle of their longest side until they are small."""
    middle = vertices[faces].mean(axis=1)
    done, waiting = [], [np.arange(len(faces))]
    while waiting:
        piece = waiting.pop()
        if len(piece) <= _PIECE:
            done.append(piece)
            continue
        axis = int(np.argmax(np.ptp(middle[piece], axis=0)))
        order = piece[np.argsort(middle[piece, axis], kind="stable")]
        waiting += [order[: len(order) // 2], order[len(order) // 2 :]]
    return done
