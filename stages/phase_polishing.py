"""Phase polishing: the displacement that makes the model's phase the observed one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from stages.polylines import believed_weights, face_frame, phase_signs, vertex_ages
from stages.stage import Params, scalar, stage
from stages.variables import (
    ANOMALY,
    AZIMUTH_WRAPS,
    BOARD_TO_TREE,
    DISPLACEMENT,
    FACE_AGE,
    FACE_PLANE,
    FACE_TOP,
    INNERMOST_AGE,
    LOSS,
    PHASE_CONFIDENCE,
    PHASE_RESIDUAL,
    POLISHED_DISPLACEMENT,
    RING_AGE_SHIFT,
    RING_AGE_SIGN,
    RING_GROUP,
    RING_INDEX,
    RING_PHASE,
    RING_RADIUS,
    RING_SCALE,
    RING_X,
    RING_Y,
    STEM,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)

if TYPE_CHECKING:
    from woodfit.face import FaceFrame
    from woodfit.phase_slopes import Slopes

Array = npt.NDArray[Any]

#: Pixels are confident from here on; a 95 % residual above the second says that the count of rings is torn, rad.
SURE, TORN_RAD = 0.5, 0.5

#: Part of a ring over which a slope of the phase is taken.
SLOPE_RINGS = 0.2


class PhasePolishingParams(Params):
    """Parameters of `phase_polishing`."""

    stiffness_px: tuple[PositiveFloat, ...] = Field(default=(48.0, 12.0, 3.0, 0.8, 0.3), min_length=1)
    """Smoothing length of each Gauss-Newton step, coarse to fine, px."""

    along_stem: PositiveFloat = 2.0
    """How much stiffer the displacement is along the stem than across it."""

    boundary_share: PositiveFloat = 0.1
    """Weight of all boundary vertices together, relative to all pixels together."""

    most_pixels: PositiveInt = 150_000
    """Face pixels that the phase is compared at; a regular subset of larger faces."""


@stage(
    requires=(
        FACE_PLANE,
        FACE_TOP,
        ANOMALY,
        RING_PHASE,
        RING_SCALE,
        PHASE_CONFIDENCE,
        RING_X,
        RING_Y,
        VERTEX_CONFIDENCE,
        VERTEX_COUNT,
        RING_INDEX,
        RING_GROUP,
        RING_AGE_SHIFT,
        RING_AGE_SIGN,
        RING_RADIUS,
        INNERMOST_AGE,
        BOARD_TO_TREE,
        STEM,
        DISPLACEMENT,
        AZIMUTH_WRAPS,
    ),
    provides=(POLISHED_DISPLACEMENT, FACE_AGE, PHASE_RESIDUAL, LOSS),
    version=4,
    params=PhasePolishingParams,
    sees_block=True,
)
def phase_polishing(ds: xr.Dataset, params: PhasePolishingParams) -> xr.Dataset:
    """Minimise the cyclic phase difference between the face and the model over the displacement."""
    from woodfit import cylinder_grid, displacement, phase_slopes
    from woodfit.anomalies import SOUND, STAIN
    from woodfit.face import stride_for
    from woodfit.rings import wrap

    start, frame = ds[DISPLACEMENT.name], face_frame(ds)
    radius, azimuth, height = (start.coords[name].values for name in ("radius", "azimuth", "height"))
    grid = cylinder_grid.CylinderGrid(radius, azimuth, height, bool(ds[AZIMUTH_WRAPS.name]))
    x, y, table = ds.coords["x"].values, ds.coords["y"].values, ds[RING_RADIUS.name].values
    phase = ds[RING_PHASE.name].values * phase_signs(ds)[:, None].astype(np.float32)
    belief = ds[PHASE_CONFIDENCE.name].values * np.isin(ds[ANOMALY.name].values, (SOUND, STAIN))
    every = stride_for(phase.size, params.most_pixels)
    grid_x, grid_y = np.meshgrid(x[::every], y[::every])
    seen = belief[::every, ::every] > 0.0
    pixels = frame.observe(
        grid_x[seen],
        grid_y[seen],
        phase[::every, ::every][seen],
        belief[::every, ::every][seen] ** 2 * every**2,
    )
    vertices = frame.observe(
        ds[RING_X.name].values,
        ds[RING_Y.name].values,
        vertex_ages(ds),
        believed_weights(ds),
    )
    rest = (pixels, vertices, table, params.stiffness_px, params.along_stem, params.boundary_share)
    polished = displacement.polish(grid, start.values, *rest)
    age = frame.age(x, y, grid, polished.displacement, table)
    residual = wrap(phase - 2.0 * np.pi * age).astype(np.float32)
    # The faces of a block hold one another's count, which slopes along each of them would let drift.
    if ds.sizes["face"] == 1 and _worst(residual, belief) > TORN_RAD:
        scale, most = scalar(ds, RING_SCALE), params.most_pixels // 4
        slopes = [_slopes(frame, x, y, phase, belief, scale, most, axis) for axis in (0, 1)]
        followed = phase_slopes.follow_slopes(grid, start.values, slopes, vertices, table, params.along_stem)
        again = displacement.polish(grid, followed, *rest)
        # Where the phase itself misses rings that were traced, following it makes things worse.
        if again.loss[-1] < polished.loss[-1]:
            polished = again
            age = frame.age(x, y, grid, polished.displacement, table)
            residual = wrap(phase - 2.0 * np.pi * age).astype(np.float32)
    figures = {"loss": round(float(polished.loss[-1]), 4)}
    sure = np.abs(residual[belief > SURE])
    if sure.size:
        figures["median residual at confident pixels (rad)"] = round(float(np.median(sure)), 3)
        figures["95 % residual at confident pixels (rad)"] = round(_worst(residual, belief), 3)
    return xr.Dataset(
        {
            POLISHED_DISPLACEMENT.name: POLISHED_DISPLACEMENT.array(polished.displacement),
            FACE_AGE.name: FACE_AGE.array(age),
            PHASE_RESIDUAL.name: PHASE_RESIDUAL.array(residual),
            LOSS.name: LOSS.array(polished.loss),
        },
        coords={name: ds.coords[name] for name in ("y", "x", "radius", "azimuth", "height")},
        attrs={"figures": figures},
    )


def _worst(residual: Array, belief: Array) -> float:
    """Residual that 95 % of the confident pixels keep to, rad; 0 without any."""
    sure = np.abs(residual[belief > SURE])
    return float(np.percentile(sure, 95)) if sure.size else 0.0


def _slopes(
    frame: FaceFrame,
    x: Array,
    y: Array,
    phase: Array,
    belief: Array,
    ring_px: float,
    most: int,
    axis: int,
) -> Slopes:
    """Phase differences over a part of a ring along one image axis, wherever both ends are believed."""
    from woodfit.face import stride_for
    from woodfit.phase_slopes import Slopes
    from woodfit.rings import wrap

    step = max(1, round(SLOPE_RINGS * ring_px / abs(float(x[1] - x[0])))) if len(x) > 1 else 1
    every = stride_for(phase.size, most)
    rows, columns = np.meshgrid(np.arange(0, len(y), every), np.arange(0, len(x), every), indexing="ij")
    far_rows, far_columns = (rows + step, columns) if axis == 0 else (rows, columns + step)
    inside = (far_rows < len(y)) & (far_columns < len(x))
    near, far = (rows[inside], columns[inside]), (far_rows[inside], far_columns[inside])
    sure = np.minimum(belief[near], belief[far])
    seen = sure > 0.0
    near, far = ((where[0][seen], where[1][seen]) for where in (near, far))
    turn = wrap(phase[far] - phase[near]) / (2.0 * np.pi)
    # A slope is the pair's difference over the part of a ring between: weighed by the face that the pair stands for.
    weight = sure[seen] ** 2 * (0.5 * every / SLOPE_RINGS) ** 2
    ahead, behind = (frame.observe(x[where[1]], y[where[0]], turn, weight) for where in (far, near))
    return Slopes(ahead, behind, turn)
