"""Traces kept apart: no two boundaries on one edge, and none that cross."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.grids import nearest
from woodfit.tracing import Trace

FloatArray = npt.NDArray[np.float64]


class _Taken:
    """Lines drawn so far, and how far a new one stays from them."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._canvas = np.full(shape, 255, np.uint8)

    def draw(self, trace: Trace) -> None:
        cv2.polylines(self._canvas, [np.round(trace.points * 16).astype(np.int32)], trace.closed, 0, 1, shift=4)

    def distance(self, points: FloatArray, reach_px: float) -> FloatArray:
        """Distance from each point to the nearest line, exact up to `reach_px`."""
        height, width = self._canvas.shape
        cols = np.clip(np.round(points[:, 0]).astype(int), 0, width - 1)
        rows = np.clip(np.round(points[:, 1]).astype(int), 0, height - 1)
        margin = int(reach_px) + 3
        top, left = max(0, int(rows.min()) - margin), max(0, int(cols.min()) - margin)
        part = self._canvas[top : int(rows.max()) + margin + 1, left : int(cols.max()) + margin + 1]
        distance = cv2.distanceTransform(np.ascontiguousarray(part), cv2.DIST_L2, 5)
        return np.asarray(distance[rows - top, cols - left], np.float64)


def _surest_first(traces: list[Trace]) -> list[int]:
    return sorted(range(len(traces)), key=lambda i: (-float(traces[i].confidence.sum()), i))


def without_doubles(traces: list[Trace], frequency: npt.NDArray[Any], nearest_rings: float = 0.22) -> list[Trace]:
    """Drop a boundary most of which came to lie on a surer one, and the stretches of others that did.

    Parameters
    ----------
    traces : list of Trace
        On their edges.
    frequency : array of shape (M, N)
        Rings per pixel.
    nearest_rings : float
        How near two boundaries may be, in local ring widths.
    """
    taken = _Taken(frequency.shape)
    kept: list[Trace] = []
    for i in _surest_first(traces):
        trace = traces[i]
        if kept:
            least = nearest_rings / nearest(frequency, trace.points)
            near = taken.distance(trace.points, float(least.max())) < least
            if near.mean() > 0.5:
                continue
            if near.any() and not trace.closed:
                trace = longest_free(trace, ~near)
                if len(trace.points) < 4:
                    continue
        taken.draw(trace)
        kept.append(trace)
    return kept


def kept_apart(traces: list[Trace], shape: tuple[int, ...], least_px: float = 1.8) -> list[Trace]:
    """Traces cut where moving brought them onto a surer one: no two may cross.

    Vertices are a pixel apart and the drawn lines half a pixel off at most, so lines that cross have vertices nearer
    than `least_px`.
    """
    taken = _Taken(shape)
    kept: list[Trace] = []
    for i in _surest_first(traces):
        trace = traces[i]
        if kept:
            near = taken.distance(trace.points, least_px) < least_px
            if near.any():
                trace = longest_free(trace, ~near)
        if len(trace.points) < 4:
            continue
        taken.draw(trace)
        kept.append(trace)
    return kept


def longest_free(trace: Trace, free: npt.NDArray[np.bool_]) -> Trace:
    """Longest stretch of a trace where `free` holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], free.astype(np.int8), [0]])))
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts)) if len(starts) else 0
    part = slice(starts[longest], ends[longest]) if len(starts) else slice(0, 0)
    return Trace(trace.points[part], trace.confidence[part], False)
