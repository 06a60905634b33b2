"""The presets: what is cut from the wood, how it is lit, and where from it is seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.render.frame import Frame
from pipeline.render.materials import Wood, mesh_of
from pipeline.render.solids import notched, subdivided
from pipeline.render.studio import Shot, film, ground, lights, sensor
from pipeline.render.variant import Variant
from woodfit.appearance import SATIN
from woodfit.block_extent import block_extent

if TYPE_CHECKING:
    from woodfit import SolidTexture

Array = npt.NDArray[Any]

#: Triangles of a carved mesh after it was divided for its relief.
_MOST_TRIANGLES = 1_500_000


@dataclass(frozen=True)
class Job:
    """What is asked for.

    Attributes
    ----------
    texture : SolidTexture
        The wood.
    size : tuple of int
        Width and height, px.
    spp : int
        Samples per pixel.
    mesh : str
        File, or ``sample:NAME``, of what is carved.
    detail : bool
        With fine grain.
    mm_per_unit : float
        Size of a unit of the texture.
    depth : int
        Most scatterings of a path in a medium.
    """

    texture: SolidTexture
    size: tuple[int, int]
    spp: int
    mesh: str = "sample:bowl"
    detail: bool = True
    mm_per_unit: float = 1.0
    depth: int = 400


Scene = dict[str, Any]
Maker = Callable[[Any, Variant, Job, Path], list[Scene]]


def front(mi: Any, variant: Variant, job: Job, folder: Path) -> list[Scene]:
    """The photographed face straight on, evenly lit: the color of the wood and nothing else."""
    texture = job.texture
    extent = block_extent(texture)
    frame = Frame.around(extent)
    wood = Wood(mi, variant, texture, frame, extent, job.detail)
    corner, right, down = texture.seen.plane[0] * (texture.pixel_size or 1.0)
    across, along = texture.seen.size[0]
    quad = corner + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) @ np.stack([across * right, along * down])
    scene = frame.scene(quad)
    mesh = mesh_of(mi, folder, scene, np.array([[0, 3, 2], [0, 2, 1]]), False, bsdf=_both_sides(wood.matte()))
    middle, half_u, half_v = scene.mean(axis=0), 0.5 * (scene[1] - scene[0]), 0.5 * (scene[0] - scene[3])
    normal = np.cross(half_u, half_v)
    normal /= np.linalg.norm(normal)
    wide, high = np.linalg.norm(half_u), np.linalg.norm(half_v)
    look = mi.ScalarTransform4f().look_at(
        origin=(middle + 3.0 * normal).tolist(), target=middle.tolist(), up=half_v.tolist()
    )
    # The whole face, whatever the shape of the picture.
    span = max(wide, high * job.size[0] / job.size[1])
    camera = {
        "type": "orthographic",
        "to_world": look.scale([span, span, 1.0]),
        "film": film(*job.size),
        "sampler": {"type": "independent", "sample_count": job.spp},
    }
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}}
    return [_scene({"type": "path", "max_depth": 2, "hide_emitters": True}, camera, {"sky": sky, "face": mesh})]


def block(mi: Any, variant: Variant, job: Job, folder: Path) -> list[Scene]:
    """The photographed board as a solid, a corner cut away."""
    extent = block_extent(job.texture)
    frame = Frame.around(extent)
    wood = Wood(mi, variant, job.texture, frame, extent, job.detail)
    vertices, faces = notched(extent)
    scene = frame.scene(vertices)
    body = mesh_of(mi, folder, scene, faces, False, bsdf=wood.surface())
    return [_in_studio(mi, job, {"block": body}, scene, Shot())]


def carved(mi: Any, variant: Variant, job: Job, folder: Path) -> list[Scene]:
    """A mesh cut from the wood; latewood stands out a little and is smoother."""
    from pipeline.carve.mesh_files import read_mesh
    from woodfit.placement import place

    mesh, texture = read_mesh(job.mesh), job.texture
    extent = block_extent(texture)
    placement = place(texture, mesh.vertices)
    # Divided finely enough to carry the relief of a ring.
    longest = 0.12 * texture.ring_width / placement.scale
    welded, corner = np.unique(mesh.vertices, axis=0, return_inverse=True)
    vertices, faces = subdivided(welded, corner.reshape(-1)[mesh.faces], longest, _MOST_TRIANGLES)
    points = placement.apply(vertices)
    normals = _vertex_normals(points, faces)
    lateness = texture.evaluate(points, detail=False).lateness
    points = points + SATIN.height(lateness, texture.ring_width)[:, None] * normals
    # Seen as the mesh stands: its own y up, whichever way it lay in the log.
    upright = placement.back(points)
    low, high = upright.min(axis=0), upright.max(axis=0)
    scale = 2.0 / float((high - low).max())
    scene = (upright - 0.5 * (low + high)) * scale
    centre = placement.offset + 0.5 * placement.scale * placement.rotation @ (low + high)
    frame = Frame(centre, scale / placement.scale, placement.rotation.T)
    wood = Wood(mi, variant, texture, frame, extent, job.detail)
    body = mesh_of(mi, folder, scene, faces, True, bsdf=wood.surface())
    return [_in_studio(mi, job, {"piece": body}, scene, Shot(28.0, 27.0))]


def false_color(mi: Any, variant: Variant, job: Job, folder: Path) -> list[Scene]:
    """The block as a translucent volume in which latewood alone is dense."""
    from woodfit.volume_view import Medium

    medium, texture = Medium(), job.texture
    extent = block_extent(texture)
    frame = Frame.around(extent)
    wood = Wood(mi, variant, texture, frame, extent, False)
    longest = int(np.clip(1.3 * max(job.size), 64, 320))
    # Extinction is given per tenth of the face's longer side, which is two units of the scene.
    unit = 10.0 / (frame.scale * float(np.sort(extent.size)[1:].max()))

    def extinction(sample: Any) -> Array:
        return unit * np.where(sample.lateness > medium.threshold, medium.late, medium.early)[..., None]

    grid = wood.grid(extent, extent.cells(longest), extinction)
    vertices, faces = notched(extent)
    scene = frame.scene(vertices)
    interior = {
        "type": "heterogeneous",
        "sigma_t": wood.volume(grid, extent),
        "albedo": {"type": "constvolume", "value": {"type": "rgb", "value": list(medium.albedo)}},
    }
    body = mesh_of(mi, folder, scene, faces, False, interior=interior, bsdf={"type": "null"})
    made = _in_studio(mi, replace(job, depth=24), {"block": body}, scene, Shot(), volume=True)
    made["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.75, 0.76, 0.78]}}
    return [made]


def _vertex_normals(vertices: Array, faces: Array) -> npt.NDArray[np.float64]:
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    scaled = np.cross(b - a, c - a)
    total = np.stack(
        [np.bincount(faces.ravel(), np.repeat(scaled[:, axis], 3), len(vertices)) for axis in range(3)], axis=-1
    )
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300))


def _both_sides(bsdf: Any) -> dict[str, Any]:
    return {"type": "twosided", "material": bsdf}


def _scene(integrator: dict[str, Any], camera: dict[str, Any], parts: dict[str, Any]) -> Scene:
    return {"type": "scene", "integrator": integrator, "sensor": camera, **parts}


def _in_studio(mi: Any, job: Job, parts: dict[str, Any], points: Array, shot: Shot, volume: bool = False) -> Scene:
    """Things on the floor of the studio."""
    integrator = {"type": "volpath" if volume else "path", "max_depth": job.depth if volume else 6}
    floor = ground(mi, float(points[:, 1].min()) - 1e-3)
    return _scene(
        integrator | {"rr_depth": 16 if volume else 5},
        sensor(mi, points, shot, job.size, job.spp),
        {**lights(mi), "floor": floor, **parts},
    )
