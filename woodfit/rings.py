"""From phase to rings: growth, tracing, true edges, order, in one call."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.boundary import edge_offsets, edge_strength, latewood_foot
from woodfit.fine_texture import Texture, read_texture
from woodfit.grids import nearest
from woodfit.growth import Growth, find_growth
from woodfit.infill import missed_boundaries
from woodfit.jogs import without_jogs
from woodfit.ring_belief import believe, mean_slope, without_doubtful, without_faint
from woodfit.ring_closure import close_rings, describe_uneven
from woodfit.ring_order import Order, order_rings
from woodfit.ring_sides import without_streaks
from woodfit.streamlines import smooth_along
from woodfit.trace_spacing import kept_apart, without_doubles
from woodfit.tracing import Trace, trace_rings

FloatArray = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Rings:
    """Ring boundaries of a face of shape (M, N), in pixels of its arrays.

    Attributes
    ----------
    traces : list of Trace
        Polylines on the true edges, ordered by index.
    order : Order
        Their indices.
    growth : Growth
        Outward direction of growth.
    phase : float32 array of shape (M, N)
        Ring phase in rad: 0 at the boundaries, growing outwards.
    confidence : float32 array of shape (M, N)
        Confidence of the phase, 0..1.
    grain_ratio : float
        Slope of the fine texture across over along the rings.
    strength : float32 array of shape (M, N)
        From `woodfit.boundary.edge_strength`: what the boundaries lie on the ridges of.
    pith : x, y in pixels, or None
        Where rings close around the pith on the face.
    """

    traces: list[Trace]
    order: Order
    growth: Growth
    phase: FloatArray
    confidence: FloatArray
    grain_ratio: float
    strength: FloatArray
    pith: tuple[float, float] | None = None


def ragged(
    traces: list[Trace],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Points (V, 2) and confidence (V,) of all traces one after the other, and how many vertices each has (R,)."""
    counts = np.array([len(t.points) for t in traces], np.int64)
    if not traces:
        return np.zeros((0, 2)), np.zeros(0), counts
    return np.concatenate([t.points for t in traces]), np.concatenate([t.confidence for t in traces]), counts


def ring_confidence(found: Rings) -> npt.NDArray[np.float64]:
    """Probability of each polyline to be a ring boundary: the mean over its vertices."""
    return np.array([float(t.confidence.mean()) for t in found.traces], np.float64)


def describe_doubt(found: Rings) -> list[str]:
    """What a person should check, in words."""
    said = []
    if not found.traces:
        return ["No ring boundary was found."]
    if found.growth.sureness < 0.7:
        said.append(
            f"The direction of growth is a guess (sureness {found.growth.sureness:.2f}); "
            "`ring_tracing.bright_outwards` settles it."
        )
    missing = np.diff(np.unique(found.order.index[found.order.group == 0])) > 1
    if missing.any():
        said.append(f"{int(missing.sum())} ring boundaries seem to be missing between traced ones; indices skip them.")
    loose = len(np.unique(found.order.group)) - 1
    if loose:
        said.append(f"{loose} groups of boundaries could not be tied to the others by counting.")
    if found.pith is not None:
        said += describe_uneven(found.traces, found.order, found.pith)
    return said


#: Edges less one-sided than this on average may be grain: 0.16 for birch, 0.27 and more for four conifers and walnut.
ONE_SIDED = 0.22


def one_sidedness(asymmetry: npt.NDArray[Any], confidence: npt.NDArray[Any]) -> float:
    """Mean of how surely the abrupt edge tells the two directions across the rings apart, where there are rings."""
    return float((asymmetry * confidence).sum() / max(float(confidence.sum()), 1e-12))


def _less_sure(traces: list[Trace], one_sided: float) -> list[Trace]:
    """Traces less believed where rings have no abrupt side, as in diffuse-porous wood: what was found may be grain."""
    share = min(1.0, one_sided / ONE_SIDED)
    return [replace(trace, confidence=trace.confidence * share) for trace in traces]


def wrap(angle: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Angle in rad brought to -pi..pi."""
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def find_rings(
    value: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    response: npt.NDArray[Any],
    explained: npt.NDArray[Any],
    normal: npt.NDArray[Any],
    asymmetry: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    orientation: npt.NDArray[Any],
    ring_scale_px: float,
    bright_outwards: bool | None = None,
    seed_confidence: float = 0.3,
    floor_confidence: float = 0.1,
    max_gap_rings: float = 1.5,
    shortest_rings: float = 2.0,
    vessels: bool = False,
    pith: tuple[float, float] | None = None,
) -> Rings:
    """Trace all ring boundaries of a face, move them onto their edges and number them.

    Parameters
    ----------
    value, valid : arrays of shape (M, N)
        Grey values and wood mask.
    response, explained, normal, asymmetry, frequency, orientation : arrays of shape (M, N)
        From the curved Gabor filter; frequency in cycles per pixel of these arrays.
    ring_scale_px : float
        Characteristic ring width in pixels of these arrays.
    bright_outwards : bool, optional
        The user's word on the direction of growth.
    seed_confidence, floor_confidence, max_gap_rings, shortest_rings : float
        As in `woodfit.tracing.trace_rings`.
    vessels : bool
        True where `value` is the density of vessels: they begin abruptly, so that edges darken outwards.
    pith : x, y in pixels of these arrays, optional
        Where rings close around the pith on the face.

    Returns
    -------
    Rings
    """
    along, _ = smooth_along(value, valid, orientation, 9, 3.0)
    texture = read_texture(value, along, valid, response, explained, asymmetry, orientation, vessels)
    bright = bool(bright_outwards) if vessels else bright_outwards
    along_stem = float(np.clip((texture.grain_ratio - 0.9) / 0.25, 0.0, 1.0))
    growth = find_growth(normal, asymmetry, explained, valid, ring_scale_px, bright, texture.pores, along_stem, pith)
    confidence = np.asarray(explained * valid, dtype=np.float32)
    limits = (seed_confidence, floor_confidence, max_gap_rings, shortest_rings)
    face = _Face(
        value,
        along,
        valid,
        response,
        normal,
        frequency,
        orientation,
        confidence,
        ring_scale_px,
        vessels,
        texture,
        limits,
    )
    kept, phase, strength = _traced(face, growth)
    kept, order = _ordered(kept, growth, frequency, valid, phase, strength, pith is not None)
    dotted = texture.dotted
    if pith is None and not dotted:
        clear = without_streaks(kept, order.index, growth.direction, strength, ring_scale_px)
        if clear is not kept:
            kept, order = _ordered(clear, growth, frequency, valid, phase, strength)
    if pith is not None:
        kept, order = close_rings(kept, order, pith, strength, frequency, valid)
    elif along_stem > 0.9 and not dotted:
        kept = _less_sure(kept, one_sidedness(asymmetry, confidence))
    rank = np.lexsort((np.arange(len(kept)), order.index, order.group))
    order = Order(order.index[rank], order.group[rank], order.agreement[rank])
    return Rings(
        [kept[i] for i in rank],
        order,
        growth,
        phase,
        confidence,
        texture.grain_ratio,
        strength,
        pith,
    )


@dataclass(frozen=True)
class _Face:
    """A face of shape (M, N) and how to trace it; the fields are those of `find_rings`."""

    value: npt.NDArray[Any]
    along: FloatArray
    valid: npt.NDArray[np.bool_]
    response: npt.NDArray[Any]
    normal: npt.NDArray[Any]
    frequency: npt.NDArray[Any]
    orientation: npt.NDArray[Any]
    confidence: FloatArray
    ring_scale_px: float
    vessels: bool
    texture: Texture
    limits: tuple[float, float, float, float]


def _traced(face: _Face, growth: Growth) -> tuple[list[Trace], FloatArray, FloatArray]:
    """Boundaries on their edges, the ring phase and the strength of edges, all as growth has it."""
    valid, frequency, direction = face.valid, face.frequency, growth.direction
    # A wave that rises through zero along the edge direction has phase -pi/2 there.
    with_growth = np.cos(direction - face.normal) >= 0.0
    rising = 0.5 * np.pi if growth.bright_outwards else -0.5 * np.pi
    phase = wrap(np.where(with_growth, 1.0, -1.0) * np.angle(face.response) + rising)
    edge_direction = direction if growth.bright_outwards else direction + np.pi
    strength = edge_strength(
        face.value, valid, face.orientation, edge_direction, face.ring_scale_px, face.texture.dotted
    )
    traces = trace_rings(phase, direction, frequency, face.confidence, valid, *face.limits)
    _, lag = _onto_edges(traces, strength, direction, frequency)
    # Traced again where the edges lie in the phase: a boundary that leaves the picture is then followed to its end.
    phase = np.asarray(wrap(phase - 2.0 * np.pi * lag), dtype=np.float32)
    traces = trace_rings(phase, direction, frequency, face.confidence, valid, *face.limits)
    moved, _ = _onto_edges(traces, strength, direction, frequency)
    around = mean_slope(strength, valid, face.ring_scale_px)
    kept = without_doubtful(believe(without_doubles(moved, frequency), strength, around, frequency))
    kept = without_faint(kept, face.response, strength)
    if not face.vessels:
        # Beside a ring of vessels the latewood's fine texture would pass for another.
        kept += missed_boundaries(kept, strength, direction, frequency, valid, around)
    if growth.bright_outwards:
        kept = _onto_latewood(kept, face.along, direction, frequency)
    kept = without_jogs(kept_apart(kept, valid.shape), direction, frequency, face.ring_scale_px, face.limits[3])
    return kept, phase, strength


def _ordered(
    traces: list[Trace],
    growth: Growth,
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    phase: FloatArray,
    strength: FloatArray,
    around_pith: bool = False,
) -> tuple[list[Trace], Order]:
    """Traces for which the order of growth has room, and their indices."""
    points, closed = [trace.points for trace in traces], [trace.closed for trace in traces]
    kept, order = order_rings(points, closed, growth.direction, frequency, valid, phase, strength, around_pith)
    return [traces[i] for i in kept], order


def _onto_edges(
    traces: list[Trace], strength: FloatArray, direction: FloatArray, frequency: npt.NDArray[Any]
) -> tuple[list[Trace], float]:
    """Traces moved onto the edges, and the median lag of the edges behind the traced phase, in rings.

    Two rounds: the first looks at half a ring to each side and learns where in the phase the edges lie, the second
    looks only around there.
    """
    lag, spread = 0.0, 0.16
    moved = traces
    for _ in range(2):
        moved, lags = [], []
        for trace in traces:
            angle, width = nearest(direction, trace.points), 1.0 / nearest(frequency, trace.points)
            offset, contrast = edge_offsets(strength, trace.points, angle, width, lag, spread, trace.closed)
            step = np.stack([np.cos(angle), np.sin(angle)], axis=1) * offset[:, None]
            # What finds no edge is believed less.
            belief = trace.confidence * np.clip(contrast, 0.0, 2.0) / 2.0
            moved.append(replace(trace, points=trace.points + step, confidence=belief))
            lags.append(offset / width)
        if not traces:
            break
        weights = np.concatenate([t.confidence for t in moved])
        lag, spread = _weighted_median(np.concatenate(lags), weights), 0.08
    height, width_px = strength.shape
    inside = [replace(t, points=np.clip(t.points, [-0.5, -0.5], [width_px - 0.5, height - 0.5])) for t in moved]
    return inside, lag


def _onto_latewood(
    traces: list[Trace], value: FloatArray, direction: FloatArray, frequency: npt.NDArray[Any]
) -> list[Trace]:
    """Traces moved from the steepest point of their steps to the latewood inside, unless the scan is out of focus."""
    moved, sharp = [], 0
    for trace in traces:
        angle = nearest(direction, trace.points)
        width = 1.0 / nearest(frequency, trace.points)
        inwards, reached = latewood_foot(value, trace.points, angle, width, trace.closed)
        step = np.stack([np.cos(angle), np.sin(angle)], axis=1) * inwards[:, None]
        moved.append(replace(trace, points=trace.points - step))
        sharp += int(reached.sum())
    return moved if sharp > 0.5 * sum(len(trace.points) for trace in traces) else traces


def _weighted_median(values: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])]) if total[-1] > 0 else 0.0
