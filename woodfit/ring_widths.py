"""Widths of the rings between the boundaries that a path crosses, at right angles to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from woodfit.measuring import Crossings

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class PathRings:
    """Rings along one path, from the inside out, one for every index from the first boundary's to the last one's.

    Parameters
    ----------
    index : int array of shape (m,)
        Index of the boundary that closes the ring outside.
    inner, outer : int arrays of shape (m,)
        Which crossings bound the ring; -1 where the boundary was not traced, and for absent rings.
    width_px : float array of shape (m,)
        At right angles to the boundaries; NaN where a boundary is missing, 0 for absent rings.
    start, end : float arrays of shape (m, 2)
        The line measured, x, y in px: as long as the ring is wide, across it, its middle on the path.
    """

    index: IntArray
    inner: IntArray
    outer: IntArray
    width_px: FloatArray
    start: FloatArray
    end: FloatArray

    def __len__(self) -> int:
        return len(self.index)


def path_rings(found: Crossings, absent: Mapping[int, int] | None = None) -> PathRings:
    """Rings between the crossings of one path, whose indices grow along it.

    Where a person said that rings are absent inside of a boundary, an index that skips as many is no gap: the oldest of
    these rings is what lies between the two boundaries, and those after it have width 0 and no boundaries of their own.

    The width is the part of the way from boundary to boundary that lies along their mean normal: exact for parallel
    boundaries however slantwise the path meets them, and for arcs about one pith.

    Parameters
    ----------
    found : Crossings
        Of one path, in order.
    absent : mapping of int to int, optional
        Index of a boundary to the number of absent rings just inside of it.
    """
    if len(found) < 2:
        empty = np.zeros(0, np.int64)
        return PathRings(empty, empty, empty, np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2)))
    index = np.arange(found.index[0] + 1, found.index[-1] + 1)
    at = np.full(len(index) + 1, -1, np.int64)
    at[found.index - found.index[0]] = np.arange(len(found))
    inner, outer = at[:-1].copy(), at[1:].copy()
    zero = np.zeros(len(index), np.bool_)
    for k in range(1, len(found)):
        skipped = int(found.index[k] - found.index[k - 1]) - 1
        if skipped > 0 and (absent or {}).get(int(found.index[k]), 0) == skipped:
            first = int(found.index[k - 1] - found.index[0])
            outer[first], inner[first + 1 : first + 1 + skipped], outer[first + 1 : first + 1 + skipped] = k, -1, -1
            zero[first + 1 : first + 1 + skipped] = True
    whole = (inner >= 0) & (outer >= 0)
    way = found.point[outer] - found.point[inner]
    turn = np.angle(np.exp(1j * (found.angle[outer] - found.angle[inner])))
    middle = found.angle[inner] + 0.5 * turn
    normal = np.stack([np.cos(middle), np.sin(middle)], axis=1)
    width = np.abs((way * normal).sum(axis=1))
    sideways = normal[:, 0] * way[:, 1] - normal[:, 1] * way[:, 0]
    # Arcs about one centre turn the way the path strays; then the chord falls short by the cosine of half the turn.
    width = np.where(sideways * turn > 0.0, width / np.cos(0.5 * np.clip(turn, -1.0, 1.0)), width)
    centre = 0.5 * (found.point[outer] + found.point[inner])
    half = 0.5 * width[:, None] * normal
    unknown = np.where(whole, 0.0, np.nan)
    return PathRings(
        index,
        inner,
        outer,
        np.where(zero, 0.0, width + unknown),
        centre - half + unknown[:, None],
        centre + half + unknown[:, None],
    )
