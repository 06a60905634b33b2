"""Pose: where in the tree the board was."""

from __future__ import annotations

from typing import Literal

import numpy as np
import xarray as xr
from pydantic import PositiveFloat

from stages.polylines import polylines_of
from stages.stage import Params, scalar, stage
from stages.variables import (
    BOARD_TO_TREE,
    GRAIN_RATIO,
    POSE_SPREAD,
    RING_AGE_SHIFT,
    RING_GROUP,
    RING_INDEX,
    RING_RADIUS,
    RING_WIDTH,
    RING_X,
    RING_Y,
    VALUE,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)


class PoseParams(Params):
    """Parameters of `pose`."""

    pith_side: Literal["behind", "before"] = "behind"
    """On which side of the photographed face the pith lies at the face's centre; a single photograph cannot tell."""

    narrowest_share: PositiveFloat = 0.25
    """Least width of a ring across the growth layers, as a share of the mean width."""

    pith_x_px: float | None = None
    """x of the pith line's point nearest to the face's centre, scan px; with y and z overrules the fit."""

    pith_y_px: float | None = None
    """y of that point, scan px."""

    pith_z_px: float | None = None
    """z of that point, scan px into the wood."""

    pith_tilt_deg: float | None = None
    """Angle between the pith and the face's normal: 0 on end grain, 90 on a face along the stem."""

    pith_azimuth_deg: float | None = None
    """Direction in the face towards which the pith leans, from +x towards +y."""


@stage(
    requires=(
        VALUE,
        RING_X,
        RING_Y,
        VERTEX_CONFIDENCE,
        VERTEX_COUNT,
        RING_INDEX,
        RING_GROUP,
        GRAIN_RATIO,
    ),
    provides=(BOARD_TO_TREE, RING_RADIUS, RING_AGE_SHIFT, RING_WIDTH, POSE_SPREAD),
    version=1,
    params=PoseParams,
)
def pose(ds: xr.Dataset, params: PoseParams) -> xr.Dataset:
    """Fit the pith line that makes the traced rings round and their widths regular."""
    from woodfit import pith, pith_energy, pose_story
    from woodfit.ring_radii import ring_radii

    lines, belief = polylines_of(ds)
    rings = pith_energy.sample_rings(lines, belief, ds[RING_INDEX.name].values, ds[RING_GROUP.name].values)
    x, y = ds.coords["x"].values, ds.coords["y"].values
    face = pose_story.Face(float(x[0]), float(y[0]), float(x[-1]), float(y[-1]))
    fixed = pith.Fixed(
        (params.pith_x_px, params.pith_y_px, params.pith_z_px), params.pith_tilt_deg, params.pith_azimuth_deg
    )
    fitted = pith.fit_pith(
        rings, face.size_px, params.pith_side == "behind", scalar(ds, GRAIN_RATIO), face.aspect, fixed
    )
    radius, shift, width = ring_radii(rings, fitted, params.narrowest_share)
    story = pose_story.describe(fitted, face, float(width))
    return xr.Dataset(
        {
            BOARD_TO_TREE.name: BOARD_TO_TREE.array(pith.board_to_tree(fitted, face.centre)),
            RING_RADIUS.name: RING_RADIUS.array(radius),
            RING_AGE_SHIFT.name: RING_AGE_SHIFT.array(shift),
            RING_WIDTH.name: RING_WIDTH.array(np.float64(width)),
            POSE_SPREAD.name: POSE_SPREAD.array(fitted.spread),
        },
        coords={"boundary": np.arange(len(radius))},
        attrs={"warnings": story.warnings, "figures": story.figures},
    )
