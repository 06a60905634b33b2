"""Initial distortion: how far growth strayed from round rings, from the traced boundaries."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import PositiveFloat, PositiveInt

from stages.polylines import believed_weights, face_frame, vertex_ages
from stages.stage import Params, scalar, stage
from stages.variables import (
    ANOMALY,
    AZIMUTH_WRAPS,
    BOARD_TO_TREE,
    DISPLACEMENT,
    FACE_PLANE,
    FACE_TOP,
    INNERMOST_AGE,
    RING_AGE_SHIFT,
    RING_AGE_SIGN,
    RING_GROUP,
    RING_INDEX,
    RING_RADIUS,
    RING_WIDTH,
    RING_X,
    RING_Y,
    STEM,
    VALID,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)


class InitialDistortionParams(Params):
    """Parameters of `initial_distortion`."""

    spacing_rings: PositiveFloat = 0.35
    """Spacing of the displacement grid along the radius in mean ring widths (never under three px)."""

    widest_px: PositiveFloat = 8.0
    """Greatest spacing along the radius: wide rings are bent on smaller scales than their width."""

    wider: PositiveFloat = 2.0
    """Spacing along the arc and along the stem, over that along the radius."""

    most_nodes: PositiveInt = 120_000
    """Bound on the number of grid nodes; the spacing widens to keep it."""

    stiffness_rings: PositiveFloat = 1.0
    """Length over which the displacement is smoothed, in mean ring widths."""

    along_stem: PositiveFloat = 2.0
    """How much stiffer the displacement is along the stem than across it."""


@stage(
    requires=(
        FACE_PLANE,
        FACE_TOP,
        VALID,
        ANOMALY,
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
        RING_WIDTH,
    ),
    provides=(DISPLACEMENT, AZIMUTH_WRAPS),
    version=6,
    params=InitialDistortionParams,
    sees_block=True,
)
def initial_distortion(ds: xr.Dataset, params: InitialDistortionParams) -> xr.Dataset:
    """Carry the difference between traced and ideal rings from the face into the tree's coordinates."""
    from woodfit import cylinder_grid, displacement

    ring, frame = scalar(ds, RING_WIDTH), face_frame(ds)
    x, y, valid = ds.coords["x"].values, ds.coords["y"].values, ds[VALID.name].values
    # The one face of a scan is covered whole, background and hidden parts too; an atlas only where there is wood.
    shown = valid if ds.sizes["face"] > 1 else np.ones_like(valid)
    spacing = max(3.0, min(params.spacing_rings * ring, params.widest_px))
    grid = frame.grid(x, y, shown, spacing, params.most_nodes, params.wider)
    vertices = frame.observe(
        ds[RING_X.name].values,
        ds[RING_Y.name].values,
        vertex_ages(ds),
        believed_weights(ds),
    )
    field = displacement.initial_displacement(
        grid, vertices, ds[RING_RADIUS.name].values, params.stiffness_rings * ring, params.along_stem
    )
    grid, field = cylinder_grid.towards_pith(grid, field)
    return xr.Dataset(
        {
            DISPLACEMENT.name: DISPLACEMENT.array(field),
            AZIMUTH_WRAPS.name: AZIMUTH_WRAPS.array(np.bool_(grid.wraps)),
        },
        coords={"radius": grid.radius, "azimuth": grid.azimuth, "height": grid.height},
        attrs={
            "figures": {
                "grid nodes": " x ".join(str(n) for n in grid.shape),
                "median displacement (px)": round(float(np.median(np.abs(field))), 2),
            },
        },
    )
