"""Reading what several stages share: ragged polylines, and where the faces lie in the tree."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from stages.stage import scalar
from stages.variables import (
    ANOMALY,
    BOARD_TO_TREE,
    FACE_PLANE,
    FACE_TOP,
    INNERMOST_AGE,
    RING_AGE_SHIFT,
    RING_AGE_SIGN,
    RING_GROUP,
    RING_INDEX,
    RING_X,
    RING_Y,
    STEM,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)

if TYPE_CHECKING:
    from woodfit.face import FaceFrame
    from woodfit.planes import Planes


def polylines_of(ds: xr.Dataset) -> tuple[list[npt.NDArray[Any]], list[npt.NDArray[Any]]]:
    """Boundaries (x, y in scan px, shape (K, 2)) and the confidence of their vertices (shape (K,))."""
    ends = np.cumsum(ds[VERTEX_COUNT.name].values)[:-1]
    points = np.column_stack([ds[RING_X.name].values, ds[RING_Y.name].values])
    belief = ds[VERTEX_CONFIDENCE.name].values
    if len(ds[VERTEX_COUNT.name]) == 0:
        return [], []
    return list(np.split(points, ends)), list(np.split(belief, ends))


def vertex_ages(ds: xr.Dataset) -> npt.NDArray[np.float64]:
    """Ring age of every vertex, from its boundary's index and its group's sign and shift."""
    group = ds[RING_GROUP.name].values
    ages = ds[RING_AGE_SIGN.name].values[group] * ds[RING_INDEX.name].values + ds[RING_AGE_SHIFT.name].values[group]
    return np.repeat(ages, ds[VERTEX_COUNT.name].values).astype(np.float64)


def planes_of(ds: xr.Dataset) -> Planes:
    """Where the faces of a dataset lie in the board frame."""
    from woodfit.planes import Planes

    return Planes(ds[FACE_PLANE.name].values.astype(np.float64), ds[FACE_TOP.name].values.astype(np.float64))


def face_frame(ds: xr.Dataset) -> FaceFrame:
    """How places on the photographs become tree coordinates, once there is a pose."""
    from woodfit.face import FaceFrame

    return FaceFrame(planes_of(ds), ds[BOARD_TO_TREE.name].values, ds[STEM.name].values)


def believed_weights(ds: xr.Dataset) -> npt.NDArray[np.float64]:
    """As `vertex_weights`, and 0 on lines that the pose does not take for ring boundaries."""
    return np.asarray(vertex_weights(ds) * (vertex_ages(ds) >= scalar(ds, INNERMOST_AGE)), np.float64)


def vertex_weights(ds: xr.Dataset) -> npt.NDArray[np.float64]:
    """Confidence of every vertex; 0 within knots and cracks (a stain leaves the rings as they are)."""
    from woodfit.anomalies import sound_at

    x, y = ds.coords["x"].values, ds.coords["y"].values
    sound = sound_at(ds[ANOMALY.name].values, x, y, ds[RING_X.name].values, ds[RING_Y.name].values, True)
    return np.asarray(np.maximum(ds[VERTEX_CONFIDENCE.name].values, 0.02) * sound, np.float64)
