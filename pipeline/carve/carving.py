"""``woodpipe carve``: read a mesh, place it in the wood, bake its maps, write the GLB and what goes with it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.carve.atlas import Atlas, atlas_of
from pipeline.carve.glb import write_glb
from pipeline.carve.mesh_files import Mesh, read_mesh
from pipeline.carve.support import Support, support_of
from pipeline.problems import Problem, UsageError
from woodfit.baking import Maps, bake
from woodfit.placement import Placement, place

if TYPE_CHECKING:
    from woodfit import SolidTexture

SIZES = (1024, 2048, 4096, 8192)


@dataclass(frozen=True)
class Wish:
    """What a person asks for; None leaves the choice to the program.

    Attributes
    ----------
    size : int
        Texels along a side of the atlas.
    position, rotation_deg : tuple of three floats, or None
        As `woodfit.placement.place` takes them.
    scale : float or None
        Likewise.
    detail : bool
        Whether the color has its fine grain.
    """

    size: int = 2048
    position: tuple[float, float, float] | None = None
    rotation_deg: tuple[float, float, float] | None = None
    scale: float | None = None
    detail: bool = True


@dataclass(frozen=True)
class Carved:
    """A carved mesh, before it is written."""

    mesh: Mesh
    placement: Placement
    atlas: Atlas
    maps: Maps
    support: Support


def parse_size(text: str) -> int:
    """Texels from ``2k`` or ``2048``."""
    word = text.strip().lower()
    known = {f"{size // 1024}k": size for size in SIZES} | {str(size): size for size in SIZES}
    if word not in known:
        expected = ", ".join(f"{size // 1024}k" for size in SIZES)
        raise UsageError("The command cannot be followed", [Problem("--size", f"found {text!r}, expected {expected}")])
    return known[word]


def parse_triple(text: str | None, option: str) -> tuple[float, float, float] | None:
    """Three numbers from ``x,y,z``."""
    if text is None:
        return None
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        problem = Problem(option, f"found {text!r}, expected three numbers such as 10,0,5")
        raise UsageError("The command cannot be followed", [problem])
    return numbers


def open_texture(path: Path) -> SolidTexture:
    """A texture, with an error for people when it is none."""
    from woodfit import SolidTexture
    from woodfit.zarr_zip import TextureFileError

    try:
        return SolidTexture.open(path)
    except TextureFileError as error:
        raise UsageError("The texture cannot be used", [Problem("--texture", str(error))]) from error


def carve(mesh: Mesh, texture: SolidTexture, wish: Wish) -> Carved:
    """Place a mesh and bake its maps."""
    if wish.scale is not None and not 0.0 < wish.scale < 1e9:
        problem = Problem("--scale", f"found {wish.scale:g}, expected a positive number")
        raise UsageError("The command cannot be followed", [problem])
    placement = place(texture, mesh.vertices, wish.position, wish.rotation_deg, wish.scale)
    corners = placement.apply(mesh.vertices)[mesh.faces]
    atlas = atlas_of(mesh, wish.size)
    maps = bake(texture, corners, atlas.uv, wish.size, wish.detail)
    return Carved(mesh, placement, atlas, maps, support_of(texture, mesh, corners))


def carve_file(mesh_path: str, texture_path: Path, out: Path, wish: Wish) -> tuple[list[Path], list[str]]:
    """Carve a mesh file; returns the files written and what is to be said."""
    from pipeline.carve.picture import draw_placement

    if out.suffix.lower() != ".glb":
        problem = Problem("--out", f"found {out.name!r}, expected a name that ends in .glb")
        raise UsageError("The command cannot be followed", [problem])
    texture = open_texture(texture_path)
    carved = carve(read_mesh(mesh_path), texture, wish)
    out.parent.mkdir(parents=True, exist_ok=True)
    files = [write_glb(out, carved), *write_maps(out, carved.maps)]
    picture = out.with_name(f"{out.stem}_placement.png")
    draw_placement(texture, carved, picture)
    report = out.with_name(f"{out.stem}.json")
    report.write_text(json.dumps(report_of(carved, texture, wish), indent=2), encoding="utf-8")
    return [*files, picture, report], words_of(carved, texture)


def write_maps(out: Path, maps: Maps) -> list[Path]:
    """The maps as PNG beside the GLB."""
    import cv2

    pictures: dict[str, npt.NDArray[Any]] = {
        "base_color": maps.color[..., ::-1],
        "roughness": maps.roughness,
        "displacement": maps.height,
        "normal": maps.normal[..., ::-1],
        "metallic": np.zeros_like(maps.roughness),
    }
    files = []
    for name, picture in pictures.items():
        path = out.with_name(f"{out.stem}_{name}.png")
        done, data = cv2.imencode(".png", np.ascontiguousarray(picture), [cv2.IMWRITE_PNG_COMPRESSION, 4])
        if not done:
            raise OSError(f"{path} cannot be encoded")
        path.write_bytes(data.tobytes())
        files.append(path)
    return files


def report_of(carved: Carved, texture: SolidTexture, wish: Wish) -> dict[str, Any]:
    """Everything that was done, as JSON."""
    placement = carved.placement
    return {
        "mesh": carved.mesh.name,
        "triangles": len(carved.mesh.faces),
        "notes": list(carved.mesh.notes),
        "unit": texture.unit,
        "rotation": placement.rotation.tolist(),
        "unit_per_mesh_unit": placement.scale,
        "offset": placement.offset.tolist(),
        "texture_coordinates": carved.atlas.note,
        "atlas_texels": wish.size,
        "displacement_of_white": carved.maps.height_scale,
        "outside_of_what_the_photograph_supports": asdict(carved.support),
    }


def words_of(carved: Carved, texture: SolidTexture) -> list[str]:
    """What a person is told."""
    size = carved.placement.scale * np.ptp(carved.mesh.vertices, axis=0)
    words = [
        *carved.mesh.notes,
        f"texture coordinates: {carved.atlas.note}",
        f"{' x '.join(f'{side:.3g}' for side in size)} {texture.unit} in the wood "
        f"({carved.placement.scale:.4g} {texture.unit} per unit of the mesh)",
    ]
    return [*words, *carved.support.words(texture.unit)]
