"""The color strip: a known strip given back, unseen rings filled, no seam at the boundaries, lateness the right way."""

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import Array

from woodfit.color_strip import ColorStrip, color_at, fit_balanced, fit_color_strip, psnr_blurred

RINGS, SAMPLES = 12, 32
EARLY, LATE = np.array([0.62, 0.42, 0.24]), np.array([0.25, 0.12, 0.05])


def true_color(age: Array) -> Array:
    """Conifer: slow darkening and an abrupt edge; every ring a little brighter or darker than the last."""
    level = 1.0 + 0.15 * np.sin(np.floor(age) / 2.5)
    share = np.mod(age, 1.0)[..., None] ** 2
    return np.asarray((EARLY * (1.0 - share) + LATE * share) * level[..., None])


def face(rings: float = RINGS, count: int = 60_000, seed: int = 0, noise: float = 0.02) -> tuple[Array, Array]:
    """Ring ages all over a face and their noisy colors."""
    rng = np.random.default_rng(seed)
    age = rng.uniform(0.0, rings, count)
    return age, np.clip(true_color(age) + rng.normal(0.0, noise, (count, 1)), 0.0, 1.0)


def fit(age: Array, rgb: Array, dark: bool = True, rings: int = RINGS) -> ColorStrip:
    return fit_color_strip(age, rgb, np.ones(len(age)), rings, SAMPLES, dark)


def away_from_edges(age: Array) -> Array:
    """Where the strip's own blur does not reach the abrupt edge."""
    fraction = np.mod(age, 1.0)
    return np.asarray((fraction > 3 / SAMPLES) & (fraction < 1 - 3 / SAMPLES))


def test_a_known_strip_is_given_back() -> None:
    strip = fit(*face())
    assert strip.rgb.shape == (RINGS * SAMPLES, 3)
    npt.assert_allclose(strip.age, (np.arange(RINGS * SAMPLES) + 0.5) / SAMPLES)
    inner = away_from_edges(strip.age)
    wrong = np.abs(strip.rgb - true_color(strip.age))
    assert wrong[inner].max() < 0.02
    assert wrong.mean() < 0.01


def test_support_counts_the_pixels_behind_every_sample() -> None:
    age, rgb = face()
    strip = fit(age, rgb)
    assert strip.support.sum() == pytest.approx(len(age))
    npt.assert_allclose(strip.support, np.histogram(age, RINGS * SAMPLES, (0, RINGS))[0])


def test_cracks_and_pores_fade_out_of_the_mean() -> None:
    age, rgb = face()
    cracked = np.random.default_rng(1).random(len(age)) < 0.08
    dirty = np.where(cracked[:, None], 0.0, rgb)
    inner = away_from_edges((np.arange(RINGS * SAMPLES) + 0.5) / SAMPLES)
    plain = 0.08 * true_color(np.arange(RINGS) + 0.1).mean()
    assert np.abs(fit(age, dirty).rgb - fit(age, rgb).rgb)[inner].mean() < 0.5 * plain


def test_unseen_rings_take_the_mean_profile_at_the_brightness_of_their_neighbours() -> None:
    age, rgb = face()
    hidden = ((age >= 4) & (age < 6)) | (age >= 10)
    strip = fit(age[~hidden], rgb[~hidden])
    unseen = np.isin(np.floor(strip.age), (4, 5, 10, 11))
    npt.assert_array_equal(strip.support[unseen], 0.0)
    assert (strip.support[~unseen] > 0).all()
    assert np.isfinite(strip.rgb).all()
    for ring in (4, 5, 10, 11):
        inner = (np.floor(strip.age) == ring) & away_from_edges(strip.age)
        guessed, true = strip.rgb[inner], true_color(strip.age[inner])
        assert np.corrcoef(guessed[:, 0], true[:, 0])[0, 1] > 0.99
        # The levels of the rings differ by up to 30 %; neighbours lie closer.
        assert np.abs(guessed / true - 1.0).max() < 0.2


def test_a_sliver_of_the_innermost_ring_does_not_color_all_rings_inside() -> None:
    # Of ring 5 only the last third was seen, under a reflection: half as bright again.
    age, rgb = face()
    seen = age > 5.67
    rgb = np.where((age < 6.0)[:, None], 1.5 * rgb, rgb)[seen]
    strip = fit(age[seen], rgb)
    level = strip.rgb.reshape(RINGS, SAMPLES, 3).mean(axis=(1, 2))
    npt.assert_allclose(level[:5], level[6:9].mean(), rtol=0.12)


def test_the_color_has_no_seam_at_ring_boundaries() -> None:
    strip = fit(*face())
    boundary = np.arange(1.0, RINGS)
    before, after = (color_at(strip, boundary + d, SAMPLES) for d in (-1e-9, 1e-9))
    npt.assert_allclose(before, after, atol=1e-6)
    # The abrupt edge itself stays abrupt: it takes a few samples, not a good part of the ring.
    rise = color_at(strip, boundary + 2.5 / SAMPLES, SAMPLES) - color_at(strip, boundary - 2.5 / SAMPLES, SAMPLES)
    assert (rise[:, 0] > 0.7 * (EARLY - LATE)[0] * 0.85).all()


def test_lateness_grows_with_darkness_in_conifers_and_with_light_in_ring_porous_wood() -> None:
    age, rgb = face()
    strip = fit(age, rgb)
    darkness = -strip.rgb.sum(axis=1).reshape(RINGS, SAMPLES)
    late = strip.lateness.reshape(RINGS, SAMPLES)
    for ring in range(RINGS):
        assert np.corrcoef(late[ring], darkness[ring])[0, 1] > 0.95
        assert late[ring].min() < 0.1
        assert late[ring].max() > 0.9
    npt.assert_allclose(fit(age, rgb, dark=False).lateness, 1.0 - strip.lateness, atol=1e-6)
    assert (strip.lateness >= 0).all()
    assert (strip.lateness <= 1).all()


def test_exposure_scales_the_color_and_leaves_the_lateness() -> None:
    age, rgb = face(noise=0.0)
    whole, half = fit(age, rgb), fit(age, 0.5 * rgb)
    npt.assert_allclose(half.rgb, 0.5 * whole.rgb, atol=1e-4)
    npt.assert_allclose(half.lateness, whole.lateness, atol=2e-3)


def test_the_order_of_the_pixels_does_not_matter() -> None:
    age, rgb = face()
    order = np.random.default_rng(2).permutation(len(age))
    npt.assert_allclose(fit(age[order], rgb[order]).rgb, fit(age, rgb).rgb, atol=1e-6)


def test_pixels_without_weight_or_off_the_strip_do_not_count() -> None:
    age, rgb = face(count=5000)
    wanted = fit(age, rgb)
    more = np.concatenate([age, [3.3, 7.7, -0.5, RINGS + 0.2]])
    junk = np.concatenate([rgb, np.full((4, 3), 9.0)])
    weight = np.concatenate([np.ones(len(age)), [0.0, 0.0, 1.0, 1.0]])
    found = fit_color_strip(more, junk, weight, RINGS, SAMPLES, True)
    npt.assert_allclose(found.rgb, wanted.rgb, atol=1e-6)
    npt.assert_allclose(found.support, wanted.support)


def test_a_face_without_pixels_still_has_a_strip() -> None:
    strip = fit(np.zeros(0), np.zeros((0, 3)))
    assert np.isfinite(strip.rgb).all()
    assert np.isfinite(strip.lateness).all()
    npt.assert_array_equal(strip.support, 0.0)


def test_colors_are_linear_between_samples_and_hold_at_the_ends() -> None:
    strip = fit(*face(count=5000))
    npt.assert_allclose(color_at(strip, strip.age, SAMPLES), strip.rgb, atol=1e-6)
    middle = 0.5 * (strip.age[1:] + strip.age[:-1])
    npt.assert_allclose(color_at(strip, middle, SAMPLES), 0.5 * (strip.rgb[1:] + strip.rgb[:-1]), atol=1e-6)
    npt.assert_array_equal(color_at(strip, np.array([[-1.0], [99.0]]), SAMPLES)[:, 0], strip.rgb[[0, -1]])


def test_inputs_are_kept() -> None:
    age, rgb = face(count=2000)
    kept = age.copy(), rgb.copy()
    fit(age, rgb)
    npt.assert_array_equal(age, kept[0])
    npt.assert_array_equal(rgb, kept[1])


def test_psnr_of_a_tenth_is_twenty_decibels_and_looks_at_wood_only() -> None:
    wanted = np.random.default_rng(3).random((40, 50, 3))
    valid = np.ones((40, 50), bool)
    assert psnr_blurred(wanted + 0.1, wanted, valid) == pytest.approx(20.0, abs=1e-3)
    valid[:, 25:] = False
    off = wanted.copy()
    off[:, 40:] += 5.0
    # Beyond the reach of the blur, what is no wood does not count.
    assert psnr_blurred(off, wanted, valid) > 80.0


def test_faces_under_different_light_give_one_wood_and_the_light_of_each() -> None:
    age, rgb = face()
    number = np.random.default_rng(3).integers(0, 3, len(age))
    light = np.array([[1.0, 1.0, 1.0], [0.55, 0.6, 0.7], [1.3, 1.1, 0.9]])
    light /= np.exp(np.log(light).mean(axis=0))
    strip, gain = fit_balanced(age, rgb * light[number], np.ones(len(age)), number, 3, RINGS, SAMPLES, True)
    npt.assert_allclose(gain, light, rtol=0.02)
    npt.assert_allclose(strip.rgb, fit(age, rgb).rgb, atol=0.02)


def test_light_is_told_from_rings_where_faces_show_different_ones() -> None:
    age, rgb = face()
    number = (age + np.random.default_rng(4).uniform(-2.0, 2.0, len(age)) > RINGS / 2).astype(int)
    light = np.array([[1.2, 1.2, 1.2], [0.8, 0.8, 0.8]])
    _, gain = fit_balanced(age, rgb * light[number], np.ones(len(age)), number, 2, RINGS, SAMPLES, True, rounds=12)
    npt.assert_allclose(gain[0] / gain[1], 1.5, rtol=0.12)


def test_a_single_face_keeps_its_light() -> None:
    age, rgb = face()
    none = np.zeros(len(age), int)
    strip, gain = fit_balanced(age, 0.5 * rgb, np.ones(len(age)), none, 1, RINGS, SAMPLES, True)
    npt.assert_array_equal(gain, np.ones((1, 3)))
    npt.assert_array_equal(strip.rgb, fit(age, 0.5 * rgb).rgb)
