"""Stages that see a block, after two of the dummy stages: what they saw is in their results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from dummy_stages import LEVEL, SMOOTH, SUMMARY, Product, SummaryParams, _note, level, read, smooth, stage

from stages.stage import Params, Variable
from stages.variables import FACE_PLANE, FACE_TOP, PIXEL_SIZE, VALID, VALUE
from woodfit.planes import Planes

PLACES = Variable("places", ("place", "board_xyz"), "f", "px", "Corners of the faces in the wood.")
FITTED = Variable("fitted", ("y", "x"), "f", "1", "An image over all faces.")


class PlaceParams(Params):
    shift: float = 0.0
    """Added to all places, px."""


@stage(
    requires=(VALUE, VALID, FACE_PLANE, FACE_TOP, PIXEL_SIZE),
    provides=(PLACES, FITTED),
    version=1,
    params=PlaceParams,
    sees_block=True,
)
def place(ds: xr.Dataset, params: PlaceParams) -> xr.Dataset:
    """Corners of the faces."""
    _note("place")
    planes = Planes(ds[FACE_PLANE.name].values, ds[FACE_TOP.name].values)
    valid = ds[VALID.name].values
    corners = []
    for top in ds[FACE_TOP.name].values:
        rows = np.flatnonzero(planes.face_of(ds.coords["y"].values) == planes.face_of(np.array([top]))[0])
        inside = valid[rows]
        y = ds.coords["y"].values[rows][inside.any(axis=1)]
        x = ds.coords["x"].values[inside.any(axis=0)]
        corners.append(planes.lift(np.array([x[0], x[-1], x[0]]), np.array([y[0], y[0], y[-1]])))
    value = ds[VALUE.name]
    return xr.Dataset(
        {
            PLACES.name: PLACES.array(np.concatenate(corners) + params.shift),
            FITTED.name: FITTED.array(value.values, value.coords),
        },
        attrs={"figures": {"size of a px": float(ds[PIXEL_SIZE.name])}},
    )


@stage(requires=(LEVEL, SMOOTH, PLACES, FITTED), provides=(SUMMARY,), version=1, params=SummaryParams, sees_block=True)
def summary(ds: xr.Dataset, params: SummaryParams) -> xr.Dataset:
    """One number of everything."""
    _note("summary")
    assert ds[SMOOTH.name].shape == ds[FITTED.name].shape
    number = float(ds[LEVEL.name].sum() + ds[PLACES.name].sum()) ** params.power
    return xr.Dataset({SUMMARY.name: SUMMARY.array(number)})


STAGES = (read, smooth, level, place, summary)


def write_levels(ds: xr.Dataset, path: Path, context: Any) -> None:
    _note("levels")
    path.write_text(f"{context.scan.name} {ds.sizes['ring']}")


def write_story(ds: xr.Dataset, path: Path, context: Any) -> None:
    """From both kinds of stages: what was read, as joined."""
    _note("story")
    plane = ds[FACE_PLANE.name]
    lines = [context.scan.name, plane.attrs["block_unit"], str(dict(ds.sizes)["y"]), str(plane.sizes["face"])]
    path.write_text("\n".join([*lines, *context.faces, *context.warnings]))


PRODUCTS = (
    Product("levels", "levels.txt", (LEVEL,), 1, write_levels),
    Product("story", "story.txt", (SUMMARY, SMOOTH, FACE_PLANE), 1, write_story),
)
