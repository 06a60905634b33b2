"""Numbers out of votes that contradict each other: whoever walks outwards has passed a ring at each boundary."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernel_scenes import Array, wood

from woodfit.ring_order import Order, order_rings
from woodfit.settled_numbers import Vote, joined, misfits, offended, settle

SHAPE = (160, 400)


def piece(row: float, begin: float = 0.0, end: float = SHAPE[1]) -> Array:
    x = np.arange(begin, end)
    return np.stack([x, np.full(len(x), row)], axis=1)


def placed(lines: list[Array], width: float = 20.0) -> tuple[list[int], Order]:
    growth, frequency = np.full(SHAPE, np.pi / 2), np.full(SHAPE, 1 / width)
    kept, order = order_rings(lines, [False] * len(lines), growth, frequency, wood(SHAPE))
    return kept.tolist(), order


# --- pieces ---------------------------------------------------------------------------------------------------
RINGS = [20.0, 40.0, 60.0, 80.0, 100.0]


@pytest.mark.parametrize("row", [49.0, 52.0, 70.0])
def test_a_short_line_between_two_neighbouring_rings_is_none(row: float) -> None:
    kept, order = placed([*(piece(at) for at in RINGS), piece(row, 150.0, 230.0)])
    assert kept == [0, 1, 2, 3, 4]
    assert order.index.tolist() == [1, 2, 3, 4, 5]
    assert set(order.group.tolist()) == {0}


def test_a_short_piece_of_a_missing_ring_is_kept() -> None:
    lines = [piece(at) for at in RINGS if at != 60.0]
    kept, order = placed([*lines, piece(60.0, 150.0, 230.0)])
    assert kept == [0, 1, 2, 3, 4]
    assert order.index.tolist() == [1, 2, 4, 5, 3]


def test_short_pieces_of_one_ring_are_kept() -> None:
    pieces = [piece(60.0, begin, begin + 70.0) for begin in (0.0, 110.0, 220.0, 330.0)]
    kept, order = placed([*(piece(at) for at in RINGS if at != 60.0), *pieces])
    assert len(kept) == 8
    assert order.index.tolist() == [1, 2, 4, 5, 3, 3, 3, 3]


def test_a_long_line_between_two_rings_pushes_the_outer_ones_on() -> None:
    # Too long to be a streak: it is a narrow ring that ends, as beside a wound.
    kept, order = placed([*(piece(at) for at in RINGS), piece(50.0, 0.0, 370.0)])
    assert len(kept) == 6
    assert order.index.tolist() == [1, 2, 4, 5, 6, 3]


def test_a_line_along_half_a_ring_does_not_push_them_on() -> None:
    # Half a ring to each side of it: a streak, or the edge of a stain. Where it ends its neighbours are one ring apart.
    kept, order = placed([*(piece(at) for at in RINGS), piece(50.0, 0.0, 260.0)])
    assert len(kept) == 6
    assert order.index[:5].tolist() == [1, 2, 3, 4, 5]
    assert order.index[5] in (2, 3)


def test_nothing_is_left_out_of_nothing() -> None:
    kept, order = placed([])
    assert kept == []
    assert len(order.index) == len(order.group) == len(order.agreement) == 0
    assert settle({}, 3).numbers().tolist() == [0, 0, 0]
    assert misfits({}, np.zeros(2, np.int64), np.ones(2)).tolist() == [False, False]


# --- votes ----------------------------------------------------------------------------------------------------
def above_first(weight: dict[Vote, float], count: int) -> list[int | None]:
    tied = settle(weight, count)
    return [tied.difference(0, node) for node in range(count)]


def test_the_weakest_link_of_a_contradicted_chain_is_mended() -> None:
    # Red oak: 1 and 4 are neighbours on the left, on the right two more rings lie between them.
    votes: dict[Vote, float] = {(1, 2, 1): 41.0, (1, 2, 2): 43.5, (1, 4, 1): 36.0, (2, 3, 1): 173.0, (3, 4, 1): 195.0}
    assert joined(votes, 4).difference(0, 1) == -1
    assert above_first(votes, 4) == [0, 2, 3, 4]


def test_several_rings_one_by_one_say_more_than_a_count_of_them_in_one_go() -> None:
    # A core: 1 and 4 are counted two rings apart where 2 and 3 are not traced.
    votes: dict[Vote, float] = {(1, 2, 1): 21.0, (2, 3, 1): 26.5, (3, 4, 1): 33.0, (1, 4, 2): 24.1}
    assert joined(votes, 4).difference(0, 1) == 0
    assert above_first(votes, 4) == [0, 1, 2, 3]


def test_a_long_streak_does_not_outweigh_what_is_counted_along_most_of_the_ring() -> None:
    # A rough disc: 4 follows 1 all round but for one side, where 2 and 3 are a streak and a piece of 4.
    votes: dict[Vote, float] = {(1, 2, 1): 119.0, (2, 3, 1): 90.0, (3, 4, 1): 71.0, (1, 4, 1): 186.0}
    assert above_first(votes, 4) == [0, 1, 2, 1]


def test_one_walk_that_slipped_past_the_end_of_a_line_mends_nothing() -> None:
    votes: dict[Vote, float] = {(1, 2, 1): 100.0, (2, 3, 1): 100.0, (3, 4, 1): 100.0, (1, 4, -1): 2.0}
    assert above_first(votes, 4) == [0, 1, 2, 3]


@st.composite
def consistent(draw: st.DrawFn) -> tuple[list[int], dict[Vote, float]]:
    """True numbers, and votes that tie all of them."""
    numbers = draw(st.lists(st.integers(0, 12), min_size=2, max_size=12))
    votes: dict[Vote, float] = {}
    for b in range(2, len(numbers) + 1):
        for a in draw(st.sets(st.integers(1, b - 1), min_size=1, max_size=3)):
            votes[a, b, numbers[b - 1] - numbers[a - 1]] = draw(st.floats(0.5, 300.0))
    return numbers, votes


@given(consistent())
def test_votes_that_agree_are_satisfied(case: tuple[list[int], dict[Vote, float]]) -> None:
    numbers, votes = case
    assert above_first(votes, len(numbers)) == [number - numbers[0] for number in numbers]
    assert offended(votes, settle(votes, len(numbers)).numbers()) == 0.0


@given(consistent(), st.data())
def test_settling_never_leaves_more_than_it_found(
    case: tuple[list[int], dict[Vote, float]], data: st.DataObject
) -> None:
    numbers, votes = case
    for _ in range(data.draw(st.integers(1, 6))):
        a = data.draw(st.integers(1, len(numbers) - 1))
        b = data.draw(st.integers(a + 1, len(numbers)))
        votes[a, b, data.draw(st.integers(-4, 4))] = data.draw(st.floats(0.5, 300.0))

    def missed(found: Array) -> float:
        """Weight that is not satisfied, once more where it is against the order of growth: the slow twin."""
        total = 0.0
        for (a, b, apart), of in votes.items():
            is_apart = int(found[b - 1] - found[a - 1])
            total += of * (is_apart != apart) + of * (apart != 0 and is_apart * apart <= 0)
        return total

    before, after = joined(votes, len(numbers)), settle(votes, len(numbers))
    assert missed(after.numbers()) <= missed(before.numbers()) + 1e-6
    # All that votes tie stays tied.
    assert [before.difference(0, b) is None for b in range(len(numbers))] == [
        after.difference(0, b) is None for b in range(len(numbers))
    ]


def test_many_rings_in_many_pieces_are_settled_though_a_tenth_of_the_votes_is_wrong() -> None:
    rng = np.random.default_rng(4)
    rings, pieces = 40, 12
    number = np.repeat(np.arange(rings), pieces)
    votes: dict[Vote, float] = {}
    for ring in range(rings - 1):
        for at in range(pieces):
            a, b = ring * pieces + at + 1, (ring + 1) * pieces + at + 1
            slip = int(rng.choice([1, -2])) if rng.random() < 0.1 else 0
            votes[a, b, 1 + slip] = float(rng.uniform(10.0, 30.0))
            votes[a, (ring + 1) * pieces + (at + 1) % pieces + 1, 1] = float(rng.uniform(5.0, 15.0))
    settled = settle(votes, len(number)).numbers()
    right = (settled - settled[0] == number - number[0]).mean()
    first = joined(votes, len(number)).numbers()
    assert right >= (first - first[0] == number - number[0]).mean()
    assert offended(votes, settled) <= offended(votes, first)
