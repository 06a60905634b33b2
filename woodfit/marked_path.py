"""Ring boundaries that a person marked along a path, apart from any file format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class MarkedPath:
    """What a person says about the boundaries along one path, from the pith outwards.

    Parameters
    ----------
    name : str
        For messages: the file, and the path in it.
    borders : tuple of float64 arrays of shape (1, 2) or (2, 2)
        x, y of each boundary in px; two points where the path goes on from another place on the same boundary.
    rings : tuple of int
        Rings from each boundary to the next (one fewer than boundaries): 1, more with absent rings, 0 where a gap hides
        how many.
    gaps : tuple of float64 arrays of shape (G, 2)
        Points between each boundary and the next where by turns a gap begins and ends; one that is left open
        ends at the next boundary.
    latewood : float64 array of shape (L, 2)
        x, y of the borders between earlywood and latewood in px.
    pith : float64 array of shape (2,) or None
        Where the path starts at the pith, which is no boundary.
    absent : tuple of int
        How many of `rings` the person called absent; none when left out. The others were counted, not seen.
    """

    name: str
    borders: tuple[FloatArray, ...]
    rings: tuple[int, ...]
    gaps: tuple[FloatArray, ...]
    latewood: FloatArray
    pith: FloatArray | None = None
    absent: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.absent:
            object.__setattr__(self, "absent", (0,) * len(self.rings))
        if not len(self.rings) == len(self.gaps) == len(self.absent) == max(0, len(self.borders) - 1):
            raise ValueError(f"{self.name}: {len(self.borders)} boundaries with {len(self.rings)} rings between")
        closed = [
            np.concatenate([gap, after[:1]]) if len(gap) % 2 else gap
            for gap, after in zip(self.gaps, self.borders[1:], strict=True)
        ]
        object.__setattr__(self, "gaps", tuple(closed))

    def reversed(self) -> MarkedPath:
        """The same path from the other end."""
        return replace(
            self,
            borders=tuple(border[::-1] for border in self.borders[::-1]),
            rings=self.rings[::-1],
            absent=self.absent[::-1],
            gaps=tuple(gap[::-1] for gap in self.gaps[::-1]),
            latewood=self.latewood[::-1],
        )

    def scaled(self, origin_xy: Sequence[float], step: float) -> MarkedPath:
        """The path in elements of an array whose first element lies at `origin_xy`, `step` px apart."""
        origin = np.asarray(origin_xy, np.float64)
        return replace(
            self,
            borders=tuple((border - origin) / step for border in self.borders),
            gaps=tuple((gap - origin) / step for gap in self.gaps),
            latewood=(self.latewood - origin) / step,
            pith=None if self.pith is None else (self.pith - origin) / step,
        )

    def stretches(self) -> list[FloatArray]:
        """For each ring interval the segments (S, 2, 2) on which every boundary is marked."""
        parts = []
        for before, gap, after in zip(self.borders[:-1], self.gaps, self.borders[1:], strict=True):
            way = np.concatenate([before[-1:], gap, after[:1]])
            parts.append(way.reshape(-1, 2, 2))
        return parts

    def absent_places(self) -> FloatArray:
        """A place on the boundary outside of each absent ring, shape (K, 2)."""
        places = [outer[0] for outer, count in zip(self.borders[1:], self.absent, strict=True) for _ in range(count)]
        return np.array(places, np.float64).reshape(-1, 2)

    def without_pith(self, pith: FloatArray, nearer_px: float) -> MarkedPath:
        """The path without a first boundary that is the pith."""
        if len(self.borders) < 2 or np.hypot(*(self.borders[0][0] - pith)) > nearer_px:
            return self
        return replace(
            self,
            borders=self.borders[1:],
            rings=self.rings[1:],
            gaps=self.gaps[1:],
            absent=self.absent[1:],
            pith=pith,
        )
