"""Measured series as the plots want them, from the document that ``series.json`` holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.report.series_plots import DrawnSeries

Array = npt.NDArray[Any]


def drawn_series(document: Mapping[str, Any]) -> list[DrawnSeries]:
    """Series of a document (docs/series_json.md) that have rings."""
    unit = "px" if document["pixel_size_mm"] is None else "mm"
    return [_drawn(path, unit) for path in document["paths"] if path["rings"]]


def _drawn(path: Mapping[str, Any], unit: str) -> DrawnSeries:
    rings, boundaries = path["rings"], path["boundaries"]
    dated = rings[0]["year"] is not None
    # Without years a ring has the number of the boundary that ends it, the same on every path that counting ties.
    numbers = np.array([ring["year"] for ring in rings] if dated else np.arange(len(rings)) + boundaries[0]["id"] + 1)
    labels: list[int | None] = [None] * len(boundaries)
    for ring, number in zip(rings, numbers, strict=True):
        if ring["outer"] is not None:
            labels[ring["outer"]] = int(number)
    onsets = [ring["latewood_onset"] for ring in rings]
    return DrawnSeries(
        name=path["name"],
        path=np.array(path["points"], float).reshape(-1, 2),
        boundaries=np.array([(one["x"], one["y"]) for one in boundaries], float).reshape(-1, 2),
        normal_rad=_column([one["angle_rad"] for one in boundaries]),
        labels=tuple(labels),
        confidence=_column([one["confidence"] for one in boundaries]),
        years=numbers,
        dated=dated,
        width=_column([ring[f"width_{unit}"] for ring in rings]),
        earlywood=_column([ring[f"earlywood_{unit}"] for ring in rings]),
        latewood=_column([ring[f"latewood_{unit}"] for ring in rings]),
        unit=unit,
        table=_table(rings, path["lateness_table"]),
        onset=_column([None if onset is None else onset["fraction"] for onset in onsets]),
    )


def _column(values: list[float | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values], float)


def _table(rings: list[Mapping[str, Any]], table: Mapping[str, Any] | None) -> Array | None:
    """Lateness of each ring, (n, fractions), NaN for rings that were not seen; absent ones have no row in the file."""
    if table is None:
        return None
    rows = iter(table["rings"])
    blank = np.full(int(table["fractions"]), np.nan)
    found = [None if ring["absent"] else next(rows, None) for ring in rings]
    return np.stack([blank if row is None else np.array(row, float) for row in found])
