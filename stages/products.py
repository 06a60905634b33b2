"""What lies in a scan's folder when a run is done: files that other programs open."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from stages.polylines import planes_of, polylines_of
from stages.stage import Variable, scalar
from stages.variables import (
    ABSENT_YEARS,
    AZIMUTH_WRAPS,
    BOARD_TO_TREE,
    BRIGHT_OUTWARDS,
    COLOR_STRIP,
    FACE_AGE,
    FACE_PLANE,
    FACE_TOP,
    FINE_GRAIN_AMPLITUDE,
    FINE_GRAIN_CELLS,
    FINE_GRAIN_COLOR,
    FINE_GRAIN_DENSITY,
    FINE_GRAIN_KIND,
    FINE_GRAIN_LOG_MEAN,
    FINE_GRAIN_SEED,
    GROWTH_SURENESS,
    LATENESS_STRIP,
    OUTERMOST_COMPLETE,
    OUTERMOST_YEAR,
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
    SERIES_VARIABLES,
    STEM,
    VALID,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)
from woodfit.cylinder_grid import CylinderGrid
from woodfit.fine_grain import FineGrain
from woodfit.seen import Seen, seen_on
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


def write_series(ds: xr.Dataset, path: Path, context: Any) -> None:
    """Write the ring series as JSON (docs/series_json.md)."""
    path.write_text(json.dumps(series_document_of(ds, context)), encoding="utf-8")


def series_document_of(ds: xr.Dataset, context: Any) -> dict[str, Any]:
    """Everything known of the ring series, as ``series.json`` holds it; `context` as of a product."""
    from woodfit.dating import dating_for
    from woodfit.series_arrays import SeriesArrays
    from woodfit.series_document import series_document

    scan, step, size = Path(context.scan), int(scalar(ds, REDUCTION)), scalar(ds, PIXEL_SIZE)
    height, width = (int(n) for n in ds[VALID.name].shape)
    year = ds[OUTERMOST_YEAR.name]
    dating, remarks = dating_for(
        scan.stem,
        None if np.isnan(year.values) else int(year.values),
        year.attrs.get("pattern") or None,
        bool(ds[OUTERMOST_COMPLETE.name]),
        ds[ABSENT_YEARS.name].values.tolist(),
    )
    arrays = SeriesArrays(**{variable.name: ds[variable.name].values for variable in SERIES_VARIABLES})
    return {
        "image": scan.name,
        "size": [width * step, height * step],
        "bright_outwards": bool(ds[BRIGHT_OUTWARDS.name]),
        "growth_sureness": round(scalar(ds, GROWTH_SURENESS), 3),
        **series_document(arrays, scan.stem, dating, size if np.isfinite(size) else None, remarks),
    }


def solid_texture_of(ds: xr.Dataset) -> SolidTexture:
    """Solid texture from the results of all stages; without fine grain where that was not fitted yet."""
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
        length_unit=ds[FACE_PLANE.name].attrs.get("block_unit") or "mm",
        stem=ds[STEM.name].values,
        fine_grain=_fine_grain_of(ds) if FINE_GRAIN_KIND.name in ds else FineGrain.none(),
        seen=_seen_of(ds) if FACE_AGE.name in ds else Seen(),
    )


def _seen_of(ds: xr.Dataset) -> Seen:
    planes, x, y = planes_of(ds), ds.coords["x"].values, ds.coords["y"].values
    face = planes.face_of(y)
    return seen_on(planes.plane, planes.top, ds[VALID.name].values, x, y, face, ds[FACE_AGE.name].values)


def _fine_grain_of(ds: xr.Dataset) -> FineGrain:
    return FineGrain(
        kind=ds[FINE_GRAIN_KIND.name].values,
        cells=ds[FINE_GRAIN_CELLS.name].values,
        density=ds[FINE_GRAIN_DENSITY.name].values,
        amplitude=ds[FINE_GRAIN_AMPLITUDE.name].values,
        color=ds[FINE_GRAIN_COLOR.name].values,
        log_mean=ds[FINE_GRAIN_LOG_MEAN.name].values,
        seed=int(scalar(ds, FINE_GRAIN_SEED)),
    )


def write_texture(ds: xr.Dataset, path: Path, context: Any) -> None:
    """Write the solid texture (docs/solid_texture.md)."""
    solid_texture_of(ds).save(path)


def write_liu(ds: xr.Dataset, path: Path, context: Any) -> None:
    """Write the wood as parameters that a person can edit (docs/liu.md)."""
    from woodfit.liu_fit import agreement, fit_liu
    from woodfit.planes import Planes

    texture = solid_texture_of(ds)
    rows, columns = np.nonzero(ds[VALID.name].values)
    some = np.linspace(0, len(rows) - 1, min(2500, len(rows))).round().astype(int)
    planes = Planes(ds[FACE_PLANE.name].values, ds[FACE_TOP.name].values)
    seen = planes.lift(ds.coords["x"].values[columns[some]], ds.coords["y"].values[rows[some]])
    points = seen * (texture.pixel_size or 1.0)
    model = fit_liu(texture, points)
    off = agreement(model, texture, points) if len(points) else {}
    path.write_text(model.to_json(image=Path(context.scan).name, off_the_texture_on_the_face=off), encoding="utf-8")


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
        FACE_PLANE,
        FACE_TOP,
        FACE_AGE,
        STEM,
        FINE_GRAIN_KIND,
        FINE_GRAIN_CELLS,
        FINE_GRAIN_DENSITY,
        FINE_GRAIN_AMPLITUDE,
        FINE_GRAIN_COLOR,
        FINE_GRAIN_LOG_MEAN,
        FINE_GRAIN_SEED,
    ),
    3,
    write_texture,
)

SERIES = Product(
    "series",
    "series.json",
    (
        VALID,
        REDUCTION,
        PIXEL_SIZE,
        BRIGHT_OUTWARDS,
        GROWTH_SURENESS,
        OUTERMOST_YEAR,
        OUTERMOST_COMPLETE,
        ABSENT_YEARS,
        *SERIES_VARIABLES,
    ),
    1,
    write_series,
)

LIU = Product("liu", "liu.json", TEXTURE.requires, 1, write_liu)

PRODUCTS = (RINGS, SERIES, TEXTURE, LIU)
