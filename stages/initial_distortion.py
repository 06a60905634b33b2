"""Initial distortion: how far growth strayed from round rings, from the traced boundaries."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import PositiveFloat, PositiveInt

from stages.polylines import vertex_ages
from stages.stage import Params, scalar, stage
from stages.variables import (
    AZIMUTH_WRAPS,
    BOARD_TO_TREE,
    DISPLACEMENT,
    RING_AGE_SHIFT,
    RING_GROUP,
    RING_INDEX,
    RING_RADIUS,
    RING_SCALE,
    RING_X,
    RING_Y,
    VALUE,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)


class InitialDistortionParams(Params):
    """Parameters of `initial_distortion`."""

    spacing_rings: PositiveFloat = 0.5
    """Spacing of the displacement grid in characteristic ring widths (never under six px)."""

    most_nodes: PositiveInt = 120_000
    """Bound on the number of grid nodes; the spacing widens to keep it."""

    stiffness_rings: PositiveFloat = 1.0
    """Length over which the displacement is smoothed, in characteristic ring widths."""

    along_stem: PositiveFloat = 2.0
    """How much stiffer the displacement is along the stem than across it."""


@stage(
    requires=(
        VALUE,
        RING_X,
        RING_Y,
        VERTEX_CONFIDENCE,
        VERTEX_COUNT,
        RING_INDEX,
        RING_GROUP,
        RING_AGE_SHIFT,
        RING_RADIUS,
        BOARD_TO_TREE,
        RING_SCALE,
    ),
    provides=(DISPLACEMENT, AZIMUTH_WRAPS),
    version=1,
    params=InitialDistortionParams,
)
def initial_distortion(ds: xr.Dataset, params: InitialDistortionParams) -> xr.Dataset:
    """Carry the difference between traced and ideal rings from the face into the tree's coordinates."""
    from woodfit import displacement, face

    ring = scalar(ds, RING_SCALE)
    matrix = ds[BOARD_TO_TREE.name].values
    grid = face.grid_of_face(
        ds.coords["x"].values,
        ds.coords["y"].values,
        matrix,
        max(6.0, params.spacing_rings * ring),
        params.most_nodes,
    )
    vertices = face.observe(
        ds[RING_X.name].values,
        ds[RING_Y.name].values,
        matrix,
        vertex_ages(ds, RING_INDEX.name, RING_GROUP.name, RING_AGE_SHIFT.name),
        np.maximum(ds[VERTEX_CONFIDENCE.name].values, 0.02),
    )
    field = displacement.initial_displacement(
        grid, vertices, ds[RING_RADIUS.name].values, params.stiffness_rings * ring, params.along_stem
    )
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
