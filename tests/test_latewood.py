"""Rings laid straight and the latewood onset in them, on rings whose share of latewood is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.testing as npt
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from series_scenes import WIDTHS, Array, boundaries, circles, face, slanted

from woodfit import measure_scan
from woodfit.latewood import LEAST_SURENESS, darkness
from woodfit.measured import Kind, Measured, Route
from woodfit.photograph import srgb_decode
from woodfit.series_arrays import FRACTIONS, pack

SHAPE = (120, 420)
PATH = Route(np.array([[2.0, 60.0], [418.0, 60.0]]), Kind.GIVEN, np.nan, 50.0)


def two_tone(
    age_at: Callable[[Array, Array], Array],
    share: Array,
    blur_px: float,
    noise: float,
    early: float = 0.25,
    late: float = 0.7,
) -> NDArray[np.float32]:
    """Darkness of rings of which the last `share` is latewood, seen by square pixels, blurred and noisy."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    offsets = (np.arange(5) - 2.0) / 5.0
    dark = np.zeros(SHAPE)
    for dy in offsets:
        for dx in offsets:
            age = age_at(x + dx, y + dy)
            ring = np.clip(np.floor(age).astype(int), 0, len(share) - 1)
            dark += np.where(age - np.floor(age) >= 1.0 - share[ring], late, early) / 25.0
    rng = np.random.default_rng(1)
    return np.asarray(gaussian_filter(dark, blur_px) + rng.normal(0.0, noise, SHAPE), np.float32)


def straight_age(widths: Array, slant_deg: float = 0.0) -> Callable[[Array, Array], Array]:
    """Ring age of slanted rings that start 60 px along their normal."""
    slant = np.radians(slant_deg)
    edges = 60.0 + np.concatenate([[0.0], np.cumsum(widths)])

    def age(x: Array, y: Array) -> Array:
        across = x * np.cos(slant) + y * np.sin(slant)
        return np.asarray(np.interp(across, edges, np.arange(len(edges)), left=-0.5, right=len(edges) + 0.2))

    return age


def strip(widths: Array, share: Array, slant_deg: float = 0.0, late: float = 0.7, **image: float) -> Measured:
    """A strip of slanted two-tone rings, measured through its middle."""
    known = boundaries(slanted(widths, slant_deg))
    age = straight_age(widths, slant_deg)
    dark = two_tone(age, share, image.get("blur_px", 1.0), image.get("noise", 0.05), late=late)
    one = face(known, dark, np.full(SHAPE, np.radians(slant_deg)), 26.0)
    return measure_scan.measure(one, [PATH], 31.0)[0]


@pytest.mark.parametrize("slant_deg", [0.0, 20.0, 40.0])
@pytest.mark.parametrize("share", [0.2, 0.35, 0.5, 0.7])
def test_a_known_share_of_latewood_is_found(share: float, slant_deg: float) -> None:
    widths = WIDTHS[WIDTHS > 18.0][:8]
    shares = np.full(len(widths), share) + np.linspace(-0.05, 0.05, len(widths))
    series = strip(widths, shares, slant_deg)
    assert np.isfinite(series.onsets.fraction).all()
    npt.assert_allclose(series.onsets.fraction, 1.0 - shares, atol=0.03)
    assert (series.onsets.sureness >= LEAST_SURENESS).all()


def test_a_sharp_border_is_found_to_a_fraction_of_a_pixel() -> None:
    widths = np.full(8, 40.0)
    shares = np.linspace(0.3, 0.6, 8)
    series = strip(widths, shares, blur_px=0.8, noise=0.02)
    npt.assert_allclose(40.0 * series.onsets.fraction, 40.0 * (1.0 - shares), atol=0.15)


def test_earlywood_and_latewood_make_the_ring_exactly() -> None:
    series = strip(WIDTHS, np.full(len(WIDTHS), 0.4), 15.0)
    arrays = pack([series], late_is_dark=True)
    known = np.isfinite(arrays.earlywood_width)
    assert known.sum() >= len(WIDTHS) - 1
    whole = arrays.earlywood_width + arrays.latewood_width
    npt.assert_allclose(whole[known], arrays.series_ring_width[known], rtol=0, atol=1e-12)


def test_rings_without_contrast_have_no_latewood_onset() -> None:
    plain = strip(WIDTHS, np.full(len(WIDTHS), 0.4), late=0.25)
    assert np.isnan(plain.onsets.fraction).all()
    npt.assert_array_equal(plain.onsets.sureness, 0.0)
    faint = strip(WIDTHS, np.full(len(WIDTHS), 0.4), late=0.3, noise=0.02)
    clear = strip(WIDTHS, np.full(len(WIDTHS), 0.4), late=0.7, noise=0.02)
    assert np.nanmean(clear.onsets.sureness) >= np.mean(faint.onsets.sureness)


def test_a_resin_canal_beside_the_path_does_not_move_the_border() -> None:
    widths, shares = np.full(8, 40.0), np.full(8, 0.4)
    clean = strip(widths, shares, noise=0.01)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    dark = two_tone(straight_age(widths), shares, 1.0, 0.01)
    dark[np.hypot(x - 150.0, y - 62.0) < 4.0] = 0.05
    one = face(boundaries(slanted(widths, 0.0)), dark, np.zeros(SHAPE), 40.0)
    marred = measure_scan.measure(one, [PATH], 31.0)[0]
    npt.assert_allclose(marred.onsets.fraction, clean.onsets.fraction, atol=0.01)


def test_in_ring_porous_wood_the_dark_pores_are_earlywood() -> None:
    widths = np.full(8, 36.0)
    # The first third is dark.
    dark = two_tone(straight_age(widths), np.full(9, 2.0 / 3.0), 1.0, 0.03, early=0.7, late=0.3)
    lines = boundaries(slanted(widths, 0.0))
    pores, conifer = (
        measure_scan.measure(face(lines, dark, np.zeros(SHAPE), 36.0, late_is_dark=is_dark), [PATH], 31.0)[0]
        for is_dark in (False, True)
    )
    npt.assert_allclose(pores.onsets.fraction, 1.0 / 3.0, atol=0.03)
    # Read as a conifer there is no darkening to find.
    assert np.isnan(conifer.onsets.fraction).all()
    npt.assert_allclose(pack([pores], False).lateness_table, 1.0 - pack([pores], True).lateness_table, atol=1e-6)


def test_curved_rings_are_laid_straight() -> None:
    pith = (-30.0, 60.0)
    radii = 80.0 + 30.0 * np.arange(9)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)

    def age(x: Array, y: Array) -> Array:
        return np.asarray((np.hypot(x - pith[0], y - pith[1]) - 80.0) / 30.0)

    dark = two_tone(age, np.full(12, 0.4), 1.0, 0.03)
    lines = circles(pith, radii, -0.9, 0.9)
    one = face(boundaries(lines), dark, np.arctan2(y - pith[1], x - pith[0]), 30.0)
    wide = measure_scan.measure(one, [PATH], 91.0)[0]
    npt.assert_allclose(wide.onsets.fraction, 0.6, atol=0.02)


def test_the_table_of_straight_rings_shows_each_rings_tones() -> None:
    series = strip(WIDTHS, np.full(len(WIDTHS), 0.4), noise=0.02)
    table = pack([series], True).lateness_table
    assert table.shape == (len(WIDTHS), FRACTIONS)
    middle_early, middle_late = table[:, int(0.3 * FRACTIONS)], table[:, int(0.8 * FRACTIONS)]
    npt.assert_allclose(middle_early, 0.25, atol=0.03)
    npt.assert_allclose(middle_late[WIDTHS > 20.0], 0.7, atol=0.03)


def test_darkness_is_inverted_lightness_of_the_encoded_image() -> None:
    encoded = np.array([[[255, 255, 255], [0, 0, 0], [255, 0, 0], [200, 100, 50]]], np.uint8)
    dark = darkness(srgb_decode(encoded))
    npt.assert_allclose(dark, [[0.0, 1.0, 0.5, 1.0 - 0.5 * (200 + 50) / 255]], atol=2e-3)
