"""Curved Gabor: phase, frequency and refined orientation of the rings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from stages.stage import Params, like_image, scalar, stage
from stages.variables import (
    ASYMMETRY,
    CURVATURE,
    EXPLAINED,
    FREQUENCY,
    MAGNITUDE,
    NORMAL,
    ORIENTATION,
    PHASE,
    REDUCTION,
    RESPONSE,
    RING_ORIENTATION,
    RING_SCALE,
    STRAIGHT_RUN,
    VALID,
    VALUE,
    VESSEL_SCALE,
)

if TYPE_CHECKING:
    from woodfit.curved_gabor import Region


class CurvedGaborParams(Params):
    """Parameters of `curved_gabor`."""

    p: PositiveInt = 80
    """Half size of the curved region across the rings, analysed px."""

    q: PositiveInt | None = None
    """Half size of the curved region along the rings, analysed px; by default three standard deviations."""

    sigma_along: PositiveFloat | None = None
    """Standard deviation of the window along the rings, analysed px; by default as far as the scan's
    rings are nearly straight, 10 to 27 px."""

    cycles: PositiveFloat | None = None
    """Standard deviation of the window across the rings, wavelengths; by default 0.5, or 0.4 where the rings are
    sought in the density of vessels, which is a narrow peak in each."""

    spread_octaves: PositiveFloat | None = None
    """How far the rings' widths are expected to lie from the characteristic one, standard deviation in octaves; by
    default 2, or 1.2 where the rings are sought in the density of vessels, which is noisy."""

    narrowest_rings: float = Field(default=0.125, gt=0.0, le=1.0)
    """Narrowest ring looked for, in characteristic ring widths (never under three analysed px)."""

    widest_rings: float = Field(default=4.0, ge=1.0)
    """Widest ring looked for, in characteristic ring widths (never over two regions)."""


def _region(ds: xr.Dataset, params: CurvedGaborParams) -> Region:
    from woodfit.curved_gabor import Region

    run = scalar(ds, STRAIGHT_RUN) / scalar(ds, REDUCTION)
    sigma = params.sigma_along or float(np.clip(run, 10.0, 27.0))
    vessels = scalar(ds, VESSEL_SCALE) > 0
    cycles = params.cycles or (0.4 if vessels else 0.5)
    spread = params.spread_octaves or (1.2 if vessels else 2.0)
    return Region(params.p, params.q or int(np.ceil(3.0 * sigma)), sigma, cycles, spread)


def _halo(ds: xr.Dataset, params: CurvedGaborParams) -> int:
    from woodfit import curved_gabor as gabor

    return gabor.halo(scalar(ds, RING_SCALE) / scalar(ds, REDUCTION), _region(ds, params))


@stage(
    requires=(VALUE, VALID, ORIENTATION, RING_SCALE, REDUCTION, STRAIGHT_RUN, VESSEL_SCALE),
    provides=(
        RESPONSE,
        MAGNITUDE,
        PHASE,
        EXPLAINED,
        NORMAL,
        ASYMMETRY,
        FREQUENCY,
        CURVATURE,
        RING_ORIENTATION,
    ),
    version=5,
    params=CurvedGaborParams,
    halo=_halo,
)
def curved_gabor(ds: xr.Dataset, params: CurvedGaborParams) -> xr.Dataset:
    """Filter along and across the rings for their phase, frequency, curvature and orientation."""
    from woodfit import curved_gabor as gabor

    step = scalar(ds, REDUCTION)
    ring = scalar(ds, RING_SCALE) / step
    field = gabor.curved_gabor(
        ds[VALUE.name].values,
        ds[VALID.name].values,
        ds[ORIENTATION.name].values,
        ring,
        _region(ds, params),
        max(3.0, params.narrowest_rings * ring),
        min(2.0 * params.p, params.widest_rings * ring),
    )
    return like_image(
        ds,
        {
            RESPONSE: field.response,
            MAGNITUDE: np.abs(field.response),
            PHASE: np.angle(field.response),
            EXPLAINED: field.explained,
            NORMAL: field.normal,
            ASYMMETRY: field.asymmetry,
            FREQUENCY: field.frequency / np.float32(step),
            CURVATURE: field.curvature / np.float32(step),
            RING_ORIENTATION: field.orientation,
        },
    )
