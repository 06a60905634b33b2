"""Knots, cracks and stains: their outlines on the photograph, and a list."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.report.pictures import jpeg
from pipeline.report.reading import Frame, Scan
from pipeline.report.rings import shown_size
from stages.variables import ANOMALY, ANOMALY_AREA, ANOMALY_BOX, ANOMALY_KIND
from woodfit.anomalies import KIND_NAMES

_COLORS = {"knot": "#e5484d", "crack": "#4c9fff", "stain": "#35c9b8"}

#: So many of a kind are listed one by one, the largest first.
_MOST_ROWS = 8


def anomaly_section(scan: Scan) -> dict[str, Any] | None:
    """Outlines and table; ``None`` when nothing was found or sought."""
    photograph, frame = scan.photograph(), scan.frame
    if photograph is None or frame is None or not scan.has(ANOMALY, ANOMALY_KIND, ANOMALY_BOX, ANOMALY_AREA):
        return None
    mask = np.asarray(scan.ds[ANOMALY.name].values, np.uint8)
    if not mask.any():
        return None
    counted = {
        name: int((scan.values(ANOMALY_KIND) == code).sum())
        for code, name in KIND_NAMES.items()
        if (mask == code).any()
    }
    words = ", ".join(f"{count} {name}{'s' if count != 1 else ''}" for name, count in counted.items())
    return {
        "picture": jpeg(photograph, f"Photograph with {words} outlined.", 84),
        "frame": frame,
        "shown": shown_size(frame),
        "lines": [
            {"path": path, "color": _COLORS[name], "title": name}
            for code, name in KIND_NAMES.items()
            for path in _outlines(mask == code, frame)
        ],
        "words": words,
        "share": f"{100.0 * float((mask > 0).mean()):.2g} %",
        "rows": _rows(scan),
    }


def _outlines(mask: npt.NDArray[np.bool_], frame: Frame) -> list[str]:
    """SVG path of each connected part of a mask of image elements."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    paths = []
    for outline in outlines:
        points = cv2.approxPolyDP(outline, 0.7, True)[:, 0].astype(float)
        points = (points + 0.5) * frame.step + [frame.left, frame.top]
        paths.append("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + "Z")
    return paths


def _rows(scan: Scan) -> list[dict[str, str]]:
    """What is listed: the largest of each kind, then the others together."""
    size, unit = (scan.pixel_size, scan.unit) if scan.pixel_size else (1.0, "px")
    kind, box, area = (scan.values(variable) for variable in (ANOMALY_KIND, ANOMALY_BOX, ANOMALY_AREA))
    rows = []
    for code, name in KIND_NAMES.items():
        numbers = np.flatnonzero(kind == code)
        for number in numbers[:_MOST_ROWS]:
            left, top, right, bottom = box[number]
            rows.append(
                {
                    "kind": name,
                    "place": f"{0.5 * (left + right):.0f}, {0.5 * (top + bottom):.0f}",
                    "extent": f"{(right - left) * size:.3g} × {(bottom - top) * size:.3g} {unit}",
                    "area": f"{area[number] * size**2:.3g} {unit}²",
                }
            )
        others = numbers[_MOST_ROWS:]
        if len(others):
            rest = f"{area[others].sum() * size**2:.3g} {unit}²"
            rows.append({"kind": name, "place": f"{len(others)} more", "extent": "", "area": rest})
    return rows
