"""Rings as many as the phase counts, on a face whose phase is known and whose traced rings are not all right."""

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from woodfit.count_trial import polish_by_best_count
from woodfit.cylinder_grid import CylinderGrid, sample
from woodfit.displacement import Observations, age_of_radius, initial_displacement, polish
from woodfit.ring_count import count_rings, outward_signs

Array = np.ndarray
GRID = CylinderGrid(np.linspace(60.0, 200.0, 36), np.linspace(-0.5, 0.5, 12), np.array([-1.0, 1.0]), wraps=False)
RINGS = 10.0 * np.arange(25)
ONE_FACE = np.zeros(60, int)


def wrapped(age: Array) -> Array:
    return np.angle(np.exp(2j * np.pi * age))


def drawn_age(shape: tuple[int, int] = (60, 90)) -> Array:
    """Bent rings of changing width, from 3 to 13."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return 3.0 + (x + 8.0 * np.sin(y / 20.0) + 8.0) / 12.0 + (x / 60.0) ** 2


@given(st.integers(-5, 5), st.integers(0, 2**32 - 1))
def test_the_count_is_the_age_up_to_a_whole_number(more: int, seed: int) -> None:
    age = drawn_age()
    noisy = age + 0.05 * np.random.default_rng(seed).normal(size=age.shape)
    ones, everywhere = np.ones(age.shape), np.ones(age.shape, bool)
    counted = count_rings(wrapped(noisy), ones, 0.2, ONE_FACE)
    off = counted.age - noisy
    npt.assert_allclose(off, np.round(off[0, 0]), atol=1e-6)
    # Numbers that are right, but for a stray third, give the age itself.
    stray = np.where(np.random.default_rng(seed + 1).random(age.shape) < 0.33, 2.0, 0.0)
    npt.assert_allclose(counted.numbered(everywhere, noisy + more + stray, ones), noisy + more, atol=1e-6)


def test_each_part_has_its_own_number_by_weight() -> None:
    age = drawn_age()
    sure = np.ones(age.shape, bool)
    sure[:, 40:44] = False
    counted = count_rings(wrapped(age), 1.0 * sure, 0.3, ONE_FACE)
    # One part is told by a few pixels of much weight, against many of little.
    told, weight = age + np.where(np.arange(90) < 42, 4.0, -2.0), np.full(age.shape, 1e-3)
    told[:5, :5], weight[:5, :5] = age[:5, :5] + 1.0, 100.0
    numbered = counted.numbered(sure, told, weight)
    npt.assert_allclose(numbered[:, :40], age[:, :40] + 1.0, atol=1e-6)
    npt.assert_allclose(numbered[:, 44:], age[:, 44:] - 2.0, atol=1e-6)
    assert np.isnan(numbered[:, 40:44]).all()


def test_where_nothing_is_believed_nothing_is_counted() -> None:
    counted = count_rings(np.zeros((4, 5)), np.zeros((4, 5)), 0.0, np.zeros(4, int))
    assert np.isnan(counted.numbered(np.zeros((4, 5), bool), np.ones((4, 5)), np.ones((4, 5)))).all()


def test_the_phase_of_a_face_numbered_inwards_is_turned() -> None:
    age = drawn_age()
    face = np.repeat([0, 1, 2], 20)
    runs = np.repeat([1.0, -1.0, 1.0], 20)
    # The age is known to a fifth of a ring only, and half of each face is not believed.
    rough = age + 0.2 * np.random.default_rng(3).normal(size=age.shape)
    weight = np.random.default_rng(4).integers(0, 2, age.shape)
    npt.assert_array_equal(outward_signs(wrapped(runs[:, None] * age), rough, weight, face), runs)
    # A face alone has nothing to be turned against.
    npt.assert_array_equal(outward_signs(wrapped(-age), rough, weight, np.zeros(60, int)), 1.0)


def places(radius: Array, azimuth: Array, target: Array) -> Observations:
    r, a, t = (np.ravel(part).astype(float) for part in np.broadcast_arrays(radius, azimuth, target))
    return Observations(r, a, np.zeros(r.size), t, np.ones(r.size))


def face(step: float = 1.5) -> tuple[Array, Array]:
    r, a = np.meshgrid(np.arange(62.0, 197.0, step), np.linspace(-0.45, 0.45, 40), indexing="ij")
    return r, a


def boundaries(false_at: float | None) -> Observations:
    """Traced rings; beyond a line that is no boundary all are counted one too many."""
    ages = np.arange(7, 20)
    radius, azimuth = np.meshgrid(10.0 * ages, np.linspace(-0.45, 0.45, 24), indexing="ij")
    counted = np.repeat(ages, 24).astype(float)
    if false_at is not None:
        counted += radius.ravel() > false_at
    return places(radius, azimuth, counted.reshape(radius.shape))


def ages_of(field: Array, radius: Array, azimuth: Array) -> Array:
    moved, _, _ = sample(GRID, field, radius.ravel(), azimuth.ravel(), np.zeros(radius.size))
    return age_of_radius(radius.ravel() + moved, RINGS)[0].reshape(radius.shape)


def polished(held: Observations, by_count: bool, belief: Array | None = None) -> Array:
    """Ages of the face after polishing on the phase of rings that are exactly even."""
    start = initial_displacement(GRID, held, RINGS, 10.0, 2.0)
    r, a = face()
    phase, belief = wrapped(r / 10.0), np.ones(r.shape) if belief is None else belief
    counted = count_rings(phase, belief, 0.2, np.zeros(len(r), int))
    count = counted.numbered(belief > 0.2, ages_of(start, r, a), belief).ravel() if by_count else None
    stiffness = (12.0, 3.0, 0.8, 0.3, 0.1, 0.05)
    return ages_of(polish(GRID, start, places(r, a, phase), held, RINGS, stiffness, 2.0, 0.1, count).displacement, r, a)


@pytest.mark.parametrize("false_at", [95.0, 135.0])
def test_a_line_that_is_no_boundary_leaves_no_wall(false_at: float) -> None:
    r, _ = face()
    # Without the count the false ring stays: the outermost and the innermost are one too far apart.
    alone = polished(boundaries(false_at), by_count=False)
    assert np.median(alone[-1] - alone[0]) - (r[-1, 0] - r[0, 0]) / 10.0 == pytest.approx(1.0, abs=0.2)
    off = polished(boundaries(false_at), by_count=True) - r / 10.0
    assert np.abs(off - np.median(off)).max() < 0.2
    assert np.median(off) == pytest.approx(round(float(np.median(off))), abs=0.05)


def test_right_rings_stay_as_they_are() -> None:
    r, _ = face()
    npt.assert_allclose(polished(boundaries(None), by_count=True), r / 10.0, atol=0.03)


def test_a_ring_that_the_counts_are_apart_is_made_up_where_nothing_is_counted() -> None:
    r, _ = face()
    # All beyond 95 px is numbered one too many; the phase is doubtful from 110 to 120 px.
    doubtful = np.where(np.abs(r - 115.0) < 5.0, 0.1, 1.0)
    off = polished(boundaries(95.0), by_count=True, belief=doubtful) - r / 10.0
    npt.assert_allclose(off[r < 104.0], 0.0, atol=0.2)
    npt.assert_allclose(off[r > 122.0], 1.0, atol=0.05)


@pytest.mark.parametrize("trusted", ["phase", "tracing"])
def test_the_count_that_leaves_least_is_taken(trusted: str) -> None:
    r, a = face()
    belief = np.where(np.abs(r - 115.0) < 5.0, 0.3, 1.0)
    if trusted == "phase":
        # A line that is no boundary: the phase between the clear parts is right, though believed little.
        age, held = r / 10.0, boundaries(95.0)
        right = age
    else:
        # The tracing is right, and within the doubtful strip the phase makes up a ring that there is not.
        right, held = r / 10.0, boundaries(None)
        age = right + np.clip((r - 110.0) / 10.0, 0.0, 1.0)
    start = initial_displacement(GRID, held, RINGS, 10.0, 2.0)
    phase, start_age = wrapped(age), ages_of(start, r, a)
    pixels = Observations(r.ravel(), a.ravel(), np.zeros(r.size), phase.ravel(), belief.ravel() ** 2)
    stiffness = (12.0, 3.0, 0.8, 0.3, 0.1, 0.05)
    found = polish_by_best_count(
        GRID, start, phase, belief, start_age, np.zeros(len(r), int), pixels, held, RINGS, stiffness, 2.0, 0.1
    )
    off = (ages_of(found.displacement, r, a) - right)[np.abs(r - 115.0) > 12.0]
    npt.assert_allclose(off - np.round(np.median(off)), 0.0, atol=0.2)
