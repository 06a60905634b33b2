"""Paths, crossings, widths at right angles, and the way to the pith, on boundaries whose truth is known."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from series_scenes import WIDTHS, Array, boundaries, circles, face, outward, slanted

from woodfit import measure_scan, measuring_path
from woodfit.measured import Kind
from woodfit.measuring import Boundaries, Crossings, cross, in_order, outward_parts, path_length, point_at
from woodfit.measuring_beside import with_those_beside
from woodfit.measuring_path import Grid
from woodfit.pith_offset import pith_offset, rings_missing
from woodfit.ring_widths import path_rings

ALONG = np.array([[0.0, 50.0], [500.0, 50.0]])


def crossed(path: Array, lines: Boundaries, growth: Array, reach: float = 15.0) -> Crossings:
    return cross(path, lines, growth, np.full(len(lines.lines), reach))


def right(lines: list[Array], turn: float = 0.0) -> Array:
    """Growth to the right, turned."""
    return np.full(sum(len(line) for line in lines), turn)


# --- widths ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slant_deg", [0.0, 7.0, 15.0, 30.0, 45.0, -45.0])
def test_a_slanted_path_does_not_over_measure(slant_deg: float) -> None:
    rng = np.random.default_rng(3)
    # Traced lines waver by a few tenths of a px, over several px.
    lines = slanted(WIDTHS, slant_deg)
    waver = [np.convolve(rng.normal(0.0, 0.3, len(line) + 8), np.ones(9) / 9.0, "valid") for line in lines]
    lines = [line + np.column_stack([w, 0.0 * w]) for line, w in zip(lines, waver, strict=True)]
    path = np.array([[0.0, 50.0], [700.0, 50.0]])
    found = crossed(path, boundaries(lines), right(lines, np.radians(slant_deg)), 25.0)
    rings = path_rings(in_order(found))
    assert len(rings) == len(WIDTHS)
    assert rings.width_px.sum() == pytest.approx(WIDTHS.sum(), rel=0.005)
    npt.assert_allclose(rings.width_px, WIDTHS, atol=0.6)
    # Without waver each ring by itself is exact.
    exact = slanted(WIDTHS, slant_deg)
    found = crossed(path, boundaries(exact), right(exact, np.radians(slant_deg)))
    npt.assert_allclose(path_rings(found).width_px, WIDTHS, rtol=1e-9)
    # From crossing to crossing it would be too much: what is tested can be missed.
    npt.assert_allclose(np.diff(found.position), WIDTHS / np.cos(np.radians(slant_deg)), rtol=1e-9)


def test_a_path_that_misses_the_pith_measures_the_rings_of_a_round_tree() -> None:
    radii = 40.0 + np.cumsum(WIDTHS)
    pith = (100.0, 100.0)
    lines = circles(pith, radii)
    path = np.array([[100.0, 135.0], [420.0, 135.0]])
    found = crossed(path, boundaries(lines, closed=np.ones(len(lines))), outward(lines, pith), 12.0)
    rings = path_rings(found)
    npt.assert_allclose(rings.width_px, np.diff(radii), rtol=0.005)
    # The first rings are met at 30 degrees: along the path they are much wider.
    assert np.diff(found.position)[0] > 1.1 * rings.width_px[0]


def test_between_boundaries_that_run_together_the_width_lies_between_the_two_ways_across() -> None:
    y = np.arange(0.0, 101.0)
    lines = [np.column_stack([100.0 + 0.0 * y, y]), np.column_stack([130.0 + 0.3 * (y - 50.0), y])]
    ring = path_rings(crossed(ALONG, boundaries(lines), right(lines)))
    across_first, across_second = 30.0, 30.0 * np.cos(np.arctan(0.3))
    assert across_second < ring.width_px[0] < across_first


def test_the_measured_line_is_as_long_as_the_ring_is_wide_and_its_middle_lies_on_the_path() -> None:
    lines = slanted(WIDTHS, 25.0)
    found = crossed(ALONG, boundaries(lines), right(lines))
    rings = path_rings(found)
    npt.assert_allclose(np.hypot(*(rings.end - rings.start).T), rings.width_px)
    npt.assert_allclose(0.5 * (rings.start + rings.end)[:, 1], 50.0, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(
    turn=st.floats(-np.pi, np.pi),
    scale=st.floats(0.3, 5.0),
    shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    slant=st.floats(-40.0, 40.0),
)
def test_turning_moving_and_scaling_the_scan_scales_the_widths(
    turn: float, scale: float, shift: tuple[float, float], slant: float
) -> None:
    matrix = scale * np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    lines = [line @ matrix + shift for line in slanted(WIDTHS, slant)]
    path = np.array([[-200.0, 50.0], [800.0, 50.0]]) @ matrix + shift
    found = crossed(path, boundaries(lines), right(lines, turn), 15.0 * scale)
    npt.assert_allclose(path_rings(in_order(found)).width_px, scale * WIDTHS, rtol=1e-6)


def test_a_vertex_on_the_path_is_one_crossing() -> None:
    lines = [np.array([[100.0, 40.0], [100.0, 50.0], [100.0, 60.0]]), np.array([[130.0, 50.0], [131.0, 70.0]])]
    bent = np.array([[0.0, 50.0], [100.0, 50.0], [200.0, 50.0]])
    npt.assert_allclose(crossed(bent, boundaries(lines), right(lines)).position[:1], [100.0])
    assert (crossed(bent, boundaries(lines), right(lines)).line == 0).sum() == 1


def test_less_than_two_boundaries_are_no_ring() -> None:
    lines = slanted(WIDTHS[:1], 0.0)[:1]
    assert len(path_rings(crossed(ALONG, boundaries(lines), right(lines)))) == 0
    nothing = np.array([[0.0, -300.0], [500.0, -300.0]])
    assert len(path_rings(in_order(crossed(nothing, boundaries(lines), right(lines))))) == 0


# --- order and gaps --------------------------------------------------------------------------------------------------


def test_a_boundary_known_by_count_but_not_traced_makes_its_two_rings_unknown() -> None:
    lines = slanted(WIDTHS, 0.0)
    kept = [i for i in range(len(lines)) if i != 4]
    found = crossed(ALONG, boundaries([lines[i] for i in kept], [i + 1 for i in kept]), right(lines[1:]))
    rings = path_rings(found)
    npt.assert_array_equal(rings.index, np.arange(2, 12))
    npt.assert_array_equal(np.isnan(rings.width_px), np.isin(rings.index, [5, 6]))
    npt.assert_allclose(rings.width_px[np.isfinite(rings.width_px)], np.delete(WIDTHS, [3, 4]))


def test_rings_that_a_person_called_absent_have_no_width_and_leave_the_others_theirs() -> None:
    lines = slanted(WIDTHS, 10.0)
    index = [1, 2, 3, 4, 7, 8, 9, 10, 11, 12, 13]
    dark = np.zeros((100, 500), np.float32)
    one = face(boundaries(lines, index), dark, np.full(dark.shape, np.radians(10.0)), 26.0)
    mark = lines[4][np.abs(lines[4][:, 1] - 80.0).argmin()]
    chosen = measure_scan.routes(one, [ALONG], [])
    (series,) = measure_scan.measure(one, chosen, None, marked_absent=np.stack([mark, mark]))
    npt.assert_array_equal(series.rings.index[series.rings.width_px == 0.0], [6, 7])
    npt.assert_allclose(series.rings.width_px[series.rings.width_px > 0.0], WIDTHS, rtol=1e-6)
    # One mark for two rings leaves it open which is which.
    (open_,) = measure_scan.measure(one, chosen, None, marked_absent=mark[None])
    npt.assert_array_equal(series.rings.index[np.isnan(open_.rings.width_px)], [5, 6, 7])


def test_where_indices_contradict_the_surest_sequence_is_kept() -> None:
    lines = slanted(WIDTHS, 0.0)
    index = [1, 2, 3, 9, 5, 6, 7, 8, 9, 10, 11]
    confidence = np.ones(len(lines))
    found = in_order(crossed(ALONG, boundaries(lines, index, confidence=confidence), right(lines)))
    npt.assert_array_equal(found.index, [1, 2, 3, 5, 6, 7, 8, 9, 10, 11])


def test_a_path_drawn_inwards_is_turned_and_one_through_the_pith_is_two() -> None:
    pith = (250.0, 50.0)
    lines = circles(pith, np.arange(20.0, 200.0, 25.0))
    known, growth = boundaries(lines, closed=np.ones(len(lines))), outward(lines, pith)
    inwards = np.array([[20.0, 50.0], [250.0, 50.0]])
    (turned,) = outward_parts(inwards, crossed(inwards, known, growth))
    npt.assert_array_equal(turned, inwards[::-1])
    left, rest = outward_parts(ALONG, crossed(ALONG, known, growth))
    npt.assert_allclose([left[0], rest[0]], [[250.0, 50.0]] * 2, atol=1.0)
    npt.assert_array_equal([left[-1], rest[-1]], [[0.0, 50.0], [500.0, 50.0]])
    for part in (left, rest):
        npt.assert_allclose(path_rings(crossed(part, known, growth)).width_px, 25.0, atol=0.05)


def test_a_boundary_broken_at_the_path_is_found_beside_it_and_flagged() -> None:
    lines = slanted(WIDTHS, 12.0)
    whole = crossed(ALONG, boundaries(lines), right(lines))
    broken = list(lines)
    for i in (3, 7):
        broken[i] = lines[i][lines[i][:, 1] > 62.0]
    known = boundaries(broken)
    found = in_order(crossed(ALONG, known, right(broken)))
    assert len(found) == len(lines) - 2
    more = with_those_beside(ALONG, found, known, reach_px=60.0)
    npt.assert_allclose(more.position, whole.position, atol=0.3)
    npt.assert_array_equal(np.flatnonzero(more.beside), [3, 7])
    npt.assert_allclose(path_rings(more).width_px, WIDTHS, atol=0.3)
    # What is seen too far away does not count.
    assert len(with_those_beside(ALONG, found, known, reach_px=10.0)) == len(found)


def test_beside_the_path_the_first_and_the_last_boundary_are_found_too() -> None:
    lines = slanted(WIDTHS, -10.0)
    whole = crossed(ALONG, boundaries(lines), right(lines))
    broken = [line[line[:, 1] > 65.0] if i in (0, len(lines) - 1) else line for i, line in enumerate(lines)]
    known = boundaries(broken)
    more = with_those_beside(ALONG, in_order(crossed(ALONG, known, right(broken))), known, 60.0)
    npt.assert_allclose(more.position, whole.position, atol=0.5)


def test_rings_that_no_count_ties_to_the_series_are_a_gap() -> None:
    lines = slanted(WIDTHS, 0.0)
    group = np.where(np.arange(len(lines)) < 7, 0, 1)
    index = [1, 2, 3, 4, 5, 6, 7, 1, 2, 3, 4]
    dark = np.zeros((100, 500), np.float32)
    one = face(boundaries(lines, index, group=group), dark, np.zeros(dark.shape), 26.0)
    (series,) = measure_scan.measure(one, measure_scan.routes(one, [ALONG], []), None)
    assert len(series.rings) == 6
    (gap,) = series.gaps
    assert gap.boundaries == 4
    assert gap.start == pytest.approx(series.found.position[-1])
    assert gap.end == pytest.approx(lines[7][0, 0])


# --- paths -----------------------------------------------------------------------------------------------------------


def test_ways_along_a_path_and_points_are_each_others_inverse() -> None:
    path = np.array([[0.0, 0.0], [30.0, 40.0], [30.0, 100.0]])
    npt.assert_allclose(path_length(path), [0.0, 50.0, 110.0])
    npt.assert_allclose(point_at(path, np.array([25.0, 80.0])), [[15.0, 20.0], [30.0, 70.0]])


def test_the_path_of_a_bent_core_stays_in_its_middle() -> None:
    x = np.arange(1200)
    middle = 150.0 + 60.0 * np.sin(x / 1200 * np.pi)
    y = np.arange(300)[:, None]
    wood = np.abs(y - middle[None, :]) < 40
    wood[:, 500:510] &= y > 150  # a chip
    grid = Grid((0.0, 0.0), 1.0, wood.shape)
    axis, aspect = measuring_path.long_axis(wood)
    assert aspect > measuring_path.CORE_ASPECT
    path, half = measuring_path.core_path(wood, grid, axis)
    assert half == pytest.approx(40.0, abs=3.0)
    off = [np.abs(py - np.interp(px, x, middle)) for px, py in path]
    assert np.max(off) < 12.0


def test_reduced_arrays_give_the_same_path_in_scan_px() -> None:
    wood = np.zeros((60, 600), np.bool_)
    wood[20:40, 10:590] = True
    fine, _ = measuring_path.core_path(wood, Grid((0.0, 0.0), 1.0, wood.shape), 0.0)
    coarse, _ = measuring_path.core_path(wood, Grid((1.5, 1.5), 4.0, wood.shape), 0.0)
    npt.assert_allclose(coarse, fine * 4.0 + 1.5)


def test_the_pith_of_a_disc_with_a_missing_sector_is_found_and_radii_start_there() -> None:
    pith = (207.0, 181.0)
    lines = circles(pith, np.arange(15.0, 150.0, 14.0), 0.4, 2 * np.pi - 0.3)
    grid = Grid((0.0, 0.0), 1.0, (400, 400))
    y, x = np.mgrid[:400, :400]
    wood = np.hypot(x - pith[0], y - pith[1]) < 160
    known = boundaries(lines)
    unseen = np.full(2, np.nan)
    found = measuring_path.find_pith(known, outward(lines, pith), grid, wood, unseen)
    assert found is not None
    npt.assert_allclose(found, pith, atol=0.5)
    north, east = (measuring_path.radius_path(found, bearing, grid, wood) for bearing in (0.0, 90.0))
    npt.assert_allclose([north[-1], east[-1]], [[207.0, 21.0], [367.0, 181.0]], atol=1.5)
    # Half of the disc does not surround its pith.
    half = circles(pith, np.arange(15.0, 150.0, 14.0), 0.0, np.pi)
    assert measuring_path.find_pith(boundaries(half), outward(half, pith), grid, wood, unseen) is None


def test_the_pith_seen_on_the_overview_starts_the_search_and_stands_where_boundaries_say_nothing() -> None:
    pith, near = (207.0, 181.0), np.array([225.0, 170.0])
    grid = Grid((0.0, 0.0), 1.0, (400, 400))
    y, x = np.mgrid[:400, :400]
    wood = np.hypot(x - pith[0], y - pith[1]) < 160
    around = circles(pith, np.arange(15.0, 150.0, 14.0))
    found = measuring_path.find_pith(boundaries(around), outward(around, pith), grid, wood, near)
    npt.assert_allclose(found, pith, atol=0.5)
    half = circles(pith, np.arange(15.0, 150.0, 14.0), 0.0, np.pi)
    npt.assert_array_equal(measuring_path.find_pith(boundaries(half), outward(half, pith), grid, wood, near), near)
    # Outside of the wood nothing can be the pith.
    away = np.array([10.0, 10.0])
    assert measuring_path.find_pith(boundaries(half), outward(half, pith), grid, wood, away) is None


def test_on_a_disc_every_radius_counts_the_same_rings_from_the_pith() -> None:
    pith = (200.0, 200.0)
    radii = np.cumsum([18.0, 15.0, 16.0, 14.0, 12.0, 15.0, 13.0, 14.0, 12.0])
    lines = circles(pith, radii)
    y, x = np.mgrid[:400, :400]
    growth = np.arctan2(y - pith[1], x - pith[0])
    known = boundaries(lines, closed=np.ones(len(lines)))
    one = face(known, np.zeros((400, 400), np.float32), growth, 14.0, valid=np.hypot(x - 200, y - 200) < 150)
    chosen = measure_scan.routes(one, [], [0.0, 90.0, 180.0, 270.0])
    assert [route.kind for route in chosen] == [Kind.RADIUS] * 4
    for series in measure_scan.measure(one, chosen, None):
        npt.assert_allclose(series.rings.width_px, np.diff(radii, prepend=0.0), atol=0.1)
        assert series.pith is not None
        assert (series.pith.on_sample, series.pith.distance_px, series.pith.years) == (True, 0.0, 0)
    # Without the two innermost boundaries the pith is away, and two more rings are missing.
    inner = boundaries(lines[2:], list(range(1, 8)), closed=np.ones(7))
    one = face(inner, np.zeros((400, 400), np.float32), growth, 14.0, valid=one.valid)
    series = measure_scan.measure(one, measure_scan.routes(one, [], [45.0]), None)[0]
    assert series.pith is not None
    assert series.pith.distance_px == pytest.approx(radii[2], abs=0.5)
    assert series.pith.years in (3, 4)


def test_across_a_board_the_line_meets_most_boundaries() -> None:
    lines = slanted(np.full(14, 20.0), 35.0, height=300)
    dark = np.zeros((300, 320), np.float32)
    inside = [line[((line >= 0) & (line < [320, 300])).all(axis=1)] for line in lines]
    known = boundaries([line for line in inside if len(line) > 20], [i for i, n in enumerate(inside, 1) if len(n) > 20])
    one = face(known, dark, np.full(dark.shape, np.radians(35.0)), 20.0)
    (route,) = measure_scan.routes(one, [], [0.0])
    assert route.kind == Kind.LINE
    (series,) = measure_scan.measure(one, [route], None)
    assert len(series.found) >= len(known.lines) - 1
    npt.assert_allclose(series.rings.width_px, 20.0, rtol=1e-6)


def test_across_a_board_the_line_goes_round_a_hole_in_the_tracing() -> None:
    lines = slanted(np.full(14, 20.0), 0.0, height=300)
    lines = [line[(line[:, 1] >= 0) & (line[:, 1] < 300)] for line in lines]
    for i in (6, 7, 8):
        lines[i] = lines[i][lines[i][:, 1] > 210.0]
    dark = np.zeros((300, 360), np.float32)
    one = face(boundaries(lines), dark, np.zeros(dark.shape), 20.0)
    (route,) = measure_scan.routes(one, [], [0.0])
    (series,) = measure_scan.measure(one, [route], None)
    assert (route.points[:, 1] > 210.0).all()
    npt.assert_allclose(series.rings.width_px, 20.0, rtol=1e-6)


# --- pith ------------------------------------------------------------------------------------------------------------


def arcs_of(radius: float, half_height: float, noise: float, seed: int) -> list[Array]:
    """Six arcs about a pith at (0, 0), around the +x axis, with slow waver."""
    rng = np.random.default_rng(seed)
    lines = []
    for r in radius + 30.0 * np.arange(6):
        turn = np.arcsin(np.linspace(-half_height, half_height, int(2 * half_height)) / r)
        waver = np.convolve(rng.normal(0.0, 1.0, len(turn) + 24), np.hanning(25), "valid")
        off = r + noise * waver / waver.std()
        lines.append(np.column_stack([off * np.cos(turn), off * np.sin(turn)]))
    return lines


@pytest.mark.parametrize("radius", [120.0, 300.0, 900.0])
def test_the_pith_of_exact_arcs_is_found(radius: float) -> None:
    found = pith_offset(arcs_of(radius, 85.0, 0.0, 0), np.array([radius, 0.0]), 0.1)
    assert found is not None
    npt.assert_allclose([found.x, found.y], [0.0, 0.0], atol=0.002 * radius)
    assert found.distance_px == pytest.approx(radius, rel=0.002)


def test_the_range_of_the_pith_distance_mostly_holds_the_truth() -> None:
    inside = []
    for seed in range(40):
        found = pith_offset(arcs_of(300.0, 85.0, 0.5, seed), np.array([300.0, 0.0]), 0.0)
        assert found is not None
        inside.append(found.least_px <= 300.0 <= found.most_px)
    assert 0.5 <= np.mean(inside) <= 1.0


def test_straight_or_hollow_boundaries_tell_no_pith() -> None:
    assert pith_offset(arcs_of(20_000.0, 85.0, 0.5, 1), np.array([20_000.0, 0.0]), 0.0) is None
    hollow = [line * [-1.0, 1.0] for line in arcs_of(300.0, 85.0, 0.2, 1)]
    assert pith_offset(hollow, np.array([-300.0, 0.0]), 0.0) is None
    assert pith_offset([], np.zeros(2), 0.0) is None


def test_missing_rings_are_counted_by_the_innermost_widths() -> None:
    assert rings_missing(100.0, np.array([20.0, np.nan, 0.0, 30.0])) == 4
    assert rings_missing(100.0, np.array([np.nan])) is None
