"""The curved Gabor filter: known waves give known responses, and the fast form gives what the literal one gives."""

import cv2
import numba
import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import (
    SHARED,
    Array,
    Image,
    angle_between,
    conifer,
    correlation,
    needs_shared,
    noise,
    pixels,
    round_age,
    straight,
    wave,
    wood,
    wrapped,
)

from woodfit import patch_gabor
from woodfit.curved_gabor import GaborField, Region, curved_gabor, halo, respond
from woodfit.grids import between, block_mean, enlarged, grid_step
from woodfit.ring_direction import curvature
from woodfit.structure_tensor import orientation
from woodfit.synthetic_scenes import scene

REGION = Region(p=40, q=16, sigma_along_px=6.0)
SMALL = Region(p=20, q=20, sigma_along_px=8.0)
TILED = Region(p=18, q=18, sigma_along_px=7.0)
FORMS = {"fast": lambda *args: respond(*args)[0], "literal": patch_gabor.respond}
CENTERS = {"inside": (60.0, 55.0), "outside": (-70.0, 40.0)}


def field_of(value: Image, scale: float, region: Region = REGION) -> GaborField:
    angle, _ = orientation(value, wood(value.shape), 1.0, 0.5 * scale)
    return curved_gabor(value, wood(value.shape), angle, scale, region, 5.0, 60.0)


def board(name: str = "cathedral", side: int = 257) -> Image:
    return (scene(name, (side, side), 3).face.rgb_encoded.max(axis=-1) / 255.0).astype(np.float32)


# --- known waves --------------------------------------------------------------------------------------------
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("tangent", [0.0, 0.4, np.pi / 2, 2.3])
@pytest.mark.parametrize("width", [8.0, 24.0])
def test_a_grating_is_answered_with_its_amplitude_and_phase(form: str, tangent: float, width: float) -> None:
    shape = (110, 120)
    age = straight(shape, width, tangent, 0.2)
    inputs = (wave(age, 0.2), wood(shape), np.full(shape, tangent), np.full(shape, 1 / width), REGION)
    inner = (slice(40, -40), slice(40, -40))
    relative = FORMS[form](*inputs)[inner] / (0.2 * np.exp(2j * np.pi * age[inner]))
    # Bilinear samples lose a little of the narrowest waves.
    assert np.abs(np.abs(relative) - 1.0).max() < (0.15 if width < 10 else 0.06)
    assert np.abs(np.angle(relative)).max() < 0.03


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("center", CENTERS)
def test_rings_are_answered_with_their_phase_along_the_radius(form: str, center: str) -> None:
    shape = (120, 120)
    age, outwards = round_age(shape, CENTERS[center], 14.0)
    inputs = (wave(age, 0.2), wood(shape), outwards - np.pi / 2, np.full(shape, 1 / 14.0), SMALL)
    relative = FORMS[form](*inputs) / (0.2 * np.exp(2j * np.pi * age))
    x, y = pixels(shape)
    known = (age > 2.0) & (np.minimum(np.minimum(x, y), np.minimum(119 - x, 119 - y)) > 20)
    assert np.abs(np.angle(relative))[known].max() < 0.1
    assert np.abs(np.abs(relative) - 1.0)[known].max() < 0.12


@pytest.mark.parametrize("form", FORMS)
def test_the_response_is_linear_in_the_wave_and_blind_to_the_mean(form: str) -> None:
    shape = (90, 90)
    age = straight(shape, 12.0, 0.7)
    rest = (wood(shape), np.full(shape, 0.7), np.full(shape, 1 / 12.0), SMALL)
    textured = wave(age) + noise(shape, 0.05)
    once = FORMS[form](textured, *rest)
    npt.assert_allclose(FORMS[form](3.0 * textured - 5.0, *rest), 3.0 * once, atol=2e-4)
    assert np.abs(FORMS[form](np.full(shape, 0.8, np.float32), *rest)).max() < 1e-5


@pytest.mark.parametrize("form", FORMS)
def test_a_wave_of_twice_or_half_the_frequency_is_hardly_answered(form: str) -> None:
    shape = (120, 120)
    for width in (8.0, 32.0):
        value = wave(straight(shape, width, 0.3))
        response = FORMS[form](
            value, wood(shape), np.full(shape, 0.3), np.full(shape, 1 / 16.0), Region(40, 10, 5.0, 1.0)
        )
        assert np.abs(response[45:-45, 45:-45]).max() < 0.02


@pytest.mark.parametrize("form", FORMS)
def test_fine_stripes_leave_the_phase_of_wide_rings_alone(form: str) -> None:
    shape, tangent = (60, 240), np.pi / 2
    age, stripes = straight(shape, 96.0, tangent), straight(shape, 6.4, tangent)
    value = wave(age, 0.1) + wave(stripes, 0.1) - 0.5
    wide = Region(p=80, q=20, sigma_along_px=8.0)
    inputs = (value, wood(shape), np.full(shape, tangent), np.full(shape, 1 / 96.0), wide)
    columns = slice(80, -80)
    relative = FORMS[form](*inputs)[25:35, columns] / np.exp(2j * np.pi * age[25:35, columns])
    assert np.abs(np.angle(relative)).max() < 0.05


@pytest.mark.parametrize("form", FORMS)
def test_the_response_turns_with_the_image(form: str) -> None:
    value = board(side=96)
    angle, _ = orientation(value, wood(value.shape), 1.0, 8.0)
    frequency = np.full(value.shape, 1 / 16.0) * (1.0 + np.linspace(0.0, 0.2, 96))
    plain = FORMS[form](value, wood(value.shape), angle, frequency, SMALL)
    for turn, turned_angle in (
        (lambda a: a[:, ::-1], -angle),
        (np.rot90, angle - np.pi / 2),
        (lambda a: np.rot90(a, 2), angle + np.pi),
    ):
        inputs = [np.ascontiguousarray(turn(a)) for a in (value, turned_angle, frequency)]
        other = FORMS[form](inputs[0], wood(value.shape), inputs[1], inputs[2], SMALL)
        assert correlation(other, turn(plain)) > 0.9995


@pytest.mark.parametrize("form", FORMS)
def test_turning_the_normal_round_gives_the_conjugate(form: str) -> None:
    # On the board of 80 px one walk of 6,400 ends half way between two pixels, and rounding decides.
    value = board(side=96)
    angle, _ = orientation(value, wood(value.shape), 1.0, 8.0)
    frequency = np.full(value.shape, 1 / 15.0)
    plain = FORMS[form](value, wood(value.shape), angle, frequency, SMALL)
    npt.assert_allclose(FORMS[form](value, wood(value.shape), angle + np.pi, frequency, SMALL), plain.conj(), atol=1e-4)


@pytest.mark.parametrize("form", FORMS)
def test_what_is_not_wood_does_not_matter(form: str) -> None:
    shape = (100, 100)
    age = straight(shape, 12.0, 0.0)
    valid = wood(shape)
    valid[:, 40:48] = False
    rest = (valid, np.zeros(shape), np.full(shape, 1 / 12.0), SMALL)
    clean = FORMS[form](wave(age), *rest)
    blotted = FORMS[form](np.where(valid, wave(age), 9.0), *rest)
    npt.assert_allclose(blotted, clean, atol=1e-5)
    error = np.abs(wrapped(np.angle(clean) - 2 * np.pi * age))
    assert error[30:-30, 30:-30][valid[30:-30, 30:-30]].max() < 0.1


# --- fast against literal -----------------------------------------------------------------------------------
def compare(value: Image, scale: float, stride: int = 12) -> tuple[float, float]:
    """Complex correlation of both forms at confident pixels of a grid, and the share of those pixels."""
    region = Region()
    field = field_of(value, scale, region)
    inputs = (value, wood(value.shape), field.orientation, field.frequency, region)
    fast, explained = respond(*inputs)
    rows, cols = (a.ravel() for a in np.mgrid[3 : value.shape[0] : stride, 3 : value.shape[1] : stride])
    literal = patch_gabor.respond(*inputs, rows, cols)
    sure = explained[rows, cols] > 0.5
    return correlation(fast[rows, cols][sure], literal[sure]), float(sure.mean())


@pytest.mark.parametrize("name", ["cathedral", "end_grain_pith", "ring_porous"])
def test_the_fast_form_is_the_literal_one_on_synthetic_wood(name: str) -> None:
    alike, share = compare(board(name, 256), 18.0)
    assert alike >= 0.98
    assert share > 0.2


@pytest.mark.shared
@needs_shared
@pytest.mark.parametrize(
    ("path", "scale"),
    [("discs/F02b.png", 23.0), ("boards/walnut_flatsawn.jpg", 40.0), ("blocks/CN03/B_col.png", 26.0)],
)
def test_the_fast_form_is_the_literal_one_on_real_wood(path: str, scale: float) -> None:
    scan = cv2.imread(str(SHARED / "data" / "scans" / path)).max(axis=-1).astype(np.float32) / 255.0
    top, left = max(0, scan.shape[0] // 3 - 128), max(0, scan.shape[1] // 3 - 128)
    alike, share = compare(scan[top : top + 256, left : left + 256], scale)
    assert alike >= 0.98
    assert share > 0.2


def test_chosen_pixels_are_answered_like_all_of_them() -> None:
    value = board(side=64)
    inputs = (value, wood(value.shape), np.full(value.shape, 0.5), np.full(value.shape, 0.08), SMALL)
    rows, cols = np.array([0, 31, 63]), np.array([5, 32, 63])
    npt.assert_array_equal(patch_gabor.respond(*inputs, rows, cols), patch_gabor.respond(*inputs)[rows, cols])


# --- the whole filter ---------------------------------------------------------------------------------------
def phase_error(field: GaborField, age: Array, outwards: Array | float) -> Array:
    """Phase off the truth (rad), its sign taken from the normal."""
    with_growth = np.cos(field.normal - outwards) > 0
    return np.abs(wrapped(np.where(with_growth, 1.0, -1.0) * np.angle(field.response) - 2 * np.pi * age))


@pytest.mark.parametrize(("width", "tangent"), [(9.0, 0.2), (16.0, 1.4), (30.0, 2.6)])
def test_frequency_phase_and_orientation_of_a_grating_are_found(width: float, tangent: float) -> None:
    shape = (180, 190)
    age = straight(shape, width, tangent)
    field = field_of(wave(age) + noise(shape, 0.04), 16.0, Region())
    assert np.median(np.abs(np.log2(field.frequency * width))) < 0.08
    assert angle_between(field.orientation, tangent)[20:-20, 20:-20].max() < np.radians(2.0)
    assert np.percentile(phase_error(field, age, tangent + np.pi / 2), 99) < 0.5
    assert np.median(field.explained) > 0.8
    assert np.median(np.abs(field.response)) == pytest.approx(0.2, rel=0.1)


def test_rings_that_widen_eightfold_are_followed() -> None:
    shape = (128, 640)
    x, _ = pixels(shape)
    rate = np.log(8.0) / 640
    age = 8.0 ** (x / 640) / (rate * 48.0)
    field = field_of(wave(age), 16.0, Region())
    width = 48.0 / 8.0 ** (x / 640)
    assert np.percentile(np.abs(np.log2(field.frequency * width))[:, 30:-30], 95) < 0.25
    assert np.percentile(phase_error(field, age, 0.0), 98) < np.pi / 4


def test_the_normal_points_to_the_bright_side_of_the_abrupt_edge() -> None:
    shape = (160, 160)
    age, outwards = round_age(shape, (-60.0, 200.0), 16.0)
    for value, sign in ((conifer(age), 1.0), (conifer(-age), -1.0)):
        field = field_of(value, 16.0)
        assert (np.cos(field.normal - outwards) * sign > 0.9).mean() > 0.99
        assert np.median(field.asymmetry) > 0.5
    assert np.median(field_of(wave(age), 16.0).asymmetry) < 0.2


def test_curvature_is_that_of_the_rings() -> None:
    shape = (200, 200)
    for distance in (60.0, 150.0):
        age, outwards = round_age(shape, (-distance, 100.0), 10.0)
        bent = curvature((outwards + np.pi / 2).astype(np.float32), 4.0)
        npt.assert_allclose(bent[20:-20, 20:-20], (1 / (10.0 * age))[20:-20, 20:-20], rtol=0.05)
    assert curvature(np.full(shape, 0.3, np.float32), 4.0).max() < 1e-4


def test_grey_scale_and_mirror_do_not_change_what_is_found() -> None:
    value = board(side=193)
    field = field_of(value, 16.0)
    scaled = field_of((0.4 * value + 0.1).astype(np.float32), 16.0)
    mirrored = field_of(np.ascontiguousarray(value[:, ::-1]), 16.0)
    sure = field.explained > 0.4
    assert correlation(scaled.response[sure], 0.4 * field.response[sure]) > 0.999
    assert np.percentile(np.abs(np.log2(scaled.frequency / field.frequency))[sure], 99) < 0.02
    assert np.percentile(np.abs(np.log2(mirrored.frequency[:, ::-1] / field.frequency))[sure], 99) < 0.05
    assert correlation(mirrored.response[:, ::-1][sure], field.response[sure]) > 0.99
    assert (np.cos(np.pi - mirrored.normal[:, ::-1] - field.normal)[sure] > 0.9).mean() > 0.99


# --- tiles --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("row", "col"), [(320, 256), (0, 320), (640, 640)])
def test_a_tile_with_its_halo_equals_the_whole(row: int, col: int) -> None:
    side, tile, scale, region = 704, 64, 10.0, TILED
    value = whole_board(side)
    whole = whole_field(side)
    margin = -(-halo(scale, region) // 64) * 64
    assert grid_step(scale) <= 64
    top, left = max(0, row - margin), max(0, col - margin)
    part = np.ascontiguousarray(value[top : row + tile + margin, left : col + tile + margin])
    assert part.size < 0.9 * value.size
    cut = field_in_part(part, scale, region, (top, left))
    inner = (slice(row - top, row - top + tile), slice(col - left, col - left + tile))
    there = (slice(row, row + tile), slice(col, col + tile))
    for name in ("response", "frequency", "explained", "asymmetry", "curvature"):
        npt.assert_allclose(getattr(cut, name)[inner], getattr(whole, name)[there], atol=2e-3, rtol=2e-3)
    assert angle_between(cut.orientation[inner], whole.orientation[there]).max() < 1e-3
    assert np.abs(wrapped(cut.normal[inner] - whole.normal[there])).max() < 1e-3


KEPT: dict[int, GaborField] = {}


def whole_board(side: int) -> Image:
    x, y = pixels((side, side))
    age = np.hypot(x + 150.0 + 12 * np.sin(y / 90), y - 300.0) / (13.0 + 2.0 * np.sin(x / 200))
    return conifer(age) + noise((side, side), 0.03)


def whole_field(side: int) -> GaborField:
    if side not in KEPT:
        KEPT[side] = field_in_part(whole_board(side), 10.0, TILED, (0, 0))
    return KEPT[side]


def field_in_part(value: Image, scale: float, region: Region, origin: tuple[int, int]) -> GaborField:
    """The filter with the orientation of the whole board, so that only its own halo is tested."""
    rows, cols = (slice(o, o + n) for o, n in zip(origin, value.shape, strict=True))
    angle = orientation(whole_board(704), wood((704, 704)), 1.0, 7.0)[0][rows, cols]
    return curved_gabor(value, wood(value.shape), np.ascontiguousarray(angle), scale, region, 5.0, 48.0)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one thread only")
def test_the_number_of_threads_does_not_matter() -> None:
    value = board(side=160)
    fields = []
    before = numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            fields.append(field_of(value, 14.0))
    finally:
        numba.set_num_threads(before)
    npt.assert_array_equal(fields[0].response, fields[1].response)
    npt.assert_array_equal(fields[0].orientation, fields[1].orientation)


def test_what_is_linear_survives_coarser_grids_of_any_shape() -> None:
    x, y = pixels((61, 83))
    plane = (0.3 * x - 0.2 * y).astype(np.float32)
    inner = (slice(4, -8), slice(4, -8))
    for step in (1, 2, 4):
        blocks = enlarged(block_mean(plane, step), step, plane.shape)
        nodes = between(np.ascontiguousarray(plane[::step, ::step]), step, plane.shape)
        npt.assert_allclose(blocks[inner], plane[inner], atol=1e-4)
        npt.assert_allclose(nodes[inner], plane[inner], atol=1e-4)


def test_inputs_are_not_modified() -> None:
    value, valid = board(side=80), wood((80, 80))
    valid[30:40] = False
    angle, _ = orientation(value, valid, 1.0, 6.0)
    frequency = np.full(value.shape, 0.07, np.float32)
    inputs = (value, valid, angle, frequency)
    before = [a.copy() for a in inputs]
    curved_gabor(value, valid, angle, 14.0, SMALL, 5.0, 40.0)
    respond(*inputs, SMALL)
    patch_gabor.respond(*inputs, SMALL, np.array([40]), np.array([40]))
    for now, then in zip(inputs, before, strict=True):
        npt.assert_array_equal(now, then)
