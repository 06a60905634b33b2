"""The stages on small scenes with known truth: contract, chain from photograph to texture, laziness, the user's word.

In the order of the data: scan, orientation, curved_gabor, ring_tracing, pose, initial_distortion, phase_polishing,
color_map.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr
from hypothesis import given as anything
from hypothesis import strategies as st
from kernel_scenes import SHARED, Array, needs_shared, wrapped
from pydantic import ValidationError
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from stages import STAGES
from stages.color_map import ColorMapParams, color_map
from stages.curved_gabor import CurvedGaborParams, curved_gabor
from stages.faces import single_face
from stages.initial_distortion import InitialDistortionParams, initial_distortion
from stages.orientation import orientation
from stages.phase_polishing import phase_polishing
from stages.polylines import polylines_of
from stages.pose import PoseParams, pose
from stages.products import solid_texture_of, write_rings, write_texture
from stages.ring_tracing import RingTracingParams, ring_tracing
from stages.scan import ScanParams, scan
from stages.stage import (
    ContractError,
    Params,
    Stage,
    Variable,
    check_variables,
    like_image,
    place_in_array,
    scalar,
    stage,
)
from stages.variables import FACE_PITH_X, FACE_PITH_Y, VESSEL_SCALE
from woodfit import SolidTexture, photograph, ring_direction, ring_scale, vessels
from woodfit.color_strip import psnr_blurred
from woodfit.synthetic_scenes import Scene, scene

SIZE = (300, 320)
SCENES = ("quarter_sawn", "end_grain_pith")
each_stage = pytest.mark.parametrize("one", STAGES, ids=lambda one: one.name)
each_scene = pytest.mark.parametrize("name", SCENES)


def source(encoded: Array, pixel_size_mm: float = np.nan) -> xr.Dataset:
    """What the pipeline reads from a file."""
    height, width = encoded.shape[:2]
    one = {"units": "1"}
    return xr.Dataset(
        {
            "encoded": (("y", "x", "channel"), encoded, one),
            "opaque": (("y", "x"), np.ones((height, width), bool), one),
            "dpi_pixel_size": ((), pixel_size_mm, {"units": "mm"}),
        },
        coords={"y": np.arange(height, dtype=float), "x": np.arange(width, dtype=float)},
    )


def added(ds: xr.Dataset, result: xr.Dataset) -> xr.Dataset:
    """The dataset that the next stage sees."""
    return ds.assign(result.data_vars).assign_coords(result.coords)


@cache
def drawn(name: str) -> Scene:
    return scene(name, SIZE, 0)


@cache
def chain(name: str) -> tuple[xr.Dataset, dict[str, xr.Dataset]]:
    """All variables after the last stage, and what each stage gave; on the way, that no stage touched its input."""
    ds, given = added(source(drawn(name).face.rgb_encoded), single_face()), {}
    for one in STAGES:
        before = ds.copy(deep=True)
        given[one.name] = one(ds, one.params_type())
        xr.testing.assert_identical(ds, before)
        ds = added(ds, given[one.name])
    return ds, given


# --- the contract ----------------------------------------------------------------------------------------------------

LENGTH = Variable("length", ("y", "x"), "f", "px", "A length.")
COUNT = Variable("count", (), "iu", "1", "A count.")


@each_stage
def test_a_stage_says_all_that_it_misses_at_once(one: Stage) -> None:
    with pytest.raises(ContractError) as caught:
        one(xr.Dataset(), one.params_type())
    first, *rest = str(caught.value).splitlines()
    assert first == f"Stage `{one.name}` cannot start:"
    assert rest == sorted(f"  - `{v.name}` is missing ({v.doc})" for v in one.requires)


def test_wrong_dims_dtype_and_units_are_told_together() -> None:
    ds = xr.Dataset({"length": (("x", "y"), np.zeros((2, 3), int)), "count": ((), 2.0, {"units": "px"})})
    with pytest.raises(ContractError) as caught:
        check_variables(ds, (LENGTH, COUNT), "Stage `saw` cannot start")
    assert str(caught.value).splitlines() == [
        "Stage `saw` cannot start:",
        "  - `count` has dtype float64, expected a kind among 'iu'",
        "  - `count` has units 'px', expected '1'",
        "  - `length` has dims ('x', 'y'), expected ('y', 'x')",
        "  - `length` has dtype int64, expected a kind among 'f'",
        "  - `length` has units None, expected 'px'",
    ]


class NoParams(Params):
    """Nothing to set."""


def saw(**kept: xr.DataArray) -> Stage:
    """A stage that returns what it is told to."""

    @stage(requires=(), provides=(COUNT,), version=1, params=NoParams)
    def inner(ds: xr.Dataset, params: NoParams) -> xr.Dataset:
        """Saw."""
        return xr.Dataset(dict(kept))

    return inner


def test_a_stage_must_keep_its_promise() -> None:
    with pytest.raises(ContractError, match="broke its promise:\n  - `count` is missing"):
        saw()(xr.Dataset(), NoParams())


def test_a_stage_must_not_return_more_than_it_declares() -> None:
    good, more = COUNT.array(np.int64(3)), LENGTH.array(np.zeros((2, 2)))
    assert int(saw(count=good)(xr.Dataset(), NoParams())["count"]) == 3
    with pytest.raises(ContractError, match="undeclared variables: length"):
        saw(count=good, length=more)(xr.Dataset(), NoParams())


def test_the_checks_read_no_values() -> None:
    import dask
    import dask.array as da

    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("a value was computed")

    with dask.config.set(scheduler=refuse):
        check_variables(xr.Dataset({"length": LENGTH.array(da.zeros((4, 4), chunks=2))}), (LENGTH,), "who")


@each_stage
def test_parameters_are_frozen_and_unknown_ones_refused(one: Stage) -> None:
    params = one.params_type()
    with pytest.raises(ValidationError, match="frozen"):
        setattr(params, next(iter(one.params_type.model_fields)), 1)
    with pytest.raises(ValidationError, match="extra"):
        one.params_type(no_such_parameter=1)


def test_images_keep_the_coordinates_of_their_source() -> None:
    ds = xr.Dataset(coords={"y": [0.5, 2.5], "x": [0.5, 2.5, 4.5]})
    made = like_image(ds, {LENGTH: np.ones((2, 3))})
    xr.testing.assert_equal(made["length"].x, ds.x)
    assert made["length"].attrs == {"units": "px", "long_name": "A length."}
    assert scalar(xr.Dataset({"count": COUNT.array(np.int64(7))}), COUNT) == 7.0


# --- from the photograph to the texture ------------------------------------------------------------------------------


@each_stage
@each_scene
def test_a_stage_returns_what_it_declares_with_meaning_and_finite(one: Stage, name: str) -> None:
    result = chain(name)[1][one.name]
    assert set(result.data_vars) == {variable.name for variable in one.provides}
    for variable in one.provides:
        array = result[variable.name]
        assert variable.problems(result) == []
        assert array.attrs["long_name"] == variable.doc
        if array.dtype.kind in "fc" and "NaN" not in variable.doc:
            assert np.isfinite(array.values).all(), variable.name


@each_scene
def test_the_ring_age_of_the_face_is_the_true_one(name: str) -> None:
    ds, _ = chain(name)
    wrong = ds["face_age"].values - drawn(name).face.age
    # A face without pith does not tell how many rings lie inside: whole years are free there.
    years = 0.0 if name == "end_grain_pith" else np.round(np.median(wrong))
    assert (np.abs(wrong - years) < 0.15).mean() >= 0.9


@each_scene
def test_the_texture_gives_the_photograph_back(name: str) -> None:
    ds, _ = chain(name)
    texture = solid_texture_of(ds)
    x, y = np.meshgrid(ds.x.values, ds.y.values)
    wood = texture.evaluate(np.stack([x, y, np.zeros_like(x)], axis=-1), detail=False)
    assert psnr_blurred(wood.rgb, ds["rgb"].values, ds["valid"].values) >= 25.0
    # A single color does not: what is tested can be missed.
    flat = np.broadcast_to(ds["rgb"].values.mean(axis=(0, 1)), wood.rgb.shape)
    assert psnr_blurred(flat, ds["rgb"].values, ds["valid"].values) < 25.0
    npt.assert_allclose(wood.ring_age, ds["face_age"].values, atol=2e-3)
    npt.assert_allclose(wood.rgb, ds["rendered"].values, atol=5e-3)


@each_scene
def test_traced_boundaries_lie_on_true_ones(name: str) -> None:
    ds, _ = chain(name)
    age = true_age_at(name, ds["ring_x"].values, ds["ring_y"].values)
    assert np.percentile(np.abs(age - np.round(age)), 90) < 0.12
    assert np.sum(ds["vertex_count"].values) == ds.sizes["vertex"]


def true_age_at(name: str, x: Array, y: Array) -> Array:
    return np.asarray(map_coordinates(drawn(name).face.age.astype(float), [y, x], order=1, mode="nearest"))


@each_scene
def test_the_ring_phase_is_that_of_the_true_age(name: str) -> None:
    ds, _ = chain(name)
    off = np.abs(wrapped(ds["ring_phase"].values - 2 * np.pi * drawn(name).face.age))
    assert np.median(off[ds["phase_confidence"].values > 0.5]) < 0.4


def test_the_pith_in_the_picture_is_found() -> None:
    ds, _ = chain("end_grain_pith")
    point, direction = np.asarray(drawn("end_grain_pith").log.pith), np.asarray(drawn("end_grain_pith").log.direction)
    matrix = ds["board_to_tree"].values
    foot = matrix[:3, :3] @ (point - point[2] / direction[2] * direction) + matrix[:3, 3]
    assert np.hypot(foot[0], foot[1]) < 8.0
    npt.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)


@each_scene
def test_radii_grow_and_the_polished_rings_do_not_fold(name: str) -> None:
    ds, _ = chain(name)
    assert ds["ring_radius"].values[0] == 0.0
    assert np.diff(ds["ring_radius"].values).min() > 0.0
    for field in ("displacement", "polished_displacement"):
        assert ((ds[field] + ds["radius"]).diff("radius") > 0.0).all()


@each_scene
def test_polishing_brings_model_and_phase_together(name: str) -> None:
    ds, _ = chain(name)
    loss = ds["loss"].values
    assert loss[-1] < 0.05
    assert loss[-1] <= loss[0]
    residual = wrapped(ds["ring_phase"].values - 2 * np.pi * ds["face_age"].values)
    # Modulo a turn: at half a turn the two may land on either side.
    npt.assert_allclose(wrapped(ds["phase_residual"].values - residual), 0.0, atol=1e-3)


def test_a_ring_too_many_where_the_phase_is_faint_does_not_shift_what_lies_behind() -> None:
    ds, _ = chain("quarter_sawn")
    middle = ds.sizes["x"] // 2
    ramp = np.clip((np.arange(ds.sizes["x"]) - middle + 6) / 12.0, 0.0, 1.0)
    strip = slice(middle - 6, middle + 6)
    phase, belief = ds["ring_phase"].copy(deep=True), ds["phase_confidence"].copy(deep=True)
    phase.values[:] = wrapped(phase.values + 2 * np.pi * ramp)
    belief.values[:, strip] = 0.06
    torn = ds.drop_vars(["polished_displacement", "face_age", "phase_residual", "loss"])
    torn = torn.assign(ring_phase=phase, phase_confidence=belief)
    wrong = phase_polishing(torn, phase_polishing.params_type())["face_age"].values - drawn("quarter_sawn").face.age
    wrong = np.delete(wrong - np.round(np.median(wrong)), strip, axis=1)
    assert (np.abs(wrong) < 0.25).mean() > 0.9


@each_scene
def test_the_strip_has_a_place_for_every_age_of_the_face(name: str) -> None:
    ds, _ = chain(name)
    assert ds.sizes["strip"] % int(ds["samples_per_ring"]) == 0
    assert ds["strip"].values[-1] > ds["face_age"].values.max()
    assert ds["strip_support"].values.sum() > 0
    assert 0.0 <= ds["lateness_strip"].values.min() <= ds["lateness_strip"].values.max() <= 1.0


@each_scene
def test_latewood_is_found_where_it_is(name: str) -> None:
    ds, _ = chain(name)
    found = np.interp(ds["face_age"].values, ds["strip"].values, ds["lateness_strip"].values)
    true = drawn(name).log.palette.lateness(drawn(name).face.age.astype(float))
    assert np.corrcoef(found.ravel(), true.ravel())[0, 1] > 0.7


def test_the_color_map_has_as_many_samples_as_asked_for() -> None:
    ds, given = chain("end_grain_pith")
    coarse = color_map(ds.drop_dims("strip"), ColorMapParams(samples_per_ring=16))
    assert coarse.sizes["strip"] * 4 == given["color_map"].sizes["strip"]
    assert int(coarse["samples_per_ring"]) == 16
    npt.assert_allclose(np.diff(coarse["strip"]), 1 / 16)


def test_the_distortion_grid_keeps_to_its_bound() -> None:
    ds, _ = chain("quarter_sawn")
    ds = ds.drop_dims(["radius", "azimuth", "height"])
    small = initial_distortion(ds, InitialDistortionParams(most_nodes=3000))
    assert small["displacement"].size <= 3000
    polished = phase_polishing(added(ds, small), phase_polishing.params_type())
    wrong = polished["face_age"].values - drawn("quarter_sawn").face.age
    assert (np.abs(wrong - np.round(np.median(wrong))) < 0.25).mean() > 0.9


class Context:
    """What the pipeline tells a product."""

    scan, version = "folder/board.png", "0"


def test_the_products_can_be_opened(tmp_path: Path) -> None:
    ds, _ = chain("end_grain_pith")
    write_texture(ds, tmp_path / "texture.zarr.zip", Context)
    texture = SolidTexture.open(tmp_path / "texture.zarr.zip")
    points = np.random.default_rng(0).uniform(0, 300, (500, 3))
    npt.assert_array_equal(texture.evaluate(points).rgb, solid_texture_of(ds).evaluate(points).rgb)
    assert (tmp_path / "texture.zarr.zip").stat().st_size < 1_000_000
    write_rings(ds, tmp_path / "rings.json", Context)
    document = json.loads((tmp_path / "rings.json").read_text())
    assert (document["image"], document["size"], document["pixel_size_mm"]) == ("board.png", [320, 300], None)
    lines, _ = polylines_of(ds)
    assert len(document["rings"]) == len(lines)
    for ring, line in zip(document["rings"], lines, strict=True):
        npt.assert_allclose(ring["points"], line, atol=0.0051)


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


# --- tiles, and the user's word --------------------------------------------------------------------------------------


@each_scene
def test_orientation_of_a_tile_with_its_halo_is_that_of_the_whole(name: str) -> None:
    ds, given = chain(name)
    params = orientation.params_type()
    assert orientation.halo is not None
    # Tiles and their margins are whole cells of every grid.
    halo = -(-orientation.halo(ds, params) // 16) * 16
    top, left = 112, 128
    rows, cols = slice(top - halo, top + 40 + halo), slice(left - halo, left + 50 + halo)
    assert rows.start >= 0
    assert cols.stop <= SIZE[1]
    tile = orientation(ds[[variable.name for variable in orientation.requires]].isel(y=rows, x=cols), params)
    core = {"y": slice(halo, halo + 40), "x": slice(halo, halo + 50)}
    wanted = given["orientation"].isel(y=slice(top, top + 40), x=slice(left, left + 50))
    npt.assert_allclose(tile["coherence"].isel(core), wanted["coherence"], atol=1e-4)
    turn = wrapped(2 * (tile["orientation"].isel(core).values - wanted["orientation"].values))
    assert np.percentile(np.abs(turn), 99) < 0.01


def test_the_users_pith_overrules_the_fit() -> None:
    ds, _ = chain("quarter_sawn")
    known = PoseParams(pith_x_px=-150.0, pith_y_px=140.0, pith_z_px=60.0, pith_tilt_deg=88.0, pith_azimuth_deg=85.0)
    matrix = pose(ds, known)["board_to_tree"].values
    npt.assert_allclose((matrix @ [-150.0, 140.0, 60.0, 1.0])[:2], 0.0, atol=1e-6)
    tilt, azimuth = np.radians([88.0, 85.0])
    wanted = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)]
    npt.assert_allclose(matrix[2, :3], wanted, atol=1e-9)


def test_one_known_coordinate_leaves_the_others_to_the_fit() -> None:
    ds, given = chain("end_grain_pith")
    fitted, moved = given["pose"]["board_to_tree"].values, pose(ds, PoseParams(pith_x_px=99.0))["board_to_tree"].values
    # What is known is known to the fit: the others are what suits it best, here much as before.
    npt.assert_allclose(moved[2, :3], fitted[2, :3], atol=0.02)
    pith = np.linalg.inv(moved) @ [0.0, 0.0, 0.0, 1.0]
    assert pith[0] == pytest.approx(99.0, abs=3.0)
    assert pith[1] == pytest.approx((np.linalg.inv(fitted) @ [0.0, 0.0, 0.0, 1.0])[1], abs=3.0)


def test_the_users_direction_of_growth_is_taken() -> None:
    ds, given = chain("quarter_sawn")
    found = bool(given["ring_tracing"]["bright_outwards"])
    other = ring_tracing(ds, RingTracingParams(bright_outwards=not found))
    assert bool(other["bright_outwards"]) is not found
    turned = wrapped(other["growth_angle"].values - given["ring_tracing"]["growth_angle"].values)
    assert np.median(np.abs(turned)) > 3.0


# --- real scans ---------------------------------------------------------------------------------------------
@pytest.mark.shared
@needs_shared
def test_rings_of_red_oak_end_grain_are_followed_across_its_rays() -> None:
    """About thirty rings of 40 to 150 px, crossed by rays that stand out more than they do, round a far pith."""
    read = cv2.imread(str(SHARED / "data" / "scans" / "boards" / "red_oak_endgrain.jpg"))
    assert read is not None
    ds = source(np.ascontiguousarray(read[..., ::-1]))
    for one in (scan, orientation, curved_gabor, ring_tracing):
        result = one(ds, one.params_type())
        ds = added(ds.drop_dims(("y", "x")) if one is scan else ds, result)
    assert 60.0 < float(ds["ring_scale"]) < 130.0
    # As the rings are curved, the pith lies below the lower right corner.
    outwards = np.arctan2(ds["y"].values[:, None] - 3100.0, ds["x"].values[None, :] - 4000.0)
    right = np.cos(ds["growth_angle"].values - outwards)
    assert (right > np.cos(np.radians(30.0))).mean() > 0.95
    assert len(np.unique(ds["ring_index"].values)) >= 28
    assert (ds["vertex_confidence"].values > 0.9).mean() > 0.5
