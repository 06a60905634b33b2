"""The numbers of boundaries: neighbours follow one another, and rings missing between them are counted."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import Array, round_age, wood

from woodfit.boundary import edges_between
from woodfit.ring_order import order_rings

SHAPE = (200, 120)
BOUNDARIES = [20.0, 40.0, 60.0, 120.0, 140.0]


# --- neighbours ---------------------------------------------------------------------------------------------
def lines_at(rows: list[float], length: int = SHAPE[1]) -> list[Array]:
    """Boundaries along the rows, from the left border to `length`."""
    x = np.arange(0.0, length)
    return [np.stack([x, np.full(length, row)], axis=1) for row in rows]


def parallel_lines(numbers: list[int]) -> list[Array]:
    return lines_at([15.0 * n for n in numbers], 200)


def order_of(
    lines: list[Array], shape: tuple[int, int] = (160, 200), width: float = 15.0
) -> tuple[list[int], list[int]]:
    growth, frequency = np.full(shape, np.pi / 2), np.full(shape, 1 / width)
    kept, order = order_rings(lines, [False] * len(lines), growth, frequency, wood(shape))
    assert kept.tolist() == list(range(len(lines)))
    assert ((order.agreement >= 0.0) & (order.agreement <= 1.0)).all()
    return order.index.tolist(), order.group.tolist()


def test_neighbours_get_consecutive_indices_whatever_their_order() -> None:
    numbers = [4, 1, 9, 2, 3, 8, 5, 7, 6]
    index, group = order_of(parallel_lines(numbers))
    assert index == numbers
    assert set(group) == {0}


def test_a_missing_ring_leaves_its_index_free() -> None:
    numbers = [1, 2, 3, 5, 6, 9]
    index, group = order_of(parallel_lines(numbers))
    assert index == numbers
    assert set(group) == {0}


def test_the_pieces_of_a_broken_ring_share_their_index() -> None:
    lines = parallel_lines([1, 2, 3, 4])
    broken = [lines[0], lines[1], lines[2][:80], lines[2][130:], lines[3]]
    index, group = order_of(broken)
    assert index == [1, 2, 3, 3, 4]
    assert set(group) == {0}


def test_a_gap_in_one_place_is_bridged_by_another() -> None:
    lines = parallel_lines([1, 2, 3, 4, 5, 6])
    holed = [lines[0], lines[1][:90], lines[2][:70], lines[3][:110], lines[4], lines[5]]
    index, _ = order_of(holed)
    assert index == [1, 2, 3, 4, 5, 6]


def test_rings_are_numbered_through_the_pith() -> None:
    shape = (200, 200)
    age, outwards = round_age(shape, (100.0, 100.0), 18.0)
    turn = np.linspace(0, 2 * np.pi, 300)
    lines = [100.0 + 18.0 * n * np.stack([np.cos(turn), np.sin(turn)], axis=1) for n in range(1, 6)]
    halves = [half for line in lines for half in (line[:120], line[150:270])]
    _, order = order_rings(halves, [False] * 10, outwards, np.full(shape, 1 / 18.0), wood(shape))
    assert order.index.tolist() == [1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
    _, whole = order_rings(lines, [True] * 5, outwards, np.full(shape, 1 / 18.0), wood(shape))
    assert whole.index.tolist() == [1, 2, 3, 4, 5]
    assert whole.agreement.min() > 0.9
    assert age.max() > 5


def test_nothing_and_a_single_ring_are_ordered_too() -> None:
    assert order_of([]) == ([], [])
    assert order_of(parallel_lines([3])) == ([1], [0])


# --- rings missing between them -----------------------------------------------------------------------------
def bump(at: float, height: float, width: float = 1.2) -> Array:
    row = np.arange(SHAPE[0], dtype=float)[:, None]
    return np.asarray(height * np.exp(-(((row - at) / width) ** 2) / 2.0) * np.ones(SHAPE))


def bumps(edges: list[tuple[float, float]]) -> Array:
    """Strength of edges at given rows, each with its height."""
    return np.asarray(sum(bump(at, height) for at, height in edges))


def edges(*faint: tuple[float, float]) -> Array:
    """Strength of the edges at the boundaries, 1 each, and of fainter ones at given places."""
    return bumps([*((at, 1.0) for at in BOUNDARIES), *faint])


def ordered(lines: list[Array], strength: Array | None) -> list[int]:
    growth, frequency = np.full(SHAPE, np.pi / 2), np.full(SHAPE, 1 / 20.0)
    kept, order = order_rings(lines, [False] * len(lines), growth, frequency, wood(SHAPE), strength=strength)
    assert kept.tolist() == list(range(len(lines)))
    return order.index.tolist()


def indices(strength: Array | None) -> list[int]:
    return ordered(lines_at(BOUNDARIES), strength)


def test_without_edges_to_look_at_the_wave_counts() -> None:
    assert indices(None) == [1, 2, 3, 6, 7]


@pytest.mark.parametrize(
    ("faint", "expected"),
    [
        ([], [1, 2, 3, 4, 5]),
        ([(90.0, 0.3)], [1, 2, 3, 5, 6]),
        ([(80.0, 0.3), (100.0, 0.4)], [1, 2, 3, 6, 7]),
        # More edges than the wave counts rings: fibre is no ring.
        ([(75.0, 0.3), (85.0, 0.3), (95.0, 0.3), (105.0, 0.3)], [1, 2, 3, 6, 7]),
        ([(90.0, 0.05)], [1, 2, 3, 4, 5]),
    ],
)
def test_no_more_rings_are_missing_than_edges_are_seen(faint: list[tuple[float, float]], expected: list[int]) -> None:
    assert indices(edges(*faint)) == expected


def test_an_edge_that_only_stays_the_darkening_of_the_wood_is_one() -> None:
    # A pale ring among dark ones: the wood darkens before it and after it, and between it just does not.
    darkening = -0.3 * (np.abs(np.arange(SHAPE[0]) - 90.0) < 24.0)[:, None] * np.ones(SHAPE)
    assert indices(edges() + darkening) == [1, 2, 3, 4, 5]
    assert indices(edges((90.0, 0.3)) + darkening) == [1, 2, 3, 5, 6]


MANY = [15.0 * n for n in range(1, 13)]
LINES = lines_at(MANY)


@pytest.mark.parametrize("strong", [0.3, 0.8])
def test_a_narrow_ring_that_the_wave_does_not_count_is_missing_where_a_clear_edge_is_seen(strong: float) -> None:
    strength = bumps([*((at, 1.0) for at in MANY), (67.0, strong)])
    missing = int(strong > 0.5)
    assert ordered(LINES, strength) == [1, 2, 3, 4, *range(5 + missing, 13 + missing)]


def test_where_many_neighbours_have_edges_between_them_they_are_fibre() -> None:
    strength = bumps([*((at, 1.0) for at in MANY), *((at + 7.0, 0.8) for at in MANY[:3])])
    assert ordered(LINES, strength) == list(range(1, 13))


def test_an_edge_on_a_part_of_the_way_along_the_boundaries_is_no_ring() -> None:
    strength = bumps([(at, 1.0) for at in MANY])
    strength[:, :60] += bump(67.0, 0.8)[:, :60]
    assert ordered(LINES, strength) == list(range(1, 13))


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("backwards", [False, True])
def test_edges_are_counted_whichever_way_is_taken(count: int, backwards: bool) -> None:
    strength = edges(*((60.0 + 60.0 * (i + 1) / (count + 1), 0.5) for i in range(count)))
    ways = np.array([[x, 60.0, x + 7.0, 120.0] for x in (10.0, 50.0, 90.0)])
    ways = ways[:, [2, 3, 0, 1]] if backwards else ways
    npt.assert_array_equal(edges_between(strength, ways, 0.15), count)
    npt.assert_array_equal(edges_between(strength, ways, 0.6), 0)
    # A share has no unit: neither light nor contrast change the count.
    npt.assert_array_equal(edges_between(7.0 * strength, ways, 0.15), count)


def test_many_ways_are_counted_as_few_are() -> None:
    strength = edges((90.0, 0.5))
    ways = np.array([[50.0, 60.0, 50.0, 120.0], [50.0, 20.0, 50.0, 40.0]] * 9000)
    npt.assert_array_equal(edges_between(strength, ways, 0.15), [1, 0] * 9000)
