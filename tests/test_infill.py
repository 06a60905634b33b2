"""Boundaries between the traced ones: a missed ring is found, streaks as strong as rings are not taken for them."""

import numpy as np
import numpy.testing as npt
import pytest

from woodfit.boundary import edge_strength
from woodfit.infill import missed_boundaries
from woodfit.ring_belief import mean_slope
from woodfit.tracing import Trace

Array = np.ndarray
RING, RINGS, HEIGHT = 30, 14, 160


def found(places: list[int]) -> list[float]:
    """Where boundaries are found, in rings, if the rings of number `places` have a second edge in their middle."""
    x = np.arange(float(RING * RINGS))
    age = x / RING
    fraction = age % 1.0
    second = np.isin(age.astype(int), places)
    value = 0.65 - 0.3 * fraction + 0.25 * second * ((fraction > 0.5) - fraction)
    noise = 0.01 * np.random.default_rng(0).normal(size=(HEIGHT, len(x)))
    value = (np.tile(value, (HEIGHT, 1)) + noise).astype(np.float32)
    everywhere, wood = np.zeros(value.shape), np.ones(value.shape, bool)
    frequency = np.full(value.shape, 1.0 / RING)
    strength = edge_strength(value, wood, everywhere + 0.5 * np.pi, everywhere, RING)
    y = np.arange(0.0, HEIGHT)
    traces = [
        Trace(np.column_stack([np.full(len(y), k * RING - 0.5), y]), np.full(len(y), 0.95), False)
        for k in range(1, RINGS)
    ]
    slope = mean_slope(strength, wood, RING)
    missed = missed_boundaries(traces, strength, everywhere, frequency, wood, slope)
    return sorted(float(np.median(trace.points[:, 0] + 0.5) / RING) for trace in missed)


@pytest.mark.parametrize("places", [[], [6], [5, 8]])
def test_a_few_missed_rings_are_found(places: list[int]) -> None:
    npt.assert_allclose(found(places), np.array(places) + 0.5, atol=0.05)


def test_streaks_in_every_ring_are_not_rings() -> None:
    assert found(list(range(RINGS))) == []
