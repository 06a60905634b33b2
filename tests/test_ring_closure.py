"""Closing the rings of a disc and finding where one is missing, on circles with known truth."""

import math

import numpy as np
import numpy.testing as npt
import pytest
from numpy.typing import NDArray

from woodfit.ring_closure import close_rings, describe_uneven, uneven_counts
from woodfit.ring_order import Order
from woodfit.tracing import Trace

SIDE = 401
PITH = (200.0, 200.0)
WIDTH = 16.0
#: Radii of ten rings of a disc, px.
RADII = WIDTH * np.arange(1, 11) + 8.0
Array = NDArray[np.float64]
Disc = tuple[list[Trace], list[int]]


def circle_points(radius: float, shift: float, theta: Array) -> Array:
    """Points at directions `theta` from the pith on a circle whose centre lies `shift` px to the right of it."""
    away = shift * np.cos(theta) + np.sqrt(radius**2 - (shift * np.sin(theta)) ** 2)
    return np.stack([PITH[0] + away * np.cos(theta), PITH[1] + away * np.sin(theta)], axis=1)


def arc(radius: float, start: float = 0.0, sweep: float = 2 * math.pi, shift: float = 0.0, sure: float = 0.95) -> Trace:
    """A trace about a pixel from vertex to vertex; negative `sweep` runs the other way round."""
    closed = abs(sweep) >= 2 * math.pi
    count = max(8, round(abs(sweep) * radius))
    theta = start + sweep * np.arange(count) / (count if closed else count - 1)
    return Trace(circle_points(radius, shift, theta), np.full(count, sure), closed)


def around(start: float, gap: float, radius: float, shift: float = 0.0) -> Trace:
    """A ring that lacks `gap` rad from `start` on."""
    return arc(radius, start + gap, 2 * math.pi - gap, shift)


def ordered(index: list[int]) -> Order:
    numbers = np.array(index, np.int64)
    return Order(numbers, np.zeros_like(numbers), np.full(len(index), 0.8))


def close(
    disc: Disc, strength: Array | None = None, valid: NDArray[np.bool_] | None = None
) -> tuple[list[Trace], Order]:
    shape = (SIDE, SIDE)
    return close_rings(
        disc[0],
        ordered(disc[1]),
        PITH,
        np.zeros(shape) if strength is None else strength,
        np.full(shape, 1 / WIDTH),
        np.ones(shape, bool) if valid is None else valid,
    )


def whole(shift: float = 0.0, but: int = -1) -> Disc:
    """A disc of closed rings with index 1 to 10, growing eccentric outwards, one left out."""
    kept = [k for k in range(1, 11) if k != but]
    return [arc(RADII[k - 1], shift=shift * k / 10) for k in kept], kept


def with_ring(pieces: list[Trace], k: int = 6, shift: float = 0.0) -> Disc:
    traces, index = whole(shift, but=k)
    return traces + pieces, index + [k] * len(pieces)


def of_index(closed: tuple[list[Trace], Order], k: int) -> list[Trace]:
    return [trace for trace, index in zip(closed[0], closed[1].index, strict=True) if index == k]


def off_circle(trace: Trace, radius: float, shift: float = 0.0) -> float:
    """Greatest distance of a trace from a circle."""
    return float(np.abs(np.hypot(*(trace.points - (PITH[0] + shift, PITH[1])).T) - radius).max())


def goes_round_once(trace: Trace) -> bool:
    """Whether a closed trace goes round the pith once, without turning back and without a jump."""
    ring = np.concatenate([trace.points, trace.points[:1]])
    theta = np.unwrap(np.arctan2(*(ring - PITH).T[::-1]))
    steps = np.hypot(*np.diff(ring, axis=0).T)
    return bool(
        trace.closed
        and abs(abs(theta[-1] - theta[0]) - 2 * math.pi) < 1e-6
        and (np.diff(theta) * np.sign(theta[-1] - theta[0]) > -1e-9).all()
        and steps.max() < 2.5
    )


@pytest.mark.parametrize("k", [2, 6, 10])
@pytest.mark.parametrize("start", [0.3, 3.0, 5.9])
def test_a_gap_is_bridged_on_the_circle(k: int, start: float) -> None:
    result = close(with_ring([around(start, 1.3, RADII[k - 1])], k))
    assert sorted(result[1].index) == list(range(1, 11))
    (ring,) = of_index(result, k)
    assert goes_round_once(ring)
    assert off_circle(ring, RADII[k - 1]) < 0.1


def test_pieces_that_run_either_way_become_one_line() -> None:
    radius = RADII[5]
    pieces = [arc(radius, 0.2, 1.5), arc(radius, 3.9, -1.8), arc(radius, 4.4, 1.7)]
    result = close(with_ring(pieces))
    (ring,) = of_index(result, 6)
    assert goes_round_once(ring)
    assert off_circle(ring, radius) < 0.1
    # The pieces are still there, vertex for vertex, as sure as they were.
    for piece in pieces:
        away = np.hypot(*(ring.points[:, None] - piece.points[None]).transpose(2, 0, 1))
        npt.assert_allclose(away.min(axis=0), 0.0)
        npt.assert_allclose(ring.confidence[away.argmin(axis=0)], 0.95)


def test_a_bridge_is_never_believed_more_than_half() -> None:
    piece = around(1.0, 1.3, RADII[5])
    noise = np.random.default_rng(0).normal(size=(SIDE, SIDE))
    for strength in (np.zeros((SIDE, SIDE)), np.abs(noise), 100.0 * np.abs(noise)):
        (ring,) = of_index(close(with_ring([piece]), strength), 6)
        theta = np.arctan2(*(ring.points - PITH).T[::-1]) % (2 * math.pi)
        bridge = (theta > 1.001) & (theta < 2.299)
        assert bridge.sum() > 100
        assert ring.confidence[bridge].max() <= 0.5
        assert ring.confidence[bridge].min() > 0.0
        assert (ring.confidence[~bridge] > 0.9).mean() > 0.98


def test_where_pieces_overlap_a_little_the_line_does_not_turn_back() -> None:
    radius = RADII[9]
    traces, index = with_ring([arc(radius, 0.0, 3.0), arc(radius, 2.98, 2.6)], 10)
    (ring,) = of_index(close((traces, index)), 10)
    assert goes_round_once(ring)
    assert off_circle(ring, radius) < 0.1


@pytest.mark.parametrize("k", [3, 6, 9])
def test_on_an_eccentric_disc_a_bridge_runs_along_its_neighbours(k: int) -> None:
    # On the far side the radius is greatest: a straight line from end to end would cut the corner.
    radius, shift = float(RADII[k - 1]), 8.0 * k / 10
    piece = around(-0.65, 1.3, radius, shift)
    result = close(with_ring([piece], k, shift=8.0))
    (ring,) = of_index(result, k)
    assert goes_round_once(ring)
    assert off_circle(ring, radius, shift) < 0.25


def test_without_neighbours_the_radius_is_carried_over() -> None:
    piece = around(-0.65, 1.3, 100.0, 8.0)
    traces, _ = close(([piece], [1]))
    assert goes_round_once(traces[0])
    ends = np.hypot(*(piece.points[[0, -1]] - PITH).T)
    theta = np.arctan2(*(traces[0].points - PITH).T[::-1])
    bridged = np.hypot(*(traces[0].points - PITH).T)[np.abs(theta) < 0.6]
    npt.assert_allclose(bridged, ends.mean(), atol=0.1)


def test_a_bridge_is_drawn_to_an_edge() -> None:
    # The ring lies a pixel farther out than its neighbours say.
    y, x = np.mgrid[:SIDE, :SIDE]
    radius, theta = np.hypot(x - PITH[0], y - PITH[1]), np.arctan2(y - PITH[1], x - PITH[0])
    swollen = RADII[5] + 1.2 * np.exp(-(((theta - 1.6) / 0.2) ** 2))
    strength = np.exp(-0.5 * ((radius - swollen) / 1.0) ** 2)
    (ring,) = of_index(close(with_ring([around(0.95, 1.3, RADII[5])]), strength), 6)
    at = np.arctan2(*(ring.points - PITH).T[::-1])
    wanted = RADII[5] + 1.2 * np.exp(-(((at - 1.6) / 0.2) ** 2))
    assert np.abs(np.hypot(*(ring.points - PITH).T) - wanted).max() < 0.5
    assert ring.confidence[np.abs(at - 1.6) < 0.4].min() > 0.3


def same(result: tuple[list[Trace], Order], disc: Disc) -> None:
    """Nothing was joined and nothing removed."""
    assert list(result[1].index) == disc[1]
    for found, given in zip(result[0], disc[0], strict=True):
        npt.assert_array_equal(found.points, given.points)
        npt.assert_array_equal(found.confidence, given.confidence)
        assert found.closed == given.closed


def test_closed_rings_stay_as_they_are() -> None:
    same(close(whole(5.0)), whole(5.0))


@pytest.mark.parametrize(("gap", "bridged"), [(1.37, True), (1.43, False)])
def test_wider_gaps_are_not_bridged(gap: float, bridged: bool) -> None:
    disc = with_ring([around(2.0, gap, RADII[5])])
    result = close(disc)
    assert goes_round_once(of_index(result, 6)[0]) == bridged
    if not bridged:
        same(result, disc)


def test_pieces_that_overlap_are_not_joined() -> None:
    disc = with_ring([arc(RADII[5], 0.0, 3.5), arc(RADII[5] + 3.0, 3.3, 2.5)])
    same(close(disc), disc)


def test_pieces_of_another_group_are_not_joined() -> None:
    traces, index = with_ring([arc(RADII[5], 0.0, 3.0), arc(RADII[5], 3.1, 3.0)])
    order = ordered(index)
    order.group[-1] = 1
    fields = np.zeros((SIDE, SIDE)), np.full((SIDE, SIDE), 1 / WIDTH), np.ones((SIDE, SIDE), bool)
    result = close_rings(traces, order, PITH, *fields)
    same(result, (traces, index))
    npt.assert_array_equal(result[1].group, order.group)


def test_a_short_piece_is_no_ring() -> None:
    disc = with_ring([arc(RADII[5], 0.0, 0.8), arc(RADII[5], 2.0, 0.8), arc(RADII[5], 4.0, 0.8)])
    same(close(disc), disc)


def test_no_bridge_leaves_the_wood() -> None:
    disc = with_ring([around(-0.6, 1.2, RADII[5])])
    valid = np.ones((SIDE, SIDE), bool)
    valid[:, 290:] = False
    same(close(disc, valid=valid), disc)
    assert goes_round_once(of_index(close(disc), 6)[0])


def test_a_bridge_does_not_leave_the_picture() -> None:
    # A disc cut off by the picture's edge.
    disc = [around(-0.6, 1.2, 230.0)], [1]
    same(close(disc), disc)


def test_a_sure_line_in_the_way_keeps_a_gap_open() -> None:
    way = arc(RADII[5] + 1.0, 1.3, 0.7, sure=0.95)
    traces, index = with_ring([around(1.0, 1.3, RADII[5])])
    disc = [*traces, way], [*index, 7]
    # It overlaps with the closed seventh ring, which therefore is no guide; it is a sure line all the same.
    same(close(disc), disc)


def test_a_doubtful_fragment_in_the_way_is_removed() -> None:
    way = arc(RADII[5] + 1.0, 1.3, 0.7, sure=0.7)
    beside = arc(RADII[5] + 8.0, 1.3, 0.7, sure=0.7)
    traces, index = with_ring([around(1.0, 1.3, RADII[5])])
    result = close(([*traces, way, beside], [*index, 42, 43]))
    assert sorted(result[1].index) == [*range(1, 11), 43]
    (ring,) = of_index(result, 6)
    assert goes_round_once(ring)
    assert off_circle(ring, RADII[5]) < 0.1
    npt.assert_array_equal(of_index(result, 43)[0].points, beside.points)


def test_a_doubtful_line_that_goes_on_beyond_the_gap_is_kept() -> None:
    # It crosses the gap and runs between the rings on either side.
    theta = np.linspace(0.0, 3.3, 340)
    radius = RADII[5] + 8.0 * np.clip((theta - 1.65) / 0.3, -1.0, 1.0)
    points = np.stack([np.cos(theta), np.sin(theta)], axis=1) * radius[:, None] + PITH
    traces, index = with_ring([around(1.0, 1.3, RADII[5])])
    disc = [*traces, Trace(points, np.full(340, 0.7), False)], [*index, 42]
    same(close(disc), disc)


def test_what_one_bridge_removed_does_not_come_back_in_another() -> None:
    # A doubtful fragment of the seventh ring runs onto the sixth where both are missing.
    fragment = arc(RADII[5] + 1.0, 1.3, 0.7, sure=0.7)
    traces, index = with_ring([around(1.0, 1.3, RADII[5])])
    seventh = index.index(7)
    traces[seventh] = arc(RADII[6], 2.3, 1.7)
    result = close(([*traces, arc(RADII[6], 5.0, 2.2), fragment], [*index, 7, 7]))
    for k in (6, 7):
        (ring,) = of_index(result, k)
        assert goes_round_once(ring)
        assert off_circle(ring, RADII[k - 1]) < 0.2


def test_a_bridge_does_not_meet_one_that_was_joined_before() -> None:
    # Without a closed neighbour the eighth ring's gap would be bridged straight across the sixth's swelling.
    theta = np.arange(-math.pi, math.pi, 0.01)
    swelling = np.exp(-((theta / 0.25) ** 2))
    inner = 80.0 + 30.0 * swelling
    keep = np.abs(theta - 2.5) > 0.4
    start = int(np.flatnonzero(~keep)[-1]) + 1
    turned = np.roll(np.arange(len(theta)), -start)
    turned = turned[keep[turned]]
    away = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    pieces = [
        Trace((away * inner[:, None] + PITH)[turned], np.full(len(turned), 0.95), False),
        around(-0.6, 1.2, 100.0),
    ]
    traces, order = close((pieces, [6, 8]))
    assert sorted(order.index) == [6, 8]
    assert {int(k): trace.closed for k, trace in zip(order.index, traces, strict=True)} == {6: True, 8: False}


def test_small_rings_guide_like_large_ones() -> None:
    # A vertex of the innermost rings passes several directions, and none may be lost.
    radius, shift = 24.0, 5.0
    traces = [arc(12.0, shift=shift), around(-0.65, 1.3, radius, shift), arc(36.0, shift=shift)]
    result = close((traces, [1, 2, 3]))
    (ring,) = of_index(result, 2)
    assert off_circle(ring, radius, shift) < 0.3


def rotated(trace: Trace) -> Trace:
    """Turned by 90 degrees about the pith, from right towards down."""
    x, y = (trace.points - PITH).T
    return Trace(np.stack([-y, x], axis=1) + PITH, trace.confidence, trace.closed)


def test_a_rotated_disc_is_closed_alike() -> None:
    disc = with_ring([arc(RADII[5], 0.2, 2.5, 6.0), arc(RADII[5], 3.4, 2.2, 6.0)], shift=10.0)
    strength = np.random.default_rng(3).random((SIDE, SIDE))
    plain, order = close(disc, strength)
    turned, turned_order = close(([rotated(t) for t in disc[0]], disc[1]), np.rot90(strength, -1))
    npt.assert_array_equal(turned_order.index, order.index)
    assert any(not given.closed for given in disc[0])
    assert all(trace.closed for trace in plain)
    for one, other in zip(plain, turned, strict=True):
        wanted = rotated(one)
        # A ring may start at another of its pieces.
        first = int(np.argmin(np.hypot(*(other.points - wanted.points[0]).T)))
        npt.assert_allclose(np.roll(other.points, -first, axis=0), wanted.points, atol=1e-3)
        npt.assert_allclose(np.roll(other.confidence, -first), wanted.confidence, atol=1e-3)
    npt.assert_array_equal(
        uneven_counts([rotated(t) for t in disc[0]], ordered(disc[1]), PITH),
        np.roll(uneven_counts(disc[0], ordered(disc[1]), PITH), 180),
    )


def test_numbers_of_pieces_are_kept() -> None:
    traces, index = with_ring([arc(RADII[5], 0.0, 3.0), arc(RADII[5], 3.1, 3.0)])
    order = ordered([k + 30 for k in index])
    order.agreement[-2:] = 0.4, 0.6
    fields = np.zeros((SIDE, SIDE)), np.full((SIDE, SIDE), 1 / WIDTH), np.ones((SIDE, SIDE), bool)
    _, found = close_rings(traces, order, PITH, *fields)
    npt.assert_array_equal(np.sort(found.index), np.arange(31, 41))
    assert found.agreement[list(found.index).index(36)] == pytest.approx(0.5)
    assert (found.group == 0).all()


@pytest.mark.parametrize("shift", [0.0, 6.0])
def test_full_rings_have_even_counts_everywhere(shift: float) -> None:
    traces, index = whole(shift)
    assert not uneven_counts(traces, ordered(index), PITH).any()
    assert describe_uneven(traces, ordered(index), PITH) == []


@pytest.mark.parametrize("k", [2, 6, 9])
@pytest.mark.parametrize("start", [0.5, 2.9, 6.0])
def test_a_wedging_ring_is_flagged_where_it_is_missing(k: int, start: float) -> None:
    traces, index = with_ring([around(start, 1.0, RADII[k - 1])], k)
    uneven = uneven_counts(traces, ordered(index), PITH)
    direction = np.radians(0.5 * np.arange(720))
    into = (direction - start) % (2 * math.pi)
    at_the_ends = np.minimum(np.abs(into), np.abs(into - 1.0)) < np.radians(0.6)
    npt.assert_array_equal(uneven[~at_the_ends], (into < 1.0)[~at_the_ends])
    assert uneven.shape == (720,)


def test_a_missing_outermost_ring_is_not_flagged() -> None:
    # Bark and a broken rim end the count, they do not break it.
    traces, index = with_ring([around(1.0, 2.0, RADII[9])], 10)
    assert not uneven_counts(traces, ordered(index), PITH).any()


def test_rings_that_swap_or_skip_are_flagged() -> None:
    traces, _ = whole()
    assert uneven_counts(traces, ordered([1, 2, 3, 5, 4, 6, 7, 8, 9, 10]), PITH).all()
    assert uneven_counts(traces, ordered([1, 2, 3, 4, 4, 5, 6, 7, 8, 9]), PITH).all()
    assert uneven_counts(traces, ordered([1, 2, 3, 4, 6, 7, 8, 9, 10, 11]), PITH).all()


def test_other_groups_do_not_count() -> None:
    traces, index = whole()
    order = ordered([*index, 3])
    order.group[-1] = 1
    assert not uneven_counts([*traces, arc(RADII[4] + 5, 0.0, 1.0)], order, PITH).any()


def test_where_rings_are_missing_is_said_in_degrees() -> None:
    traces, index = with_ring([around(math.radians(60.2), math.radians(35.6), RADII[5])])
    (said,) = describe_uneven(traces, ordered(index), PITH)
    assert "In 10 % of the directions" in said
    assert said.endswith("right towards down: 60 to 96).")
