"""From encoded pixels to linear color, wood mask and analysis resolution."""

import numpy as np
import numpy.testing as npt
import pytest
from numpy.typing import NDArray

from woodfit.photograph import (
    develop,
    grey_value,
    mask_at,
    mask_window,
    reduction_for,
    srgb_decode,
    srgb_encode,
    wood_mask,
)

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
