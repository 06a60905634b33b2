"""Spectra along and across the grain: gratings have theirs where they should, and white noise is white."""

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import Array, noise, pixels, wood

from woodfit.grain_spectrum import (
    BANDS,
    Lines,
    band_power,
    difference_db,
    grain_angle,
    grain_spectrum,
    line_power,
    place_lines,
)

SHAPE = (300, 340)


def level(angle: float) -> Array:
    return np.full(SHAPE, angle)


@pytest.mark.parametrize("tangent", [0.0, 0.4, 1.3, 2.5])
@pytest.mark.parametrize("band", [2, 4, 6, 8])
def test_a_grating_has_its_power_across_its_lines_in_its_own_band(tangent: float, band: int) -> None:
    x, y = pixels(SHAPE)
    image = np.sin(2 * np.pi * BANDS[band] * (-np.sin(tangent) * x + np.cos(tangent) * y))
    across = grain_spectrum(image, wood(SHAPE), level(tangent + np.pi / 2))
    along = grain_spectrum(image, wood(SHAPE), level(tangent))
    assert int(np.argmax(across)) == band
    assert along.max() < 1e-2 * across.max()


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_white_noise_has_its_variance_in_every_band(angle: float) -> None:
    found = grain_spectrum(noise(SHAPE, 0.1), wood(SHAPE), level(angle))
    # Power per cycle per px, of positive frequencies; lines between pixels lose a little of the finest.
    npt.assert_allclose(found[:7], 2 * 0.1**2, rtol=0.25)
    npt.assert_allclose(found[7:], 2 * 0.1**2, rtol=0.4)


def test_power_is_the_square_of_the_amplitude() -> None:
    values = np.random.default_rng(0).normal(size=(50, 128))
    npt.assert_allclose(line_power(3.0 * values + 7.0), 9.0 * line_power(values), rtol=1e-9, atol=1e-20)


def test_the_mean_of_a_line_leaks_into_no_band() -> None:
    assert line_power(np.full((4, 64), 5.0)).max() < 1e-20


@pytest.mark.parametrize("length", [32, 64, 128])
def test_every_line_stays_within_the_wood_and_is_straight(length: int) -> None:
    x, y = pixels(SHAPE)
    valid = np.hypot(x - 160, y - 150) < 120
    angle = np.arctan2(y - 150, x - 160)
    lines = place_lines(valid, angle, 300, length)
    assert len(lines.x) > 20
    assert valid[np.rint(lines.y).astype(int), np.rint(lines.x).astype(int)].all()
    npt.assert_allclose(np.hypot(np.diff(lines.x), np.diff(lines.y)), 1.0, atol=1e-3)
    middle = 0.5 * (lines.x[:, 0] + lines.x[:, -1]), 0.5 * (lines.y[:, 0] + lines.y[:, -1])
    turn = np.arctan2(lines.y[:, -1] - lines.y[:, 0], lines.x[:, -1] - lines.x[:, 0])
    wanted = np.arctan2(middle[1] - 150, middle[0] - 160)
    npt.assert_allclose(np.abs(np.sin(turn - wanted)), 0.0, atol=1e-3)


def test_shorter_lines_are_taken_where_long_ones_do_not_fit() -> None:
    narrow = np.zeros(SHAPE, bool)
    narrow[100:170] = True
    assert place_lines(narrow, level(np.pi / 2)).x.shape[1] == 64
    assert place_lines(narrow, level(0.0)).x.shape[1] == 128
    assert np.isnan(grain_spectrum(noise(SHAPE, 1.0), np.zeros(SHAPE, bool), level(0.0))).all()


def test_lines_read_what_lies_under_them() -> None:
    x, y = pixels(SHAPE)
    lines = Lines(np.array([[20.25, 21.25, 22.25]], np.float32), np.array([[30.5, 31.5, 32.5]], np.float32))
    npt.assert_allclose(lines.read(0.01 * x + 0.003 * y), 0.01 * lines.x + 0.003 * lines.y, atol=1e-3)
    assert lines.read(np.zeros((*SHAPE, 3))).shape == (1, 3, 3)


def test_a_band_without_a_frequency_is_unknown() -> None:
    found = band_power(np.ones(17))
    # Lines of 32 px know 1/32, 2/32, 3/32 …: the bands between the first two stay empty.
    npt.assert_array_equal(np.isnan(found), [True, True, False, True, False, False, False, False, False])


def test_decibels_are_ten_times_the_logarithm_and_unknown_stays_unknown() -> None:
    found = difference_db(np.array([10.0, 0.5, np.nan, 0.0]), np.array([1.0, 1.0, 1.0, 1.0]))
    npt.assert_allclose(found, [10.0, -3.0103, np.nan, np.nan], atol=1e-4)


def test_the_grain_runs_along_the_fibre_and_on_end_grain_along_the_rings() -> None:
    right, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    fiber = np.array([[np.cos(0.3), np.sin(0.3), 0.0], [0.0, 0.0, 1.0], [0.0, 0.4, 0.9165]])
    outward = np.array([[0.0, 0.0, 1.0], [np.cos(1.1), np.sin(1.1), 0.0], [1.0, 0.0, 0.0]])
    angle, end_grain = grain_angle(fiber, outward, right, 2.0 * down)
    npt.assert_array_equal(end_grain, [False, True, True])
    wanted = np.array([0.3, 1.1 + np.pi / 2, np.pi / 2])
    npt.assert_allclose(np.abs(np.sin(angle - wanted)), 0.0, atol=1e-9)
