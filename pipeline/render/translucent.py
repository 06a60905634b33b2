"""Thin wood with light behind it: veneer, fitted and extruded side by side, and a lampshade."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.render.frame import UPRIGHT, Frame
from pipeline.render.materials import Wood, mesh_of
from pipeline.render.presets import Job, Scene
from pipeline.render.solids import box, shell
from pipeline.render.studio import Shot, ground, sensor
from pipeline.render.variant import Variant
from woodfit.block_extent import Extent, block_extent
from woodfit.volume_optics import extinction_per_mm, scattering_albedo

if TYPE_CHECKING:
    from woodfit import SolidTexture

Array = npt.NDArray[Any]

#: Thickness of veneer and of the lampshade's wall (Nindel et al. 2023, Fig. "veneer"), mm.
THICKNESS_MM = 1.8

#: The sheet's longest side, in thicknesses.
_SHEET = 30.0

#: Turns in which the board's x, y or z stands upright in the scene.
_STANDING = (
    np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    UPRIGHT,
    np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
)

_SHEET_CELLS, _SHADE_CELLS = 420, 280


def medium(wood: Wood, extent: Extent, cells: tuple[int, int, int], mm_per_scene: float, flat: bool) -> dict[str, Any]:
    """The wood in a box as a medium of heterogeneous extinction and albedo.

    `flat` takes the wood of the box's front for all of its depth: an extrusion.
    """
    if flat:
        front = Extent(extent.low, np.array([*extent.high[:2], extent.low[2] + 1e-6 * extent.size[2]]))
        both = wood.grid(front, (*cells[:2], 1), _optics)
        both = np.repeat(both, 2, axis=0)
    else:
        both = wood.grid(extent, cells, _optics)
    return {
        "type": "heterogeneous",
        "sigma_t": wood.volume(both[..., :1] * mm_per_scene, extent),
        "albedo": wood.volume(both[..., 1:], extent),
    }


def _optics(sample: Any) -> Array:
    """Extinction (1/mm) and scattering albedo (RGB) of wood, (..., 4)."""
    # The sheet has no refracting boundary here: the medium's index is 1.
    return np.concatenate([extinction_per_mm(sample.lateness)[..., None], scattering_albedo(sample.rgb)], axis=-1)


def _cells(job: Job, most: int) -> int:
    """Cells along the longest side: no finer than the picture shows."""
    return int(np.clip(2 * max(job.size), 48, most))


def sheet_of(texture: SolidTexture, mm_per_unit: float) -> Extent:
    """A sheet of veneer from the middle of the face, `THICKNESS_MM` thick."""
    block = block_extent(texture)
    thick = THICKNESS_MM / mm_per_unit
    half = 0.5 * np.minimum(block.size[:2], _SHEET * thick)
    low = np.array([*(block.centre[:2] - half), block.low[2]])
    return Extent(low, np.array([*(block.centre[:2] + half), block.low[2] + min(thick, block.size[2])]))


def veneer(mi: Any, variant: Variant, job: Job, folder: Path) -> list[Scene]:
    """Two sheets before a shining sphere: the wood extruded from its face, and the wood as fitted."""
    sheet = sheet_of(job.texture, job.mm_per_unit)
    frame = Frame.around(sheet)
    wood = Wood(mi, variant, job.texture, frame, sheet, False)
    vertices, faces = box(sheet)
    scene = frame.scene(vertices)
    scenes = []
    for flat in (True, False):
        within = medium(wood, sheet, sheet.cells(_cells(job, _SHEET_CELLS)), job.mm_per_unit / frame.scale, flat)
        body = mesh_of(mi, folder, scene, faces, False, interior=within, bsdf={"type": "null"})
        camera = sensor(mi, scene, Shot(0.0, 0.0, 20.0, 0.94), job.size, job.spp)
        lamp = {
            "type": "sphere",
            "center": [0.0, 0.0, -2.3],
            "radius": 2.1,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [105.0, 100.0, 92.0]}},
        }
        sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.05, 0.05, 0.055]}}
        integrator = {"type": "volpath", "max_depth": job.depth, "rr_depth": 24}
        scenes.append(
            {"type": "scene", "integrator": integrator, "sensor": camera, "sky": sky, "lamp": lamp, "sheet": body}
        )
    return scenes


def side_views(texture: SolidTexture, mm_per_unit: float, width: int) -> tuple[Array, Array]:
    """The lower edge of the two sheets, extruded and fitted, as linear color (H, `width`, 3), four times as thick."""
    sheet = sheet_of(texture, mm_per_unit)
    rows = max(8, round(4.0 * width * sheet.size[2] / sheet.size[0]))
    x = sheet.low[0] + (np.arange(width) + 0.5) / width * sheet.size[0]
    z = sheet.low[2] + (np.arange(rows) + 0.5) / rows * sheet.size[2]
    fitted = np.stack(np.broadcast_arrays(x, sheet.high[1], z[:, None]), axis=-1)
    flat = np.stack(np.broadcast_arrays(x, sheet.high[1], np.full((rows, 1), sheet.low[2])), axis=-1)
    return texture.evaluate(flat, False).rgb, texture.evaluate(fitted, False).rgb


def lampshade(mi: Any, variant: Variant, job: Job, folder: Path) -> list[Scene]:
    """A shade turned from the block, its axis along the grain, with a bulb inside."""
    texture = job.texture
    block = block_extent(texture)
    grain = int(np.argmax(np.abs(texture.board_to_tree[2, :3])))
    radius = 0.49 * float(np.delete(block.size, grain).min())
    height = float(min(block.size[grain] * 0.98, 2.6 * radius))
    thick = min(THICKNESS_MM / job.mm_per_unit, 0.2 * radius)
    t = np.linspace(0.0, 1.0, 48)
    profile = np.stack([radius * (0.70 + 0.30 * np.sin(0.5 * np.pi * (1.0 - t)) ** 1.2), height * (t - 0.5)], axis=-1)
    vertices, faces = shell(profile, thick)
    frame = Frame(block.centre, 2.0 / height, _STANDING[grain])
    scene = frame.scale * vertices
    placed = frame.board(scene)
    extent = Extent(placed.min(axis=0), placed.max(axis=0))
    wood = Wood(mi, variant, texture, frame, extent, False)
    within = medium(wood, extent, extent.cells(_cells(job, _SHADE_CELLS)), job.mm_per_unit / frame.scale, False)
    body = mesh_of(mi, folder, scene, faces, False, interior=within, bsdf={"type": "null"})
    bulb = {
        "type": "sphere",
        "center": [0.0, -0.05, 0.0],
        "radius": 0.2,
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [640.0, 560.0, 460.0]}},
    }
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.06, 0.065, 0.08]}}
    integrator = {"type": "volpath", "max_depth": job.depth, "rr_depth": 24}
    return [
        {
            "type": "scene",
            "integrator": integrator,
            "sensor": sensor(mi, scene, Shot(20.0, 17.0), job.size, job.spp),
            "sky": sky,
            "bulb": bulb,
            "floor": ground(mi, float(scene[:, 1].min()) - 2e-3, 0.3),
            "shade": body,
        }
    ]
