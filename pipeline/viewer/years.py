"""Calendar years of the rings of a texture, where its scan was dated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stages.products import SERIES, series_document_of
from stages.stage import scalar
from stages.variables import OUTERMOST_YEAR, RING_AGE_SHIFT, RING_AGE_SIGN

if TYPE_CHECKING:
    import xarray as xr

    from pipeline.context import ProductContext


def years_of(ds: xr.Dataset, context: ProductContext) -> dict[int, int]:
    """Year of each ring index; empty when the scan is not dated, or is a block of several faces."""
    needed = (*SERIES.requires, RING_AGE_SHIFT, RING_AGE_SIGN)
    if context.faces or any(variable.name not in ds for variable in needed):
        return {}
    if np.isnan(scalar(ds, OUTERMOST_YEAR)) and not ds[OUTERMOST_YEAR.name].attrs.get("pattern"):
        return {}
    sign, shift = ds[RING_AGE_SIGN.name].values, ds[RING_AGE_SHIFT.name].values
    years: dict[int, int] = {}
    for path in series_document_of(ds, context)["paths"]:
        group = int(path["group"])
        for ring in path["rings"]:
            sides = [ring[side] for side in ("inner", "outer") if ring[side] is not None]
            if ring["year"] is not None and len(sides) == 2:
                # A ring lies between two boundaries; its index is the age at the inner one.
                inner = min(sign[group] * side + shift[group] for side in sides)
                years.setdefault(int(np.floor(inner)), int(ring["year"]))
    return years
