"""The scan stage and what hangs on it: grid, light, ring width, pith, mounts and vessels."""

from functools import cache
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr
from hypothesis import given as anything
from hypothesis import strategies as st
from kernel_scenes import Array
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree
from stage_scenes import SIZE, added, chain, drawn, source, true_age_at

from stages.curved_gabor import CurvedGaborParams, curved_gabor
from stages.orientation import orientation
from stages.ring_tracing import RingTracingParams, ring_tracing
from stages.scan import ScanParams, scan
from stages.stage import (
    place_in_array,
)
from stages.variables import FACE_PITH_X, FACE_PITH_Y, VESSEL_SCALE
from woodfit import photograph, ring_direction, ring_scale, vessels
from woodfit.synthetic_scenes import Scene, scene

# --- scan ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reduction", [1, 2])
def test_a_scan_in_chunks_is_the_same_and_waits_until_it_is_asked(
    reduction: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    ds = source(drawn("quarter_sawn").face.rgb_encoded)
    params = ScanParams(ring_width_px=16.0, reduction=reduction)
    eager = scan(ds, params)
    developed: list[int] = []
    develop = photograph.develop

    def watched(encoded: Any, opaque: Any) -> Any:
        developed.append(encoded.size)
        return develop(encoded, opaque)

    monkeypatch.setattr(photograph, "develop", watched)
    lazy = scan(ds.chunk({"y": 100, "x": 64}), params)
    assert sum(developed) == 0
    for name in ("rgb", "value", "valid"):
        assert lazy[name].chunks is not None
    computed = lazy.compute(scheduler="synchronous")
    assert sum(developed) > 0
    xr.testing.assert_allclose(computed, eager, atol=1e-6)
    xr.testing.assert_equal(computed["valid"], eager["valid"])


def test_rings_land_in_scan_px_at_reduced_resolution() -> None:
    ds = scan(source(drawn("quarter_sawn").face.rgb_encoded), ScanParams(reduction=2))
    for one in (orientation, curved_gabor, ring_tracing):
        ds = added(ds, one(ds, one.params_type()))
    npt.assert_array_equal(ds.x, np.arange(160) * 2 + 0.5)
    npt.assert_array_equal(ds.y, np.arange(150) * 2 + 0.5)
    assert int(ds["reduction"]) == 2
    age = true_age_at("quarter_sawn", ds["ring_x"].values, ds["ring_y"].values)
    assert np.percentile(np.abs(age - np.round(age)), 90) < 0.15
    # Ring widths and frequencies stay those of the scan.
    whole, _ = chain("quarter_sawn")
    assert float(ds["ring_scale"]) == pytest.approx(float(whole["ring_scale"]), rel=0.2)
    assert float(ds["frequency"].median()) == pytest.approx(float(whole["frequency"].median()), rel=0.1)


def test_where_the_pixels_lie_is_where_the_rings_lie() -> None:
    ds, given = chain("quarter_sawn")
    moved = ring_tracing(ds.assign_coords(x=ds.x + 1000.0, y=ds.y + 50.0), RingTracingParams())
    npt.assert_allclose(moved["ring_x"], given["ring_tracing"]["ring_x"] + 1000.0, atol=1e-6)
    npt.assert_allclose(moved["ring_y"], given["ring_tracing"]["ring_y"] + 50.0, atol=1e-6)


def test_reduced_pixels_are_means_in_linear_light() -> None:
    encoded = drawn("quarter_sawn").face.rgb_encoded
    reduced = scan(source(encoded), ScanParams(reduction=3, ring_width_px=16.0))
    linear = photograph.srgb_decode(encoded[:300, :318])
    npt.assert_allclose(reduced["rgb"], linear.reshape(100, 3, 106, 3, 3).mean(axis=(1, 3)), atol=1e-5)
    npt.assert_array_equal(reduced.y, np.arange(100) * 3 + 1.0)


def test_the_users_scale_overrules_the_files() -> None:
    ds = source(drawn("quarter_sawn").face.rgb_encoded, pixel_size_mm=0.0847)
    found = scan(ds, ScanParams(ring_width_px=16.0))
    assert float(found["pixel_size"]) == 0.0847
    assert found.attrs["warnings"] == []
    assert float(scan(ds, ScanParams(ring_width_px=16.0, pixel_size_mm=0.1))["pixel_size"]) == 0.1
    assert "No scale is known" in chain("quarter_sawn")[1]["scan"].attrs["warnings"][0]


def test_sixteen_bits_are_the_same_scan() -> None:
    encoded = drawn("quarter_sawn").face.rgb_encoded
    params = ScanParams(ring_width_px=16.0)
    # 257 * 255 = 65535
    xr.testing.assert_allclose(scan(source(encoded.astype(np.uint16) * 257), params), scan(source(encoded), params))


def test_transparent_pixels_are_not_valid() -> None:
    ds = source(drawn("quarter_sawn").face.rgb_encoded)
    ds["opaque"][:, :80] = False
    valid = scan(ds, ScanParams(ring_width_px=16.0))["valid"].values
    assert not valid[:, :80].any()
    assert valid[:, 90:].all()


def test_a_scan_of_background_is_said_to_have_no_wood() -> None:
    white = np.full((*SIZE, 3), 255, np.uint8)
    found = scan(source(white), ScanParams(ring_width_px=16.0))
    assert any("Hardly any wood" in said for said in found.attrs["warnings"])


def test_the_pith_seen_on_a_face_is_told_in_scan_px() -> None:
    drawn_pith = drawn("end_grain_pith").log.pith[:2]
    ds, _ = chain("end_grain_pith")
    npt.assert_allclose([ds["face_pith_x"], ds["face_pith_y"]], drawn_pith, atol=2.0)
    encoded = drawn("end_grain_pith").face.rgb_encoded
    reduced = scan(source(encoded), ScanParams(reduction=2))
    npt.assert_allclose([reduced["face_pith_x"], reduced["face_pith_y"]], drawn_pith, atol=2.0)
    board, _ = chain("quarter_sawn")
    assert np.isnan([board["face_pith_x"], board["face_pith_y"]]).all()
    assert place_in_array(board, FACE_PITH_X, FACE_PITH_Y) is None
    known = scan(source(encoded), ScanParams(pith_px=(12.5, -30.0), ring_width_px=16.0))
    assert (float(known["face_pith_x"]), float(known["face_pith_y"])) == (12.5, -30.0)


@anything(st.integers(1, 9), st.floats(-500, 500), st.floats(-500, 500), st.integers(0, 40))
def test_a_place_in_the_scan_is_found_in_the_array(step: int, x: float, y: float, start: int) -> None:
    first = start * step + (step - 1) / 2
    ds = xr.Dataset(
        {FACE_PITH_X.name: FACE_PITH_X.array(np.float64(x)), FACE_PITH_Y.name: FACE_PITH_Y.array(np.float64(y))},
        coords={"y": np.arange(30) * step + first, "x": np.arange(20) * step + first},
    )
    place = place_in_array(ds, FACE_PITH_X, FACE_PITH_Y)
    assert place is not None
    npt.assert_allclose(np.array(place) * step + first, (x, y), atol=1e-9)
    half = ds.assign({FACE_PITH_Y.name: FACE_PITH_Y.array(np.float64(np.nan))})
    assert place_in_array(half, FACE_PITH_X, FACE_PITH_Y) is None


def circles(radius: float, side: int = 300, ring_px: float = 16.0) -> Array:
    """Rings that go through the middle of the picture at a radius; infinite for straight ones."""
    y, x = np.mgrid[:side, :side] - 0.5 * (side - 1)
    away = x if np.isinf(radius) else np.hypot(x + radius, y)
    return np.asarray(0.5 + 0.3 * np.cos(2 * np.pi * away / ring_px), np.float32)


def run_of(
    value: Array, ring_px: float = 16.0, step: int = 1, thick_px: float | None = None, rays: bool = False
) -> float:
    """`straight_run` of a picture that is wood all over."""

    def window(row: int, col: int, rows: int, cols: int, step: int) -> tuple[Array, Array]:
        part = ring_scale.reduce_by(value[row : row + rows, col : col + cols], step)
        return part, np.ones(part.shape, bool)

    return ring_direction.straight_run(value.shape, window, ring_px, step, thick_px=thick_px, rays=rays)


def test_rings_may_be_followed_a_part_of_their_radius() -> None:
    runs = {radius: run_of(circles(radius)) for radius in (200.0, 400.0, 800.0, np.inf)}
    for radius in (200.0, 400.0, 800.0):
        assert 0.04 * radius < runs[radius] < 0.09 * radius
    # Straight rings: a quarter of the wood's thickness.
    assert runs[200.0] < runs[400.0] < runs[800.0] < runs[np.inf] == 0.25 * 300
    assert run_of(circles(np.inf), thick_px=80.0) == 20.0
    assert run_of(circles(200.0), thick_px=80.0) == runs[200.0]


@pytest.mark.parametrize("radius", [200.0, 600.0])
def test_the_straight_run_scales_with_the_picture(radius: float) -> None:
    value = circles(radius)
    twice = np.kron(value, np.ones((2, 2), np.float32))
    assert run_of(twice, ring_px=32.0, step=2) == pytest.approx(2.0 * run_of(value), rel=1e-3)
    assert run_of(value.T) == pytest.approx(run_of(value), rel=0.01)


def test_where_noise_drowns_the_rings_the_broad_look_says_how_straight_they_are() -> None:
    value = circles(800.0)
    drowned = (0.5 * value + np.random.default_rng(1).normal(0.0, 0.8, value.shape)).astype(np.float32)
    assert run_of(drowned) < 0.6 * run_of(drowned, rays=True) < run_of(value)
    # Where the rings are clear, bends are never blunted.
    assert run_of(value, rays=True) == run_of(value)


def test_where_there_is_no_wood_the_straight_run_is_bounded_all_the_same() -> None:
    def window(row: int, col: int, rows: int, cols: int, step: int) -> tuple[Array, Array]:
        return np.zeros((rows, cols), np.float32), np.zeros((rows, cols), bool)

    assert ring_direction.straight_run((200, 300), window, 16.0, 1) == 50.0


# --- wood on a mount -------------------------------------------------------------------------------------------------

MOUNTS = {"white": ((250, 250, 250), 1.0), "black": ((6, 6, 6), 1.0), "blue": ((40, 60, 140), 2.0)}
MARGIN = 40


def mounted(encoded: Array, mount: str) -> Array:
    """A scan laid on a mount of one color with some noise, `MARGIN` px wide all round."""
    color, sigma = MOUNTS[mount]
    height, width = encoded.shape[:2]
    shape = (height + 2 * MARGIN, width + 2 * MARGIN, 3)
    laid = np.random.default_rng(0).normal(color, sigma, shape).clip(0, 255).round().astype(np.uint8)
    laid[MARGIN:-MARGIN, MARGIN:-MARGIN] = encoded
    return laid


def traced(encoded: Array) -> xr.Dataset:
    """All variables after ring tracing."""
    ds = source(encoded)
    for one in (scan, orientation, curved_gabor, ring_tracing):
        ds = added(ds, one(ds, one.params_type()))
    return ds


@cache
def core() -> tuple[Scene, xr.Dataset]:
    found = scene("core", SIZE, 0)
    return found, traced(found.face.rgb_encoded)


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_core_on_a_mount_has_the_rings_of_the_core(mount: str) -> None:
    bare, alone = core()
    ds = traced(mounted(bare.face.rgb_encoded, mount))
    height, width = bare.face.age.shape
    points = [
        np.stack([d["ring_x"], d["ring_y"]], axis=1) - margin for d, margin in ((alone, 0.0), (ds, float(MARGIN)))
    ]
    index = [np.repeat(d["ring_index"].values, d["vertex_count"].values) for d in (alone, ds)]
    # The rim of the core may be lost with its mount.
    inside = [((p > 6.0) & (p < np.array([width, height]) - 7.0)).all(axis=1) for p in points]
    for one, other in ((0, 1), (1, 0)):
        assert inside[one].sum() > 1500
        distance, nearest = cKDTree(points[other]).query(points[one][inside[one]])
        assert (distance < 2.0).mean() > 0.95
        # The numbers may begin elsewhere, but run alike.
        shift = index[other][nearest] - index[one][inside[one]]
        assert (shift == np.median(shift)).mean() > 0.95
    assert bool(ds["bright_outwards"]) == bool(alone["bright_outwards"])
    assert float(ds["ring_scale"]) == pytest.approx(float(alone["ring_scale"]), rel=0.05)
    age = map_coordinates(bare.face.age.astype(float), points[1][inside[1]].T[::-1], order=1, mode="nearest")
    assert np.percentile(np.abs(age - np.round(age)), 90) < 0.1


def arches(shape: tuple[int, int], radius: float, outwards: bool) -> Array:
    """Rings that arch about a point on the right, with edges that brighten away from it or towards it."""
    y, x = np.mgrid[: shape[0], : shape[1]] - 0.5 * (np.array(shape)[:, None, None] - 1)
    age = np.hypot(x - radius, y) / (16.0 if outwards else -16.0)
    value = 0.8 - 0.35 * (age % 1.0) ** 2 + np.random.default_rng(0).normal(0.0, 0.02, shape)
    return np.asarray((255 * np.clip(value[..., None] * (0.95, 0.75, 0.55), 0, 1)).round(), np.uint8)


@pytest.mark.parametrize("outwards", [True, False])
def test_bends_say_the_kind_of_wood_only_where_rings_turn_within_it(outwards: bool) -> None:
    # Over the width of a core they turn by two degrees: it is a conifer's, however they bend.
    assert bool(traced(mounted(arches((64, 640), 1500.0, outwards), "blue"))["bright_outwards"])
    assert bool(traced(mounted(arches(SIZE, 250.0, outwards), "blue"))["bright_outwards"]) == outwards


# --- wood with vessels -----------------------------------------------------------------------------------------------


@cache
def porous() -> tuple[Scene, xr.Dataset]:
    """Ring-porous end grain, up to its traced rings."""
    found = scene("ring_porous_end", SIZE, 0)
    ds = source(found.face.rgb_encoded)
    for one in (scan, orientation, curved_gabor, ring_tracing):
        ds = added(ds, one(ds, one.params_type()))
    return found, ds


def test_rings_of_ring_porous_wood_are_sought_in_the_density_of_its_vessels() -> None:
    found, ds = porous()
    assert int(ds["vessel_scale"]) == 1
    dense = vessels.density_signal(photograph.grey_value(found.face.rgb_encoded), 1)
    npt.assert_allclose(ds["value"], dense, atol=1e-5)
    assert not bool(ds["bright_outwards"])
    age = map_coordinates(found.face.age.astype(float), [ds["ring_y"], ds["ring_x"]], order=1, mode="nearest")
    assert np.percentile(np.abs(age - np.round(age)), 80) < 0.15
    # Nearly every boundary that runs through a good part of the face is there.
    ages, counts = np.unique(np.round(found.face.age), return_counts=True)
    assert set(ages[counts > 0.5 * np.median(counts)]) <= set(np.round(age))
    assert set(chain("quarter_sawn")[0]["vessel_scale"].values.ravel()) == {0}


def test_the_user_says_whether_vessels_count() -> None:
    encoded = porous()[0].face.rgb_encoded
    grey = scan(source(encoded), ScanParams(ring_porous=False, ring_width_px=20.0))
    assert int(grey["vessel_scale"]) == 0
    npt.assert_allclose(grey["value"], photograph.grey_value(encoded), atol=1e-6)
    conifer = drawn("quarter_sawn").face.rgb_encoded
    dense = scan(source(conifer), ScanParams(ring_porous=True, ring_width_px=16.0))
    assert int(dense["vessel_scale"]) == 1
    npt.assert_allclose(dense["value"], vessels.density_signal(photograph.grey_value(conifer), 1), atol=1e-5)


@pytest.mark.parametrize("reduction", [1, 2])
def test_the_density_of_vessels_in_chunks_is_that_of_the_whole(reduction: int) -> None:
    ds = source(porous()[0].face.rgb_encoded)
    params = ScanParams(ring_width_px=20.0, reduction=reduction)
    lazy = scan(ds.chunk({"y": 100, "x": 64}), params)
    assert lazy["value"].chunks is not None
    eager = scan(ds, params)
    assert int(eager["vessel_scale"]) == 1
    xr.testing.assert_allclose(lazy.compute(scheduler="synchronous"), eager, atol=1e-5)


def test_the_region_of_the_filter_is_that_of_the_docs() -> None:
    ds, given = chain("quarter_sawn")
    sigma = float(np.clip(ds["straight_run"], 10.0, 27.0))
    said = CurvedGaborParams(sigma_along=sigma, q=int(np.ceil(3 * sigma)), cycles=0.5)
    xr.testing.assert_identical(curved_gabor(ds, said), given["curved_gabor"])
    # Vessels are a narrow peak in each ring, and their density is noisy: the window across is shorter, and widths far
    # from the characteristic one are believed less.
    for_vessels = ds.assign(vessel_scale=VESSEL_SCALE.array(np.int64(1)))
    shorter = curved_gabor(ds, CurvedGaborParams(sigma_along=sigma, cycles=0.4, spread_octaves=1.2))
    xr.testing.assert_identical(curved_gabor(for_vessels, CurvedGaborParams()), shorter)
    assert not shorter["explained"].equals(given["curved_gabor"]["explained"])
    assert curved_gabor.halo is not None
    assert curved_gabor.halo(ds, CurvedGaborParams(q=120)) > curved_gabor.halo(ds, CurvedGaborParams(q=30))
