"""The two sides of the pith on a board: they show the same rings, and streaks between them are none."""

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernel_scenes import Array, wood

from woodfit.ring_order import _matched_sides, order_rings
from woodfit.ring_sides import matched_shift, sides_of, without_streaks
from woodfit.ring_walks import Votes
from woodfit.settled_numbers import joined
from woodfit.tracing import Trace

SHAPE = (200, 400)
MIDDLE = 200.0

#: Distances of the boundaries from the pith on a flat-sawn face: one ring covers the wide middle.
AWAY = np.array([60.0, 92.0, 116.0, 134.0, 156.0, 168.0, 186.0])


def upright(x: float) -> Array:
    y = np.arange(0.0, SHAPE[0])
    return np.stack([np.full(len(y), x), y], axis=1)


def fields() -> tuple[Array, Array]:
    """Growth away from the middle, and about the local number of rings per px."""
    x = np.broadcast_to(np.arange(float(SHAPE[1])), SHAPE)
    growth = np.where(x < MIDDLE, np.pi, 0.0)
    frequency = np.where(np.abs(x - MIDDLE) < 60.0, 1 / 55.0, 1 / 24.0)
    return growth, frequency


def board() -> list[Array]:
    return [upright(MIDDLE + side * away) for away in AWAY for side in (-1.0, 1.0)]


def number(lines: list[Array]) -> list[int]:
    growth, frequency = fields()
    kept, order = order_rings(lines, [False] * len(lines), growth, frequency, wood(SHAPE))
    assert kept.tolist() == list(range(len(lines)))
    return order.index.tolist()


def test_both_sides_of_a_board_have_the_same_numbers() -> None:
    assert number(board()) == [n for n in range(1, 8) for _ in range(2)]


@pytest.mark.parametrize("streak", [MIDDLE - 20.0, MIDDLE + 25.0])
def test_a_streak_on_one_side_of_the_middle_does_not_shift_the_numbers_of_the_other(streak: float) -> None:
    index = number([*board(), upright(streak)])
    assert index[:14:2] == index[1:14:2]
    assert np.diff(index[:14:2]).tolist() == [1] * 6
    assert index[14] < index[0]


def test_a_ring_that_one_side_misses_does_not_shift_them_either() -> None:
    index = number(board()[1:])
    assert index[1::2] == index[2::2]


def test_a_ring_traced_over_both_sides_outweighs_their_widths() -> None:
    # Left 1-5, right 6-11, and 12 outside of both: by the widths the outermost ring on the right would lie outside it.
    left, right = [10.0, 14.0, 20.0, 12.0], [10.0, 14.0, 20.0, 12.0, 17.0]
    votes = Votes({(5, 12, 1): 200.0, (11, 12, 1): 200.0, (1, 6, 0): 30.0}, {})
    for first, widths in ((1, left), (6, right)):
        for number, width in enumerate(widths, start=first):
            votes.weight[number, number + 1, 1] = 40.0
            votes.way[number, number + 1] = [width]
    side = np.array([1] * 5 + [-1] * 6 + [0])
    counted = joined(votes.weight, 12)
    assert matched_shift(dict(enumerate(left)), dict(enumerate(right, start=-1)), 0) != 0
    assert _matched_sides(counted, votes, side) is counted
    # Without that ring the widths are believed.
    for pair in ((5, 12), (11, 12)):
        del votes.weight[(*pair, 1)]
    votes.weight[5, 11, 0] = 30.0
    tied = _matched_sides(joined(votes.weight, 12), votes, side)
    assert [tied.difference(a, a + 5) for a in range(5)] == [0] * 5


def test_rings_with_nothing_in_common_keep_the_count() -> None:
    assert matched_shift({1: 20.0, 2: 21.0, 3: 20.0}, {1: 20.0, 2: 20.0, 3: 21.0, 4: 20.0}, 0) == 0
    assert matched_shift({}, {1: 20.0}, 0) == 0
    assert matched_shift({1: 20.0}, {5: 20.0}, 0) == 0


@given(seed=st.integers(0, 10_000), off=st.integers(-2, 2), count=st.integers(9, 20))
def test_widths_tell_the_count_whatever_it_was(seed: int, off: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    widths = 20.0 * np.exp(rng.normal(0.0, 0.3, count))
    one = dict(enumerate((widths * np.exp(rng.normal(0.0, 0.02, count))).tolist()))
    other = {index + 7: 1.2 * width for index, width in enumerate(widths.tolist())}
    found = matched_shift(one, other, -7 + off)
    assert found == -off
    # Told the other way round, the sides are shifted the other way.
    assert matched_shift(other, one, 7 - off) == off


def test_sides_are_told_by_where_growth_goes() -> None:
    growth, _ = fields()
    side = sides_of([upright(50.0), upright(350.0), np.array([[x, 100.0] for x in range(150, 250)])], growth)
    assert side[0] * side[1] == -1
    assert side[2] == 0
    npt.assert_array_equal(sides_of([upright(50.0), upright(90.0)], growth), 0)
    assert len(sides_of([], growth)) == 0


def traces(*lines: Array) -> list[Trace]:
    return [Trace(line, np.ones(len(line)), False) for line in lines]


def test_streaks_between_the_sides_are_no_boundaries() -> None:
    growth, _ = fields()
    strength = np.full(SHAPE, 0.02, np.float32)
    strength[:, 150:250] = 0.003
    # The innermost boundary on the left fades into the middle half-way down.
    strength[100:, 130:150] = 0.003
    lines = traces(*board(), upright(180.0))
    index = np.array([*(n for n in range(2, 9) for _ in range(2)), 1])
    kept = without_streaks(lines, index, growth, strength, 10.0)
    assert len(kept) == 14
    assert 80 < len(kept[0].points) < 125
    assert all(one is other for one, other in zip(kept[1:], lines[1:14], strict=True))
    # Farther out a faint boundary stays.
    strength[:, 300:325] = 0.003
    assert len(without_streaks(lines, index, growth, strength, 10.0)) == 14


def test_a_face_with_one_side_keeps_all_its_boundaries() -> None:
    lines = traces(upright(50.0), upright(70.0), upright(90.0))
    strength = np.zeros(SHAPE, np.float32)
    strength[:, :60] = 0.02
    assert without_streaks(lines, np.array([3, 2, 1]), fields()[0], strength, 20.0) is lines
