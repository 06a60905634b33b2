"""Reading and writing the contiguous ragged polylines that flow between stages."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from stages.variables import RING_X, RING_Y, VERTEX_CONFIDENCE, VERTEX_COUNT


def polylines_of(ds: xr.Dataset) -> tuple[list[npt.NDArray[Any]], list[npt.NDArray[Any]]]:
    """Boundaries (x, y in scan px, shape (K, 2)) and the confidence of their vertices (shape (K,))."""
    ends = np.cumsum(ds[VERTEX_COUNT.name].values)[:-1]
    points = np.column_stack([ds[RING_X.name].values, ds[RING_Y.name].values])
    belief = ds[VERTEX_CONFIDENCE.name].values
    if len(ds[VERTEX_COUNT.name]) == 0:
        return [], []
    return list(np.split(points, ends)), list(np.split(belief, ends))


def vertex_ages(ds: xr.Dataset, index: str, group: str, shift: str) -> npt.NDArray[np.float64]:
    """Ring age of every vertex: its boundary's index plus its group's shift."""
    ages = ds[index].values + ds[shift].values[ds[group].values]
    return np.repeat(ages, ds[VERTEX_COUNT.name].values).astype(np.float64)
