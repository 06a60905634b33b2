"""What the renderer reads of the wood: surface textures evaluated at the point hit, meshes, grids of a medium."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.render.drjit_wood import DrjitWood
from pipeline.render.frame import Frame
from pipeline.render.variant import Variant
from woodfit.appearance import SATIN
from woodfit.block_extent import Extent

if TYPE_CHECKING:
    from woodfit import SolidTexture

Array = npt.NDArray[Any]

#: Cells along the longest side of the grid that the scalar variant reads instead.
_GRID = 320

#: Points evaluated at a time where a grid is filled.
_SLAB_POINTS = 1 << 20


class Wood:
    """The wood of a scene: its texture, where it lies, and how this variant reads it."""

    def __init__(
        self, mi: Any, variant: Variant, texture: SolidTexture, frame: Frame, extent: Extent, detail: bool = True
    ) -> None:
        self.mi, self.variant, self.texture, self.frame, self.extent = mi, variant, texture, frame, extent
        self.detail = detail
        self._drjit = DrjitWood(mi, texture, detail) if variant.vectorised else None

    def surface(self) -> dict[str, Any]:
        """A BSDF with the color and the roughness of the wood."""
        return {
            "type": "principled",
            "base_color": self.color(),
            "roughness": self.roughness(),
            "specular": 0.5,
        }

    def matte(self) -> dict[str, Any]:
        """A BSDF with the color of the wood alone."""
        return {"type": "diffuse", "reflectance": self.color()}

    def color(self) -> Any:
        """Texture of the linear color."""
        if self._drjit is None:
            return self._grid_texture(lambda wood: np.clip(wood.rgb, 0.0, 1.0))
        return self._python_texture(False)

    def roughness(self) -> Any:
        """Texture of the roughness."""
        if self._drjit is None:
            return self._grid_texture(lambda wood: SATIN.roughness(wood.lateness)[..., None])
        return self._python_texture(True)

    def _python_texture(self, rough: bool) -> Any:
        import drjit as dr

        mi, wood, frame = self.mi, self._drjit, self.frame
        if wood is None:
            raise TypeError("the scalar variant reads the wood from grids")
        read: DrjitWood = wood

        def value(si: Any) -> Any:
            (red, green, blue), late, _ = read(frame.board_of(mi, si.p))
            if rough:
                early, latewood = SATIN.roughness_early, SATIN.roughness_late
                return mi.Color3f(early + (latewood - early) * dr.clip(late, 0.0, 1.0))
            return mi.Color3f(*(dr.clip(channel, 0.0, 1.0) for channel in (red, green, blue)))

        def single(si: Any) -> Any:
            found = value(si)
            return (found.x + found.y + found.z) / 3.0

        # Made by `type`, since the base is chosen with the variant, when the program runs.
        methods = {
            "eval": lambda self, si, active=True: value(si),
            "eval_1": lambda self, si, active=True: single(si),
            "eval_3": lambda self, si, active=True: value(si),
            "mean": lambda self: mi.Float(0.5),
            "is_spatially_varying": lambda self: True,
            "to_string": lambda self: "WoodTexture[]",
        }
        kind: Any = type("WoodTexture", (mi.Texture,), methods)
        name = f"woodpipe_{'roughness' if rough else 'color'}"
        mi.register_texture(name, lambda props: kind(props))
        return mi.load_dict({"type": name})

    def _grid_texture(self, take: Callable[[Any], Array]) -> Any:
        """What the scalar variant reads: calls into Python for every ray would take it an hour."""
        grid = self.grid(self.extent, self.extent.cells(_GRID), take, self.detail)
        return {"type": "volume", "volume": self.volume(grid, self.extent)}

    def grid(
        self, extent: Extent, cells: tuple[int, int, int], take: Callable[[Any], Array], detail: bool = False
    ) -> npt.NDArray[np.float32]:
        """Something of the wood in the cells of a box of the board frame, filled slab by slab; (nz, ny, nx, C)."""
        nx, ny, nz = cells
        points = extent.points(cells)
        thick = max(1, _SLAB_POINTS // (nx * ny))
        slabs = (points[first : first + thick] for first in range(0, nz, thick))
        return np.concatenate([np.asarray(take(self.texture.evaluate(slab, detail)), np.float32) for slab in slabs])

    def volume(self, grid: npt.NDArray[np.float32], extent: Extent) -> dict[str, Any]:
        """A grid that fills a box of the board frame."""
        mi = self.mi
        matrix = np.eye(4)
        matrix[:3, 3] = self.frame.scene(extent.low)
        matrix[:3, :3] = (self.frame.scene(extent.low + np.diag(extent.size)) - matrix[:3, 3]).T
        place = mi.ScalarTransform4f(matrix.tolist())
        return {
            "type": "gridvolume",
            "grid": mi.VolumeGrid(np.ascontiguousarray(grid)),
            "to_world": place,
            "raw": True,
            "filter_type": "trilinear",
        }


def mesh_of(mi: Any, folder: Path, vertices: Array, faces: Array, smooth: bool, **more: Any) -> dict[str, Any]:
    """A mesh of scene coordinates for a scene's dictionary; `more` is what a shape takes: a BSDF, media.

    It passes through a file in `folder`, which the caller removes once the scene is loaded.
    """
    mesh = mi.Mesh("wood", len(vertices), len(faces), has_vertex_normals=smooth)
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
    params["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
    params.update()
    if smooth:
        mesh.recompute_vertex_normals()
    path = folder / f"mesh_{len(list(folder.iterdir()))}.ply"
    mesh.write_ply(str(path))
    return {"type": "ply", "filename": str(path), "face_normals": not smooth, **more}
