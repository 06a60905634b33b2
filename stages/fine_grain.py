"""Fine grain: what the face shows beside its rings, as noise that runs along the fibre anywhere in the tree."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import NonNegativeInt, PositiveInt

from stages.polylines import planes_of
from stages.products import solid_texture_of
from stages.stage import Params, scalar, stage
from stages.variables import (
    ANOMALY,
    AZIMUTH_WRAPS,
    BOARD_TO_TREE,
    CLOSE_UP,
    CLOSE_UP_OPAQUE,
    CLOSE_UP_X,
    CLOSE_UP_Y,
    COLOR_STRIP,
    FACE_PLANE,
    FACE_TOP,
    FINE_GRAIN_AMPLITUDE,
    FINE_GRAIN_CELLS,
    FINE_GRAIN_COLOR,
    FINE_GRAIN_DENSITY,
    FINE_GRAIN_KIND,
    FINE_GRAIN_LOG_MEAN,
    FINE_GRAIN_SEED,
    LATENESS_STRIP,
    PIXEL_SIZE,
    POLISHED_DISPLACEMENT,
    REDUCTION,
    RING_RADIUS,
    RING_WIDTH,
    SAMPLES_PER_RING,
    STEM,
    VALID,
)


class FineGrainParams(Params):
    """Parameters of `fine_grain`."""

    enabled: bool = True
    """Whether the texture gets fine grain at all; without, its color is that of the rings alone."""

    seed: NonNegativeInt = 0
    """Another seed, another piece of the same wood."""

    most_lines: PositiveInt = 350
    """About how many lines of each direction the photograph's spectra are read on."""


@stage(
    requires=(
        FACE_PLANE,
        FACE_TOP,
        CLOSE_UP,
        CLOSE_UP_OPAQUE,
        CLOSE_UP_X,
        CLOSE_UP_Y,
        VALID,
        ANOMALY,
        REDUCTION,
        PIXEL_SIZE,
        BOARD_TO_TREE,
        STEM,
        RING_RADIUS,
        RING_WIDTH,
        POLISHED_DISPLACEMENT,
        AZIMUTH_WRAPS,
        COLOR_STRIP,
        LATENESS_STRIP,
        SAMPLES_PER_RING,
    ),
    provides=(
        FINE_GRAIN_KIND,
        FINE_GRAIN_CELLS,
        FINE_GRAIN_DENSITY,
        FINE_GRAIN_AMPLITUDE,
        FINE_GRAIN_COLOR,
        FINE_GRAIN_LOG_MEAN,
        FINE_GRAIN_SEED,
    ),
    version=2,
    params=FineGrainParams,
    sees_block=True,
)
def fine_grain(ds: xr.Dataset, params: FineGrainParams) -> xr.Dataset:
    """Fit lattice noises to the power that the color map lacks, along and across the grain."""
    from woodfit import fine_grain_fit, fine_grain_lines
    from woodfit.fine_grain import FineGrain
    from woodfit.photograph import srgb_decode

    grain, figures, warnings = FineGrain.none(), {}, []
    if params.enabled:
        sound = ds[VALID.name].values & (ds[ANOMALY.name].values == 0)
        lines = fine_grain_lines.read_lines(
            solid_texture_of(ds),
            srgb_decode(ds[CLOSE_UP.name].values),
            fine_grain_lines.known_in_windows(
                ds[CLOSE_UP_OPAQUE.name].values,
                ds[CLOSE_UP_X.name].values,
                ds[CLOSE_UP_Y.name].values,
                sound,
                int(scalar(ds, REDUCTION)),
            ),
            ds[CLOSE_UP_X.name].values,
            ds[CLOSE_UP_Y.name].values,
            planes_of(ds),
            params.most_lines,
        )
        grain = fine_grain_fit.fit_fine_grain(lines, scalar(ds, RING_WIDTH), params.seed)
        figures = fine_grain_fit.worst_differences(grain, lines)
        if not lines:
            warnings = ["No fine grain: the wood is too small for lines of 32 px along and across it."]
    return xr.Dataset(
        {
            FINE_GRAIN_KIND.name: FINE_GRAIN_KIND.array(grain.kind),
            FINE_GRAIN_CELLS.name: FINE_GRAIN_CELLS.array(grain.cells),
            FINE_GRAIN_DENSITY.name: FINE_GRAIN_DENSITY.array(grain.density),
            FINE_GRAIN_AMPLITUDE.name: FINE_GRAIN_AMPLITUDE.array(grain.amplitude),
            FINE_GRAIN_COLOR.name: FINE_GRAIN_COLOR.array(grain.color),
            FINE_GRAIN_LOG_MEAN.name: FINE_GRAIN_LOG_MEAN.array(grain.log_mean),
            FINE_GRAIN_SEED.name: FINE_GRAIN_SEED.array(np.int64(grain.seed)),
        },
        attrs={"figures": figures, "warnings": warnings},
    )
