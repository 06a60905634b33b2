"""Vessels: seen in ring-porous wood and nowhere else, and their density is dark where they crowd."""

from functools import cache

import cv2
import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import SHARED, Image, conifer, needs_shared, noise, pixels, straight, wood

from woodfit import photograph
from woodfit.ring_scale import ScaleScores, reduce_by
from woodfit.synthetic_scenes import Scene, scene
from woodfit.vessels import VESSELS, crowd_by_rings, density_halo, density_signal, vessel_evidence, vessel_scale

SIZE = (240, 240)


@cache
def drawn(name: str, seed: int) -> Scene:
    return scene(name, SIZE, seed)


def grey(name: str, seed: int) -> Image:
    return photograph.grey_value(drawn(name, seed).face.rgb_encoded).astype(np.float32)


def dots(radius_px: float, spacing_px: int, depth: float = 0.3) -> Image:
    """Dark spots on a lattice, over a little noise of the sensor."""
    x, y = pixels(SIZE)
    off = [np.mod(a, spacing_px) - spacing_px / 2 for a in (x, y)]
    rim = np.clip(radius_px - np.hypot(*off) + 0.5, 0.0, 1.0)
    return np.asarray(0.7 - depth * rim + noise(SIZE, 0.01), np.float32)


def scores(peak: float, scale_px: float) -> ScaleScores:
    wavelength = np.array([8.0, 11.3, 16.0, 22.6, 32.0, 45.2])
    return ScaleScores(wavelength, peak * np.exp(-(np.log2(wavelength / scale_px) ** 2)))


@pytest.mark.parametrize(("density", "crowd"), [(0.5, True), (0.45, True), (0.35, False), (0.0, False)])
def test_vessels_make_the_rings_where_their_density_is_as_periodic_as_the_wood(density: float, crowd: bool) -> None:
    assert crowd_by_rings(scores(0.5, 22.6), scores(density, 22.6), 21.0) == crowd
    # What is periodic elsewhere does not count.
    assert not crowd_by_rings(scores(0.5, 22.6), scores(0.5, 500.0), 21.0)


# --- evidence -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_ring_porous_end_grain_shows_vessels(seed: int) -> None:
    value = grey("ring_porous_end", seed)
    assert vessel_evidence(value, wood(SIZE)) > VESSELS


@pytest.mark.parametrize("name", ["end_grain_pith", "end_grain_off", "quarter_sawn", "flat_sawn", "cathedral"])
def test_conifers_show_none(name: str) -> None:
    assert vessel_evidence(grey(name, 0), wood(SIZE)) < VESSELS


@pytest.mark.parametrize("name", ["ring_porous_end", "end_grain_off"])
def test_evidence_depends_neither_on_the_side_nor_on_the_light(name: str) -> None:
    value = grey(name, 0)
    evidence = vessel_evidence(value, wood(SIZE))
    for other in (value[:, ::-1], value[::-1], np.rot90(value), value.T, 0.4 * value, 0.5 * value + 0.3):
        again = vessel_evidence(np.ascontiguousarray(other), wood(SIZE))
        assert again == pytest.approx(evidence, rel=0.03)


def test_the_negative_of_a_picture_has_the_inverse_evidence() -> None:
    value = grey("ring_porous_end", 1)
    assert vessel_evidence(1.0 - value, wood(SIZE)) * vessel_evidence(value, wood(SIZE)) == pytest.approx(1.0, rel=0.02)


def test_spots_are_vessels_and_thin_dark_latewood_is_not() -> None:
    age = straight(SIZE, 14.0, 0.4)
    thin = 0.7 - 0.35 * (np.mod(age, 1.0) > 0.85)
    lines = cv2.GaussianBlur(thin.astype(np.float32), (0, 0), 0.7) + noise(SIZE, 0.02)
    assert vessel_evidence(lines, wood(SIZE)) < VESSELS
    assert vessel_evidence(dots(1.5, 9), wood(SIZE)) > 1.5


def test_what_is_not_wood_has_no_vessels() -> None:
    value = conifer(straight(SIZE, 14.0, 0.4)) + noise(SIZE, 0.02)
    valid = wood(SIZE)
    valid[:, 120:] = False
    speckled = np.where(valid, value, dots(1.5, 9, depth=0.6))
    assert vessel_evidence(speckled, valid) < VESSELS < vessel_evidence(speckled, wood(SIZE))
    valid[:] = False
    valid[100:120, 100:120] = True
    assert vessel_evidence(speckled, valid) == 1.0


# --- their size -----------------------------------------------------------------------------------------------------


def scale_of(value: Image, ring_scale_px: float) -> int:
    """`vessel_scale` of a picture in memory; on the way, that only parts of the scan are asked for."""
    valid = wood(value.shape)

    def window(row: int, col: int, rows: int, cols: int, step: int) -> tuple[Image, np.ndarray]:
        assert row >= 0
        assert row + rows <= value.shape[0]
        assert col >= 0
        assert col + cols <= value.shape[1]
        part = (slice(row, row + rows), slice(col, col + cols))
        return reduce_by(value[part], step), reduce_by(valid[part].astype(np.float32), step) > 0.99

    return vessel_scale(value.shape, window, ring_scale_px, window_px=160)


def test_vessels_are_seen_where_they_are_small_spots() -> None:
    assert scale_of(dots(1.5, 9), 30.0) == 1
    assert scale_of(conifer(straight(SIZE, 30.0, 0.4)) + noise(SIZE, 0.02), 30.0) == 0
    # The same wood at twice and four times the resolution, by a scanner with its own noise.
    for factor in (2, 4):
        large = cv2.resize(grey("ring_porous_end", 1), None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        found = scale_of(large + noise(large.shape, 0.02), 25.0 * factor)
        assert 1 <= found <= factor
        # Rings stay at least twenty px wide.
        assert scale_of(large, 39.0) in (0, 1)


def test_rings_too_narrow_for_a_density_have_no_vessels() -> None:
    assert scale_of(dots(1.5, 9), 13.0) == 0
    assert scale_of(dots(1.5, 9), 15.0) == 1


# --- density --------------------------------------------------------------------------------------------------------


def test_density_is_dark_in_the_pore_band_of_each_ring() -> None:
    log, face = drawn("ring_porous_end", 0).log, drawn("ring_porous_end", 0).face
    signal = density_signal(grey("ring_porous_end", 0), 1)
    fraction = np.mod(face.age, 1.0)
    share = log.palette.pore_share
    inside, outside = (fraction > 0.1) & (fraction < 0.8 * share), (fraction > share + 0.15) & (fraction < 0.9)
    assert signal.max() <= 1.0 + 1e-6
    assert np.median(signal[inside]) < np.median(signal[outside]) - signal.std()


@pytest.mark.parametrize("scale", [1, 2])
def test_only_narrow_dark_spots_count(scale: int) -> None:
    x, _ = pixels(SIZE)
    npt.assert_allclose(density_signal(np.full(SIZE, 0.4, np.float32), scale), 1.0, atol=1e-6)
    # A dark half is no vessel, nor is the step to it, nor are bright spots.
    npt.assert_allclose(density_signal(np.where(x < 120, 0.3, 0.7), scale), 1.0, atol=1e-6)
    spot = np.full(SIZE, 0.5, np.float32)
    spot[120, 120] = 0.9
    npt.assert_allclose(density_signal(spot, scale), 1.0, atol=1e-6)
    spot[120, 120] = 0.1
    dark = density_signal(spot, scale)
    assert np.unravel_index(dark.argmin(), SIZE) == (120, 120)
    # What a spot takes is spread, not lost.
    assert (1.0 - dark).sum() == pytest.approx(4.0 * 0.4, rel=1e-3)


def test_density_grows_with_the_contrast_and_not_with_the_light() -> None:
    value = grey("ring_porous_end", 0)
    signal = density_signal(value, 1)
    npt.assert_allclose(density_signal(value + 0.2, 1), signal, atol=1e-5)
    npt.assert_allclose(1.0 - density_signal(0.5 * value, 1), 0.5 * (1.0 - signal), atol=1e-5)
    turned = np.rot90(density_signal(np.rot90(value), 1), -1)
    assert np.corrcoef(turned.ravel(), signal.ravel())[0, 1] > 0.98
    npt.assert_allclose(density_signal(value[:, ::-1], 1), signal[:, ::-1], atol=1e-5)
    assert density_signal(value, 1, coarser=2.0).std() < signal.std()


@pytest.mark.parametrize("scale", [1, 2, 4])
def test_nothing_beyond_the_halo_influences_the_density(scale: int) -> None:
    value = grey("ring_porous_end", 2)
    margin = density_halo(scale)
    # Tiles start at whole blocks.
    part = (slice(112 - margin, 132 + margin), slice(116 - margin, 124 + margin))
    tile = density_signal(value[part], scale)[margin:-margin, margin:-margin]
    npt.assert_allclose(tile, density_signal(value, scale)[112:132, 116:124], atol=1e-6)


def test_inputs_are_not_modified() -> None:
    value, valid = grey("ring_porous_end", 0), wood(SIZE)
    kept = value.copy()
    vessel_evidence(value, valid)
    density_signal(value, 1)
    npt.assert_array_equal(value, kept)
    assert valid.all()


# --- real scans -----------------------------------------------------------------------------------------------------

CONIFERS = (
    "cores/mtreering_001.png",
    "cores/mtreering_incline.png",
    "cores/p105_a.tif",
    "cores/uaa_core.jpg",
    "discs/F02b.png",
    "discs/A05b.jpeg",
    "discs/B09c.jpeg",
    "discs/C08d.jpeg",
)


def real_scale(name: str, ring_scale_px: float) -> int:
    read = cv2.imread(str(SHARED / "data" / "scans" / name))
    assert read is not None, name
    height, width = read.shape[:2]
    step = max(1, -(-max(height, width) // 1200))
    encoded = np.ascontiguousarray(read[..., ::-1])
    overview = encoded[::step, ::step]
    mask = photograph.wood_mask(overview, np.ones(overview.shape[:2], bool), 0.92, 0.06)

    def window(row: int, col: int, rows: int, cols: int, by: int) -> tuple[Image, np.ndarray]:
        part = photograph.grey_value(encoded[row : row + rows, col : col + cols])
        inside = photograph.mask_window(mask, step, row, col, part.shape)
        return reduce_by(part, by), reduce_by(inside.astype(np.float32), by) > 0.99

    return vessel_scale((height, width), window, ring_scale_px)


@pytest.mark.shared
@needs_shared
@pytest.mark.parametrize("face", ["A", "B", "C", "D", "E", "F", "cut2"])
def test_the_faces_of_a_ring_porous_block_are_recognised(face: str) -> None:
    assert real_scale(f"blocks/CN03/{face}_col.png", 20.0) >= 1


@pytest.mark.shared
@needs_shared
@pytest.mark.parametrize("name", CONIFERS)
def test_scans_of_conifers_are_not_taken_for_ring_porous(name: str) -> None:
    assert real_scale(name, 80.0) == 0
