"""The carved mesh as one GLB: its own places, normals, coordinates and the baked maps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.extras import need
from woodfit.mesh_normals import corner_normals

if TYPE_CHECKING:
    from pipeline.carve.carving import Carved


def write_glb(path: Path, carved: Carved) -> Path:
    """Write the mesh in its own frame, y up, one unit of the mesh a metre, with base color, roughness and normals."""
    trimesh = need("trimesh", "carve", "to write GLB")
    pillow = need("PIL.Image", "carve", "to write pictures into GLB")
    vertices, faces, normals, uv = welded(carved)
    rough = carved.maps.roughness
    # glTF reads roughness from green and metallic from blue.
    packed = np.stack([np.zeros_like(rough), rough, np.zeros_like(rough)], axis=-1)
    material = trimesh.visual.material.PBRMaterial(
        name="wood",
        baseColorTexture=pillow.fromarray(carved.maps.color),
        metallicRoughnessTexture=pillow.fromarray(packed),
        normalTexture=pillow.fromarray(carved.maps.normal),
        metallicFactor=1.0,
        roughnessFactor=1.0,
    )
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    mesh = trimesh.Trimesh(vertices, faces, vertex_normals=normals, visual=visual, process=False, validate=False)
    scene = trimesh.Scene({carved.mesh.name: mesh})
    data = scene.export(file_type="glb", include_normals=True)
    temporary = path.with_name(f".{path.name}.partial")
    temporary.write_bytes(data)
    temporary.replace(path)
    return path


def welded(carved: Carved) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]:
    """Vertices, faces, normals and coordinates, with a vertex for every corner that differs in any of them."""
    faces = carved.mesh.faces
    normals = corner_normals(carved.mesh.vertices, faces).reshape(-1, 3)
    uv = carved.atlas.uv.reshape(-1, 2)
    key = np.column_stack([faces.reshape(-1), np.round(uv * 1e6).astype(np.int64), np.round(normals * 1e3)])
    key = np.ascontiguousarray(key.astype(np.int64))
    _, first, corner = np.unique(key.view([("", np.int64)] * 6).ravel(), return_index=True, return_inverse=True)
    vertices = carved.mesh.vertices[faces.reshape(-1)[first]]
    return vertices, corner.reshape(-1, 3), normals[first], uv[first]
