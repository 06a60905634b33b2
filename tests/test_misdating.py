"""Missing and false rings: truth by construction, an enumerating twin, invariances, and real cores."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_scenes import SHARED, needs_shared

from woodfit.dendro import tucson
from woodfit.dendro.agreement import baillie_pilcher
from woodfit.dendro.misdating import (
    EDGE,
    FEWEST_RINGS,
    Misdating,
    find_misdating,
)
from woodfit.dendro.ring_lags import LARGEST_LAG, event_probabilities, mean_index, path_probabilities

Array = np.ndarray
Pair = tuple[Array, Array]


def cores(seed: int, rings: int = 60, own: float = 0.35, swing: float = 0.35) -> Pair:
    """Two cores of one tree: a common climate and each its own noise, oldest ring first."""
    rng = np.random.default_rng(seed)
    climate = rng.normal(0, swing, rings)
    trend = np.linspace(0.6, -0.3, rings)
    one, other = (np.exp(trend + climate + own * swing * rng.normal(0, 1, rings)) for _ in range(2))
    return one, 1.3 * other


def without_boundary(width: Array, ring: int) -> Array:
    """The boundary at the outer end of the ring is missed: it and the next are measured as one."""
    return np.concatenate([width[:ring], [width[ring] + width[ring + 1]], width[ring + 2 :]])


def without_ring(width: Array, ring: int) -> Array:
    """The ring did not grow here."""
    return np.delete(width, ring)


def with_false_boundary(width: Array, ring: int, share: float = 0.6) -> Array:
    """The ring is cut in two."""
    return np.concatenate([width[:ring], [share * width[ring], (1 - share) * width[ring]], width[ring + 1 :]])


def named(found: list[Misdating], kind: str, ring: int, reach: int = 2) -> bool:
    """Whether this event was found, counted from the outer end."""
    return any(event.kind == kind and abs(event.ring - ring) <= reach for event in found)


@pytest.mark.parametrize(
    ("damage", "kind", "merged"),
    [(without_boundary, "missing", True), (without_ring, "missing", False), (with_false_boundary, "false", False)],
)
def test_one_error_anywhere_inside_is_named(damage: Callable[[Array, int], Array], kind: str, merged: bool) -> None:
    hits = same = total = 0
    for seed in range(6):
        one, other = cores(seed)
        for ring in range(8, 52, 4):
            found = find_misdating(damage(one, ring), other)
            # Merged rings are named by the younger one.
            truth = 59 - ring - (damage is without_boundary)
            hits += named(found, kind, truth)
            same += any(event.merged == merged for event in found)
            total += 1
    assert hits >= 0.95 * total
    assert same >= 0.75 * total


def test_two_errors_are_both_named() -> None:
    hits = 0
    for seed in range(20):
        one, other = cores(seed, 120)
        broken = with_false_boundary(without_boundary(one, 80), 30)
        found = find_misdating(broken, other)
        hits += named(found, "missing", 119 - 81) and named(found, "false", 119 - 30) and len(found) == 2
    assert hits >= 18


def test_sound_series_stay_unflagged() -> None:
    pairs = [cores(seed, own=own) for seed in range(100) for own in (0.3, 0.6)]
    flagged = sum(bool(find_misdating(one, other)) for one, other in pairs)
    assert flagged <= 0.03 * len(pairs)


def test_strangers_are_not_accused() -> None:
    pairs = [(cores(seed)[0], cores(1000 + seed)[1]) for seed in range(100)]
    assert sum(bool(find_misdating(one, other)) for one, other in pairs) <= 5


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 50), st.floats(0.01, 100.0), st.floats(0.01, 100.0))
def test_units_do_not_matter(seed: int, scale: float, other_scale: float) -> None:
    one, other = cores(seed)
    broken = without_boundary(one, 30)
    plain, scaled = find_misdating(broken, other), find_misdating(scale * broken, other_scale * other)
    assert [(event.kind, event.ring) for event in plain] == [(event.kind, event.ring) for event in scaled]


def test_missing_in_one_is_false_in_the_other() -> None:
    one, other = cores(3)
    broken = without_boundary(one, 30)
    (missing,), (false,) = find_misdating(broken, other), find_misdating(other, broken)
    assert (missing.kind, false.kind) == ("missing", "false")
    assert abs(missing.ring - false.ring) <= 1


def test_a_longer_partner_changes_nothing_where_the_series_ends() -> None:
    one, other = cores(5, 100)
    short = without_boundary(one[-60:], 30)
    (at_once,), (with_more,) = find_misdating(short, other[-60:]), find_misdating(short, other)
    assert at_once.ring == with_more.ring
    assert at_once.kind == with_more.kind == "missing"


def test_unknown_and_absent_rings_do_no_harm() -> None:
    one, other = cores(7)
    broken = without_boundary(one, 30)
    broken[[10, 45]] = np.nan
    other[[20, 50]] = 0.0
    before = broken.copy(), other.copy()
    assert named(find_misdating(broken, other), "missing", 28)
    np.testing.assert_array_equal(broken, before[0])
    np.testing.assert_array_equal(other, before[1])


def test_nothing_is_sought_at_the_edges_or_in_short_series() -> None:
    one, other = cores(1)
    x, y = without_boundary(one, 30)[::-1], other[::-1]
    chances = event_probabilities(x, y, (EDGE, len(x) - EDGE), 0.01)
    assert chances[:, :EDGE].sum() == 0
    assert chances[:, -EDGE:].sum() == 0
    assert chances.sum() > 0
    few = FEWEST_RINGS - 1
    assert find_misdating(one[:few], other[:few]) == []
    assert find_misdating(one, np.full(60, np.nan)) == []


@pytest.mark.parametrize("bad", [np.ones((3, 3)), np.array([1.0, -1.0]), np.array([1.0, np.inf])])
def test_what_is_no_series_is_refused(bad: Array) -> None:
    with pytest.raises(ValueError, match="the series has"):
        find_misdating(bad, np.ones(30))


def test_constant_series_are_no_evidence() -> None:
    assert find_misdating(np.ones(60), np.ones(60)) == []


def slow_paths(keep: Array, events: Array) -> Array:
    """Probabilities of the events by writing out every path."""
    strengths, n, _ = keep.shape
    weight, chances = 0.0, np.zeros((3, *keep.shape[1:]))

    def walk(s: int, ring: int, lag: int, score: float, seen: tuple[tuple[int, int, int], ...]) -> Iterator[None]:
        nonlocal weight
        if ring == n:
            weight += np.exp(score)
            for spot in seen:
                chances[spot] += np.exp(score)
            return
        if ring > n or not 0 <= lag < keep.shape[2]:
            return
        yield from walk(s, ring + 1, lag, score + keep[s, ring, lag], seen)
        for event, (rings, change) in enumerate(((1, 1), (1, 1), (2, -1))):
            if 0 <= lag + change < keep.shape[2]:
                here = score + events[event, s, ring, lag]
                yield from walk(s, ring + rings, lag + change, here, (*seen, (event, ring, lag)))

    for s in range(strengths):
        for _ in walk(s, 0, LARGEST_LAG, 0.0, ()):
            pass
    return chances / weight


def test_sums_over_paths_equal_writing_them_out() -> None:
    rng = np.random.default_rng(0)
    keep = rng.normal(0, 1, (2, 5, 2 * LARGEST_LAG + 1))
    events = rng.normal(-1, 1, (3, *keep.shape))
    np.testing.assert_allclose(path_probabilities(keep, events), slow_paths(keep, events), rtol=1e-9)


def test_mean_index_follows_the_common_signal() -> None:
    rng = np.random.default_rng(2)
    climate = rng.normal(0, 0.3, 200)
    width = np.exp(climate + rng.normal(0, 0.3, (12, 200))) * np.linspace(3, 0.3, 200)
    width[3, :80] = np.nan
    index = mean_index(width)
    assert baillie_pilcher(index, np.exp(climate)).r > 0.9
    assert abs(index.mean() - 1) < 0.05
    assert np.isnan(mean_index(np.full((3, 4), np.nan))).all()


def windows(name: str, own: int, length: int, step: int) -> Iterator[Pair]:
    """Stretches that two cores of one tree have in common; `own` leading characters of a name are the tree."""
    path = SHARED / "data" / "formats" / "tucson" / f"{name}.rwl"
    series = tucson.loads(path.read_text(encoding="latin-1"), str(path))
    for one, other in itertools.combinations(series, 2):
        if one.name[:own] == other.name[:own]:
            first, end = max(one.years[0], other.years[0]), min(one.years[-1], other.years[-1]) + 1
            for year in range(first, end - length + 1, step):
                a, b = (w.width_mm[year - w.years[0] :][:length] for w in (one, other))
                if np.isfinite(a).all() and np.isfinite(b).all():
                    yield a, b


@pytest.mark.shared
@needs_shared
@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.slow)])
def test_a_boundary_removed_by_hand_from_sixty_rings_is_named_within_two_years(every: int) -> None:
    """On cores of one tree that agree (r > 0.6): wa082, co021, ca533, nm580."""
    rng = np.random.default_rng(0)
    trees = (("wa082", 5), ("co021", 4), ("ca533", 5), ("nm580", 5))
    pairs = [pair for name, own in trees for pair in windows(name, own, 60, 120)]
    pairs = [pair for pair in pairs if baillie_pilcher(*pair).r > 0.6]
    assert len(pairs) > 200
    pairs = pairs[::every]
    missing, false, alarms = [], [], []
    for one, other in pairs:
        ring = int(rng.integers(7, 52))
        missing.append(named(find_misdating(without_boundary(one, ring), other), "missing", 58 - ring))
        split = with_false_boundary(one, ring, rng.uniform(0.25, 0.75))
        false.append(named(find_misdating(split, other), "false", 59 - ring))
        alarms.append(bool(find_misdating(one, other)))
    assert np.mean(missing) >= 0.95
    assert np.mean(false) >= 0.93
    assert np.mean(alarms) <= 0.05


@pytest.mark.shared
@needs_shared
def test_a_ring_taken_from_a_long_series_is_named_against_the_mean_of_the_others() -> None:
    path = SHARED / "data" / "formats" / "tucson" / "co021.rwl"
    series = [one for one in tucson.loads(path.read_text(encoding="latin-1"), str(path)) if one.last_year == 1963]
    years = np.arange(1700, 1964)
    table = np.full((len(series), len(years)), np.nan)
    for row, one in zip(table, series, strict=True):
        kept = one.years >= years[0]
        row[-int(kept.sum()) :] = one.width_mm[kept]
    hits = 0
    for row in range(8):
        master = mean_index(np.delete(table, row, axis=0))
        hits += named(find_misdating(without_boundary(table[row], 150), master), "missing", len(years) - 2 - 150)
    assert hits == 8
