"""Files in which a person marks ring boundaries: CooRecorder's and our table, told apart by what is in them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from woodfit.dendro import boundary_table, coorecorder
from woodfit.dendro.path_widths import PathPoint
from woodfit.dendro.text import error, excerpt
from woodfit.marked_path import MarkedPath
from woodfit.series_marks import NOT_TRACED

#: A border that lies so near to the pith, in px, is the start of the path.
AT_PITH_PX = 1.0

#: A border that was written without having been traced counts as untouched within so many px of its place.
UNTOUCHED_PX = 1.0


def read_marked_paths(text: str, source: str) -> list[MarkedPath]:
    """Paths of a CooRecorder file (.pos) or of a table of boundaries (.csv), in px of the scan.

    Parameters
    ----------
    text : str
        Content of the file.
    source : str
        Its name, for messages.

    Raises
    ------
    woodfit.dendro.series.FormatError
        With the line, what was found and what was expected.
    """
    if text.lstrip().startswith("#DENDRO"):
        return [path_of_pos(coorecorder.loads(text, source), source)]
    if boundary_table.is_table(text):
        return boundary_table.loads(text, source)
    first = next((line for line in text.splitlines() if line.strip()), "")
    columns = ",".join(boundary_table.COLUMNS)
    raise error(source, 1, excerpt(first), f"a CooRecorder file ('#DENDRO ...') or a table with the columns {columns}")


def path_of_pos(measured: coorecorder.MeasuredPath, source: str) -> MarkedPath:
    """Path of a CooRecorder file, which runs from bark to pith, turned outwards and in px."""
    if measured.dpi is None:
        raise error(source, None, "no line '#DPI'", "the resolution, which turns millimeters into px of the scan")
    dpi = measured.dpi
    borders: list[PathPoint] = []
    gaps: list[list[PathPoint]] = []
    rings: list[int] = []
    absent: list[int] = []
    untouched = _untouched(measured, UNTOUCHED_PX * coorecorder.MM_PER_INCH / dpi)
    for point in measured.points:
        if point in untouched:
            rings[-1] += 1 + point.zeros
            absent[-1] += point.zeros
        elif point.kind == "border":
            borders.append(point)
            gaps.append([])
            rings.append(1 + point.zeros)
            absent.append(point.zeros)
        elif point.kind == "gap" and borders:
            gaps[-1].append(point)
    latewood = [point.xy_mm for point in measured.points if point.kind == "latewood"]
    rings = [0 if gap else count for count, gap in zip(rings, gaps, strict=True)][:-1]
    absent = [0 if gap else count for count, gap in zip(absent, gaps, strict=True)][:-1]
    path = MarkedPath(
        name=source,
        borders=tuple(
            coorecorder.px_from_mm(np.array([xy for xy in (one.xy_mm, one.second_xy_mm) if xy is not None]), dpi)
            for one in borders
        ),
        rings=tuple(rings),
        gaps=tuple(
            coorecorder.px_from_mm(np.array([point.xy_mm for point in gap]).reshape(-1, 2), dpi) for gap in gaps[:-1]
        ),
        latewood=coorecorder.px_from_mm(np.array(latewood).reshape(-1, 2), dpi),
        absent=tuple(absent),
    ).reversed()
    pith = measured.pith_xy_mm
    if pith is None:
        return path
    # The distance is that of the innermost point, written in tenths of a millimeter.
    nearer_px = 0.1 * dpi / coorecorder.MM_PER_INCH if measured.pith_distance_mm == 0.0 else AT_PITH_PX
    return path.without_pith(coorecorder.px_from_mm(np.array(pith), dpi), nearer_px)


def _untouched(measured: coorecorder.MeasuredPath, within_mm: float) -> set[PathPoint]:
    """Borders that woodpipe wrote for rings without a traced boundary and that nobody has put in their place."""
    borders = [point for point in measured.points if point.kind == "border"]
    sure = [at for at, point in enumerate(borders) if point.label != NOT_TRACED]
    untouched = set()
    for start, end in pairwise(sure):
        ends = [np.mean([one.xy_mm, one.second_xy_mm or one.xy_mm], axis=0) for one in (borders[start], borders[end])]
        for at in range(start + 1, end):
            place = ends[0] + (ends[1] - ends[0]) * (at - start) / (end - start)
            if np.hypot(*(np.array(borders[at].xy_mm) - place)) <= within_mm:
                untouched.add(borders[at])
    return untouched
