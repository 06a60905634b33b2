"""Ring series: widths, earlywood and latewood along measurement paths, and the way to the pith."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, field_validator, model_validator

from stages.polylines import polylines_of
from stages.stage import InputFile, Params, scalar, stage
from stages.variables import (
    ABSENT_YEARS,
    BRIGHT_OUTWARDS,
    CORRECTED_ABSENT_X,
    CORRECTED_ABSENT_Y,
    CORRECTED_LATEWOOD_X,
    CORRECTED_LATEWOOD_Y,
    FACE_PITH_X,
    FACE_PITH_Y,
    FREQUENCY,
    GRAIN_RATIO,
    GROWTH_ANGLE,
    OUTERMOST_COMPLETE,
    OUTERMOST_YEAR,
    REDUCTION,
    RGB,
    RING_CLOSED,
    RING_CONFIDENCE,
    RING_GROUP,
    RING_INDEX,
    RING_X,
    RING_Y,
    SERIES_VARIABLES,
    VALID,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)

Point = tuple[float, float]

COMPASS_POINTS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


class RingSeriesParams(Params):
    """Parameters of `ring_series`."""

    path: tuple[tuple[Point, ...], ...] = ()
    """Paths to measure along, each a list of [x, y] in scan px (a single one may stand alone); found when not given."""

    path_file: InputFile | None = None
    """File with the paths instead: CooRecorder .pos, or JSON {"paths": [{"points": [[x, y], ...]}]}."""

    radii: tuple[str | float, ...] = ("N", "E", "S", "W")
    """Radii of a disc: compass points on the image (N is up) or degrees clockwise from up."""

    corridor_px: PositiveFloat | None = None
    """Width along the boundaries over which a ring's profile is averaged, scan px; about a ring when not given."""

    outermost_year: int | None = Field(default=None, ge=-20000, le=20000)
    """Year of the outermost wood of the sample; 0 is 1 BC."""

    year_pattern: str | None = None
    """Regular expression whose one group finds that year in the scan's name without suffix, e.g. '_([0-9]{4})$'."""

    outermost_complete: bool = True
    """Whether the last boundary ends the outermost year's ring; false when wood of that year lies outside of it."""

    absent_years: tuple[int, ...] = ()
    """Years whose ring is locally absent: given width 0, so that older rings get earlier years."""

    @field_validator("path", mode="before")
    @classmethod
    def _one_path_may_stand_alone(cls, value: Any) -> Any:
        is_alone = isinstance(value, list | tuple) and value and _is_point(value[0])
        return [value] if is_alone else value

    @field_validator("path")
    @classmethod
    def _paths_lead_somewhere(cls, value: tuple[tuple[Point, ...], ...]) -> tuple[tuple[Point, ...], ...]:
        from woodfit.path_file import checked_path

        for number, points in enumerate(value, 1):
            checked_path(np.array(points, np.float64).reshape(-1, 2), f"path {number}")
        return value

    @field_validator("path_file")
    @classmethod
    def _file_holds_paths(cls, value: InputFile | None) -> InputFile | None:
        from woodfit.path_file import read_paths

        if value is not None:
            read_paths(value.text, value.name)
        return value

    @field_validator("radii")
    @classmethod
    def _radii_have_directions(cls, value: tuple[str | float, ...]) -> tuple[str | float, ...]:
        for name in value:
            if isinstance(name, str) and name.upper() not in COMPASS_POINTS:
                raise ValueError(f"expected {', '.join(COMPASS_POINTS)} or degrees, found {name!r}")
        if not value:
            raise ValueError("expected at least one radius")
        return value

    @field_validator("year_pattern")
    @classmethod
    def _pattern_has_one_group(cls, value: str | None) -> str | None:
        if value is None:
            return None
        try:
            groups = re.compile(value).groups
        except re.error as error:
            raise ValueError(f"not a regular expression ({error})") from None
        if groups != 1:
            raise ValueError(f"expected one group in parentheses for the year, found {groups}")
        return value

    @model_validator(mode="after")
    def _one_source_of_paths(self) -> RingSeriesParams:
        if self.path and self.path_file is not None:
            raise ValueError("expected `path` or `path_file`, found both")
        return self


def _is_point(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(v, int | float) for v in value)


@stage(
    requires=(
        RGB,
        VALID,
        REDUCTION,
        FREQUENCY,
        RING_X,
        RING_Y,
        VERTEX_CONFIDENCE,
        VERTEX_COUNT,
        RING_INDEX,
        RING_GROUP,
        RING_CONFIDENCE,
        RING_CLOSED,
        GROWTH_ANGLE,
        BRIGHT_OUTWARDS,
        GRAIN_RATIO,
        CORRECTED_LATEWOOD_X,
        CORRECTED_LATEWOOD_Y,
        CORRECTED_ABSENT_X,
        CORRECTED_ABSENT_Y,
        FACE_PITH_X,
        FACE_PITH_Y,
    ),
    provides=(*SERIES_VARIABLES, OUTERMOST_YEAR, OUTERMOST_COMPLETE, ABSENT_YEARS),
    version=1,
    params=RingSeriesParams,
)
def ring_series(ds: xr.Dataset, params: RingSeriesParams) -> xr.Dataset:
    """Measure the rings along paths across them, at right angles to their boundaries."""
    from woodfit import latewood, measure_scan, measured, path_file, series_arrays
    from woodfit.measuring import Boundaries
    from woodfit.measuring_path import Grid, bearings

    lines, _ = polylines_of(ds)
    origin = [float(ds.coords[name][0]) if name in ds.coords else 0.0 for name in ("x", "y")]
    height, width = ds[VALID.name].shape
    face = measured.Face(
        boundaries=Boundaries(
            lines,
            ds[RING_INDEX.name].values.astype(np.int64),
            ds[RING_GROUP.name].values.astype(np.int64),
            ds[RING_CLOSED.name].values,
            ds[RING_CONFIDENCE.name].values.astype(np.float64),
        ),
        growth=ds[GROWTH_ANGLE.name].values,
        frequency=ds[FREQUENCY.name].values,
        valid=ds[VALID.name].values,
        dark=latewood.darkness(ds[RGB.name].values),
        grid=Grid((origin[0], origin[1]), scalar(ds, REDUCTION), (height, width)),
        late_is_dark=bool(ds[BRIGHT_OUTWARDS.name]),
        along_stem=scalar(ds, GRAIN_RATIO) > measure_scan.ALONG_STEM,
        pith=np.array([scalar(ds, FACE_PITH_X), scalar(ds, FACE_PITH_Y)]),
    )
    given = [np.array(points, np.float64) for points in params.path]
    if params.path_file is not None:
        given = path_file.read_paths(params.path_file.text, params.path_file.name)
    step = face.grid.step
    path_file.check_on_scan(given, width * step, height * step)
    chosen = measure_scan.routes(face, given, bearings(params.radii))
    latewood_marks = np.column_stack([ds[CORRECTED_LATEWOOD_X.name].values, ds[CORRECTED_LATEWOOD_Y.name].values])
    absent_marks = np.column_stack([ds[CORRECTED_ABSENT_X.name].values, ds[CORRECTED_ABSENT_Y.name].values])
    series = measure_scan.measure(face, chosen, params.corridor_px, latewood_marks, absent_marks)
    arrays = series_arrays.pack(series, face.late_is_dark)
    fraction = (np.arange(series_arrays.FRACTIONS) + 0.5) / series_arrays.FRACTIONS
    year = OUTERMOST_YEAR.array(np.float64(np.nan if params.outermost_year is None else params.outermost_year))
    # A stage does not know the scan's name: what it says of the year is read when the series are written.
    year.attrs["pattern"] = params.year_pattern or ""
    return xr.Dataset(
        {variable.name: variable.array(getattr(arrays, variable.name)) for variable in SERIES_VARIABLES}
        | {
            OUTERMOST_YEAR.name: year,
            OUTERMOST_COMPLETE.name: OUTERMOST_COMPLETE.array(np.bool_(params.outermost_complete)),
            ABSENT_YEARS.name: ABSENT_YEARS.array(np.array(sorted(set(params.absent_years)), np.int64)),
        },
        coords={"fraction": fraction},
        attrs={
            "warnings": measure_scan.describe_doubt(series),
            "figures": measure_scan.figures(series),
        },
    )
