"""The solid texture: what a user takes away. Wood at any point, from one small file."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit import zarr_zip
from woodfit.cylinder_grid import CylinderGrid, cylindrical, sample

FORMAT = "woodpipe solid texture"
FORMAT_VERSION = 1

#: Points evaluated at a time: keeps the temporaries in the cache and the memory flat.
_BATCH = 1 << 17

#: Whole rings repeated, mirrored in nothing, where the wood goes on beyond the last one that the face shows.
_REPEAT = 8


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
    """

    ring_age: npt.NDArray[np.float64]
    ring_index: npt.NDArray[np.int64]
    fraction: npt.NDArray[np.float64]
    lateness: npt.NDArray[np.float32]
    rgb: npt.NDArray[np.float32]
    fiber_direction: npt.NDArray[np.float32]


@dataclass(frozen=True)
class SolidTexture:
    """A solid wood texture.

    ``age(q) = F(r + m_r(r, azimuth, height))`` with ``r`` the distance from the pith line and ``F`` the inverse of
    the table of ring radii; ``color = strip(age)``.

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
        mm per px; None when no scale is known, and then points are px.
    attributes : dict
        Anything else worth keeping with the texture (JSON).
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

    @cached_property
    def unit(self) -> str:
        """Unit of points: ``"mm"``, or ``"px"`` when no scale is known."""
        return "px" if self.pixel_size is None else "mm"

    @cached_property
    def _mean_width(self) -> float:
        count = len(self.ring_radius)
        return float((self.ring_radius[-1] - self.ring_radius[max(0, count - 11)]) / max(1, min(10, count - 1)))

    def evaluate(self, points: npt.ArrayLike) -> WoodSample:
        """Wood at points of the board frame.

        Parameters
        ----------
        points : array_like of shape (..., 3)
            x right, y down, z into the wood; in mm, or px when `pixel_size` is None.

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
        for start in range(0, count, _BATCH):
            part = slice(start, start + _BATCH)
            age[part], fiber[part] = self._grow(flat[part])
            rgb[part], late[part] = self._color(age[part])
        index = np.floor(age).astype(np.int64)
        shape = array.shape[:-1]
        return WoodSample(
            age.reshape(shape),
            index.reshape(shape),
            (age - index).reshape(shape),
            late.reshape(shape),
            rgb.reshape(*shape, 3),
            fiber.reshape(*shape, 3),
        )

    def _grow(self, points: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float32]]:
        """Ring age and fibre direction at points (K, 3) in px."""
        r, azimuth, height = cylindrical(points, self.board_to_tree)
        moved, slope_r, slope_h = sample(self.grid, self.displacement, r, azimuth, height)
        age = self._age(r + moved)
        # The fibre stays within its growth layer: where the layers lean outwards with height, it leans with them.
        lean = -slope_h / np.maximum(1.0 + slope_r, 0.05)
        rotation = self.board_to_tree[:3, :3]
        outward = np.cos(azimuth)[:, None] * rotation[0] + np.sin(azimuth)[:, None] * rotation[1]
        fiber = rotation[2] + lean[:, None] * outward
        fiber /= np.linalg.norm(fiber, axis=1, keepdims=True)
        return age, fiber.astype(np.float32)

    def _age(self, radius: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        table = self.ring_radius
        age = np.interp(radius, table, np.arange(len(table)))
        beyond = np.maximum(radius - table[-1], 0.0) / self._mean_width
        return np.asarray(age + beyond, dtype=np.float64)

    def _color(self, age: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Color and lateness at ring ages (K,); linear between strip samples."""
        strip, period = self._strip
        size = len(self.color_strip)
        position = np.maximum(age * self.samples_per_ring - 0.5, 0.0)
        beyond = position - (size - 0.5)
        position = np.where(beyond >= 0.0, size - 0.5 + np.mod(beyond, period), position)
        low = position.astype(np.int64)
        part = (position - low).astype(np.float32)
        both = strip[low] * (1.0 - part)[:, None] + strip[low + 1] * part[:, None]
        return both[:, :3], both[:, 3]

    @cached_property
    def _strip(self) -> tuple[npt.NDArray[np.float32], int]:
        """Color and lateness, the last whole rings twice and one sample more, and how many samples come again."""
        strip = np.column_stack([self.color_strip, self.lateness_strip]).astype(np.float32)
        rings = min(_REPEAT, len(strip) // self.samples_per_ring)
        period = rings * self.samples_per_ring or len(strip)
        # Beyond the strip its last whole rings come again, rather than one color smeared out.
        again = strip[-period:]
        return np.ascontiguousarray(np.concatenate([strip, again, again[:1]])), period

    def save(self, path: str | Path) -> None:
        """Write the texture to one self-contained file (``.zarr.zip``; see docs/solid_texture.md)."""
        arrays: dict[str, npt.NDArray[Any]] = {
            "board_to_tree": np.asarray(self.board_to_tree, np.float64),
            "displacement": np.asarray(self.displacement, np.float32),
            "ring_radius": np.asarray(self.ring_radius, np.float64),
            "color_strip": np.asarray(self.color_strip, np.float32),
            "lateness_strip": np.asarray(self.lateness_strip, np.float32),
            "grid_radius": self.grid.radius,
            "grid_azimuth": self.grid.azimuth,
            "grid_height": self.grid.height,
        }
        attributes = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "pixel_size_mm": self.pixel_size,
            "samples_per_ring": self.samples_per_ring,
            "azimuth_wraps": self.grid.wraps,
            **self.attributes,
        }
        zarr_zip.write(Path(path), arrays, attributes)

    @classmethod
    def open(cls, path: str | Path) -> SolidTexture:
        """Read a texture that `save` wrote.

        Raises
        ------
        woodfit.zarr_zip.TextureFileError
            When the file is missing, damaged, of another kind or of a later version.
        """
        arrays, attributes = zarr_zip.read(Path(path))
        if attributes.pop("format", None) != FORMAT:
            raise zarr_zip.TextureFileError(f"{path}: a Zarr group, but not a {FORMAT}")
        version = attributes.pop("format_version", None)
        if version != FORMAT_VERSION:
            raise zarr_zip.TextureFileError(
                f"{path}: texture format version {version}, this woodpipe reads version {FORMAT_VERSION}"
            )
        try:
            grid = CylinderGrid(
                arrays["grid_radius"],
                arrays["grid_azimuth"],
                arrays["grid_height"],
                bool(attributes.pop("azimuth_wraps")),
            )
            _check_shapes(arrays, grid)
            size = attributes.pop("pixel_size_mm")
            return cls(
                arrays["board_to_tree"],
                grid,
                arrays["displacement"],
                arrays["ring_radius"],
                arrays["color_strip"],
                arrays["lateness_strip"],
                int(attributes.pop("samples_per_ring")),
                None if size is None else float(size),
                attributes,
            )
        except KeyError as missing:
            raise zarr_zip.TextureFileError(f"{path}: the texture lacks {missing}") from None
        except (TypeError, ValueError) as wrong:
            raise zarr_zip.TextureFileError(f"{path}: the texture is damaged ({wrong})") from None


def _check_shapes(arrays: dict[str, npt.NDArray[Any]], grid: CylinderGrid) -> None:
    """Raise `ValueError` when the arrays of a file do not fit each other."""
    samples, rings = max(2, len(arrays["color_strip"])), max(2, len(arrays["ring_radius"]))
    expected = {
        "board_to_tree": (4, 4),
        "displacement": tuple(max(2, n) for n in grid.shape),
        "ring_radius": (rings,),
        "color_strip": (samples, 3),
        "lateness_strip": (samples,),
    }
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise ValueError(f"`{name}` has shape {arrays[name].shape}, expected {shape}")
