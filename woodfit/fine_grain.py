"""Fine grain: what a face shows beside its rings, as a layer of noise that runs along the fibre anywhere in the tree.

The color of a point is ``strip(age) * exp(L)``; L is a sum of a few lattice noises (:mod:`woodfit.fine_grain_noise`):
fibre streaks, pores, rays, and streaks along the growth layers. Pores and rays as exponents on the color follow Liu et
al., "Simulating the structure and texture of solid wood" (SIGGRAPH Asia 2016). The lattices lie in the tree's own
coordinates, with the ideal radius of a growth layer for the radius, so the grain follows the layers where they bend.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit import fine_grain_noise as noise

Array = npt.NDArray[Any]
FloatArray = npt.NDArray[np.float64]

#: Lateness at which the mean of the factor is kept, so that color is not shifted.
LEVELS: FloatArray = np.linspace(0.0, 1.0, 5)

#: Points that the mean of the factor is taken over.
_MEAN_POINTS = 60_000


@dataclass(frozen=True)
class FineGrain:
    """A sum of K noises.

    Attributes
    ----------
    kind : int64 array of shape (K,)
        ``fine_grain_noise.FIBRE``, ``PORE``, ``RAY`` or ``LAYER``.
    cells : float64 array of shape (K, 3)
        Size of the lattice's cells in px; for FIBRE and PORE across, across, along the fibre; for RAY along the
        arc, the height, the radius; for LAYER along the radius, the height, the arc.
    density : float64 array of shape (K,)
        Share of the cells that hold a pore; read for PORE only.
    amplitude : float64 array of shape (K, 2)
        In earlywood and in latewood, as exponents: standard deviation, for PORE the depth of one.
    color : float64 array of shape (K, 3)
        Share of the exponent that red, green and blue get.
    log_mean : float64 array of shape (5, 3)
        Logarithm of the mean factor at lateness 0, 1/4, ... 1, which is taken off again.
    seed : int
        Another seed, another piece of the same wood.
    """

    kind: npt.NDArray[np.int64]
    cells: FloatArray
    density: FloatArray
    amplitude: FloatArray
    color: FloatArray
    log_mean: FloatArray
    seed: int = 0

    @classmethod
    def none(cls) -> FineGrain:
        """No fine grain at all."""
        three, two = np.zeros((0, 3)), np.zeros((0, 2))
        return cls(np.zeros(0, np.int64), three, np.zeros(0), two, three, np.zeros((len(LEVELS), 3)))

    @classmethod
    def of(cls, kind: Array, cells: Array, density: Array, amplitude: Array, color: Array, seed: int = 0) -> FineGrain:
        """Fine grain of given noises, its mean factor measured on random points of the tree."""
        kind, density = np.asarray(kind, np.int64).ravel(), np.asarray(density, np.float64).ravel()
        cells = np.asarray(cells, np.float64).reshape(-1, 3)
        amplitude, color = (np.asarray(part, np.float64) for part in (amplitude, color))
        raw = cls(kind, cells, density, amplitude, color, np.zeros((len(LEVELS), 3)), seed)
        rng = np.random.default_rng(1)
        span = 1e4 * max(1.0, float(cells.max(initial=1.0)))
        radius, height = rng.uniform(0.0, span, (2, _MEAN_POINTS))
        azimuth = rng.uniform(-np.pi, np.pi, _MEAN_POINTS)
        fields = np.zeros((_MEAN_POINTS, len(kind)), np.float32)
        for number, one in enumerate(raw.seeds):
            fields[:, number] = noise.render(
                int(kind[number]), cells[number], float(density[number]), one, radius, azimuth, height
            )
        log_mean = np.zeros((len(LEVELS), 3))
        for row, level in enumerate(LEVELS):
            strength = (1.0 - level) * amplitude[:, :1] + level * amplitude[:, 1:]
            log_mean[row] = np.log(np.exp(fields @ (strength * color)).mean(axis=0))
        return cls(kind, cells, density, amplitude, color, log_mean, seed)

    @classmethod
    def unit(cls, kind: int, cells: tuple[float, ...], density: float, seed: int) -> FineGrain:
        """One grey noise of amplitude 1, its mean left where it is."""
        one = np.ones((1, 3))
        return cls(
            np.array([kind]),
            np.asarray(cells, np.float64)[None],
            np.array([density]),
            one[:, :2],
            one,
            np.zeros((len(LEVELS), 3)),
            seed,
        )

    @property
    def empty(self) -> bool:
        """Whether there is nothing to add."""
        return len(self.kind) == 0

    @property
    def seeds(self) -> npt.NDArray[np.uint64]:
        """Seed of each noise, below 2³²."""
        mixed = np.random.SeedSequence(self.seed).generate_state(1)[0]
        # Kind and cells, not the place in the list, tell noises apart: one more leaves the others as they were.
        return np.array(
            [mixed ^ _name(kind, cells) for kind, cells in zip(self.kind, self.cells, strict=True)], np.uint64
        )

    def log_factor(self, radius: Array, azimuth: Array, height: Array, lateness: Array) -> npt.NDArray[np.float32]:
        """Logarithm of what the linear color is multiplied by.

        Parameters
        ----------
        radius, azimuth, height : arrays of shape (N,)
            Points in the tree: ideal radius of their growth layer (``r + m_r``, px), rad, px.
        lateness : array of shape (N,)
            0 earlywood to 1 latewood.

        Returns
        -------
        float32 array of shape (N, 3)
            Its exponential has mean 1 at any lateness, over the whole tree.
        """
        late = np.ascontiguousarray(lateness, np.float32)
        if self.empty:
            return np.zeros((len(late), 3), np.float32)
        r, a, h = (np.ascontiguousarray(axis, np.float64) for axis in (radius, azimuth, height))
        factor = noise.log_color(
            self.kind, self.cells, self.density, self.amplitude, self.color, self.seeds, r, a, h, late
        )
        place = np.clip(late, 0.0, 1.0) * (len(LEVELS) - 1)
        low = np.minimum(place.astype(np.int64), len(LEVELS) - 2)
        part = (place - low).astype(np.float32)[:, None]
        table = self.log_mean.astype(np.float32)
        return np.asarray(factor - table[low] * (1.0 - part) - table[low + 1] * part, dtype=np.float32)


def _name(kind: Any, cells: Array) -> np.uint32:
    """32 bits that stand for a kind and cells."""
    words = [int(kind), *(int(word) for word in np.asarray(cells, np.float32).view(np.uint32))]
    return np.uint32(np.random.SeedSequence(words).generate_state(1)[0])
