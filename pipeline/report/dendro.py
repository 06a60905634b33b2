"""The section on measured series: the paths on the photograph with their years, widths, and latewood."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.report.axes import linear_bar
from pipeline.report.labels import Name, place_labels
from pipeline.report.palettes import ring_color
from pipeline.report.pictures import jpeg
from pipeline.report.reading import Frame, Scan
from pipeline.report.rings import UNSURE, shown_size
from pipeline.report.series_plots import TRANSITION_MAP, DrawnSeries, spaghetti_plot, transition_plot, widths_plot

Array = npt.NDArray[Any]

_WIDE_PX, _NARROW_PX = 1040.0, 340.0

#: Half the length of a boundary's mark on a path, screen px.
_MARK_PX = 7.0
# Years stand beside their mark: this far from the path at least and at most, screen px.
_BESIDE_PX = (14.0, 46.0)


def dendro_section(scan: Scan, all_series: Sequence[DrawnSeries]) -> dict[str, Any] | None:
    """Everything about the measured series.

    Parameters
    ----------
    scan
        For its photograph.
    all_series
        What was measured, with at least one ring each.

    Returns
    -------
    dict or None
        For the page's template; ``None`` when nothing was measured.
    """
    if not all_series:
        return None
    return {
        "overlay": paths_overlay(scan, all_series),
        "series": [
            {
                "name": one.name,
                "words": _words(one),
                "widths": widths_plot(one, f"series{number}"),
                "transition": transition_plot(one, f"transition{number}"),
            }
            for number, one in enumerate(all_series)
        ],
        "spaghetti": spaghetti_plot(all_series, "spaghetti") if len(all_series) > 1 else None,
        "bar": linear_bar(TRANSITION_MAP, 0.0, 1.0, ""),
        "dated": all(one.dated for one in all_series),
    }


def paths_overlay(scan: Scan, all_series: Sequence[DrawnSeries]) -> dict[str, Any] | None:
    """The photograph with every path, a mark where it crosses a boundary, and the years; ``None`` without one."""
    photograph, frame = scan.photograph(), scan.frame
    if photograph is None or frame is None:
        return None
    shown = shown_size(frame)
    wide_px = shown["most"] if shown["most"] < _WIDE_PX else max(_WIDE_PX, shown["least"])
    names = ", ".join(one.name for one in all_series)
    return {
        "shown": shown,
        "frame": frame,
        "picture": jpeg(photograph, f"Photograph with the measurement paths {names} and the years of the rings.", 86),
        "paths": ["M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in one.path) for one in all_series],
        "marks": [mark for one in all_series for mark in boundary_marks(one, _MARK_PX * frame.width / wide_px)],
        "wide": [label for one in all_series for label in _labels(one, frame, wide_px)],
        "narrow": [label for one in all_series for label in _labels(one, frame, min(_NARROW_PX, shown["most"]))],
    }


def boundary_marks(series: DrawnSeries, half: float) -> list[dict[str, Any]]:
    """Short lines along the boundaries where the path crosses them.

    Parameters
    ----------
    series
        With its boundaries.
    half
        Half a mark's length, scan px.

    Returns
    -------
    list of dict
        SVG path, color, whether unsure, and a title each.
    """
    along = _tangents(series)
    word = "year" if series.dated else "ring"
    marks = []
    for (x, y), (u, v), label, confidence in zip(
        series.boundaries, along * half, series.labels, series.confidence, strict=True
    ):
        name = f"{series.name}, end of {word} {label}" if label is not None else f"{series.name}, ends no measured ring"
        marks.append(
            {
                "path": f"M{x - u:.1f} {y - v:.1f}L{x + u:.1f} {y + v:.1f}",
                "color": ring_color(label or 0),
                "unsure": bool(confidence < UNSURE),
                "title": f"{name}, confidence {confidence:.2f}",
            }
        )
    return marks


def _tangents(series: DrawnSeries) -> Array:
    """Unit vectors along the boundaries, (c, 2); across the path where their normal is not known."""
    if not len(series.boundaries):
        return np.empty((0, 2))
    steps = np.diff(series.path, axis=0)
    middles = 0.5 * (series.path[1:] + series.path[:-1])
    nearest = np.argmin(np.hypot(*(series.boundaries[:, None] - middles).transpose(2, 0, 1)), axis=1)
    angle = np.arctan2(steps[nearest, 1], steps[nearest, 0])
    angle = np.where(np.isfinite(series.normal_rad), series.normal_rad, angle) + 0.5 * np.pi
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _labels(series: DrawnSeries, frame: Frame, width_px: float) -> list[dict[str, Any]]:
    unit = frame.width / width_px
    beside = np.linspace(*_BESIDE_PX, 12) * unit
    beside = np.concatenate([beside, -beside])
    lines: dict[Name, list[Array]] = {
        (label, ""): [point + beside[:, None] * along]
        for point, along, label in zip(series.boundaries, _tangents(series), series.labels, strict=True)
        if label is not None
    }
    extent = (frame.left, frame.top, frame.width, frame.height)
    return [
        {
            "text": str(label.name[0]),
            "left": f"{100 * (label.x - frame.left) / frame.width:.2f}",
            "top": f"{100 * (label.y - frame.top) / frame.height:.2f}",
            "color": ring_color(label.name[0]),
        }
        for label in place_labels(lines, extent, unit)
    ]


def _words(series: DrawnSeries) -> str:
    """The series in a sentence."""
    known = series.width[np.isfinite(series.width)]
    what = f"{series.years[0]}\u2013{series.years[-1]}, " if series.dated else ""
    words = f"{what}{len(series.years)} rings"
    if len(known):
        words += f", mean width {known.mean():.3g} {series.unit}"
    doubtful = int((series.confidence < UNSURE).sum())
    return words + (f", {doubtful} boundaries unsure" if doubtful else "")
