"""Scan: linear color, grey value, wood mask and the scale of the rings, on the grid that everything else uses."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from stages.stage import Params, scalar, stage
from stages.variables import (
    DPI_PIXEL_SIZE,
    ENCODED,
    OPAQUE,
    PIXEL_SIZE,
    REDUCTION,
    RGB,
    RING_SCALE,
    VALID,
    VALUE,
)


class ScanParams(Params):
    """Parameters of `scan`."""

    pixel_size_mm: PositiveFloat | None = None
    """Size of a scan pixel in mm; overrides the file's resolution tags. Without either, lengths stay in px."""

    ring_width_px: PositiveFloat | None = None
    """Characteristic ring width in scan px; found when not given."""

    reduction: PositiveInt | None = None
    """Scan px per analysed px along each axis; chosen from the ring width when not given."""

    background_white: float = Field(default=0.92, gt=0.5, le=1.0)
    """Colorless areas at the scan's edge at least this bright (encoded value) are background."""

    background_black: float = Field(default=0.06, ge=0.0, lt=0.5)
    """Areas at the scan's edge at most this bright (encoded value) are background."""


@stage(
    requires=(ENCODED, OPAQUE, DPI_PIXEL_SIZE),
    provides=(RGB, VALUE, VALID, PIXEL_SIZE, REDUCTION, RING_SCALE),
    version=1,
    params=ScanParams,
)
def scan(ds: xr.Dataset, params: ScanParams) -> xr.Dataset:
    """Decode the photograph, mask what is not wood and find how wide its rings are."""
    from woodfit import photograph, ring_scale

    encoded, opaque = ds[ENCODED.name], ds[OPAQUE.name]
    height, width = opaque.shape
    overview_step = max(1, -(-max(height, width) // 1200))
    mask = photograph.wood_mask(
        _part(encoded, slice(None), slice(None), overview_step),
        _part(opaque, slice(None), slice(None), overview_step),
        params.background_white,
        params.background_black,
    )

    def window(row: int, col: int, rows: int, cols: int, step: int) -> tuple[Any, Any]:
        part = encoded[row : row + rows, col : col + cols].values
        inside = photograph.mask_window(mask, overview_step, row, col, part.shape[:2])
        value = ring_scale.reduce_by(photograph.grey_value(part), step)
        return value, ring_scale.reduce_by(inside.astype(np.float32), step) > 0.99

    scale_px = params.ring_width_px or ring_scale.ring_scale((height, width), window)
    step = params.reduction or photograph.reduction_for((height, width), scale_px)
    arrays = xr.apply_ufunc(
        photograph.develop,
        encoded.chunk(channel=-1) if encoded.chunks else encoded,
        opaque,
        input_core_dims=[["channel"], []],
        output_core_dims=[["channel"], [], []],
        dask="parallelized",
        output_dtypes=[np.float32, np.float32, np.bool_],
    )
    rgb, value, clear = (_coarsen(array, step) for array in arrays)
    wood = photograph.mask_at(mask, overview_step, step, clear.shape)
    valid = (clear >= 0.99) & xr.DataArray(wood, dims=("y", "x"))
    pixel_size = params.pixel_size_mm or scalar(ds, DPI_PIXEL_SIZE)
    warnings = [] if np.isfinite(pixel_size) else ["No scale is known: lengths are in px. Set `scan.pixel_size_mm`."]
    if wood.mean() < 0.02:
        warnings.append("Hardly any wood was found: nearly all of the scan looks like background.")
    coords = {name: rgb.coords[name] for name in ("y", "x")}
    return xr.Dataset(
        {
            RGB.name: RGB.array(rgb.transpose("y", "x", "channel").astype(np.float32).data),
            VALUE.name: VALUE.array(value.astype(np.float32).data),
            VALID.name: VALID.array(valid.data),
            PIXEL_SIZE.name: PIXEL_SIZE.array(np.float64(pixel_size)),
            REDUCTION.name: REDUCTION.array(np.int64(step)),
            RING_SCALE.name: RING_SCALE.array(np.float64(scale_px)),
        },
        coords=coords,
        attrs={
            "warnings": warnings,
            "figures": {"ring width found (px)": round(scale_px, 1), "analysed at 1 :": step},
        },
    )


def _part(array: xr.DataArray, rows: slice, cols: slice, step: int) -> Any:
    """Every `step`-th element along y and x, computed."""
    return array[rows, cols][::step, ::step].values


def _coarsen(array: xr.DataArray, step: int) -> xr.DataArray:
    """Mean over blocks; the coordinates become the blocks' centres in scan px."""
    if step == 1:
        return array
    return array.astype(np.float32).coarsen(y=step, x=step, boundary="trim").mean()
