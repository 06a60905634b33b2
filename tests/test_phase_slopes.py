"""Rings as many as the phase counts, on a face whose phase is known and whose traced rings are not all right."""

import numpy as np
import numpy.testing as npt
import pytest
import torch

from woodfit.cylinder_grid import CylinderGrid, sample
from woodfit.displacement import (
    Difference,
    Interpolation,
    Observations,
    age_of_radius,
    initial_displacement,
    polish,
)
from woodfit.phase_slopes import Slopes, follow_slopes

Array = np.ndarray
GRID = CylinderGrid(np.linspace(60.0, 200.0, 36), np.linspace(-0.5, 0.5, 12), np.array([-1.0, 1.0]), wraps=False)
RINGS = 10.0 * np.arange(25)


def places(radius: Array, azimuth: Array, target: Array, weight: float = 1.0) -> Observations:
    r, a, t = (np.ravel(part).astype(float) for part in np.broadcast_arrays(radius, azimuth, target))
    return Observations(r, a, np.zeros(r.size), t, np.full(r.size, weight))


def face(step: float = 1.5) -> tuple[Array, Array]:
    r, a = np.meshgrid(np.arange(62.0, 197.0, step), np.linspace(-0.45, 0.45, 40), indexing="ij")
    return r, a


def slopes(apart_px: float = 2.0, weight: float = 25.0) -> list[Slopes]:
    """Along the radius and along the arc, of rings that are exactly even."""
    r, a = face()
    turn = np.full(r.size, apart_px / 10.0)
    outwards = Slopes(places(r + apart_px, a, 0.0, weight), places(r, a, 0.0, weight), turn)
    return [outwards, Slopes(places(r, a + 0.02, 0.0, weight), places(r, a - 0.02, 0.0, weight), np.zeros(r.size))]


def boundaries(false_at: float | None) -> Observations:
    """Traced rings; beyond a line that is no boundary all are counted one too many."""
    ages = np.arange(7, 20)
    radius, azimuth = np.meshgrid(10.0 * ages, np.linspace(-0.45, 0.45, 24), indexing="ij")
    counted = np.repeat(ages, 24).astype(float)
    if false_at is not None:
        counted += radius.ravel() > false_at
    return places(radius, azimuth, counted.reshape(radius.shape))


def ages(field: Array, radius: Array, azimuth: Array) -> Array:
    moved, _, _ = sample(GRID, field, radius.ravel(), azimuth.ravel(), np.zeros(radius.size))
    return age_of_radius(radius.ravel() + moved, RINGS)[0].reshape(radius.shape)


def polished(start: Array, held: Observations) -> Array:
    r, a = face()
    wrapped = np.angle(np.exp(2j * np.pi * r / 10.0))
    return polish(GRID, start, places(r, a, wrapped), held, RINGS, (48.0, 12.0, 3.0, 0.8, 0.3), 2.0, 0.1).displacement


@pytest.mark.parametrize("false_at", [95.0, 135.0])
def test_a_line_that_is_no_boundary_leaves_no_wall(false_at: float) -> None:
    held = boundaries(false_at)
    start = initial_displacement(GRID, held, RINGS, 10.0, 2.0)
    r, a = face()
    # Polishing alone keeps the false ring: the outermost and the innermost are one too far apart.
    alone = ages(polished(start, held), r, a)
    assert np.median(alone[-1] - alone[0]) - (r[-1, 0] - r[0, 0]) / 10.0 == pytest.approx(1.0, abs=0.2)
    counted = ages(polished(follow_slopes(GRID, start, slopes(), held, RINGS, 2.0), held), r, a)
    off = counted - r / 10.0
    assert np.abs(off - np.median(off)).max() < 0.2
    assert np.median(off) == pytest.approx(round(float(np.median(off))), abs=0.05)


def test_right_rings_stay_as_they_are() -> None:
    held = boundaries(None)
    start = initial_displacement(GRID, held, RINGS, 10.0, 2.0)
    r, a = face()
    npt.assert_allclose(ages(follow_slopes(GRID, start, slopes(), held, RINGS, 2.0), r, a), r / 10.0, atol=0.03)


def test_without_slopes_the_start_stays() -> None:
    start = np.random.default_rng(0).normal(size=GRID.shape).astype(np.float32)
    npt.assert_array_equal(follow_slopes(GRID, start, [], boundaries(None), RINGS, 2.0), start)


def test_a_difference_is_that_of_two_interpolations_and_its_transpose_belongs_to_it() -> None:
    r, a = face(7.0)
    ahead, behind = Interpolation(GRID, places(r + 2.0, a, 0.0)), Interpolation(GRID, places(r, a, 0.0))
    pair = Difference(ahead, behind)
    rng = np.random.default_rng(1)
    field = torch.from_numpy(rng.normal(size=int(np.prod(GRID.shape))).astype(np.float32))
    values = torch.from_numpy(rng.normal(size=r.size).astype(np.float32))
    npt.assert_allclose(pair.at(field), ahead.at(field) - behind.at(field), atol=1e-5)
    npt.assert_allclose(torch.dot(pair.at(field), values), torch.dot(field, pair.back(values)), rtol=1e-3)
    # Its bound is one: the matrix it stands for never exceeds it.
    weight = torch.ones(r.size)
    energy = torch.dot(pair.at(field), pair.at(field))
    assert float(energy) <= float(torch.dot(pair.bound(weight), field**2)) * 1.0001
