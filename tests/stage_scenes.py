"""Drawn scenes taken through the stages, as the tests of the stages share them."""

from functools import cache

import numpy as np
import xarray as xr
from kernel_scenes import Array
from scipy.ndimage import map_coordinates

from stages import STAGES
from stages.faces import single_face
from woodfit.synthetic_scenes import Scene, scene

SIZE = (300, 320)


def source(encoded: Array, pixel_size_mm: float = np.nan) -> xr.Dataset:
    """What the pipeline reads from a file."""
    height, width = encoded.shape[:2]
    one = {"units": "1"}
    return xr.Dataset(
        {
            "encoded": (("y", "x", "channel"), encoded, one),
            "opaque": (("y", "x"), np.ones((height, width), bool), one),
            "dpi_pixel_size": ((), pixel_size_mm, {"units": "mm"}),
        },
        coords={"y": np.arange(height, dtype=float), "x": np.arange(width, dtype=float)},
    )


def added(ds: xr.Dataset, result: xr.Dataset) -> xr.Dataset:
    """The dataset that the next stage sees."""
    return ds.assign(result.data_vars).assign_coords(result.coords)


@cache
def drawn(name: str) -> Scene:
    return scene(name, SIZE, 0)


@cache
def chain(name: str) -> tuple[xr.Dataset, dict[str, xr.Dataset]]:
    """All variables after the last stage, and what each stage gave; on the way, that no stage touched its input."""
    ds, given = added(source(drawn(name).face.rgb_encoded), single_face()), {}
    for one in STAGES:
        before = ds.copy(deep=True)
        given[one.name] = one(ds, one.params_type())
        xr.testing.assert_identical(ds, before)
        ds = added(ds, given[one.name])
    return ds, given


def true_age_at(name: str, x: Array, y: Array) -> Array:
    return np.asarray(map_coordinates(drawn(name).face.age.astype(float), [y, x], order=1, mode="nearest"))
