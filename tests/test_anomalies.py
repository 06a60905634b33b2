"""Knots, cracks and stains: found where they were drawn, and nowhere on sound wood of any cut."""

import re
from dataclasses import replace
from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr
from hypothesis import given as anything
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from kernel_scenes import SHARED, Array, needs_shared

from stages.anomalies import AnomaliesParams, anomalies
from woodfit.anomalies import CRACK, KNOT, STAIN, Anomalies, Face, describe, disturbed, find_anomalies, listed, sound_at
from woodfit.anomalies_drawn import BlemishedLog, Crack, Knot, Stain
from woodfit.ring_direction import curvature
from woodfit.synthetic import Log, photograph, plane_points, srgb_decode
from woodfit.synthetic_scenes import SCENE_NAMES, random_log, scene

SIZE = (300, 320)
CONIFERS = tuple(name for name in SCENE_NAMES if not name.startswith("ring_porous"))


def plane(size: tuple[int, int]) -> Array:
    return plane_points(size, (0, 0, 0), (1, 0, 0), (0, 1, 0))


def seen(encoded: Array, age: Array, vessels: bool = False) -> Face:
    """The face as a perfect search for rings would see it."""
    down, right = np.gradient(age.astype(float))
    slope = np.hypot(down, right)
    ring = float(1.0 / np.median(slope))
    double = np.exp(2j * (np.arctan2(down, right) + np.pi / 2)) * slope**2
    smooth = cv2.GaussianBlur(double.real, (0, 0), 0.3 * ring) + 1j * cv2.GaussianBlur(double.imag, (0, 0), 0.3 * ring)
    angle = (0.5 * np.angle(smooth) % np.pi).astype(np.float32)
    rgb = srgb_decode(encoded / 255.0).astype(np.float32)
    return Face(rgb, np.ones(age.shape, bool), angle, curvature(angle, 0.3 * ring), ring, None, vessels)


def struck(log: Log, x: float, y: float) -> tuple[float, float, float]:
    """Radius, azimuth and height of a place on the face."""
    across, up, height = log.tree(np.array([x, y, 0.0]))
    return float(np.hypot(across, up)), float(np.arctan2(up, across)), float(height)


def with_knot(log: Log, x: float, y: float, radius: float) -> BlemishedLog:
    """A branch of that radius where it meets the face at (x, y)."""
    away, azimuth, height = struck(log, x, y)
    length = away / np.cos(0.35)
    return BlemishedLog.of(log, (Knot(height - length * np.sin(0.35), azimuth, 0.35, radius / length),))


@cache
def blemished(name: str, what: str) -> tuple[Face, Array, Anomalies]:
    """What is seen, what is there and what is found on a face with one blemish."""
    plain = scene(name, SIZE, 1)
    size = plain.face.age.shape
    # Not at the pith, where a branch has no room yet.
    x, y = next(
        (fx * size[1], fy * size[0])
        for fx, fy in ((0.6, 0.55), (0.3, 0.4), (0.75, 0.75), (0.25, 0.75))
        if struck(plain.log, fx * size[1], fy * size[0])[0] > 90.0
    )
    away, azimuth, height = struck(plain.log, x, y)
    if what == "knot":
        log = with_knot(plain.log, x, y, 14.0)
    elif what == "crack":
        crack = Crack(azimuth, max(away - 90.0, 5.0), away + 80.0, 4.0, height - 100.0, height + 100.0)
        log = BlemishedLog.of(plain.log, cracks=(crack,))
    else:
        log = BlemishedLog.of(plain.log, stains=(Stain(azimuth, 45.0 / away, away - 60.0, away + 60.0),))
    photo = photograph(log, (size[0], size[1]), rng=np.random.default_rng(3))
    face = seen(photo.rgb_encoded, log.age(plane((size[0], size[1]))))
    return face, log.kind(plane((size[0], size[1]))), find_anomalies(face)


def overlap(one: Array, other: Array) -> float:
    """Intersection over union of two masks."""
    return float((one & other).sum() / max(1, (one | other).sum()))


def near(mask: Array, px: int) -> Array:
    """A mask widened by some px."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((2 * px + 1, 2 * px + 1), np.uint8)) > 0)


# --- the forward model -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_a_log_without_blemishes_is_the_plain_log_to_the_last_bit(name: str) -> None:
    plain = random_log(name, (60, 70), np.random.default_rng(2))
    points = plane((60, 70))
    npt.assert_array_equal(BlemishedLog.of(plain).color(points), plain.color(points))
    npt.assert_array_equal(BlemishedLog.of(plain).age(points), plain.age(points))


def test_age_still_increases_outwards_beside_a_branch() -> None:
    plain = random_log("flat_sawn", SIZE, np.random.default_rng(4))
    log = BlemishedLog.of(plain, (Knot(0.0, 0.5, 0.3, 0.1),))
    azimuth = 0.5 + np.concatenate([np.linspace(0.2, 1.0, 20), np.linspace(-1.0, -0.2, 20)])
    ray = np.cos(azimuth)[:, None] * log.axes[0] + np.sin(azimuth)[:, None] * log.axes[1]
    points = np.asarray(log.pith) + np.arange(5.0, 600.0)[:, None] * ray[:, None]
    assert (np.diff(log.age(points), axis=1) > 0).all()


def test_rings_bulge_outwards_beside_a_branch_and_not_far_from_it() -> None:
    plain = random_log("end_grain_off", SIZE, np.random.default_rng(4))
    log = BlemishedLog.of(plain, (Knot(0.0, 0.0, 0.0, 0.1),))
    beside = np.asarray(log.pith) + 300.0 * log.axes[0] + 40.0 * log.axes[2]
    assert log.age(beside) < plain.age(beside) - 0.3
    far = np.asarray(log.pith) - 300.0 * log.axes[0]
    npt.assert_allclose(log.age(far), plain.age(far), atol=1e-9)


# --- what is found ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", SCENE_NAMES)
def test_nothing_is_found_on_sound_wood(name: str, seed: int) -> None:
    drawn = scene(name, SIZE, seed)
    found = find_anomalies(seen(drawn.face.rgb_encoded, drawn.face.age, name.startswith("ring_porous")))
    assert len(found.kind) == 0, describe(found, 1.0, "px")
    assert not found.mask.any()


@pytest.mark.parametrize("name", CONIFERS)
def test_a_knot_is_found_where_it_is(name: str) -> None:
    _, truth, found = blemished(name, "knot")
    assert overlap(found.mask == KNOT, truth == KNOT) >= 0.5
    assert (found.mask[~near(truth == KNOT, 4)] == KNOT).sum() == 0


# A quarter-sawn face may lie in the crack's own plane.
@pytest.mark.parametrize("name", [name for name in CONIFERS if name != "quarter_sawn"])
def test_a_crack_is_found_along_most_of_its_length(name: str) -> None:
    _, truth, found = blemished(name, "crack")
    crack = found.mask == CRACK
    assert near(crack, 2)[truth == CRACK].mean() >= 0.55
    assert (crack & ~near(truth == CRACK, 8)).sum() <= 0.1 * crack.sum()


@pytest.mark.parametrize("name", ["end_grain_off", "end_grain_pith", "core"])
def test_stain_along_the_rays_is_found(name: str) -> None:
    _, truth, found = blemished(name, "stain")
    assert (found.mask == STAIN)[truth == STAIN].mean() >= 0.7
    assert overlap(found.mask == STAIN, truth == STAIN) >= 0.5


@pytest.mark.parametrize("turn", ["mirrored", "transposed"])
def test_a_mirrored_face_has_mirrored_anomalies(turn: str) -> None:
    face, _, found = blemished("end_grain_off", "knot")
    if turn == "mirrored":
        moved = tuple(image[:, ::-1] for image in (face.rgb, face.valid, np.pi - face.orientation, face.curvature))
        expected = found.mask[:, ::-1]
    else:
        angle = (np.pi / 2 - face.orientation) % np.pi
        moved = (face.rgb.transpose(1, 0, 2), face.valid.T, angle.T, face.curvature.T)
        expected = found.mask.T
    rgb, valid, orientation, bend = (np.ascontiguousarray(image) for image in moved)
    again = find_anomalies(Face(rgb, valid, orientation, bend, face.ring_px))
    assert overlap(again.mask == KNOT, expected == KNOT) > 0.9


def test_dimmer_light_changes_little() -> None:
    face, _, found = blemished("end_grain_off", "knot")
    again = find_anomalies(replace(face, rgb=0.7 * face.rgb))
    assert overlap(again.mask == KNOT, found.mask == KNOT) > 0.9


def test_a_lump_at_the_pith_is_no_knot() -> None:
    face, truth, _ = blemished("end_grain_off", "knot")
    rows, cols = np.nonzero(truth == KNOT)
    at_pith = find_anomalies(replace(face, pith=(float(cols.mean()), float(rows.mean()))))
    assert not (at_pith.mask == KNOT).any()


def test_what_is_not_wood_is_no_anomaly() -> None:
    face, _, _ = blemished("end_grain_off", "knot")
    none = find_anomalies(replace(face, valid=np.zeros(face.valid.shape, bool)))
    assert not none.mask.any()
    half = face.valid.copy()
    half[:, : half.shape[1] // 2] = False
    assert not find_anomalies(replace(face, valid=half)).mask[~half].any()


def test_a_gray_picture_has_no_stain() -> None:
    face, _, _ = blemished("end_grain_off", "stain")
    gray = np.repeat(face.rgb.mean(axis=2, keepdims=True), 3, axis=2)
    assert not (find_anomalies(replace(face, rgb=gray)).mask == STAIN).any()


# --- the table and the weights ---------------------------------------------------------------------------------------


@anything(arrays(np.uint8, (9, 11), elements=st.integers(0, 3)))
def test_the_table_holds_every_anomalous_pixel_once(mask: Array) -> None:
    found = listed(mask)
    for code in (KNOT, CRACK, STAIN):
        assert found.area[found.kind == code].sum() == (mask == code).sum()
        for left, top, right, bottom in found.box[found.kind == code].astype(int):
            assert (mask[top : bottom + 1, left : right + 1] == code).any()
    assert (np.diff(found.kind) >= 0).all()


@anything(arrays(np.uint8, (5, 7), elements=st.integers(0, 3)), st.sampled_from([1.0, 3.0]), st.booleans())
def test_weights_are_those_of_the_nearest_pixel(mask: Array, step: float, stain_is_sound: bool) -> None:
    x, y = 2.0 + step * np.arange(7), 1.0 + step * np.arange(5)
    rng = np.random.default_rng(0)
    px, py = rng.uniform(x[0] - 5, x[-1] + 5, (4, 6)), rng.uniform(y[0] - 5, y[-1] + 5, (4, 6))
    weight = sound_at(mask, x, y, px, py, stain_is_sound)
    for place in np.ndindex(4, 6):
        code = mask[np.argmin(np.abs(y - py[place])), np.argmin(np.abs(x - px[place]))]
        assert weight[place] == float(code == 0 or (code == STAIN and stain_is_sound))


def test_rings_are_disturbed_around_knots_on_cracks_and_not_by_stain() -> None:
    mask = np.zeros((30, 40), np.uint8)
    mask[10, 10], mask[10, 30], mask[20:, :] = KNOT, CRACK, STAIN
    rows, cols = np.mgrid[:30, :40]
    expected = (np.hypot(rows - 10, cols - 10) <= 4.0) | (mask == CRACK)
    found = disturbed(mask, 4.0)
    assert (found != expected).sum() <= 8, "a disc of pixels is round to within its rim"
    assert not found[20:].any()
    npt.assert_array_equal(disturbed(mask, 0.0), (mask == KNOT) | (mask == CRACK))


# --- the stage -------------------------------------------------------------------------------------------------------


def dataset(step: int = 2) -> xr.Dataset:
    """The variables that the stage asks for, of a face with a knot analysed at reduced resolution."""
    face, _, _ = blemished("end_grain_off", "knot")
    values: dict[str, tuple[Any, Any, str]] = {
        "rgb": (("y", "x", "channel"), face.rgb, "1"),
        "valid": (("y", "x"), face.valid, "1"),
        "ring_orientation": (("y", "x"), face.orientation, "rad"),
        "curvature": (("y", "x"), face.curvature / step, "px-1"),
        "ring_scale": ((), face.ring_px * step, "px"),
        "reduction": ((), step, "1"),
        "pixel_size": ((), 0.05, "mm"),
        "vessel_scale": ((), 0, "1"),
        "face_pith_x": ((), np.nan, "px"),
        "face_pith_y": ((), np.nan, "px"),
    }
    height, width = face.valid.shape
    coords = {"y": 0.5 + step * np.arange(height), "x": 0.5 + step * np.arange(width)}
    return xr.Dataset({name: (dims, array, {"units": unit}) for name, (dims, array, unit) in values.items()}, coords)


def test_the_stage_gives_places_and_areas_in_scan_px() -> None:
    ds = dataset(2)
    result = anomalies(ds, AnomaliesParams())
    _, _, found = blemished("end_grain_off", "knot")
    npt.assert_array_equal(result.anomaly, found.mask)
    npt.assert_allclose(result.anomaly_box, 0.5 + 2 * found.box)
    npt.assert_allclose(result.anomaly_area, 4 * found.area)
    area = 4 * found.area[found.kind == KNOT].sum() * 0.05**2
    assert result.attrs["figures"]["knots"].startswith(f"1, {area:.3g} mm²")


def test_ignored_knots_leave_all_wood_sound() -> None:
    result = anomalies(dataset(), AnomaliesParams(knots="ignore"))
    assert not result.anomaly.any()
    assert result.sizes["spot"] == 0
    assert result.attrs["figures"] == {"knots": "ignored"}


def test_a_face_that_is_mostly_anomalous_is_warned_of() -> None:
    mask = np.zeros((10, 10), np.uint8)
    mask[:4] = STAIN
    warnings, figures = describe(listed(mask), 1.0, "px")
    assert len(warnings) == 1
    assert "40 %" in warnings[0]
    assert figures["knots"] == "none"


def test_the_report_outlines_and_lists_what_was_found() -> None:
    from pipeline.report.anomalies import anomaly_section
    from pipeline.report.reading import Scan
    from pipeline.report.templating import render

    ds = dataset(2)
    assert anomaly_section(Scan(ds)) is None
    found = anomalies(ds, AnomaliesParams())
    section = anomaly_section(Scan(ds.assign(found.data_vars)))
    assert section is not None
    assert section["words"].startswith("1 knot")
    left, top, right, bottom = found.anomaly_box.values[0]
    numbers = np.array([float(part) for part in re.findall(r"[-\d.]+", section["lines"][0]["path"])]).reshape(-1, 2)
    # The outline runs through the centres of the outermost pixels.
    npt.assert_allclose([*numbers.min(axis=0), *numbers.max(axis=0)], [left, top, right, bottom], atol=2.0)
    area = float(found.anomaly_area[0]) * 0.05**2
    assert section["rows"][0]["area"] == f"{area:.3g} mm²"
    page = render("anomalies.html.j2", anomalies=section)
    assert page.count("<path") == 2 * len(section["lines"])
    assert anomaly_section(Scan(ds.assign(anomalies(ds, AnomaliesParams(knots="ignore")).data_vars))) is None


# --- real scans ------------------------------------------------------------------------------------------------------


def photographed(name: str, halved: bool) -> Anomalies:
    """Anomalies of a shared scan, at half its size."""
    from stages import STAGES

    image = cv2.imread(str(SHARED / "data" / "scans" / name))[..., ::-1]
    image = np.ascontiguousarray(
        cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) if halved else image
    )
    height, width = image.shape[:2]
    ds = xr.Dataset(
        {
            "encoded": (("y", "x", "channel"), image, {"units": "1"}),
            "opaque": (("y", "x"), np.ones((height, width), bool), {"units": "1"}),
            "dpi_pixel_size": ((), np.nan, {"units": "mm"}),
        },
        {"y": np.arange(height, dtype=float), "x": np.arange(width, dtype=float)},
    )
    for one in STAGES:
        if one.name in ("scan", "orientation", "curved_gabor", "anomalies"):
            result = one(ds, one.params_type())
            ds = (result[[]] if one.name == "scan" else ds).assign(result.data_vars).assign_coords(result.coords)
    return Anomalies(ds.anomaly.values, ds.anomaly_kind.values, ds.anomaly_box.values, ds.anomaly_area.values)


@pytest.mark.shared
@needs_shared
@pytest.mark.slow
def test_both_knots_of_the_walnut_veneer_are_found() -> None:
    found = photographed("boards/walnut_flatsawn.jpg", halved=True)
    for x, y in ((329, 314), (291, 362)):
        assert (found.mask[y - 8 : y + 9, x - 8 : x + 9] == KNOT).any()
    assert (found.mask == KNOT).mean() < 0.005


@pytest.mark.shared
@needs_shared
@pytest.mark.slow
def test_the_cracks_and_the_blue_stain_of_the_pine_disc_are_found() -> None:
    found = photographed("discs/F02b.png", halved=True)
    for x, y in ((150, 405), (720, 375)):
        assert (found.mask[y - 6 : y + 7, x - 20 : x + 21] == CRACK).any()
    for x, y in ((370, 195), (650, 290)):
        assert found.mask[y, x] == STAIN
    assert found.mask[560, 470] == 0
    assert (found.mask == KNOT).mean() < 0.001


@pytest.mark.shared
@needs_shared
@pytest.mark.slow
@pytest.mark.parametrize("face", ["A", "B", "C", "E", "F", "cut2"])
def test_sound_ring_porous_faces_have_no_anomaly(face: str) -> None:
    found = photographed(f"blocks/CN03/{face}_col.png", halved=False)
    assert not found.mask.any()
