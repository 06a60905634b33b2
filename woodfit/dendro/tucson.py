"""Tucson decadal files (.rwl), the exchange format of the International Tree-Ring Data Bank.

Layout and codes: https://www.ncei.noaa.gov/pub/data/paleo/treering/treeinfo.txt; what programs make of them in
docs/formats.md. Years are astronomical: 0 is 1 BC.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from woodfit.dendro.series import FloatArray, FormatError, RingSeries
from woodfit.dendro.short_names import short_names
from woodfit.dendro.text import RingBudget, error, excerpt
from woodfit.dendro.tucson_header import TucsonHeader
from woodfit.dendro.tucson_lines import STOP_UNITS_MM, Row, parse_rows, split_lines

NOT_MEASURED = -999
"""Written for a ring that exists but was not measured; read are all negative codes."""


@dataclass(frozen=True)
class _Segment:
    """Consecutive rings of one series with the lines that they stand in."""

    first_year: int
    width_mm: list[float]
    lines: tuple[int, int]

    @property
    def end_year(self) -> int:
        return self.first_year + len(self.width_mm)


def loads(text: str, source: str = "text") -> list[RingSeries]:
    """Read a Tucson decadal file.

    The unit of each series is told by its end mark: 999 for 0.01 mm, -9999 for 0.001 mm. 0 is an absent ring; negative
    codes, blank cells and years without a cell become NaN. Blocks of one name that do not overlap are one series.

    Parameters
    ----------
    text : str
        Contents of the file, with or without the three header lines.
    source : str
        Its name, for messages.

    Returns
    -------
    list of RingSeries
        In the order of the file; `width_mm` holds what the file holds, earlywood for an earlywood file.

    Raises
    ------
    FormatError
        With line and reason: misaligned columns, no end mark, data after it, two series of one name that overlap.
    """
    header, data = split_lines(text, source)
    if header and not data:
        raise error(
            source, None, f"no series, and {excerpt(header[-1][8:12])} in columns 9-12 of the last line",
            "a year there", "names of more than 8 characters shift the columns",
        )  # fmt: skip
    segments: dict[str, list[_Segment]] = {}
    budget = RingBudget(source)
    runs = [list(run) for _, run in itertools.groupby(parse_rows(data, source), key=lambda row: row.name)]
    for index, run in enumerate(runs):
        stop = _stop_mark(run[-1])
        if stop is None:
            after = runs[index + 1][0] if index + 1 < len(runs) else None
            raise _unended(run[-1], after if after and after.name in segments else None, source)
        segments.setdefault(run[0].name, []).extend(_segments(run, stop, budget))
    series = []
    for name, parts in segments.items():
        parts = sorted((part for part in parts if part.width_mm), key=lambda part: part.first_year)
        if not parts:
            continue
        for earlier, later in itertools.pairwise(parts):
            if later.first_year < earlier.end_year:
                first, second = sorted((earlier, later), key=lambda part: part.lines)
                raise error(
                    source, second.lines[0],
                    f"{name!r} for {second.first_year}-{second.end_year - 1} after its end mark, though lines"
                    f" {first.lines[0]}-{first.lines[1]} give it {first.first_year}-{first.end_year - 1}",
                    "no overlap of two blocks of one name", "rename or remove one of them",
                )  # fmt: skip
        count = parts[-1].end_year - parts[0].first_year
        budget.take(count, name)
        width = np.full(count, np.nan)
        for part in parts:
            width[part.first_year - parts[0].first_year : part.end_year - parts[0].first_year] = part.width_mm
        series.append(RingSeries(name, width, parts[0].first_year))
    if not series:
        raise error(source, None, "no series", "lines of a name, a year and ring widths")
    return series


def _segments(rows: list[Row], stop: int, budget: RingBudget) -> list[_Segment]:
    """Consecutive lines of one name, cut at end marks."""
    unit = STOP_UNITS_MM[stop]
    segments: list[_Segment] = []
    width: list[float] = []
    start: Row | None = None
    previous: Row | None = None
    for row in rows:
        if start is None or previous is None:
            start, width = row, []
        else:
            _check_decade(row, previous, budget.source)
            gap = row.year - start.year - len(width)
            budget.take(gap, row.name)
            width += [np.nan] * gap
        count = row.cells.index(stop) if stop in row.cells else len(row.cells)
        _check_row(row, count, stop, budget.source)
        width += [np.nan if cell is None or cell < 0 else cell * unit for cell in row.cells[:count]]
        previous = row
        if count < len(row.cells):
            segments.append(_Segment(start.year, width, (start.number, row.number)))
            start = None
    return segments


def _stop_mark(row: Row) -> int | None:
    """The end mark of a series' last line; zeros, blanks and negative codes may follow it."""
    for cell in reversed(row.cells):
        if cell in STOP_UNITS_MM:
            return int(cell)
        if cell is not None and cell > 0:
            return None
    return None


def _unended(row: Row, after: Row | None, source: str) -> FormatError:
    if after is not None:
        return error(
            source, after.number,
            f"data of series {after.name!r} after its end mark, within series {row.name!r}", "its lines in one block",
            "the line may bear the wrong name",
        )  # fmt: skip
    return error(
        source, row.number, f"the end of series {row.name!r} without an end mark", "999 (0.01 mm) or -9999 (0.001 mm)",
        "the unit is unknown; add the mark in the cell after the last ring",
    )  # fmt: skip


def _check_decade(row: Row, previous: Row, source: str) -> None:
    decade = previous.year // 10 * 10
    if row.year % 10 or row.year <= decade:
        raise error(
            source, row.number, f"the year {row.year} after the line of {previous.year} in series {row.name!r}",
            f"{decade + 10} or a later decade", "two series may share the name, or the year is mistyped",
        )  # fmt: skip


def _check_row(row: Row, count: int, stop: int, source: str) -> None:
    if count > row.room:
        raise error(
            source, row.number, f"{count} values from {row.year} on", f"at most {row.room}, to the end of the decade",
            "the year or the columns are wrong",
        )  # fmt: skip
    if -9999 in row.cells[:count]:
        raise error(
            source, row.number, f"-9999 within series {row.name!r}, which ends with 999", "one of the two marks",
            "the unit is unknown",
        )  # fmt: skip
    rest = [cell for cell in row.cells[count + 1 :] if cell is not None and cell > 0 and cell != stop]
    if rest:
        raise error(
            source, row.number, f"{rest[0]} after the end mark {stop} of series {row.name!r}", "nothing or zeros",
            "a ring of 9.99 mm must be written as 998 in units of 0.01 mm" if stop == 999 else "",
        )  # fmt: skip


def dumps(series: Sequence[RingSeries], unit_mm: float = 0.01, header: TucsonHeader | None = None) -> str:
    """Write a Tucson decadal file.

    999 is never written for a width but 998, in both units, since programs take it for the end mark; a ring
    narrower than half a unit is written as 1, since 0 means an absent ring. An unmeasured ring is -999. Series without
    a date start in year 1. Names are shortened by `written_names`.

    Parameters
    ----------
    series : sequence of RingSeries
        Earlywood and latewood go into files of their own, see `earlywood` and `latewood`.
    unit_mm : float
        0.01 or 0.001.
    header : TucsonHeader, optional
        Written as the three header lines. The data bank wants none.

    Raises
    ------
    FormatError
        For equal names, years outside -9999..9998 and widths that need more than five digits.
    """
    stops = {unit: stop for stop, unit in STOP_UNITS_MM.items()}
    if unit_mm not in stops:
        raise FormatError(f"a Tucson file cannot have the unit {unit_mm} mm; expected 0.01 or 0.001")
    names = written_names(series)
    out = [] if header is None else header.lines([one for one in series if len(one)])
    for one in series:
        if len(one) == 0:
            raise FormatError(f"series {one.name!r} has no rings to write; leave it out")
        first, last = _written_years(one)
        if not -9999 <= first <= last <= 9998:
            raise FormatError(f"series {one.name!r}: a Tucson file takes years -9999 to 9998, not {first} to {last}")
        cells = [*_cells(one, unit_mm), stops[unit_mm]]
        year = first
        while year <= last + 1:
            count = 10 - year % 10
            place = f"{names[one.name]:<7}{year:5d}" if year < -999 else f"{names[one.name]:<8}{year:4d}"
            out.append(place + "".join(f"{cell:6d}" for cell in cells[year - first : year - first + count]))
            year += count
    return "\n".join(out) + "\n"


def written_names(series: Sequence[RingSeries]) -> dict[str, str]:
    """Names as `dumps` writes them: at most 8 characters, 6 for a series that begins before the year -999.

    The sign of such a year stands in column 8 and reads as the end of a name that fills the 7 columns before it.
    """
    lengths = [6 if _written_years(one)[0] < -999 else 8 for one in series]
    return short_names([one.name for one in series], lengths)


def earlywood(series: Sequence[RingSeries]) -> list[RingSeries]:
    """Series of earlywood widths, for the file with an ``e`` at the end of its name."""
    return [part for one in series if (part := _part(one, one.earlywood_mm)) is not None]


def latewood(series: Sequence[RingSeries]) -> list[RingSeries]:
    """Series of latewood widths, for the file with an ``l`` at the end of its name."""
    return [part for one in series if (part := _part(one, one.latewood_mm)) is not None]


def join_woods(
    rings: Sequence[RingSeries], early: Sequence[RingSeries], late: Sequence[RingSeries]
) -> list[RingSeries]:
    """Put the earlywood and latewood of two other files to the rings of the same name and year."""
    parts = [{one.name: one for one in file} for file in (early, late)]
    joined = []
    for ring in rings:
        woods = [None if (part := file.get(ring.name)) is None else _placed(part, ring) for file in parts]
        joined.append(replace(ring, earlywood_mm=woods[0], latewood_mm=woods[1]))
    return joined


def _placed(part: RingSeries, ring: RingSeries) -> FloatArray:
    width = np.full(len(ring), np.nan)
    _, at, of = np.intersect1d(ring.years, part.years, assume_unique=True, return_indices=True)
    width[at] = part.width_mm[of]
    return width


def _part(series: RingSeries, width_mm: FloatArray | None) -> RingSeries | None:
    """A part of the rings as a series, without the unmeasured ones at both ends."""
    known = np.flatnonzero(np.isfinite(width_mm)) if width_mm is not None else np.zeros(0, int)
    if width_mm is None or len(known) == 0:
        return None
    first, end = int(known[0]), int(known[-1]) + 1
    return RingSeries(series.name, width_mm[first:end], int(series.years[first]))


def _written_years(series: RingSeries) -> tuple[int, int]:
    first = 1 if series.first_year is None else series.first_year
    return first, first + len(series) - 1


def _cells(series: RingSeries, unit_mm: float) -> list[int]:
    cells = []
    for width in series.width_mm:
        if np.isnan(width):
            cells.append(NOT_MEASURED)
            continue
        if not 0 <= width / unit_mm < 99999.5:
            raise FormatError(
                f"series {excerpt(series.name)}: a width of {width:g} mm does not fit into the columns of a Tucson file"
                f" in units of {unit_mm} mm; write 0.01 mm or look for a missed boundary"
            )
        cell = max(round(width / unit_mm), int(width > 0))
        cells.append(998 if cell == 999 else cell)
    return cells
