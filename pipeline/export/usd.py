"""USD: the block, or a mesh, with baked maps as one USDZ; and the MaterialX document beside it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.carve.carving import Carved, Wish, carve, write_maps
from pipeline.carve.glb import welded
from pipeline.carve.mesh_files import Mesh, read_mesh
from pipeline.export.registry import Options, mm_or_one
from pipeline.extras import need
from pipeline.render.solids import box
from woodfit.appearance import SATIN
from woodfit.block_extent import block_extent
from woodfit.placement import Placement

if TYPE_CHECKING:
    from woodfit import SolidTexture

#: Turns the board frame upright.
_UPRIGHT = np.diag([1.0, -1.0, -1.0])


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.usdz`` (y up), and ``NAME.mtlx`` with its tables for renderers that evaluate it.

    The block is in the board frame turned upright, in mm where its size is known, else a unit of the texture stands for
    a mm; a mesh keeps its own frame, in metres.
    """
    need("pxr.Usd", "export", "to write USD")
    wish = Wish(options.map_px, detail=options.detail)
    if options.mesh is None:
        carved, metres = _block(texture, wish), 1e-3 * mm_or_one(texture, options)
    else:
        carved, metres = carve(read_mesh(options.mesh), texture, wish), 1.0
    path = folder / f"{options.name}.usdz"
    with tempfile.TemporaryDirectory() as work:
        _package(Path(work), path, carved, metres)
    from pipeline.export import materialx

    return [path, *materialx.write(texture, folder, options)]


def _block(texture: SolidTexture, wish: Wish) -> Carved:
    from pipeline.carve.atlas import atlas_of
    from pipeline.carve.support import support_of
    from woodfit.baking import bake

    vertices, faces = box(block_extent(texture))
    mesh = Mesh(vertices @ _UPRIGHT, faces, None, "block")
    placement = Placement(_UPRIGHT, 1.0, np.zeros(3))
    atlas, corners = atlas_of(mesh, wish.size), vertices[faces]
    maps = bake(texture, corners, atlas.uv, wish.size, wish.detail)
    return Carved(mesh, placement, atlas, maps, support_of(texture, mesh, corners))


def _package(work: Path, path: Path, carved: Carved, metres: float) -> None:
    from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdUtils

    maps = {file.stem.removeprefix("wood_"): file for file in write_maps(work / "wood.glb", carved.maps)}
    layer = work / "wood.usdc"
    stage = Usd.Stage.CreateNew(str(layer))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    root = UsdGeom.Xform.Define(stage, "/Wood")
    stage.SetDefaultPrim(root.GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, "/Wood/Piece")
    _geometry(mesh, carved)
    material = UsdShade.Material.Define(stage, "/Wood/Material")
    surface = UsdShade.Shader.Define(stage, "/Wood/Material/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(0.0)
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(SATIN.index_of_refraction)
    reader = UsdShade.Shader.Define(stage, "/Wood/Material/Coordinates")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    place = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    kinds = {
        "base_color": ("diffuseColor", Sdf.ValueTypeNames.Color3f, "rgb", "sRGB"),
        "roughness": ("roughness", Sdf.ValueTypeNames.Float, "r", "raw"),
        "normal": ("normal", Sdf.ValueTypeNames.Normal3f, "rgb", "raw"),
    }
    for name, (field, kind, channels, space) in kinds.items():
        image = UsdShade.Shader.Define(stage, f"/Wood/Material/{name}")
        image.CreateIdAttr("UsdUVTexture")
        image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{maps[name].name}")
        image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(place)
        for axis in ("wrapS", "wrapT"):
            image.CreateInput(axis, Sdf.ValueTypeNames.Token).Set("clamp")
        if name == "normal":
            image.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set((2.0, 2.0, 2.0, 1.0))
            image.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set((-1.0, -1.0, -1.0, 0.0))
        given = Sdf.ValueTypeNames.Float if channels == "r" else Sdf.ValueTypeNames.Float3
        surface.CreateInput(field, kind).ConnectToSource(image.CreateOutput(channels, given))
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    stage.GetRootLayer().Save()
    del stage
    for unused in ("displacement", "metallic"):
        maps[unused].unlink()
    made = work / "wood.usdz"
    if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer)), str(made)):
        raise OSError(f"{path} cannot be packed")
    path.write_bytes(made.read_bytes())


def _geometry(mesh: Any, carved: Carved) -> None:
    from pxr import Sdf, UsdGeom, Vt

    vertices, faces, normals, uv = welded(carved)
    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(vertices, np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces, np.int32).ravel()))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(normals, np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(uv, np.float32)))
