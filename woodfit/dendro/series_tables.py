"""Ring series as CSV tables: one column per series, or one line per ring."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence

import numpy as np

from woodfit.dendro.series import FloatArray, FormatError, RingSeries
from woodfit.dendro.text import MAX_WIDTH_MM, RingBudget, error, excerpt, parse_float, parse_year

LONG_COLUMNS = ("series", "year", "rw_mm", "ew_mm", "lw_mm", "confidence", "remark")
EARLY, LATE = "_EW", "_LW"
MISSING = ("", "NA", "NaN", "nan")


def dumps_wide(series: Sequence[RingSeries], woods: bool = False) -> str:
    """Write widths in mm, one line per year and one column per series, as dplR and dplPy read them.

    Parameters
    ----------
    series : sequence of RingSeries
        Dated, or none of them (then the first column is ``Ring``, counted from 1, instead of ``Year``).
    woods : bool
        Add the columns ``<name>_EW`` and ``<name>_LW`` where these are known.

    Raises
    ------
    FormatError
        For equal names, and when only some series are dated.
    """
    if len({one.first_year is None for one in series}) > 1:
        raise FormatError("a table by year cannot hold series with and without a date; write the long table instead")
    columns: list[tuple[str, RingSeries, FloatArray]] = []
    for one in series:
        columns.append((one.name, one, one.width_mm))
        parts = ((EARLY, one.earlywood_mm), (LATE, one.latewood_mm)) if woods else ()
        columns += [(one.name + ending, one, part) for ending, part in parts if part is not None]
    if len({name for name, *_ in columns}) < len(columns):
        raise FormatError("several columns of the table would have the same name; give each series its own")
    dated = bool(series) and series[0].first_year is not None
    out = io.StringIO()
    writer = csv.writer(out, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n")
    writer.writerow(["Year" if dated else "Ring", *(name for name, *_ in columns)])
    years = np.unique(np.concatenate([one.years for one in series])) if series else np.zeros(0, np.int64)
    for year in years.tolist():
        cells = []
        for _, one, values in columns:
            ring = year - int(one.years[0]) if len(one) else -1
            cells.append(_number(values[ring]) if 0 <= ring < len(one) else "NA")
        out.write(",".join([str(year), *cells]) + "\n")
    return out.getvalue()


def dumps_long(series: Sequence[RingSeries]) -> str:
    """Write one line per ring with the columns `LONG_COLUMNS`; the year is empty for series without a date."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(LONG_COLUMNS)
    for one in series:
        columns = [one.width_mm, one.earlywood_mm, one.latewood_mm, one.confidence]
        for ring, year in enumerate(one.years.tolist()):
            cells = ["" if column is None else _number(column[ring]) for column in columns]
            writer.writerow([one.name, "" if one.first_year is None else year, *cells, one.remarks.get(ring, "")])
    return out.getvalue()


def loads_csv(text: str, source: str = "text") -> list[RingSeries]:
    """Read either table; commas, semicolons (then also decimal commas) or tabs between the cells.

    In the wide table, missing values before the first and after the last are left out, those between are NaN; columns
    ``<name>_EW`` and ``<name>_LW`` beside ``<name>`` are its earlywood and latewood.

    Raises
    ------
    FormatError
        With line and reason.
    """
    rows = _rows(text, source)
    line, head = next(rows, (1, [""]))
    names = [name.strip() for name in head]
    if names[0] == LONG_COLUMNS[0]:
        if tuple(names) != LONG_COLUMNS:
            raise error(source, line, f"the columns {excerpt(','.join(names))}", ",".join(LONG_COLUMNS))
        return _long(rows, source)
    if names[0].lower() not in ("year", "years", "ring") or len(names) < 2:
        raise error(
            source, line, f"the columns {excerpt(','.join(names))}", "'Year' (or 'Ring') and one column per series, or "
            + ",".join(LONG_COLUMNS),
        )  # fmt: skip
    if len(set(names)) < len(names) or not all(names):
        raise error(source, line, "columns without a name of their own", "distinct names")
    return _wide(names, rows, source)


def _number(value: float) -> str:
    return "NA" if np.isnan(value) else f"{value:.4f}".rstrip("0").rstrip(".")


def _rows(text: str, source: str) -> Iterator[tuple[int, list[str]]]:
    first = text.split("\n", 1)[0]
    delimiter = max(",;\t", key=first.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                yield reader.line_num, [_point_for_comma(cell) for cell in row] if delimiter == ";" else row
    except csv.Error as reason:
        raise error(source, reader.line_num, f"broken CSV ({reason})", "cells, quotes in pairs") from None


def _point_for_comma(cell: str) -> str:
    return cell.replace(",", ".") if cell.strip().replace(",", "", 1).isdigit() else cell


def _cell(text: str, top: float, line: int, source: str) -> float:
    token = text.strip()
    if token in MISSING:
        return math.nan
    value = parse_float(token)
    if value is None or not 0 <= value <= top:
        raise error(source, line, f"the value {excerpt(token)}", f"a number between 0 and {top:g}, or NA")
    return value


def _wide(names: list[str], rows: Iterator[tuple[int, list[str]]], source: str) -> list[RingSeries]:
    years: list[int] = []
    table: list[list[float]] = []
    for line, row in rows:
        if len(row) != len(names):
            raise error(source, line, f"{len(row)} cells", f"{len(names)} as in the first line")
        years.append(parse_year(row[0], source, line))
        if len(years) > 1 and years[-1] <= years[-2]:
            raise error(source, line, f"the year {years[-1]} after {years[-2]}", "years that grow")
        table.append([_cell(cell, MAX_WIDTH_MM, line, source) for cell in row[1:]])
    columns: dict[str, tuple[int, FloatArray]] = {}
    budget = RingBudget(source)
    values = np.array(table, np.float64).reshape(len(table), len(names) - 1)
    at = np.array(years, np.int64)
    for name, column in zip(names[1:], values.T, strict=True):
        known = np.flatnonzero(np.isfinite(column))
        if len(known):
            first, last = int(at[known[0]]), int(at[known[-1]])
            budget.take(last - first + 1, name)
            width = np.full(last - first + 1, np.nan)
            width[at[known] - first] = column[known]
            columns[name] = (first, width)
    if not columns:
        raise error(source, None, "no values", "widths in mm below the names")
    dated = names[0].lower() != "ring"
    series = []
    for name, (first, width) in columns.items():
        if not any(name.endswith(ending) and name.removesuffix(ending) in columns for ending in (EARLY, LATE)):
            early, late = (_fitted(columns.get(name + ending), first, len(width)) for ending in (EARLY, LATE))
            series.append(RingSeries(name, width, first if dated else None, early, late))
    return series


def _fitted(column: tuple[int, FloatArray] | None, first: int, count: int) -> FloatArray | None:
    """A column's values for `count` years from `first` on."""
    if column is None:
        return None
    start, values = column
    out = np.full(count, np.nan)
    low, high = max(start, first), min(start + len(values), first + count)
    out[max(low - first, 0) : max(high - first, 0)] = values[max(low - start, 0) : max(high - start, 0)]
    return out


def _long(rows: Iterator[tuple[int, list[str]]], source: str) -> list[RingSeries]:
    rings: dict[str, list[tuple[int, list[str]]]] = {}
    for line, row in rows:
        if len(row) != len(LONG_COLUMNS):
            raise error(source, line, f"{len(row)} cells", f"{len(LONG_COLUMNS)}: {','.join(LONG_COLUMNS)}")
        rings.setdefault(row[0].strip(), []).append((line, row))
    if not rings:
        raise error(source, None, "no rings", "one line per ring")
    budget = RingBudget(source)
    return [_long_series(name, lines, budget) for name, lines in rings.items()]


def _long_series(name: str, rings: list[tuple[int, list[str]]], budget: RingBudget) -> RingSeries:
    source = budget.source
    budget.take(len(rings), name)
    years = [parse_year(row[1], source, line) if row[1].strip() else None for line, row in rings]
    for (line, _), before, year in zip(rings[1:], years, years[1:], strict=False):
        if (before is None) != (year is None) or (before is not None and year != before + 1):
            raise error(
                source, line, f"the year {year} after {before} in series {excerpt(name)}",
                "the following year, or none", "a ring without a width needs a line with NA",
            )  # fmt: skip
    tops = (MAX_WIDTH_MM, MAX_WIDTH_MM, MAX_WIDTH_MM, 1.0)
    columns = [
        np.array([_cell(row[2 + index], top, line, source) for line, row in rings]) for index, top in enumerate(tops)
    ]
    early, late, confidence = (column if np.isfinite(column).any() else None for column in columns[1:])
    remarks = {ring: row[6].strip() for ring, (_, row) in enumerate(rings) if row[6].strip()}
    return RingSeries(name, columns[0], years[0], early, late, confidence, remarks)
