"""Exports: each is opened again by the tool that it is for, and holds the wood."""

import json
import os
import re
import struct
import subprocess
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from color_checks import assert_same_colors, srgb
from typer.testing import CliRunner
from wood_samples import WOODS, in_block, old_wood

from pipeline.cli import app
from pipeline.export.registry import EXPORTERS, Options, export_all, exporters_named
from pipeline.export.volumes import cells_of, slabs
from pipeline.problems import UsageError
from woodfit import SolidTexture
from woodfit.block_extent import block_extent

UPRIGHT = np.array([1.0, -1.0, -1.0])
EVERY = {**WOODS, "old": old_wood()}
BLENDER = os.environ.get("WOODPIPE_BPY_PYTHON")

needs_blender = pytest.mark.skipif(
    BLENDER is None, reason="WOODPIPE_BPY_PYTHON does not name a Python with bpy, Blender as a module"
)


def exported(name: str, wood: SolidTexture, folder: Path, **more: object) -> list[Path]:
    (exporter,) = exporters_named(name)
    return exporter.write(wood, folder, Options(**{"cells": 40, "map_px": 256, **more}))


def held(wood: SolidTexture, where: np.ndarray) -> np.ndarray:
    """Which points lie in rings that shaders' tables hold."""
    return wood.evaluate(where, detail=False).ring_age > (61 if len(wood.ring_radius) > 250 else -1)


# --- MaterialX -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(EVERY))
def test_the_materialx_graph_run_as_glsl_gives_the_wood(tmp_path: Path, name: str) -> None:
    pytest.importorskip("MaterialX")
    from materialx_programs import loaded, run_document

    wood = EVERY[name]
    document = loaded(exported("materialx", wood, tmp_path)[0])
    assert document.validate() == (True, "")
    where = in_block(wood, 10_000)
    found = run_document(document, tmp_path, where * UPRIGHT)[:, :3]
    known, kept = wood.evaluate(where).rgb, held(wood, where)
    assert_same_colors(found[kept], known[kept])
    ages = run_document(document, tmp_path, where * UPRIGHT, "age")[:, 0]
    assert np.percentile(np.abs(ages - wood.evaluate(where).ring_age)[kept], 99) < 0.02


def test_osl_and_essl_are_generated_from_the_materialx_graph(tmp_path: Path) -> None:
    pytest.importorskip("MaterialX")
    from materialx_programs import generated, loaded

    document = loaded(exported("materialx", WOODS["sector"], tmp_path)[0])
    assert "woodpipe_fine_grain" in generated(document, tmp_path, "osl")
    assert "woodpipe_fine_grain" in generated(document, tmp_path, "essl")


def test_without_detail_the_document_has_standard_nodes_only(tmp_path: Path) -> None:
    mx = pytest.importorskip("MaterialX")
    files = exported("materialx", WOODS["round"], tmp_path, detail=False)
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(files[0]))
    assert document.getNodeDefs() == []
    assert {path.suffix for path in files} == {".mtlx", ".exr"}


# --- OSL and Blender -----------------------------------------------------------------------------------------------


def test_the_osl_shader_has_all_its_numbers(tmp_path: Path) -> None:
    source = exported("osl", WOODS["sector"], tmp_path)[0].read_text()
    assert re.findall(r"\bWP_\w+", source) == []
    assert source.count("{") == source.count("}")


@pytest.mark.slow
@needs_blender
@pytest.mark.parametrize("kind", ["osl", "blender"])
@pytest.mark.parametrize("name", list(EVERY))
def test_cycles_sees_the_wood(tmp_path: Path, name: str, kind: str) -> None:
    wood = EVERY[name]
    source = exported(kind, wood, tmp_path)[0]
    where = in_block(wood, 10_000)
    np.save(tmp_path / "points.npy", where * UPRIGHT)
    words = [str(tmp_path / "points.npy"), str(tmp_path / "out.npy"), "osl" if kind == "osl" else "script", str(source)]
    program = Path(__file__).with_name("blender_osl.py")
    assert BLENDER is not None
    done = subprocess.run([BLENDER, str(program), *words], capture_output=True, text=True, check=False)
    assert (tmp_path / "out.npy").exists(), done.stdout + done.stderr
    known, kept = wood.evaluate(where, detail=kind == "osl").rgb, held(wood, where)
    assert_same_colors(np.load(tmp_path / "out.npy")[kept], known[kept])


def test_the_blender_script_is_python_with_the_numbers_in_it(tmp_path: Path) -> None:
    script, *tables = exported("blender", WOODS["sector"], tmp_path)
    text = script.read_text()
    compile(text, str(script), "exec")
    assert "@ABOUT@" not in text
    assert {path.name for path in tables} == {
        f"wood_{kind}.exr" for kind in ("displacement", "age", "color", "lateness")
    }


# --- USD -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mesh", [None, "sample:ball"])
def test_the_usdz_is_valid_and_holds_the_piece(tmp_path: Path, mesh: str | None) -> None:
    usd = pytest.importorskip("pxr.Usd")
    pytest.importorskip("xatlas")
    from pxr import UsdGeom, UsdValidation

    path = exported("usd", WOODS["sector"], tmp_path, mesh=mesh)[0]
    stage = usd.Stage.Open(str(path))
    rules = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert [error.GetErrorAsString() for error in UsdValidation.ValidationContext(rules).Validate(stage)] == []
    piece = UsdGeom.Mesh(stage.GetPrimAtPath("/Wood/Piece"))
    points = np.array(piece.GetPointsAttr().Get())
    if mesh is None:
        extent = block_extent(WOODS["sector"])
        npt.assert_allclose(np.ptp(points, axis=0), extent.size, rtol=1e-5)
        assert UsdGeom.GetStageMetersPerUnit(stage) == pytest.approx(1e-3)
    else:
        assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
        npt.assert_allclose(np.linalg.norm(points, axis=1).max(), 1.0, rtol=1e-3)


# --- volumes -------------------------------------------------------------------------------------------------------


def test_slabs_together_are_the_block_whatever_their_thickness() -> None:
    wood = WOODS["sector"]
    cells = cells_of(wood, Options(cells=30))
    whole = wood.evaluate(cells.extent.points(cells.shape))
    for thick, upright in ((1, False), (8, True), (1000, False)):
        parts = list(slabs(wood, cells, True, thick, upright))
        color = np.concatenate([part.color for part in parts])
        npt.assert_allclose(color[::-1, ::-1] if upright else color, np.clip(whole.rgb, 0.0, None), atol=1e-6)
        assert max(len(part.color) for part in parts) <= thick


READ_VDB = """
import json, sys
import numpy as np, pyopenvdb as vdb
grids, about = vdb.readAll(sys.argv[1])
out = {"about": {k: str(v) for k, v in about.items()}}
for grid in grids:
    low, high = grid.evalActiveVoxelBoundingBox()
    shape = [b - a + 1 for a, b in zip(low, high)]
    color = grid.name == "color"
    array = np.zeros(shape + [3] if color else shape, np.float32)
    grid.copyToArray(array)
    np.save(sys.argv[2] + grid.name + ".npy", array)
    out[grid.name] = {"low": low, "count": grid.activeVoxelCount(), "class": grid.gridClass,
                      "ends": [grid.transform.indexToWorld(p) for p in (low, high)]}
print(json.dumps(out))
"""


@pytest.mark.parametrize("cells", [40, 150])
def test_openvdb_reads_the_grids_back(tmp_path: Path, cells: int) -> None:
    python = "/usr/bin/python3"
    if subprocess.run([python, "-c", "import pyopenvdb"], capture_output=True, check=False).returncode:
        pytest.skip("the system's Python has no pyopenvdb (on Debian: python3-openvdb)")
    wood = WOODS["sector"]
    (path,) = exported("vdb", wood, tmp_path, cells=cells)
    done = subprocess.run(
        [python, "-c", READ_VDB, str(path), f"{tmp_path}/"], capture_output=True, text=True, check=True
    )
    told = json.loads(done.stdout)
    shape = cells_of(wood, Options(cells=cells)).shape
    known = wood.evaluate(block_extent(wood).points(shape))
    for name, values in (("color", known.rgb), ("lateness", known.lateness)):
        assert told[name]["count"] == np.prod(shape)
        found = np.load(tmp_path / f"{name}.npy")
        # Index x, y, z with y up and z towards the camera, against z, y, x of the board.
        board = np.swapaxes(values, 0, 2)[:, ::-1, ::-1]
        npt.assert_allclose(found, np.maximum(board, 0.0), atol=1e-6)
    npt.assert_allclose(np.load(tmp_path / "extinction.npy"), 6.5 + 9.5 * np.load(tmp_path / "lateness.npy"), rtol=1e-5)
    extent, step = block_extent(wood), block_extent(wood).size / np.array(shape)
    corners = [extent.low * UPRIGHT + [0.5, -extent.size[1] / step[1] + 0.5, -extent.size[2] / step[2] + 0.5] * step]
    npt.assert_allclose(told["color"]["ends"][0], corners[0], atol=1e-4)
    npt.assert_allclose(np.subtract(*reversed(told["color"]["ends"])), (np.array(shape) - 1) * step, rtol=1e-6)
    assert told["about"]["unit"] == "mm"


def test_mitsuba_reads_its_grids_back(tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    before = mi.variant()
    mi.set_variant("scalar_rgb")
    try:
        wood = WOODS["sector"]
        paths = exported("mitsuba", wood, tmp_path)
        shape = cells_of(wood, Options(cells=40)).shape
        known = wood.evaluate(block_extent(wood).points(shape))
        grids = {path.stem.removeprefix("wood_"): np.array(mi.VolumeGrid(str(path))) for path in paths}
    finally:
        if before is not None:
            mi.set_variant(before)
    npt.assert_allclose(grids["color"], np.maximum(known.rgb, 0.0), atol=1e-6)
    npt.assert_allclose(grids["lateness"].reshape(shape[::-1]), known.lateness, atol=1e-6)
    (low,) = struct.iter_unpack("<3f", paths[0].read_bytes()[24:36])
    npt.assert_allclose(low, block_extent(wood).low, rtol=1e-6)


# --- pictures ------------------------------------------------------------------------------------------------------


def read_png(path: Path) -> np.ndarray:
    import cv2

    return np.asarray(cv2.imread(str(path))[..., ::-1], float)


def test_slices_are_the_wood_on_their_planes(tmp_path: Path) -> None:
    wood = WOODS["sector"]
    paths = exported("slices", wood, tmp_path, cells=60, slices=3)
    assert len(paths) == 9
    extent = block_extent(wood)
    middle = read_png(next(path for path in paths if path.name == "wood_z_2.png"))
    height, width = middle.shape[:2]
    x = extent.low[0] + (np.arange(width) + 0.5) / width * extent.size[0]
    y = extent.low[1] + (np.arange(height) + 0.5) / height * extent.size[1]
    grid = np.stack(np.broadcast_arrays(x[None], y[:, None], extent.centre[2]), axis=-1)
    npt.assert_allclose(middle, srgb(wood.evaluate(grid).rgb), atol=0.51)


def test_neighbours_meet_along_the_edges_of_the_net(tmp_path: Path) -> None:
    exported("faces", WOODS["plain"], tmp_path, cells=300)
    front, right, top, back, left, bottom = (
        read_png(tmp_path / f"wood_{name}.png") for name in ("front", "right", "top", "back", "left", "bottom")
    )
    for one, other in (
        (front[:, -1], right[:, 0]),
        (right[:, -1], back[:, 0]),
        (left[:, -1], front[:, 0]),
        (back[:, -1], left[:, 0]),
        (top[-1], front[0]),
        (front[-1], bottom[0]),
    ):
        # Half a px on either side of the edge: alike, but not the same.
        assert np.abs(one - other).mean() < 12.0
        assert np.abs(one - other[::-1]).mean() > np.abs(one - other).mean()
    net = read_png(tmp_path / "wood_net.png")
    assert net.shape[0] == front.shape[0] + 2 * top.shape[0]
    assert net.shape[1] == 2 * (front.shape[1] + left.shape[1])


def test_the_sheet_is_printed_at_its_true_size(tmp_path: Path) -> None:
    wood = WOODS["sector"]
    (path,) = exported("sheet", wood, tmp_path, dpi=100.0)
    (box,) = re.findall(rb"/MediaBox \[\s*0 0 ([\d.]+) ([\d.]+)\s*\]", path.read_bytes())
    width, height = (float(part) / 72.0 * 25.4 for part in box)
    npt.assert_allclose([width - 20.0, height - 30.0], block_extent(wood).size[:2], atol=0.05)
    with pytest.raises(UsageError, match="give --pixel-size"):
        exported("sheet", WOODS["round"], tmp_path)
    with pytest.raises(UsageError, match="mm deep"):
        exported("sheet", wood, tmp_path, depth_mm=500.0)
    exported("sheet", WOODS["round"], tmp_path, pixel_size_mm=0.1, dpi=50.0)


def test_the_liu_parameters_open_as_a_model(tmp_path: Path) -> None:
    from woodfit.liu import LiuModel

    wood = WOODS["sector"]
    (path,) = exported("liu", wood, tmp_path)
    model = LiuModel.from_json(path.read_text())
    where = in_block(wood, 500)
    assert np.corrcoef(model.evaluate(where).ring_age, wood.evaluate(where).ring_age)[0, 1] > 0.9


# --- the command ---------------------------------------------------------------------------------------------------


def test_every_exporter_has_a_module_and_help() -> None:
    for exporter in EXPORTERS:
        assert exporter.help
        assert (Path(__file__).parent.parent / "pipeline" / "export" / f"{exporter.module}.py").exists()
    assert exporters_named("all") == list(EXPORTERS)
    assert [one.name for one in exporters_named("osl, liu,osl")] == ["osl", "liu"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "materialy"], "did you mean 'materialx'"),
        (["--to", ""], "names nothing"),
        (["--to", "vdb", "--cells", "3"], "expected 8 to 2048"),
    ],
)
def test_wrong_words_are_told(tmp_path: Path, words: list[str], said: str) -> None:
    texture = tmp_path / "texture.zarr.zip"
    WOODS["plain"].save(texture)
    done = CliRunner().invoke(app, ["export", "--texture", str(texture), "--out", str(tmp_path / "out"), *words])
    assert done.exit_code == 2
    assert said in done.output


def test_an_export_that_fails_stops_no_other(tmp_path: Path) -> None:
    texture = tmp_path / "texture.zarr.zip"
    WOODS["plain"].save(texture)
    words = ["--to", "sheet,liu", "--out", str(tmp_path / "out"), "--name", "pine"]
    done = CliRunner().invoke(app, ["export", "--texture", str(texture), *words])
    assert done.exit_code == 1
    assert "give --pixel-size" in done.output
    assert (tmp_path / "out" / "liu" / "pine_liu.json").exists()


def test_a_missing_extra_is_named_with_the_command_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    for name in ("MaterialX", "pxr", "pxr.Usd", "trimesh", "mitsuba"):
        monkeypatch.setitem(sys.modules, name, None)
    problems = export_all(WOODS["plain"], exporters_named("materialx,usd,liu"), tmp_path, Options())[1]
    assert len(problems) == 2
    assert all("pip install 'woodpipe[export]'" in problem for problem in problems)
    texture = tmp_path / "texture.zarr.zip"
    WOODS["plain"].save(texture)
    body = tmp_path / "body.obj"
    body.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for words, extra in ((["carve", str(body)], "carve"), (["render", "block"], "render")):
        done = CliRunner().invoke(app, [*words, "--texture", str(texture)])
        assert done.exit_code == 2
        assert f"pip install 'woodpipe[{extra}]'" in done.output
