"""Rings missing between traced boundaries: the edges seen there correct what the wave counts."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import wood
from numpy.typing import NDArray

from woodfit.boundary import edges_between
from woodfit.ring_order import order_rings

SHAPE = (200, 120)
BOUNDARIES = [20.0, 40.0, 60.0, 120.0, 140.0]

Array = NDArray[np.float64]


def bump(at: float, height: float, width: float = 1.2) -> Array:
    row = np.arange(SHAPE[0], dtype=float)[:, None]
    return np.asarray(height * np.exp(-(((row - at) / width) ** 2) / 2.0) * np.ones(SHAPE))


def bumps(edges: list[tuple[float, float]]) -> Array:
    """Strength of edges at given rows, each with its height."""
    return np.asarray(sum(bump(at, height) for at, height in edges))


def edges(*faint: tuple[float, float]) -> Array:
    """Strength of the edges at the boundaries, 1 each, and of fainter ones at given places."""
    return bumps([*((at, 1.0) for at in BOUNDARIES), *faint])


def parallel(places: list[float]) -> list[Array]:
    x = np.arange(0.0, SHAPE[1])
    return [np.stack([x, np.full(len(x), at)], axis=1) for at in places]


def ordered(lines: list[Array], strength: Array | None) -> list[int]:
    growth, frequency = np.full(SHAPE, np.pi / 2), np.full(SHAPE, 1 / 20.0)
    return order_rings(lines, [False] * len(lines), growth, frequency, wood(SHAPE), strength=strength).index.tolist()


def indices(strength: Array | None) -> list[int]:
    return ordered(parallel(BOUNDARIES), strength)


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


@pytest.mark.parametrize("strong", [0.3, 0.8])
def test_a_narrow_ring_that_the_wave_does_not_count_is_missing_where_a_clear_edge_is_seen(strong: float) -> None:
    strength = bumps([*((at, 1.0) for at in MANY), (67.0, strong)])
    missing = int(strong > 0.5)
    assert ordered(parallel(MANY), strength) == [1, 2, 3, 4, *range(5 + missing, 13 + missing)]


def test_where_many_neighbours_have_edges_between_them_they_are_fibre() -> None:
    strength = bumps([*((at, 1.0) for at in MANY), *((at + 7.0, 0.8) for at in MANY[:3])])
    assert ordered(parallel(MANY), strength) == list(range(1, 13))


def test_an_edge_on_a_part_of_the_way_along_the_boundaries_is_no_ring() -> None:
    strength = bumps([(at, 1.0) for at in MANY])
    strength[:, :60] += bump(67.0, 0.8)[:, :60]
    assert ordered(parallel(MANY), strength) == list(range(1, 13))


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
