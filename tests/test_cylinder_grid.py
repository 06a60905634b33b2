"""The cylindrical grid: interpolation that is exact where it must be, without a seam and without folds."""

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from kernel_scenes import Array

from woodfit.cylinder_grid import (
    CylinderGrid,
    cylindrical,
    grid_for,
    sample,
    towards_pith,
    trilinear,
    without_fold,
)
from woodfit.pith import Pith, board_to_tree

OPEN = CylinderGrid(np.linspace(40.0, 160.0, 9), np.linspace(-0.6, 0.9, 7), np.linspace(-50.0, 70.0, 5), wraps=False)
ROUND = CylinderGrid(
    np.linspace(0.0, 120.0, 9), -np.pi + np.arange(12) * np.pi / 6, np.linspace(-50.0, 70.0, 5), wraps=True
)
both = pytest.mark.parametrize("grid", [OPEN, ROUND], ids=["open", "round"])


def values_on(grid: CylinderGrid, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(0.0, 5.0, grid.shape)


def places(grid: CylinderGrid, count: int = 500, seed: int = 1, beyond: float = 0.0) -> tuple[Array, Array, Array]:
    """Random places of the grid, and around it by `beyond` of its extent; azimuths from -pi to pi if beyond."""
    rng = np.random.default_rng(seed)

    def on(axis: Array, more: float) -> Array:
        return rng.uniform(axis[0] - more * np.ptp(axis), axis[-1] + more * np.ptp(axis), count)

    azimuth = on(grid.azimuth, 0.0) if beyond == 0.0 else rng.uniform(-np.pi, np.pi, count)
    return np.maximum(on(grid.radius, beyond), 0.0), azimuth, on(grid.height, beyond)


def at(grid: CylinderGrid, values: Array, *where: Array) -> Array:
    """The obvious twin of `sample`: weights times values."""
    index, weight = trilinear(grid, *where)
    return np.asarray((values.ravel()[index] * weight).sum(axis=1))


@both
def test_functions_linear_along_each_axis_are_interpolated_exactly(grid: CylinderGrid) -> None:
    def function(r: Array, a: Array, h: Array) -> Array:
        return np.asarray((1.0 + 0.1 * r) * (2.0 - a) * (3.0 + 0.05 * h) + 0.2 * r - 4.0 * a)

    values = function(*np.meshgrid(grid.radius, grid.azimuth, grid.height, indexing="ij"))
    where = places(grid)
    wanted = function(*where)
    npt.assert_allclose(at(grid, values, *where), wanted, atol=1e-5 * np.abs(values).max())


@both
def test_nodes_give_their_own_value(grid: CylinderGrid) -> None:
    values = values_on(grid)
    nodes = [axis.ravel() for axis in np.meshgrid(grid.radius, grid.azimuth, grid.height, indexing="ij")]
    npt.assert_allclose(at(grid, values, *nodes), values.ravel(), atol=1e-4)


@both
def test_weights_are_shares_of_one(grid: CylinderGrid) -> None:
    index, weight = trilinear(grid, *places(grid, 2000, beyond=0.7))
    npt.assert_allclose(weight.sum(axis=1), 1.0, atol=1e-6)
    assert weight.min() >= -1e-6
    assert index.min() >= 0
    assert index.max() < np.prod(grid.shape)


@both
def test_sample_equals_its_obvious_twin(grid: CylinderGrid) -> None:
    values, where = values_on(grid), places(grid, 2000, beyond=0.7)
    npt.assert_allclose(sample(grid, values, *where)[0], at(grid, values, *where), atol=1e-4)


@both
def test_slopes_are_those_of_the_value(grid: CylinderGrid) -> None:
    values, (r, a, h) = values_on(grid), places(grid, 2000, beyond=0.3)
    step = 0.01
    _, slope_r, slope_h = sample(grid, values, r, a, h)
    ahead_r, behind_r = (at(grid, values, r + d, a, h) for d in (step, -step))
    ahead_h, behind_h = (at(grid, values, r, a, h + d) for d in (step, -step))
    for axis, place, slope, rise in (
        (grid.radius, r, slope_r, ahead_r - behind_r),
        (grid.height, h, slope_h, ahead_h - behind_h),
    ):
        # Where the small step meets a node, the two sides differ.
        within = np.abs(place[:, None] - axis).min(axis=1) > step
        # float32 weights: some 1e-6 of values of about ten, over the step.
        npt.assert_allclose(rise[within] / (2 * step), slope[within], atol=2e-3)
        outside = (place < axis[0]) | (place > axis[-1])
        assert outside.any()
        npt.assert_array_equal(slope[outside], 0.0)


@both
def test_beyond_the_grid_the_nearest_value_holds_along_radius_and_height(grid: CylinderGrid) -> None:
    values, (r, a, h) = values_on(grid), places(grid, 300, beyond=0.8)
    nearest = np.clip(r, *grid.radius[[0, -1]]), a, np.clip(h, *grid.height[[0, -1]])
    npt.assert_allclose(sample(grid, values, r, a, h)[0], sample(grid, values, *nearest)[0], atol=1e-5)


@both
def test_the_value_is_continuous_all_the_way_round(grid: CylinderGrid) -> None:
    values = values_on(grid)
    azimuth = np.linspace(-np.pi, np.pi, 40001)
    value, _, _ = sample(grid, values, np.full_like(azimuth, 100.0), azimuth, np.full_like(azimuth, 13.0))
    steepest = np.ptp(values) / grid.steps[1] * (azimuth[1] - azimuth[0])
    assert np.abs(np.diff(value)).max() < 1.5 * steepest
    assert value[0] == pytest.approx(value[-1], abs=1e-3)


@both
def test_a_whole_turn_changes_nothing(grid: CylinderGrid) -> None:
    values, (r, a, h) = values_on(grid), places(grid, 300, beyond=0.2)
    npt.assert_allclose(sample(grid, values, r, a + 2 * np.pi, h)[0], sample(grid, values, r, a, h)[0], atol=1e-4)


def test_turning_the_field_by_nodes_is_turning_the_places() -> None:
    values, (r, a, h) = values_on(ROUND), places(ROUND)
    turned = np.roll(values, 5, axis=1)
    npt.assert_allclose(
        sample(ROUND, turned, r, a + 5 * ROUND.steps[1], h)[0], sample(ROUND, values, r, a, h)[0], atol=1e-4
    )


@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize("most", [300, 5000, 10**6])
def test_a_grid_covers_its_points_within_the_bound(wraps: bool, most: int) -> None:
    rng = np.random.default_rng(2)
    reach = np.pi if wraps else 0.8
    r, a, h = rng.uniform(30, 200, 4000), rng.uniform(-reach, reach, 4000), rng.uniform(-90, 90, 4000)
    grid = grid_for(r, a, h, 10.0, most)
    assert np.prod(grid.shape) <= most
    assert grid.wraps is wraps
    for axis, place in ((grid.radius, r), (grid.height, h)):
        assert axis[0] <= place.min()
        assert axis[-1] >= place.max()
    for axis in (grid.radius, grid.azimuth, grid.height):
        npt.assert_allclose(np.diff(axis), axis[1] - axis[0])
    if wraps:
        assert len(grid.azimuth) * grid.steps[1] == pytest.approx(2 * np.pi)
    else:
        npt.assert_allclose(grid.azimuth[[0, -1]], [a.min(), a.max()])
    if most == 10**6:
        assert max(grid.steps[0], grid.steps[2]) <= 10.0


def test_points_in_one_layer_still_make_a_grid() -> None:
    grid = grid_for(np.full(5, 50.0), np.zeros(5), np.full(5, 3.0), 6.0, 1000)
    assert grid.shape == (2, 2, 2)
    assert min(grid.steps) > 0.0


def test_cylindrical_coordinates_lead_back_to_the_point() -> None:
    direction = np.array([0.3, 0.9, 0.2]) / np.linalg.norm([0.3, 0.9, 0.2])
    pith = Pith(np.array([40.0, -20.0, 60.0]), direction, 0.0, np.zeros(4))
    matrix = board_to_tree(pith, np.array([100.0, 80.0, 0.0]))
    points = np.random.default_rng(3).uniform(-200, 200, (4, 5, 3))
    r, a, h = cylindrical(points, matrix)
    tree = np.stack([r * np.cos(a), r * np.sin(a), h, np.ones_like(r)], axis=-1)
    npt.assert_allclose((tree @ np.linalg.inv(matrix).T)[..., :3], points, atol=1e-9)
    away = points - pith.point
    npt.assert_allclose(r, np.linalg.norm(np.cross(away, direction), axis=-1), atol=1e-9)


fields = arrays(np.float64, (12, 2, 3), elements=st.floats(-60.0, 60.0, width=32))
RADIUS = np.linspace(10.0, 120.0, 12)


@given(fields, st.floats(0.05, 0.5))
@settings(max_examples=80, deadline=None)
def test_without_fold_the_radius_always_grows(values: Array, least: float) -> None:
    grown = without_fold(values, RADIUS, least) + RADIUS[:, None, None]
    assert np.diff(grown, axis=0).min() >= least * (RADIUS[1] - RADIUS[0]) - 1e-9


@given(fields, st.floats(0.05, 0.5))
@settings(max_examples=80, deadline=None)
def test_without_fold_leaves_growing_fields_alone(values: Array, least: float) -> None:
    fine = without_fold(values, RADIUS, least)
    npt.assert_allclose(without_fold(fine, RADIUS, least), fine, atol=1e-9)


@given(fields, st.floats(-30.0, 30.0))
@settings(max_examples=40, deadline=None)
def test_without_fold_treats_inside_and_outside_alike(values: Array, shift: float) -> None:
    straight = without_fold(values, RADIUS)
    mirrored = -without_fold(-values[::-1], RADIUS)[::-1]
    npt.assert_allclose(mirrored, straight, atol=1e-9)
    npt.assert_allclose(without_fold(values + shift, RADIUS), straight + shift, atol=1e-9)


def test_without_fold_keeps_its_input() -> None:
    values = values_on(ROUND)
    before = values.copy()
    assert np.abs(without_fold(values * 9.0, ROUND.radius) - values * 9.0).max() > 1.0
    without_fold(values, ROUND.radius)
    npt.assert_array_equal(values, before)


def test_a_displacement_goes_on_to_the_pith_in_proportion_to_the_radius() -> None:
    grid = CylinderGrid(np.linspace(60.0, 200.0, 15), np.linspace(-1.0, 1.0, 5), np.linspace(0.0, 90.0, 4), False)
    # Uneven growth by which every constant continuation would leave a disc of age 0 about the pith.
    field = np.full(grid.shape, -40.0) + np.random.default_rng(0).normal(0.0, 3.0, grid.shape[1:])
    wider, carried = towards_pith(grid, field)
    npt.assert_allclose(wider.radius[-15:], grid.radius)
    npt.assert_allclose(carried[-15:], field, rtol=1e-6)
    assert 0.0 <= wider.radius[0] < grid.steps[0]
    npt.assert_allclose(np.diff(wider.radius), grid.steps[0])
    grown = wider.radius[:, None, None] + carried
    assert (grown >= 0.0).all()
    assert (np.diff(grown, axis=0) > 0.0).all()


def test_a_grid_far_from_the_pith_stays_as_it_is() -> None:
    grid = CylinderGrid(np.linspace(900.0, 1000.0, 11), np.linspace(-1.0, 1.0, 5), np.linspace(0.0, 90.0, 4), False)
    same, values = towards_pith(grid, np.ones(grid.shape))
    assert same is grid
    npt.assert_array_equal(values, 1.0)
