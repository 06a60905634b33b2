"""From encoded pixels to linear color, wood mask and analysis resolution."""

import cv2
import numpy as np
import numpy.testing as npt
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from woodfit.photograph import (
    develop,
    grey_value,
    mask_at,
    mask_window,
    reduction_for,
    srgb_decode,
    srgb_encode,
    thickness,
    wood_mask,
)
from woodfit.synthetic_scenes import SCENE_NAMES, scene

SHAPE = (120, 150)
WOOD = np.array([190, 140, 90], np.uint8)


def disc(radius: float = 45.0) -> NDArray[np.bool_]:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.asarray(np.hypot(x - 74.5, y - 59.5) < radius)


def picture(inside: NDArray[np.bool_], background: int, seed: int = 0) -> NDArray[np.uint8]:
    """Noisy wood where `inside`, plain grey elsewhere."""
    noise = np.random.default_rng(seed).integers(-25, 25, (*SHAPE, 1))
    wood = np.clip(WOOD + noise, 0, 255)
    return np.where(inside[..., None], wood, background).astype(np.uint8)


def found_in(encoded: NDArray[np.uint8], opaque: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    return wood_mask(encoded, np.ones(SHAPE, bool) if opaque is None else opaque, 0.92, 0.06)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_encoding_undoes_decoding_for_every_code(dtype: type[np.unsignedinteger]) -> None:
    top = np.iinfo(dtype).max
    codes = np.arange(top + 1).astype(dtype)
    npt.assert_array_equal(np.round(srgb_encode(srgb_decode(codes)) * top).astype(dtype), codes)


def test_decoding_undoes_encoding() -> None:
    linear = np.linspace(0.0, 1.0, 1001)
    npt.assert_allclose(srgb_decode(srgb_encode(linear)), linear, atol=1e-6)


def test_decoding_meets_the_standard() -> None:
    # IEC 61966-2-1: middle grey 0.5 decodes to 0.2140; the two branches meet at 0.04045.
    npt.assert_allclose(srgb_decode(np.array([0.0, 0.02, 0.5, 1.0])), [0.0, 0.02 / 12.92, 0.214041, 1.0], atol=1e-6)
    low, high = srgb_decode(np.array([0.04045 - 1e-7, 0.04045 + 1e-7]))
    assert high - low == pytest.approx(0.0, abs=1e-6)
    assert np.all(np.diff(srgb_decode(np.arange(256, dtype=np.uint8))) > 0)


def test_the_depth_of_the_file_does_not_matter() -> None:
    encoded = picture(disc(), 250)
    # 257 * 255 = 65535
    deep = encoded.astype(np.uint16) * 257
    npt.assert_allclose(srgb_decode(deep), srgb_decode(encoded), atol=1e-6)
    npt.assert_allclose(grey_value(deep), grey_value(encoded), atol=1e-6)
    npt.assert_array_equal(
        wood_mask(deep, np.ones(SHAPE, bool), 0.92, 0.06), wood_mask(encoded, np.ones(SHAPE, bool), 0.92, 0.06)
    )


def test_linear_values_out_of_range_are_clipped() -> None:
    npt.assert_array_equal(srgb_encode(np.array([-0.5, 1.5])), [0.0, 1.0])


def test_the_grey_value_is_the_brightest_channel() -> None:
    npt.assert_allclose(grey_value(np.array([[51, 255, 0], [51, 0, 102]], np.uint8)), [1.0, 0.4])


def test_develop_gives_color_grey_value_and_opacity() -> None:
    encoded, opaque = picture(disc(), 255), disc()
    rgb, value, clear = develop(encoded, opaque)
    npt.assert_array_equal(rgb, srgb_decode(encoded))
    npt.assert_array_equal(value, grey_value(encoded))
    npt.assert_array_equal(clear, opaque)


@pytest.mark.parametrize("background", [255, 0], ids=["white", "black"])
def test_a_disc_is_told_from_its_background(background: int) -> None:
    found = found_in(picture(disc(), background))
    assert not found[~disc(46.0)].any()
    # Its blurred rim is given up: three pixels, no more.
    assert found[disc(41.5)].all()


def test_transparent_pixels_are_no_wood() -> None:
    found = found_in(picture(np.ones(SHAPE, bool), 0), disc())
    assert not found[~disc(46.0)].any()
    assert found[disc(41.5)].all()


def test_a_board_that_touches_all_edges_is_wood_everywhere() -> None:
    assert found_in(picture(np.ones(SHAPE, bool), 0)).all()


@pytest.mark.parametrize("background", [255, 0], ids=["filler", "crack"])
def test_islands_inside_the_wood_stay_wood(background: int) -> None:
    assert found_in(picture(~disc(12.0), background)).all()


@pytest.mark.parametrize("turns", range(4))
def test_background_may_reach_any_one_edge(turns: int) -> None:
    strip = np.zeros((100, 100), bool)
    strip[:, :20] = True
    strip[:5] = strip[-5:] = False
    strip = np.rot90(strip, turns)
    encoded = np.where(strip[..., None], 255, WOOD).astype(np.uint8)
    found = wood_mask(encoded, np.ones(strip.shape, bool), 0.92, 0.06)
    assert not found[strip].any()
    assert found.mean() > 0.7


def test_a_thin_scratch_does_not_let_the_background_in() -> None:
    inside = ~disc(20.0)
    inside[60, :75] = False
    assert found_in(picture(inside, 255))[disc(16.0)].all()


def test_bright_wood_with_color_is_not_background() -> None:
    opaque = np.ones(SHAPE, bool)
    for color, wood in (([255, 225, 190], True), ([225, 222, 218], False)):
        encoded = np.broadcast_to(np.array(color, np.uint8), (*SHAPE, 3)).copy()
        assert (wood_mask(encoded, opaque, 0.7, 0.06) == wood).all()


def test_a_speck_at_the_edge_is_no_background() -> None:
    inside = np.ones(SHAPE, bool)
    inside[50:53, :4] = False
    assert found_in(picture(inside, 255)).all()


def test_a_mask_mirrors_with_its_picture() -> None:
    encoded = picture(disc() & (np.mgrid[: SHAPE[0], : SHAPE[1]][1] > 60), 255)
    npt.assert_array_equal(found_in(encoded[::-1, ::-1].copy()), found_in(encoded)[::-1, ::-1])


def test_the_mask_leaves_its_input_alone() -> None:
    encoded = picture(disc(), 255)
    before = encoded.copy()
    found_in(encoded)
    npt.assert_array_equal(encoded, before)


def on_mount(
    strip: NDArray[np.uint8], color: tuple[int, int, int], sigma: float
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """A strip on a mount of one color with some noise, and where the strip lies."""
    place = np.pad(np.ones(strip.shape[:2], bool), ((40, 30), (50, 25)))
    mount = np.random.default_rng(0).normal(color, sigma, (*place.shape, 3)).clip(0, 255).round().astype(np.uint8)
    mount[place] = strip.reshape(-1, 3)
    return mount, place


MOUNTS = {
    "white": ((250, 250, 250), 1.0),
    "black": ((6, 6, 6), 1.0),
    "grey": ((128, 128, 128), 1.0),
    "blue felt": ((40, 60, 140), 2.0),
    "brown": ((95, 60, 35), 2.0),
}


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("turns", [0, 1])
def test_a_core_is_told_from_a_mount_of_one_color(mount: str, turns: int) -> None:
    encoded, place = on_mount(np.rot90(scene("core", (300, 320)).face.rgb_encoded, turns), *MOUNTS[mount])
    found = wood_mask(encoded, np.ones(place.shape, bool), 0.92, 0.06)
    assert not found[~place].any()
    # Its rim is given up: three pixels, no more.
    rows, cols = np.flatnonzero(place.any(axis=1)), np.flatnonzero(place.any(axis=0))
    assert found[rows[3] : rows[-3], cols[3] : cols[-3]].all()


@pytest.mark.parametrize("slope", [0.0, 0.04])
def test_a_thin_core_on_a_large_mount_is_found(slope: float) -> None:
    core = scene("core", (300, 320)).face.rgb_encoded
    mount = np.random.default_rng(0).normal((40, 60, 140), 2.0, (400, core.shape[1] + 80, 3)).clip(0, 255)
    place = np.zeros(mount.shape[:2], bool)
    for column in range(core.shape[1]):
        top = 170 + round(slope * column)
        mount[top : top + core.shape[0], column + 40] = core[:, column]
        place[top : top + core.shape[0], column + 40] = True
    found = wood_mask(mount.astype(np.uint8), np.ones(place.shape, bool), 0.92, 0.06)
    assert not found[~place].any()
    assert found[place].mean() > 0.85


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_a_face_without_background_is_wood_everywhere(name: str) -> None:
    encoded = scene(name, (300, 320)).face.rgb_encoded
    assert wood_mask(encoded, np.ones(encoded.shape[:2], bool), 0.92, 0.06).all()


@pytest.mark.parametrize(("side", "wood"), [((185, 140, 95), True), ((90, 60, 120), False)])
def test_an_even_side_is_wood_if_it_is_colored_like_the_middle(side: tuple[int, int, int], wood: bool) -> None:
    encoded = picture(np.ones(SHAPE, bool), 0)
    encoded[:, :20] = side
    found = found_in(encoded)
    assert (found[:, :20] == wood).all()
    assert found[:, 24:].all()


@pytest.mark.parametrize(("name", "seed"), [("quarter_sawn", 1), ("flat_sawn", 4), ("end_grain_off", 3)])
def test_dark_heartwood_along_a_side_is_wood(name: str, seed: int) -> None:
    drawn = scene(name, seed=seed)
    age = drawn.face.age[..., None]
    heart = np.array([0.53, 0.31, 0.23]) ** (age < np.percentile(age, 40))
    assert wood_mask((drawn.face.rgb_encoded * heart).astype(np.uint8), np.ones(age.shape[:2], bool), 0.92, 0.06).all()


@pytest.mark.parametrize("grain_px", [0.0, 1.5, 3.0])
def test_a_rough_mount_is_background(grain_px: float) -> None:
    encoded, place = on_mount(scene("core", (300, 320)).face.rgb_encoded, (60, 40, 30), 0.0)
    rough = np.random.default_rng(0).normal(size=place.shape)
    rough = gaussian_filter(rough, grain_px)
    mount = np.clip(encoded + 5.0 * (rough / rough.std())[..., None], 0, 255).astype(np.uint8)
    found = wood_mask(np.where(place[..., None], encoded, mount), np.ones(place.shape, bool), 0.92, 0.06)
    assert found[~place].mean() < 0.1
    assert found[place].mean() > 0.7


def test_a_grey_card_as_bright_as_the_wood_is_background_where_it_is_all_around() -> None:
    place = disc()
    assert np.array_equal(found_in(picture(place, 128)), cv2.erode(place.astype(np.uint8), np.ones((5, 5))) > 0)
    encoded = picture(np.ones(SHAPE, bool), 0)
    encoded[:, :20] = 150, 128, 110
    assert found_in(encoded).all(), "on one side only it may be a wide ring"


def test_a_side_of_many_colors_is_wood_however_dark() -> None:
    encoded = picture(np.ones(SHAPE, bool), 0)
    encoded[:, :20] //= 3
    encoded[::2, :20] += 40
    assert found_in(encoded).all()


def test_wood_colored_like_its_mount_here_and_there_stays_wood() -> None:
    strip = picture(np.ones(SHAPE, bool), 0)
    # Bark-colored latewood, four pixels wide, along and across.
    strip[:, 40:44] = strip[60:64] = (95, 60, 35)
    encoded, place = on_mount(strip, (95, 60, 35), 2.0)
    found = wood_mask(encoded, np.ones(place.shape, bool), 0.92, 0.06)
    assert not found[~place].any()
    assert found[60:-50, 70:-45].all()


def test_thickness_is_that_of_the_largest_disk() -> None:
    strip = np.zeros(SHAPE, bool)
    strip[30:61] = True
    assert thickness(strip) == pytest.approx(32.0, abs=1.0)
    assert thickness(strip.T) == thickness(strip)
    assert thickness(disc(45.0)) == pytest.approx(90.0, abs=3.0)
    assert thickness(disc(45.0) | strip) == pytest.approx(90.0, abs=3.0)
    # The picture's edge bounds wood that fills it.
    assert thickness(np.ones(SHAPE, bool)) == pytest.approx(SHAPE[0], abs=2.0)
    assert thickness(np.zeros(SHAPE, bool)) == 0.0


@pytest.mark.parametrize("ring", [4.0, 20.0, 64.0])
def test_small_scans_keep_their_pixels(ring: float) -> None:
    assert reduction_for((735, 750), ring) == 1


def test_rings_too_wide_for_the_region_are_reduced_even_in_a_small_scan() -> None:
    assert reduction_for((735, 750), 320.0) == 8


@pytest.mark.parametrize("ring", [3.0, 20.0, 45.0, 100.0, 333.0])
def test_large_scans_are_reduced_until_a_ring_is_some_twenty_pixels(ring: float) -> None:
    step = reduction_for((8000, 6000), ring)
    assert step >= 1
    assert step == 1 or 20.0 <= ring / step < 40.0


def test_a_mask_is_brought_to_pixels_and_to_the_analysis_alike() -> None:
    mask = np.random.default_rng(1).random((10, 12)) > 0.5
    whole = mask_window(mask, 4, 0, 0, (41, 50))
    npt.assert_array_equal(whole[:40, :48], np.kron(mask, np.ones((4, 4), bool)))
    npt.assert_array_equal(mask_window(mask, 4, 7, 9, (20, 15)), whole[7:27, 9:24])
    npt.assert_array_equal(mask_at(mask, 4, 1, (41, 50)), whole)
    npt.assert_array_equal(mask_at(mask, 4, 4, (10, 12)), mask)
