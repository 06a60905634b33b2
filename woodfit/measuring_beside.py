"""Boundaries that end before a path reaches them: a crack, a knot, a gap in the tracing.

Rings are long. Where the path itself misses one of its boundaries, the same boundary is often seen beside it, between
the same neighbours, and tells where it would lie on the path.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from woodfit.measuring import Boundaries, Crossings, increasing, path_length, point_at

FloatArray = npt.NDArray[np.float64]


def with_those_beside(path: FloatArray, chosen: Crossings, boundaries: Boundaries, reach_px: float) -> Crossings:
    """Crossings with the boundaries that end before the path reaches them but lie within `reach_px` of it.

    Such a boundary is put between its crossed neighbours in the proportion in which it divides their distance where
    it was seen; beyond the last neighbour, at the distance seen.
    """
    if len(chosen) == 0:
        return chosen
    known, members = set(chosen.index.tolist()), boundaries.group == chosen.group[0]
    length = float(path_length(path)[-1])
    near = cKDTree(point_at(path, np.arange(0.0, length + 2.0, 2.0)))
    rows: list[tuple[float, float, int, float]] = []
    for index in sorted(set(boundaries.index[members].tolist()) - known):
        row = _seen_beside(near, np.flatnonzero(members & (boundaries.index == index)), chosen, boundaries, reach_px)
        if row is not None and 0.0 < row[0] < length:
            rows.append(row)
    return _merged(path, chosen, rows, boundaries)


def _seen_beside(
    near: cKDTree, pieces: npt.NDArray[np.intp], chosen: Crossings, boundaries: Boundaries, reach_px: float
) -> tuple[float, float, int, float] | None:
    """Position on the path, outward normal, line and way along it of a boundary that the path misses."""
    seen: list[tuple[float, int, int]] = []
    for line in pieces.tolist():
        points = boundaries.lines[line]
        gaps, _ = near.query(points)
        # The last vertices of a trace may already have lost the boundary.
        inner = np.arange(len(points))[3:-3] if len(points) > 9 else np.arange(len(points))
        inner = inner[gaps[inner] <= reach_px]
        seen += [(float(gaps[i]), line, int(i)) for i in inner[np.argsort(gaps[inner], kind="stable")][:200:5]]
    for _, line, vertex in sorted(seen)[:20]:
        place = _position_beside(line, vertex, chosen, boundaries)
        if place is not None:
            return (*place, line, float(path_length(boundaries.lines[line])[vertex]))
    return None


def _position_beside(line: int, vertex: int, chosen: Crossings, boundaries: Boundaries) -> tuple[float, float] | None:
    """Position on the path and outward normal for a boundary seen at a vertex; None if its neighbours are not there."""
    index = boundaries.index[line]
    after = int(np.searchsorted(chosen.index, index))
    inner, outer = after - 1, after
    gaps = [_gap(line, vertex, int(chosen.line[i]), boundaries) for i in (inner, outer) if 0 <= i < len(chosen)]
    if any(gap is None for gap in gaps):
        return None
    known = [gap for gap in gaps if gap is not None]
    if len(known) < 2:
        only = outer if inner < 0 else inner
        along = chosen.point[min(only + 1, len(chosen) - 1)] - chosen.point[max(only - 1, 0)]
        size = float(np.hypot(*along))
        normal = np.array([np.cos(chosen.angle[only]), np.sin(chosen.angle[only])])
        slant = abs(float(along @ normal)) / size if size > 0.0 else 1.0
        sign = -1.0 if inner < 0 else 1.0
        return float(chosen.position[only] + sign * known[0] / max(slant, 0.3)), float(chosen.angle[only])
    share = known[0] / (known[0] + known[1])
    turn = np.angle(np.exp(1j * (chosen.angle[outer] - chosen.angle[inner])))
    position = chosen.position[inner] + share * (chosen.position[outer] - chosen.position[inner])
    return float(position), float(chosen.angle[inner] + share * turn)


def _gap(line: int, vertex: int, neighbour: int, boundaries: Boundaries) -> float | None:
    """Way across the ring from a vertex to a neighbouring boundary; None where that one does not pass there."""
    points = boundaries.lines[line]
    point = points[vertex]
    along = points[min(vertex + 5, len(points) - 1)] - points[max(vertex - 5, 0)]
    same = (boundaries.index == boundaries.index[neighbour]) & (boundaries.group == boundaries.group[neighbour])
    offset = np.concatenate([boundaries.lines[i] for i in np.flatnonzero(same).tolist()]) - point
    nearest = offset[int((offset**2).sum(axis=1).argmin())]
    gap, length = float(np.hypot(*nearest)), float(np.hypot(*along))
    # The shortest way to a line that passes goes straight across; to one that has ended it goes slantwise.
    if gap == 0.0 or length == 0.0 or abs(float(nearest @ along)) > 0.5 * gap * length:
        return None
    return gap


def _merged(
    path: FloatArray, chosen: Crossings, rows: list[tuple[float, float, int, float]], boundaries: Boundaries
) -> Crossings:
    """Crossings and those found beside, in order; what does not fit between its neighbours by index is left out."""
    line = np.array([row[2] for row in rows], np.int64)
    position = np.array([row[0] for row in rows], np.float64)
    more = Crossings(
        position=position,
        point=point_at(path, position),
        angle=np.array([row[1] for row in rows], np.float64),
        line=line,
        place=np.array([row[3] for row in rows], np.float64),
        index=boundaries.index[line],
        group=boundaries.group[line],
        # Its place on the path is inferred.
        confidence=0.8 * boundaries.confidence[line],
        beside=np.ones(len(line), np.bool_),
    )
    both = Crossings(
        **{name: np.concatenate([getattr(chosen, name), getattr(more, name)]) for name in chosen.__dataclass_fields__}
    )
    both = both.take(np.argsort(both.position, kind="stable"))
    # What the path really crosses must not give way to what was inferred.
    return both.take(increasing(both.index, np.where(both.beside, 0.01, 1.0)))
