"""Which traced boundaries the marks of a path lie on, and which it crosses without a mark."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from woodfit.marked_path import MarkedPath
from woodfit.matching import locate_crossings, match_ordered
from woodfit.tracing import Trace

FloatArray = npt.NDArray[np.float64]

#: A mark belongs to a boundary within this many px, or this share of the smaller ring beside it if that is more.
NEAR_PX, NEAR_RINGS = 3.0, 0.25


@dataclass(frozen=True)
class Match:
    """Which line each mark of a path lies on, -1 for none, and the lines crossed without a mark, and where."""

    lines: list[int]
    unmarked: list[tuple[int, float]]


def positions_of(path: MarkedPath) -> FloatArray:
    """Way along the path to each mark; the step along a boundary between two points of one mark does not count."""
    steps = [float(np.hypot(*(b[0] - a[-1]))) for a, b in zip(path.borders[:-1], path.borders[1:], strict=True)]
    return np.concatenate([[0.0], np.cumsum(steps)])


def tolerance_of(positions: FloatArray) -> FloatArray:
    """How far from each mark its boundary may have been traced, px."""
    widths = np.diff(positions, prepend=-np.inf, append=np.inf)
    smaller = np.minimum(widths[:-1], widths[1:])
    return np.maximum(NEAR_PX, np.where(np.isfinite(smaller), NEAR_RINGS * smaller, 0.0))


def match_marks(path: MarkedPath, lines: Sequence[Trace]) -> Match:
    """Match marks with the lines that the path crosses, in order; then the rest with lines that end beside it."""
    positions = positions_of(path)
    tolerance = tolerance_of(positions)
    boxes = boxes_of(lines)
    rows: list[tuple[float, int, float]] = []
    for first, stretches in enumerate(path.stretches()):
        start = path.borders[first][-1]
        for segment in stretches:
            a, b = segment
            before = positions[first] + float(np.hypot(*(a - start)))
            rows += _crossed(lines, boxes, a, b, before)
    for border, inner, position, reach in (
        (path.borders[0][0], path.borders[min(1, len(path.borders) - 1)][0], positions[0], -tolerance[0]),
        (path.borders[-1][-1], path.borders[max(-2, -len(path.borders))][-1], positions[-1], tolerance[-1]),
    ):
        # The outermost marks may lie just inside of their boundaries.
        length = float(np.hypot(*(border - inner)))
        if length > 0.0:
            beyond = border + (border - inner) / length * abs(reach)
            met = _crossed(lines, boxes, border, beyond, 0.0)
            rows += [(position + float(np.sign(reach)) * way, line, at) for way, line, at in met]
    rows.sort()
    matched = [-1] * len(positions)
    pairs = match_ordered(positions, np.array([row[0] for row in rows]), tolerance)
    for mark, row in pairs:
        if rows[row][1] not in matched:
            matched[mark] = rows[row][1]
    inside = [row for row in rows if positions[0] < row[0] < positions[-1]]
    unmarked = {line: at for _, line, at in inside if line not in matched}
    crossed = {line for _, line, _ in rows}
    for mark in (i for i, line in enumerate(matched) if line < 0):
        beside = nearest_line(path.borders[mark][0], lines, boxes, tolerance[mark], {*crossed, *matched})
        matched[mark] = -1 if beside is None else beside
    return Match(matched, list(unmarked.items()))


def nearest_line(
    point: FloatArray, lines: Sequence[Trace], boxes: FloatArray, reach_px: float, but: Collection[int]
) -> int | None:
    """The line nearest to a point and within reach of it, `but` some; None without any."""
    near = ((boxes[:, 0] <= point + reach_px) & (boxes[:, 1] >= point - reach_px)).all(axis=1)
    free = [i for i in np.flatnonzero(near).tolist() if i not in but]
    apart = [(float(np.hypot(*(lines[i].points - point).T).min()), i) for i in free]
    return min(apart)[1] if apart and min(apart)[0] <= reach_px else None


def boxes_of(lines: Sequence[Trace]) -> FloatArray:
    """Smallest and largest x, y of each line; shape (R, 2, 2)."""
    return np.array([[t.points.min(axis=0), t.points.max(axis=0)] for t in lines]).reshape(-1, 2, 2)


def _crossed(
    lines: Sequence[Trace], boxes: FloatArray, a: FloatArray, b: FloatArray, before: float
) -> list[tuple[float, int, float]]:
    """Position, line and fractional vertex of every crossing of the segment from `a`, `before` px along the path."""
    if (a == b).all():
        return []
    apart = (boxes[:, 1] < np.minimum(a, b)) | (boxes[:, 0] > np.maximum(a, b))
    near = np.flatnonzero(~apart.any(axis=1)).tolist()
    loops = [np.concatenate([t.points, t.points[:1]]) if t.closed else t.points for t in (lines[i] for i in near)]
    met = locate_crossings(loops, a, b)
    return [
        (before + float(way), near[which], float(at))
        for way, which, at in zip(met.position, met.polyline, met.vertex, strict=True)
    ]
