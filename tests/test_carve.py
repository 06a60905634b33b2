"""Carving: the piece lies in the wood, its maps are the wood's, and no chart shows its border."""

import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from color_checks import assert_same_encoded, srgb
from typer.testing import CliRunner
from wood_samples import WOODS

from pipeline.carve.atlas import atlas_of
from pipeline.carve.carving import Carved, Wish, carve, parse_size
from pipeline.carve.mesh_files import Mesh, read_mesh
from pipeline.carve.sample_meshes import sample_mesh
from pipeline.carve.support import spread_points
from pipeline.cli import app
from pipeline.problems import UsageError
from pipeline.render.solids import volume
from woodfit.baking import rasterize, sample_map
from woodfit.block_extent import block_extent
from woodfit.mesh_normals import corner_normals
from woodfit.placement import place

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("xatlas")


def mesh_of(name: str, fineness: int = 40) -> Mesh:
    return Mesh(*sample_mesh(name, fineness), None, name)


@pytest.mark.parametrize("name", ["pawn", "bowl", "knot"])
@pytest.mark.parametrize("wood", list(WOODS))
def test_a_mesh_is_turned_never_mirrored_and_fills_the_block(name: str, wood: str) -> None:
    texture, mesh = WOODS[wood], mesh_of(name, 24)
    placed = place(texture, mesh.vertices)
    npt.assert_allclose(placed.rotation @ placed.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(placed.rotation) == pytest.approx(1.0)
    points, block = placed.apply(mesh.vertices), block_extent(texture)
    assert (points >= block.low - 1e-9).all()
    assert (points <= block.high + 1e-9).all()
    assert (np.ptp(points, axis=0) / block.size).max() > 0.95
    npt.assert_allclose(placed.back(points), mesh.vertices, atol=1e-9)


def test_the_longest_side_of_a_piece_lies_along_the_grain() -> None:
    texture, mesh = WOODS["round"], mesh_of("pawn", 24)
    sides = np.ptp(place(texture, mesh.vertices).apply(mesh.vertices), axis=0)
    assert int(np.argmax(sides)) == int(np.argmax(np.abs(texture.board_to_tree[2, :3])))


def test_a_given_place_turn_and_scale_are_taken() -> None:
    texture, mesh = WOODS["sector"], mesh_of("pawn", 24)
    placed = place(texture, mesh.vertices, (10.0, 20.0, 5.0), (0.0, 0.0, 90.0), 3.0)
    points = placed.apply(mesh.vertices)
    npt.assert_allclose(0.5 * (points.min(axis=0) + points.max(axis=0)), [10.0, 20.0, 5.0])
    npt.assert_allclose(np.ptp(points, axis=0), 3.0 * np.ptp(mesh.vertices, axis=0)[[1, 0, 2]])
    # Standing upright, y goes up: towards the board's -y; a quarter turn about z takes that to its x.
    npt.assert_allclose(placed.rotation @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-12)


def test_texels_show_the_points_of_their_triangles() -> None:
    corners = np.array([[[0.0, 0, 0], [4, 0, 0], [0, 4, 0]], [[4.0, 0, 0], [4, 4, 0], [0, 4, 0]]])
    texels = rasterize(corners[..., :2] / 4.0, 16)
    assert (texels.triangle >= 0).all()
    points, shown = texels.points(slice(0, 16), corners)
    assert shown.all()
    middles = (np.arange(16) + 0.5) / 4.0
    npt.assert_allclose(points.reshape(16, 16, 3)[..., 0], np.broadcast_to(middles, (16, 16)), atol=1e-6)
    npt.assert_allclose(points.reshape(16, 16, 3)[..., 1], np.broadcast_to(middles[::-1, None], (16, 16)), atol=1e-6)


_ALONG = (0.25, 0.5, 0.75)


def differences_at_borders(made: Carved) -> np.ndarray:
    """Differences of the color along edges whose two faces lie apart in the atlas, of 255."""
    mesh, uv = made.mesh, made.atlas.uv
    _, at = np.unique(mesh.vertices, axis=0, return_inverse=True)
    at = at.ravel()[mesh.faces]
    ends = at[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges, owner, which = np.sort(ends, axis=1), np.repeat(np.arange(len(at)), 3), np.tile(np.arange(3), len(at))
    order = np.lexsort(edges.T)
    edges, owner, which = edges[order], owner[order], which[order]
    pairs = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    ends_uv = [uv[owner[one][:, None], np.stack([which[one], (which[one] + 1) % 3], -1)] for one in (pairs, pairs + 1)]
    # The two faces of an edge walk it in opposite directions.
    first, second = ends_uv[0], ends_uv[1][:, ::-1]
    apart = np.abs(first - second).max(axis=(1, 2)) > 1e-6
    colors = [
        np.concatenate(
            [sample_map(made.maps.color.astype(float), (1 - t) * side[apart, 0] + t * side[apart, 1]) for t in _ALONG]
        )
        for side in (first, second)
    ]
    return np.abs(colors[0] - colors[1]).mean(axis=1)


@pytest.mark.parametrize(("name", "size"), [("pawn", 1024), pytest.param("knot", 4096, marks=pytest.mark.slow)])
def test_the_baked_color_is_that_of_the_wood_and_no_chart_shows(name: str, size: int) -> None:
    wood = WOODS["round"]
    made = carve(mesh_of(name), wood, Wish(size))
    corners = made.placement.apply(made.mesh.vertices)[made.mesh.faces]
    points, face, weight = spread_points(corners, 10_000, np.random.default_rng(3))
    uv = np.einsum("kc,kcd->kd", weight, made.atlas.uv[face])
    assert_same_encoded(sample_map(made.maps.color.astype(float), uv), srgb(wood.evaluate(points).rgb))
    off = differences_at_borders(made)
    assert len(off) > 20
    # Where an abrupt ring boundary crosses a border within a texel, the two sides sample it differently.
    assert np.percentile(off, 99) <= 3.0


def test_roughness_falls_and_height_rises_with_lateness() -> None:
    wood = WOODS["plain"]
    made = carve(mesh_of("ball"), wood, Wish(1024))
    corners = made.placement.apply(made.mesh.vertices)[made.mesh.faces]
    points, face, weight = spread_points(corners, 2_000, np.random.default_rng(4))
    uv = np.einsum("kc,kcd->kd", weight, made.atlas.uv[face])
    late = wood.evaluate(points).lateness
    rough = sample_map(made.maps.roughness[..., None].astype(float), uv)[:, 0]
    high = sample_map(made.maps.height[..., None].astype(float), uv)[:, 0]
    assert np.corrcoef(rough, late)[0, 1] < -0.97
    assert np.corrcoef(high, late)[0, 1] > 0.97
    steep = np.abs(made.maps.normal.astype(float)[..., :2] - 127.5)
    assert steep.max() > 10.0, "ring boundaries are edges of the relief"
    assert np.median(steep) < 8.0


def test_own_coordinates_are_kept_unless_they_overlap_or_leave_the_atlas() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), vertices[:, :2] * 0.8 + 0.1
    assert atlas_of(Mesh(vertices, faces, uv, "quad"), 256).own
    for spoilt, said in ((uv * 3.0, "leave"), (np.where(uv > 0.5, uv, 0.5) * 0 + uv[[0, 1, 2, 1]], "overlap")):
        atlas = atlas_of(Mesh(vertices, faces, spoilt, "quad"), 256)
        assert not atlas.own
        assert said in atlas.note


def test_normals_are_smooth_on_a_ball_and_sharp_on_a_cube() -> None:
    vertices, faces = sample_mesh("ball", 32)
    normals = corner_normals(vertices, faces)
    towards = vertices[faces] / np.linalg.norm(vertices[faces], axis=-1, keepdims=True)
    assert np.einsum("fcd,fcd->fc", normals, towards).min() > 0.99
    cube = trimesh.creation.box()
    sharp = corner_normals(np.asarray(cube.vertices), np.asarray(cube.faces))
    npt.assert_allclose(sharp, np.repeat(cube.face_normals[:, None], 3, axis=1), atol=1e-9)


def test_the_command_writes_a_glb_that_opens_with_its_maps_and_a_report(tmp_path: Path) -> None:
    texture, out = tmp_path / "texture.zarr.zip", tmp_path / "made" / "thing.glb"
    WOODS["sector"].save(texture)
    body = tmp_path / "body.ply"
    trimesh.Trimesh(*sample_mesh("bowl", 24), process=False).export(body)
    done = CliRunner().invoke(app, ["carve", str(body), "--texture", str(texture), "--out", str(out), "--size", "2k"])
    assert done.exit_code == 0, done.output
    assert "% of the surface" in done.output
    scene = trimesh.load_scene(out)
    (mesh,) = scene.geometry.values()
    npt.assert_allclose(np.sort(mesh.bounds, axis=0), np.sort(read_mesh(body).vertices, axis=0)[[0, -1]], atol=1e-5)
    material = mesh.visual.material
    assert material.baseColorTexture.size == (2048, 2048)
    packed = np.asarray(material.metallicRoughnessTexture)
    assert packed[..., 2].max() == 0, "wood is no metal"
    assert volume(np.asarray(mesh.vertices), np.asarray(mesh.faces)) > 0.0
    # What a viewer makes of the file is the wood: trimesh counts v upwards, as the maps are looked up here.
    assert isinstance(mesh.visual.uv, np.ndarray)
    wood, mesh_here = WOODS["sector"], read_mesh(body)
    placed = place(wood, mesh_here.vertices)
    corners = np.asarray(mesh.vertices)[mesh.faces]
    points, face, weight = spread_points(corners, 2_000, np.random.default_rng(5))
    uv = np.einsum("kc,kcd->kd", weight, np.asarray(mesh.visual.uv)[mesh.faces[face]])
    found = sample_map(np.asarray(material.baseColorTexture.convert("RGB"), float), uv)
    assert_same_encoded(found, srgb(wood.evaluate(placed.apply(points)).rgb))
    report = json.loads(out.with_suffix(".json").read_text())
    outside = report["outside_of_what_the_photograph_supports"]
    assert 0.0 <= outside["area_share"] <= 1.0
    names = {path.name for path in out.parent.iterdir()}
    assert {"thing_base_color.png", "thing_displacement.png", "thing_normal.png", "thing_placement.png"} <= names


def test_parts_far_from_the_photograph_are_told() -> None:
    wood, mesh = WOODS["round"], mesh_of("ball", 16)
    near = carve(mesh, wood, Wish(1024, position=(150.0, 100.0, 5.0), scale=5.0)).support
    far = carve(mesh, wood, Wish(1024, position=(150.0, 100.0, 900.0), scale=5.0)).support
    assert near.area_share == 0.0
    assert far.area_share == 1.0
    assert far.furthest == pytest.approx(905.0, abs=2.0)


def test_wrong_words_are_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="expected 1k, 2k, 4k, 8k"):
        parse_size("3k")
    texture = tmp_path / "texture.zarr.zip"
    texture.write_text("no wood")
    for words, said in (
        (["--position", "1,2"], "expected three numbers"),
        (["--out", str(tmp_path / "a.obj")], "ends in .glb"),
        ([], "not a readable solid texture"),
        (["--scale", "-1"], ""),
    ):
        done = CliRunner().invoke(app, ["carve", "sample:ball", "--texture", str(texture), *words])
        assert done.exit_code == 2
        assert said in done.output
