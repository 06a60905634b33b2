"""Anomalies: the knots, cracks and stains that no fit may take for rings or for sound color."""

from __future__ import annotations

from typing import Literal

import numpy as np
import xarray as xr
from pydantic import PositiveFloat

from stages.stage import Params, place_in_array, scalar, stage
from stages.variables import (
    ANOMALY,
    ANOMALY_AREA,
    ANOMALY_BOX,
    ANOMALY_KIND,
    CURVATURE,
    FACE_PITH_X,
    FACE_PITH_Y,
    PIXEL_SIZE,
    REDUCTION,
    RGB,
    RING_ORIENTATION,
    RING_SCALE,
    VALID,
    VESSEL_SCALE,
)


class AnomaliesParams(Params):
    """Parameters of `anomalies`."""

    knots: Literal["ignore", "mask"] = "mask"
    """Whether knots, cracks and stains are found and left out of every fit; with `ignore` all wood counts as sound."""

    smallest_knot_rings: PositiveFloat = 0.35
    """Least thickness of a knot, in characteristic ring widths."""

    shortest_crack_rings: PositiveFloat = 2.0
    """Least length of a crack, in characteristic ring widths."""

    smallest_stain_rings: PositiveFloat = 2.0
    """Least width of a stain, in characteristic ring widths."""


@stage(
    requires=(
        RGB,
        VALID,
        RING_ORIENTATION,
        CURVATURE,
        RING_SCALE,
        REDUCTION,
        PIXEL_SIZE,
        VESSEL_SCALE,
        FACE_PITH_X,
        FACE_PITH_Y,
    ),
    provides=(ANOMALY, ANOMALY_KIND, ANOMALY_BOX, ANOMALY_AREA),
    version=1,
    params=AnomaliesParams,
)
def anomalies(ds: xr.Dataset, params: AnomaliesParams) -> xr.Dataset:
    """Find knots, cracks and stains by their darkness, direction and color."""
    from woodfit import anomalies as search

    step = scalar(ds, REDUCTION)
    valid = ds[VALID.name].values
    if params.knots == "ignore":
        found = search.listed(np.zeros(valid.shape, np.uint8))
    else:
        face = search.Face(
            ds[RGB.name].values,
            valid,
            ds[RING_ORIENTATION.name].values,
            ds[CURVATURE.name].values * step,
            scalar(ds, RING_SCALE) / step,
            place_in_array(ds, FACE_PITH_X, FACE_PITH_Y),
            scalar(ds, VESSEL_SCALE) > 0,
        )
        found = search.find_anomalies(
            face, params.smallest_knot_rings, params.shortest_crack_rings, params.smallest_stain_rings
        )
    coords = {name: ds.coords[name] for name in ("y", "x") if name in ds.coords}
    left, top = (float(ds.coords[name][0]) if name in ds.coords else 0.0 for name in ("x", "y"))
    size = scalar(ds, PIXEL_SIZE)
    story = (
        search.describe(found, (step * size) ** 2, "mm") if np.isfinite(size) else search.describe(found, step**2, "px")
    )
    return xr.Dataset(
        {
            ANOMALY.name: ANOMALY.array(found.mask),
            ANOMALY_KIND.name: ANOMALY_KIND.array(found.kind),
            ANOMALY_BOX.name: ANOMALY_BOX.array(found.box * step + np.array([left, top, left, top])),
            ANOMALY_AREA.name: ANOMALY_AREA.array(found.area * step**2),
        },
        coords=coords,
        attrs={"warnings": story[0], "figures": {"knots": "ignored"} if params.knots == "ignore" else story[1]},
    )
