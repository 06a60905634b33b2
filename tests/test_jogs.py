"""Boundaries that jump from one ring to another are cut there; those that bend with the rings are not."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernel_scenes import Array, round_age

from woodfit.jogs import without_jogs
from woodfit.tracing import Trace

SHAPE = (120, 400)
WIDTH = 16.0
SQUARE = (300, 300)


def straight() -> tuple[Array, Array]:
    """Growth down the rows, and rings per px."""
    return np.full(SHAPE, np.pi / 2), np.full(SHAPE, 1 / WIDTH)


def step(rings: float, over_rings: float, at: float = 200.0) -> Trace:
    """A line along the rows that gets `rings` onward over a way of `over_rings`."""
    x = np.arange(0.0, SHAPE[1])
    y = 50.0 + rings * WIDTH * np.clip((x - at) / (over_rings * WIDTH) + 0.5, 0.0, 1.0)
    return Trace(np.stack([x, y], axis=1), np.linspace(0.5, 1.0, len(x)), False)


def circle(radius: float, jump: float = 0.0, turn: float = 0.0, closed: bool = True) -> Trace:
    """Around the middle of SQUARE, `jump` px farther out from the angle `turn` on for a third of the way."""
    angle = np.arange(0.0, 2 * np.pi, 1.0 / radius)
    out = ((angle - turn) % (2 * np.pi)) < 2 * np.pi / 3
    away = radius + jump * out
    points = 150.0 + away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Trace(points, np.ones(len(angle)), closed)


def cut(*traces: Trace, growth: Array | None = None, frequency: Array | None = None) -> list[Trace]:
    down, rings = straight()
    return without_jogs(
        list(traces), down if growth is None else growth, rings if frequency is None else frequency, WIDTH, 2.0
    )


@pytest.mark.parametrize("rings", [1.0, -1.0, 0.8, 2.0])
@pytest.mark.parametrize("over_rings", [0.3, 1.0])
def test_a_line_that_jumps_to_the_next_ring_becomes_two(rings: float, over_rings: float) -> None:
    line = step(rings, over_rings)
    first, second = cut(line)
    npt.assert_allclose(first.points[:-3, 1], 50.0)
    npt.assert_allclose(second.points[3:, 1], 50.0 + rings * WIDTH)
    # No more than the jog is lost, and confidence stays with its vertex.
    assert len(first.points) + len(second.points) > SHAPE[1] - (over_rings + 1.0) * WIDTH
    npt.assert_array_equal(first.confidence, line.confidence[: len(first.confidence)])
    npt.assert_array_equal(second.confidence, line.confidence[-len(second.confidence) :])


@pytest.mark.parametrize(("rings", "over_rings"), [(0.4, 0.5), (1.0, 6.0), (0.0, 1.0)])
def test_a_line_that_wavers_or_drifts_stays(rings: float, over_rings: float) -> None:
    line = step(rings, over_rings)
    (same,) = cut(line)
    assert same is line


def test_a_part_too_short_to_be_a_boundary_is_left_out() -> None:
    (part,) = cut(step(1.0, 0.5, at=20.0))
    assert part.points[0, 0] > 20.0
    assert cut() == []


def test_what_lies_between_two_jogs_is_a_part_of_its_own() -> None:
    there, back = step(1.0, 0.5, at=130.0), step(-1.0, 0.5, at=270.0)
    points = there.points.copy()
    points[:, 1] += back.points[:, 1] - 50.0
    parts = cut(Trace(points, there.confidence, False))
    assert len(parts) == 3
    npt.assert_allclose([np.median(part.points[:, 1]) for part in parts], [50.0, 66.0, 50.0])


@given(radius=st.floats(40.0, 120.0), closed=st.booleans())
def test_a_ring_round_the_pith_stays(radius: float, closed: bool) -> None:
    _, outwards = round_age(SQUARE, (150.0, 150.0), WIDTH)
    ring = circle(radius, closed=closed)
    (same,) = cut(ring, growth=outwards, frequency=np.full(SQUARE, 1 / WIDTH))
    assert same is ring


@given(turn=st.floats(0.0, 6.2), jump=st.sampled_from([WIDTH, -WIDTH]))
def test_a_closed_line_is_cut_wherever_it_begins(turn: float, jump: float) -> None:
    _, outwards = round_age(SQUARE, (150.0, 150.0), WIDTH)
    parts = cut(circle(80.0, jump, turn), growth=outwards, frequency=np.full(SQUARE, 1 / WIDTH))
    assert len(parts) == 2
    assert not any(part.closed for part in parts)
    radii = [np.hypot(*(part.points - 150.0).T) for part in parts]
    for radius in radii:
        assert np.ptp(radius[3:-3]) < 1e-6
    npt.assert_allclose(sorted(float(np.median(radius)) for radius in radii), sorted([80.0, 80.0 + jump]))


@given(st.integers(0, 1000))
def test_which_way_growth_goes_and_the_line_is_read_does_not_matter(seed: int) -> None:
    down, _ = straight()
    rng = np.random.default_rng(seed)
    either = down + np.pi * rng.integers(0, 2, (1, SHAPE[1]))
    line = step(1.0, 0.5)
    reverse = Trace(line.points[::-1].copy(), line.confidence[::-1].copy(), False)
    expected = cut(line)
    for parts in (cut(line, growth=either), cut(reverse)[::-1]):
        assert len(parts) == 2
        for part, same in zip(parts, expected, strict=True):
            assert abs(len(part.points) - len(same.points)) <= 2
            npt.assert_allclose(np.median(part.points, axis=0), np.median(same.points, axis=0), atol=1.5)
