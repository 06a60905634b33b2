"""Ring boundaries as polylines: walk along the rings, held on the boundary phase (paper, Sec. 3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from woodfit.photograph import thickness

FloatArray = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Trace:
    """One traced boundary.

    Attributes
    ----------
    points : float array of shape (K, 2)
        x, y in pixels, image frame, about one pixel apart.
    confidence : float array of shape (K,)
        0..1.
    closed : bool
        True when the last point is next to the first.
    """

    points: npt.NDArray[np.float64]
    confidence: npt.NDArray[np.float64]
    closed: bool


#: Ring widths a walk may go with growth on its other side: orientation turns over for a little about a tight corner.
_OTHER_SIDE_RINGS = 1.0


@njit(cache=True)
def _mark(owner: npt.NDArray[np.int32], x: float, y: float, radius: float, label: int) -> None:
    height, width = owner.shape
    r = int(radius + 1.0)
    cx = int(x + 0.5)
    cy = int(y + 0.5)
    for iy in range(max(0, cy - r), min(height, cy + r + 1)):
        for ix in range(max(0, cx - r), min(width, cx + r + 1)):
            if (ix - x) ** 2 + (iy - y) ** 2 <= radius * radius and owner[iy, ix] == 0:
                owner[iy, ix] = label


@njit(cache=True)
def _walk(
    phase: FloatArray,
    grow_x: FloatArray,
    grow_y: FloatArray,
    frequency: FloatArray,
    confidence: FloatArray,
    valid: npt.NDArray[np.bool_],
    owner: npt.NDArray[np.int32],
    start_x: float,
    start_y: float,
    side: float,
    floor: float,
    max_gap: float,
    limit: int,
    label: int,
    most_turn: float,
) -> tuple[npt.NDArray[np.float64], bool, float]:
    """Walk one way from a start: rows of x, y, confidence; whether it closed; how far it turned, in rad."""
    height, width = phase.shape
    path = np.empty((limit, 3), np.float64)
    count = 0
    x, y = start_x, start_y
    ix, iy = int(x + 0.5), int(y + 0.5)
    hx, hy = -side * grow_y[iy, ix], side * grow_x[iy, ix]
    gap = 0.0
    kept = 0
    closed = False
    start_hx, start_hy = hx, hy
    turned = 0.0
    against = 0.0
    agreed = 0
    while count < limit:
        # Tangent here, agreeing with the heading.
        tx, ty = -float(grow_y[iy, ix]), float(grow_x[iy, ix])
        other_side = side * (tx * hx + ty * hy) < 0.0
        if tx * hx + ty * hy < 0.0:
            tx, ty = -tx, -ty
        if confidence[iy, ix] >= floor:
            # Wood grown on the other side of the line: the edge of another ring, whose phase is that of this one.
            against = against + float(frequency[iy, ix]) if other_side else 0.0
            if against > _OTHER_SIDE_RINGS:
                return path[:agreed].copy(), False, abs(turned)
            before_x, before_y = hx, hy
            hx, hy = 0.6 * hx + 0.4 * tx, 0.6 * hy + 0.4 * ty
            norm = np.sqrt(hx * hx + hy * hy)
            hx, hy = hx / norm, hy / norm
            turned += before_x * hy - before_y * hx
            # Once round without coming home: a tear has led the walk onto the next ring.
            if abs(turned) > most_turn:
                break
        x += hx
        y += hy
        if not (x >= -0.49 and y >= -0.49 and x < width - 0.51 and y < height - 0.51):
            break
        ix, iy = int(x + 0.5), int(y + 0.5)
        if not valid[iy, ix]:
            break
        gx, gy, f = float(grow_x[iy, ix]), float(grow_y[iy, ix]), float(frequency[iy, ix])
        # The phase at the nearest pixel, carried to the exact place by its own gradient.
        off = phase[iy, ix] + 2.0 * np.pi * f * ((x - ix) * gx + (y - iy) * gy)
        off -= 2.0 * np.pi * np.round(off / (2.0 * np.pi))
        if confidence[iy, ix] >= floor and abs(off) < 0.5 * np.pi:
            shift = -off / (2.0 * np.pi * f)
            shift = min(max(shift, -0.7), 0.7)
            x += shift * gx
            y += shift * gy
            gap = 0.0
        else:
            gap += 1.0
        if not (x >= -0.49 and y >= -0.49 and x < width - 0.51 and y < height - 0.51):
            break
        ix, iy = int(x + 0.5), int(y + 0.5)
        if owner[iy, ix] != 0 and owner[iy, ix] != label:
            break
        path[count, 0] = x
        path[count, 1] = y
        path[count, 2] = confidence[iy, ix] if gap == 0.0 else 0.0
        count += 1
        if gap == 0.0:
            kept = count
            if against == 0.0:
                agreed = count
        if gap > max_gap:
            break
        if count > 12 and (x - start_x) ** 2 + (y - start_y) ** 2 < 1.5**2 and hx * start_hx + hy * start_hy > 0.5:
            closed = True
            kept = count
            break
    return path[:kept].copy(), closed, abs(turned)


#: Turn in rad after which a walk has been once round.
_ONCE_ROUND = 6.6


def _close(path: npt.NDArray[np.float64], near_px: float) -> tuple[npt.NDArray[np.float64], bool]:
    """Path (K, 3) cut where it comes back to its start, and whether it does."""
    if len(path) < 5:
        # A walk that spun over doubtful ground, of which next to nothing is kept.
        return path, False
    tail = len(path) - len(path) // 5
    apart = np.hypot(*(path[tail:, :2] - path[0, :2]).T)
    home = int(apart.argmin())
    return (path[: tail + home + 1], True) if apart[home] < near_px else (path, False)


def trace_rings(
    phase: npt.NDArray[Any],
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    confidence: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    seed_confidence: float,
    floor_confidence: float,
    max_gap_rings: float,
    shortest_rings: float,
) -> list[Trace]:
    """Trace every boundary, the surest first.

    Parameters
    ----------
    phase : array of shape (M, N)
        Ring phase in rad, 0 at the boundaries, growing along `growth`.
    growth : array of shape (M, N)
        Outward direction in rad.
    frequency : array of shape (M, N)
        Rings per pixel.
    confidence : array of shape (M, N)
        0..1.
    valid : bool array of shape (M, N)
        The wood.
    seed_confidence, floor_confidence : float
        Where a trace may start, and below which the phase is not believed but the heading is kept.
    max_gap_rings : float
        How far, in local ring widths, a trace carries on without belief.
    shortest_rings : float
        Traces shorter than this many local ring widths (or than most of a narrow scan) are dropped; closed ones when
        they are no longer than the way round half a ring width.

    Returns
    -------
    list of Trace
        In order of discovery; none crosses another.
    """
    phase = np.ascontiguousarray(phase, np.float32)
    grow_x, grow_y = np.cos(growth).astype(np.float32), np.sin(growth).astype(np.float32)
    frequency = np.ascontiguousarray(frequency, np.float32)
    confidence = np.ascontiguousarray(confidence, np.float32)
    height, width = phase.shape
    owner = np.zeros((height, width), np.int32)
    # A seed lies within half a pixel of the boundary along the growth direction.
    near = np.abs(phase) <= np.pi * frequency * 1.05
    rows, cols = np.nonzero(near & valid & (confidence >= seed_confidence))
    order = np.lexsort((cols, rows, -np.round(confidence[rows, cols], 3)))
    traces: list[Trace] = []
    limit = 8 * (height + width)
    # A boundary across a core is no longer than the core is thick, whatever lies around it.
    thick = thickness(valid)
    for row, col in zip(rows[order].tolist(), cols[order].tolist(), strict=True):
        if owner[row, col]:
            continue
        label = len(traces) + 1
        f = float(frequency[row, col])
        shift = -float(phase[row, col]) / (2.0 * np.pi * f)
        x = float(np.clip(col + shift * grow_x[row, col], 0, width - 1))
        y = float(np.clip(row + shift * grow_y[row, col], 0, height - 1))
        fields = (phase, grow_x, grow_y, frequency, confidence, valid, owner, x, y)
        limits = (floor_confidence, max_gap_rings / f, limit, label)
        ahead, closed, turned = _walk(*fields, 1.0, *limits, _ONCE_ROUND)
        parts = [np.array([[x, y, confidence[row, col]]]), ahead]
        if not closed and turned < 6.0:
            behind, _, more = _walk(*fields, -1.0, *limits, max(0.0, _ONCE_ROUND - turned))
            parts.insert(0, behind[::-1])
            turned += more
        path = np.concatenate(parts)
        if not closed and turned > 5.5:
            path, closed = _close(path, 0.35 / f)
        # What closes within half a ring goes round the pith itself, or a speck.
        if len(path) < (np.pi / f if closed else min(shortest_rings / f, 0.6 * thick)):
            _mark(owner, x, y, 0.3 / f, -1)
            continue
        for px, py, _ in path:
            ix, iy = int(px + 0.5), int(py + 0.5)
            _mark(owner, px, py, 0.35 / float(frequency[iy, ix]), label)
        traces.append(Trace(path[:, :2].copy(), path[:, 2].copy(), closed))
    return traces
