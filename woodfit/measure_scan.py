"""Ring series of a whole scan: paths laid, rings measured along them, what is missing inside and outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from woodfit import measuring, measuring_path
from woodfit.latewood import latewood_onsets, straighten, with_marked
from woodfit.measured import Face, Gap, Kind, Measured, PithSeen, Route
from woodfit.measuring import Crossings
from woodfit.measuring_beside import with_those_beside
from woodfit.pith_offset import pith_offset, rings_missing
from woodfit.ring_widths import PathRings, path_rings

FloatArray = npt.NDArray[np.float64]

#: Innermost boundaries that the pith is estimated from, and rings whose mean width counts the missing ones.
INNERMOST = 6

#: Fine texture steeper across than along the rings by this is that of a face along the stem: its rings are no circles.
ALONG_STEM = 1.2


def routes(face: Face, given: Sequence[FloatArray], bearings_deg: Sequence[float]) -> list[Route]:
    """Paths to measure along: those given, or the radii of a disc, or the middle of a core, or a line across a board.

    Parameters
    ----------
    face : Face
        The scan.
    given : sequence of arrays of shape (P, 2)
        The user's paths; empty for automatic ones.
    bearings_deg : sequence of float
        Radii of a disc.
    """
    near = 4.0 * _usual_width(face)
    if given:
        return [Route(points, Kind.GIVEN, np.nan, near) for points in given]
    if not face.boundaries.lines:
        return []
    piece = measuring_path.largest_piece(face.valid)
    pith = measuring_path.find_pith(face.boundaries, _growth_at_vertices(face), face.grid, piece, face.pith)
    if pith is not None and not face.along_stem:
        return [
            Route(measuring_path.radius_path(pith, bearing, face.grid, piece), Kind.RADIUS, bearing, near)
            for bearing in bearings_deg
        ]
    axis, aspect = measuring_path.long_axis(piece)
    if aspect >= measuring_path.CORE_ASPECT and _across(face, axis) > 0.6:
        points, half = measuring_path.core_path(piece, face.grid, axis)
        return [Route(points, Kind.CORE, np.nan, max(half, face.grid.step))]
    return [
        Route(
            measuring_path.line_across(face.boundaries, face.growth, face.frequency, face.grid, piece),
            Kind.LINE,
            np.nan,
            near,
        )
    ]


def measure(
    face: Face,
    chosen: Sequence[Route],
    corridor_px: float | None,
    marked_latewood: FloatArray | None = None,
    marked_absent: FloatArray | None = None,
) -> list[Measured]:
    """Measure the rings along every path; a path through the pith gives two series.

    Parameters
    ----------
    face : Face
        The scan.
    chosen : sequence of Route
        Paths.
    corridor_px : float or None
        Width along the boundaries over which a ring's profile is averaged; about a ring when None.
    marked_latewood : array of shape (K, 2), optional
        Latewood onsets that a person marked, x, y in scan px; they count where they lie on a path.
    marked_absent : array of shape (K, 2), optional
        A place on the boundary outside of each ring that a person called absent, x, y in scan px.
    """
    marks = np.zeros((0, 2)) if marked_latewood is None else marked_latewood
    absent = _absent_inside(face, np.zeros((0, 2)) if marked_absent is None else marked_absent)
    series = []
    corridor = corridor_px or float(np.clip(_usual_width(face), 9.0 * face.grid.step, 61.0 * face.grid.step))
    reach = _direction_reach(face)
    growth = _growth_at_vertices(face)
    for route in chosen:
        first = measuring.cross(route.points, face.boundaries, growth, reach)
        parts = measuring.outward_parts(route.points, first) if route.kind != Kind.RADIUS else [route.points]
        for part in parts:
            own = replace(route, points=part)
            series.append(_along(face, own, measuring.cross(part, face.boundaries, growth, reach)))
    return [_finished(face, one, corridor, marks, absent) for one in _from_pith(series)]


@dataclass(frozen=True)
class _Draft:
    """A series before its rings are measured."""

    route: Route
    found: Crossings
    gaps: list[Gap]
    unfit: int
    pith: PithSeen | None = None


def _along(face: Face, route: Route, every: Crossings) -> _Draft:
    """Choose and complete the crossings of one path."""
    chosen = measuring.in_order(every)
    found = with_those_beside(route.points, chosen, face.boundaries, route.reach_px)
    if len(found) == 0:
        return _Draft(route, found, [], 0)
    same = every.group == found.group[0]
    low, high = float(found.position[0]), float(found.position[-1])
    gaps = []
    for outside in (every.position < low, every.position > high):
        others = every.take(outside & ~same)
        if len(others):
            met = len(np.unique(np.stack([others.group, others.index]), axis=1).T)
            near = float(others.position.max()) if others.position[0] < low else float(others.position.min())
            gaps.append(Gap(min(near, low), max(near, low), met) if near < low else Gap(high, near, met))
    unfit = len(set(every.index[same].tolist()) - set(found.index.tolist()))
    return _Draft(route, found, gaps, unfit)


def _from_pith(series: list[_Draft]) -> list[_Draft]:
    """On discs: the pith starts the innermost ring, or says how many rings are missing inside."""
    drafts = []
    radii = [one for one in series if one.route.kind == Kind.RADIUS and len(one.found) > 1]
    for one in series:
        if one.route.kind != Kind.RADIUS or len(one.found) < 2:
            drafts.append(one)
            continue
        found = one.found
        tied = [other.found for other in radii if other.found.group[0] == found.group[0]]
        innermost = min(int(other.index[0]) for other in tied)
        inside = _rings_inside([other for other in tied if int(other.index[0]) == innermost])
        x, y = one.route.points[0]
        if inside == 1:
            pith = PithSeen(True, float(x), float(y), 0.0, 0.0, 0.0, 0)
            drafts.append(replace(one, found=_with_pith(one.route.points, found, innermost - 1), pith=pith))
        else:
            missing = inside + int(found.index[0]) - innermost
            way = float(found.position[0])
            drafts.append(replace(one, pith=PithSeen(True, float(x), float(y), way, way, way, missing)))
    return drafts


def _rings_inside(tied: Sequence[Crossings]) -> int:
    """Rings between the pith and the innermost boundary, by the width of the next ones; at least 1."""
    counts = []
    for one in tied:
        inner = one.take(np.arange(min(4, len(one))))
        # Rings get narrower from the pith outwards: the widest of the next three is most like the first.
        widest = float((np.diff(inner.position) / np.diff(inner.index)).max())
        counts.append(float(inner.position[0]) / widest)
    # The first ring is often half as wide again as the next.
    return max(1, int(np.median(counts) + 0.25))


def _with_pith(path: FloatArray, found: Crossings, index: int) -> Crossings:
    """Crossings with the pith as the innermost boundary."""
    ahead = found.point[0] - path[0]
    pith = Crossings(
        position=np.zeros(1),
        point=path[:1],
        angle=np.array([np.arctan2(ahead[1], ahead[0])]),
        line=np.array([-1]),
        place=np.zeros(1),
        index=np.array([index]),
        group=found.group[:1],
        confidence=np.ones(1),
        beside=np.zeros(1, np.bool_),
    )
    return Crossings(
        **{name: np.concatenate([getattr(pith, name), getattr(found, name)]) for name in found.__dataclass_fields__}
    )


def _absent_inside(face: Face, marks: FloatArray) -> dict[tuple[int, int], int]:
    """Group and index of the boundaries on which absent rings were marked, and how many there are inside of each."""
    counts: dict[tuple[int, int], int] = {}
    lines = face.boundaries.lines
    for mark in marks:
        gaps = [float(np.hypot(*(line - mark).T).min()) for line in lines]
        if gaps:
            nearest = int(np.argmin(gaps))
            key = int(face.boundaries.group[nearest]), int(face.boundaries.index[nearest])
            counts[key] = counts.get(key, 0) + 1
    return counts


def _finished(
    face: Face, draft: _Draft, corridor: float, marks: FloatArray, absent: Mapping[tuple[int, int], int]
) -> Measured:
    """Measure widths and latewood of a series and look for its pith."""
    found, route = draft.found, draft.route
    own = {index: count for (group, index), count in absent.items() if len(found) and group == found.group[0]}
    rings = path_rings(found, own)
    straight = straighten(face.dark, face.valid, face.grid, found, rings, face.boundaries, corridor)
    onsets = latewood_onsets(straight, rings.width_px, face.grid.step, face.late_is_dark)
    onsets = with_marked(onsets, rings, marks)
    rests = [0.0, 0.0]
    if len(found):
        ends = (route.points[0], route.points[-1])
        for which, (k, end) in enumerate(zip((0, -1), ends, strict=True)):
            normal = np.array([np.cos(found.angle[k]), np.sin(found.angle[k])])
            rests[which] = abs(float((end - found.point[k]) @ normal))
    pith = draft.pith or _estimated_pith(face, route, found, rings)
    return Measured(route, found, rings, straight, onsets, draft.gaps, draft.unfit, pith, rests[0], rests[1])


def _estimated_pith(face: Face, route: Route, found: Crossings, rings: PathRings) -> PithSeen | None:
    """Pith outside the sample, from the curvature of the innermost boundaries."""
    if face.along_stem or len(found) < 3 or route.kind == Kind.RADIUS:
        return None
    reach = max(2.0 * route.reach_px, 12.0 * _usual_width(face)) if route.kind != Kind.CORE else 2.0 * route.reach_px
    arcs = []
    for k in range(min(INNERMOST, len(found))):
        line = face.boundaries.lines[int(found.line[k])]
        arcs.append(line[np.hypot(*(line - found.point[k]).T) <= reach])
    fit = pith_offset(arcs, found.point[0], float(found.angle[0]))
    if fit is None:
        return None
    years = rings_missing(fit.distance_px, rings.width_px[:INNERMOST])
    return PithSeen(False, fit.x, fit.y, fit.distance_px, fit.least_px, fit.most_px, years)


def _usual_width(face: Face) -> float:
    """Median ring width of the wood, scan px."""
    inside = face.frequency[face.valid]
    return float(1.0 / max(float(np.median(inside)), 1e-6)) if inside.size else 16.0 * face.grid.step


def _growth_at_vertices(face: Face) -> FloatArray:
    """Outward direction at all vertices, one line after the other."""
    lines = face.boundaries.lines
    return np.asarray(face.grid.nearest(face.growth, np.concatenate(list(lines))), np.float64) if lines else np.zeros(0)


def _direction_reach(face: Face) -> FloatArray:
    """How far along each boundary its direction is fitted: about a ring width, scan px."""
    widths = [1.0 / np.median(face.grid.nearest(face.frequency, line)) for line in face.boundaries.lines]
    return np.clip(np.array(widths, np.float64), 8.0 * face.grid.step, 40.0 * face.grid.step)


def _across(face: Face, axis_rad: float) -> float:
    """How far growth runs along an axis: 1 along it, 0 across."""
    return float(np.mean(np.abs(np.cos(face.growth[face.valid] - axis_rad)))) if face.valid.any() else 0.0


def describe_doubt(series: Sequence[Measured]) -> list[str]:
    """What a person should check, in words."""
    said = []
    if not any(len(one.rings) for one in series):
        return ["No ring was measured: no path crosses two boundaries."]
    empty = sum(len(one.rings) == 0 for one in series)
    missing = sum(int(np.isnan(one.rings.width_px).sum()) for one in series)
    unfit, gaps = sum(one.unfit for one in series), sum(len(one.gaps) for one in series)
    if empty:
        said.append(f"{empty} of {len(series)} measurement paths cross less than two boundaries.")
    if missing:
        said.append(f"{missing} rings are known but were not measured: a boundary of theirs was not traced.")
    if gaps:
        said.append(f"{gaps} gaps on measurement paths in which the rings could not be counted.")
    if unfit:
        said.append(f"{unfit} boundaries on measurement paths contradict the count and were left out.")
    return said


def figures(series: Sequence[Measured]) -> dict[str, float | str]:
    """What the report says about the measuring."""
    widths = np.concatenate([np.zeros(0), *(one.rings.width_px for one in series)])
    known = widths[np.isfinite(widths)]
    onsets = np.concatenate([np.zeros(0), *(one.onsets.fraction for one in series)])
    return {
        "measurement paths": len(series),
        "rings measured": len(known),
        "latewood onsets": int(np.isfinite(onsets).sum()),
        "mean ring width (px)": round(float(known.mean()), 2) if len(known) else "-",
    }
