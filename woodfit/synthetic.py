"""The forward model: a log whose ring age is known everywhere, and photographs of it on any plane.

All points are in the board frame (x right, y down, z into the wood), in px. A log is a straight pith line, a
table of ring boundaries (radii), a smooth radial distortion that varies with radius, azimuth and height, and a
palette: the colors of each ring. Ring age is 0 at the pith and grows by 1 at each ring boundary.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

Floats = NDArray[np.float64]

_CHUNK_ROWS = 96
_PITH_RADIUS_PX = 2.5


def srgb_encode(linear: Floats) -> Floats:
    """Encode linear values 0..1 by the sRGB transfer curve (0..1, same shape)."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def srgb_decode(encoded: Floats) -> Floats:
    """Decode sRGB-encoded values 0..1 to linear ones (0..1, same shape)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@dataclass(frozen=True)
class Distortion:
    """Radial displacement ``m_r``: a sum of waves in azimuth, height and radius, zero at the pith.

    One wave is ``(amplitude * (1 - exp(-(r / fade)**2)) + share * r) * cos(n azimuth + k height + q r + shift)``.

    Parameters
    ----------
    amplitude, share
        Of each wave, shape (waves,), px and plain.
    order, height_rate, radius_rate, shift
        Integer n, k and q in rad/px and the shift in rad, shape (waves,).
    fade
        Radius in px over which the waves set in.
    """

    amplitude: Floats
    share: Floats
    order: Floats
    height_rate: Floats
    radius_rate: Floats
    shift: Floats
    fade: float

    def bound(self) -> float:
        """Upper bound of ``|d m_r / d r|`` at any place; rings cannot fold over while it is below 1."""
        # 0.858 / fade is the steepest slope of 1 - exp(-(r / fade)**2); waves with a share have radius_rate 0.
        slopes = np.abs(self.amplitude) * (0.858 / self.fade + np.abs(self.radius_rate)) + np.abs(self.share)
        return float(slopes.sum())

    def __call__(self, radius: Floats, azimuth: Floats, height: Floats) -> Floats:
        """Displacement in px at cylindrical places of one shape (px, rad, px)."""
        onset = -np.expm1(-((radius / self.fade) ** 2))
        total = np.zeros_like(radius)
        for a, s, n, k, q, c in zip(
            self.amplitude, self.share, self.order, self.height_rate, self.radius_rate, self.shift, strict=True
        ):
            total += (a * onset + s * radius) * np.cos(n * azimuth + k * height + q * radius + c)
        return total


@dataclass(frozen=True)
class Palette:
    """Color of every ring over its fraction, and what the fibre, vessels and rays add.

    Parameters
    ----------
    early, late
        Linear rgb of earlywood and latewood of each ring, shape (rings, 3).
    onset, power
        Fraction at which each ring starts to darken and the exponent of its darkening, shape (rings,).
    streak
        Strength of the fibre streaks, as standard deviation of log brightness.
    streak_length
        Length of the fibre streaks along the pith, px.
    pore_share
        Fraction of the ring taken by the pore band of ring-porous wood; 0 for a conifer.
    pore_spacing, pore_radius, pore_darkness
        Lattice constant and radius of the vessels in px, and the share of light that a vessel swallows.
    ray
        Strength of the rays (log brightness); 0 for none.
    """

    early: Floats
    late: Floats
    onset: Floats
    power: Floats
    streak: float
    streak_length: float
    pore_share: float = 0.0
    pore_spacing: float = 8.0
    pore_radius: float = 2.5
    pore_darkness: float = 0.6
    ray: float = 0.0

    def lateness(self, age: Floats) -> Floats:
        """Lateness 0..1 at ring ages of any shape: a slow rise, then an abrupt fall at the boundary."""
        ring = np.clip(age.astype(np.intp), 0, len(self.early) - 1)
        fraction = age - np.floor(age)
        onset = self.onset[ring]
        return np.asarray(np.clip((fraction - onset) / (1.0 - onset), 0.0, 1.0) ** self.power[ring], dtype=float)

    def base(self, age: Floats) -> Floats:
        """Linear rgb by ring age alone, shape (..., 3): a mix of absorbances, not of light."""
        ring = np.clip(age.astype(np.intp), 0, len(self.early) - 1)
        early, late = np.log(self.early), np.log(self.late)
        return np.asarray(np.exp(early[ring] + self.lateness(age)[..., None] * (late - early)[ring]), dtype=float)


@dataclass(frozen=True)
class Log:
    """A log with known ring age everywhere.

    Parameters
    ----------
    pith
        A point of the pith line, board frame, px; height 0 is there.
    direction
        Unit vector of the pith line, board frame.
    taper
        Relative change of ring radii per px of height.
    boundaries
        Undistorted radius of each ring boundary in px, increasing from 0; boundary i has ring age i.
    distortion
        Radial displacement.
    palette
        Colors.
    seed
        Of the grain noise.
    """

    pith: tuple[float, float, float]
    direction: tuple[float, float, float]
    taper: float
    boundaries: Floats
    distortion: Distortion
    palette: Palette
    seed: int

    @cached_property
    def axes(self) -> Floats:
        """Tree axes as rows in the board frame, shape (3, 3); the last row is the pith direction."""
        direction = np.asarray(self.direction, dtype=float)
        helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
        first = np.cross(helper, direction)
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(direction, first), direction])

    @cached_property
    def _grain(self) -> NDArray[np.float32]:
        return np.random.default_rng(self.seed).standard_normal((96, 96, 48), dtype=np.float32)

    def tree(self, points: ArrayLike) -> Floats:
        """Points (..., 3) of the board frame in the tree frame (x, y across, z along the pith), px."""
        return np.asarray((np.asarray(points, dtype=float) - np.asarray(self.pith)) @ self.axes.T, dtype=float)

    def grown_radius(self, tree: Floats) -> Floats:
        """Radius ``r + m_r`` in px, taper undone, of tree-frame points (..., 3): the key into `boundaries`."""
        x, y, height = tree[..., 0], tree[..., 1], tree[..., 2]
        radius = np.hypot(x, y)
        return (radius + self.distortion(radius, np.arctan2(y, x), height)) * (1.0 + self.taper * height)

    def _age(self, tree: Floats) -> Floats:
        grown = self.grown_radius(tree)
        last = len(self.boundaries) - 1
        width = self.boundaries[-1] - self.boundaries[-2]
        beyond = np.maximum(grown - self.boundaries[-1], 0.0) / width
        return np.asarray(np.interp(grown, self.boundaries, np.arange(last + 1.0)) + beyond, dtype=float)

    def age(self, points: ArrayLike) -> Floats:
        """Ring age, shape (...), of board-frame points (..., 3) in px: 0 at the pith, +1 at each boundary."""
        return self._age(self.tree(points))

    def color(self, points: ArrayLike) -> Floats:
        """Linear rgb 0..1, shape (..., 3), of board-frame points (..., 3) in px, without light and sensor."""
        tree = self.tree(points)
        age = self._age(tree)
        palette = self.palette
        x, y, z = tree[..., 0], tree[..., 1], tree[..., 2]
        radius = np.hypot(x, y)
        length = palette.streak_length
        fine = self._noise(x / 1.4, y / 1.4, z / length)
        coarse = self._noise(x / 6.5 + 17.0, y / 6.5, z / (4.0 * length))
        stain = self._noise(x / 70.0, y / 70.0 + 31.0, z / 500.0)
        absorbance = -palette.streak * (0.9 * fine + 0.7 * coarse) - 0.03 * stain
        if palette.ray > 0.0:
            azimuth = np.arctan2(y, x)
            rays = self._noise(azimuth * 180.0 + 900.0, radius / 110.0 + 3.0, z / 28.0)
            absorbance -= palette.ray * np.clip(rays - 0.7, 0.0, 1.2)
        rgb = palette.base(age) * np.exp(-absorbance)[..., None]
        if palette.pore_share > 0.0:
            rgb *= 1.0 - palette.pore_darkness * self._pores(x, y, z, age)[..., None] * np.array([0.9, 1.0, 1.08])
        pith = np.exp(-((radius / _PITH_RADIUS_PX) ** 4))
        return np.clip(rgb * (1.0 - 0.5 * pith)[..., None], 0.0, 1.0)

    def _noise(self, x: Floats, y: Floats, z: Floats) -> Floats:
        """Periodic trilinear noise of about unit lattice and unit variance at the lattice points."""
        places = np.stack([x.ravel(), y.ravel(), z.ravel()]).astype(np.float32)
        noise = ndimage.map_coordinates(self._grain, places, order=1, mode="grid-wrap")
        return np.asarray(noise, dtype=float).reshape(x.shape)

    def _pores(self, x: Floats, y: Floats, z: Floats, age: Floats) -> Floats:
        """Share of vessel lumen 0..1: one vessel per jittered cell across the grain, winding along it."""
        palette = self.palette
        cell = palette.pore_spacing
        fraction = age - np.floor(age)
        # Vessels wind: longitudinal faces cut them into streaks of finite length instead of endless lines.
        wind_x = 0.55 * cell * self._noise(x / 60.0, y / 60.0, z / 75.0)
        wind_y = 0.55 * cell * self._noise(x / 60.0 + 40.0, y / 60.0, z / 75.0)
        across, down = (x + wind_x) / cell, (y + wind_y) / cell
        early = np.clip(1.0 - fraction / palette.pore_share, 0.0, 1.0) ** 0.35
        radius = palette.pore_radius * np.maximum(early, 0.22)
        filled = 0.35 + 0.65 * (early > 0.0)
        column, row = np.floor(across), np.floor(down)
        jitter = np.random.default_rng([self.seed, 1]).random((4, 64, 64)).astype(np.float32)
        # Vessels too small to resolve darken the whole band a little.
        lumen = 0.2 * early
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                i, j = (column + dx).astype(np.intp), (row + dy).astype(np.intp)
                off_x, off_y, size, chance = jitter[:, i & 63, j & 63]
                distance = cell * np.hypot(i + 0.1 + 0.8 * off_x - across, j + 0.1 + 0.8 * off_y - down)
                rim = np.clip((radius * (0.7 + 0.5 * size) - distance) + 0.5, 0.0, 1.0)
                lumen = np.maximum(lumen, rim * (chance < filled))
        return lumen


@dataclass(frozen=True)
class Photograph:
    """A photograph of a plane with its truth.

    Parameters
    ----------
    rgb_encoded
        sRGB-encoded pixels, uint8, shape (H, W, 3).
    age
        Ring age at the pixel centres, float32, shape (H, W).
    """

    rgb_encoded: NDArray[np.uint8]
    age: NDArray[np.float32]


def plane_points(
    size_yx: tuple[int, int], origin: ArrayLike, u: ArrayLike, v: ArrayLike, shift: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """Board-frame points, shape (H, W, 3): pixel (row, column) lies at ``origin + column * u + row * v``.

    `shift` is added to (row, column).
    """
    rows = np.arange(size_yx[0], dtype=float)[:, None, None] + shift[0]
    columns = np.arange(size_yx[1], dtype=float)[None, :, None] + shift[1]
    corner, right, down = (np.asarray(vector, dtype=float) for vector in (origin, u, v))
    return np.asarray(corner + columns * right + rows * down, dtype=float)


def photograph(
    log: Log,
    size_yx: tuple[int, int],
    origin: ArrayLike = (0.0, 0.0, 0.0),
    u: ArrayLike = (1.0, 0.0, 0.0),
    v: ArrayLike = (0.0, 1.0, 0.0),
    *,
    rng: np.random.Generator,
    noise: float = 1.0,
) -> Photograph:
    """Photograph the plane ``origin + column * u + row * v`` (board frame, px) of a log as a good scan does.

    Each pixel averages 2x2 samples, the optics blur by about 0.6 px, the light varies slowly by some per cent,
    and the sensor adds shot and read noise; `noise` scales light variation and sensor noise (0: none).
    """
    sides = np.asarray(u, float), np.asarray(v, float)
    linear = np.empty((*size_yx, 3), dtype=np.float32)
    age = np.empty(size_yx, dtype=np.float32)
    for top in range(0, size_yx[0], _CHUNK_ROWS):
        rows = min(_CHUNK_ROWS, size_yx[0] - top)
        corner = np.asarray(origin, float) + top * sides[1]
        age[top : top + rows] = log.age(plane_points((rows, size_yx[1]), corner, *sides))
        samples = [
            log.color(plane_points((rows, size_yx[1]), corner, *sides, shift=(dy, dx)))
            for dy in (-0.25, 0.25)
            for dx in (-0.25, 0.25)
        ]
        linear[top : top + rows] = np.mean(samples, axis=0)
    blurred = cv2.GaussianBlur(linear, (0, 0), rng.uniform(0.45, 0.75), borderType=cv2.BORDER_REFLECT_101)
    lit = blurred * (1.0 + noise * _light(size_yx, rng))[..., None]
    sigma = noise * np.hypot(rng.uniform(0.001, 0.003), rng.uniform(0.005, 0.018) * np.sqrt(np.maximum(lit, 0.0)))
    noisy = lit + sigma * rng.standard_normal(lit.shape)
    return Photograph(np.round(255.0 * srgb_encode(noisy)).astype(np.uint8), age)


def _light(size_yx: tuple[int, int], rng: np.random.Generator) -> Floats:
    """Slow relative variation of the light, shape (H, W)."""
    height, width = size_yx
    y, x = np.linspace(-1.0, 1.0, height)[:, None], np.linspace(-1.0, 1.0, width)[None, :]
    slope = rng.normal(0.0, 0.03, size=2)
    knots = rng.normal(0.0, 0.03, size=(4, 4)).astype(np.float32)
    blobs = cv2.resize(knots, (width, height), interpolation=cv2.INTER_CUBIC).reshape(height, width)
    vignette = rng.uniform(0.0, 0.06) * (x**2 + y**2)
    return np.asarray(slope[0] * x + slope[1] * y + blobs - vignette, dtype=float)
