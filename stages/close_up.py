"""Close-up: windows of the photograph at its own resolution, for what is finer than the grid of the analysis."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import Field

from stages.stage import Params, stage
from stages.variables import CLOSE_UP, CLOSE_UP_OPAQUE, CLOSE_UP_X, CLOSE_UP_Y, ENCODED, OPAQUE


class CloseUpParams(Params):
    """Parameters of `close_up`."""

    window_px: int = Field(default=256, ge=64, le=1024)
    """Side of a window, scan px."""

    most_windows: int = Field(default=24, ge=1, le=400)
    """Windows at most; they are spread evenly over the scan."""


@stage(
    requires=(ENCODED, OPAQUE),
    provides=(CLOSE_UP, CLOSE_UP_OPAQUE, CLOSE_UP_X, CLOSE_UP_Y),
    version=1,
    params=CloseUpParams,
)
def close_up(ds: xr.Dataset, params: CloseUpParams) -> xr.Dataset:
    """Keep windows of the photograph as it was stored."""
    from woodfit.close_up import window_corners

    encoded, opaque, size = ds[ENCODED.name], ds[OPAQUE.name], params.window_px
    rows, columns = window_corners((opaque.sizes["y"], opaque.sizes["x"]), size, params.most_windows)
    pixels = np.zeros((len(rows), size, size, 3), encoded.dtype)
    clear = np.zeros((len(rows), size, size), np.bool_)
    for number, (row, column) in enumerate(zip(rows, columns, strict=True)):
        part = slice(row, row + size), slice(column, column + size)
        known = opaque[part].values
        pixels[number, : known.shape[0], : known.shape[1]] = encoded[part].values
        clear[number, : known.shape[0], : known.shape[1]] = known
    return xr.Dataset(
        {
            CLOSE_UP.name: CLOSE_UP.array(pixels),
            CLOSE_UP_OPAQUE.name: CLOSE_UP_OPAQUE.array(clear),
            CLOSE_UP_X.name: CLOSE_UP_X.array(columns.astype(np.float64)),
            CLOSE_UP_Y.name: CLOSE_UP_Y.array(rows.astype(np.float64)),
        }
    )
