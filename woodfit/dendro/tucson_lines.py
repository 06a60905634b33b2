"""Columns of the Tucson decadal format: one line to a name, a year and integers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from woodfit.dendro.text import error, excerpt, lines, parse_int

STOP_UNITS_MM = {999: 0.01, -9999: 0.001}
"""The mark in the cell after the last ring, and the unit that it stands for."""
HEADER_LINES = 3


@dataclass(frozen=True)
class Row:
    """Line `number` (from 1) of a series: the year of its first cell, and the cells, None where blank."""

    number: int
    name: str
    year: int
    cells: tuple[int | None, ...]

    @property
    def room(self) -> int:
        """Cells up to the end of the decade."""
        return 10 - self.year % 10


def split_lines(text: str, source: str) -> tuple[list[str], list[tuple[int, str]]]:
    """Header lines and numbered data lines of a file; blank lines and comments are dropped.

    Raises
    ------
    FormatError
        When more than three lines come before the first with a year in columns 9-12.
    """
    header: list[str] = []
    data: list[tuple[int, str]] = []
    for number, line in enumerate(lines(text), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if data or _has_year(line):
            data.append((number, line.rstrip()))
        elif len(header) < HEADER_LINES:
            header.append(line)
        else:
            raise error(
                source, number, f"{excerpt(line[8:12])} in columns 9-12", "a year, right-justified to column 12",
                "at most three header lines may come before the data",
            )  # fmt: skip
    return header, data


def parse_rows(data: list[tuple[int, str]], source: str) -> Iterator[Row]:
    """Read data lines one after the other."""
    minus = _minus_years(data, source)
    for number, line in data:
        yield _tab_row(number, line, source) if "\t" in line else _fixed_row(number, line, number in minus, source)


def _has_year(line: str) -> bool:
    if "\t" in line:
        fields = _tab_fields(line)
        return len(fields) > 1 and parse_int(fields[1]) is not None
    return parse_int(line[8:12].strip()) is not None


def _tab_fields(line: str) -> list[str]:
    fields = [part.strip() for part in line.split("\t")]
    return fields if len(fields) > 2 and parse_int(fields[1]) is not None else line.split()


def _tab_row(number: int, line: str, source: str) -> Row:
    fields = _tab_fields(line)
    year = parse_int(fields[1]) if len(fields) > 1 else None
    if year is None or abs(year) > 9999 or len(fields) > 13:
        raise error(source, number, excerpt(line), "a name, a year and up to ten integers between tabs")
    cells = tuple(_cell(text, number, f"field {index}", source) for index, text in enumerate(fields[2:], 3))
    return Row(number, fields[0], year, _without_blank_end(cells))


def _fixed_row(number: int, line: str, minus: bool, source: str) -> Row:
    name, field = (line[:7], line[7:12]) if minus else (line[:8], line[8:12])
    year = parse_int(field.strip())
    if year is None or not name.strip():
        raise error(
            source, number, f"{excerpt(line[:12])} in columns 1-12", "a name in columns 1-8 and a year in columns 9-12",
            "names of more than 8 characters shift the columns",
        )  # fmt: skip
    line = line[:12] + line[12:].split("#", 1)[0]
    starts = range(12, 72, 6)
    cells = [_cell(line[at : at + 6], number, f"columns {at + 1}-{at + 6}", source) for at in starts]
    if cells[-1] is not None and line[72:78].strip() in ("999", "-9999"):
        cells.append(int(line[72:78]))
    return Row(number, name.strip(), year, _without_blank_end(tuple(cells)))


def _cell(text: str, number: int, place: str, source: str) -> int | None:
    token = text.strip()
    if not token:
        return None
    value = parse_int(token)
    if value is None:
        raise error(
            source, number, f"{excerpt(text)} in {place}", "one integer or blanks",
            "the columns are misaligned: each value takes 6 columns, the first ends in column 18",
        )  # fmt: skip
    return value


def _without_blank_end(cells: tuple[int | None, ...]) -> tuple[int | None, ...]:
    count = len(cells)
    while count and cells[count - 1] is None:
        count -= 1
    return cells[:count]


def _minus_years(data: list[tuple[int, str]], source: str) -> set[int]:
    """Numbers of the lines whose column 8 is the sign of a year before -999, not the end of a name.

    ``ABCDEFG-1234`` may be both, unless column 7 is blank. Years grow from line to line and all lines but the first
    start on a decade, which tells for several lines of a series; a single line is told by how many values its decade
    takes.
    """
    minus: set[int] = set()
    group: list[tuple[int, str]] = []
    for entry in [*data, (0, "")]:
        if group and (entry[1][:8] != group[0][1][:8] or not _is_doubtful(entry[1])):
            if _is_minus(group, source):
                minus.update(number for number, _ in group)
            group = []
        if _is_doubtful(entry[1]):
            group.append(entry)
    return minus


def _is_doubtful(line: str) -> bool:
    return line[7:8] == "-" and line[8:12].isdigit() and line[8:12].isascii() and len(line[8:12]) == 4


def _is_minus(group: list[tuple[int, str]], source: str) -> bool:
    years = [int(line[8:12]) for _, line in group]
    number, line = group[0]
    if line[6] == " ":
        return True
    if len(years) > 1:
        return years[1] < years[0]
    filled = len([text for text in line[12:72].split() if text not in ("999", "-9999")])
    plus, minus = filled <= 10 - years[0] % 10, filled <= 10 - -years[0] % 10
    if plus == minus:
        raise error(
            source, number, f"{excerpt(line[:12])} in columns 1-12",
            f"either the name {line[:8]!r} with the year {years[0]} or {line[:7]!r} with {-years[0]}",
            "put another sign than '-' in column 8, or a name of at most 7 characters",
        )  # fmt: skip
    return minus
