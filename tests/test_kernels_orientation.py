"""Orientation, walks along the rings, the scan's scale and the field of frequency, on wood drawn for it."""

import itertools

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import Image, angle_between, conifer, noise, pixels, round_age, straight, wave, wood

from woodfit.frequency import ROUNDS, log_bank, smooth_frequency
from woodfit.ring_scale import ScaleScores, reduce_by, ring_scale, scale_scores
from woodfit.streamlines import MARGIN_PX, smooth_along
from woodfit.structure_tensor import halo, orientation
from woodfit.synthetic_scenes import scene
from woodfit.wave_bank import fit_bank
from woodfit.wave_fit import fit_across

INSIDE = (slice(24, -24), slice(24, -24))


def board(side: int = 256) -> Image:
    return (scene("cathedral", (side, side), 3).face.rgb_encoded.max(axis=-1) / 255.0).astype(np.float32)


# --- orientation --------------------------------------------------------------------------------------------
@pytest.mark.parametrize("degrees", [0, 1, 17, 44, 45, 46, 89, 90, 91, 135, 178, 179])
def test_the_orientation_of_a_grating_is_its_tangent(degrees: float) -> None:
    shape, tangent = (120, 130), np.radians(degrees)
    angle, coherence = orientation(wave(straight(shape, 12.0, tangent)), wood(shape), 1.0, 5.0)
    assert angle_between(angle, tangent)[INSIDE].max() < np.radians(0.15)
    assert angle_between(angle, tangent).max() < np.radians(4.0)
    assert coherence[INSIDE].min() > 0.999
    assert angle.min() >= 0.0
    assert angle.max() <= np.pi


def test_orientations_on_both_sides_of_the_wrap_average_to_it_and_not_to_its_normal() -> None:
    shape = (120, 160)
    x, y = pixels(shape)
    arch = (y + 0.0006 * (x - 80) ** 2) / 10.0
    angle, _ = orientation(wave(arch), wood(shape), 1.0, 8.0)
    assert angle[60, 30] > 0.0
    assert angle_between(angle[60, 75:86], 0.0).max() < np.radians(1.5)
    assert angle_between(angle[60, 40], np.arctan(-0.0012 * (40 - 80))) < np.radians(1.5)


def test_the_orientation_of_rings_is_at_right_angles_to_the_radius() -> None:
    shape = (200, 200)
    age, outwards = round_age(shape, (100.0, 100.0), 12.0)
    angle, _ = orientation(wave(age), wood(shape), 1.0, 5.0)
    away = (age > 3) & (age < 8)
    assert angle_between(angle, outwards + np.pi / 2)[away].max() < np.radians(1.0)


@pytest.mark.parametrize("tangent_deg", [90.0, 75.0])
def test_light_that_falls_off_along_the_rings_does_not_turn_them(tangent_deg: float) -> None:
    # A round core: half as bright at its rims, where that is steeper than the rings.
    shape, tangent = (100, 500), np.radians(tangent_deg)
    rim = ((pixels(shape)[1] - 49.5) / 50.0) ** 2
    value = wave(straight(shape, 25.0, tangent), 0.1, 0.6) * (1.0 - 0.5 * rim)
    angle, _ = orientation(value.astype(np.float32), wood(shape), 3.0, 20.0)
    assert np.percentile(angle_between(angle, tangent), 99) < np.radians(7.0)


def scratched(pith: tuple[float, float], shape: tuple[int, int] = (200, 220)) -> tuple[Image, np.ndarray]:
    """Rings about a pith, and over a wedge of them rays that are stronger than the rings; the tangent."""
    age, outwards = round_age(shape, pith, 12.0)
    wedge = np.abs(np.angle(np.exp(1j * (outwards - 0.7)))) < 0.3
    rays = 0.5 * np.cos(60.0 * outwards) * np.clip(age - 2.0, 0.0, 1.0)
    return (wave(age) + wedge * rays + noise(shape, 0.01)).astype(np.float32), outwards + np.pi / 2


def test_where_the_pith_is_seen_rays_do_not_count() -> None:
    pith, shape = (70.0, 60.0), (200, 220)
    value, tangent = scratched(pith)
    age, outwards = round_age(shape, pith, 12.0)
    rayed = (np.abs(outwards - 0.7) < 0.2) & (age > 4)
    blind, _ = orientation(value, wood(shape), 1.0, 6.0)
    seeing, coherence = orientation(value, wood(shape), 1.0, 6.0, pith)
    assert np.median(angle_between(blind, tangent)[rayed]) > np.radians(60.0)
    assert np.percentile(angle_between(seeing, tangent)[rayed], 95) < np.radians(12.0)
    assert np.isfinite(seeing).all()
    assert coherence.min() >= 0.0
    assert coherence.max() <= 1.0


def test_a_pith_hardly_changes_rings_that_go_round_it() -> None:
    shape = (200, 200)
    age, outwards = round_age(shape, (100.0, 100.0), 12.0)
    plain, _ = orientation(wave(age), wood(shape), 1.0, 5.0)
    seeing, _ = orientation(wave(age), wood(shape), 1.0, 5.0, (100.0, 100.0))
    tangent = outwards + np.pi / 2
    inside = (age > 3) & (age < 7.5)
    assert angle_between(seeing, tangent)[inside].max() < np.radians(1.5)
    # At the border half of the window is missing: there the circle helps.
    assert angle_between(seeing, tangent)[age > 3].max() < angle_between(plain, tangent)[age > 3].max()


def test_rings_that_are_no_circles_keep_their_own_direction() -> None:
    shape = (200, 200)
    x, y = pixels(shape)
    # Ellipses, half as wide again as high.
    inner, outer = (x - 100) / 1.5, y - 100
    value = wave(np.hypot(inner, outer) / 10.0)
    tangent = np.arctan2(outer, inner / 1.5) + np.pi / 2
    angle, _ = orientation(value, wood(shape), 1.0, 5.0, (100.0, 100.0))
    away = np.hypot(inner, outer) > 25
    circle = np.arctan2(outer, x - 100) + np.pi / 2
    assert angle_between(circle, tangent)[away].max() > np.radians(20.0)
    # The circle has less than a third of the say.
    assert angle_between(angle, tangent)[away].max() < np.radians(8.0)


def test_orientation_about_a_pith_turns_with_the_image_and_moves_with_its_tile() -> None:
    pith, shape = (70.0, 60.0), (200, 220)
    value, _ = scratched(pith)
    angle, _ = orientation(value, wood(shape), 1.0, 6.0, pith)
    for turned, moved, expected in (
        (np.rot90(value), (pith[1], 219 - pith[0]), np.rot90(angle - np.pi / 2)),
        (value[:, ::-1], (219 - pith[0], pith[1]), -angle[:, ::-1]),
        (value.T, pith[::-1], np.pi / 2 - angle.T),
    ):
        other, _ = orientation(np.ascontiguousarray(turned), wood(turned.shape), 1.0, 6.0, moved)
        assert np.percentile(angle_between(other, expected), 99) < 1e-2
    margin = 64
    tile, _ = orientation(value[64:, 64:], wood((136, 156)), 1.0, 6.0, (pith[0] - 64, pith[1] - 64))
    assert np.percentile(angle_between(tile[margin:, margin:], angle[128:, 128:]), 99) < 1e-3


def rayed(shape: tuple[int, int] = (300, 340)) -> tuple[Image, np.ndarray]:
    """Bent rings of 20 px crossed by rays that are narrower and in places three times as strong; the tangent."""
    age, outwards = round_age(shape, (-300.0, 500.0), 20.0)
    strong = 0.5 + 0.5 * np.cos(2 * np.pi * pixels(shape)[0] / 170.0)
    rays = 0.6 * strong * np.cos(500.0 * outwards)
    return (wave(age) + rays + noise(shape, 0.05)).astype(np.float32), outwards + np.pi / 2


def test_rays_stand_across_the_rings_and_speak_for_them() -> None:
    value, tangent = rayed()
    misled, _ = orientation(value, wood(value.shape), 2.4, 16.0)
    assert (angle_between(misled, tangent) > np.pi / 4).mean() > 0.2
    assert angle_between(misled, tangent).max() > np.radians(80.0)
    angle, coherence = orientation(value, wood(value.shape), 2.4, 16.0, rays=True)
    # Where both are about as strong, what is left of each is noise.
    assert np.median(angle_between(angle, tangent)) < np.radians(2.5)
    assert np.percentile(angle_between(angle, tangent), 99) < np.radians(25.0)
    assert coherence.mean() > 0.5


def test_wood_without_rays_keeps_its_direction_when_rays_are_thought_of() -> None:
    shape = (300, 320)
    age, outwards = round_age(shape, (-60.0, 150.0), 16.0)
    angle, _ = orientation(wave(age) + noise(shape, 0.02), wood(shape), 2.0, 12.8, rays=True)
    assert np.percentile(angle_between(angle, outwards + np.pi / 2)[INSIDE], 99) < np.radians(4.0)


def test_orientation_turns_with_the_image() -> None:
    value = board()
    angle, coherence = orientation(value, wood(value.shape), 1.0, 6.0)
    for turned, expected in (
        (np.rot90(value), np.rot90(angle - np.pi / 2)),
        (value[:, ::-1], -angle[:, ::-1]),
        (value[::-1], -angle[::-1]),
        (value.T, np.pi / 2 - angle.T),
    ):
        other, _ = orientation(np.ascontiguousarray(turned), wood(turned.shape), 1.0, 6.0)
        assert angle_between(other, expected).max() < 2e-3
    assert coherence.mean() > 0.3


def test_orientation_does_not_depend_on_the_grey_scale() -> None:
    value = board()
    angle, coherence = orientation(value, wood(value.shape), 1.0, 6.0)
    other, as_coherent = orientation(0.3 - 0.2 * value, wood(value.shape), 1.0, 6.0)
    clear = coherence > 0.3
    assert angle_between(angle, other)[clear].max() < 1e-2
    npt.assert_allclose(coherence[clear], as_coherent[clear], atol=1e-2)


def test_the_edge_of_the_wood_is_not_a_ring() -> None:
    shape = (160, 160)
    x, y = pixels(shape)
    valid = np.hypot(x - 80, y - 80) < 60
    value = np.where(valid, wave(straight(shape, 10.0, 0.4)), 1.0).astype(np.float32)
    angle, _ = orientation(value, valid, 1.0, 5.0)
    assert angle_between(angle, 0.4)[valid].max() < np.radians(6.0)
    assert np.median(angle_between(angle, 0.4)[valid]) < np.radians(0.5)


@pytest.mark.parametrize(("window", "rays"), [(7.0, False), (18.0, False), (7.0, True)])
@pytest.mark.parametrize(("row", "col"), [(128, 192), (0, 64)])
def test_a_tile_with_its_halo_has_the_orientation_of_the_whole(row: int, col: int, window: float, rays: bool) -> None:
    value = board(512 if rays else 384)
    valid = wood(value.shape)
    valid[:, 250:300] = False
    whole, coherent = orientation(value, valid, 1.5, window, rays=rays)
    # Tiles start on a grid of 64 px.
    margin = -(-halo(1.5, window, rays) // 64) * 64
    top, left = max(0, row - margin), max(0, col - margin)
    part = (slice(top, row + 64 + margin), slice(left, col + 64 + margin))
    angle, coherence = orientation(value[part], valid[part], 1.5, window, rays=rays)
    inner = (slice(row - top, row - top + 64), slice(col - left, col - left + 64))
    tile = (slice(row, row + 64), slice(col, col + 64))
    clear = coherent[tile] > 0.01
    assert angle_between(angle[inner], whole[tile])[clear].max() < 1e-3
    npt.assert_allclose(coherence[inner], coherent[tile], atol=1e-4)


# --- walks --------------------------------------------------------------------------------------------------
def test_a_walk_along_a_circle_does_not_drift() -> None:
    shape = (261, 261)
    radius, outwards = round_age(shape, (130.0, 130.0), 1.0)
    smooth, support = smooth_along(radius, wood(shape), outwards + np.pi / 2, 80, 1e6)
    drift = smooth - radius
    for low, high, most in ((10, 20, 0.4), (20, 60, 0.25), (60, 120, 0.12)):
        ring = (radius >= low) & (radius < high)
        assert np.abs(drift[ring]).max() < most
        assert abs(drift[ring].mean()) < 0.05
    npt.assert_allclose(support[radius < 120], 1.0, atol=1e-4)


def test_smoothing_along_the_rings_keeps_them_and_removes_noise() -> None:
    shape = (200, 200)
    age, outwards = round_age(shape, (20.0, -60.0), 10.0)
    clean = wave(age)
    smooth, _ = smooth_along(clean + noise(shape, 0.2), wood(shape), outwards + np.pi / 2, 40, 15.0)
    error = (smooth - clean)[40:-40, 40:-40]
    assert error.std() < 0.2 / np.sqrt(15.0 * 2 * np.sqrt(np.pi)) * 1.3


def test_what_has_no_weight_does_not_count() -> None:
    shape = (90, 120)
    value = wave(straight(shape, 9.0, 0.0))
    weight = wood(shape)
    weight[:, 50:60] = False
    blotted = np.where(weight, value, 7.0)
    smooth, support = smooth_along(blotted, weight, np.zeros(shape), 30, 10.0)
    npt.assert_allclose(smooth, value, atol=1e-5)
    assert support[45, 55] < support[45, 100]
    nothing, none = smooth_along(value, np.zeros(shape), np.zeros(shape), 30, 10.0)
    assert not nothing.any()
    assert not none.any()


def test_a_wave_is_fitted_without_bias_at_the_border() -> None:
    shape = (60, 200)
    age = straight(shape, 20.0, -np.pi / 2)
    rows, cols = np.array([30, 30, 30]), np.array([0, 100, 199])
    response, explained = fit_across(
        wave(age, phase=0.6), np.ones(shape), np.zeros(shape), rows, cols, np.full(3, 0.05), 80, 0.5
    )
    truth = 0.2 * np.exp(1j * (2 * np.pi * age[rows, cols] + 0.6))
    assert np.abs(np.angle(response / truth)).max() < 0.25
    assert abs(np.angle(response[1] / truth[1])) < 0.01
    assert np.abs(np.abs(response) / 0.2 - 1.0).max() < 0.2
    assert explained.min() > 0.95


def test_a_bank_of_waves_is_fitted_like_each_of_them() -> None:
    value = board()
    weight = wood(value.shape)
    weight[:, 100:112] = False
    angle, _ = orientation(value, weight, 1.0, 6.0)
    smooth, support = smooth_along(value, weight, angle, 20, 8.0)
    rows, cols = (a.ravel() for a in np.mgrid[0:256:15, 0:256:15])
    # No longer than the samples of a wave are pixels apart.
    bank = 1.0 / np.array([5.0, 8.0, 12.5, 16.0])
    place = (smooth, support, angle + np.pi / 2, rows, cols)
    together, shares = fit_bank(*place, bank, 40, 0.5)
    for k, frequency in enumerate(bank):
        alone, share = fit_across(*place, np.full(rows.size, frequency), 40, 0.5)
        npt.assert_allclose(together[:, k], alone, atol=1e-4)
        npt.assert_allclose(shares[:, k], share, atol=5e-3)


@pytest.mark.parametrize("width", [20.0, 40.0, 70.0])
def test_long_waves_walked_in_long_steps_keep_amplitude_and_phase(width: float) -> None:
    shape = (260, 260)
    age, outwards = round_age(shape, (-90.0, 120.0), width)
    rows, cols = (a.ravel() for a in np.mgrid[110:150:7, 110:150:7])
    response, explained = fit_across(
        wave(age, phase=0.4), np.ones(shape), outwards, rows, cols, np.full(rows.size, 1 / width), 110, 0.5
    )
    relative = response / (0.2 * np.exp(1j * (2 * np.pi * age[rows, cols] + 0.4)))
    npt.assert_allclose(np.abs(relative), 1.0, atol=0.03)
    npt.assert_allclose(np.angle(relative), 0.0, atol=0.03)
    # The damping of the fit, 2 x 0.02, keeps it from 1.
    assert explained.min() > 0.96


def test_far_from_the_wood_nothing_is_smoothed_and_nothing_changes_on_it() -> None:
    shape = (120, 140)
    x, y = pixels(shape)
    valid = np.hypot(x - 60, y - 60) < 30
    value = wave(straight(shape, 9.0, 0.5)) + noise(shape, 0.05)
    smooth, support = smooth_along(value, valid, np.full(shape, 0.5), 30, 10.0)
    far = np.maximum(np.abs(x - 60), np.abs(y - 60)) > 30 + MARGIN_PX
    assert not smooth[far].any()
    assert not support[far].any()
    assert support[valid].min() > 0.1
    cropped = smooth_along(value[25:95, 25:95], valid[25:95, 25:95], np.full((70, 70), 0.5), 30, 10.0)[0]
    npt.assert_allclose(cropped[valid[25:95, 25:95]], smooth[valid], atol=2e-5)


# --- scale and frequency ------------------------------------------------------------------------------------
def test_the_scale_of_a_strip_is_not_that_of_the_shading_across_it() -> None:
    face = scene("core").face
    shape = face.age.shape
    x, y = pixels(shape)
    light = 1.0 - 1.2 * ((x / shape[1] - 0.5) ** 2 + (y / shape[0] - 0.5) ** 2)
    value = (face.rgb_encoded.max(axis=-1) / 255.0 * light).astype(np.float32)

    def window(row: int, col: int, rows: int, cols: int, step: int) -> tuple[np.ndarray, np.ndarray]:
        part = reduce_by(value[row : row + rows, col : col + cols], step)
        return part, wood(part.shape)

    assert 12.0 < ring_scale(shape, scale_scores(shape, window)) < 20.0


@pytest.mark.parametrize(
    ("width", "tangent"), [(6, 0.3), (8, 1.2), (12, 0.0), (20, 2.0), (32, 1.57), (50, 0.8), (80, 0.3)]
)
@pytest.mark.parametrize("draw", [wave, conifer])
def test_the_scale_of_a_scan_is_the_width_of_its_rings(width: float, tangent: float, draw: type) -> None:
    shape = (500, 600)
    value = draw(straight(shape, width, tangent)) + noise(shape, 0.03)
    valid = wood(shape)

    def window(row: int, col: int, rows: int, cols: int, step: int) -> tuple[Image, np.ndarray]:
        part = (slice(row, row + rows), slice(col, col + cols))
        return reduce_by(value[part], step), reduce_by(valid[part].astype(np.float32), step) > 0.5

    assert abs(np.log2(ring_scale(shape, scale_scores(shape, window)) / width)) < 0.12


def test_what_is_periodic_in_one_of_two_signals_only_is_not_the_width_of_the_rings() -> None:
    shape = (500, 600)
    rings, bands, pores = (straight(shape, width, 0.3) for width in (20.0, 113.0, 10.0))
    signals = (wave(rings) + wave(pores, 0.3), wave(rings) + wave(bands, 0.4))
    valid = wood(shape)

    def scores(value: Image) -> ScaleScores:
        def window(row: int, col: int, rows: int, cols: int, step: int) -> tuple[Image, np.ndarray]:
            part = (slice(row, row + rows), slice(col, col + cols))
            return reduce_by(value[part], step), reduce_by(valid[part].astype(np.float32), step) > 0.5

        return scale_scores(shape, window)

    one, other = (scores(value + noise(shape, 0.03)) for value in signals)
    assert abs(np.log2(ring_scale(shape, one) / 20.0)) > 0.5
    assert abs(np.log2(ring_scale(shape, other) / 20.0)) > 0.5
    assert abs(np.log2(ring_scale(shape, one.with_other(other)) / 20.0)) < 0.25


def test_reduction_is_a_mean_over_blocks() -> None:
    image = np.random.default_rng(0).random((13, 17)).astype(np.float32)
    npt.assert_allclose(reduce_by(image, 4), image[:12, :16].reshape(3, 4, 4, 4).mean(axis=(1, 3)), rtol=1e-5)
    assert reduce_by(image, 1) is image


def bell(bank: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Evidence of shape (F, M, N) around a frequency per cell."""
    return np.exp(-0.5 * (np.log2(bank[:, None, None] / frequency[None]) / 0.4) ** 2)


def test_the_bank_is_even_in_the_logarithm_and_covers_its_range() -> None:
    bank = log_bank(5.0, 80.0, 5)
    assert bank[0] == pytest.approx(1 / 80)
    assert bank[-1] == pytest.approx(1 / 5)
    npt.assert_allclose(np.diff(np.log2(bank)), 0.2, rtol=1e-5)


def test_frequency_is_found_between_those_of_the_bank_and_lone_cells_are_overruled() -> None:
    bank = log_bank(5.0, 80.0, 5)
    truth = np.full((24, 30), 0.061)
    truth[:, 15:] = 0.09
    evidence = bell(bank, truth)
    for row, col in itertools.product((5, 12, 19), (4, 9, 20, 26)):
        evidence[:, row, col] = bell(bank, np.full((1, 1), 0.03))[:, 0, 0]
    frequency, sureness = smooth_frequency(evidence, bank, 1.5, 0.1)
    away = np.abs(np.arange(30) - 14.5) > 4
    assert np.abs(np.log2(frequency / truth))[:, away].max() < 0.1
    assert sureness.min() > 0.0
    assert sureness.max() <= 1.0


def test_frequency_is_smooth_where_the_evidence_is_torn() -> None:
    bank = log_bank(5.0, 80.0, 5)
    slope = 0.03 * 2.0 ** (np.arange(40) / 20.0)[None, :].repeat(30, axis=0)
    rng = np.random.default_rng(1)
    evidence = bell(bank, slope) * rng.random((bank.size, 30, 40)) ** 2
    strongest = bank[evidence.argmax(axis=0)]
    frequency, _ = smooth_frequency(evidence, bank, 2.0, 0.1)

    def jump(field: np.ndarray) -> float:
        return float(np.diff(np.log2(field), axis=1).std())

    assert jump(frequency) < 0.3 * jump(strongest)
    assert np.abs(np.log2(frequency / slope)).mean() < 0.15


def test_a_cell_depends_on_a_bounded_neighbourhood() -> None:
    bank = log_bank(5.0, 80.0, 5)
    rng = np.random.default_rng(2)
    evidence = rng.random((bank.size, 40, 44))
    whole, _ = smooth_frequency(evidence, bank, 1.2, 0.1)
    reach = ROUNDS + 3
    part, _ = smooth_frequency(evidence[:, 14 - reach : 24 + reach, 15 - reach : 25 + reach], bank, 1.2, 0.1)
    npt.assert_allclose(part[reach : reach + 10, reach : reach + 10], whole[14:24, 15:25], rtol=1e-5)


def test_inputs_are_not_modified() -> None:
    value, valid = board(96), wood((96, 96))
    angle = np.full((96, 96), 0.3, np.float32)
    kept = value.copy(), valid.copy(), angle.copy()
    orientation(value, valid, 1.0, 4.0)
    smooth_along(value, valid, angle, 10, 4.0)
    bank = log_bank(5.0, 40.0, 3)
    evidence = np.random.default_rng(0).random((bank.size, 9, 9)).astype(np.float32)
    before = evidence.copy()
    smooth_frequency(evidence, bank, 1.0, 0.1)
    for now, then in ((value, kept[0]), (valid, kept[1]), (angle, kept[2]), (evidence, before)):
        npt.assert_array_equal(now, then)
