"""Traces kept apart: none nearer than asked, the surest untouched, in whatever order they come."""

import numpy as np
import numpy.testing as npt
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_scenes import Array
from scipy.spatial import cKDTree

from woodfit.trace_spacing import kept_apart, longest_free, without_doubles
from woodfit.tracing import Trace

SHAPE = (120, 140)
#: A drawn line passes this near to its vertices' neighbours, and a vertex is looked up at its nearest pixel.
RASTER_PX = 1.3


def line(y: float, slope: float = 0.0, start: float = 5.0, end: float = 130.0, confidence: float = 0.8) -> Trace:
    x = np.arange(start, end)
    return Trace(np.stack([x, y + slope * (x - 70.0)], axis=1), np.full(len(x), confidence), False)


def circle(radius: float, confidence: float = 0.8) -> Trace:
    turn = np.linspace(0.0, 2 * np.pi, round(2 * np.pi * radius), endpoint=False)
    points = np.stack([70.0 + radius * np.cos(turn), 60.0 + radius * np.sin(turn)], axis=1)
    return Trace(points, np.full(len(turn), confidence), True)


@st.composite
def bundles(draw: st.DrawFn) -> list[Trace]:
    """Waving lines at random places, as sure as they like, all inside the picture."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    traces = []
    for _ in range(draw(st.integers(2, 9))):
        start, end = np.sort(rng.uniform(0, 139, 2))
        x = np.arange(start, max(end, start + 6.0))
        y = rng.uniform(0, 119) + rng.uniform(-0.6, 0.6) * (x - 70) + rng.uniform(0, 5) * np.sin(x / rng.uniform(8, 30))
        points = np.clip(np.stack([x, y], axis=1), 0.0, [139.0, 119.0])
        traces.append(Trace(points, rng.uniform(0.1, 1.0, len(x)), False))
    return traces


def surest(traces: list[Trace]) -> Trace:
    return max(traces, key=lambda t: float(t.confidence.sum()))


def as_set(traces: list[Trace]) -> set[bytes]:
    return {t.points.tobytes() + t.confidence.tobytes() for t in traces}


def nearest(traces: list[Trace]) -> float:
    """Least distance between vertices of two traces."""
    trees = [cKDTree(t.points) for t in traces]
    apart = [float(a.query(b.data)[0].min()) for i, a in enumerate(trees) for b in trees[:i]]
    return min(apart, default=np.inf)


@settings(max_examples=60, deadline=None)
@given(bundles(), st.floats(1.8, 12.0), st.integers(0, 1000))
def test_kept_traces_are_apart_the_surest_is_whole_and_the_order_does_not_matter(
    traces: list[Trace], least: float, seed: int
) -> None:
    kept = kept_apart(traces, SHAPE, least)
    assert nearest(kept) >= least - RASTER_PX
    assert as_set([surest(traces)]) <= as_set(kept)
    shuffled = [traces[i] for i in np.random.default_rng(seed).permutation(len(traces))]
    assert as_set(kept_apart(shuffled, SHAPE, least)) == as_set(kept)
    assert min(len(t.points) for t in kept) >= 4


@settings(max_examples=60, deadline=None)
@given(bundles(), st.floats(6.0, 30.0), st.integers(0, 1000))
def test_doubles_go_by_the_local_ring_width(traces: list[Trace], width: float, seed: int) -> None:
    frequency = np.full(SHAPE, 1.0 / width)
    kept = without_doubles(traces, frequency)
    assert nearest(kept) >= 0.22 * width - RASTER_PX
    assert as_set([surest(traces)]) <= as_set(kept)
    shuffled = [traces[i] for i in np.random.default_rng(seed).permutation(len(traces))]
    assert as_set(without_doubles(shuffled, frequency)) == as_set(kept)
    wide = without_doubles(traces, frequency, nearest_rings=0.5)
    assert sum(len(t.points) for t in wide) <= sum(len(t.points) for t in traces)


@settings(max_examples=60, deadline=None)
@given(bundles(), st.floats(1.8, 12.0))
def test_what_is_kept_are_stretches_of_what_came(traces: list[Trace], least: float) -> None:
    for kept in kept_apart(traces, SHAPE, least):
        assert any(_is_stretch(kept.points, t.points) for t in traces)
    # Traces that are apart already stay as they are.
    clear = [line(y) for y in (10.0, 40.0, 70.0, 100.0)]
    assert as_set(kept_apart(clear, SHAPE, least)) == as_set(clear)


def _is_stretch(part: Array, whole: Array) -> bool:
    start = np.flatnonzero((whole == part[0]).all(axis=1))
    return any(np.array_equal(whole[s : s + len(part)], part) for s in start)


def test_of_two_boundaries_on_one_edge_the_surer_stays() -> None:
    sure, doubtful, other = line(50.0, confidence=0.9), line(51.5, confidence=0.6), line(70.0, confidence=0.5)
    kept = without_doubles([doubtful, other, sure], np.full(SHAPE, 1 / 15.0))
    assert as_set(kept) == as_set([sure, other])
    # Where rings are six times as narrow they are two.
    assert len(without_doubles([doubtful, other, sure], np.full(SHAPE, 1 / 5.0))) == 3


def test_a_boundary_that_runs_into_another_is_cut_before_it() -> None:
    sure, leaning = line(50.0), line(60.0, slope=-0.2, confidence=0.5)
    kept = without_doubles([sure, leaning], np.full(SHAPE, 1 / 15.0))
    assert len(kept) == 2
    assert as_set([sure]) <= as_set(kept)
    rest = kept[1].points
    assert 0.5 < len(rest) / len(leaning.points) < 1.0
    assert np.abs(rest[:, 1] - 50.0).min() >= 0.22 * 15.0 - RASTER_PX


def test_crossing_lines_no_longer_cross() -> None:
    flat, steep = line(60.0, confidence=0.9), line(60.0, slope=0.5, confidence=0.5)
    kept = kept_apart([steep, flat], SHAPE)
    assert len(kept) == 2
    assert as_set([flat]) <= as_set(kept)
    below = kept[1].points[:, 1] - 60.0
    assert (below > 0).all() or (below < 0).all()


def test_closed_rings_inside_one_another_stay_closed_and_a_cut_one_is_open() -> None:
    rings = [circle(r) for r in (10.0, 22.0, 34.0, 46.0)]
    for kept in (kept_apart(rings, SHAPE), without_doubles(rings, np.full(SHAPE, 1 / 12.0))):
        assert as_set(kept) == as_set(rings)
        assert all(t.closed for t in kept)
    bar = line(60.0, confidence=1.0)
    cut = kept_apart([circle(30.0, 0.3), bar], SHAPE)
    assert [t.closed for t in cut] == [False, False]
    assert as_set([bar]) <= as_set(cut)


@given(st.lists(st.booleans(), min_size=1, max_size=40))
def test_the_longest_free_stretch_is_the_longest(free: list[bool]) -> None:
    whole = Trace(np.arange(2.0 * len(free)).reshape(-1, 2), np.arange(float(len(free))), True)
    found = longest_free(whole, np.array(free))
    stretches = [
        (end - start, -start)
        for start in range(len(free))
        for end in range(start + 1, len(free) + 1)
        if all(free[start:end])
    ]
    length, start = max(stretches, default=(0, 0))
    npt.assert_array_equal(found.confidence, np.arange(-start, -start + length))
    npt.assert_array_equal(found.points, whole.points[-start : -start + length])
    assert not found.closed


def test_nothing_stays_nothing() -> None:
    assert kept_apart([], SHAPE) == []
    assert without_doubles([], np.full(SHAPE, 0.1)) == []
