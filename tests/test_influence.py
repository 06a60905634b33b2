"""The influence-area metric: what is perfect, shifted, missed, doubled and torn scores as its definition says."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from woodfit.influence import influence_score, ray_radii, truth_from_rays, truth_from_rings
from woodfit.matching import Counts

CENTER = np.array([150.0, 140.0])
WIDTH = 10.0
RADII = WIDTH * np.arange(1, 9)

Piece = NDArray[np.float64]


def circle(radius: float, start_deg: float = 0.0, end_deg: float = 360.0, center: Piece = CENTER) -> Piece:
    """An arc with vertices that do not lie on whole degrees."""
    angle = np.radians(np.linspace(start_deg, end_deg, 1999))
    return np.asarray(center + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def labelled(radii: Sequence[float] | NDArray[np.float64] = RADII) -> list[dict[str, Any]]:
    return [
        {"id": k, "closed": True, "points": circle(radius)[:-1].tolist()} for k, radius in enumerate(radii, start=1)
    ]


TRUTH = truth_from_rings(labelled(), CENTER)


def traced(shift: float = 0.0) -> list[list[Piece]]:
    return [[circle(radius + shift)] for radius in RADII]


# --- sampling along rays ------------------------------------------------------------------------------------
def test_circle_has_its_radius_on_every_ray_and_an_arc_only_on_its_own() -> None:
    npt.assert_allclose(ray_radii([circle(30.0)], CENTER), 30.0, atol=1e-3)
    arc = ray_radii([circle(30.0, 350.5, 370.5)], CENTER)
    assert np.flatnonzero(np.isfinite(arc)).tolist() == [*range(11), *range(351, 360)]


def test_rays_turn_from_x_towards_y() -> None:
    radius = ray_radii([circle(30.0, center=CENTER + np.array([0.0, 10.0]))], CENTER)
    assert radius[90] == pytest.approx(40.0, abs=1e-3)
    assert radius[270] == pytest.approx(20.0, abs=1e-3)
    assert radius[0] == pytest.approx(np.sqrt(30.0**2 - 10.0**2), abs=1e-3)


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), min_size=2, max_size=8),
    st.integers(3, 40),
)
def test_radii_equal_solving_for_every_segment_and_ray(points: list[tuple[float, float]], rays: int) -> None:
    # Away from the pith and from rays through vertices, where "crosses" is a matter of definition.
    line = np.array(points) + np.array([0.123456, 0.0345678])
    angle = 2 * np.pi * np.arange(rays) / rays
    sums, counts = np.zeros(rays), np.zeros(rays)
    for p, q in pairwise(line):
        for k in range(rays):
            along = np.array([np.cos(angle[k]), np.sin(angle[k])])
            system = np.stack([along, p - q], axis=-1)
            if abs(np.linalg.det(system)) < 1e-9:
                continue
            t, v = np.linalg.solve(system, p)
            if t > 0 and 0 < v < 1:
                sums[k] += t
                counts[k] += 1
    expected = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    close = np.abs(np.sin(np.subtract.outer(angle, np.arctan2(line[:, 1], line[:, 0])))).min(axis=1) < 1e-6
    found = ray_radii([line], [0.0, 0.0], rays)
    npt.assert_allclose(found[~close], expected[~close], rtol=1e-6)


# --- areas --------------------------------------------------------------------------------------------------
def test_areas_meet_half_way_begin_at_the_pith_and_end_as_far_outside_as_they_begin_inside() -> None:
    inner, outer = truth_from_rings(labelled([10.0, 30.0, 40.0]), CENTER).areas()
    npt.assert_allclose(inner[:, 77], [0.0, 20.0, 35.0], atol=1e-3)
    npt.assert_allclose(outer[:, 77], [20.0, 35.0, 45.0], atol=1e-3)


def test_areas_do_not_depend_on_the_order_of_the_labels() -> None:
    shuffled = truth_from_rings([labelled([40.0, 10.0, 30.0])[k] for k in (2, 0, 1)], CENTER)
    inner, _ = shuffled.areas()
    npt.assert_allclose(inner[:, 5], [20.0, 35.0, 0.0], atol=1e-3)


# --- scores -------------------------------------------------------------------------------------------------
def test_perfect_tracing_scores_one_without_error() -> None:
    score = influence_score(traced(), TRUTH, pixel_size_mm=0.5).figures()
    assert [score[f"influence_{name}"] for name in ("recall", "precision", "f")] == [1.0, 1.0, 1.0]
    assert score["influence_rings"] == 8
    assert score["influence_rmse_px"] == pytest.approx(0.0, abs=1e-3)


def test_tracing_off_by_less_than_half_a_ring_is_found_and_the_error_is_the_shift() -> None:
    score = influence_score(traced(0.4 * WIDTH), TRUTH, pixel_size_mm=0.5).figures()
    assert score["influence_f"] == 1.0
    assert score["influence_rmse_px"] == pytest.approx(4.0, abs=1e-3)
    assert score["influence_rmse_mm"] == pytest.approx(2.0, abs=1e-3)


def test_tracing_off_by_more_than_half_a_ring_belongs_to_the_next_ring() -> None:
    score = influence_score(traced(0.6 * WIDTH), TRUTH)
    assert score.missed == (1,)
    assert score.counts.matched == 7
    assert score.counts.false == 1  # the outermost now lies outside of every area
    npt.assert_allclose(score.rmse_px, 4.0, atol=1e-3)


def test_missed_ring_costs_recall_and_doubled_ring_costs_precision() -> None:
    rings = traced()
    missed = influence_score(rings[:3] + rings[4:], TRUTH)
    assert (missed.missed, missed.counts.matched, missed.counts.false) == ((4,), 7, 0)
    doubled = influence_score([*rings, [circle(RADII[3] + 2.0)]], TRUTH)
    assert (doubled.counts.matched, doubled.counts.missed, doubled.counts.false) == (8, 0, 1)
    npt.assert_allclose(doubled.rmse_px, 0.0, atol=1e-3)  # the nearer one is kept


@pytest.mark.parametrize("first", [True, False])
def test_of_two_on_one_ring_the_nearer_is_kept_in_any_order(first: bool) -> None:
    near, far = [circle(RADII[3] + 1.0)], [circle(RADII[3] + 2.0)]
    others = [ring for k, ring in enumerate(traced()) if k != 3]
    score = influence_score([*others, *((near, far) if first else (far, near))], TRUTH)
    assert score.rmse_px.max() == pytest.approx(1.0, abs=1e-3)
    assert score.counts.false == 1


def test_torn_ring_is_one_ring_when_its_pieces_are_held_for_one_and_two_false_ones_otherwise() -> None:
    halves = [circle(RADII[3], 0.5, 180.5), circle(RADII[3], 180.5, 360.5)]
    others = [ring for k, ring in enumerate(traced()) if k != 3]
    assert influence_score([*others, halves], TRUTH).figures()["influence_f"] == 1.0
    apart = influence_score([*others, halves[:1], halves[1:]], TRUTH)
    assert (apart.counts.matched, apart.counts.missed, apart.counts.false) == (7, 1, 2)


@pytest.mark.parametrize(("part", "found"), [(0.59, False), (0.61, True)])
def test_sixty_per_cent_of_a_ring_are_enough(part: float, found: bool) -> None:
    others = [ring for k, ring in enumerate(traced()) if k != 3]
    score = influence_score([*others, [circle(RADII[3], 0.5, 0.5 + 360 * part)]], TRUTH)
    assert score.counts.matched == 7 + found
    assert score.counts.false == (not found)


def test_ring_that_slips_to_its_neighbour_half_way_round_is_not_found() -> None:
    slipping = [circle(RADII[3], 0.5, 180.5), circle(RADII[4], 180.5, 360.5)]
    others = [ring for k, ring in enumerate(traced()) if k not in (3, 4)]
    score = influence_score([*others, slipping], TRUTH)
    assert (score.counts.matched, score.counts.missed, score.counts.false) == (6, 2, 1)


def test_uncertain_ring_is_neither_missed_nor_found() -> None:
    rings = labelled()
    rings[5]["uncertain"] = 1
    truth = truth_from_rings(rings, CENTER)
    for tracing in (traced(), traced()[:5] + traced()[6:]):
        assert influence_score(tracing, truth).counts == Counts(7, 0, 0)


def test_nothing_traced_misses_all_and_something_far_off_is_false() -> None:
    assert influence_score([], TRUTH).counts.missed == 8
    assert np.isnan(influence_score([], TRUTH).figures()["influence_precision"])
    assert influence_score([[circle(130.0)]], TRUTH).counts.false == 1


def test_turning_the_disc_changes_nothing() -> None:
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])

    def turned(points: Any) -> Piece:
        return np.asarray((np.asarray(points) - CENTER) @ quarter.T + CENTER)

    bumpy = [[circle(radius, center=CENTER + np.array([3.0, 1.0]))] for radius in RADII]
    truth = truth_from_rings([ring | {"points": turned(ring["points"])} for ring in labelled()], CENTER)
    score = influence_score([[turned(piece) for piece in ring] for ring in bumpy], truth)
    straight = influence_score(bumpy, TRUTH)
    assert score.counts == straight.counts
    npt.assert_allclose(score.rmse_px, straight.rmse_px, atol=1e-6)


# --- truth from labelled rays -------------------------------------------------------------------------------
def ray(angle_deg: float, numbers: Sequence[int | None], radii: Sequence[float], **more: Any) -> dict[str, Any]:
    along = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    return {
        "start": CENTER.tolist(),
        "end": (CENTER + 100 * along).tolist(),
        "positions": (CENTER + np.asarray(radii)[:, None] * along).tolist(),
        "ring_index": list(numbers),
        **more,
    }


def test_rings_are_interpolated_between_near_rays_only() -> None:
    angles = [0.0, 10.0, 20.0, 90.0, 350.0]
    paths = [ray(angle, [1, 2], [10 + 0.1 * angle, 40.0]) for angle in angles]
    truth = truth_from_rays(paths, CENTER)
    known = np.flatnonzero(np.isfinite(truth.radius[0])).tolist()
    assert known == [*range(21), 90, *range(350, 360)]
    assert truth.radius[0, 5] == pytest.approx(10.5)
    assert truth.radius[0, 355] == pytest.approx((45.0 + 10.0) / 2)
    npt.assert_allclose(truth.radius[1][known], 40.0)


def test_perfect_tracing_scores_one_on_labelled_rays_too() -> None:
    paths = [ray(angle, range(1, 9), RADII) for angle in (0, 45, 90, 135, 180, 225, 270, 315)]
    score = influence_score(traced(), truth_from_rays(paths, CENTER))
    assert (score.counts.matched, score.counts.missed, score.counts.false) == (8, 0, 0)


def test_marks_without_a_number_are_not_judged() -> None:
    paths = [ray(angle, [None, *range(2, 9)], RADII) for angle in (0, 45, 90, 135, 180, 225, 270, 315)]
    truth = truth_from_rays(paths, CENTER)
    assert influence_score(traced(), truth).figures()["influence_f"] == 1.0
    assert influence_score([*traced(), [circle(16.0)]], truth).counts.false == 1


def test_ring_is_uncertain_when_half_of_its_labels_are() -> None:
    paths = [
        ray(angle, [1, 2], [20.0, 40.0], uncertain=[int(angle < 180), int(angle < 90)]) for angle in range(0, 360, 45)
    ]
    npt.assert_array_equal(truth_from_rays(paths, CENTER).uncertain, [True, False])


def test_too_few_rays_are_refused_with_their_number() -> None:
    with pytest.raises(ValueError, match=r"2 rays.*at least 4"):
        truth_from_rays([ray(0, [1], [20.0]), ray(180, [1], [20.0])], CENTER)
    elsewhere = [ray(angle, [1], [20.0]) for angle in range(0, 360, 45)]
    with pytest.raises(ValueError, match="0 rays"):
        truth_from_rays(elsewhere, CENTER + 20.0)
