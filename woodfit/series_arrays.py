"""Measured series as flat arrays, the form in which they are kept: everything of one kind in one row, and counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.measured import Measured
from woodfit.measuring import point_at

Array = npt.NDArray[Any]

#: Samples across each ring in the table of straightened rings.
FRACTIONS = 64


@dataclass(frozen=True)
class SeriesArrays:
    """All series of a scan; scan px, image frame.

    Fields that start with ``path_`` have one entry for each vertex of all paths one after the other (``path_count``
    of them for each series), ``crossing_`` for each boundary crossed (``crossing_count``), ``series_ring_`` for each
    ring from the inside out (``series_ring_count``), ``gap_`` for each gap, ``series_`` for each series.
    """

    path_x: Array
    path_y: Array
    path_count: Array
    series_kind: Array
    series_bearing: Array
    crossing_x: Array
    crossing_y: Array
    crossing_angle: Array
    crossing_index: Array
    crossing_group: Array
    crossing_confidence: Array
    crossing_beside: Array
    crossing_pith: Array
    crossing_count: Array
    series_ring_index: Array
    series_ring_inner: Array
    series_ring_outer: Array
    series_ring_width: Array
    earlywood_width: Array
    latewood_width: Array
    latewood_onset: Array
    onset_sureness: Array
    measure_x: Array
    measure_y: Array
    lateness_table: Array
    series_ring_count: Array
    gap_series: Array
    gap_x: Array
    gap_y: Array
    gap_boundaries: Array
    series_unfit: Array
    series_inner_rest: Array
    series_outer_rest: Array
    pith_on_sample: Array
    pith_x: Array
    pith_y: Array
    pith_distance: Array
    pith_years: Array

    def __len__(self) -> int:
        return len(self.path_count)

    def parts(self) -> Iterator[dict[str, Array]]:
        """Every series by itself: its values under the names of the fields."""
        ends = {name: np.cumsum(getattr(self, f"{name}_count")) for name in ("path", "crossing", "series_ring")}
        for k in range(len(self)):
            cut = {
                name: slice(int(end[k] - getattr(self, f"{name}_count")[k]), int(end[k])) for name, end in ends.items()
            }
            part: dict[str, Array] = {}
            for field in fields(self):
                values, dim = getattr(self, field.name), _dim(field.name)
                if dim == "gap":
                    part[field.name] = values[self.gap_series == k]
                else:
                    part[field.name] = values[cut[dim]] if dim in cut else values[k]
            yield part


_RING_FIELDS = {"earlywood_width", "latewood_width", "latewood_onset", "onset_sureness"} | {
    "measure_x",
    "measure_y",
    "lateness_table",
}


def _dim(name: str) -> str:
    """Dimension of a field."""
    if name.endswith("_count"):
        return "series"
    if name in _RING_FIELDS or name.startswith("series_ring_"):
        return "series_ring"
    first = name.partition("_")[0]
    return first if first in ("path", "crossing", "gap") else "series"


def pack(series: Sequence[Measured], late_is_dark: bool) -> SeriesArrays:
    """Flat arrays of measured series; lateness in the table is darkness or, in ring-porous wood, lightness."""

    def joined(parts: list[Array], like: Any, *shape: int) -> Array:
        return np.concatenate([np.zeros((0, *shape), like), *parts]).astype(like)

    def each(values: list[Any], like: Any) -> Array:
        return np.array(values, like).reshape(len(series))

    width = [one.rings.width_px for one in series]
    early = [one.onsets.fraction * one.rings.width_px for one in series]
    gaps = [(k, one, gap) for k, one in enumerate(series) for gap in one.gaps]
    gap_ends = np.array([point_at(one.route.points, np.array([g.start, g.end])) for _, one, g in gaps])
    gap_ends = gap_ends.reshape(-1, 2, 2)
    pith = [one.pith for one in series]
    profiles = [one.straight.profile if late_is_dark else 1.0 - one.straight.profile for one in series]
    lines = [np.stack([one.rings.start, one.rings.end], axis=1) for one in series]
    return SeriesArrays(
        path_x=joined([one.route.points[:, 0] for one in series], float),
        path_y=joined([one.route.points[:, 1] for one in series], float),
        path_count=each([len(one.route.points) for one in series], np.int64),
        series_kind=each([int(one.route.kind) for one in series], np.int64),
        series_bearing=each([one.route.bearing_deg for one in series], float),
        crossing_x=joined([one.found.point[:, 0] for one in series], float),
        crossing_y=joined([one.found.point[:, 1] for one in series], float),
        crossing_angle=joined([one.found.angle for one in series], float),
        crossing_index=joined([one.found.index for one in series], np.int64),
        crossing_group=joined([one.found.group for one in series], np.int64),
        crossing_confidence=joined([one.found.confidence for one in series], float),
        crossing_beside=joined([one.found.beside for one in series], np.bool_),
        crossing_pith=joined([one.found.line < 0 for one in series], np.bool_),
        crossing_count=each([len(one.found) for one in series], np.int64),
        series_ring_index=joined([one.rings.index for one in series], np.int64),
        series_ring_inner=joined([one.rings.inner for one in series], np.int64),
        series_ring_outer=joined([one.rings.outer for one in series], np.int64),
        series_ring_width=joined(width, float),
        earlywood_width=joined(early, float),
        # What is left, so that the parts make the whole exactly.
        latewood_width=joined([w - e for w, e in zip(width, early, strict=True)], float),
        latewood_onset=joined([one.onsets.fraction for one in series], float),
        onset_sureness=joined([one.onsets.sureness for one in series], float),
        measure_x=joined([line[..., 0] for line in lines], float, 2),
        measure_y=joined([line[..., 1] for line in lines], float, 2),
        lateness_table=joined(profiles, np.float32, FRACTIONS),
        series_ring_count=each([len(one.rings) for one in series], np.int64),
        gap_series=np.array([k for k, _, _ in gaps], np.int64),
        gap_x=gap_ends[..., 0],
        gap_y=gap_ends[..., 1],
        gap_boundaries=np.array([gap.boundaries for _, _, gap in gaps], np.int64),
        series_unfit=each([one.unfit for one in series], np.int64),
        series_inner_rest=each([one.inner_rest_px for one in series], float),
        series_outer_rest=each([one.outer_rest_px for one in series], float),
        pith_on_sample=each([one is not None and one.on_sample for one in pith], np.bool_),
        pith_x=each([np.nan if one is None else one.x for one in pith], float),
        pith_y=each([np.nan if one is None else one.y for one in pith], float),
        pith_distance=np.array(
            [(np.nan,) * 3 if one is None else (one.distance_px, one.least_px, one.most_px) for one in pith], float
        ).reshape(len(series), 3),
        pith_years=each([-1 if one is None or one.years is None else one.years for one in pith], np.int64),
    )
