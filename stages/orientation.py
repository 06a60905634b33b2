"""Orientation: the local direction of the ring boundaries."""

from __future__ import annotations

import xarray as xr
from pydantic import PositiveFloat

from stages.stage import Params, like_image, place_in_array, scalar, stage
from stages.variables import (
    COHERENCE,
    FACE_PITH_X,
    FACE_PITH_Y,
    ORIENTATION,
    REDUCTION,
    RING_SCALE,
    VALID,
    VALUE,
    VESSEL_SCALE,
)


class OrientationParams(Params):
    """Parameters of `orientation`."""

    gradient_sigma_rings: PositiveFloat = 0.12
    """Gaussian before the gradient, standard deviation in ring widths."""

    window_sigma_rings: PositiveFloat = 0.8
    """Gaussian window of the average, standard deviation in ring widths; wider for dotted, ring-porous boundaries."""


def _sigmas(ds: xr.Dataset, params: OrientationParams) -> tuple[float, float]:
    """Gradient and window standard deviations in array elements."""
    ring = scalar(ds, RING_SCALE) / scalar(ds, REDUCTION)
    return max(0.8, params.gradient_sigma_rings * ring), max(3.0, params.window_sigma_rings * ring)


def _halo(ds: xr.Dataset, params: OrientationParams) -> int:
    from woodfit import structure_tensor

    return structure_tensor.halo(*_sigmas(ds, params), rays=scalar(ds, VESSEL_SCALE) > 0)


@stage(
    requires=(VALUE, VALID, RING_SCALE, REDUCTION, VESSEL_SCALE, FACE_PITH_X, FACE_PITH_Y),
    provides=(ORIENTATION, COHERENCE),
    version=5,
    params=OrientationParams,
    halo=_halo,
)
def orientation(ds: xr.Dataset, params: OrientationParams) -> xr.Dataset:
    """Estimate the ring tangent and its coherence by the structure tensor."""
    from woodfit import structure_tensor

    angle, coherence = structure_tensor.orientation(
        ds[VALUE.name].values,
        ds[VALID.name].values,
        *_sigmas(ds, params),
        place_in_array(ds, FACE_PITH_X, FACE_PITH_Y),
        rays=scalar(ds, VESSEL_SCALE) > 0,
    )
    return like_image(ds, {ORIENTATION: angle, COHERENCE: coherence})
