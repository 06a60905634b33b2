"""How many rings apart two neighbouring traced boundaries are: by the wave between them, and by the edges seen there.

The wave alone is wrong in two ways. In a ring much wider than the others it counts its overtone; and a narrow ring
beside wide ones, missed by the tracing, it does not count at all. The grey values between two boundaries show either.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.boundary import edges_between

#: Cycles that say that a boundary was missed: a ring may be half as wide again as its neighbours.
_TWO_RINGS = 1.65

#: Least strength of an edge that may be a boundary that was missed, as a share of the boundaries beside it.
_FAINT = 0.15

#: Strength of an edge that is one although the wave does not count it, where this share of the walks from one boundary
#: to the other pass it. Of the neighbours on four labelled cores none has such an edge, of the pairs with a boundary
#: left out between them all have. On rough discs and on boards along the stem many neighbours have: saw marks, fibre.
_CLEAR, _MOST_WALKS, _LEAST_WALKS = 0.5, 0.8, 4

#: Where more of the walks than this pass a clear edge, edges say nothing.
_FEW = 0.1


def rings_apart(
    cycles: npt.NDArray[np.float64],
    ways: npt.NDArray[np.float64],
    boundaries: npt.NDArray[np.int64],
    strength: npt.NDArray[Any] | None,
) -> npt.NDArray[np.int64]:
    """Rings from one boundary to the next, 1 for neighbours, of each of K walks between boundaries.

    Parameters
    ----------
    cycles : array of shape (K,)
        Cycles of the wave that the walk passed.
    ways : array of shape (K, 4)
        x, y of its start and of its end, px.
    boundaries : int array of shape (K, 2)
        The two boundaries.
    strength : array of shape (M, N), optional
        From `woodfit.boundary.edge_strength`; without it the wave decides.

    Returns
    -------
    int array of shape (K,)
    """
    apart = 1 + np.floor(np.maximum(cycles - _TWO_RINGS + 1.0, 0.0)).astype(np.int64)
    if strength is None or not len(cycles):
        return apart
    near = apart == 1
    apart[~near] = np.minimum(apart[~near], 1 + edges_between(strength, ways[~near], _FAINT))
    seen = np.zeros(len(cycles), bool)
    seen[near] = edges_between(strength, ways[near], _CLEAR) > 0
    if seen.sum() < _FEW * near.sum():
        _, pair = np.unique(boundaries, axis=0, return_inverse=True)
        pair = pair.ravel()
        walks, clear = (np.bincount(pair, weights=of) for of in (near, seen))
        missed = (walks >= _LEAST_WALKS) & (clear > _MOST_WALKS * walks)
        apart[near & missed[pair]] = 2
    return apart
