"""The document ``series.json``: everything known of a scan's ring series, for exporters and plots.

Written from the measured arrays and the dating; read back as series that the exchange formats take. The format is
described in docs/series_json.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.dating import Dating
from woodfit.dendro.series import RingSeries
from woodfit.measured import Kind
from woodfit.measuring_path import bearing_name
from woodfit.series_arrays import FRACTIONS, SeriesArrays

Part = Mapping[str, npt.NDArray[Any]]

FORMAT, VERSION = "woodpipe series", 1

#: A ring so many times wider than its neighbours may hide a boundary that was missed.
SUSPICIOUS = 2.2

_KINDS = {Kind.CORE: "core", Kind.RADIUS: "radius", Kind.LINE: "line", Kind.GIVEN: "given"}


def series_document(
    arrays: SeriesArrays, stem: str, dating: Dating, pixel_size_mm: float | None, remarks: list[str]
) -> dict[str, Any]:
    """Document of all series of a scan; the caller adds what it knows of the image.

    Parameters
    ----------
    arrays : SeriesArrays
        The measured series.
    stem : str
        Name of the scan; series are called after it.
    dating : Dating
        Years.
    pixel_size_mm : float or None
        None when no scale is known: then all that is said in mm is null.
    remarks : list of str
        About the scan as a whole.
    """
    parts = list(arrays.parts())
    names = _names(stem, parts)
    outermost: dict[int, int] = {}
    for part in parts:
        if len(part["crossing_index"]):
            group = int(part["crossing_group"][0])
            outermost[group] = max(outermost.get(group, 0), int(part["crossing_index"][-1]))
    return {
        "format": FORMAT,
        "version": VERSION,
        "pixel_size_mm": pixel_size_mm,
        "outermost_year": dating.outermost_year,
        "outermost_complete": dating.complete,
        "remarks": remarks,
        "paths": [_path(part, name, dating, outermost, pixel_size_mm) for part, name in zip(parts, names, strict=True)],
    }


def _names(stem: str, parts: Sequence[Part]) -> list[str]:
    """Name of each series: the scan's, with the radius or a number where there are several."""
    if len(parts) == 1:
        return [stem]
    bearings = [float(part["series_bearing"]) for part in parts]
    if all(math.isfinite(bearing) for bearing in bearings):
        return [f"{stem}_{bearing_name(bearing)}" for bearing in bearings]
    return [f"{stem}_{number}" for number in range(1, len(parts) + 1)]


def _path(
    part: Part, name: str, dating: Dating, outermost: Mapping[int, int], pixel_size_mm: float | None
) -> dict[str, Any]:
    """One series."""
    count = len(part["crossing_index"])
    group = int(part["crossing_group"][0]) if count else None
    gaps = [_gap(part, k) for k in range(len(part["gap_boundaries"]))]
    remarks = []
    years: list[int | None] = [None] * len(part["series_ring_index"])
    missing_outside = outermost[group] - int(part["crossing_index"][-1]) if group is not None else 0
    if dating.outermost_year is not None and count:
        if any(gap["outside"] for gap in gaps):
            remarks.append("not dated: the rings between this series and the outermost wood could not be counted")
        else:
            absent = [False] * missing_outside + [bool(width == 0.0) for width in part["series_ring_width"][::-1]]
            inwards = dating.years_inwards(absent)
            years = [*inwards[missing_outside:][::-1]]
            if len(outermost) > 1:
                remarks.append("dated by the outermost ring of its own piece of wood")
    if part["series_unfit"]:
        remarks.append(f"{int(part['series_unfit'])} boundaries contradict the count and were left out")
    boundaries = [_boundary(part, k) for k in range(count)]
    rings = _rings(part, years, pixel_size_mm)
    for k, ring in enumerate(rings):
        if ring["outer"] is not None:
            boundaries[ring["outer"]]["year"] = years[k]
    rings = _with_absent(rings, dating, missing_outside == 0)
    return {
        "name": name,
        "kind": _KINDS[Kind(int(part["series_kind"]))],
        "bearing_deg": _number(float(part["series_bearing"]), 2),
        "points": np.round(np.column_stack([part["path_x"], part["path_y"]]), 3).tolist(),
        "group": group,
        "first_year": rings[0]["year"] if rings else None,
        "last_year": rings[-1]["year"] if rings else None,
        "unmeasured_outer": None
        if any(gap["outside"] for gap in gaps)
        else missing_outside + (0 if dating.complete else 1),
        "boundaries": boundaries,
        "rings": rings,
        "gaps": gaps,
        "inner_rest_px": _number(float(part["series_inner_rest"]), 3),
        "outer_rest_px": _number(float(part["series_outer_rest"]), 3),
        "pith": _pith(part, pixel_size_mm),
        "lateness_table": {"fractions": FRACTIONS, "rings": _table(part["lateness_table"])},
        "remarks": remarks,
    }


def _boundary(part: Part, k: int) -> dict[str, Any]:
    """One crossing."""
    return {
        "x": _number(float(part["crossing_x"][k]), 3),
        "y": _number(float(part["crossing_y"][k]), 3),
        "id": int(part["crossing_index"][k]),
        "kind": "pith" if part["crossing_pith"][k] else "boundary",
        "angle_rad": _number(float(part["crossing_angle"][k]), 5),
        "confidence": _number(float(part["crossing_confidence"][k]), 3),
        "beside": bool(part["crossing_beside"][k]),
        "year": None,
    }


def _rings(part: Part, years: list[Any], pixel_size_mm: float | None) -> list[dict[str, Any]]:
    """Measured rings from the inside out."""
    width = part["series_ring_width"].astype(np.float64)
    beside = part["crossing_beside"]
    rings = []
    for k in range(len(width)):
        inner, outer = int(part["series_ring_inner"][k]), int(part["series_ring_outer"][k])
        remarks = []
        is_absent = bool(width[k] == 0.0)
        if is_absent:
            remarks.append("absent ring")
        elif inner < 0 or outer < 0:
            remarks.append("boundary not traced")
        if outer >= 0 and beside[outer]:
            remarks.append("boundary seen beside the path")
        if _is_suspicious(width, k):
            remarks.append("unusually wide: a boundary may have been missed")
        # The parts are rounded so that they still make the whole.
        whole, early = _number(float(width[k]), 4), _number(float(part["earlywood_width"][k]), 4)
        onset = float(part["latewood_onset"][k])
        start, end = (np.array([part["measure_x"][k, i], part["measure_y"][k, i]]) for i in (0, 1))
        ring = {
            "year": years[k],
            "inner": inner if inner >= 0 else None,
            "outer": outer if outer >= 0 else None,
            "absent": is_absent,
            "width_px": whole,
            "earlywood_px": early,
            "latewood_px": None if whole is None or early is None else round(whole - early, 4),
            "from": _xy(start),
            "to": _xy(end),
            "latewood_onset": None
            if not math.isfinite(onset)
            else {
                "fraction": round(onset, 4),
                "xy": _xy(start + onset * (end - start)),
                "sureness": _number(float(part["onset_sureness"][k]), 3),
            },
            "confidence": _number(float(part["crossing_confidence"][outer]), 3) if outer >= 0 else None,
            "remarks": remarks,
        }
        rings.append(ring | _in_mm(float(width[k]), float(part["earlywood_width"][k]), pixel_size_mm))
    return rings


def _in_mm(width_px: float, early_px: float, pixel_size_mm: float | None) -> dict[str, float | None]:
    """Widths in mm to a tenth of a micrometre."""
    size = math.nan if pixel_size_mm is None else pixel_size_mm
    whole, early = _number(width_px * size, 4), _number(early_px * size, 4)
    late = None if whole is None or early is None else round(whole - early, 4)
    return {"width_mm": whole, "earlywood_mm": early, "latewood_mm": late}


def _is_suspicious(width: npt.NDArray[np.float64], k: int) -> bool:
    """Whether a ring is far wider than its neighbours on both sides."""
    near = np.concatenate([width[max(0, k - 3) : k], width[k + 1 : k + 4]])
    near = near[near > 0.0]
    return len(near) >= 3 and bool(width[k] > SUSPICIOUS * near.max())


def _with_absent(rings: list[dict[str, Any]], dating: Dating, reaches_outermost: bool) -> list[dict[str, Any]]:
    """Rings with those of the absent years put in, width 0."""
    if not rings or rings[-1]["year"] is None:
        return rings
    last = rings[-1]["year"]
    if reaches_outermost and dating.outermost_year is not None:
        last = max(last, dating.outermost_year - (0 if dating.complete else 1))
    is_mm = any(ring["width_mm"] is not None for ring in rings)
    zero = {"width_px": 0.0, "width_mm": 0.0 if is_mm else None, "absent": True, "remarks": ["absent ring"]}
    blank = dict.fromkeys(rings[0]) | zero
    known = {ring["year"] for ring in rings}
    more = [blank | {"year": year} for year in dating.absent_between(rings[0]["year"], last) if year not in known]
    return sorted([*rings, *more], key=lambda ring: int(ring["year"]))


def _gap(part: Part, k: int) -> dict[str, Any]:
    """One part in which the rings could not be counted."""
    x, y = part["gap_x"][k], part["gap_y"][k]
    last = np.array([part["crossing_x"][-1], part["crossing_y"][-1]])
    # The gap starts where the series ends, or ends where it begins.
    is_outside = bool(np.hypot(x[0] - last[0], y[0] - last[1]) < 0.01)
    return {
        "from": _xy(np.array([x[0], y[0]])),
        "to": _xy(np.array([x[1], y[1]])),
        "outside": is_outside,
        "rings": None,
        "boundaries_beyond": int(part["gap_boundaries"][k]),
    }


def _pith(part: Part, pixel_size_mm: float | None) -> dict[str, Any] | None:
    """Where the pith is, None when nothing tells."""
    distance, least, most = (float(value) for value in part["pith_distance"])
    if not math.isfinite(distance):
        return None
    size = math.nan if pixel_size_mm is None else pixel_size_mm
    years = int(part["pith_years"])
    return {
        "on_sample": bool(part["pith_on_sample"]),
        "xy": _xy(np.array([float(part["pith_x"]), float(part["pith_y"])])),
        "distance_px": _number(distance, 3),
        "distance_px_range": [_number(least, 3), _number(most, 3)],
        "distance_mm": _number(distance * size, 4),
        "years": years if years >= 0 else None,
    }


def _table(table: npt.NDArray[Any]) -> list[list[float] | None]:
    """Straightened rings to three decimals; null for a ring that was not seen."""
    return [np.round(row.astype(np.float64), 3).tolist() if np.isfinite(row).all() else None for row in table]


def _xy(point: npt.NDArray[Any]) -> list[float] | None:
    """Coordinates to a thousandth of a px; None when unknown."""
    return np.round(point.astype(np.float64), 3).tolist() if np.isfinite(point).all() else None


def _number(value: float, digits: int) -> float | None:
    """Rounded, None when not finite."""
    return round(value, digits) if math.isfinite(value) else None


def ring_series(document: Mapping[str, Any]) -> list[RingSeries]:
    """Series of a document in mm; those without a measured ring are left out.

    Rings that were not measured at the ends are no part of a series; those inside are told by `pith_years`, those
    outside by `unmeasured_outer`. The document must have a scale.
    """
    series = [_ring_series(path, float(document["pixel_size_mm"])) for path in document["paths"]]
    return [one for one in series if one is not None]


def _ring_series(path: Mapping[str, Any], pixel_size_mm: float) -> RingSeries | None:
    """One path as a series."""
    measured = [k for k, ring in enumerate(path["rings"]) if ring["width_mm"] is not None and not ring["absent"]]
    if not measured:
        return None
    # Absent rings after the last measured one are known, and stay.
    end = max(k for k, ring in enumerate(path["rings"]) if ring["width_mm"] is not None) + 1
    rings, before, after = path["rings"][measured[0] : end], measured[0], len(path["rings"]) - end
    columns = {
        name: np.array([math.nan if ring[name] is None else ring[name] for ring in rings], np.float64)
        for name in ("width_mm", "earlywood_mm", "latewood_mm", "confidence")
    }
    has_latewood = bool(np.isfinite(columns["latewood_mm"]).any())
    pith, unmeasured = path["pith"], path["unmeasured_outer"]
    distance = years = None
    if pith is not None:
        inner = path["boundaries"][rings[0]["inner"]]
        distance = math.dist((inner["x"], inner["y"]), pith["xy"]) * pixel_size_mm
        years = None if pith["years"] is None else pith["years"] + before
    return RingSeries(
        path["name"],
        columns["width_mm"],
        rings[0]["year"],
        columns["earlywood_mm"] if has_latewood else None,
        columns["latewood_mm"] if has_latewood else None,
        columns["confidence"],
        {k: "; ".join(ring["remarks"]) for k, ring in enumerate(rings) if ring["remarks"]},
        pith_distance_mm=None if distance is None else round(distance, 4),
        pith_years=years,
        pith=None if pith is None else pith["on_sample"],
        unmeasured_outer=None if unmeasured is None else unmeasured + after,
    )
