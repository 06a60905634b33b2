"""Parts of a correction, on arrays: a line moved through a point, and who counts before whom."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
from hypothesis import given
from hypothesis import strategies as st
from test_correction import distance

from woodfit.added_boundary import shift_through
from woodfit.corrected_order import Tie, corrected_order
from woodfit.ring_order import Order
from woodfit.tracing import Trace


@given(
    at=st.floats(0.0, 1.0),
    across=st.floats(-4.0, 4.0),
    reach=st.floats(5.0, 40.0),
    closed=st.booleans(),
    count=st.integers(12, 200),
)
def test_a_shifted_line_passes_through_the_point(
    at: float, across: float, reach: float, closed: bool, count: int
) -> None:
    turn = np.linspace(0.0, 2 * np.pi, count, endpoint=not closed)[:, None]
    radius = count / (2 * np.pi)
    line = Trace(radius * np.concatenate([np.cos(turn), np.sin(turn)], axis=1), np.zeros(count), closed)
    angle = 2 * np.pi * (0.25 + 0.5 * at)
    point = (radius + np.clip(across, -0.5 * radius, None)) * np.array([np.cos(angle), np.sin(angle)])
    moved = shift_through(line, point, reach)
    ring = np.concatenate([moved.points, moved.points[:1]]) if closed else moved.points
    assert distance(point, ring) < 1e-9
    assert moved.confidence.max() == 1.0
    far = np.hypot(*(line.points - point).T) > reach + abs(across) + 2.0
    npt.assert_array_equal(moved.points[far], line.points[far])


def test_indices_follow_the_person_first_and_the_tracing_second() -> None:
    # Rings 1..6 traced, 3 in two pieces, of which the person's path meets the first; group 1 lies apart.
    traced_order = Order(np.array([1, 2, 3, 3, 4, 5, 6, 1]), np.array([0, 0, 0, 0, 0, 0, 0, 1]), np.full(8, 0.5))
    length = [10] * 8
    old = list(range(8))
    order, clashes = corrected_order(traced_order, old, [], length, [Tie(1, 2, 3, False, "p")], {1, 2})
    assert order.index.tolist() == [1, 2, 5, 5, 6, 7, 8, 1]
    assert order.group.tolist() == [0, 0, 0, 0, 0, 0, 0, 1]
    assert order.agreement.tolist() == [0.5, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5]
    assert clashes == []
    # A ring without room between consecutive marks is loose, and said to be.
    order, clashes = corrected_order(traced_order, old, [], length, [Tie(1, 4, 1, False, "p")], {1, 4})
    assert (order.index[[0, 1, 4, 5, 6]] - order.index[1]).tolist() == [-1, 0, 1, 2, 3]
    assert order.group[[0, 1, 4, 5, 6]].tolist() == [0] * 5
    assert order.group[2] == order.group[3] != 0
    assert "2 traced boundaries" in clashes[0]
    # Removed rings do not count, not even across a gap.
    order, clashes = corrected_order(traced_order, [0, 1, 4, 5], [2, 3], length[:4], [Tie(1, 2, 9, True, "p")], {1, 2})
    assert order.index.tolist() == [1, 2, 3, 4]
    # Two people who count differently are both named.
    ties = [Tie(0, 1, 1, False, "one"), Tie(0, 1, 2, False, "two")]
    assert corrected_order(traced_order, old, [], length, ties, {0, 1})[1] == [
        "two counts 2 rings where other corrections count otherwise."
    ]


@given(st.lists(st.integers(1, 3), min_size=2, max_size=12), st.data())
def test_marks_are_consecutive_whatever_was_traced(rings: list[int], data: st.DataObject) -> None:
    count = len(rings) + 1
    index = np.array(data.draw(st.lists(st.integers(1, 20), min_size=count, max_size=count, unique=True).map(sorted)))
    was = np.array(data.draw(st.lists(st.integers(0, 2), min_size=count, max_size=count)))
    ties = [Tie(i, i + 1, n, False, "p") for i, n in enumerate(rings)]
    everyone = list(range(count))
    order, clashes = corrected_order(Order(index, was, np.ones(count)), everyone, [], [5] * count, ties, everyone)
    npt.assert_array_equal(order.index, np.cumsum([1, *rings]))
    assert set(order.group.tolist()) == {0}
    assert clashes == []
