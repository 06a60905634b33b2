"""Where a measurement path crosses the ring boundaries, and how wide the rings are there.

Everything is in scan px, image frame. A path runs from the inside of the tree to its outside once `outward_parts` has
looked at it; widths are taken at right angles to the boundaries, so a path that meets them slantwise measures the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Boundaries:
    """Traced ring boundaries.

    Parameters
    ----------
    lines : sequence of float arrays of shape (K, 2)
        x, y of the vertices in scan px; closed ones do not repeat their first point.
    index, group : int arrays of shape (R,)
        Ring index, growing outwards, and the group within which indices compare.
    closed : bool array of shape (R,)
        Whether a line returns to its start.
    confidence : float array of shape (R,)
        0..1.
    """

    lines: Sequence[FloatArray]
    index: IntArray
    group: IntArray
    closed: BoolArray
    confidence: FloatArray

    def loop(self, line: int) -> FloatArray:
        """Vertices of a line, the first one repeated at the end if it is closed."""
        points = self.lines[line]
        return np.concatenate([points, points[:1]]) if self.closed[line] and len(points) > 2 else points


@dataclass(frozen=True)
class Crossings:
    """Where one path meets boundaries, in order along it.

    Parameters
    ----------
    position : float array of shape (n,)
        Way along the path from its start, px.
    point : float array of shape (n, 2)
        x, y in px.
    angle : float array of shape (n,)
        Outward normal of the boundary, rad from +x towards +y.
    line : int array of shape (n,)
        Which boundary; -1 for the pith.
    place : float array of shape (n,)
        Way along that boundary from its first vertex, px.
    index, group : int arrays of shape (n,)
        Of the boundary.
    confidence : float array of shape (n,)
        0..1.
    beside : bool array of shape (n,)
        True where the path itself misses the boundary, which was seen beside it.
    """

    position: FloatArray
    point: FloatArray
    angle: FloatArray
    line: IntArray
    place: FloatArray
    index: IntArray
    group: IntArray
    confidence: FloatArray
    beside: BoolArray

    def __len__(self) -> int:
        return len(self.position)

    def take(self, which: npt.NDArray[np.intp] | BoolArray) -> Crossings:
        """Some of the crossings."""
        return Crossings(**{name: getattr(self, name)[which] for name in self.__dataclass_fields__})


def path_length(path: FloatArray) -> FloatArray:
    """Way from the start to each vertex, px; shape (P,)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])


def point_at(path: FloatArray, position: FloatArray) -> FloatArray:
    """Points (..., 2) of a polyline at ways (...) from its start, px; its ends beyond them."""
    way = path_length(path)
    return np.stack([np.interp(position, way, path[:, 0]), np.interp(position, way, path[:, 1])], axis=-1)


def clip_path(path: FloatArray, start: float, end: float) -> FloatArray:
    """Part of a polyline between two ways from its start, px."""
    way = path_length(path)
    inner = path[(way > start) & (way < end)]
    return np.concatenate([point_at(path, np.array([start])), inner, point_at(path, np.array([end]))])


def tangent_at(points: FloatArray, place: float, reach_px: float, closed: bool) -> FloatArray:
    """Unit tangent of a polyline about a way along it, from the line that fits best within `reach_px` to both sides."""
    way = path_length(points)
    if closed:
        length = way[-1]
        points = np.concatenate([points[:-1], points[:-1], points])
        way = np.concatenate([way[:-1] - length, way[:-1], way + length])
    near = np.flatnonzero(np.abs(way - place) <= reach_px)
    if len(near) < 2:
        after = int(np.clip(np.searchsorted(way, place), 1, len(way) - 1))
        near = np.array([after - 1, after])
    offset = points[near] - points[near].mean(axis=0)
    tangent = np.linalg.svd(offset, full_matrices=False)[2][0]
    along = points[near[-1]] - points[near[0]]
    return np.asarray(tangent if tangent @ along >= 0.0 else -tangent)


def cross(path: FloatArray, boundaries: Boundaries, growth_rad: FloatArray, reach_px: FloatArray) -> Crossings:
    """Every crossing of a path with any boundary, in order along the path.

    Parameters
    ----------
    path : array of shape (P, 2)
        x, y in scan px.
    boundaries : Boundaries
        What may be crossed.
    growth_rad : array of shape (V,)
        Outward direction of growth at every vertex, all lines one after the other.
    reach_px : array of shape (R,)
        How far along each boundary its direction is fitted, to both sides.

    Returns
    -------
    Crossings
    """
    loops = [boundaries.loop(i) for i in range(len(boundaries.lines))]
    first_vertex = np.cumsum([0, *(len(line) for line in boundaries.lines)])
    rows: list[tuple[float, float, float, float, int, float]] = []
    way = path_length(path)
    for number, loop in enumerate(loops):
        along = path_length(loop)
        for start, end, passed in zip(path[:-1], path[1:], way[:-1], strict=True):
            length = float(np.hypot(*(end - start)))
            if length == 0.0:
                continue
            step = (end - start) / length
            offset = loop - start
            position, side = offset @ step, step[0] * offset[:, 1] - step[1] * offset[:, 0]
            # Half-open, so that a vertex on the path gives one crossing and not two or none.
            for i in np.flatnonzero((side[:-1] < 0) != (side[1:] < 0)):
                share = side[i] / (side[i] - side[i + 1])
                here = float(position[i] + share * (position[i + 1] - position[i]))
                last = passed + length >= way[-1]
                if not (0.0 <= here < length or (last and here == length)):
                    continue
                place = float(along[i] + share * (along[i + 1] - along[i]))
                tangent = tangent_at(loop, place, float(reach_px[number]), bool(boundaries.closed[number]))
                grows = growth_rad[first_vertex[number] + min(int(i), len(boundaries.lines[number]) - 1)]
                normal = np.array([tangent[1], -tangent[0]])
                normal = normal if normal @ [np.cos(grows), np.sin(grows)] >= 0.0 else -normal
                x, y = start + here * step
                rows.append((passed + here, float(x), float(y), float(np.arctan2(normal[1], normal[0])), number, place))
    rows.sort()
    table = np.array([row[:4] + row[5:] for row in rows], np.float64).reshape(-1, 5)
    line = np.array([row[4] for row in rows], np.int64)
    return Crossings(
        position=table[:, 0],
        point=table[:, 1:3],
        angle=table[:, 3],
        line=line,
        place=table[:, 4],
        index=boundaries.index[line],
        group=boundaries.group[line],
        confidence=boundaries.confidence[line],
        beside=np.zeros(len(line), np.bool_),
    )


def outward_parts(path: FloatArray, found: Crossings) -> list[FloatArray]:
    """The path turned so that it runs outwards; two paths when it runs through the pith and out again.

    Parameters
    ----------
    path : array of shape (P, 2)
        As drawn.
    found : Crossings
        Its crossings; their normals point outwards.

    Returns
    -------
    list of one or two arrays of shape (P, 2)
    """
    if len(found) == 0:
        return [path]
    ahead = point_at(path, found.position + 1.0) - point_at(path, found.position - 1.0)
    outwards = np.cos(found.angle) * ahead[:, 0] + np.sin(found.angle) * ahead[:, 1] >= 0.0
    forward, backward = int((~outwards).sum()), int(outwards.sum())
    # Misfits when the path goes inwards over the first m crossings and outwards after them.
    misfits = np.concatenate([[0], np.cumsum(outwards)]) + np.concatenate([np.cumsum(~outwards[::-1])[::-1], [0]])
    middle = int(misfits.argmin())
    # A few crossings with a wrong direction are not yet a pith.
    if misfits[middle] + 2 < min(forward, backward):
        turn = 0.5 * float(found.position[middle - 1] + found.position[middle])
        end = float(path_length(path)[-1])
        return [clip_path(path, 0.0, turn)[::-1], clip_path(path, turn, end)]
    return [path if forward <= backward else path[::-1]]


def in_order(found: Crossings) -> Crossings:
    """Crossings of the group that the path shows most of, one for each index, indices growing along the path.

    Where pieces disagree (a jagged line crossed three times, a wrong index) the surest increasing sequence is kept.
    """
    if len(found) == 0:
        return found
    weight = found.confidence + 0.2
    names = np.unique(found.group)
    mass = [float(weight[found.group == name].sum()) for name in names]
    own = found.take(found.group == names[int(np.argmax(mass))])
    return own.take(increasing(own.index, own.confidence + 0.2))


def increasing(index: IntArray, weight: FloatArray) -> npt.NDArray[np.intp]:
    """Places of the strictly increasing sequence of greatest weight."""
    best, before = weight.copy(), np.full(len(index), -1)
    for i in range(1, len(index)):
        sums = np.where(index[:i] < index[i], best[:i], -np.inf)
        if sums.max() > -np.inf:
            before[i] = int(sums.argmax())
            best[i] = weight[i] + sums.max()
    chain = [int(best.argmax())]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1], np.intp)
