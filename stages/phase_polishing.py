"""Phase polishing: the displacement that makes the model's phase the observed one."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from stages.polylines import believed_weights, face_frame, vertex_ages
from stages.stage import Params, stage
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
    RING_X,
    RING_Y,
    STEM,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)

Array = npt.NDArray[Any]


class PhasePolishingParams(Params):
    """Parameters of `phase_polishing`."""

    stiffness_px: tuple[PositiveFloat, ...] = Field(default=(12.0, 3.0, 0.8, 0.3, 0.1, 0.05), min_length=1)
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
    version=9,
    params=PhasePolishingParams,
    sees_block=True,
)
def phase_polishing(ds: xr.Dataset, params: PhasePolishingParams) -> xr.Dataset:
    """Minimise the cyclic phase difference between the face and the model over the displacement."""
    from woodfit import count_trial, cylinder_grid, ring_count
    from woodfit.anomalies import SOUND, STAIN
    from woodfit.face import stride_for
    from woodfit.rings import wrap

    start, frame = ds[DISPLACEMENT.name], face_frame(ds)
    radius, azimuth, height = (start.coords[name].values for name in ("radius", "azimuth", "height"))
    grid = cylinder_grid.CylinderGrid(radius, azimuth, height, bool(ds[AZIMUTH_WRAPS.name]))
    x, y, table = ds.coords["x"].values, ds.coords["y"].values, ds[RING_RADIUS.name].values
    belief = ds[PHASE_CONFIDENCE.name].values * np.isin(ds[ANOMALY.name].values, (SOUND, STAIN))
    start_age, phase = frame.age(x, y, grid, start.values, table), ds[RING_PHASE.name].values
    face = frame.planes.face_of(y)
    phase = phase * ring_count.outward_signs(phase, start_age, belief**2, face)[:, None]
    every = stride_for(phase.size, params.most_pixels)
    thinned = (slice(None, None, every),) * 2
    seen = belief[thinned] > count_trial.LEAST_BELIEF
    seen_x, seen_y = (axis[seen] for axis in np.meshgrid(x[::every], y[::every]))
    found = count_trial.polish_by_best_count(
        grid,
        start.values,
        phase[thinned],
        belief[thinned],
        start_age[thinned],
        face[::every],
        frame.observe(seen_x, seen_y, phase[thinned][seen], belief[thinned][seen] ** 3 * every**2),
        frame.observe(ds[RING_X.name].values, ds[RING_Y.name].values, vertex_ages(ds), believed_weights(ds)),
        table,
        params.stiffness_px,
        params.along_stem,
        params.boundary_share,
    )
    age = frame.age(x, y, grid, found.displacement, table)
    residual = wrap(phase - 2.0 * np.pi * age).astype(np.float32)
    figures = {"loss": round(float(found.loss[-1]), 4)}
    sure = np.abs(residual[belief > count_trial.SURE])
    if sure.size:
        worst = count_trial.worst_residual(residual, belief)
        figures["median residual at confident pixels (rad)"] = round(float(np.median(sure)), 3)
        figures["95 % residual at confident pixels (rad)"] = round(worst, 3)
    return xr.Dataset(
        {
            POLISHED_DISPLACEMENT.name: POLISHED_DISPLACEMENT.array(found.displacement),
            FACE_AGE.name: FACE_AGE.array(age),
            PHASE_RESIDUAL.name: PHASE_RESIDUAL.array(residual),
            LOSS.name: LOSS.array(found.loss),
        },
        coords={name: ds.coords[name] for name in ("y", "x", "radius", "azimuth", "height")},
        attrs={"figures": figures},
    )
