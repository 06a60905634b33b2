"""The solid texture: what a user takes away. Wood at any point, from one small file."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit import texture_file
from woodfit.cylinder_grid import CylinderGrid, cylindrical, sample, widening
from woodfit.fine_grain import FineGrain
from woodfit.seen import Seen

#: Points evaluated at a time: keeps the temporaries in the cache and the memory flat.
_BATCH = 1 << 17

#: Whole rings repeated, mirrored in nothing, where the wood goes on beyond the last one that the face shows.
_REPEAT = 8


#: A grid less high than this comes from a face at right angles to the pith, which does not show how layers lean.
_FLAT_PX = 1.0


@dataclass(frozen=True)
class WoodSample:
    """Wood at points of shape (...).

    Attributes
    ----------
    ring_age : float64 array
        0 at the pith, +1 at each ring boundary.
    ring_index : int64 array
        ``floor(ring_age)``.
    fraction : float64 array
        Share of that year's growth, 0..1.
    lateness : float32 array
        0 earlywood to 1 latewood.
    rgb : float32 array of shape (..., 3)
        Linear, sRGB primaries.
    fiber_direction : float32 array of shape (..., 3)
        Unit vector along the fibre, board frame.
    confidence : float32 array
        1 where the photographs show the wood, falling towards 0 away from them (`woodfit.seen`).
    """

    ring_age: npt.NDArray[np.float64]
    ring_index: npt.NDArray[np.int64]
    fraction: npt.NDArray[np.float64]
    lateness: npt.NDArray[np.float32]
    rgb: npt.NDArray[np.float32]
    fiber_direction: npt.NDArray[np.float32]
    confidence: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Place:
    """Where points lie in the tree.

    Attributes
    ----------
    distance : float64 array of shape (K,)
        Distance r from the pith line, px.
    radius : float64 array of shape (K,)
        Ideal radius of their growth layer, ``r + m_r``, px.
    azimuth, height : float64 arrays of shape (K,)
        rad and px.
    outward : float64 array of shape (K, 3)
        Unit vector away from the pith, board frame.
    fiber : float32 array of shape (K, 3)
        Unit vector along the fibre, board frame.
    """

    distance: npt.NDArray[np.float64]
    radius: npt.NDArray[np.float64]
    azimuth: npt.NDArray[np.float64]
    height: npt.NDArray[np.float64]
    outward: npt.NDArray[np.float64]
    fiber: npt.NDArray[np.float32]


@dataclass(frozen=True)
class SolidTexture:
    """A solid wood texture.

    ``age(q) = F(r + m_r(r, azimuth, height))`` with ``r`` the distance from the pith line and ``F`` the inverse of
    the table of ring radii; ``color = strip(age) exp(L)`` with ``L`` the fine grain.

    Attributes
    ----------
    board_to_tree : array of shape (4, 4)
        Rigid transform, px to px.
    grid, displacement
        The cylindrical grid and m_r on it, px.
    ring_radius : array of shape (N,)
        Ideal radius in px at ring age 0, 1, ...; rings continue beyond with the mean width of the outermost ten.
    color_strip : float32 array of shape (S, 3)
        Linear RGB; sample i is the color at ring age ``(i + 0.5) / samples_per_ring``.
    lateness_strip : float32 array of shape (S,)
        As `color_strip`.
    samples_per_ring : int
        Of the strips.
    pixel_size : float or None
        Size of a px in `length_unit`; None when no scale is known, and then points are px.
    attributes : dict
        Anything else worth keeping with the texture (JSON).
    length_unit : str
        Unit of points when `pixel_size` is known: mm, or that of a block's own frame.
    stem : array of shape (3,)
        bend_x, bend_y and taper of the stem in 1/px (`woodfit.cylinder_grid.cylindrical`).
    fine_grain : FineGrain
        Streaks, pores and rays beside the color of the rings.
    seen : Seen
        What the photographs show of the block.
    """

    board_to_tree: npt.NDArray[np.float64]
    grid: CylinderGrid
    displacement: npt.NDArray[np.float32]
    ring_radius: npt.NDArray[np.float64]
    color_strip: npt.NDArray[np.float32]
    lateness_strip: npt.NDArray[np.float32]
    samples_per_ring: int
    pixel_size: float | None = None
    attributes: dict[str, Any] = field(default_factory=dict)
    length_unit: str = "mm"
    stem: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    fine_grain: FineGrain = field(default_factory=FineGrain.none)
    seen: Seen = field(default_factory=Seen)

    @cached_property
    def unit(self) -> str:
        """Unit of points: ``"px"`` when no scale is known, else `length_unit`."""
        return "px" if self.pixel_size is None else self.length_unit

    @cached_property
    def mean_width(self) -> float:
        """Mean width (px) of the outermost ten rings, which rings beyond them have."""
        count = len(self.ring_radius)
        return float((self.ring_radius[-1] - self.ring_radius[max(0, count - 11)]) / max(1, min(10, count - 1)))

    @cached_property
    def ring_width(self) -> float:
        """Mean ring width in `unit`."""
        rings = max(1, len(self.ring_radius) - 1)
        return float(self.ring_radius[-1] - self.ring_radius[0]) / rings * (self.pixel_size or 1.0)

    @cached_property
    def middle_height(self) -> float:
        """Middle of the grid along the stem, px."""
        return float(0.5 * (self.grid.height[0] + self.grid.height[-1]))

    def evaluate(self, points: npt.ArrayLike, detail: bool = True) -> WoodSample:
        """Wood at points of the board frame.

        Parameters
        ----------
        points : array_like of shape (..., 3)
            x right, y down, z into the wood; in `unit`.
        detail : bool
            Whether the color has its fine grain; without, it is that of the rings alone.

        Returns
        -------
        WoodSample
            Arrays of shape (...).

        Raises
        ------
        ValueError
            When the last axis does not have three entries.
        """
        array = np.asarray(points, np.float64)
        if array.ndim == 0 or array.shape[-1] != 3:
            raise ValueError(f"points have shape {array.shape}, expected (..., 3)")
        flat = array.reshape(-1, 3) / (1.0 if self.pixel_size is None else self.pixel_size)
        count = len(flat)
        age, late = np.empty(count), np.empty(count, np.float32)
        rgb, fiber = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
        confidence, width = np.empty(count, np.float32), self.ring_width / (self.pixel_size or 1.0)
        for start in range(0, count, _BATCH):
            part = slice(start, start + _BATCH)
            place = self.place(flat[part])
            age[part], fiber[part] = self.age_of_radius(place.radius), place.fiber
            confidence[part] = self.seen.confidence(flat[part], age[part], width)
            rgb[part], late[part] = self.color_at(age[part])
            if detail and not self.fine_grain.empty:
                radius = self.fiber_radius(place)
                rgb[part] *= np.exp(self.fine_grain.log_factor(radius, place.azimuth, place.height, late[part]))
        index = np.floor(age).astype(np.int64)
        shape = array.shape[:-1]
        return WoodSample(
            age.reshape(shape),
            index.reshape(shape),
            (age - index).reshape(shape),
            late.reshape(shape),
            rgb.reshape(*shape, 3),
            fiber.reshape(*shape, 3),
            confidence.reshape(shape),
        )

    def place(self, points: npt.NDArray[np.float64]) -> Place:
        """Where points (K, 3) of the board frame, in px, lie in the tree."""
        r, azimuth, height = cylindrical(points, self.board_to_tree, self.stem)
        moved, slope_r, slope_h = sample(self.grid, self.displacement, r, azimuth, height)
        # The fibre stays within its growth layer: where the layers lean outwards with height, it leans with them.
        lean = -slope_h / np.maximum(1.0 + slope_r, 0.05)
        if np.ptp(self.grid.height) < _FLAT_PX:
            lean = np.zeros_like(lean)
        bend_x, bend_y, taper = (float(part) for part in self.stem)
        if taper:
            wide = widening(height, taper)
            lean = lean / wide - np.where(wide > 0.05, taper, 0.0) * r / wide**2
        rotation = self.board_to_tree[:3, :3]
        outward = np.cos(azimuth)[:, None] * rotation[0] + np.sin(azimuth)[:, None] * rotation[1]
        fiber = rotation[2] + lean[:, None] * outward
        if bend_x or bend_y:
            fiber = fiber + (2.0 * height)[:, None] * (bend_x * rotation[0] + bend_y * rotation[1])
        fiber /= np.linalg.norm(fiber, axis=1, keepdims=True)
        return Place(
            r.astype(np.float64),
            np.asarray(r + moved, np.float64),
            azimuth.astype(np.float64),
            height.astype(np.float64),
            outward,
            fiber.astype(np.float32),
        )

    def fiber_radius(self, place: Place) -> npt.NDArray[np.float64]:
        """Radius (px) of the fibre through places, where it passes through the middle of the grid's height; (K,).

        Constant along a fibre like the ideal radius, but with the true widths across: what stretches one ring and
        presses another does not do so to the fibres.
        """
        middle = np.full_like(place.height, self.middle_height)
        there, _, _ = sample(self.grid, self.displacement, place.distance, place.azimuth, middle)
        return np.asarray(place.radius - there, dtype=np.float64)

    def age_of_radius(self, radius: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Ring age at ideal radii (px), same shape."""
        table = self.ring_radius
        age = np.interp(radius, table, np.arange(len(table)))
        beyond = np.maximum(radius - table[-1], 0.0) / self.mean_width
        return np.asarray(age + beyond, dtype=np.float64)

    def color_at(self, age: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Linear RGB (K, 3) and lateness (K,) of the rings at ring ages (K,), without fine grain."""
        strip, period = self.repeated_strip
        size = len(self.color_strip)
        position = np.maximum(age * self.samples_per_ring - 0.5, 0.0)
        beyond = position - (size - 0.5)
        position = np.where(beyond >= 0.0, size - 0.5 + np.mod(beyond, period), position)
        low = position.astype(np.int64)
        part = (position - low).astype(np.float32)
        both = strip[low] * (1.0 - part)[:, None] + strip[low + 1] * part[:, None]
        return both[:, :3], both[:, 3]

    @cached_property
    def repeated_strip(self) -> tuple[npt.NDArray[np.float32], int]:
        """Color and lateness, the last whole rings twice and one sample more, and how many samples come again."""
        strip = np.column_stack([self.color_strip, self.lateness_strip]).astype(np.float32)
        rings = min(_REPEAT, len(strip) // self.samples_per_ring)
        period = rings * self.samples_per_ring or len(strip)
        # Beyond the strip its last whole rings come again, rather than one color smeared out.
        again = strip[-period:]
        return np.ascontiguousarray(np.concatenate([strip, again, again[:1]])), period

    def save(self, path: str | Path) -> None:
        """Write the texture to one self-contained file (``.zarr.zip``; see docs/solid_texture.md)."""
        texture_file.write(self, Path(path))

    @classmethod
    def open(cls, path: str | Path) -> SolidTexture:
        """Read a texture that `save` wrote.

        Raises
        ------
        woodfit.zarr_zip.TextureFileError
            When the file is missing, damaged, of another kind or of a later version.
        """
        return cls(**texture_file.read(Path(path)))
