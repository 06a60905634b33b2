"""The photograph with its numbered rings: vector lines over the picture, numbers that keep their size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.report.labels import Name, place_labels
from pipeline.report.palettes import ring_color
from pipeline.report.pictures import Picture, fit, jpeg
from pipeline.report.reading import Frame, Scan
from stages.variables import (
    RING_AGE_SHIFT,
    RING_AGE_SIGN,
    RING_CLOSED,
    RING_CONFIDENCE,
    RING_GROUP,
    RING_INDEX,
    RING_X,
    RING_Y,
    VERTEX_COUNT,
)

Array = npt.NDArray[Any]

#: Below this confidence a ring is drawn dashed: one in a hundred above it is no ring, about one in four below.
UNSURE = 0.9

_WIDE_PX, _NARROW_PX, _THUMB_PX = 1040.0, 340.0, 360

#: Strips are shown at least so high (lying) or wide (standing), px; lying ones scroll sideways on a small screen.
_LEAST_PX = 110.0


@dataclass(frozen=True)
class Ring:
    """One traced boundary.

    Parameters
    ----------
    index
        Its number, growing outwards.
    confidence
        0..1.
    closed
        Whether it returns to its start.
    counted
        Whether its number is tied to the others' by counting; otherwise it is a guess.
    points
        Shape (N, 2): x, y in px of the scan.
    """

    index: int
    confidence: float
    closed: bool
    counted: bool
    points: Array


def rings_of(scan: Scan) -> list[Ring] | None:
    """Traced boundaries; ``None`` when tracing has not run."""
    if not scan.has(RING_X, RING_Y, VERTEX_COUNT, RING_INDEX):
        return None
    points = np.column_stack([scan.values(RING_X), scan.values(RING_Y)]).astype(float)
    index = scan.values(RING_INDEX)
    confidence = scan.values(RING_CONFIDENCE) if scan.has(RING_CONFIDENCE) else np.ones(len(index))
    closed = scan.values(RING_CLOSED) if scan.has(RING_CLOSED) else np.zeros(len(index), bool)
    group = scan.values(RING_GROUP) if scan.has(RING_GROUP) else np.zeros(len(index), int)
    pieces = np.split(points, np.cumsum(scan.values(VERTEX_COUNT))[:-1]) if len(index) else []
    counted = group == 0
    if scan.block is not None and scan.has(RING_AGE_SHIFT):
        # Each face was counted on its own; in the block a ring has one number on all faces.
        index, counted = (
            scan.values(RING_AGE_SIGN)[group] * index + scan.values(RING_AGE_SHIFT)[group],
            np.ones(len(group), bool),
        )
    rows = zip(index, confidence, closed, counted, pieces, strict=True)
    return [Ring(int(i), float(c), bool(k), bool(g), p) for i, c, k, g, p in rows if len(p)]


def ring_section(scan: Scan, name: str, faces: Sequence[str] = ()) -> dict[str, Any] | None:
    """The photograph, or those of a block's faces with their names, with rings if they were traced."""
    photograph, frame = scan.photograph(), scan.frame
    if photograph is None or frame is None:
        return None
    rings = rings_of(scan)
    shown = shown_size(frame)
    section: dict[str, Any] = {
        "shown": shown,
        "picture": jpeg(photograph, _alt(name, frame, rings), 86),
        "frame": frame,
        "traced": rings is not None,
        "lines": [],
        "wide": [],
        "narrow": [],
        "unsure": 0,
        "count": 0,
        "faces": _face_names(scan, frame, faces),
    }
    if not rings:
        return section
    tolerance = 0.3 * max(frame.width, frame.height) / _WIDE_PX
    section["lines"] = [
        {
            "path": _path(ring, tolerance),
            "color": ring_color(ring.index),
            "unsure": ring.confidence < UNSURE,
            "title": f"ring {ring.index}, confidence {ring.confidence:.2f}"
            + ("" if ring.counted else ", its number is a guess"),
        }
        for ring in rings
    ]
    section["wide"] = _labels(
        rings, frame, shown["most"] if shown["most"] < _WIDE_PX else max(_WIDE_PX, shown["least"])
    )
    section["narrow"] = _labels(rings, frame, min(_NARROW_PX, shown["most"]))
    section["count"] = len({ring.index for ring in rings})
    section["unsure"] = len({ring.index for ring in rings if ring.confidence < UNSURE})
    section["guessed"] = sum(not ring.counted for ring in rings)
    section["first"], section["last"] = min(r.index for r in rings), max(r.index for r in rings)
    return section


def _face_names(scan: Scan, frame: Frame, faces: Sequence[str]) -> list[dict[str, str]]:
    """Name of each face and the place of its upper left corner, per cent."""
    places = () if scan.block is None else scan.block.places
    return [
        {
            "text": name,
            "left": f"{100 * (x - frame.left) / frame.width:.2f}",
            "top": f"{100 * (y - frame.top) / frame.height:.2f}",
        }
        for name, (x, y) in zip(faces, places, strict=True)
    ]


def shown_size(frame: Frame) -> dict[str, float]:
    """Least and most width of a photograph on the screen, px."""
    if frame.width >= frame.height:
        return {"least": min(4000.0, round(_LEAST_PX * frame.width / frame.height)), "most": 4000.0}
    return {"least": 0.0, "most": max(_LEAST_PX, round(_WIDE_PX * frame.width / frame.height))}


def _alt(name: str, frame: Frame, rings: list[Ring] | None) -> str:
    size = f"{frame.width:.0f} by {frame.height:.0f} pixels"
    if rings is None:
        return f"Photograph {name}, {size}."
    if not rings:
        return f"Photograph {name}, {size}, no ring boundaries found."
    numbers = sorted({ring.index for ring in rings})
    return f"Photograph {name}, {size}, with {len(numbers)} ring boundaries, numbered {numbers[0]} to {numbers[-1]}."


def _path(ring: Ring, tolerance: float) -> str:
    """SVG path of a boundary, thinned out by less than `tolerance` px."""
    points = ring.points[np.isfinite(ring.points).all(axis=1)]
    if len(points) > 2:
        points = cv2.approxPolyDP(points.astype(np.float32)[:, None], tolerance, ring.closed)[:, 0]
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + ("Z" if ring.closed else "")


def _labels(rings: list[Ring], frame: Frame, width_px: float) -> list[dict[str, Any]]:
    lines: dict[Name, list[Array]] = {}
    for ring in rings:
        lines.setdefault((ring.index, "" if ring.counted else "?"), []).append(
            ring.points[np.isfinite(ring.points).all(axis=1)]
        )
    extent = (frame.left, frame.top, frame.width, frame.height)
    labels = place_labels(lines, extent, frame.width / width_px)
    return [
        {
            "text": f"{label.name[0]}{label.name[1]}",
            "left": f"{100 * (label.x - frame.left) / frame.width:.2f}",
            "top": f"{100 * (label.y - frame.top) / frame.height:.2f}",
            "color": ring_color(label.name[0]),
        }
        for label in labels
    ]


def thumbnail(scan: Scan, name: str) -> Picture | None:
    """A small picture of the photograph with its rings, for the index."""
    photograph, frame = scan.photograph(), scan.frame
    if photograph is None or frame is None:
        return None
    small = np.ascontiguousarray(fit(photograph, 2 * _THUMB_PX))
    rings = rings_of(scan) or []
    width = 2 if len(rings) < 30 else 1
    for ring in rings:
        places = (ring.points - [frame.left, frame.top]) * (small.shape[1] / frame.width) - 0.5
        color = ring_color(ring.index)
        line = np.round(places * 16).astype(np.int32)[:, None]
        rgb = tuple(int(color[k : k + 2], 16) for k in (1, 3, 5))
        cv2.polylines(small, [line], ring.closed, rgb, width, cv2.LINE_AA, 4)
    return jpeg(fit(small, _THUMB_PX), f"Photograph {name} with its rings", 78)
