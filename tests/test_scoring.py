"""Metrics: a perfect result scores 1, a wrong one does not, and matching is the best there is."""

import itertools

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from woodfit.dendro_scoring import PathComparison, compare_path, confidence_pairs, reliability
from woodfit.matching import (
    Counts,
    count_matches,
    level_crossings,
    line_crossings,
    locate_crossings,
    match_ordered,
    neighbour_tolerance,
)
from woodfit.scoring import (
    across_grain_lines,
    age_correlation,
    age_share,
    boundary_pixels,
    boundary_recall_precision,
    face_score,
    line_f,
    path_score,
    phase_share,
    psnr_blurred,
    rasterize,
)

WIDTH = 20.0
SHAPE = (300, 320)
CENTER = np.array([150.0, 140.0])


def disc_age() -> NDArray[np.float64]:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return np.asarray(np.hypot(x - CENTER[0], y - CENTER[1]) / WIDTH)


def disc_rings(shift: float = 0.0) -> list[NDArray[np.float64]]:
    """The boundaries of `disc_age`, their radii off by `shift` px, cut at the image's border."""
    angle = np.linspace(0, 2 * np.pi, 1000)
    rings = []
    for radius in np.arange(1, 13) * WIDTH + shift:
        circle = CENTER + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        inside = ((circle >= 0) & (circle <= [SHAPE[1] - 1, SHAPE[0] - 1])).all(axis=1)
        rings += [
            circle[run] for run in np.split(np.arange(1000), np.flatnonzero(np.diff(inside)) + 1) if inside[run[0]]
        ]
    return rings


def board_age(slope: float = 0.15) -> NDArray[np.float64]:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return np.asarray((x + slope * y + 40) / WIDTH)


def board_rings(shift: float = 0.0, slope: float = 0.15) -> list[NDArray[np.float64]]:
    y = np.arange(SHAPE[0], dtype=float)
    lines = [np.stack([WIDTH * k - 40 - slope * y + shift, y], axis=-1) for k in range(1, 25)]
    cut = [line[(line[:, 0] >= 0) & (line[:, 0] <= SHAPE[1] - 1)] for line in lines]
    return [line for line in cut if len(line) > 1]


SCENES = {"disc": (disc_age, disc_rings), "board": (board_age, board_rings)}


# --- matching -----------------------------------------------------------------------------------------------
def brute_force(
    truth: NDArray[np.float64],
    found: NDArray[np.float64],
    tolerance: NDArray[np.float64],
    uncertain: NDArray[np.bool_],
) -> tuple[int, int]:
    """Most certain matches, then most uncertain ones, over every order-preserving one-to-one pairing."""
    best = (0, 0)
    for size in range(min(len(truth), len(found)) + 1):
        for rows in itertools.combinations(range(len(truth)), size):
            for columns in itertools.combinations(range(len(found)), size):
                if all(abs(truth[i] - found[j]) <= tolerance[i] for i, j in zip(rows, columns, strict=True)):
                    certain = sum(not uncertain[i] for i in rows)
                    best = max(best, (certain, size - certain))
    return best


positions = st.lists(st.floats(0, 30), max_size=6).map(lambda values: np.sort(np.array(values, dtype=float)))


@settings(deadline=None, max_examples=150)
@given(positions, positions, st.data())
def test_counts_equal_brute_force(truth: NDArray[np.float64], found: NDArray[np.float64], data: st.DataObject) -> None:
    size = len(truth)
    tolerance = np.array(data.draw(st.lists(st.floats(0, 6), min_size=size, max_size=size)), dtype=float)
    uncertain = np.array(data.draw(st.lists(st.booleans(), min_size=size, max_size=size)), dtype=bool)
    certain, doubtful = brute_force(truth, found, tolerance, uncertain)
    counts = count_matches(truth, found, tolerance, uncertain)
    assert counts == Counts(certain, int((~uncertain).sum()) - certain, len(found) - certain - doubtful)


@settings(deadline=None, max_examples=100)
@given(positions, positions)
def test_pairs_are_one_to_one_in_order_and_within_tolerance(
    truth: NDArray[np.float64], found: NDArray[np.float64]
) -> None:
    pairs = match_ordered(truth, found, np.full(len(truth), 3.0))
    for (a, b), (c, d) in itertools.pairwise(pairs):
        assert a < c
        assert b < d
    assert all(abs(truth[i] - found[j]) <= 3.0 for i, j in pairs)


def test_of_equally_many_matches_the_nearest_are_taken() -> None:
    assert match_ordered(np.array([10.0]), np.array([8.0, 10.5, 12.0]), np.array([3.0])) == [(0, 1)]


def test_one_traced_line_does_not_serve_two_rings() -> None:
    assert count_matches(np.array([10.0, 12.0]), np.array([11.0]), np.array([3.0, 3.0])) == Counts(1, 1, 0)


def test_uncertain_is_neither_missed_nor_false() -> None:
    truth, tolerance, doubt = np.array([10.0, 30.0]), np.array([3.0, 3.0]), np.array([False, True])
    assert count_matches(truth, np.array([10.0]), tolerance, doubt) == Counts(1, 0, 0)
    assert count_matches(truth, np.array([10.0, 31.0]), tolerance, doubt) == Counts(1, 0, 0)
    assert count_matches(truth, np.array([10.0, 31.0, 32.0]), tolerance, doubt) == Counts(1, 0, 1)


def test_tolerance_is_a_quarter_of_the_smaller_neighbouring_ring() -> None:
    npt.assert_allclose(neighbour_tolerance(np.array([0.0, 4.0, 14.0, 44.0]), 3.0), [1.0, 1.0, 2.5, 3.0])
    npt.assert_allclose(neighbour_tolerance(np.array([5.0]), 3.0), [3.0])


def test_scores_of_nothing_are_nan_and_not_perfect() -> None:
    assert np.isnan([Counts().scores()[name] for name in ("sensitivity", "precision", "f")]).all()
    assert Counts(0, 3, 0).scores()["f"] == 0.0


# --- crossings ----------------------------------------------------------------------------------------------
def test_level_crossings_are_sub_pixel_and_skip_gaps_and_the_pith() -> None:
    npt.assert_allclose(level_crossings([0.5, 1.5, 1.75, 2.75]), [0.5, 2.25])
    npt.assert_allclose(level_crossings([2.5, 0.5]), [0.25, 0.75])
    npt.assert_allclose(level_crossings([0.5, np.nan, 1.5]), [])
    npt.assert_allclose(level_crossings([0.2, 0.0, 0.2]), [])


def test_line_crossing_through_a_vertex_counts_once_and_touching_counts_evenly() -> None:
    through = np.array([[5.0, -1.0], [5.0, 0.0], [5.0, 1.0]])
    touching = np.array([[2.0, 1.0], [3.0, 0.0], [4.0, 1.0]])
    npt.assert_allclose(line_crossings([through], [0, 0], [10, 0]), [5.0])
    assert len(line_crossings([touching], [0, 0], [10, 0])) % 2 == 0
    assert len(line_crossings([touching * [1, -1]], [0, 0], [10, 0])) % 2 == 0
    npt.assert_allclose(line_crossings([through + np.array([20.0, 0.0])], [0, 0], [10, 0]), [])


def test_line_crossings_of_a_slanted_line() -> None:
    found = line_crossings([np.array([[0.0, 10.0], [10.0, 0.0]])], [0, 0], [10, 10])
    npt.assert_allclose(found, [5 * np.sqrt(2)])


# --- lines across the grain ---------------------------------------------------------------------------------
def test_lines_cross_the_grain_of_a_board_and_radiate_on_a_disc() -> None:
    for start, end in across_grain_lines(board_age(), 20):
        along = (end - start) / np.hypot(*(end - start))
        assert abs(along @ np.array([1.0, 0.15]) / np.hypot(1.0, 0.15)) > 0.999
        assert ((start >= -1e-9) & (end <= np.array([319, 299]) + 1e-9)).all()
    rays = across_grain_lines(disc_age(), 20)
    assert len(rays) == 20
    assert all(np.hypot(*(start - CENTER)) < 1.0 for start, _ in rays)


@pytest.mark.parametrize("name", SCENES)
def test_perfect_tracing_scores_one(name: str) -> None:
    age, rings = SCENES[name]
    assert line_f(rings(), age())["f"] == 1.0
    assert boundary_recall_precision(rings(), age()) == {"recall": 1.0, "precision": 1.0}


@pytest.mark.parametrize("name", SCENES)
def test_shifted_tracing_fails(name: str) -> None:
    age, rings = SCENES[name]
    assert line_f(rings(shift=2.5), age())["f"] > 0.99
    assert line_f(rings(shift=4.0), age())["f"] < 0.1
    shifted = boundary_recall_precision(rings(shift=5.0), age())
    assert shifted["recall"] < 0.1
    assert shifted["precision"] < 0.1


def test_tolerance_shrinks_with_the_rings() -> None:
    age = board_age() * 2.5  # rings of 8 px: a quarter is 2 px
    rings = [np.stack([8.0 * k - 40 - 0.15 * np.arange(300.0) + 2.5, np.arange(300.0)], axis=-1) for k in range(1, 60)]
    assert line_f(rings, age)["f"] < 0.1


def test_missed_and_doubled_rings_cost_what_they_are() -> None:
    rings = board_rings()
    whole = [ring for ring in rings if len(ring) > 290]
    missing = line_f([ring for ring in rings if ring is not whole[3]], board_age())
    assert missing["precision"] == 1.0
    assert missing["missed"] == pytest.approx(18, abs=2)
    doubled = line_f([*rings, whole[3] + [1.0, 0.0]], board_age())
    assert doubled["sensitivity"] == 1.0
    assert doubled["false"] == pytest.approx(18, abs=2)


def test_nothing_traced_is_no_recall_and_no_precision() -> None:
    scores = boundary_recall_precision([], disc_age())
    assert scores["recall"] == 0.0
    assert np.isnan(scores["precision"])
    assert line_f([], disc_age())["f"] == 0.0


def test_grazing_crossings_are_left_out_unless_asked_for() -> None:
    # Rings along x on the left, that turn to run along the lines across the grain on the right.
    y, x = np.mgrid[:200, :600].astype(float)
    age = np.where(x < 400, x / 20, 20 + 0.001 * (x - 400) + (y - 100) / 20 * (x - 400) / 200)
    lax, strict = (line_f([], age, grazing_deg=deg)["missed"] for deg in (60.0, 90.0))
    assert lax < strict - 10
    assert lax >= 20 * 19 - 20  # the crossings on the left all count


def test_excused_find_is_not_false() -> None:
    found, excused = np.array([5.0, 50.0]), np.array([False, True])
    assert count_matches(np.array([5.0]), found, np.array([3.0]), excused=excused) == Counts(1, 0, 0)
    assert count_matches(np.array([5.0]), found, np.array([3.0])) == Counts(1, 0, 1)


# --- pixels and fields --------------------------------------------------------------------------------------
def test_boundary_pixels_are_left_and_above_the_change() -> None:
    age = np.array([[0.2, 0.9, 1.1], [0.3, 1.2, 1.4], [np.nan, 1.2, 2.4]])
    npt.assert_array_equal(boundary_pixels(age), [[False, True, False], [True, False, True], [False, True, False]])


def test_rasterized_line_is_one_pixel_wide_and_where_it_was_drawn() -> None:
    mask = rasterize([np.array([[2.0, 3.0], [8.0, 3.0]])], (6, 12))
    npt.assert_array_equal(np.argwhere(mask), [[3, x] for x in range(2, 9)])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_phase_share_ignores_sign_and_constant_only(sign: float) -> None:
    age = board_age()
    phase = np.angle(np.exp(1j * (sign * 2 * np.pi * age + 1.234)))
    assert phase_share(phase, age) == 1.0
    phase[:, :32] += np.pi
    assert phase_share(phase, age) == pytest.approx(0.9, abs=0.01)
    noise = np.random.default_rng(0).uniform(-np.pi, np.pi, age.shape)
    assert phase_share(noise, age) == pytest.approx(0.5, abs=0.02)


def test_age_share_takes_one_constant_and_counts_missing_as_wrong() -> None:
    age = board_age()
    hat = age + 7.3
    hat[:75] += 0.5
    hat[75:90] = np.nan
    scores = age_share(hat, age)
    assert scores["age_share"] == pytest.approx(210 / 300)
    assert scores["age_offset"] == pytest.approx(7.3)
    assert age_share(age * 1.5, age)["age_share"] < 0.2
    assert age_share(np.full_like(age, np.nan), age)["age_share"] == 0.0


def test_age_correlation() -> None:
    age = disc_age()
    assert age_correlation(2 * age + 3, age) == pytest.approx(1.0)
    assert age_correlation(-age, age) == pytest.approx(-1.0)
    assert np.isnan(age_correlation(np.zeros_like(age), age))


def test_psnr_is_that_of_a_known_error_and_blur_removes_noise() -> None:
    image = np.random.default_rng(0).random((60, 60, 3))
    assert psnr_blurred(image, image) == float("inf")
    assert psnr_blurred(image, image + 0.1) == pytest.approx(20.0, abs=1e-3)
    checker = 0.1 * (-1.0) ** np.add.outer(np.arange(60), np.arange(60))[..., None]
    assert psnr_blurred(image, image + checker) > 50.0
    half = image.copy()
    half[:30] += 0.1
    assert psnr_blurred(image, half, valid=np.arange(60)[:, None] + np.zeros((60, 60)) > 40) == float("inf")


# --- labels -------------------------------------------------------------------------------------------------
def _path(**changes: object) -> dict[str, object]:
    x = [k * WIDTH - 40 - 0.15 * 100 for k in range(3, 19)]
    path: dict[str, object] = {"start": [0, 100], "end": [319, 100], "positions": [[v, 100] for v in x]}
    return path | {"uncertain": [0] * len(x)} | changes


def test_path_score_of_a_perfect_and_a_shifted_tracing() -> None:
    perfect = path_score(board_rings(), _path())
    assert (perfect["sensitivity"], perfect["precision"], perfect["f"]) == (1.0, 1.0, 1.0)
    assert path_score(board_rings(shift=4), _path())["f"] == 0.0
    assert path_score(board_rings(shift=4), _path(), tolerance_px=5)["f"] == 1.0
    assert path_score(board_rings(), [_path(), _path()])["matched"] == 2 * perfect["matched"]


def test_path_positions_need_not_be_ordered() -> None:
    positions = _path()["positions"]
    assert isinstance(positions, list)
    assert path_score(board_rings(), _path(positions=positions[::-1]))["f"] == 1.0


def test_path_is_judged_only_where_it_is_labelled() -> None:
    positions = _path()["positions"]
    assert isinstance(positions, list)
    cut = _path(positions=positions[4:], uncertain=[0] * (len(positions) - 4))
    assert path_score(board_rings(), cut)["false"] == 4
    assert path_score(board_rings(), cut | {"labelled_from_radius": positions[4][0] - 5})["false"] == 0


def test_face_score_counts_lengths() -> None:
    rings = [{"id": i, "uncertain": 0, "points": ring.tolist()} for i, ring in enumerate(board_rings())]
    perfect = face_score(board_rings(), {"rings": rings})
    assert (perfect["label_share"], perfect["traced_share"]) == (1.0, 1.0)
    assert perfect["label_median_px"] < 0.3
    assert face_score(board_rings(shift=6), {"rings": rings})["label_share"] < 0.05
    half = [ring[: len(ring) // 2] for ring in board_rings()]
    scores = face_score(half, {"rings": rings})
    assert scores["label_share"] == pytest.approx(0.5, abs=0.05)
    assert scores["traced_share"] == 1.0


def test_face_score_leaves_out_uncertain_labels_and_ignored_places() -> None:
    rings = [{"id": i, "uncertain": int(i == 4), "points": r.tolist()} for i, r in enumerate(board_rings())]
    traced = board_rings()
    assert face_score(traced, {"rings": rings})["traced_share"] == 1.0
    assert face_score(traced[:4] + traced[5:], {"rings": rings})["label_share"] == 1.0
    wild = [*traced, np.array([[100.0, 50.0], [140.0, 50.0]])]
    label = {"rings": rings, "ignore": [[[90, 40], [150, 40], [150, 60], [90, 60]]]}
    assert face_score(wild, {"rings": rings})["traced_share"] < 1.0
    assert face_score(wild, label)["traced_share"] == 1.0


# --- dendrochronologists' figures ---------------------------------------------------------------------------
EDGES = np.array([20.0, 60.0, 110.0, 150.0, 240.0, 300.0, 330.0, 400.0])


def core(**changes: object) -> dict[str, object]:
    """A path along y = 10 with boundaries at `EDGES`, the bark on the left."""
    label: dict[str, object] = {"start": [0, 10], "end": [420, 10], "positions": [[x, 10] for x in EDGES]}
    return label | {"year": [2015 - k for k in range(len(EDGES))]} | changes


def upright(positions: NDArray[np.float64] | list[float]) -> list[NDArray[np.float64]]:
    return [np.array([[x, 0.0], [x, 20.0]]) for x in positions]


def test_crossings_tell_the_polyline_and_the_place_on_it() -> None:
    lines = [np.array([[30.0, 0.0], [30.0, 20.0]]), np.array([[5.0, 0.0], [5.0, 8.0], [5.0, 16.0]])]
    found = locate_crossings(lines, [0, 10], [100, 10])
    npt.assert_allclose(found.position, [5.0, 30.0])
    assert found.polyline.tolist() == [1, 0]
    npt.assert_allclose(found.vertex, [1.25, 0.5])


def test_known_shift_gives_its_error_and_widths_do_not_feel_it() -> None:
    figures = compare_path(upright(EDGES + 2.0), core(), pixel_size_mm=0.05).figures()
    assert figures["f"] == figures["fine_f"] == 1.0
    assert figures["position_median_px"] == figures["position_p95_px"] == figures["position_bias_px"] == 2.0
    assert figures["position_median_mm"] == pytest.approx(0.1)
    assert figures["widths"] == len(EDGES) - 1
    assert figures["width_r"] == pytest.approx(1.0)
    assert figures["width_rmse_mm"] == pytest.approx(0.0, abs=1e-12)


def test_errors_are_not_cut_off_at_the_tolerance() -> None:
    figures = compare_path(upright(EDGES + 6.0), core(), tolerance_px=3.0).figures()
    assert figures["f"] == 0.0
    assert figures["position_median_px"] == 6.0


def test_fine_tolerance_is_a_tenth_of_a_mm_or_a_quarter_ring_and_never_under_a_px() -> None:
    # A quarter of the smaller ring is 7.5 px at 300 and 330 and at least 10 px elsewhere.
    assert compare_path(upright(EDGES + 7.0), core(), pixel_size_mm=0.01).fine.matched == 8
    assert compare_path(upright(EDGES + 8.0), core(), pixel_size_mm=0.01).fine.matched == 6
    assert compare_path(upright(EDGES + 8.0), core(), pixel_size_mm=0.02).fine.matched == 0
    assert compare_path(upright(EDGES + 0.9), core(), pixel_size_mm=5.0).fine.matched == 8
    assert np.isnan(compare_path(upright(EDGES), core()).figures()["fine_f"])


@pytest.mark.parametrize("flipped", [False, True])
def test_missed_and_false_boundaries_are_named_by_year(flipped: bool) -> None:
    found = [*np.delete(EDGES, 3), 200.0, 410.0]
    label, traced = core(), upright(found)
    if flipped:
        label |= {"start": [420, 10], "end": [0, 10]}
    comparison = compare_path(traced, label)
    assert comparison.missed == (2012,)
    # 200 px lies between the boundaries of 2012 and 2011, inside the ring of 2012; 410 px inside of that of 2008.
    assert sorted(comparison.false) == [2008, 2012]


def test_false_boundary_outside_of_the_outermost_belongs_to_the_next_year() -> None:
    assert compare_path(upright([8.0, *EDGES]), core()).false == (2016,)
    undated = {key: value for key, value in core().items() if key != "year"}
    assert compare_path(upright([8.0, *EDGES]), undated).false == (1,)


def test_widths_are_taken_only_of_rings_with_both_boundaries_and_nothing_between() -> None:
    comparison = compare_path(upright([*np.delete(EDGES, 3), 270.0]), core())
    npt.assert_allclose(comparison.width_px[:, 0], [40.0, 50.0, 30.0, 70.0])
    npt.assert_allclose(comparison.width_px[:, 1], comparison.width_px[:, 0])


def test_one_missed_ring_ruins_the_dated_series_but_not_the_bracketed_widths() -> None:
    whole = compare_path(upright(EDGES + np.array([0, 1, 0, -1, 0, 1, 0, -1])), core()).figures()
    missing = compare_path(upright(np.delete(EDGES, 1)), core()).figures()
    assert whole["series_r"] > 0.99
    assert missing["width_r"] == pytest.approx(1.0)
    assert missing["series_r"] < 0.7


def test_uncertain_boundary_bounds_no_width_and_is_not_missed() -> None:
    label = core(uncertain=[0, 0, 0, 1, 0, 0, 0, 0])
    for found in (EDGES, np.delete(EDGES, 3)):
        comparison = compare_path(upright(found), label)
        assert comparison.counts == Counts(7, 0, 0)
        assert len(comparison.width_px) == 5


def test_comparisons_add_up_as_if_they_were_one() -> None:
    one, other = compare_path(upright(EDGES + 1.0), core()), compare_path(upright(EDGES[2:] - 2.0), core())
    both = (one + other).figures()
    assert both["boundaries"] == 16
    assert both["sensitivity"] == pytest.approx(14 / 16)
    assert both["position_median_px"] == 1.0
    assert (one + PathComparison()).figures() == pytest.approx(one.figures(), nan_ok=True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"uncertain": [0, 1]}, "`uncertain` has 2 values for 8 positions"),
        ({"year": [1]}, "`year` has 1 values"),
        ({"end": [0, 10]}, r"leads from \[0, 10\] to \[0, 10\]"),
    ],
)
def test_label_that_contradicts_itself_says_how(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        compare_path([], core(**changes))


# --- confidence ---------------------------------------------------------------------------------------------
def test_confidence_pairs_tell_right_from_wrong() -> None:
    label = core(uncertain=[0, 0, 0, 0, 0, 0, 0, 1])
    found = [*EDGES, 200.0]
    confidence, right = confidence_pairs(upright(found), [0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1], label)
    # The one at the uncertain label is left out; the one at 200 px is false.
    npt.assert_allclose(confidence, [0.9, 0.8, 0.7, 0.6, 0.1, 0.5, 0.4, 0.3])
    assert right.tolist() == [True, True, True, True, False, True, True, True]


def test_confidence_of_vertices_is_taken_where_the_line_is_crossed() -> None:
    confidence, _ = confidence_pairs(upright(EDGES), [[0.0, 1.0]] * len(EDGES), [core(), core()])
    npt.assert_allclose(confidence, np.full(16, 0.5))


def test_reliability_counts_every_boundary_once() -> None:
    confidence = np.array([0.0, 0.5, 0.51, 0.7, 0.9, 0.95, 1.0])
    right = np.array([False, True, True, False, True, True, True])
    rows = reliability(confidence, right)
    assert [row["boundaries"] for row in rows] == [2, 2, 1, 2]
    assert [row["share"] for row in rows] == [0.5, 0.5, 1.0, 1.0]
    assert rows[3]["confidence"] == pytest.approx(0.975)
    assert np.isnan(reliability(confidence[:0], right[:0])[0]["share"])


@settings(deadline=None, max_examples=80)
@given(positions, st.integers(0, 2**31))
def test_counts_and_confidence_pairs_agree(found: NDArray[np.float64], seed: int) -> None:
    rng = np.random.default_rng(seed)
    label = core(positions=[[x, 10] for x in np.sort(rng.uniform(0, 30, 5))], year=None)
    label["uncertain"] = rng.integers(0, 2, 5).tolist()
    belief = rng.random(len(found)).tolist()
    confidence, right = confidence_pairs(upright(found), belief, label)
    counts = compare_path(upright(found), label).counts
    assert (int(right.sum()), len(right)) == (counts.matched, counts.matched + counts.false)
    assert set(confidence) <= set(belief)


def test_closed_label_is_traced_all_round() -> None:
    square = [[10.0, 10.0], [60.0, 10.0], [60.0, 60.0], [10.0, 60.0]]
    closed = np.array([*square, square[0]])
    label = {"rings": [{"id": 1, "closed": True, "points": square}]}
    assert face_score([closed], label)["traced_share"] == 1.0
    assert face_score([np.array(square)], label)["label_share"] == pytest.approx(0.75 + 6 / 200, abs=0.01)
