"""Meshes from files: OBJ, PLY, STL and GLB, read by trimesh once their headers have been looked at."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.carve.mesh_checks import MOST_TRIANGLES, check_mesh_file, mesh_error, plain_glb
from pipeline.carve.sample_meshes import SAMPLES, sample_mesh
from pipeline.extras import need
from pipeline.problems import Problem, UsageError, did_you_mean

#: Names a mesh that is generated rather than read.
SAMPLE = "sample:"


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh.

    Attributes
    ----------
    vertices : float64 array of shape (V, 3)
        y up. glTF is in metres; the other formats do not say.
    faces : int64 array of shape (F, 3)
        Vertices of each triangle, counter-clockwise seen from outside.
    uv : float64 array of shape (V, 2), or None
        Texture coordinates of the vertices, v up, as in OBJ.
    name : str
        The file's, without suffix.
    notes : tuple of str
        What a person should know of the mesh.
    """

    vertices: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int64]
    uv: npt.NDArray[np.float64] | None
    name: str
    notes: tuple[str, ...] = ()


def read_mesh(path: str | Path) -> Mesh:
    """Read a mesh, or make the one that ``sample:NAME`` names.

    Raises
    ------
    UsageError
        In one line: what is wrong with the file and what to do; or that trimesh is not installed.
    """
    if str(path).startswith(SAMPLE):
        name = str(path).removeprefix(SAMPLE)
        if name not in SAMPLES:
            problem = Problem("", f"there is no sample mesh {name!r}{did_you_mean(name, SAMPLES)}")
            raise UsageError("The mesh cannot be used", [problem])
        return Mesh(*sample_mesh(name), None, name)
    path = Path(path)
    kind = check_mesh_file(path)
    trimesh = need("trimesh", "carve", "to read meshes")
    data = io.BytesIO(plain_glb(path) if kind == "glb" else _bytes_of(path, kind))
    try:
        options = {"skip_materials": True} if kind == "obj" else {}
        loaded = trimesh.load_scene(data, file_type=kind, process=False, resolver=None, **options).to_mesh()
        vertices, faces = np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces, np.int64)
    except MemoryError:
        raise
    # Parsers of four formats fail in as many ways on a broken file; to a person it is one.
    except Exception as error:
        what = f"cannot be read as .{kind} ({type(error).__name__}: {error}). Open it elsewhere and save it again"
        raise mesh_error(path, what) from error
    if not len(faces):
        raise mesh_error(path, "has no faces; expected triangles")
    return checked(vertices, faces, _uv(loaded, len(vertices)), path)


def _bytes_of(path: Path, kind: str) -> bytes:
    """A file's bytes; of a text mesh as UTF-8, whatever its comments and names were written in."""
    data = path.read_bytes()
    text = kind == "obj" or (kind == "stl" and data.lstrip()[:5].lower() == b"solid" and b"facet" in data)
    return data.decode("utf-8", "replace").encode("utf-8") if text else data


def checked(vertices: npt.NDArray[Any], faces: npt.NDArray[Any], uv: npt.NDArray[Any] | None, path: Path) -> Mesh:
    """A mesh whose numbers make sense, with notes on what does not hinder."""
    if len(faces) > MOST_TRIANGLES:
        raise mesh_error(path, f"has {len(faces):,} triangles; at most {MOST_TRIANGLES:,} are read")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise mesh_error(path, f"has faces that name vertices beyond its {len(vertices):,}")
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    bad = int((~np.isfinite(vertices[used]).all(axis=1)).sum())
    if bad:
        raise mesh_error(path, f"has {bad:,} vertices that are not numbers (NaN or infinite); repair the mesh")
    extent = float(np.ptp(vertices[used], axis=0).max())
    if not 1e-12 < extent < 1e12:
        raise mesh_error(path, f"is {extent:g} long; expected something that has a size")
    corners = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    flat = area <= 1e-12 * extent**2
    if flat.all():
        raise mesh_error(path, "has no surface: all its triangles are flat")
    notes = []
    if flat.any():
        notes.append(f"{int(flat.sum()):,} triangles without area were left out")
        faces = faces[~flat]
    open_edges, crowded = _edges(vertices, faces)
    if open_edges:
        notes.append(f"the mesh is open: {open_edges:,} edges with a face on one side only")
    if crowded:
        notes.append(f"the mesh is not a manifold: {crowded:,} edges with more than two faces")
    # Vertices of no face are no part of the surface; one far off, or NaN, would decide how large the rest becomes.
    kept, corner = np.unique(faces, return_inverse=True)
    faces = corner.reshape(-1, 3).astype(np.int64)
    return Mesh(vertices[kept], faces, None if uv is None else uv[kept], path.stem, tuple(notes))


def _edges(vertices: npt.NDArray[Any], faces: npt.NDArray[Any]) -> tuple[int, int]:
    """Edges with one face, and with more than two, of places rather than of vertices (seams split those)."""
    _, place = np.unique(vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[faces]
    edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges[:, 0] * np.int64(len(vertices)) + edges[:, 1], return_counts=True)
    return int((counts == 1).sum()), int((counts > 2).sum())


def _uv(loaded: Any, count: int) -> npt.NDArray[np.float64] | None:
    uv = getattr(loaded.visual, "uv", None)
    if uv is None or np.shape(uv) != (count, 2) or not np.isfinite(uv).all():
        return None
    return np.asarray(uv, np.float64)
