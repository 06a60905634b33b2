"""Scan: linear color, grey value, wood mask and the scale of the rings, on the grid that everything else uses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from stages.stage import Params, scalar, stage
from stages.variables import (
    DPI_PIXEL_SIZE,
    ENCODED,
    FACE_PITH_X,
    FACE_PITH_Y,
    OPAQUE,
    PIXEL_SIZE,
    REDUCTION,
    RGB,
    RING_SCALE,
    STRAIGHT_RUN,
    VALID,
    VALUE,
    VESSEL_SCALE,
)


class ScanParams(Params):
    """Parameters of `scan`."""

    pixel_size_mm: PositiveFloat | None = None
    """Size of a scan pixel in mm; overrides the file's resolution tags. Without either, lengths stay in px."""

    ring_width_px: PositiveFloat | None = None
    """Characteristic ring width in scan px; found when not given."""

    ring_porous: bool | None = None
    """Whether rings are to be sought in the density of vessels rather than in the grey value; found when not given."""

    reduction: PositiveInt | None = None
    """Scan px per analysed px along each axis; chosen from the ring width when not given."""

    pith_px: tuple[float, float] | None = None
    """x, y of the pith in scan px where the face shows it; found when not given."""

    background_white: float = Field(default=0.92, gt=0.5, le=1.0)
    """Colorless areas at the scan's edge at least this bright (encoded value) are background."""

    background_black: float = Field(default=0.06, ge=0.0, lt=0.5)
    """Areas at the scan's edge at most this bright (encoded value) are background."""


@stage(
    requires=(ENCODED, OPAQUE, DPI_PIXEL_SIZE),
    provides=(
        RGB,
        VALUE,
        VALID,
        PIXEL_SIZE,
        REDUCTION,
        RING_SCALE,
        STRAIGHT_RUN,
        VESSEL_SCALE,
        FACE_PITH_X,
        FACE_PITH_Y,
    ),
    version=7,
    params=ScanParams,
)
def scan(ds: xr.Dataset, params: ScanParams) -> xr.Dataset:
    """Decode the photograph, mask what is not wood and find how wide its rings are."""
    from woodfit import photograph, ring_direction, ring_scale, vessels

    encoded, opaque = ds[ENCODED.name], ds[OPAQUE.name]
    height, width = opaque.shape
    shape = (height, width)
    # Background, pith and ring width are seen on an overview or on samples, whatever the size of the scan.
    overview_step = max(1, -(-max(height, width) // 1200))
    mask = photograph.wood_mask(
        _part(encoded, slice(None), slice(None), overview_step),
        _part(opaque, slice(None), slice(None), overview_step),
        params.background_white,
        params.background_black,
    )

    def window_of(transform: Callable[..., Any], *arguments: Any) -> Callable[..., tuple[Any, Any]]:
        def window(row: int, col: int, rows: int, cols: int, step: int) -> tuple[Any, Any]:
            part = photograph.grey_value(encoded[row : row + rows, col : col + cols].values)
            inside = photograph.mask_window(mask, overview_step, row, col, part.shape)
            value = ring_scale.reduce_by(transform(part, *arguments), step)
            return value, ring_scale.reduce_by(inside.astype(np.float32), step) > 0.99

        return window

    grey = window_of(np.asarray)
    thick = photograph.thickness(mask) * overview_step
    if params.ring_width_px is None:
        in_grey = ring_scale.scale_scores(shape, grey, thick_px=thick)
        scale_px = ring_scale.ring_scale(shape, in_grey)
    else:
        scale_px = params.ring_width_px
    pores = 0
    if params.ring_porous is not False:
        pores = vessels.vessel_scale(shape, grey, scale_px) or int(params.ring_porous or 0)
    if pores and params.ring_width_px is None:
        # Blurred twice as far: single vessels must not pass for narrow rings.
        in_density = ring_scale.scale_scores(shape, window_of(vessels.density_signal, pores, 2.0), thick_px=thick)
        in_both = ring_scale.ring_scale(shape, in_grey.with_other(in_density))
        if params.ring_porous or vessels.crowd_by_rings(in_grey, in_density, in_both):
            scale_px = in_both
        else:
            pores = 0
    seen = window_of(vessels.density_signal, pores) if pores else grey
    overview = _part(encoded, slice(None), slice(None), overview_step)
    pith = params.pith_px or _pith(photograph.grey_value(overview), mask, overview_step)
    step = params.reduction or photograph.reduction_for(shape, scale_px, float(mask.mean()))
    straight = ring_direction.straight_run(shape, seen, scale_px, step, thick_px=thick, rays=pores > 0)
    arrays = xr.apply_ufunc(
        photograph.develop,
        encoded.chunk(channel=-1) if encoded.chunks else encoded,
        opaque,
        input_core_dims=[["channel"], []],
        output_core_dims=[["channel"], [], []],
        dask="parallelized",
        output_dtypes=[np.float32, np.float32, np.bool_],
    )
    rgb, value, clear = arrays
    if pores:
        value = _neighbourhood(vessels.density_signal, value, vessels.density_halo(pores), scale=pores)
    rgb, value, clear = (_coarsen(array, step) for array in (rgb, value, clear))
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
            STRAIGHT_RUN.name: STRAIGHT_RUN.array(np.float64(straight)),
            FACE_PITH_X.name: FACE_PITH_X.array(np.float64(pith[0])),
            FACE_PITH_Y.name: FACE_PITH_Y.array(np.float64(pith[1])),
            VESSEL_SCALE.name: VESSEL_SCALE.array(np.int64(pores)),
        },
        coords=coords,
        attrs={
            "warnings": warnings,
            "figures": {
                "ring width found (px)": round(scale_px, 1),
                "analysed at 1 :": step,
                "vessels": "rings sought in their density" if pores else "none seen",
            },
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


def _neighbourhood(function: Any, array: xr.DataArray, margin: int, **named: Any) -> xr.DataArray:
    """`function` over an array in memory, or over the chunks of a large one with a margin around each."""
    if array.chunks:
        import dask.array as da

        # No margin at the scan's border: there the function does as it does with the whole.
        data = da.map_overlap(
            function, array.data, depth=margin, boundary="none", dtype=np.float32, meta=np.zeros((0, 0), "f4"), **named
        )
        data = data.rechunk(array.data.chunks)
    else:
        data = function(array.values, **named)
    return array.copy(data=data)


def _pith(overview: Any, mask: Any, overview_step: int) -> tuple[float, float]:
    """Pith in scan px as an overview shows it, NaN where it does not."""
    from woodfit import centre, structure_tensor

    angle, coherence = structure_tensor.orientation(overview, mask, 1.5, 5.0)
    found = centre.find_centre(angle, coherence * mask)
    if found is None:
        return float("nan"), float("nan")
    return found[0] * overview_step, found[1] * overview_step
