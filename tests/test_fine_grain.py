"""Fine grain: noise that never comes again, has no seam, keeps the mean color, and gives a face its spectrum back."""

import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr
from kernel_scenes import SHARED, Array, needs_shared
from test_solid_texture import MATRIX, from_tree, plain

from stages import STAGES
from stages.faces import single_face
from stages.products import solid_texture_of
from woodfit import SolidTexture, fine_grain_noise
from woodfit.close_up import window_corners
from woodfit.fine_grain import FineGrain
from woodfit.fine_grain_fit import differences_db, fit_fine_grain, worst_differences
from woodfit.fine_grain_lines import known_in_windows, read_lines
from woodfit.fine_grain_measure import luminance, skewness
from woodfit.grain_spectrum import difference_db, grain_angle, grain_spectrum
from woodfit.photograph import srgb_decode
from woodfit.planes import Planes
from woodfit.synthetic_scenes import scene

FIBRE, PORE, RAY, LAYER = fine_grain_noise.FIBRE, fine_grain_noise.PORE, fine_grain_noise.RAY, fine_grain_noise.LAYER
KINDS = [
    (FIBRE, (3.0, 3.0, 48.0), 1.0),
    (PORE, (4.0, 4.0, 120.0), 0.2),
    (RAY, (2.0, 20.0, 50.0), 1.0),
    (LAYER, (2.0, 60.0, 30.0), 1.0),
]
each_kind = pytest.mark.parametrize(("kind", "cells", "density"), KINDS)


def field(kind: int, cells: tuple[float, ...], density: float, radius: Array, azimuth: Array, height: Array) -> Array:
    radius, azimuth, height = (np.ravel(part) for part in np.broadcast_arrays(radius, azimuth, height))
    one = FineGrain.unit(kind, cells, density, 3)
    return one.log_factor(radius, azimuth, height, np.zeros(radius.size))[:, 0].astype(float)


def mixed(seed: int = 0) -> FineGrain:
    kind, cells, density = zip(*KINDS, strict=True)
    amplitude = np.array([[0.1, 0.05], [0.8, 0.2], [0.1, 0.1], [0.1, 0.15]])
    return FineGrain.of(
        np.array(kind), np.array(cells), np.array(density), amplitude, np.tile([0.8, 1.0, 1.3], (4, 1)), seed
    )


def random_places(count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 3e4, count), rng.uniform(-np.pi, np.pi, count), rng.uniform(-3e4, 3e4, count)


# --- the noises ------------------------------------------------------------------------------------------------------


@each_kind
def test_a_place_has_the_same_grain_in_whatever_company(kind: int, cells: tuple[float, ...], density: float) -> None:
    radius, azimuth, height = random_places(5000)
    whole = field(kind, cells, density, radius, azimuth, height)
    npt.assert_array_equal(field(kind, cells, density, radius[77:80], azimuth[77:80], height[77:80]), whole[77:80])
    npt.assert_allclose(field(kind, cells, density, radius, azimuth + 2 * np.pi, height), whole, atol=1e-5)


@each_kind
def test_grain_is_continuous_everywhere(kind: int, cells: tuple[float, ...], density: float) -> None:
    # Across the pith's plane, the branch cut of the azimuth, and the shells at which rays double in number.
    step = 0.01
    t = np.arange(-400.0, 400.0, step)
    for shift in (0.0, 3.3):
        x, y = t, np.full_like(t, shift)
        across = field(kind, cells, density, np.hypot(x, y), np.arctan2(y, x), 5.0)
        beyond = np.abs(t) > (8.0 if kind in (RAY, LAYER) else 0.0)
        assert np.abs(np.diff(across))[beyond[1:]].max() < 12.0 * step / cells[0] * max(1.0, np.abs(across).max())
    turn = np.linspace(-np.pi, np.pi, 40_001)
    around = field(kind, cells, density, np.full_like(turn, 60.0), turn, 5.0)
    assert np.abs(np.diff(np.append(around, around[0]))).max() < 0.1
    assert np.abs(np.diff(field(kind, cells, density, 60.0, 0.3, t))).max() < 0.05


@each_kind
def test_grain_does_not_come_again(kind: int, cells: tuple[float, ...], density: float) -> None:
    # One window of the tree, correlated with every one of a long way further up and further out.
    r, h = np.meshgrid(np.arange(500.0, 540.0), np.arange(0.0, 400.0, 2.0), indexing="ij")
    here = field(kind, cells, density, r, 0.2, h)
    places = [(0.2, h + 997.0 * shift) for shift in range(1, 60)] + [(0.2 + 0.1 * shift, h) for shift in range(1, 60)]
    found = [np.corrcoef(here, field(kind, cells, density, r, *there))[0, 1] for there in places]
    spread = np.std(found)
    assert np.abs(found).max() < max(5.0 * spread, 0.05)
    assert np.abs(found).max() < 0.6


@each_kind
def test_grain_is_long_along_its_own_axis(kind: int, cells: tuple[float, ...], density: float) -> None:
    radius, azimuth, height = random_places(40_000, 1)
    radius += 500.0
    here = field(kind, cells, density, radius, azimuth, height)

    def alike(dr: float, arc: float, dh: float) -> float:
        return float(
            np.corrcoef(here, field(kind, cells, density, radius + dr, azimuth + arc / radius, height + dh))[0, 1]
        )

    step = 1.5 * cells[0]
    along = {"r": alike(step, 0, 0), "arc": alike(0, step, 0), "h": alike(0, 0, step)}
    longest = {FIBRE: "h", PORE: "h", RAY: "r", LAYER: "arc"}[kind]
    assert along[longest] > 0.6
    shortest = {FIBRE: "r", PORE: "arc", RAY: "arc", LAYER: "r"}[kind]
    assert abs(along[shortest]) < 0.25


@pytest.mark.parametrize(("kind", "cells"), [(kind, cells) for kind, cells, _ in KINDS if kind != PORE])
def test_signed_noises_have_mean_0_and_spread_1(kind: int, cells: tuple[float, ...]) -> None:
    values = field(kind, cells, 1.0, *random_places(200_000, 2))
    assert abs(values.mean()) < 0.02
    assert values.std() == pytest.approx(1.0, abs=0.1)
    assert abs(skewness(values)) < 0.1


@pytest.mark.parametrize(("kind", "cells"), [(kind, cells) for kind, cells, _ in KINDS if kind != PORE])
@pytest.mark.parametrize("plane", ["height", "azimuth", "x"])
def test_on_no_plane_through_the_lattice_is_grain_stronger_or_weaker(
    kind: int, cells: tuple[float, ...], plane: str
) -> None:
    radius, azimuth, height = random_places(100_000, 11)
    if plane == "height":
        height = np.zeros_like(height)
    elif plane == "azimuth":
        azimuth = np.zeros_like(azimuth)
    else:
        azimuth = np.arccos(np.clip(60.0 / np.maximum(radius, 60.0), 0.0, 1.0))
    assert field(kind, cells, 1.0, radius, azimuth, height).std() == pytest.approx(1.0, abs=0.13)


@pytest.mark.parametrize("density", [0.04, 0.1, 0.25, 0.5])
def test_pores_are_dark_and_as_many_as_asked_for(density: float) -> None:
    values = field(PORE, (4.0, 4.0, 120.0), density, *random_places(200_000, 3))
    assert values.max() <= 0.0
    # One bump (1 - d^2)^2 of radius 1 in that share of the cells: its integral is pi / 3.
    assert values.mean() == pytest.approx(-density * np.pi / 3, rel=0.05)
    assert values.std() == pytest.approx(fine_grain_noise.pore_spread(density), rel=0.1)


def test_another_seed_is_another_piece_of_the_same_wood() -> None:
    places = (*random_places(50_000, 4), np.full(50_000, 0.3))
    one, same, other = (grain.log_factor(*places)[:, 1] for grain in (mixed(0), mixed(0), mixed(1)))
    npt.assert_array_equal(one, same)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.05
    assert other.std() == pytest.approx(one.std(), rel=0.05)


@pytest.mark.parametrize("lateness", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_the_mean_color_is_kept_in_early_and_in_latewood(lateness: float) -> None:
    factor = np.exp(mixed().log_factor(*random_places(400_000, 5), np.full(400_000, lateness)).astype(float))
    npt.assert_allclose(factor.mean(axis=0), 1.0, atol=0.01)
    # And there is something whose mean could have been shifted.
    assert factor.std(axis=0).min() > 0.1


def test_a_noise_does_not_depend_on_the_others_in_the_sum() -> None:
    grain, places = mixed(), random_places(2000, 6)
    total = np.zeros((2000, 3))
    for number, (kind, cells, density) in enumerate(KINDS):
        alone = FineGrain.unit(kind, cells, density, grain.seed).log_factor(*places, np.zeros(2000))
        total += grain.amplitude[number, 0] * grain.color[number] * alone
    npt.assert_allclose(grain.log_factor(*places, np.zeros(2000)) + grain.log_mean[0], total, atol=1e-4)


# --- the texture with its grain --------------------------------------------------------------------------------------


def grained() -> SolidTexture:
    return replace(plain(), fine_grain=mixed())


def test_the_grain_can_be_switched_off() -> None:
    points = np.random.default_rng(0).uniform(0, 300, (5000, 3))
    bare, with_it = plain().evaluate(points), grained().evaluate(points)
    npt.assert_array_equal(grained().evaluate(points, detail=False).rgb, bare.rgb)
    assert np.abs(with_it.rgb / bare.rgb - 1.0).mean() > 0.02
    npt.assert_array_equal(with_it.ring_age, bare.ring_age)
    npt.assert_array_equal(with_it.lateness, bare.lateness)


def test_a_ring_keeps_its_color_on_average() -> None:
    one = grained()
    rng = np.random.default_rng(1)
    for age in (2.2, 7.9):
        radius = np.full(100_000, np.interp(age, np.arange(len(one.ring_radius)), one.ring_radius))
        points = from_tree(radius, rng.uniform(-np.pi, np.pi, 100_000), rng.uniform(-4000, 4000, 100_000))
        mean = one.evaluate(points).rgb.mean(axis=0, dtype=np.float64)
        npt.assert_allclose(mean, one.evaluate(points[:1], detail=False).rgb[0], rtol=0.02)


def test_streaks_run_along_the_fibre_direction_where_the_layers_lean() -> None:
    kind, cells, density = KINDS[0]
    streaks = FineGrain.of(
        np.array([kind]), np.array([cells]), np.array([density]), np.array([[0.2, 0.2]]), np.ones((1, 3))
    )
    one = plain()
    r, _, h = np.meshgrid(one.grid.radius, one.grid.azimuth, one.grid.height, indexing="ij")
    leaning = replace(one, displacement=(0.25 * h * (r > 0)).astype(np.float32), fine_grain=streaks)
    rng = np.random.default_rng(2)
    points = from_tree(rng.uniform(60, 200, 4000), rng.uniform(-np.pi, np.pi, 4000), rng.uniform(-100, 100, 4000))

    def alike(shift: Array) -> float:
        two = [
            leaning.evaluate(p).rgb[:, 1] / leaning.evaluate(p, detail=False).rgb[:, 1]
            for p in (points, points + shift)
        ]
        return float(np.corrcoef(*two)[0, 1])

    fiber = leaning.evaluate(points).fiber_direction.astype(float)
    assert np.abs(fiber @ MATRIX[2, :3]).max() < 0.98, "the fibre leans"
    assert alike(12.0 * fiber) > 0.8
    # A quarter of 12 px further in is another streak.
    assert alike(12.0 * MATRIX[2, :3]) < 0.6


def test_a_picture_of_512_by_512_with_ten_noises_takes_less_than_a_second() -> None:
    kind, cells, density = zip(*(KINDS * 3)[:10], strict=True)
    many = FineGrain.of(
        np.array(kind),
        np.array(cells) * np.arange(1, 11)[:, None],
        np.array(density),
        np.full((10, 2), 0.1),
        np.ones((10, 3)),
    )
    one = replace(plain(), fine_grain=many)
    y, x = np.mgrid[:512, :512].astype(float)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    one.evaluate(points[:8])
    spent = []
    for detail in (True, False, True, False):
        start = time.process_time()
        one.evaluate(points, detail=detail)
        spent.append(time.process_time() - start)
    # Processor time of all threads: other processes do not count.
    assert min(spent[::2]) - min(spent[1::2]) < 1.0


# --- the fit ---------------------------------------------------------------------------------------------------------


def photograph_of(one: SolidTexture, size: int = 256) -> tuple[Array, Array, Array, Array]:
    """One window of the texture's own face: rgb, valid, x, y."""
    y, x = np.mgrid[:size, :size].astype(float)
    rgb = one.evaluate(np.stack([x, y, np.zeros_like(x)], axis=-1)).rgb
    return rgb[None], np.ones((1, size, size), bool), np.zeros(1), np.zeros(1)


def test_a_face_drawn_with_fine_grain_gets_its_spectrum_back() -> None:
    lines = read_lines(plain(), *photograph_of(grained()), Planes.single())
    assert {one.direction for one in lines} >= {"along", "across"}
    before = np.nanmax(np.abs(differences_db(FineGrain.none(), lines)))
    found = fit_fine_grain(lines, 15.0, seed=5)
    after = np.nanmax(np.abs(differences_db(found, lines)))
    assert after < 2.0 < 4.0 < before
    worst = worst_differences(found, lines)
    assert len(worst) == 2
    assert all(abs(value) < 2.0 for value in worst.values())


def test_a_face_without_fine_grain_gets_hardly_any() -> None:
    lines = read_lines(plain(), *photograph_of(plain()), Planes.single())
    found = fit_fine_grain(lines, 15.0)
    places = (*random_places(2000, 8), np.zeros(2000))
    assert found.log_factor(*places).std() < 0.02


@pytest.mark.slow
def test_dark_spots_become_pores_and_plain_noise_does_not() -> None:
    def made(kind: int, density: float, depth: float) -> FineGrain:
        cells = np.array([[2.0, 2.0, 32.0]])
        return FineGrain.of(np.array([kind]), cells, np.array([density]), np.full((1, 2), depth), np.ones((1, 3)))

    shares = {}
    for name, grain in (("pores", made(PORE, 0.1, 0.6)), ("noise", made(FIBRE, 1.0, 0.1))):
        face = photograph_of(replace(plain(), fine_grain=grain))
        found = fit_fine_grain(read_lines(plain(), *face, Planes.single()), 15.0, seed=1)
        places = (*random_places(60_000, 9), np.zeros(60_000))
        shares[name] = skewness(found.log_factor(*places)[:, 1])
    assert shares["pores"] < -1.0
    assert abs(shares["noise"]) < 0.4


def test_earlywood_and_latewood_have_their_own_strength() -> None:
    grain = FineGrain.of(
        np.array([FIBRE]), np.array([[1.0, 1.0, 16.0]]), np.ones(1), np.array([[0.2, 0.03]]), np.ones((1, 3))
    )
    face = photograph_of(replace(plain(), fine_grain=grain))
    found = fit_fine_grain(read_lines(plain(), *face, Planes.single()), 15.0)
    places = random_places(20_000, 10)
    early, late = (found.log_factor(*places, np.full(20_000, level))[:, 1].std() for level in (0.0, 1.0))
    assert early > 2.0 * late


def test_no_lines_no_grain() -> None:
    assert fit_fine_grain([], 10.0).empty
    nothing = (np.zeros((1, 256, 256, 3), np.float32), np.zeros((1, 256, 256), bool), np.zeros(1), np.zeros(1))
    assert read_lines(plain(), *nothing, Planes.single()) == []


# --- windows ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(20, 1610), (256, 256), (735, 750), (2700, 1300), (300, 9000)])
def test_windows_lie_on_the_scan_and_cover_a_small_one(shape: tuple[int, int]) -> None:
    rows, columns = window_corners(shape, 256, 24)
    assert 1 <= len(rows) == len(columns) <= 24
    assert rows.min() >= 0
    assert columns.min() >= 0
    assert (rows + 256 <= max(shape[0], 256)).all()
    assert (columns + 256 <= max(shape[1], 256)).all()
    assert len(set(zip(rows.tolist(), columns.tolist(), strict=True))) == len(rows)
    if shape[0] * shape[1] < 10 * 256**2:
        seen = np.zeros(shape, bool)
        for row, column in zip(rows, columns, strict=True):
            seen[row : row + 256, column : column + 256] = True
        assert seen.all()


def test_the_wood_in_a_window_is_that_of_the_reduced_mask() -> None:
    rng = np.random.default_rng(0)
    sound = rng.random((50, 40)) > 0.3
    opaque = np.ones((2, 64, 64), bool)
    found = known_in_windows(opaque, np.array([10.0, 70.0]), np.array([5.0, 100.0]), sound, 3)
    full = np.zeros((400, 400), bool)
    full[:150, :120] = np.kron(sound, np.ones((3, 3), bool))
    npt.assert_array_equal(found[0], full[5:69, 10:74])
    npt.assert_array_equal(found[1], full[100:164, 70:134])
    assert opaque.all()


# --- the stages ------------------------------------------------------------------------------------------------------


@cache
def drawn_board(name: str, size: tuple[int, int]) -> xr.Dataset:
    return after_all_stages(scene(name, size, 0).face.rgb_encoded)


def after_all_stages(encoded: Array) -> xr.Dataset:
    one = {"units": "1"}
    height, width = encoded.shape[:2]
    file = xr.Dataset(
        {
            "encoded": (("y", "x", "channel"), encoded, one),
            "opaque": (("y", "x"), np.ones((height, width), bool), one),
            "dpi_pixel_size": ((), np.nan, {"units": "mm"}),
        },
        coords={"y": np.arange(height, dtype=float), "x": np.arange(width, dtype=float)},
    )
    ds = single_face()
    for stage in STAGES:
        # The file's own pixels have another size than the grid of the analysis.
        given = stage(file if stage.name in ("scan", "close_up") else ds, stage.params_type())
        ds = ds.assign(given.data_vars).assign_coords(given.coords)
    return ds


def face_differences(one: SolidTexture, encoded: Array, valid: Array) -> tuple[Array, Array]:
    """Texture against photograph on the whole face at its own resolution, dB: along and across the grain."""
    y, x = np.mgrid[: encoded.shape[0], : encoded.shape[1]].astype(float)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    place = one.place(points.reshape(-1, 3))
    angle, _ = grain_angle(place.fiber, place.outward, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    angle = angle.reshape(x.shape)
    drawn, shown = luminance(one.evaluate(points).rgb), luminance(srgb_decode(encoded))
    along, across = (
        difference_db(grain_spectrum(drawn, valid, turned), grain_spectrum(shown, valid, turned))
        for turned in (angle, angle + 0.5 * np.pi)
    )
    return along, across


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow)
        for name in ("quarter_sawn", "flat_sawn", "end_grain_pith", "ring_porous")
    ],
)
def test_the_face_of_a_drawn_board_has_its_spectrum_with_fine_grain(name: str) -> None:
    # In 300 px of this flat-sawn board there are two rings, and its streaks pass for more.
    size = (480, 500) if name == "flat_sawn" else (300, 320)
    encoded = scene(name, size, 0).face.rgb_encoded
    ds = drawn_board(name, size)
    one = solid_texture_of(ds)
    valid = ds["valid"].values & (ds["anomaly"].values == 0)
    bare = face_differences(replace(one, fine_grain=FineGrain.none()), encoded, valid)
    found = face_differences(one, encoded, valid)
    assert np.nanmax(np.abs(found)) < 3.0
    assert np.nanmax(np.abs(bare)) > 3.0


def test_fine_grain_can_be_left_out_of_the_texture() -> None:
    ds = drawn_board("quarter_sawn", (300, 320))
    stage = STAGES[-1]
    assert stage.name == "fine_grain"
    bare = stage(ds, stage.params_type(enabled=False))
    assert bare.sizes["noise"] == 0
    kept = ds.drop_dims("noise").assign(bare.data_vars)
    assert solid_texture_of(kept).fine_grain.empty
    again = stage(ds.drop_dims("noise"), stage.params_type(seed=1))
    assert int(again["fine_grain_seed"]) == 1


@needs_shared
@pytest.mark.shared
@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["boards/walnut_flatsawn.jpg", "boards/red_birch.jpg", "boards/red_oak_endgrain.jpg", "blocks/CN03/B_col.png"],
)
def test_the_face_of_a_real_board_has_its_spectrum_with_fine_grain(name: str) -> None:
    import cv2

    pixels = cv2.imread(str(Path(SHARED) / "data" / "scans" / name))
    assert pixels is not None
    encoded = np.ascontiguousarray(pixels[..., ::-1])
    ds = after_all_stages(encoded)
    step = int(ds["reduction"])
    sound = ds["valid"].values & (ds["anomaly"].values == 0)
    valid = np.zeros(encoded.shape[:2], bool)
    whole = np.kron(sound, np.ones((step, step), bool))
    valid[: whole.shape[0], : whole.shape[1]] = whole
    assert np.nanmax(np.abs(face_differences(solid_texture_of(ds), encoded, valid))) < 3.0
