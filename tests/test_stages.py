"""The stages on small scenes with known truth: contract, chain from photograph to texture, laziness, the user's word.

In the order of the data: scan, orientation, curved_gabor, ring_tracing, pose, initial_distortion, phase_polishing,
color_map.
"""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr
from kernel_scenes import SHARED, needs_shared, wrapped
from pydantic import ValidationError
from stage_scenes import SIZE, added, chain, drawn, source, true_age_at

from stages import STAGES
from stages.color_map import ColorMapParams, color_map
from stages.curved_gabor import curved_gabor
from stages.initial_distortion import InitialDistortionParams, initial_distortion
from stages.orientation import orientation
from stages.phase_polishing import phase_polishing
from stages.polylines import polylines_of
from stages.pose import PoseParams, pose
from stages.products import solid_texture_of, write_rings, write_texture
from stages.ring_tracing import RingTracingParams, ring_tracing
from stages.scan import scan
from stages.stage import (
    ContractError,
    Params,
    Stage,
    Variable,
    check_variables,
    like_image,
    scalar,
    stage,
)
from woodfit import SolidTexture
from woodfit.color_strip import psnr_blurred
from woodfit.synthetic_scenes import scene

SCENES = ("quarter_sawn", "end_grain_pith")
each_stage = pytest.mark.parametrize("one", STAGES, ids=lambda one: one.name)
each_scene = pytest.mark.parametrize("name", SCENES)


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


# --- tiles, and the user's word --------------------------------------------------------------------------------------


@each_scene
def test_orientation_of_a_tile_with_its_halo_is_that_of_the_whole(name: str) -> None:
    ds, _ = chain(name)
    # Half the usual window, so that a tile with its margins fits into the scene.
    params = orientation.params_type(window_sigma_rings=0.4)
    whole = orientation(ds, params)
    assert orientation.halo is not None
    # Tiles and their margins are whole cells of every grid.
    halo = -(-orientation.halo(ds, params) // 16) * 16
    top, left = 112, 128
    rows, cols = slice(top - halo, top + 40 + halo), slice(left - halo, left + 50 + halo)
    assert rows.start >= 0
    assert cols.stop <= SIZE[1]
    tile = orientation(ds[[variable.name for variable in orientation.requires]].isel(y=rows, x=cols), params)
    core = {"y": slice(halo, halo + 40), "x": slice(halo, halo + 50)}
    wanted = whole.isel(y=slice(top, top + 40), x=slice(left, left + 50))
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


@pytest.mark.parametrize("seed", [0, 4])
def test_thin_latewood_in_a_small_scan_does_not_reverse_the_growth(seed: int) -> None:
    """At half the size rings of 9 to 11 px are so sharp that what smoothing leaves of latewood looks like vessels."""
    face = scene("quarter_sawn", seed=seed).face
    half = cv2.resize(face.rgb_encoded, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    ds = source(half)
    for one in (scan, orientation, curved_gabor, ring_tracing):
        ds = added(ds, one(ds, one.params_type()))
    assert bool(ds["bright_outwards"])
    down, right = np.gradient(face.age[::2, ::2])
    agreed = np.cos(ds["growth_angle"].values - np.arctan2(down, right)[: half.shape[0], : half.shape[1]])
    assert (agreed > 0.8).mean() > 0.98


# --- real scans ---------------------------------------------------------------------------------------------
def traced(name: str) -> xr.Dataset:
    """All that is known of a real scan after ring tracing."""
    read = cv2.imread(str(SHARED / "data" / "scans" / name))
    assert read is not None
    ds = source(np.ascontiguousarray(read[..., ::-1]))
    for one in (scan, orientation, curved_gabor, ring_tracing):
        result = one(ds, one.params_type())
        ds = added(ds.drop_dims(("y", "x")) if one is scan else ds, result)
    return ds


@pytest.mark.shared
@needs_shared
def test_rings_of_a_core_on_its_mount_are_numbered_across() -> None:
    """The phase runs on along the mount's edge from a ring to one six rings further out."""
    ds = traced("cores/uaa_core.jpg")
    counts = ds["vertex_count"].values
    x, y = ds["ring_x"].values, ds["ring_y"].values
    line = np.repeat(np.arange(len(counts)), counts)
    for row_px in (300.0, 900.0):
        here = np.abs(y - row_px) <= 2.5
        met = {int(i): float(x[here & (line == i)].mean()) for i in np.unique(line[here])}
        outwards = ds["ring_index"].values[sorted(met, key=met.__getitem__)]
        assert len(outwards) >= 18
        assert (np.diff(outwards) == 1).all(), outwards


@pytest.mark.shared
@needs_shared
def test_the_wide_rings_of_a_narrow_ringed_core_are_counted_once() -> None:
    """Its outer rings are up to three times as wide as most: the wave counts their overtone."""
    ds = traced("cores/p105_a.tif")
    counts = ds["vertex_count"].values
    middle = np.array([x.mean() for x in np.split(ds["ring_x"].values, np.cumsum(counts)[:-1])])
    path = json.loads((SHARED / "data/labels/p105_a.json").read_text())["paths"][0]
    label = np.array([x for x, _ in path["positions"]])
    nearest = np.abs(label[:, None] - middle).argmin(axis=1)
    met = np.flatnonzero(np.abs(middle[nearest] - label) <= 4.0)
    steps = -np.diff(ds["ring_index"].values[nearest[met]])
    assert len(met) >= 56
    # 41 of 57 steps were right while all cycles counted.
    assert (steps == np.diff(met)).sum() >= 53


@pytest.mark.shared
@needs_shared
def test_rings_of_red_oak_end_grain_are_followed_across_its_rays() -> None:
    """About thirty rings of 40 to 150 px, crossed by rays that stand out more than they do, round a far pith."""
    ds = traced("boards/red_oak_endgrain.jpg")
    assert 60.0 < float(ds["ring_scale"]) < 130.0
    # As the rings are curved, the pith lies below the lower right corner.
    outwards = np.arctan2(ds["y"].values[:, None] - 3100.0, ds["x"].values[None, :] - 4000.0)
    right = np.cos(ds["growth_angle"].values - outwards)
    assert (right > np.cos(np.radians(30.0))).mean() > 0.95
    assert len(np.unique(ds["ring_index"].values)) >= 28
    assert (ds["vertex_confidence"].values > 0.9).mean() > 0.5
