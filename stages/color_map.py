"""Color map: color and lateness over continuous ring age, and the face rendered with them."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import PositiveInt

from stages.polylines import planes_of
from stages.stage import Params, stage
from stages.variables import (
    ANOMALY,
    BRIGHT_OUTWARDS,
    COLOR_STRIP,
    FACE_AGE,
    FACE_GAIN,
    FACE_PLANE,
    FACE_TOP,
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
    requires=(FACE_PLANE, FACE_TOP, RGB, VALID, ANOMALY, FACE_AGE, PHASE_CONFIDENCE, BRIGHT_OUTWARDS, RING_RADIUS),
    provides=(COLOR_STRIP, LATENESS_STRIP, STRIP_SUPPORT, SAMPLES_PER_RING, FACE_GAIN, RENDERED),
    version=3,
    params=ColorMapParams,
    sees_block=True,
)
def color_map(ds: xr.Dataset, params: ColorMapParams) -> xr.Dataset:
    """Fit the color of every ring at every fraction of its growth, and each face's light."""
    from woodfit import color_strip

    age, rgb, valid = ds[FACE_AGE.name].values, ds[RGB.name].values, ds[VALID.name].values
    weight = np.maximum(ds[PHASE_CONFIDENCE.name].values, 0.05) * valid * (ds[ANOMALY.name].values == 0)
    rows = planes_of(ds).face_of(ds.coords["y"].values)
    face = np.broadcast_to(rows[:, None], age.shape)
    strip, gain = color_strip.fit_balanced(
        age.ravel(),
        rgb.reshape(-1, 3),
        weight.ravel(),
        face.ravel(),
        ds.sizes["face"],
        max(int(age[valid].max(initial=0.0)) + 2, ds.sizes["boundary"]),
        params.samples_per_ring,
        bool(ds[BRIGHT_OUTWARDS.name]),
    )
    rendered = color_strip.color_at(strip, age, params.samples_per_ring) * gain[face]
    psnr = color_strip.psnr_blurred(rendered, rgb, valid)
    return xr.Dataset(
        {
            COLOR_STRIP.name: COLOR_STRIP.array(strip.rgb),
            LATENESS_STRIP.name: LATENESS_STRIP.array(strip.lateness),
            STRIP_SUPPORT.name: STRIP_SUPPORT.array(strip.support),
            SAMPLES_PER_RING.name: SAMPLES_PER_RING.array(np.int64(params.samples_per_ring)),
            FACE_GAIN.name: FACE_GAIN.array(gain),
            RENDERED.name: RENDERED.array(rendered),
        },
        coords={"strip": strip.age, "y": ds.coords["y"], "x": ds.coords["x"]},
        attrs={
            "figures": {"face given back, PSNR of linear rgb blurred by 1.5 px (dB)": round(psnr, 2)},
        },
    )
