"""Ring boundaries as a table that a person can edit: one row for each, from the pith outwards.

::

    path,ring,x_px,y_px,kind
    north,1,102.314,55.000,boundary
    north,2,131.950,55.120,latewood
    north,2,140.207,55.310,boundary
    north,3,,,absent
    north,4,171.666,55.480,boundary

`kind` is ``boundary``; ``untraced`` for one that must be there by the count of rings and was not found, to be made
``boundary`` by whoever sees it; ``absent`` for a ring that is locally missing between the boundaries before and after
(no coordinates); ``gap`` for the two ends of a crack, between which nothing is known (the second may be left out: up
to the next boundary); ``latewood`` for the border between earlywood and latewood; ``pith`` where the path starts at it.
The order of the rows counts, not `ring`, which only helps to find one's way. x runs right and y down, in px of the
scan, 0 in the middle of its first pixel.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from woodfit.dendro.text import error, excerpt, lines, parse_float
from woodfit.marked_path import MarkedPath

COLUMNS = ("path", "ring", "x_px", "y_px", "kind")
KINDS = ("boundary", "untraced", "absent", "gap", "latewood", "pith")
_FARTHEST_PX = 1e7


@dataclass(frozen=True)
class Mark:
    """One row of the table.

    Parameters
    ----------
    path : str
        Which path it belongs to.
    kind : str
        One of `KINDS`.
    xy : tuple of two float or None
        In px; None for an absent ring.
    ring : int or None
        Index of the ring that the boundary ends; only told, never read.
    line : int
        Line of the file, 0 when not from a file.
    """

    path: str
    kind: str
    xy: tuple[float, float] | None
    ring: int | None = None
    line: int = 0


def dumps(marks: Iterable[Mark]) -> str:
    """Write the table; coordinates to a thousandth of a px."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for mark in marks:
        xy = ("", "") if mark.xy is None else tuple(f"{value:.3f}" for value in mark.xy)
        writer.writerow([" ".join(mark.path.split()), "" if mark.ring is None else mark.ring, *xy, mark.kind])
    return out.getvalue()


def is_table(text: str) -> bool:
    """Whether a text begins as the table does."""
    rows = _rows(text)
    return bool(rows) and _columns(rows[0][1]) is not None


def loads(text: str, source: str = "boundaries.csv") -> list[MarkedPath]:
    """Read the table.

    Fields may be separated by semicolons or tabs, then with decimal commas, as spreadsheets write them; lines that
    begin with ``#`` before the columns' names, and empty lines, are passed over.

    Parameters
    ----------
    text : str
        Content.
    source : str
        Name for messages.

    Returns
    -------
    list of MarkedPath
        In the order of their first rows.

    Raises
    ------
    FormatError
        With the line, what was found, what was expected.
    """
    by_path: dict[str, list[Mark]] = {}
    for mark in _marks(text, source):
        by_path.setdefault(mark.path, []).append(mark)
    if not by_path:
        raise error(source, None, "no boundaries", f"a line {','.join(COLUMNS)} and below it one row for each boundary")
    return [_path_of(marks, f"{source}, path {name!r}" if name else source, source) for name, marks in by_path.items()]


def _rows(text: str) -> list[tuple[int, str]]:
    """Lines with their numbers, without empty ones and without comments above the columns' names."""
    numbered = [(number, line) for number, line in enumerate(lines(text), 1) if line.strip()]
    head = next((at for at, (_, line) in enumerate(numbered) if not line.startswith("#")), len(numbered))
    return numbered[head:]


def _columns(line: str) -> tuple[str, list[str]] | None:
    """Separator and names of the columns, None for a line that is no head of this table."""
    for separator in (",", ";", "\t"):
        names = [name.strip().strip('"').lower() for name in line.lstrip("\ufeff").split(separator)]
        if set(COLUMNS) <= set(names):
            return separator, names
    return None


def _marks(text: str, source: str) -> Iterator[Mark]:
    rows = _rows(text)
    if not rows:
        return
    found = _columns(rows[0][1])
    if found is None:
        raise error(source, rows[0][0], excerpt(rows[0][1]), f"the columns {','.join(COLUMNS)}")
    separator, names = found
    for number, line in rows[1:]:
        try:
            fields = next(csv.reader([line], delimiter=separator, strict=True))
        except csv.Error as reason:
            raise error(source, number, f"{excerpt(line)} ({reason})", f"fields separated by {separator!r}") from None
        if not any(field.strip() for field in fields):
            continue
        if len(fields) != len(names):
            raise error(source, number, f"{len(fields)} fields", f"{len(names)} ({', '.join(names)})")
        row = {name: field.strip() for name, field in zip(names, fields, strict=True)}
        yield _mark(row, separator, number, source)


def _mark(row: dict[str, str], separator: str, line: int, source: str) -> Mark:
    kind = row["kind"].lower()
    if kind not in KINDS:
        raise error(source, line, f"kind {excerpt(row['kind'])}", f"one of {', '.join(KINDS)}")
    if kind == "absent":
        if row["x_px"] or row["y_px"]:
            raise error(source, line, "an absent ring with coordinates", "none", "if it is there, write boundary")
        return Mark(row["path"], kind, None, line=line)
    xy = []
    for name in ("x_px", "y_px"):
        value = parse_float(row[name] if separator == "," else row[name].replace(",", "."))
        if value is None or abs(value) > _FARTHEST_PX:
            raise error(source, line, f"{name} {excerpt(row[name])}", "a number of px")
        xy.append(value)
    return Mark(row["path"], kind, (xy[0], xy[1]), line=line)


def _path_of(marks: list[Mark], name: str, source: str) -> MarkedPath:
    """Turn the rows of one path into what they say."""
    borders: list[Mark] = []
    rings: list[int] = []
    gaps: list[list[Mark]] = []
    absents: list[int] = []
    skipped, absent, gap = 0, 0, list[Mark]()
    latewood, pith = [], None
    for mark in marks:
        if mark.kind in ("absent", "untraced"):
            skipped += 1
            absent += mark.kind == "absent"
        elif mark.kind == "gap":
            gap.append(mark)
        elif mark.kind == "latewood":
            latewood.append(mark.xy)
        elif mark.kind == "pith":
            if borders or skipped or gap or pith is not None:
                raise error(source, mark.line, "the pith among the boundaries", "it in the first row of its path")
            pith = np.array(mark.xy, np.float64)
        else:
            _check_order(borders, mark, source)
            if borders:
                rings.append(0 if gap else 1 + skipped)
                absents.append(0 if gap else absent)
                gaps.append(gap)
            elif skipped or gap:
                raise error(source, mark.line, "absent rings or a gap before the first boundary", "them after it")
            borders.append(mark)
            skipped, absent, gap = 0, 0, []
    if skipped or gap:
        raise error(source, marks[-1].line, "absent rings or a gap after the last boundary", "them before it")
    if len(borders) < 2:
        raise error(source, marks[0].line, f"{len(borders)} boundaries on a path", "at least two")
    return MarkedPath(
        name=name,
        borders=tuple(np.array([border.xy], np.float64) for border in borders),
        rings=tuple(rings),
        gaps=tuple(np.array([mark.xy for mark in gap], np.float64).reshape(-1, 2) for gap in gaps),
        latewood=np.array(latewood, np.float64).reshape(-1, 2),
        pith=pith,
        absent=tuple(absents),
    )


def _check_order(borders: list[Mark], mark: Mark, source: str) -> None:
    """Refuse a boundary at the place of the one before it, or behind that one as seen from the one before that."""
    if not borders:
        return
    here, last = np.array(mark.xy, np.float64), np.array(borders[-1].xy, np.float64)
    if (here == last).all():
        raise error(source, mark.line, f"the boundary of line {borders[-1].line} again", "one at another place")
    if len(borders) > 1 and (here - last) @ (last - np.array(borders[-2].xy, np.float64)) < 0.0:
        expected = "boundaries in the order in which they are met from the pith outwards"
        raise error(source, mark.line, f"a path that turns back at line {borders[-1].line}", expected)
