"""The phase without its jumps: torn no more than needed, and where that costs least."""

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.sparse import coo_array, eye_array, hstack

from woodfit.ring_count import count_rings
from woodfit.unwrapping import unwrap

Array = np.ndarray


def wrapped(age: Array) -> Array:
    return np.angle(np.exp(2j * np.pi * age))


def tears(age: Array, phase: Array, axis: int) -> Array:
    """Whole rings by which neighbours differ more than their phases do."""
    step = np.diff(phase, axis=axis) / (2 * np.pi)
    return np.round(np.diff(age, axis=axis) - (step - np.round(step)))


def cost(age: Array, phase: Array, belief: Array) -> float:
    between = [np.minimum(belief[:, 1:], belief[:, :-1]), np.minimum(belief[1:], belief[:-1])]
    return sum(
        float((np.abs(tears(age, phase, axis)) * each).sum()) for axis, each in zip((1, 0), between, strict=True)
    )


def least_cost(phase: Array, belief: Array) -> float:
    """The same by a linear program over the age of every pixel and the tear between every two neighbours."""
    number = np.arange(phase.size).reshape(phase.shape)
    ends = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    here, ahead = (np.concatenate([pair[side].ravel() for pair in ends]) for side in (0, 1))
    step = (phase.ravel()[ahead] - phase.ravel()[here]) / (2 * np.pi)
    step -= np.round(step)
    row = np.arange(len(here))
    signs, places = np.r_[-np.ones(len(row)), np.ones(len(row))], (np.r_[row, row], np.r_[here, ahead])
    slope = coo_array((signs, places), shape=(len(row), phase.size))
    more = eye_array(len(row))
    each = np.minimum(belief.ravel()[here], belief.ravel()[ahead])
    bounds = [(None, None)] * phase.size + [(0, None)] * (2 * len(row))
    found = linprog(
        np.r_[np.zeros(phase.size), each, each], A_eq=hstack([slope, -more, more]), b_eq=step, bounds=bounds
    )
    assert found.status == 0
    return float(found.fun)


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(2, 7))
def test_no_other_ages_are_torn_less(seed: int, rows: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    phase, belief = rng.uniform(-np.pi, np.pi, (rows, columns)), rng.random((rows, columns))
    age = unwrap(phase, belief)
    whole = age - phase / (2 * np.pi)
    npt.assert_allclose(whole, np.round(whole), atol=1e-6)
    # A thousandth for each pixel of a tear.
    assert cost(age, phase, belief) <= least_cost(phase, belief) + 2e-3 * age.size


@pytest.mark.parametrize("width", [5.0, 12.0, 40.0])
def test_what_does_not_contradict_itself_is_not_torn(width: float) -> None:
    y, x = np.mgrid[:120, :150]
    age = np.hypot(x + 30.0, y - 50.0) / width
    off = unwrap(wrapped(age), np.ones(age.shape)) - age
    npt.assert_allclose(off, np.round(off[0, 0]), atol=1e-6)


def two_rings_that_end() -> Array:
    """Age of rings of 12 px between which one begins at (30, 60) and ends at (90, 60), x and y."""
    y, x = np.mgrid[:120, :120].astype(float)
    return y / 12.0 + (np.arctan2(y - 60.3, x - 30.3) - np.arctan2(y - 60.3, x - 90.3)) / (2 * np.pi)


@pytest.mark.parametrize("through", ["the middle", "the left"])
def test_tears_run_through_faint_wood(through: str) -> None:
    belief = np.full((120, 120), 0.9)
    if through == "the middle":
        belief[54:66, 20:100] = 0.05
    else:
        # Longer, but fainter than straight from one to the other: both rings go on to the edge.
        belief[54:66, :40] = belief[54:66, 80:] = 0.05
    phase = wrapped(two_rings_that_end())
    age = unwrap(phase, belief)
    for axis in (0, 1):
        torn = tears(age, phase, axis) != 0
        faint = np.maximum(np.delete(belief, 0, axis), np.delete(belief, -1, axis)) < 0.5
        assert not torn[~faint].any()


def test_each_face_is_counted_by_itself() -> None:
    phase = wrapped(two_rings_that_end())
    belief = np.random.default_rng(3).random(phase.shape) * 0.2 + 0.5
    alone = count_rings(phase, belief, 0.1, np.zeros(120, int))
    turned = count_rings(-phase, belief, 0.1, np.zeros(120, int))
    both = count_rings(np.concatenate([phase, -phase]), np.tile(belief, (2, 1)), 0.1, np.repeat([3, 7], 120))
    npt.assert_allclose(both.age, np.concatenate([alone.age, turned.age]))
    # Each has a number of its own, though they touch.
    told, everywhere = np.concatenate([alone.age + 2.0, turned.age - 5.0]), np.ones((240, 120), bool)
    npt.assert_allclose(both.numbered(everywhere, told, np.ones(told.shape)), told)
