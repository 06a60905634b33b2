"""The radial displacement m_r: first from the traced rings, then polished on the phase (paper, Sec. 3.4 and 3.5).

Both are the same weighted least squares on the cylindrical grid: observations say where ``r + m_r`` should be, a
membrane energy keeps the field smooth between and beyond them. Where the phase can be trusted it gives the wanted
displacement in closed form, so the cyclic loss is minimised by Gauss-Newton steps, from coarse to fine, instead of
hundreds of gradient steps. Only the phase is compared, never the image: colors cannot pull rings out of shape.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy.sparse import csr_array

from woodfit.cylinder_grid import CylinderGrid, refine, trilinear, without_fold

Array = npt.NDArray[Any]

#: Steps of the coarse grid over those of the fine one; how far slopes go on, in smoothing lengths; how much less stiff
#: the coarse field is: it has too few nodes to follow more than the slow part anyway.
_COARSER, _BEND_RINGS, _SLACK = 4, 8.0, 1e-4

#: How far a counted age may miss before it fades, step by step, rings: at first all count in full, so that a start that
#: contradicts them is left. What remains in the first step of the weight of all that is not counted. By how many of its
#: losses a fit that contradicts all boundaries must be better than one that contradicts none.
_COUNT_MISSES, _GIVING_WAY, _CONTRADICTION = (1e3, 1e3, 1e3, 1.0, 0.5), 1e-3, 4.0


@dataclass(frozen=True)
class Observations:
    """Places on the face and what is known there.

    Attributes
    ----------
    radius, azimuth, height : arrays of shape (N,)
        Tree coordinates (px, rad, px).
    target : array of shape (N,)
        Ring age for boundary vertices; wrapped ring phase in rad for pixels.
    weight : array of shape (N,)
        How far it counts (a power of its confidence) times the face area (px²) that the place stands for.
    """

    radius: Array
    azimuth: Array
    height: Array
    target: Array
    weight: Array

    def at(self, places: Array) -> Observations:
        """Some of the places, by index or as a bool array of shape (N,)."""
        parts = (self.radius, self.azimuth, self.height, self.target, self.weight)
        return Observations(*(part[places] for part in parts))

    def weighing(self, times: float) -> Observations:
        """The same of so many times the weight."""
        return replace(self, weight=self.weight * times)


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep torch to one thread.

    The vectors are too short for more to pay, on a busy machine waiting threads are a hundred times slower, and sums
    must not depend on how many there are.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class Interpolation:
    """Trilinear interpolation as a sparse matrix and its transpose."""

    def __init__(self, grid: CylinderGrid, places: Observations) -> None:
        index, weight = trilinear(grid, places.radius, places.azimuth, places.height)
        count, nodes = len(index), int(np.prod(grid.shape))
        starts = np.arange(0, 8 * count + 1, 8)
        # SciPy's product is two to three times faster than that of torch's sparse layouts.
        self.forward = csr_array((weight.ravel(), index.ravel(), starts), shape=(count, nodes))
        self.backward = self.forward.T.tocsr()

    def at(self, field: torch.Tensor) -> torch.Tensor:
        """Value of a flat field at the places."""
        return torch.from_numpy(self.forward @ field.numpy())

    def back(self, values: torch.Tensor) -> torch.Tensor:
        """Transpose of `at`."""
        return torch.from_numpy(self.backward @ values.numpy())


class Membrane:
    """Energy of a field's slopes in the metric of the tree, per unit volume.

    With a `bend_px` the energy of its curvature is added: slopes then go on into what was not seen and fade over
    about that length, where those of a bare membrane end at once.
    """

    def __init__(self, grid: CylinderGrid, along_stem: float, bend_px: float = 0.0) -> None:
        self.shape = grid.shape
        self.wraps = grid.wraps
        dr, da, dh = grid.steps
        # A face seen from end to end gives one layer of height: its extent is not a scale.
        dh = max(dh, 1.0)
        arc = np.maximum(grid.radius, dr) * da
        volume = arc * dr * dh
        between = 0.5 * (volume[1:] + volume[:-1]) / dr**2
        self.radial = torch.from_numpy(between.astype(np.float32))[:, None, None]
        self.turning = torch.from_numpy((volume / arc**2).astype(np.float32))[:, None, None]
        self.rising = torch.from_numpy((along_stem * volume / dh**2).astype(np.float32))[:, None, None]
        self.bend = bend_px**2
        each = np.broadcast_to((1.0 / volume)[:, None, None], grid.shape)
        self.inverse_volume = torch.from_numpy(each.astype(np.float32).reshape(-1).copy())

    def gradient(self, flat: torch.Tensor) -> torch.Tensor:
        """Gradient of the energy, halved."""
        slopes = self._slopes(flat)
        return slopes + self.bend * self._slopes(self.inverse_volume * slopes) if self.bend else slopes

    def _slopes(self, flat: torch.Tensor) -> torch.Tensor:
        field = flat.view(self.shape)
        out = torch.zeros_like(field)
        slope = self.radial * (field[1:] - field[:-1])
        out[1:] += slope
        out[:-1] -= slope
        slope = self.turning * (field[:, 1:] - field[:, :-1])
        out[:, 1:] += slope
        out[:, :-1] -= slope
        if self.wraps:
            slope = (self.turning * (field[:, :1] - field[:, -1:]))[:, 0]
            out[:, 0] += slope
            out[:, -1] -= slope
        slope = self.rising * (field[:, :, 1:] - field[:, :, :-1])
        out[:, :, 1:] += slope
        out[:, :, :-1] -= slope
        return out.reshape(-1)

    def diagonal(self) -> torch.Tensor:
        """Diagonal of the energy's matrix, about."""
        out = torch.zeros(self.shape)
        out[1:] += self.radial
        out[:-1] += self.radial
        out += 2.0 * self.turning + 2.0 * self.rising
        slopes = out.reshape(-1)
        # A row of the Laplacian squared: its middle and, in three dimensions, about a quarter more for the rest.
        return slopes + 1.25 * self.bend * slopes**2 * self.inverse_volume


def solve(
    terms: Sequence[tuple[Interpolation, torch.Tensor, torch.Tensor]],
    membrane: Membrane,
    stiffness: float,
    start: torch.Tensor,
    iterations: int,
    base: torch.Tensor | None = None,
) -> torch.Tensor:
    """Conjugate gradients on sum w (A m - t)² + stiffness * membrane(m - base); without `base` on the field itself."""
    ridge = 1e-4 * stiffness

    def apply(field: torch.Tensor) -> torch.Tensor:
        total = stiffness * membrane.gradient(field) + ridge * field
        for places, weight, _ in terms:
            total = total + places.back(weight * places.at(field))
        return total

    right = torch.zeros_like(start) if base is None else stiffness * membrane.gradient(base) + ridge * base
    diagonal = stiffness * membrane.diagonal() + ridge
    for places, weight, target in terms:
        right = right + places.back(weight * target)
        # Row sums bound the diagonal of A' W A from above: a safe preconditioner without squaring the matrix.
        diagonal = diagonal + places.back(weight)
    field = start.clone()
    residual = right - apply(field)
    scaled = residual / diagonal
    direction = scaled.clone()
    power = torch.dot(residual, scaled)
    first = power
    for _ in range(iterations):
        if float(power) <= 1e-10 * float(first) or float(power) == 0.0:
            break
        moved = apply(direction)
        step = power / torch.dot(direction, moved)
        field = field + step * direction
        residual = residual - step * moved
        scaled = residual / diagonal
        following = torch.dot(residual, scaled)
        direction = scaled + (following / power) * direction
        power = following
    return field


def age_of_radius(radius: Array, ring_radius: Array) -> tuple[Array, Array]:
    """Ring age at an ideal radius and the local ring width, both of the shape of `radius`.

    Parameters
    ----------
    radius : array
        Ideal (undistorted) radius, px.
    ring_radius : array of shape (N,)
        Radius at age 0, 1, ... N-1; beyond, rings continue with the mean width of the outermost ten.

    Returns
    -------
    age, width_px : arrays
    """
    table = np.asarray(ring_radius, np.float64)
    count = len(table)
    last = float((table[-1] - table[max(0, count - 11)]) / max(1, min(10, count - 1)))
    ring = np.clip(np.searchsorted(table, radius, side="right") - 1, 0, count - 2)
    width = np.diff(table)[ring]
    age = ring + (radius - table[ring]) / width
    beyond = radius >= table[-1]
    age = np.where(beyond, count - 1 + (radius - table[-1]) / last, np.maximum(age, 0.0))
    return age, np.where(beyond, last, width)


def radius_of_age(age: Array, ring_radius: Array) -> Array:
    """Ideal radius (px) of a ring age; the inverse of `age_of_radius`."""
    table = np.asarray(ring_radius, np.float64)
    count = len(table)
    last = float((table[-1] - table[max(0, count - 11)]) / max(1, min(10, count - 1)))
    inside = np.interp(age, np.arange(count), table)
    return np.asarray(inside + np.maximum(np.asarray(age) - (count - 1), 0.0) * last)


@one_thread()
def initial_displacement(
    grid: CylinderGrid, boundaries: Observations, ring_radius: Array, stiffness_px: float, along_stem: float
) -> npt.NDArray[np.float32]:
    """Displacement that takes each traced boundary vertex to its ring's ideal radius.

    First on a coarse grid, whose slopes go on beyond what was seen, then the rest on the fine one.

    Parameters
    ----------
    grid : CylinderGrid
        Of the texture.
    boundaries : Observations
        Vertices with their ring age as target.
    ring_radius : array of shape (N,)
        Ideal radii at ages 0, 1, ...
    stiffness_px : float
        Length over which the field is smoothed.
    along_stem : float
        How much stiffer it is along the stem.

    Returns
    -------
    float32 array of the grid's shape
        ``r + m_r`` increases with r.
    """
    wanted = radius_of_age(boundaries.target, ring_radius) - boundaries.radius
    weight = torch.from_numpy(np.asarray(boundaries.weight, np.float32))
    target = torch.from_numpy(wanted.astype(np.float32))
    coarse = grid.coarser(_COARSER)
    bending = Membrane(coarse, along_stem, _BEND_RINGS * stiffness_px)
    slow = _robust_fit(coarse, boundaries, weight, target, bending, _SLACK * stiffness_px, None, 400)
    base = torch.from_numpy(refine(coarse, slow.view(coarse.shape).numpy(), grid).reshape(-1))
    field = _robust_fit(grid, boundaries, weight, target, Membrane(grid, along_stem), stiffness_px, base, 150)
    return without_fold(field.view(grid.shape).numpy(), grid.radius).astype(np.float32)


def _robust_fit(
    grid: CylinderGrid,
    boundaries: Observations,
    weight: torch.Tensor,
    target: torch.Tensor,
    membrane: Membrane,
    stiffness_px: float,
    base: torch.Tensor | None,
    iterations: int,
) -> torch.Tensor:
    """Field of least misfit to the boundaries, three times reweighted."""
    places = Interpolation(grid, boundaries)
    field = torch.zeros(int(np.prod(grid.shape))) if base is None else base
    robust = weight
    for _ in range(3):
        field = solve([(places, robust, target)], membrane, stiffness_px, field, iterations, base)
        miss = torch.abs(places.at(field) - target)
        # A wrongly numbered boundary must not bend its neighbours: beyond some median misses it fades.
        scale = 3.0 * float(miss.median()) + 1.0
        robust = weight / (1.0 + (miss / scale) ** 2)
    return field


@dataclass(frozen=True)
class Polished:
    """Result of `polish`.

    Attributes
    ----------
    displacement : float32 array of the grid's shape
        Px.
    loss : array
        Cyclic loss before the first step and after each.
    contradicted : float
        Share of the boundary vertices, by weight, that lie more than half a ring off; 0 where it was not asked.
    """

    displacement: npt.NDArray[np.float32]
    loss: npt.NDArray[np.float64]
    contradicted: float = 0.0

    @property
    def worth(self) -> float:
        """What remains, less is better: two sides of the pith a ring off fit as well, but for the boundaries."""
        return float(self.loss[-1]) * (1.0 + _CONTRADICTION * self.contradicted)


def cyclic_loss(difference_rad: Array, weight: Array) -> float:
    """Weighted mean of 1 - cos of phase differences: 0 when equal, 1 for noise, 2 when opposite."""
    return float((weight * (1.0 - np.cos(difference_rad))).sum() / max(float(weight.sum()), 1e-12))


@one_thread()
def polish(
    grid: CylinderGrid,
    start: Array,
    pixels: Observations,
    boundaries: Observations,
    ring_radius: Array,
    stiffness_px: Sequence[float],
    along_stem: float,
    boundary_share: float = 0.5,
    count: Array | None = None,
) -> Polished:
    """Minimise the cyclic phase difference between face and model over the displacement.

    Parameters
    ----------
    grid : CylinderGrid
        Of the texture.
    start : array of the grid's shape
        Initial displacement, px; its phase should be within pi/2 of the observed one.
    pixels : Observations
        Face pixels with their wrapped ring phase (rad).
    boundaries : Observations
        Boundary vertices with their ring age: they hold the exact edges, which a sinusoid's phase only approximates.
    ring_radius : array of shape (N,)
        Ideal radii at ages 0, 1, ...
    stiffness_px : sequence of float
        Smoothing length of each Gauss-Newton step, from coarse to fine.
    along_stem : float
        How much stiffer the field is along the stem.
    boundary_share : float
        Weight of all boundary vertices together, relative to all pixels together.
    count : array of shape (N,), optional
        Ring ages of the pixels as the phase counts them (`woodfit.ring_count`), NaN where it does not: whole rings are
        then not free, and boundaries and uncounted pixels give way in the first step.

    Returns
    -------
    Polished
    """
    membrane = Membrane(grid, along_stem)
    at_pixels, at_vertices = Interpolation(grid, pixels), Interpolation(grid, boundaries)
    field = base = torch.from_numpy(np.ascontiguousarray(start, np.float32).reshape(-1))
    heavy = boundary_share * float(pixels.weight.sum()) / max(float(boundaries.weight.sum()), 1e-9)
    losses: list[float] = []
    count = np.full(len(pixels.target), np.nan) if count is None else count
    counted = np.isfinite(count)
    counts = bool(counted.any())
    for step, stiffness in enumerate(stiffness_px):
        now = at_pixels.at(field).numpy()
        age, width = age_of_radius(pixels.radius + now, ring_radius)
        if not losses:
            losses.append(cyclic_loss(pixels.target - 2.0 * np.pi * age, pixels.weight))
        turn = pixels.target / (2.0 * np.pi) - age
        turn = turn - np.round(turn)
        # 1 - cos(x) is a parabola of height x sin(x): the weight of its Gauss-Newton step is sin(x) / x.
        fades = np.sinc(2.0 * turn)
        wanted = now + turn * width
        if counts:
            fades = _GIVING_WAY * fades if step == 0 else fades
            miss = (count - age)[counted] / _COUNT_MISSES[min(step, len(_COUNT_MISSES) - 1)]
            fades[counted] = 1.0 / (1.0 + miss**2)
            wanted[counted] = radius_of_age(count[counted], ring_radius) - pixels.radius[counted]
        # In rings, not px: wide and narrow rings count alike.
        scale = np.median(width)
        weight = pixels.weight * fades * (scale / width) ** 2

        held = at_vertices.at(field).numpy()
        vertex_age, vertex_width = age_of_radius(boundaries.radius + held, ring_radius)
        miss = boundaries.target - vertex_age
        vertex_weight = heavy * boundaries.weight * (scale / vertex_width) ** 2 / (1.0 + (miss / 0.25) ** 2)
        if counts and step == 0:
            vertex_weight = _GIVING_WAY * vertex_weight
        vertex_wanted = radius_of_age(boundaries.target, ring_radius) - boundaries.radius
        terms = [
            (at_pixels, tensor(weight), tensor(wanted)),
            (at_vertices, tensor(vertex_weight), tensor(vertex_wanted)),
        ]
        # The start's own shape is kept where nothing is seen; only the change is kept smooth.
        field = solve(terms, membrane, float(stiffness), field, 30, base)
        smooth = without_fold(field.view(grid.shape).numpy(), grid.radius)
        field = torch.from_numpy(smooth.astype(np.float32).reshape(-1))
        age, _ = age_of_radius(pixels.radius + at_pixels.at(field).numpy(), ring_radius)
        losses.append(cyclic_loss(pixels.target - 2.0 * np.pi * age, pixels.weight))
    vertex_age, _ = age_of_radius(boundaries.radius + at_vertices.at(field).numpy(), ring_radius)
    off = boundaries.weight[np.abs(boundaries.target - vertex_age) > 0.5]
    contradicted = float(off.sum() / max(float(boundaries.weight.sum()), 1e-9))
    return Polished(field.view(grid.shape).numpy().copy(), np.asarray(losses), contradicted)


def tensor(values: Array) -> torch.Tensor:
    """Values as float32."""
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))
