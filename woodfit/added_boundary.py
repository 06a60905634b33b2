"""A boundary that a person added at one point, followed to both sides."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from woodfit.boundary import edge_offsets
from woodfit.grids import nearest
from woodfit.ring_walks import Surroundings, distance_outwards, draw_labels
from woodfit.tracing import Trace

FloatArray = npt.NDArray[np.float64]


def shift_through(trace: Trace, point: FloatArray, reach_px: float) -> Trace:
    """Trace moved so that it passes through a point near it.

    The whole step is made where the trace is nearest; along the trace it fades out, as half a cosine, within
    `reach_px` to both sides. Confidence becomes 1 in the same way.
    """
    points = trace.points
    after = np.roll(points, -1, axis=0) if trace.closed else points[1:]
    before = points[: len(after)]
    if len(after) == 0:
        return replace(trace, points=point[None, :].copy(), confidence=np.ones(1))
    chord = after - before
    share = ((point - before) * chord).sum(axis=1) / np.maximum((chord**2).sum(axis=1), 1e-12)
    feet = before + np.clip(share, 0.0, 1.0)[:, None] * chord
    at = int(np.hypot(*(feet - point).T).argmin())
    lengths = np.hypot(*chord.T)
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    start, end = way[at], way[at + 1]
    # Both ends of the nearest chord make the whole step, and so does the foot between them.
    here = way[: len(points)]
    apart = np.maximum(np.maximum(start - here, here - end), 0.0)
    if trace.closed:
        total = way[-1]
        beyond = np.maximum(np.maximum(start - here - total, here + total - end), 0.0)
        apart = np.minimum(apart, beyond)
        apart = np.minimum(apart, np.maximum(np.maximum(start + total - here, here - total - end), 0.0))
    weight = np.where(apart < reach_px, 0.5 + 0.5 * np.cos(np.pi * np.minimum(apart / reach_px, 1.0)), 0.0)
    belief = trace.confidence + weight * (1.0 - trace.confidence)
    return replace(trace, points=points + weight[:, None] * (point - feet[at]), confidence=belief)


def follow_boundary(
    point: FloatArray,
    lines: Sequence[Trace],
    inner: int | None,
    outer: int | None,
    same_as_inner: Collection[int],
    same_as_outer: Collection[int],
    strength: npt.NDArray[Any],
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
) -> Trace:
    """New boundary through a point, along its neighbours and on the edge between them.

    The longer neighbour is followed at the share of the way to the other one that the point has; from there the
    strongest continuous edge close by is taken. It ends where the neighbours do, and before it touches another line.

    Parameters
    ----------
    point : array of shape (2,)
        x, y in pixels.
    lines : sequence of Trace
        All other boundaries.
    inner, outer : int or None
        Which of `lines` are its neighbours.
    same_as_inner, same_as_outer : collections of int
        Lines that are pieces of the same rings as those.
    strength : array of shape (M, N)
        From `woodfit.boundary.edge_strength`.
    growth, frequency : arrays of shape (M, N)
        Outward direction in rad, rings per pixel.
    valid : bool array of shape (M, N)
        The wood.

    Returns
    -------
    Trace
        Through the point, with confidence 1.
    """
    sides = []
    if inner is not None:
        sides.append((inner, 1.0, same_as_outer))
    if outer is not None:
        sides.append((outer, -1.0, same_as_inner))
    made = None
    for number, sign, others in sorted(sides, key=lambda side: -len(lines[side[0]].points)):
        if made is None:
            way = _way_to(lines, number, others, sign, growth, frequency, valid) if len(sides) == 2 else None
            made = _beside(point, lines[number], sign, way, growth, frequency)
    if made is None:
        made = _along_tangent(point, growth, frequency, valid)
    base, angle, width, closed = made
    offset, _ = edge_offsets(np.asarray(strength, np.float32), base, angle, width, 0.0, 0.06, closed)
    moved = Trace(base + np.stack([np.cos(angle), np.sin(angle)], axis=1) * offset[:, None], np.ones(len(base)), closed)
    return _free(shift_through(moved, point, reach_of(float(np.median(width)))), point, lines, valid)


def reach_of(ring_width_px: float) -> float:
    """How far along a boundary a person's point is heeded, px."""
    return float(np.clip(2.0 * ring_width_px, 6.0, 60.0))


def _way_to(
    lines: Sequence[Trace],
    number: int,
    others: Collection[int],
    sign: float,
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
) -> FloatArray:
    """Way in px from each vertex of a line across the rings to one of the `others`, 0 where something else is met."""
    points = lines[number].points
    far = int(4.0 / float(np.median(nearest(frequency, points)))) + 8
    top = np.array(growth.shape)[::-1]
    low = np.clip(np.floor(points.min(axis=0)).astype(int) - far, 0, top - 1)
    high = np.clip(np.ceil(points.max(axis=0)).astype(int) + far, 1, top)
    window = slice(low[1], high[1]), slice(low[0], high[0])
    shape = growth[window].shape
    labels = draw_labels([t.points - low for t in lines], [t.closed for t in lines], shape)
    turned = growth[window] + (0.0 if sign > 0 else np.pi)
    around = Surroundings.of(labels, turned, frequency[window], valid[window])
    met, way = distance_outwards(points - low, number + 1, around)
    return np.where(np.isin(met - 1, list(others)), way, 0.0)


Base = tuple[FloatArray, FloatArray, FloatArray, bool]


def _beside(
    point: FloatArray,
    line: Trace,
    sign: float,
    way: FloatArray | None,
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
) -> Base | None:
    """Points beside a line: at a share of the `way` to the next one, or at the point's own distance from it."""
    distance = np.hypot(*(line.points - point).T)
    at = int(distance.argmin())
    points, closed = line.points, line.closed
    if closed:
        # The point's place in the middle, so that the stretch around it is in one piece.
        turn = at - len(points) // 2
        points = np.roll(points, -turn, axis=0)
        way = None if way is None else np.roll(way, -turn)
        at -= turn
    angle = nearest(growth, points) + (0.0 if sign > 0 else np.pi)
    if way is None:
        width = 1.0 / nearest(frequency, points)
        away = np.full(len(points), float(distance.min()))
    else:
        known = way > 0.0
        if not known[max(0, at - 4) : at + 5].any():
            return None
        # Small holes, where a ray slipped through, are bridged.
        filled = np.interp(np.arange(len(way)), np.flatnonzero(known), way[known])
        holes = np.convolve(known, np.ones(9), mode="same") > 0
        start = at - int(np.argmin(np.concatenate([holes[: at + 1][::-1], [False]]))) + 1
        end = at + int(np.argmin(np.concatenate([holes[at:], [False]])))
        closed = closed and end - start == len(points)
        points, angle, width = points[start:end], angle[start:end], gaussian_filter1d(filled[start:end], 3.0)
        share = float(np.clip(distance.min() / max(width[at - start], 1e-9), 0.1, 0.9))
        away = share * width
    if len(points) < 4:
        return None
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points + step * away[:, None], angle, np.asarray(width, np.float64), closed


def _along_tangent(
    point: FloatArray, growth: npt.NDArray[Any], frequency: npt.NDArray[Any], valid: npt.NDArray[np.bool_]
) -> Base:
    """Points a pixel apart along the rings through a point, as far as there is wood; at least two to either side.

    Either side ends after half a turn: around the pith a walk would go on for ever.
    """
    parts = []
    for side in (1.0, -1.0):
        steps: list[FloatArray] = []
        here, heading, turned = point.copy(), None, 0.0
        for _ in range(sum(valid.shape)):
            angle = float(nearest(growth, here[None, :])[0])
            tangent = side * np.array([-np.sin(angle), np.cos(angle)])
            if heading is not None and tangent @ heading < 0.0:
                tangent = -tangent
            if heading is not None:
                turned += float(heading[0] * tangent[1] - heading[1] * tangent[0])
            if abs(turned) > 3.0:
                break
            here, heading = here + tangent, tangent
            inside = (here >= -0.5).all() and here[0] < valid.shape[1] - 0.5 and here[1] < valid.shape[0] - 0.5
            if len(steps) >= 2 and not (inside and nearest(valid, here[None, :])[0]):
                break
            steps.append(here)
        parts.append(np.array(steps))
    points = np.concatenate([parts[1][::-1], point[None, :], parts[0]])
    return points, nearest(growth, points), 1.0 / nearest(frequency, points).astype(np.float64), False


def _free(trace: Trace, point: FloatArray, lines: Sequence[Trace], valid: npt.NDArray[np.bool_]) -> Trace:
    """Stretch around the point that stays inside the wood and away from all other lines."""
    low, high = trace.points.min(axis=0) - 3.0, trace.points.max(axis=0) + 3.0
    near = [line.points[((line.points > low) & (line.points < high)).all(axis=1)] for line in lines]
    at = int(np.hypot(*(trace.points - point).T).argmin())
    apart = np.full(len(trace.points), np.inf)
    if sum(map(len, near)):
        apart = cKDTree(np.concatenate(near)).query(trace.points)[0]
    height, width = valid.shape
    inside = ((trace.points >= -0.5) & (trace.points <= [width - 0.5, height - 0.5])).all(axis=1)
    # Vertices are a pixel apart: lines that keep this distance do not cross. Nearer only where the person says so.
    free = (apart >= min(1.8, 0.6 * float(apart[at]))) & inside & nearest(valid, trace.points)
    if free.all():
        return trace
    free[max(0, at - 1) : at + 2] = True
    if trace.closed:
        turn = at - len(free) // 2
        points, free = np.roll(trace.points, -turn, axis=0), np.roll(free, -turn)
        at -= turn
    else:
        points = trace.points
    start = at - int(np.argmin(np.concatenate([free[: at + 1][::-1], [False]]))) + 1
    end = at + int(np.argmin(np.concatenate([free[at:], [False]])))
    return Trace(points[start:end], np.ones(end - start), False)
