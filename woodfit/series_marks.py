"""Series as marks on the image that a person can check and correct: CooRecorder files and the table of boundaries."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.dendro.boundary_table import Mark
from woodfit.dendro.coorecorder import MM_PER_INCH, MeasuredPath
from woodfit.dendro.path_widths import PathPoint

FloatArray = npt.NDArray[np.float64]

#: Resolution written when no scale is known.
NOMINAL_DPI = 1200.0

#: Widths from point to point may differ by this share before borders get two points.
SAME_WIDTH = 0.001

NOT_TRACED = "not traced"


def measured_path(document: Mapping[str, Any], path: Mapping[str, Any], image: str, written_as: str) -> MeasuredPath:
    """One path of ``series.json`` as a CooRecorder file, from bark to pith.

    A border gets two points where the path meets the boundaries slantwise, so that the distances from point to point
    are the widths at right angles. A boundary that was not traced but must be there stands, labelled, where equal
    rings would put it. Without a scale the coordinates are those of `NOMINAL_DPI`, and a comment says so.

    Parameters
    ----------
    document, path : mappings
        The document and one of its ``paths`` with at least one ring.
    image : str
        Path of the scan.
    written_as : str
        Path of the file itself.
    """
    size = document["pixel_size_mm"]
    dpi = NOMINAL_DPI if size is None else MM_PER_INCH / size
    comments = [f"woodpipe series {path['name']}"]
    if size is None:
        comments.append(f"no scale was known: {NOMINAL_DPI:g} dpi is nominal and lengths are not true")
    if any(gap["outside"] for gap in path["gaps"]):
        comments.append("the rings between the first point and the outermost wood could not be counted")
    if any(not gap["outside"] for gap in path["gaps"]):
        comments.append("the rings inside of the last point could not be counted")
    # A semicolon at the end would make a comment look like a list of values.
    comments += [remark.rstrip("; ") for remark in path["remarks"]]
    return MeasuredPath(
        points=tuple(_points(path, MM_PER_INCH / dpi)),
        image=image,
        dpi=dpi,
        dated=path["last_year"],
        comments=tuple(comments),
        keys=_keys(path["pith"], MM_PER_INCH / dpi),
        written_as=written_as,
    )


def _keys(pith: Mapping[str, Any] | None, mm_per_px: float) -> dict[str, str]:
    """What is known of the pith."""
    if pith is None:
        return {}
    x, y = (value * mm_per_px for value in pith["xy"])
    keys = {"PithCoordinates": f"{x:.4f},{y:.4f}", "DistanceToPith": f"{pith['distance_px'] * mm_per_px:.1f}"}
    return keys if pith["years"] is None else keys | {"YearsToPith": str(pith["years"])}


def _points(path: Mapping[str, Any], mm_per_px: float) -> Iterator[PathPoint]:
    """Points from bark to pith."""
    boundaries, rings = path["boundaries"], path["rings"]
    measured = [ring for ring in rings if not ring["absent"]]
    single = all(_is_straight(ring, boundaries) for ring in measured)
    inwards = {ring["outer"]: ring for ring in measured if ring["outer"] is not None}
    outwards = {ring["inner"]: ring for ring in measured if ring["inner"] is not None}
    zeros, untraced = _absent_outside(rings), _untraced_inside(rings)
    for k in range(len(boundaries) - 1, -1, -1):
        here = np.array([boundaries[k]["x"], boundaries[k]["y"]])
        older, younger = inwards.get(k), outwards.get(k)
        ends = [_end(younger, "from", here, single), _end(older, "to", here, single)]
        # Before the first and after the last border nothing is measured.
        ends = ends[1:] if k == len(boundaries) - 1 else ends[:1] if k == 0 else ends
        first, last = (_mm(end, mm_per_px) for end in (ends[0], ends[-1]))
        label = "beside the path" if boundaries[k]["beside"] else ""
        yield PathPoint(first, None if first == last else last, label=label, zeros=zeros.get(k, 0))
        if older is not None and older["latewood_onset"] is not None:
            share = older["latewood_onset"]["fraction"]
            inner = _end(older, "from", _point(boundaries[older["inner"]]), single)
            yield PathPoint(_mm(inner + share * (ends[-1] - inner), mm_per_px), kind="latewood")
        if k > 0:
            yield from (
                PathPoint(_mm(point, mm_per_px), label=NOT_TRACED)
                for point in _between(boundaries[k], boundaries[k - 1], untraced.get(k, 0))
            )


def _is_straight(ring: Mapping[str, Any], boundaries: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a ring is as wide from crossing to crossing as at right angles."""
    if ring["from"] is None or ring["width_px"] == 0.0:
        return True
    way = math.dist(_point(boundaries[ring["inner"]]), _point(boundaries[ring["outer"]]))
    return abs(way / float(ring["width_px"]) - 1.0) < SAME_WIDTH


def _end(ring: Mapping[str, Any] | None, which: str, crossing: FloatArray, single: bool) -> FloatArray:
    """End of the line measured across a ring, or the crossing itself."""
    if single or ring is None or ring[which] is None:
        return crossing
    return np.array(ring[which], np.float64)


def _absent_outside(rings: Sequence[Mapping[str, Any]]) -> dict[int, int]:
    """How many absent rings follow outside of each boundary that closes a ring."""
    zeros: dict[int, int] = {}
    last = None
    for ring in rings:
        if not ring["absent"]:
            last = ring["outer"]
        elif last is not None:
            zeros[last] = zeros.get(last, 0) + 1
    return zeros


def _untraced_inside(rings: Sequence[Mapping[str, Any]]) -> dict[int, int]:
    """How many boundaries were not traced between each boundary and the next inside of it."""
    counts: dict[int, int] = {}
    missing = 0
    for ring in rings:
        if ring["absent"]:
            continue
        if ring["outer"] is None:
            missing += 1
        elif missing:
            counts[ring["outer"]] = missing
            missing = 0
    return counts


def _between(outer: Mapping[str, Any], inner: Mapping[str, Any], count: int) -> list[FloatArray]:
    """Where boundaries that were not traced would lie if the rings were equally wide, from the outside in."""
    ends = _point(outer), _point(inner)
    return [ends[0] + (ends[1] - ends[0]) * step / (count + 1) for step in range(1, count + 1)]


def _point(boundary: Mapping[str, Any]) -> FloatArray:
    return np.array([boundary["x"], boundary["y"]], np.float64)


def _mm(point: FloatArray, mm_per_px: float) -> tuple[float, float]:
    """To a tenth of a micrometre, as the file holds it."""
    return round(float(point[0]) * mm_per_px, 4), round(float(point[1]) * mm_per_px, 4)


def boundary_marks(document: Mapping[str, Any]) -> list[Mark]:
    """All paths of ``series.json`` as rows of the table of boundaries, from the pith outwards, scan px."""
    marks: list[Mark] = []
    for path in document["paths"]:
        boundaries, name = path["boundaries"], path["name"]
        inwards = {ring["outer"]: ring for ring in path["rings"] if ring["outer"] is not None}
        zeros, untraced = _absent_outside(path["rings"]), _untraced_inside(path["rings"])
        for k, boundary in enumerate(boundaries):
            if k > 0:
                missing = _between(boundary, boundaries[k - 1], untraced.get(k, 0))[::-1]
                marks += [
                    Mark(name, "untraced", _px(point), boundaries[k - 1]["id"] + 1 + step)
                    for step, point in enumerate(missing)
                ]
                onset = inwards[k]["latewood_onset"] if k in inwards else None
                if onset is not None:
                    marks.append(Mark(name, "latewood", _px(np.array(onset["xy"])), boundary["id"]))
            # As in CooRecorder's files the ring inside of a boundary is older than those absent at it.
            marks += [Mark(name, "absent", None)] * zeros.get(k, 0)
            marks.append(Mark(name, boundary["kind"], _px(_point(boundary)), boundary["id"]))
    return marks


def _px(point: FloatArray) -> tuple[float, float]:
    return float(point[0]), float(point[1])
