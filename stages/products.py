"""What lies in a scan's folder when a run is done: files that other programs open."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from stages.polylines import polylines_of
from stages.stage import Variable, scalar
from stages.variables import (
    AZIMUTH_WRAPS,
    BOARD_TO_TREE,
    COLOR_STRIP,
    LATENESS_STRIP,
    PIXEL_SIZE,
    POLISHED_DISPLACEMENT,
    REDUCTION,
    RING_CLOSED,
    RING_CONFIDENCE,
    RING_GROUP,
    RING_INDEX,
    RING_RADIUS,
    RING_X,
    RING_Y,
    SAMPLES_PER_RING,
    VALID,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)
from woodfit.cylinder_grid import CylinderGrid
from woodfit.solid_texture import SolidTexture


@dataclass(frozen=True)
class Product:
    """A file made from the results of stages.

    Parameters
    ----------
    name
        What it is called in ``woodpipe show``.
    filename
        Its name in the scan's folder.
    requires
        Variables it is made from.
    version
        Goes up when the same results give another file.
    write
        ``write(ds, path, context)``; `context` has at least ``scan`` (path of the scan) and ``version``.
    """

    name: str
    filename: str
    requires: tuple[Variable, ...]
    version: int
    write: Callable[[xr.Dataset, Path, Any], None]


def write_rings(ds: xr.Dataset, path: Path, context: Any) -> None:
    """Write the ring boundaries as JSON in the image frame (docs/rings_json.md)."""
    lines, _ = polylines_of(ds)
    step = int(scalar(ds, REDUCTION))
    height, width = (int(n) for n in ds[VALID.name].shape)
    index, group = ds[RING_INDEX.name].values, ds[RING_GROUP.name].values
    confidence, closed = ds[RING_CONFIDENCE.name].values, ds[RING_CLOSED.name].values
    size = scalar(ds, PIXEL_SIZE)
    document = {
        "image": Path(context.scan).name,
        "size": [width * step, height * step],
        "pixel_size_mm": size if np.isfinite(size) else None,
        "rings": [
            {
                "id": int(index[i]),
                "group": int(group[i]),
                "confidence": round(float(confidence[i]), 3),
                "closed": bool(closed[i]),
                "points": np.round(line, 2).tolist(),
            }
            for i, line in enumerate(lines)
        ],
    }
    path.write_text(json.dumps(document), encoding="utf-8")


def solid_texture_of(ds: xr.Dataset) -> SolidTexture:
    """Solid texture from the results of all stages."""
    field = ds[POLISHED_DISPLACEMENT.name]
    radius, azimuth, height = (field.coords[name].values for name in ("radius", "azimuth", "height"))
    grid = CylinderGrid(radius, azimuth, height, bool(ds[AZIMUTH_WRAPS.name]))
    size = scalar(ds, PIXEL_SIZE)
    return SolidTexture(
        board_to_tree=ds[BOARD_TO_TREE.name].values,
        grid=grid,
        displacement=field.values,
        ring_radius=ds[RING_RADIUS.name].values,
        color_strip=ds[COLOR_STRIP.name].values,
        lateness_strip=ds[LATENESS_STRIP.name].values,
        samples_per_ring=int(scalar(ds, SAMPLES_PER_RING)),
        pixel_size=size if np.isfinite(size) else None,
        attributes={"face_size_px": [int(n) * int(scalar(ds, REDUCTION)) for n in ds[VALID.name].shape[::-1]]},
    )


def write_texture(ds: xr.Dataset, path: Path, context: Any) -> None:
    """Write the solid texture (docs/solid_texture.md)."""
    solid_texture_of(ds).save(path)


RINGS = Product(
    "rings",
    "rings.json",
    (
        VALID,
        REDUCTION,
        PIXEL_SIZE,
        RING_X,
        RING_Y,
        VERTEX_CONFIDENCE,
        VERTEX_COUNT,
        RING_INDEX,
        RING_GROUP,
        RING_CONFIDENCE,
        RING_CLOSED,
    ),
    1,
    write_rings,
)

TEXTURE = Product(
    "texture",
    "texture.zarr.zip",
    (
        VALID,
        REDUCTION,
        PIXEL_SIZE,
        BOARD_TO_TREE,
        RING_RADIUS,
        POLISHED_DISPLACEMENT,
        COLOR_STRIP,
        LATENESS_STRIP,
        AZIMUTH_WRAPS,
        SAMPLES_PER_RING,
    ),
    1,
    write_texture,
)

PRODUCTS = (RINGS, TEXTURE)
