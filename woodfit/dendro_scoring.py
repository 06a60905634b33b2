"""How good ring boundaries are along labelled paths, as dendrochronologists judge it.

Image frame: x right, y down, px, pixel centres at integers. A polyline is an array (n, 2) of x, y; a closed one repeats
its first point at the end. Labelled paths are read by :class:`woodfit.labelled_path.LabelledPath`. Figures of nothing
are NaN, so that they never pass for good ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from woodfit.labelled_path import LabelledPath
from woodfit.matching import (
    Counts,
    Crossings,
    Matching,
    locate_crossings,
    match_boundaries,
    neighbour_tolerance,
    share,
)

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

FINE_TOLERANCE_MM = 0.1
RELIABILITY_EDGES = (0.0, 0.5, 0.7, 0.9, 1.0)


# --- one labelled path --------------------------------------------------------------------------------------
@dataclass(frozen=True)
class PathComparison:
    """Traced boundaries against labelled ones along a path; adds up over paths and images.

    Parameters
    ----------
    counts
        Matched, missed and false within the tolerance in px.
    fine
        The same within the smaller of 0.1 mm and a quarter of the smaller neighbouring ring, never under 1 px; all
        zero when there is no scale.
    error_px, error_mm
        Traced minus labelled position along the path of the paired boundaries (nearer than a quarter of the smaller
        neighbouring ring, never under 1 px: not cut off at the tolerance); mm only where the scale is known.
    width_px, width_mm
        Labelled and traced width of the rings whose two boundaries are paired with nothing traced between, shape
        (n, 2), along the path.
    series_px
        Labelled and traced widths (n, 2) as a dated series has them before anyone corrects it: counted inwards from the
        outermost boundary, so that one missed ring shifts all inside of it. Empty where the label does not tell which
        way age grows.
    missed, false
        Rings, by year or number, whose outer boundary was not found, and in which a boundary is that should not be.
    confidence, right
        Of every traced boundary that was judged: its confidence, and whether a label is there.
    """

    counts: Counts = field(default_factory=Counts)
    fine: Counts = field(default_factory=Counts)
    error_px: Floats = field(default_factory=lambda: np.empty(0))
    error_mm: Floats = field(default_factory=lambda: np.empty(0))
    width_px: Floats = field(default_factory=lambda: np.empty((0, 2)))
    width_mm: Floats = field(default_factory=lambda: np.empty((0, 2)))
    series_px: Floats = field(default_factory=lambda: np.empty((0, 2)))
    missed: tuple[int, ...] = ()
    false: tuple[int, ...] = ()
    confidence: Floats = field(default_factory=lambda: np.empty(0))
    right: Bools = field(default_factory=lambda: np.empty(0, dtype=bool))

    def __add__(self, other: PathComparison) -> PathComparison:
        joined: dict[str, Any] = {}
        for item in fields(self):
            a, b = getattr(self, item.name), getattr(other, item.name)
            joined[item.name] = np.concatenate([a, b]) if isinstance(a, np.ndarray) else a + b
        return PathComparison(**joined)

    def figures(self) -> dict[str, float]:
        """Figures by name; those in mm and ``fine_*`` are NaN without a scale."""
        fine = {f"fine_{name}": value for name, value in self.fine.scores().items()}
        width = self.width_mm if len(self.width_mm) else self.width_px
        return {
            "boundaries": float(self.counts.matched + self.counts.missed),
            **self.counts.scores(),
            **{name: fine[name] if sum_of(self.fine) else float("nan") for name in fine},
            "position_median_px": _quantile(self.error_px, 0.5),
            "position_p95_px": _quantile(self.error_px, 0.95),
            "position_median_mm": _quantile(self.error_mm, 0.5),
            "position_p95_mm": _quantile(self.error_mm, 0.95),
            "position_bias_px": float(self.error_px.mean()) if len(self.error_px) else float("nan"),
            "widths": float(len(width)),
            "width_r": correlation(width[:, 0], width[:, 1]),
            "width_rmse_px": _rms(self.width_px[:, 1] - self.width_px[:, 0]),
            "width_rmse_mm": _rms(self.width_mm[:, 1] - self.width_mm[:, 0]),
            "series_r": correlation(self.series_px[:, 0], self.series_px[:, 1]),
        }


def compare_path(
    polylines: Sequence[ArrayLike],
    path: Mapping[str, Any],
    tolerance_px: float = 3.0,
    pixel_size_mm: float | None = None,
    confidence: Sequence[ArrayLike] | None = None,
) -> PathComparison:
    """Traced polylines against one labelled path.

    Parameters
    ----------
    polylines
        Arrays (n, 2) of x, y.
    path
        The label, see the head of this module.
    tolerance_px
        How far along the path from a label still is a hit.
    pixel_size_mm
        mm per px, None when unknown.
    confidence
        Of each polyline: one number, or one for each of its vertices; None when there is none.

    Raises
    ------
    KeyError, ValueError
        The label lacks a key or contradicts itself.
    """
    label = LabelledPath.read(path)
    crossings, outside = _crossings_near(polylines, label, tolerance_px)
    found = crossings.position

    def matched(tolerance: Floats) -> Matching:
        return match_boundaries(label.position, found, tolerance, label.uncertain, outside)

    main = matched(np.full(len(label.position), tolerance_px))
    quarter = neighbour_tolerance(label.position, np.inf, least_px=1.0)
    paired = matched(np.where(np.isfinite(quarter), quarter, tolerance_px)).pairs
    error = np.array([found[j] - label.position[i] for i, j in paired], dtype=float)
    widths = _bracketed_widths(label.position, found, paired)
    known = pixel_size_mm is not None and np.isfinite(pixel_size_mm) and pixel_size_mm > 0
    scale = float(pixel_size_mm) if known and pixel_size_mm is not None else float("nan")
    fine = neighbour_tolerance(label.position, FINE_TOLERANCE_MM / scale, least_px=1.0) if known else None
    judged = sorted([(j, True) for _, j in main.pairs] + [(j, False) for j in main.false])
    belief = _confidence_at(crossings, confidence)
    missed = [label.number[i] for i in main.missed if np.isfinite(label.number[i])]
    false = [label.ring_at(float(found[j])) for j in main.false]
    return PathComparison(
        counts=main.counts,
        fine=Counts() if fine is None else matched(fine).counts,
        error_px=error,
        error_mm=error * scale if known else np.empty(0),
        width_px=widths,
        width_mm=widths * scale if known else np.empty((0, 2)),
        series_px=_series_widths(label, found),
        missed=tuple(int(number) for number in missed),
        false=tuple(number for number in false if number is not None),
        confidence=np.array([belief[j] for j, _ in judged], dtype=float),
        right=np.array([right for _, right in judged], dtype=bool),
    )


def _crossings_near(
    polylines: Sequence[ArrayLike], label: LabelledPath, tolerance_px: float
) -> tuple[Crossings, Bools]:
    """Crossings in the labelled part and just outside of it, and which of them are outside."""
    every = locate_crossings(polylines, label.start, label.end)
    near = (every.position >= label.low - tolerance_px) & (every.position <= label.high + tolerance_px)
    kept = Crossings(every.position[near], every.polyline[near], every.vertex[near])
    return kept, (kept.position < label.low) | (kept.position > label.high)


def _bracketed_widths(truth: Floats, found: Floats, pairs: Sequence[tuple[int, int]]) -> Floats:
    """Labelled and traced widths (n, 2) of rings whose boundaries are paired next to each other in both."""
    widths = [
        (truth[i2] - truth[i1], found[j2] - found[j1])
        for (i1, j1), (i2, j2) in pairwise(pairs)
        if i2 == i1 + 1 and j2 == j1 + 1
    ]
    return np.array(widths, dtype=float).reshape(-1, 2)


def _series_widths(label: LabelledPath, found: Floats) -> Floats:
    """Labelled and traced widths (n, 2), the outermost first and then counted inwards, right or wrong.

    An uncertain boundary counts as labelled when something was traced at it.
    """
    if not label.outwards or len(label.position) < 2 or not len(found):
        return np.empty((0, 2))
    near = neighbour_tolerance(label.position, np.inf, least_px=1.0)
    seen = np.abs(label.position[:, None] - found).min(axis=1) <= near
    kept = ~label.uncertain | seen
    truth, near = label.position[kept], near[kept]
    if len(truth) < 2:
        return np.empty((0, 2))
    traced = found[(found >= truth[0] - near[0]) & (found <= truth[-1] + near[-1])]
    order = -label.outwards
    sides = [np.abs(np.diff(places[::order])) for places in (truth, traced)]
    count = min(len(side) for side in sides)
    return np.stack([side[:count] for side in sides], axis=-1)


def _confidence_at(crossings: Crossings, confidence: Sequence[ArrayLike] | None) -> Floats:
    """Confidence at each crossing, shape (n,); NaN without any."""
    if confidence is None:
        return np.full(len(crossings.position), np.nan)
    values = []
    for number, vertex in zip(crossings.polyline, crossings.vertex, strict=True):
        of_line = np.atleast_1d(np.asarray(confidence[number], dtype=float))
        values.append(float(np.interp(vertex, np.arange(len(of_line)), of_line)))
    return np.array(values, dtype=float)


# --- is confidence worth its name ---------------------------------------------------------------------------
def confidence_pairs(
    polylines: Sequence[ArrayLike],
    confidence: Sequence[ArrayLike],
    paths: Mapping[str, Any] | Iterable[Mapping[str, Any]],
    tolerance_px: float = 3.0,
) -> tuple[Floats, Bools]:
    """Confidence of every traced boundary that crosses a labelled path, and whether it is right.

    What is found at an uncertain label or outside the labelled part of a path is left out; a second boundary at a
    label that is already taken is wrong.

    Parameters
    ----------
    polylines
        Arrays (n, 2) of x, y.
    confidence
        For each polyline one number, or one for each of its vertices (then interpolated at the crossing).
    paths
        One labelled path or several.
    tolerance_px
        How far along the path from a label still is right.

    Returns
    -------
    confidence : float array of shape (k,)
    right : bool array of shape (k,)
    """
    several = [paths] if isinstance(paths, Mapping) else paths
    every = sum((compare_path(polylines, path, tolerance_px, None, confidence) for path in several), PathComparison())
    return every.confidence, every.right


def reliability(confidence: Floats, right: Bools, edges: Sequence[float] = RELIABILITY_EDGES) -> list[dict[str, float]]:
    """Share of right boundaries for each range of confidence, lower edge excluded but for the first.

    One mapping for each range: ``above``, ``up_to``, ``boundaries``, ``right`` (counts), ``share`` (right of all) and
    ``confidence`` (the mean; a calibrated confidence equals the share).
    """
    rows = []
    for number, (low, high) in enumerate(pairwise(edges)):
        inside = (confidence <= high) & ((confidence > low) | ((number == 0) & (confidence >= low)))
        count = int(inside.sum())
        good = int(right[inside].sum())
        mean = float(confidence[inside].mean()) if count else float("nan")
        rows.append(
            {
                "above": low,
                "up_to": high,
                "boundaries": float(count),
                "right": float(good),
                "share": share(good, count),
                "confidence": mean,
            }
        )
    return rows


# --- small figures ------------------------------------------------------------------------------------------
def correlation(a: Floats, b: Floats) -> float:
    """Pearson correlation; NaN for fewer than three values or one that never changes."""
    if len(a) < 3 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


def sum_of(counts: Counts) -> int:
    """All that was counted."""
    return counts.matched + counts.missed + counts.false


def _quantile(error: Floats, at: float) -> float:
    return float(np.quantile(np.abs(error), at)) if len(error) else float("nan")


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2))) if len(error) else float("nan")
