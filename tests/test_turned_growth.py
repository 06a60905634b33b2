"""Growth that boundaries contradict is found, and nothing else is."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from woodfit.ring_order import Order, order_rings
from woodfit.tracing import Trace
from woodfit.turned_growth import against_indices

Array = npt.NDArray[Any]

SHAPE, RING_PX = (300, 240), 20.0


def face() -> tuple[list[Trace], Array, Array, Array]:
    """Slightly inclined boundaries, growth to the right, rings per px, wood."""
    y = np.arange(0.0, 300.0)
    lines = [np.stack([10.0 + RING_PX * k + 0.05 * y, y], axis=1) for k in range(11)]
    traces = [Trace(points, np.ones(len(points)), False) for points in lines]
    return traces, np.full(SHAPE, -0.05), np.full(SHAPE, 1.0 / RING_PX), np.ones(SHAPE, bool)


def ordered(traces: list[Trace], growth: Array, frequency: Array, valid: Array) -> Order:
    return order_rings([t.points for t in traces], [t.closed for t in traces], growth, frequency, valid)


def test_right_growth_is_left_alone() -> None:
    traces, growth, frequency, valid = face()
    order = ordered(traces, growth, frequency, valid)
    assert not against_indices(traces, order, growth, frequency, valid, RING_PX).any()


def test_a_corner_turned_round_is_found() -> None:
    traces, growth, frequency, valid = face()
    corner = np.zeros(SHAPE, bool)
    corner[200:, :90] = True
    misled = np.where(corner, growth + np.pi, growth)
    order = ordered(traces, misled, frequency, valid)
    # Two thirds of every line lie in clearer wood.
    assert list(order.index) == list(range(1, 12))
    found = against_indices(traces, order, misled, frequency, valid, RING_PX)
    # But for a ring on either side of its rim.
    inner, outer = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
    inner[220:, 20:70], outer[180:, :110] = True, True
    assert found[inner].all()
    assert not found[~outer].any()


def test_a_patch_smaller_than_a_few_rings_is_left_alone() -> None:
    traces, growth, frequency, valid = face()
    growth[140:160, 100:120] += np.pi
    order = ordered(traces, growth, frequency, valid)
    assert not against_indices(traces, order, growth, frequency, valid, RING_PX).any()


@pytest.mark.parametrize("lines", [0, 1])
def test_without_neighbors_nothing_is_said(lines: int) -> None:
    traces, growth, frequency, valid = face()
    order = ordered(traces[:lines], growth, frequency, valid)
    assert not against_indices(traces[:lines], order, growth, frequency, valid, RING_PX).any()
