"""Renders: the renderer sees the wood that Python sees, media keep their light, bodies are what they should be."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
from color_checks import assert_same_colors
from typer.testing import CliRunner
from wood_samples import WOODS, in_block, old_wood

from pipeline.cli import app
from pipeline.problems import UsageError
from pipeline.render import solids, variant
from pipeline.render.frame import Frame
from pipeline.render.translucent import sheet_of
from woodfit.block_extent import Extent, block_extent
from woodfit.volume_optics import extinction_per_mm, scattering_albedo, surface_albedo

pytest.importorskip("mitsuba")


@pytest.fixture(scope="module")
def llvm() -> Any:
    chosen = variant.choose_variant()
    if not chosen.vectorised:
        pytest.skip(chosen.said)
    return variant.start(chosen)


@pytest.mark.parametrize("name", [*WOODS, "old"])
def test_the_renderer_evaluates_the_color_that_the_texture_has(llvm: Any, name: str) -> None:
    from pipeline.render.drjit_wood import DrjitWood

    wood = old_wood() if name == "old" else WOODS[name]
    where = in_block(wood, 10_000)
    known = wood.evaluate(where)
    held = known.ring_age > 61 if name == "old" else np.ones(len(where), bool)
    mi = llvm
    point = mi.Point3f(*(mi.Float(np.ascontiguousarray(axis, np.float32)) for axis in where.T))
    rgb, late, age = DrjitWood(mi, wood)(point)
    found = np.stack([np.array(channel) for channel in rgb], axis=-1)
    assert_same_colors(found[held], known.rgb[held], 0.3, 1.5)
    npt.assert_allclose(np.array(age)[held], known.ring_age[held], atol=5e-3)
    assert np.percentile(np.abs(np.array(late) - known.lateness)[held], 99) < 0.02


def test_a_white_sheet_in_a_white_room_is_white(llvm: Any, tmp_path: Path) -> None:
    from pipeline.render.materials import mesh_of

    mi = llvm
    vertices, faces = solids.box(Extent(np.array([-1.0, -1.0, -0.1]), np.array([1.0, 1.0, 0.1])))
    grid = np.random.default_rng(0).uniform(5.0, 40.0, (4, 8, 8, 1)).astype(np.float32)
    volume = {
        "type": "gridvolume",
        "grid": mi.VolumeGrid(grid),
        "to_world": mi.ScalarTransform4f().translate([-1, -1, -0.1]).scale([2, 2, 0.2]),
    }
    interior = {"type": "heterogeneous", "sigma_t": volume, "albedo": {"type": "constvolume", "value": 1.0}}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 10_000},
            "sensor": {
                "type": "orthographic",
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 3], [0, 0, 0], [0, 1, 0]).scale([0.8, 0.8, 1]),
                "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 64},
            },
            "room": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}},
            "sheet": mesh_of(mi, tmp_path, vertices, faces, False, interior=interior, bsdf={"type": "null"}),
        }
    )
    picture = np.array(mi.render(scene))[..., :3]
    assert picture.mean() == pytest.approx(1.0, abs=0.01)


def test_the_front_is_the_photographed_face(llvm: Any) -> None:
    from pipeline.render import render_preset
    from pipeline.report.pictures import srgb_bytes

    wood = WOODS["plain"]
    picture = render_preset("front", wood, size=(60, 40), spp=256, denoise=False).astype(float)
    x, y = np.meshgrid((np.arange(600) + 0.5) / 2.0, (np.arange(400) + 0.5) / 2.0)
    fine = wood.evaluate(np.stack([x, y, np.zeros_like(x)], axis=-1)).rgb
    known = srgb_bytes(fine.reshape(40, 10, 60, 10, 3).mean(axis=(1, 3))).astype(float)
    assert np.abs(picture - known).mean() < 4.0


@pytest.mark.parametrize("preset", ["block", "carved", "false-color", "veneer", "lampshade"])
def test_every_preset_draws_something_of_the_asked_size(llvm: Any, preset: str) -> None:
    from pipeline.render import render_preset

    said: list[str] = []
    picture = render_preset(preset, WOODS["plain"], size=(32, 24), spp=2, tell=said.append, denoise=False)
    assert picture.shape[1] >= 32
    assert picture.shape[0] >= 24
    assert picture.std() > 2.0
    assert any("taken as" in line for line in said) == (preset in ("veneer", "lampshade")), (
        "wood in px has no thickness"
    )


@pytest.mark.slow
def test_the_scalar_variant_draws_the_same_block(llvm: Any) -> None:
    program = (
        "import sys; sys.path[:0] = ['tests']; import numpy as np\n"
        "from wood_samples import WOODS; from pipeline.render import render_preset\n"
        "np.save(sys.argv[2], render_preset('block', WOODS['plain'], (64, 64), 64, variant=sys.argv[1], denoise=False))"
    )
    pictures = []
    for name in ("llvm", "scalar"):
        out = Path(f"/tmp/woodpipe_{name}.npy")
        subprocess.run([sys.executable, "-c", program, name, str(out)], check=True, cwd=Path(__file__).parent.parent)
        pictures.append(np.load(out).astype(float))
        out.unlink()
    # The grid blurs rings of few cells, so patches are compared, not pixels.
    patches = [picture.reshape(8, 8, 8, 8, 3).mean(axis=(1, 3)) for picture in pictures]
    assert np.abs(patches[0] - patches[1]).mean() < 3.0


def test_a_library_that_does_not_work_gives_scalar_and_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "libLLVM-99.so"
    broken.write_bytes(b"no library")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(broken))
    chosen = variant.choose_variant()
    assert chosen.name == "scalar_rgb"
    assert str(broken) in chosen.said
    with pytest.raises(UsageError, match="libllvm19"):
        variant.choose_variant("llvm")


@pytest.mark.parametrize(
    "body",
    [
        solids.box(Extent(np.zeros(3), np.array([1.0, 2.0, 3.0]))),
        solids.notched(Extent(np.zeros(3), np.array([4.0, 5.0, 2.0]))),
        solids.shell(np.array([[2.0, 0.0], [2.2, 1.0], [1.5, 3.0]]), 0.1, 64),
    ],
)
def test_bodies_are_closed_and_turned_outwards(body: solids.Surface) -> None:
    vertices, faces = body
    assert solids.volume(vertices, faces) > 0.0
    _, place = np.unique(np.round(vertices, 9), axis=0, return_inverse=True)
    edges = place.ravel()[faces][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forth = {tuple(edge) for edge in edges.tolist()}
    assert forth == {(b, a) for a, b in forth}, "every edge is walked once each way"


def test_the_notch_takes_the_corner_at_the_front_above_and_to_the_right() -> None:
    whole = Extent(np.zeros(3), np.array([4.0, 5.0, 2.0]))
    vertices, faces = solids.notched(whole, (0.5, 0.4, 0.5))
    assert solids.volume(vertices, faces) == pytest.approx(40.0 - 2.0 * 1.6 * 1.0)
    assert not any((vertex == [4.0, 0.0, 0.0]).all() for vertex in vertices)


def test_dividing_a_surface_keeps_its_volume_and_shortens_its_edges() -> None:
    vertices, faces = solids.box(Extent(np.zeros(3), np.ones(3)))
    finer, more = solids.subdivided(vertices, faces, 0.3, 10**6)
    corners = finer[more]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max() <= 0.3
    assert solids.volume(finer, more) == pytest.approx(1.0)
    assert len(solids.subdivided(vertices, faces, 1e-6, 1000)[1]) <= 1000


def test_the_frame_of_the_scene_leads_there_and_back() -> None:
    extent = Extent(np.array([1.0, 2.0, 3.0]), np.array([5.0, 4.0, 9.0]))
    frame = Frame.around(extent)
    points = np.random.default_rng(0).normal(size=(20, 3))
    npt.assert_allclose(frame.board(frame.scene(points)), points, atol=1e-12)
    corners = frame.scene(extent.corners())
    assert np.ptp(corners, axis=0).max() == pytest.approx(2.0)
    npt.assert_allclose(frame.scene(extent.centre), 0.0, atol=1e-12)


def test_the_block_behind_a_single_face_is_as_deep_as_it_should_be() -> None:
    extent = block_extent(WOODS["round"])
    npt.assert_allclose(extent.low, [-0.5, -0.5, 0.0])
    npt.assert_allclose(extent.size, [301.0, 201.0, 0.4 * 201.0])
    sheet = sheet_of(WOODS["sector"], 1.0)
    assert sheet.size[2] == pytest.approx(1.8)


@pytest.mark.parametrize("index", [1.0, 1.3, 1.5, 1.55])
def test_the_albedo_of_the_medium_and_of_its_surface_lead_to_each_other(index: float) -> None:
    # Under a refracting boundary a bright surface needs an albedo that float32 cannot tell from 1.
    surface = np.linspace(0.01, 0.95 if index == 1.0 else 0.5, 200)
    scattering = scattering_albedo(surface, index)
    assert ((scattering > 0.0) & (scattering < 1.0)).all()
    assert (np.diff(scattering) > 0.0).all()
    npt.assert_allclose(surface_albedo(scattering, index), surface, atol=2e-3)


def test_latewood_is_the_denser() -> None:
    npt.assert_allclose(extinction_per_mm(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])), [6.5, 6.5, 11.25, 16.0, 16.0])


def test_wrong_words_are_told(tmp_path: Path) -> None:
    texture = tmp_path / "texture.zarr.zip"
    WOODS["plain"].save(texture)
    for words, said in (
        (["blok"], "did you mean 'block'"),
        (["block", "--size", "big"], "expected WxH"),
        (["block", "--out", "a.jpg"], "ends in .png"),
        (["block", "--variant", "cuda"], "expected auto, llvm or scalar"),
    ):
        done = CliRunner().invoke(app, ["render", *words, "--texture", str(texture)])
        assert done.exit_code == 2, done.output
        assert said in done.output
