"""The image loss beside the phase loss: right gradients, the paper's verdict, light in a volume, and the picture."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import numpy.testing as npt
import pytest
import torch
from kernel_scenes import Array
from typer.testing import CliRunner

from pipeline.ablation import (
    FACE_FOLD,
    FOLD_OVER,
    IMAGE_ERROR,
    PHASE_ERROR,
    ROUGHNESS,
    Face,
    Variant,
    fit_variants,
    stored_results,
)
from pipeline.cli import app
from pipeline.layout import Layout
from pipeline.plan import Selection
from pipeline.project import Project
from woodfit.color_strip import ColorStrip, color_at
from woodfit.cylinder_grid import CylinderGrid, grid_for, sample
from woodfit.displacement import Observations, age_of_radius
from woodfit.image_loss import (
    FaceField,
    FacePixels,
    carried_inwards,
    descend_phase,
    fit_image,
    folded_share,
    image_loss,
    phase_loss,
    ring_age,
    roughness,
    strip_color,
)
from woodfit.synthetic_scenes import encode_png, scene
from woodfit.volume_view import Medium, View, cut_corner, draw_volume, extinction, light_reaching

OPEN = CylinderGrid(np.linspace(60.0, 160.0, 6), np.linspace(-0.6, 0.9, 5), np.linspace(-50.0, 70.0, 4), wraps=False)
ROUND = CylinderGrid(
    np.linspace(5.0, 105.0, 6), -np.pi + np.arange(8) * np.pi / 4, np.linspace(-50.0, 70.0, 4), wraps=True
)
both = pytest.mark.parametrize("grid", [OPEN, ROUND], ids=["open", "round"])
TABLE = np.cumsum([0.0, *(14.0 * np.exp(np.random.default_rng(11).normal(0.0, 0.15, 16)))])
SAMPLES = 8


def places(grid: CylinderGrid, count: int = 40) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(5)
    r, a, h = (rng.uniform(axis[0], axis[-1], count) for axis in (grid.radius, grid.azimuth, grid.height))
    return r, a, h


def random_strip() -> Array:
    return np.random.default_rng(8).uniform(0.1, 0.9, (len(TABLE) * SAMPLES, 3))


# --- the differentiable face is the real one --------------------------------------------------------------------------


@both
def test_the_face_is_interpolated_as_the_texture_is(grid: CylinderGrid) -> None:
    field, where = np.random.default_rng(1).normal(0.0, 3.0, grid.shape).astype(np.float32), places(grid, 500)
    found = FaceField(grid, *where)(torch.from_numpy(field.reshape(-1)))
    npt.assert_allclose(found.numpy(), sample(grid, field, *where)[0], atol=1e-4)


def test_age_and_color_are_those_of_the_texture() -> None:
    radius, strip = np.linspace(-5.0, TABLE[-1] + 60.0, 700), random_strip()
    age = ring_age(torch.from_numpy(radius), TABLE)
    npt.assert_allclose(age.numpy(), age_of_radius(radius, TABLE)[0], atol=1e-12)
    known = ColorStrip(np.zeros(0), strip.astype(np.float32), np.zeros(0, np.float32), np.zeros(0, np.float32))
    rgb = strip_color(torch.from_numpy(strip), age, SAMPLES)
    npt.assert_allclose(rgb.numpy(), color_at(known, age.numpy(), SAMPLES), atol=1e-5)


@both
def test_gradients_of_both_losses_are_those_of_finite_differences(grid: CylinderGrid) -> None:
    rng = np.random.default_rng(2)
    on_face = FaceField(grid, *places(grid))
    field = torch.from_numpy(rng.normal(0.0, 2.0, int(np.prod(grid.shape)))).requires_grad_()
    strip = torch.from_numpy(random_strip()).requires_grad_()
    rgb, weight = torch.from_numpy(rng.uniform(0.0, 1.0, (40, 3))), torch.from_numpy(rng.dirichlet(np.ones(40)))
    phase = torch.from_numpy(rng.uniform(-np.pi, np.pi, 40))
    assert torch.autograd.gradcheck(
        lambda f, s: image_loss(f, s, on_face, rgb, weight, TABLE, SAMPLES), (field, strip), atol=1e-6
    )
    assert torch.autograd.gradcheck(lambda f: phase_loss(f, on_face, phase, weight, TABLE), (field,), atol=1e-6)
    loss = image_loss(field, strip, on_face, rgb, weight, TABLE, SAMPLES)
    for part in torch.autograd.grad(loss, (field, strip)):
        assert float(part.abs().max()) > 1e-6


def test_whole_turns_of_the_phase_cost_nothing() -> None:
    on_face, weight = FaceField(OPEN, *places(OPEN)), torch.full((40,), 1.0 / 40, dtype=torch.float64)
    field = torch.zeros(int(np.prod(OPEN.shape)), dtype=torch.float64)
    phase = 2.0 * np.pi * ring_age(on_face.radius, TABLE)
    turns = torch.from_numpy(np.random.default_rng(4).integers(-3, 4, 40))
    assert float(phase_loss(field, on_face, phase + 2.0 * np.pi * turns, weight, TABLE)) == pytest.approx(
        0.0, abs=1e-12
    )
    assert float(phase_loss(field, on_face, phase + np.pi, weight, TABLE)) == pytest.approx(2.0)


# --- descent ----------------------------------------------------------------------------------------------------------


def flat_sawn() -> tuple[CylinderGrid, tuple[Array, Array, Array], Array]:
    """Grid, places and true ring age of a face 60 px above the pith."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-90.0, 91.0, 2.0), np.arange(0.0, 81.0, 2.0)))
    r, a = np.hypot(x, 60.0), np.arctan2(x, 60.0)
    age, _ = age_of_radius(r + 2.5 * np.cos(2.0 * a + 0.4) * np.sin(r / 35.0 + y / 60.0), TABLE)
    return grid_for(r, a, y, 8.0, 20_000), (r, a, y), age


def test_descent_on_the_phase_finds_the_rings() -> None:
    grid, where, age = flat_sawn()
    pixels = Observations(*where, 2.0 * np.pi * age, np.ones(len(age)))
    found = descend_phase(grid, np.zeros(grid.shape), pixels, TABLE, 200, 0.02)
    after = age_of_radius(where[0] + sample(grid, found.displacement, *where)[0], TABLE)[0]
    before = age_of_radius(where[0], TABLE)[0]
    assert np.percentile(np.abs(before - age), 90) > 0.1
    assert np.percentile(np.abs(after - age), 90) < 0.02
    assert found.loss[-1] < 0.02 * found.loss[0]


def test_descent_on_the_image_lowers_its_error_and_leaves_its_inputs_alone() -> None:
    grid, where, age = flat_sawn()
    strip, start = random_strip().astype(np.float32), np.zeros(grid.shape)
    known = ColorStrip(np.zeros(0), strip, np.zeros(0, np.float32), np.zeros(0, np.float32))
    pixels = FacePixels(*where, color_at(known, age, SAMPLES), np.ones(len(age)))
    grey = np.full_like(strip, 0.5)
    fit = fit_image(grid, start, pixels, TABLE, grey, SAMPLES, 60)
    assert fit.loss[-1] < 0.5 * fit.loss[0]
    assert fit.displacement.shape == grid.shape
    assert (fit.rgb >= 0.0).all()
    npt.assert_array_equal(grey, 0.5)
    npt.assert_array_equal(start, 0.0)


@both
def test_what_the_face_does_not_know_goes_round_the_stem(grid: CylinderGrid) -> None:
    change = np.random.default_rng(3).normal(size=grid.shape)
    touched = np.zeros(grid.shape, bool)
    # Each growth layer is seen at one azimuth of every height but the last.
    column = np.random.default_rng(4).integers(0, grid.shape[1], grid.shape[:2][0])
    touched[np.arange(grid.shape[0]), column, :-1] = True
    carried = carried_inwards(grid, change, touched)
    npt.assert_array_equal(carried[touched], change[touched])
    for layer, seen in enumerate(column):
        npt.assert_array_equal(
            carried[layer, :, :-1], np.broadcast_to(change[layer, seen, :-1], carried[layer, :, :-1].shape)
        )
    npt.assert_array_equal(carried_inwards(grid, change, np.zeros_like(touched)), 0.0)


def test_the_nearest_azimuth_may_lie_beyond_the_cut_of_the_circle() -> None:
    touched = np.zeros(ROUND.shape, bool)
    touched[:, [3, 7]] = True
    change = np.broadcast_to(np.arange(8.0)[:, None], ROUND.shape)
    # 1 lies two steps from 3 and two from 7, which is past the cut.
    carried = carried_inwards(ROUND, change, touched)
    npt.assert_array_equal(carried[:, [0, 2, 3, 4, 6, 7], 0], np.broadcast_to([7, 3, 3, 3, 7, 7], (6, 6)))


# --- figures ----------------------------------------------------------------------------------------------------------


def test_the_folded_share_is_that_of_the_cells_that_fold() -> None:
    field = np.zeros(OPEN.shape)
    # Of five cells along the radius one falls by more than its width, one by less.
    field[2:] -= 21.0
    field[4:] -= 19.0
    assert folded_share(OPEN, field, *places(OPEN, 40_000)) == pytest.approx(0.2, abs=0.01)
    assert folded_share(OPEN, np.zeros(OPEN.shape), *places(OPEN, 1000)) == 0.0


def test_roughness_sees_jitter_and_no_slope() -> None:
    y, x = np.mgrid[:80, :90].astype(float)
    valid = (x > 10) | (y > 10)
    jitter = np.random.default_rng(1).normal(0.0, 0.5, x.shape)
    inner = np.zeros_like(valid)
    inner[25:-25, 25:-25] = True
    assert roughness(np.full_like(x, 7.0), valid, 6.0) < 1e-9
    assert roughness(jitter, valid, 6.0) == pytest.approx(0.5, rel=0.05)
    assert roughness(3.0 * jitter, valid, 6.0) == pytest.approx(3.0 * roughness(jitter, valid, 6.0))
    # Straight slopes are their own mean, away from the edge of the wood.
    slope = 0.2 * x + 0.1 * y
    assert roughness(slope + jitter, valid, 3.0) < 1.1 * roughness(jitter, valid, 3.0)


# --- light in a volume ------------------------------------------------------------------------------------------------

STRAIGHT = View(
    yaw_deg=0.0, pitch_deg=0.0, light=(0.0, 0.0, 1.0), strength=1.0, ambient=0.0, background=(1.0, 1.0, 1.0)
)
BLACK = Medium(albedo=(0.0, 0.0, 0.0))


def middle(picture: Array) -> Array:
    return picture[picture.shape[0] // 2, picture.shape[1] // 2]


def test_a_block_without_scattering_dims_what_lies_behind_as_beer_and_lambert_say() -> None:
    sigma = np.full((24, 60, 60), 0.05, np.float32)
    npt.assert_allclose(middle(draw_volume(sigma, 120, BLACK, STRAIGHT)), np.exp(-24 * 0.05), rtol=1e-4)
    # Seen at an angle the way through a thin plate is longer.
    aslant = View(yaw_deg=35.0, pitch_deg=0.0, background=(1.0, 1.0, 1.0))
    plate = np.full((6, 80, 80), 0.1, np.float32)
    npt.assert_allclose(
        middle(draw_volume(plate, 200, BLACK, aslant)), np.exp(-0.6 / np.cos(np.radians(35.0))), rtol=1e-3
    )


def test_single_scattering_of_a_thick_block_lit_from_the_front_is_half_its_albedo() -> None:
    # The integral of s exp(-2 s t) over the depth.
    sigma = np.full((60, 40, 40), 0.1, np.float32)
    expected = 0.5 * (1.0 - np.exp(-2 * 6.0)) * np.array(Medium().albedo) + np.exp(-6.0)
    npt.assert_allclose(middle(draw_volume(sigma, 100, Medium(), STRAIGHT)), expected, rtol=2e-3)


def test_light_falls_off_along_its_own_way() -> None:
    sigma = np.zeros((20, 50, 50), np.float32)
    sigma[5, 20:30, 20:30] = 2.0
    reaching = light_reaching(sigma, (0.0, 0.5, 1.0))
    assert (reaching[:5] == 1.0).all()
    shadow = reaching[15] < 0.5
    rows, columns = np.nonzero(shadow)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (25, 34, 20, 29)
    # The way through a slanted layer is longer than through one met head on.
    assert float(np.log(reaching[15, 30, 25])) == pytest.approx(-2.0 * np.sqrt(1.25), rel=1e-4)


def test_latewood_is_dense_and_the_cut_corner_empty() -> None:
    lateness = np.zeros((10, 20, 40))
    lateness[:, :, ::4] = 0.95
    sigma = extinction(lateness, Medium())
    npt.assert_allclose(sigma[0, 0, :4], np.array([15.0, 0.5, 0.5, 0.5]) * 10 / 40, rtol=1e-6)
    cut = cut_corner(sigma, 0.5)
    assert (cut[:5, :10, 20:] == 0.0).all()
    removed = np.zeros(sigma.shape, bool)
    removed[:5, :10, 20:] = True
    npt.assert_array_equal(cut[~removed], sigma[~removed])


def test_finer_voxels_give_the_same_picture() -> None:
    z, y, x = np.mgrid[:16, :30, :40]
    coarse = np.asarray(0.9 + 0.1 * ((x // 4 + y // 10 + z // 8) % 2))
    fine = coarse.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    thin = Medium(late=1.5, early=0.05)
    pictures = [draw_volume(extinction(part, thin), 160, thin, View()) for part in (coarse, fine)]
    assert pictures[0].shape == pictures[1].shape
    assert np.abs(cv2.blur(pictures[0] - pictures[1], (9, 9))).mean() < 0.03 * pictures[1].mean()


# --- a board ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, str]:
    """Config, picture and what the command said, for a small synthetic board."""
    folder = tmp_path_factory.mktemp("ablation")
    (folder / "scans").mkdir()
    drawn = scene("quarter_sawn", (270, 280), 0)
    (folder / "scans/board.png").write_bytes(encode_png(drawn.face.rgb_encoded, None))
    config, picture = folder / "my.yaml", folder / "pictures/side_by_side.png"
    config.write_text("scans: scans\noutput: out\nexecution: {scheduler: threads}\n")
    words = ["ablate", "board", "--config", str(config), "--steps", "40", "--out", str(picture)]
    with pytest.MonkeyPatch.context() as patch:
        # Neither a report nor many voxels are needed here, and both take their time.
        patch.setattr("pipeline.project.all_products", lambda stages: ())
        patch.setattr("pipeline.ablation_picture._LONGER_VOXELS", 96)
        told = CliRunner().invoke(app, words)
    assert told.exit_code == 0, told.output
    return config, picture, told.output


def variants_of(config: Path, steps: int) -> tuple[list[Variant], Face]:
    project = Project.load(config)
    ds = stored_results(project, Selection(until="color_map", scan="board"), Layout(project.config.output))
    return fit_variants(ds, steps), Face.of(ds)


def test_the_command_runs_the_stages_and_writes_one_picture(board: tuple[Path, Path, str]) -> None:
    _, path, told = board
    assert "board: color_map done" in told
    assert str(path) in told
    picture = cv2.imread(str(path))
    # Four columns: the photograph and three variants, each with something in its volume.
    columns = np.array_split(picture[picture.shape[0] // 2 : int(0.8 * picture.shape[0])], 4, axis=1)
    assert all(float(column.std()) > 20.0 for column in columns[1:])
    assert np.abs(columns[1].astype(float) - columns[3]).mean() > 2.0


@pytest.mark.slow
def test_image_loss_gives_the_face_back_and_breaks_the_rings(board: tuple[Path, Path, str]) -> None:
    blind, begun, ours = (one.figures for one in variants_of(board[0], 60)[0])
    # Colors and rings are moved together until the face looks right, wherever the rings then are.
    assert begun[IMAGE_ERROR] < ours[IMAGE_ERROR]
    for other in (blind, begun):
        assert other[PHASE_ERROR] > 3.0 * ours[PHASE_ERROR]
        assert other[FOLD_OVER] > 1e-3
    assert blind[ROUGHNESS] > 2.0 * ours[ROUGHNESS]
    assert blind[FACE_FOLD] > 1e-3
    assert ours[FOLD_OVER] == ours[FACE_FOLD] == 0.0


def test_the_front_is_the_photograph_and_figures_are_those_of_the_front(board: tuple[Path, Path, str]) -> None:
    variants, face = variants_of(board[0], 2)
    for one in variants:
        assert one.front.shape == face.rgb.shape
        error = np.sqrt(((one.front - face.rgb)[face.valid] ** 2).mean())
        assert one.figures[IMAGE_ERROR] == pytest.approx(float(error))
        assert error < 0.5 * face.rgb[face.valid].std()


def test_wrong_words_are_told_before_anything_runs(project: Callable[..., Path]) -> None:
    config = project(scans=2)
    for words, said in (
        (["bord_0"], "did you mean 'board_0'?"),
        (["board_*"], "expected one scan, found board_0.png, board_1.png"),
        (["board_0", "--out", "picture.jpg"], "expected a .png file"),
    ):
        told = CliRunner().invoke(app, ["ablate", *words, "--config", str(config)])
        assert told.exit_code == 2, told.output
        assert said in told.output
    assert not (config.parent / "out").exists()
