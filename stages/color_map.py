"""Color map: color and lateness over continuous ring age, and the face rendered with them."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import PositiveInt

from stages.stage import Params, stage
from stages.variables import (
    BRIGHT_OUTWARDS,
    COLOR_STRIP,
    FACE_AGE,
    LATENESS_STRIP,
    PHASE_CONFIDENCE,
    RENDERED,
    RGB,
    RING_RADIUS,
    SAMPLES_PER_RING,
    STRIP_SUPPORT,
    VALID,
)


class ColorMapParams(Params):
    """Parameters of `color_map`."""

    samples_per_ring: PositiveInt = 64
    """Samples of the strip for each ring."""


@stage(
    requires=(RGB, VALID, FACE_AGE, PHASE_CONFIDENCE, BRIGHT_OUTWARDS, RING_RADIUS),
    provides=(COLOR_STRIP, LATENESS_STRIP, STRIP_SUPPORT, SAMPLES_PER_RING, RENDERED),
    version=1,
    params=ColorMapParams,
)
def color_map(ds: xr.Dataset, params: ColorMapParams) -> xr.Dataset:
    """Fit the color of every ring at every fraction of its growth."""
    from woodfit import color_strip

    age = ds[FACE_AGE.name].values
    rgb = ds[RGB.name].values
    weight = np.maximum(ds[PHASE_CONFIDENCE.name].values, 0.05) * ds[VALID.name].values
    strip = color_strip.fit_color_strip(
        age.ravel(),
        rgb.reshape(-1, 3),
        weight.ravel(),
        max(int(age.max()) + 2, ds.sizes["boundary"]),
        params.samples_per_ring,
        bool(ds[BRIGHT_OUTWARDS.name]),
    )
    rendered = color_strip.color_at(strip, age, params.samples_per_ring)
    psnr = color_strip.psnr_blurred(rendered, rgb, ds[VALID.name].values)
    return xr.Dataset(
        {
            COLOR_STRIP.name: COLOR_STRIP.array(strip.rgb),
            LATENESS_STRIP.name: LATENESS_STRIP.array(strip.lateness),
            STRIP_SUPPORT.name: STRIP_SUPPORT.array(strip.support),
            SAMPLES_PER_RING.name: SAMPLES_PER_RING.array(np.int64(params.samples_per_ring)),
            RENDERED.name: RENDERED.array(rendered),
        },
        coords={"strip": strip.age, "y": ds.coords["y"], "x": ds.coords["x"]},
        attrs={
            "figures": {"face given back, PSNR of linear rgb blurred by 1.5 px (dB)": round(psnr, 2)},
        },
    )
