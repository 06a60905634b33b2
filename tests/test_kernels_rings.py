"""From phase to numbered rings: growth, traces and edges, on rings whose answer is known."""

import itertools

import cv2
import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_scenes import Array, Image, conifer, field_of, noise, pixels, round_age, straight, wood, wrapped
from scipy.ndimage import gaussian_filter, grey_dilation
from scipy.spatial import cKDTree

from woodfit import fine_texture, rings
from woodfit.boundary import edge_offsets, edge_strength, latewood_foot
from woodfit.matching import line_crossings
from woodfit.ring_order import order_rings
from woodfit.rings import Rings, find_rings
from woodfit.synthetic_scenes import scene
from woodfit.tracing import Trace, trace_rings

#: An edge is found to this many px: the darkening before it pulls its steepest place outwards by about 0.1 px, and
#: bilinear samples of the slope draw it towards the pixel rows.
EDGE_PX = 0.45
LIMITS = {"seed_confidence": 0.3, "floor_confidence": 0.1, "max_gap_rings": 1.5, "shortest_rings": 2.0}


def trace(age: Array, confidence: Array | None = None, growth: Array | None = None) -> list[Trace]:
    """Trace the boundaries of a known age."""
    down, right = np.gradient(age)
    return trace_rings(
        wrapped(2 * np.pi * age),
        np.arctan2(down, right) if growth is None else growth,
        np.maximum(np.hypot(down, right), 1e-3),
        np.ones(age.shape) if confidence is None else confidence,
        wood(age.shape),
        **LIMITS,
    )


def crossings(lines: list[Array]) -> list[tuple[int, int]]:
    """Pairs of polylines of which two segments cross."""
    start = np.concatenate([line[:-1] for line in lines])
    end = np.concatenate([line[1:] for line in lines])
    owner = np.concatenate([np.full(len(line) - 1, i) for i, line in enumerate(lines)])
    reach = float(np.hypot(*(end - start).T).max())
    pairs = cKDTree((start + end) / 2).query_pairs(reach + 1e-6, output_type="ndarray")
    a, b = pairs[owner[pairs[:, 0]] != owner[pairs[:, 1]]].T

    def side(p: Array, q: Array, r: Array) -> Array:
        return np.sign((q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0]))

    cross = (side(start[a], end[a], start[b]) * side(start[a], end[a], end[b]) < 0) & (
        side(start[b], end[b], start[a]) * side(start[b], end[b], end[a]) < 0
    )
    return sorted({(int(owner[i]), int(owner[j])) for i, j in zip(a[cross], b[cross], strict=True)})


# --- traces -------------------------------------------------------------------------------------------------
def test_concentric_rings_are_traced_as_closed_circles() -> None:
    age, _ = round_age((241, 241), (120.3, 119.8), 15.0)
    traces = trace(age)
    radii = [np.hypot(t.points[:, 0] - 120.3, t.points[:, 1] - 119.8) for t in traces]
    inner = {round(float(r.mean() / 15)): (t, r) for t, r in zip(traces, radii, strict=True) if r.mean() < 112}
    assert sorted(inner) == [1, 2, 3, 4, 5, 6, 7]
    for number, (found, radius) in inner.items():
        assert found.closed
        npt.assert_allclose(radius, 15.0 * number, atol=0.1)
        assert np.hypot(*(found.points[0] - found.points[-1])) < 2.5
        angles = np.sort(np.arctan2(found.points[:, 1] - 119.8, found.points[:, 0] - 120.3))
        assert np.diff(angles).max() < 3.0 / (15.0 * number)
    outer = [t for t, r in zip(traces, radii, strict=True) if r.mean() >= 121]
    assert not any(t.closed for t in outer)
    assert len(outer) >= 8


def turns_of(points: Array, center: tuple[float, float]) -> float:
    """How often a line goes round a point, without sign."""
    azimuth = np.unwrap(np.arctan2(points[:, 1] - center[1], points[:, 0] - center[0]))
    return float(abs(azimuth[-1] - azimuth[0]) / (2 * np.pi))


@pytest.mark.parametrize("width", [7.0, 16.0, 26.0])
def test_a_circle_closes_once(width: float) -> None:
    center = (120.3, 119.8)
    age, _ = round_age((241, 241), center, width)
    closed = [t for t in trace(age) if t.closed]
    radii = sorted(float(np.hypot(*(t.points - center).T).mean()) for t in closed)
    npt.assert_allclose(radii, width * np.arange(1, len(radii) + 1), atol=0.15)
    # The picture reaches 119.8 px from the centre.
    assert len(radii) == int(119.8 / width)
    for t in closed:
        # The last point is next to the first and not beyond it.
        assert 1.0 - 3.0 / len(t.points) < turns_of(t.points, center) < 1.0 + 1.5 / len(t.points)


@pytest.mark.parametrize("pitch", [1.0, -1.0, 2.0])
def test_a_spiral_walk_ends_after_one_turn(pitch: float) -> None:
    """A tear in the phase that makes one endless boundary of all rings."""
    shape, center, width = (241, 241), (120.3, 119.8), 15.0
    age, outwards = round_age(shape, center, width)
    age = age + pitch * outwards / (2 * np.pi)
    traces = trace_rings(
        wrapped(2 * np.pi * age), outwards, np.full(shape, 1 / width), np.ones(shape), wood(shape), **LIMITS
    )
    whole = [t for t in traces if np.hypot(*(t.points - center).T).max() < 110]
    assert len(whole) >= 4
    assert not any(t.closed for t in whole)
    # Its start lies up to a ring off the circle, where the tangent turns a little further.
    assert max(turns_of(t.points, center) for t in whole) < 1.15
    assert crossings([t.points for t in traces]) == []


@pytest.mark.parametrize("tear", [0.2, 0.3])
def test_a_walk_that_comes_home_a_little_off_is_closed_without_an_overlap(tear: float) -> None:
    shape, center, width = (241, 241), (120.3, 119.8), 15.0
    age, outwards = round_age(shape, center, width)
    torn = age + tear * outwards / (2 * np.pi)
    traces = trace_rings(
        wrapped(2 * np.pi * torn), outwards, np.full(shape, 1 / width), np.ones(shape), wood(shape), **LIMITS
    )
    inner = [t for t in traces if np.hypot(*(t.points - center).T).max() < 110]
    assert len(inner) >= 5
    for t in inner:
        assert t.closed
        assert turns_of(t.points, center) < 1.01
        assert np.hypot(*(t.points[0] - t.points[-1])) < 0.35 * width


def test_a_walk_that_spins_off_its_boundary_leaves_nothing() -> None:
    # Round a point no pixel but the first lies near a boundary, so the walk turns full circle without keeping any.
    y, x = np.mgrid[:24, :24] - 11.5
    phase = np.full(x.shape, 3.0)
    phase[11, 14] = 0.0
    fields = (phase, np.arctan2(y, x), np.full(x.shape, 0.05), np.ones(x.shape), wood(x.shape))
    assert trace_rings(*fields, **LIMITS) == []


def test_a_speck_that_closes_within_half_a_ring_is_no_ring() -> None:
    shape, center, width = (160, 160), (80.0, 80.0), 20.0
    age, _ = round_age(shape, center, width)
    # The dark pith itself: a boundary phase at a third of a ring.
    x, y = pixels(shape)
    near = np.hypot(x - center[0], y - center[1]) < 0.5 * width
    phase = np.where(near, age - 0.3, age)
    traces = trace_rings(
        wrapped(2 * np.pi * phase),
        np.arctan2(y - center[1], x - center[0]),
        np.full(shape, 1 / width),
        np.ones(shape),
        wood(shape),
        **LIMITS,
    )
    radii = sorted(float(np.hypot(*(t.points - center).T).mean()) for t in traces if t.closed)
    npt.assert_allclose(radii, [20.0, 40.0, 60.0], atol=0.3)


@pytest.mark.parametrize("tangent", [0.0, 0.6, np.pi / 2, 2.5])
def test_parallel_rings_are_traced_from_border_to_border(tangent: float) -> None:
    shape, width = (150, 180), 12.0
    age = straight(shape, width, tangent, 0.3)
    traces = trace(age)
    x, y = pixels(shape)
    expected = set(range(int(np.ceil(age.min() + 1.2)), int(np.floor(age.max() - 1.2)) + 1))
    found = []
    for t in traces:
        at = (-np.sin(tangent) * t.points[:, 0] + np.cos(tangent) * t.points[:, 1]) / width + 0.3
        npt.assert_allclose(at, np.round(at.mean()), atol=0.05)
        ends = t.points[[0, -1]]
        to_border = np.minimum(ends, np.array([x.max(), y.max()]) - ends).min(axis=1)
        assert to_border.max() < 1.6
        assert not t.closed
        found.append(round(float(at.mean())))
    assert len(found) == len(set(found))
    assert expected <= set(found)


@pytest.mark.parametrize(("gap_px", "pieces"), [(10, 1), (14, 1), (40, 2)])
def test_a_short_gap_is_bridged_and_a_long_one_ends_the_trace(gap_px: int, pieces: int) -> None:
    shape = (60, 240)
    confidence = np.ones(shape)
    confidence[:, 120 : 120 + gap_px] = 0.0
    traces = trace(straight(shape, 12.0, 0.0), confidence)
    levels = [round(float(t.points[:, 1].mean() / 12)) for t in traces]
    assert [levels.count(n) for n in (1, 2, 3, 4)] == [pieces] * 4
    for t in traces:
        blind = (t.points[:, 0] > 121) & (t.points[:, 0] < 119 + gap_px - 1)
        assert (t.confidence[blind] == 0.0).all()
        if pieces == 1:
            npt.assert_allclose(t.points[:, 1], np.round(t.points[:, 1].mean() / 12) * 12, atol=0.5)
    assert not crossings([t.points for t in traces])


def test_a_walk_ends_where_growth_changes_sides() -> None:
    # Rings growing to the right, whose phase runs on from one leg to another round the foot of the picture, as it does
    # along the edge of a mount: each leg is a boundary of its own.
    x, y = pixels((160, 161))
    right, down = x - 80.0, np.maximum(y - 100.0, 0.0)
    apart = np.hypot(right, down) / 16.0
    side = np.where(right < 0.0, -1.0, 1.0)
    found = trace_rings(
        wrapped(2 * np.pi * side * apart),
        side * np.arctan2(down, np.abs(right)),
        np.full(apart.shape, 1 / 16),
        np.where(apart < 0.5, 0.0, 1.0),
        wood(apart.shape),
        **LIMITS,
    )
    assert len(found) == 10, "five legs on either side"
    for line in found:
        legs = line.points[line.points[:, 1] < 100.0, 0]
        assert np.ptp(legs) < 1.0, "on one leg only"
        assert not line.closed


def test_no_trace_leaves_the_wood_or_starts_where_nothing_is_believed() -> None:
    shape = (120, 120)
    age = straight(shape, 12.0, 0.0)
    valid = wood(shape)
    valid[:, 70:] = False
    down, right = np.gradient(age)
    fields = (wrapped(2 * np.pi * age), np.arctan2(down, right), np.hypot(down, right))
    traces = trace_rings(*fields, np.ones(shape), valid, **LIMITS)
    assert len(traces) >= 9
    assert max(t.points[:, 0].max() for t in traces) < 70
    assert trace_rings(*fields, np.full(shape, 0.2), valid, **LIMITS) == []


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.0, 0.9), st.floats(8.0, 16.0))
def test_traces_never_cross(seed: int, disorder: float, width: float) -> None:
    rng = np.random.default_rng(seed)
    shape = (130, 140)
    bend = gaussian_filter(rng.normal(0.0, 1.0, shape), 14.0)
    age = straight(shape, width, float(rng.uniform(0, np.pi))) + 0.5 * bend / np.abs(bend).max()
    down, right = np.gradient(age)
    shaken = gaussian_filter(rng.normal(0.0, 1.0, shape), 2.0)
    traces = trace_rings(
        wrapped(2 * np.pi * age + disorder * np.pi * shaken / np.abs(shaken).max()),
        np.arctan2(down, right) + 0.3 * gaussian_filter(rng.normal(0.0, 1.0, shape), 3.0),
        np.full(shape, 1 / width),
        np.clip(rng.uniform(0.2, 1.0) + gaussian_filter(rng.normal(0.0, 3.0, shape), 5.0), 0.0, 1.0),
        wood(shape),
        **LIMITS,
    )
    if len(traces) > 1:
        assert crossings([t.points for t in traces]) == []


# --- edges --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.5, 0.75])
@pytest.mark.parametrize(("slope", "off", "centre"), [(0.0, 0.0, 0.0), (0.12, 2.5, 2.0), (-0.3, -2.7, -2.4)])
def test_a_step_is_found_to_a_fraction_of_a_pixel(slope: float, off: float, centre: float, fraction: float) -> None:
    shape, width, fine = (100, 140), 20.0, 8
    x = np.arange(140.0)
    y = (np.arange(100 * fine) + 0.5) / fine - 0.5
    at = 50.0 + fraction + slope * (x - 70)
    lean = np.hypot(1.0, slope)
    age = (y[:, None] - at) / (width * lean)
    value = (0.8 - 0.4 * np.mod(age, 1.0) ** 2).reshape(100, fine, 140).mean(axis=1).astype(np.float32)
    across = np.arctan2(1.0, -slope)
    direction = np.full(shape, across)
    strength = edge_strength(value + noise(shape, 0.01), wood(shape), direction - np.pi / 2, direction, width)
    unit = np.array([np.cos(across), np.sin(across)])
    points = np.stack([x, at], axis=1)[10:-10] - off * unit
    angles, widths = np.full(120, across), np.full(120, width)
    offset, contrast = edge_offsets(strength, points, angles, widths, centre / width, 0.08, closed=False)
    assert abs(float(np.median(offset)) - off) < EDGE_PX
    assert np.abs(offset - off)[5:-5].max() < 2 * EDGE_PX
    assert np.median(contrast) > 1.0


def test_the_edge_of_a_closed_ring_has_no_seam() -> None:
    shape = (140, 140)
    age, outwards = round_age(shape, (70.0, 70.0), 20.0)
    strength = edge_strength(conifer(age), wood(shape), outwards + np.pi / 2, outwards, 20.0)
    turn = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    points = 70.0 + 37.5 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    offset, _ = edge_offsets(strength, points, turn, np.full(240, 20.0), 0.0, 0.16, closed=True)
    npt.assert_allclose(offset, 2.5, atol=0.3)
    rolled, _ = edge_offsets(
        strength, np.roll(points, 60, axis=0), np.roll(turn, 60), np.full(240, 20.0), 0.0, 0.16, closed=True
    )
    npt.assert_allclose(np.roll(rolled, -60), offset, atol=0.02)


def step_across(blur_px: float) -> tuple[Image, Array]:
    """A step at x = 60 between dark latewood inside and bright earlywood outside, and points on its steepest place."""
    x, _ = pixels((40, 120))
    value = gaussian_filter(np.where(x < 60, 0.3, 0.8), (0.0, blur_px)).astype(np.float32)
    return value, np.stack([np.full(30, 59.5), np.arange(5.0, 35.0)], axis=1)


@pytest.mark.parametrize("blur_px", [0.5, 0.7])
def test_the_foot_of_a_sharp_step_is_where_its_latewood_begins(blur_px: float) -> None:
    value, points = step_across(blur_px)
    way, sharp = latewood_foot(value, points, np.zeros(30), np.full(30, 40.0), closed=False)
    assert sharp.all()
    # Four fifths of a blurred step are behind 0.84 standard deviations inside of its steepest point.
    npt.assert_allclose(way, 0.84 * np.hypot(blur_px, 0.29), atol=0.35)
    assert way.max() <= 1.0
    dark, _ = latewood_foot(0.5 * value + 0.1, points, np.zeros(30), np.full(30, 40.0), closed=False)
    npt.assert_allclose(dark, way, atol=1e-4)


@pytest.mark.parametrize("blur_px", [3.0, 6.0])
def test_a_step_out_of_focus_has_no_foot(blur_px: float) -> None:
    value, points = step_across(blur_px)
    way, sharp = latewood_foot(value, points, np.zeros(30), np.full(30, 40.0), closed=False)
    assert not sharp.any()
    npt.assert_array_equal(way, 0.0)


# --- all together -------------------------------------------------------------------------------------------
def rings_of(value: Image, scale: float, bright_outwards: bool | None = None) -> Rings:
    field, _ = field_of(value, scale)
    return find_rings(
        value,
        wood(value.shape),
        field.response,
        field.explained,
        field.normal,
        field.asymmetry,
        field.frequency,
        field.orientation,
        scale,
        bright_outwards=bright_outwards,
    )


def test_drawn_rings_are_found_on_their_edges_with_their_numbers() -> None:
    shape = (200, 260)
    age, outwards = round_age(shape, (-60.0, 100.0), 16.0)
    rings = rings_of(conifer(age) + noise(shape, 0.02), 16.0)
    assert set(rings.order.group) == {0}
    shift = set()
    for t, index in zip(rings.traces, rings.order.index, strict=True):
        at = np.hypot(t.points[:, 0] + 60.0, t.points[:, 1] - 100.0) / 16.0
        assert np.abs(at - np.round(np.median(at))).max() < 0.2
        shift.add(round(float(np.median(at))) - int(index))
    assert len(shift) == 1
    across = line_crossings([t.points for t in rings.traces], [0.0, 100.0], [259.0, 100.0])
    # Boundaries lie on the latewood's edge, up to half a pixel inside the steepest point.
    npt.assert_allclose(across, np.arange(4, 20) * 16.0 - 60.0, atol=1.0)
    assert np.percentile(np.abs(wrapped(rings.phase - 2 * np.pi * age)), 95) < np.pi / 4
    assert (np.cos(rings.growth.direction - outwards) > 0.9).mean() > 0.99


@pytest.mark.parametrize(("blur_px", "inwards"), [(0.6, True), (3.0, False)])
def test_only_boundaries_in_focus_are_moved_onto_the_latewood(blur_px: float, inwards: bool) -> None:
    shape, width = (120, 260), 40.0
    age = straight(shape, width, -np.pi / 2, 0.3)
    fine = 16
    x = (np.arange(shape[1] * fine) + 0.5) / fine - 0.5
    drawn = gaussian_filter(0.8 - 0.4 * np.mod(x / width + 0.3, 1.0) ** 2, blur_px * fine)
    value = np.broadcast_to(drawn.reshape(-1, fine).mean(axis=1), shape) + noise(shape, 0.003)
    rings = rings_of(value.astype(np.float32), width, bright_outwards=True)
    lines = [t for t in rings.traces if 20 < t.points[:, 0].mean() < 240]
    assert len(lines) >= 5
    slope = np.gradient(drawn)
    for t in lines:
        near = np.abs(x - t.points[:, 0].mean()) < 8
        steepest = float(x[near][slope[near].argmax()])
        moved = steepest - float(np.median(t.points[:, 0]))
        assert (0.2 < moved <= 1.2) if inwards else (abs(moved) < 0.3)
    assert age.max() > 5


@pytest.mark.parametrize(("sharp_px", "moves"), [(190, True), (60, False)])
def test_a_scan_mostly_out_of_focus_is_left_alone_as_a_whole(sharp_px: int, moves: bool) -> None:
    shape, width, fine = (180, 260), 36.0, 16
    y = (np.arange(shape[0] * fine) + 0.5) / fine - 0.5
    profile = 0.8 - 0.4 * np.mod(y / width + 0.4, 1.0) ** 2
    clear, blurred = (gaussian_filter(profile, b * fine).reshape(-1, fine).mean(axis=1) for b in (0.6, 3.0))
    x, _ = pixels(shape)
    value = np.where(x < sharp_px, clear[:, None], blurred[:, None]) + noise(shape, 0.003)
    rings = rings_of(value.astype(np.float32), width, bright_outwards=True)
    in_focus = np.concatenate([t.points[t.points[:, 0] < sharp_px - 15] for t in rings.traces])
    ring = np.mod(in_focus[:, 1] / width + 0.4, 1.0)
    away = width * (ring - np.round(ring))
    away = away[np.abs(away) < 3.0]
    assert len(away) > 3 * (sharp_px - 15)
    assert (float(np.median(away)) < -0.25) if moves else (abs(float(np.median(away))) < 0.25)


@pytest.mark.parametrize("name", ["flat_sawn", "end_grain_pith", "ring_porous"])
def test_rings_of_a_log_never_cross(name: str) -> None:
    value = (scene(name, (300, 320), 5).face.rgb_encoded.max(axis=-1) / 255.0).astype(np.float32)
    rings = rings_of(value, 18.0)
    assert len(rings.traces) > 3
    assert crossings([t.points for t in rings.traces]) == []


@pytest.mark.parametrize("kind", ["fibers", "vessels"])
def test_streaks_that_stand_everywhere_do_not_reverse_the_growth(kind: str) -> None:
    shape = (240, 260)
    age = straight(shape, 24.0, np.pi / 2)
    rng = np.random.default_rng(4)
    if kind == "fibers":
        streaks = gaussian_filter(rng.normal(0.0, 1.0, shape), (25.0, 0.8))
        streaks *= 0.03 / streaks.std()
    else:
        # Dark only, as in diffuse-porous wood.
        vessels = grey_dilation((rng.random(shape) < 0.001).astype(float), (41, 2))
        streaks = -0.15 * gaussian_filter(vessels, 0.7)
    found = rings_of((0.5 + 0.3 * conifer(age) + streaks).astype(np.float32), 24.0)
    assert found.grain_ratio > fine_texture.STREAKED
    assert found.growth.bright_outwards
    assert (np.cos(found.growth.direction - np.pi) > 0.9).mean() > 0.98


def test_a_label_is_no_evidence_for_vessels() -> None:
    face = scene("quarter_sawn").face.rgb_encoded.copy()
    cv2.rectangle(face, (480, 60), (700, 180), (250, 250, 250), -1)
    cv2.putText(face, "No 17", (500, 140), cv2.FONT_HERSHEY_SIMPLEX, 2, (20, 20, 20), 6)
    found = rings_of((face.max(axis=-1) / 255.0).astype(np.float32), 17.0)
    assert found.growth.bright_outwards


@pytest.mark.parametrize("seed", [0, 2])
def test_streaks_that_begin_at_the_boundaries_darken_outwards(seed: int) -> None:
    value = (scene("ring_porous", (480, 500), seed).face.rgb_encoded.max(axis=-1) / 255.0).astype(np.float32)
    found = rings_of(value, 24.0)
    assert found.grain_ratio > fine_texture.STREAKED
    assert not found.growth.bright_outwards


def test_inputs_are_not_modified() -> None:
    shape = (90, 90)
    value = conifer(straight(shape, 12.0, 0.2))
    field, angle = field_of(value, 12.0)
    fields = [
        value,
        wood(shape),
        field.response,
        field.explained,
        field.normal,
        field.asymmetry,
        field.frequency,
        angle,
    ]
    before = [a.copy() for a in fields]
    rings = find_rings(*fields, 12.0)
    lines = [t.points.copy() for t in rings.traces]
    order_rings([t.points for t in rings.traces], [False] * len(lines), angle, field.frequency, wood(shape))
    for now, then in itertools.chain(
        zip(fields, before, strict=True), zip([t.points for t in rings.traces], lines, strict=True)
    ):
        npt.assert_array_equal(now, then)


def test_rings_without_an_abrupt_side_are_kept_but_not_sure() -> None:
    line = Trace(np.array([[0.0, 1.0], [1.0, 1.0]]), np.array([0.98, 0.96]), False)
    (plain,) = rings._less_sure([line], 0.5 * rings.ONE_SIDED)
    npt.assert_allclose(plain.confidence, 0.5 * line.confidence)
    (abrupt,) = rings._less_sure([line], 3.0 * rings.ONE_SIDED)
    npt.assert_allclose(abrupt.confidence, line.confidence)
    believed = np.array([[1.0, 0.0]])
    assert rings.one_sidedness(np.array([[0.3, 0.9]]), believed) == pytest.approx(0.3)
    assert rings.one_sidedness(np.zeros((2, 2)), np.zeros((2, 2))) == 0.0
