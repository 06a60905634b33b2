"""The radial displacement: the least squares behind it, and known growth given back from rings and phase."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.testing as npt
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_scenes import Array, wrapped

from woodfit.cylinder_grid import CylinderGrid, grid_for, refine, sample
from woodfit.displacement import (
    Interpolation,
    Membrane,
    Observations,
    Polished,
    age_of_radius,
    cyclic_loss,
    initial_displacement,
    polish,
    radius_of_age,
)

STIFFNESS = (48.0, 16.0, 6.0, 2.0, 1.0)
OPEN = CylinderGrid(np.linspace(60.0, 160.0, 11), np.linspace(-0.6, 0.9, 8), np.linspace(-50.0, 70.0, 7), wraps=False)
ROUND = CylinderGrid(
    np.linspace(5.0, 105.0, 11), -np.pi + np.arange(12) * np.pi / 6, np.linspace(-50.0, 70.0, 7), wraps=True
)
both = pytest.mark.parametrize("grid", [OPEN, ROUND], ids=["open", "round"])


def random_field(grid: CylinderGrid, seed: int) -> torch.Tensor:
    size = int(np.prod(grid.shape))
    return torch.from_numpy(np.random.default_rng(seed).normal(size=size).astype(np.float32))


def random_places(grid: CylinderGrid, count: int = 300) -> Observations:
    rng = np.random.default_rng(5)
    r, a, h = (rng.uniform(axis[0], axis[-1], count) for axis in (grid.radius, grid.azimuth, grid.height))
    return Observations(r, a, h, np.zeros(count), np.ones(count))


@both
def test_the_membrane_is_self_adjoint_and_never_gains_energy(grid: CylinderGrid) -> None:
    membrane, x, y = Membrane(grid, 2.0), random_field(grid, 1), random_field(grid, 2)
    left, right = torch.dot(membrane.gradient(x), y), torch.dot(x, membrane.gradient(y))
    npt.assert_allclose(left, right, rtol=1e-4, atol=1e-4 * float(torch.dot(membrane.gradient(x), x)))
    assert float(torch.dot(membrane.gradient(x), x)) > 0.0
    npt.assert_allclose(membrane.gradient(torch.ones_like(x)), 0.0, atol=1e-6)


def slope_energy(grid: CylinderGrid, along_stem: float, flat: torch.Tensor) -> float:
    """The obvious twin: half the squared slopes between neighbours times the volume of a cell, one by one."""
    field = flat.double().numpy().reshape(grid.shape)
    dr, da, dh = grid.steps
    arc = np.maximum(grid.radius, dr) * da
    volume = arc * dr * dh
    total = 0.0
    nr, na, nh = grid.shape
    for i in range(nr):
        for j in range(na):
            for k in range(nh):
                here = field[i, j, k]
                if i + 1 < nr:
                    total += 0.5 * (volume[i] + volume[i + 1]) * ((field[i + 1, j, k] - here) / dr) ** 2
                if j + 1 < na or grid.wraps:
                    total += volume[i] * ((field[i, (j + 1) % na, k] - here) / arc[i]) ** 2
                if k + 1 < nh:
                    total += along_stem * volume[i] * ((field[i, j, k + 1] - here) / dh) ** 2
    return 0.5 * total


@both
def test_the_membrane_gradient_is_the_gradient_of_its_energy(grid: CylinderGrid) -> None:
    membrane, field = Membrane(grid, 2.0), random_field(grid, 3)
    gradient = membrane.gradient(field)
    assert 0.5 * float(torch.dot(gradient, field)) == pytest.approx(slope_energy(grid, 2.0, field), rel=1e-4)
    for seed in (4, 5, 6):
        way = random_field(grid, seed)
        # The energy is quadratic: central differences have no error but rounding.
        rise = slope_energy(grid, 2.0, field + 0.5 * way) - slope_energy(grid, 2.0, field - 0.5 * way)
        assert float(torch.dot(gradient, way)) == pytest.approx(rise, rel=1e-3, abs=1e-4 * float(gradient.norm()))


def test_the_membrane_measures_slopes_in_the_tree() -> None:
    r, a, h = np.linspace(40.0, 200.0, 60), np.linspace(-0.5, 0.5, 40), np.linspace(0.0, 150.0, 50)
    grid = CylinderGrid(r, a, h, wraps=False)
    x = r[:, None] * np.cos(a)[None, :]
    field = torch.from_numpy(np.repeat((0.3 * x)[..., None], len(h), axis=2).astype(np.float32).ravel())
    energy = 0.5 * float(torch.dot(Membrane(grid, 2.0).gradient(field), field))
    # A plane of slope 0.3 over the volume; the grid's outer cells count a half more than they hold.
    volume = 0.5 * (200.0**2 - 40.0**2) * 1.0 * 150.0
    assert energy == pytest.approx(0.5 * 0.3**2 * volume, rel=0.05)


@both
def test_the_diagonal_bounds_that_of_the_membrane(grid: CylinderGrid) -> None:
    membrane = Membrane(grid, 2.0)
    size = int(np.prod(grid.shape))
    units = torch.eye(size)[:: size // 40]
    true = torch.stack([torch.dot(membrane.gradient(unit), unit) for unit in units])
    bound = membrane.diagonal()[:: size // 40][: len(true)]
    assert bool((bound >= true * (1 - 1e-5)).all())
    assert bool((bound <= 4.0 * true).all())


@both
def test_back_is_the_transpose_of_at(grid: CylinderGrid) -> None:
    places = random_places(grid)
    matrix, field = Interpolation(grid, places), random_field(grid, 7)
    values = torch.from_numpy(np.random.default_rng(8).normal(size=len(places.radius)).astype(np.float32))
    left, right = torch.dot(matrix.at(field), values), torch.dot(field, matrix.back(values))
    npt.assert_allclose(left, right, rtol=1e-4, atol=1e-3)


@both
def test_at_equals_sample(grid: CylinderGrid) -> None:
    places, field = random_places(grid), random_field(grid, 9)
    value, _, _ = sample(grid, field.numpy().reshape(grid.shape), places.radius, places.azimuth, places.height)
    npt.assert_allclose(Interpolation(grid, places).at(field), value, atol=1e-5)


tables = st.lists(st.floats(0.5, 60.0), min_size=1, max_size=30).map(lambda widths: np.cumsum([0.0, *widths]))


@given(tables, st.lists(st.floats(0.0, 3.0), min_size=1, max_size=20))
@settings(max_examples=100, deadline=None)
def test_age_and_radius_undo_each_other_within_the_table_and_beyond(table: Array, shares: list[float]) -> None:
    age = np.array(shares) * (len(table) - 1)
    radius = radius_of_age(age, table)
    npt.assert_allclose(age_of_radius(radius, table)[0], age, atol=1e-7)
    npt.assert_allclose(radius_of_age(age_of_radius(radius, table)[0], table), radius, atol=1e-6)


def test_boundaries_have_whole_ages_and_the_width_is_the_slope() -> None:
    table = np.cumsum([0.0, 9.0, 14.0, 6.0, 22.0, 11.0])
    npt.assert_allclose(age_of_radius(table, table)[0], np.arange(6))
    radius = np.linspace(0.3, 120.0, 1000)
    age, width = age_of_radius(radius, table)
    after, _ = age_of_radius(radius + 1e-6, table)
    npt.assert_allclose((after - age) / 1e-6, 1.0 / width, rtol=1e-3)
    # Beyond the table: the mean width of the (at most ten) outermost rings.
    assert width[-1] == pytest.approx(62.0 / 5)


def test_nothing_is_younger_than_the_pith() -> None:
    assert age_of_radius(np.array([-5.0]), np.array([0.0, 10.0, 20.0]))[0] == 0.0


def test_the_cyclic_loss_tells_agreement_from_noise() -> None:
    rng = np.random.default_rng(1)
    assert cyclic_loss(np.zeros(9), np.ones(9)) == 0.0
    assert cyclic_loss(np.full(9, 2 * np.pi), np.ones(9)) == pytest.approx(0.0)
    assert cyclic_loss(np.full(9, np.pi), np.ones(9)) == pytest.approx(2.0)
    assert cyclic_loss(rng.uniform(-np.pi, np.pi, 100_000), np.ones(100_000)) == pytest.approx(1.0, abs=0.02)
    assert cyclic_loss(np.array([0.0, np.pi]), np.array([3.0, 1.0])) == pytest.approx(0.5)


# --- a log whose displacement is known -------------------------------------------------------------------------------

WIDTHS = 20.0 * np.exp(np.random.default_rng(11).normal(0.0, 0.15, 20))
TABLE = np.cumsum([0.0, *WIDTHS])


def displaced(r: Array, a: Array, h: Array, most_px: float = 4.0) -> Array:
    """A smooth displacement: with rings of 15 px and more its phase stays within pi/2 of none."""
    return np.asarray(most_px * np.cos(2.0 * a + 0.4) * np.sin(r / 45.0 + h / 90.0))


Truth = Callable[[Array, Array, Array], Array]


def face(truth: Truth) -> tuple[CylinderGrid, Observations, Observations]:
    """Grid, phase pixels and ring boundaries of a flat-sawn face 120 px above the pith."""
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-180.0, 180.0, 91), np.linspace(0.0, 160.0, 41)))
    r, a = np.hypot(x, 120.0), np.arctan2(x, 120.0)
    age, _ = age_of_radius(r + truth(r, a, y), TABLE)
    pixels = Observations(r, a, y, wrapped(2 * np.pi * age), np.full(len(r), 16.0))
    boundary, angle, height = (
        v.ravel() for v in np.meshgrid(np.arange(7, 10), np.linspace(-0.9, 0.9, 120), np.linspace(0.0, 160.0, 41))
    )
    ideal = radius_of_age(boundary, TABLE)
    found = ideal.copy()
    for _ in range(60):
        found = ideal - truth(found, angle, height)
    shown = np.abs(found * np.cos(angle) - 120.0) < 60.0
    area = np.full(int(shown.sum()), 360.0 * 160.0 / shown.sum())
    vertices = Observations(found[shown], angle[shown], height[shown], boundary[shown].astype(float), area)
    return grid_for(r, a, y, 8.0, 30_000), pixels, vertices


def miss(grid: CylinderGrid, field: Array, pixels: Observations, truth: Truth) -> Array:
    """Error in px at every pixel."""
    where = pixels.radius, pixels.azimuth, pixels.height
    return np.abs(sample(grid, field, *where)[0] - truth(*where))


@cache
def polished() -> tuple[CylinderGrid, Observations, Observations, Polished]:
    grid, pixels, vertices = face(displaced)
    return grid, pixels, vertices, polish(grid, np.zeros(grid.shape), pixels, vertices, TABLE, STIFFNESS, 2.0)


def test_rings_alone_give_the_displacement_at_the_rings() -> None:
    grid, _, vertices = face(displaced)
    field = initial_displacement(grid, vertices, TABLE, 1.0, 2.0)
    assert np.percentile(miss(grid, np.zeros(grid.shape), vertices, displaced), 95) > 3.0
    assert np.percentile(miss(grid, field, vertices, displaced), 95) < 0.4
    assert field.dtype == np.float32


def test_wrongly_numbered_boundaries_do_not_bend_their_neighbours() -> None:
    grid, _, vertices = face(displaced)
    wrong = np.random.default_rng(3).random(len(vertices.target)) < 0.1
    numbered = replace(vertices, target=vertices.target + wrong)
    field, right = (initial_displacement(grid, seen, TABLE, 1.0, 2.0) for seen in (numbered, vertices))
    # A plain mean would be off by a tenth of a ring: two px.
    assert np.percentile(np.abs(field - right), 95) < 0.4


def test_polishing_finds_a_known_displacement_from_within_a_quarter_turn() -> None:
    grid, pixels, _, result = polished()
    start = wrapped(pixels.target - 2 * np.pi * age_of_radius(pixels.radius, TABLE)[0])
    assert 1.0 < np.abs(start).max() < np.pi / 2
    wrong = miss(grid, result.displacement, pixels, displaced)
    assert np.median(wrong) < 0.1
    assert np.percentile(wrong, 99) < 0.5


def test_boundaries_that_the_count_contradicts_are_told() -> None:
    grid, pixels, vertices, result = polished()
    assert result.contradicted == 0.0
    inner = vertices.target <= np.median(vertices.target)
    off = replace(vertices, target=vertices.target + np.where(inner, 0.0, 1.0))
    count = pixels.target / (2.0 * np.pi)
    whole = np.round(age_of_radius(pixels.radius + displaced(pixels.radius, pixels.azimuth, pixels.height), TABLE)[0])
    turns = whole + wrapped(2.0 * np.pi * (count - whole)) / (2.0 * np.pi)
    again = polish(grid, np.zeros(grid.shape), pixels, off, TABLE, STIFFNESS, 2.0, count=turns)
    assert again.contradicted == pytest.approx(off.weight[~inner].sum() / off.weight.sum(), abs=0.02)


def test_polishing_lowers_the_loss() -> None:
    grid, pixels, _, result = polished()
    assert len(result.loss) == len(STIFFNESS) + 1
    assert result.loss[-1] < 0.01 * result.loss[0]
    # What is said is true: the loss is that of the returned field.
    moved, _, _ = sample(grid, result.displacement, pixels.radius, pixels.azimuth, pixels.height)
    age, _ = age_of_radius(pixels.radius + moved, TABLE)
    assert result.loss[-1] == pytest.approx(cyclic_loss(pixels.target - 2 * np.pi * age, pixels.weight), abs=1e-5)


def test_whole_turns_of_the_phase_do_not_matter() -> None:
    grid, pixels, vertices, result = polished()
    turns = np.random.default_rng(4).integers(-3, 4, len(pixels.target))
    turned = replace(pixels, target=pixels.target + 2 * np.pi * turns)
    again = polish(grid, np.zeros(grid.shape), turned, vertices, TABLE, STIFFNESS, 2.0)
    npt.assert_allclose(again.displacement, result.displacement, atol=2e-3)


def test_the_scale_of_the_weights_does_not_matter_to_what_is_found() -> None:
    grid, pixels, vertices, result = polished()
    doubled = replace(vertices, weight=7.0 * vertices.weight)
    again = polish(grid, np.zeros(grid.shape), pixels, doubled, TABLE, STIFFNESS, 2.0)
    npt.assert_allclose(again.displacement, result.displacement, atol=2e-3)


def test_a_tenth_of_the_boundaries_may_be_wrong() -> None:
    grid, pixels, vertices, _ = polished()
    # A stretch of the face where every boundary is taken for the next one: no average can help.
    wrong = vertices.height <= 14.0
    assert 0.08 < wrong.mean() < 0.12
    numbered = replace(vertices, target=vertices.target + wrong)
    result = polish(grid, np.zeros(grid.shape), pixels, numbered, TABLE, STIFFNESS, 2.0)
    found = miss(grid, result.displacement, pixels, displaced)
    assert np.median(found) < 0.1
    assert np.percentile(found[pixels.height <= 14.0], 90) < 1.0


def test_boundaries_lead_where_the_phase_says_nothing() -> None:
    grid, pixels, vertices, _ = polished()
    silent = replace(pixels, weight=np.full_like(pixels.weight, 1e-6))
    result = polish(grid, np.zeros(grid.shape), silent, vertices, TABLE, STIFFNESS, 2.0, boundary_share=3e7)
    assert np.median(miss(grid, result.displacement, vertices, displaced)) < 0.2


def test_rings_never_fold_over() -> None:
    # Noise for a phase and a start that folds: the hardest that can be asked for.
    grid, pixels, vertices, _ = polished()
    rng = np.random.default_rng(6)
    noisy = replace(pixels, target=rng.uniform(-np.pi, np.pi, len(pixels.target)))
    start = rng.normal(0.0, 12.0, grid.shape)
    field = polish(grid, start, noisy, vertices, TABLE, (2.0, 0.1), 2.0).displacement
    r, a, h = rng.uniform(0.0, 260.0, 100_000), rng.uniform(-np.pi, np.pi, 100_000), rng.uniform(-50, 250, 100_000)
    assert np.diff(start + grid.radius[:, None, None], axis=0).min() < 0.0
    assert 1.0 + sample(grid, field, r, a, h)[1].min() > 0.14
    here, further = (age_of_radius(q + sample(grid, field, q, a, h)[0], TABLE)[0] for q in (r, r + 5.0))
    assert (further >= here).all()


def test_no_boundaries_are_no_obstacle() -> None:
    grid, pixels, vertices, _ = polished()
    none = Observations(*(getattr(vertices, name)[:0] for name in ("radius", "azimuth", "height", "target", "weight")))
    result = polish(grid, np.zeros(grid.shape), pixels, none, TABLE, STIFFNESS, 2.0)
    assert np.median(miss(grid, result.displacement, pixels, displaced)) < 0.1


def test_inputs_are_kept_and_the_threads_of_torch_too() -> None:
    grid, pixels, vertices, _ = polished()
    start = np.zeros(grid.shape, np.float32)
    kept = pixels.target.copy(), vertices.target.copy(), torch.get_num_threads()
    polish(grid, start, pixels, vertices, TABLE, (16.0,), 2.0)
    initial_displacement(grid, vertices, TABLE, 10.0, 2.0)
    npt.assert_array_equal(start, 0.0)
    npt.assert_array_equal(pixels.target, kept[0])
    npt.assert_array_equal(vertices.target, kept[1])
    assert torch.get_num_threads() == kept[2]


@both
def test_a_bending_membrane_is_the_gradient_of_an_energy_that_planes_do_not_escape(grid: CylinderGrid) -> None:
    bare, stiff = Membrane(grid, 2.0), Membrane(grid, 2.0, bend_px=40.0)
    x, y = random_field(grid, 1), random_field(grid, 2)
    left, right = torch.dot(stiff.gradient(x), y), torch.dot(x, stiff.gradient(y))
    npt.assert_allclose(left, right, rtol=1e-3, atol=1e-4 * float(torch.dot(stiff.gradient(x), x)))
    assert float(torch.dot(stiff.gradient(x), x)) > float(torch.dot(bare.gradient(x), x))
    # Per node the diagonal is the energy of a field that is 1 there alone; the estimate may miss it by about half.
    for node in (0, 37, len(x) // 2):
        alone = torch.zeros_like(x)
        alone[node] = 1.0
        share = float(torch.dot(stiff.gradient(alone), alone) / stiff.diagonal()[node])
        assert 0.4 < share < 1.6


def test_slopes_go_on_into_wood_that_was_not_seen() -> None:
    """Rings that lean outwards along the stem by 0.06, seen along its lower half."""
    rng = np.random.default_rng(2)
    table = np.arange(30) * 12.0
    r, a, h = rng.uniform(80, 240, 6000), rng.uniform(-0.5, 0.5, 6000), rng.uniform(-150, 150, 6000)
    grid = grid_for(r, a, h, 10.0, 60_000)
    seen = h < 0.0
    age = np.round((r - 0.06 * h) / 12.0)
    on_ring = 12.0 * age + 0.06 * h
    places = Observations(on_ring[seen], a[seen], h[seen], age[seen], np.ones(int(seen.sum())))
    field = initial_displacement(grid, places, table, 12.0, 2.0)
    near = (h > 10.0) & (h < 50.0)
    found, _, _ = sample(grid, field, on_ring[near], a[near], h[near])
    assert np.median(np.abs(found + 0.06 * h[near])) < 0.9
    # A field that stayed as at the edge would be off by 0.06 h: 1.8 px in the middle of what is judged.
    assert np.median(np.abs(0.06 * h[near])) > 1.5


def test_coarser_grids_cover_the_same_wood() -> None:
    for grid in (OPEN, ROUND):
        coarse = grid.coarser(4)
        assert coarse.wraps == grid.wraps
        for fine, rough in ((grid.radius, coarse.radius), (grid.height, coarse.height)):
            npt.assert_allclose(rough[[0, -1]], fine[[0, -1]])
        values = np.random.default_rng(0).normal(size=coarse.shape).astype(np.float32)
        r, a, h = (np.random.default_rng(1).uniform(x[0], x[-1], 500) for x in (grid.radius, grid.azimuth, grid.height))
        same, _, _ = sample(grid, refine(grid, np.ones(grid.shape), grid), r, a, h)
        npt.assert_allclose(same, 1.0, rtol=1e-6)
        assert refine(coarse, values, grid).shape == grid.shape
