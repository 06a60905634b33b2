"""Heidelberg files (.fh) of the program TSAP: header lines ``Key=Value``, then ring widths."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from woodfit.dendro.heidelberg_writing import EARLY, LATE, NOT_MEASURED, dumps
from woodfit.dendro.series import FloatArray, RingSeries
from woodfit.dendro.text import (
    MAX_RINGS,
    MAX_WIDTH_MM,
    RingBudget,
    error,
    excerpt,
    lines,
    parse_float,
    parse_int,
    parse_year,
)

__all__ = ["Block", "dumps", "loads", "read_blocks"]

NUMBERS_PER_RING = {"tree": 1, "single": 1, "double": 2, "halfchrono": 2, "quadro": 4, "chrono": 4}
UNITS_MM = {"mm": 1.0, "1/10mm": 0.1, "1/100mm": 0.01, "1/1000mm": 0.001}
_YES, _NO = ("p", "b", "1", "y", "yes"), ("-", "0", "n", "no")


@dataclass(frozen=True)
class Block:
    """One header with its numbers.

    Parameters
    ----------
    line : int
        Line of ``HEADER:``, from 1.
    header : dict
        Values by key in lower case.
    kind : str
        Word after ``DATA:`` in lower case.
    numbers : float64 array of shape (n, k)
        As written: k is 1, or 2 (width and depth, or earlywood and latewood), or 4 (width and three counts).
    remarks : dict
        Flags and comments by ring.
    """

    line: int
    header: dict[str, str]
    kind: str
    numbers: FloatArray
    remarks: dict[int, str]

    @property
    def data_type(self) -> str:
        """What was measured, in lower case: ``ringwidth``, ``earlywood``, ``min density``, ..."""
        return self.header.get("datatype", "").lower() or "ringwidth"


def loads(text: str, source: str = "text", data_types: Collection[str] | None = None) -> list[RingSeries]:
    """Read a Heidelberg file.

    Depths and counts of mean curves are dropped. Years are taken as astronomical. A file that says ``Undated`` or
    ``RelDated`` gives series without a date. 0 is an absent ring.

    Parameters
    ----------
    text, source : str
        Contents and name.
    data_types : collection of str, optional
        Kinds of measurement to keep (``DataType`` in lower case, for example ``{"ringwidth"}``). By default all:
        densities come as numbers in the unit that their header names, as in other readers.

    Returns
    -------
    list of RingSeries
        In the order of the file; earlywood and latewood blocks written by `dumps` are joined to their rings.

    Raises
    ------
    FormatError
        With line and reason.
    """
    series: list[RingSeries] = []
    kinds: list[str] = []
    for block in read_blocks(text, source):
        if data_types is None or block.data_type in data_types:
            series.append(_series(block, source))
            kinds.append(block.data_type)
    if not series:
        raise error(source, None, "no series", "blocks of 'HEADER:' and 'DATA:'")
    return _join_woods(series, kinds)


def read_blocks(text: str, source: str = "text") -> Iterator[Block]:
    """Read the blocks of a file one after the other, for instance to see headers that a series does not keep."""
    rows = [(number, line.strip()) for number, line in enumerate(lines(text), 1) if line.strip()]
    starts = [index for index, (_, line) in enumerate(rows) if line.lower() == "header:"]
    if not rows or starts[:1] != [0]:
        found = excerpt(rows[0][1]) if rows else "nothing"
        raise error(source, rows[0][0] if rows else None, found, "'HEADER:' on the first line of a Heidelberg file")
    budget = RingBudget(source)
    for first, end in itertools.pairwise([*starts, len(rows)]):
        yield _block(rows[first:end], budget)


def _block(rows: list[tuple[int, str]], budget: RingBudget) -> Block:
    source, start = budget.source, rows[0][0]
    header: dict[str, str] = {}
    at = 1
    while at < len(rows) and not rows[at][1].lower().startswith("data:"):
        number, line = rows[at]
        key, sign, value = line.partition("=")
        if not sign:
            raise error(source, number, excerpt(line), "'Key=Value' or 'DATA:' in a header")
        header[key.strip().lower()] = value.strip()
        at += 1
    if at == len(rows):
        raise error(source, start, "a header without data", "'DATA:Tree' and ring widths after it")
    number, line = rows[at]
    kind = line[len("data:") :].strip().lower()
    if kind not in NUMBERS_PER_RING:
        raise error(source, number, f"the data kind {excerpt(kind)}", ", ".join(sorted(NUMBERS_PER_RING)))
    if "keycode" not in header:
        raise error(source, start, "no KeyCode", "'KeyCode=' with the name of the series")
    numbers, remarks = _numbers(rows[at + 1 :], source)
    per_ring = NUMBERS_PER_RING[kind]
    count = _length(header, start, source)
    budget.take(count, header["keycode"])
    if len(numbers) < count * per_ring or any(numbers[count * per_ring :]):
        raise error(
            source, number, f"{len(numbers)} numbers in DATA:{kind}",
            f"{count} rings of {per_ring} and zeros after them", "Length or the dates do not fit the data",
        )  # fmt: skip
    values = np.array(numbers[: count * per_ring], np.float64).reshape(count, per_ring)
    return Block(start, header, kind, values, {at // per_ring: word for at, word in remarks.items()})


def _numbers(rows: list[tuple[int, str]], source: str) -> tuple[list[float], dict[int, str]]:
    """All numbers of a block, and by index of the number the flags and comments after it."""
    numbers: list[float] = []
    remarks: dict[int, str] = {}
    for number, line in rows:
        body, _, words = line.partition(";")
        values = [parse_float(token) for token in body.split()]
        known = [value for value in values if value is not None and value >= 0]
        if len(known) < len(values) or (words and len(values) != 1):
            raise error(source, number, excerpt(line), "numbers from 0 on, or one number with ';flags;comment'")
        numbers += known
        if len(numbers) > 4 * MAX_RINGS + 40:
            raise error(source, number, "more numbers than rings can have", f"at most {MAX_RINGS} rings of 4")
        remark = "; ".join(word.strip() for word in words.split(";") if word.strip())
        if remark:
            remarks[len(numbers) - 1] = remark
    return numbers, remarks


def _length(header: dict[str, str], line: int, source: str) -> int:
    dates = [parse_year(header[key], source, line) for key in ("datebegin", "dateend") if header.get(key)]
    span = dates[1] - dates[0] + 1 if len(dates) == 2 else None
    if not header.get("length"):
        if span is None or span < 1:
            raise error(source, line, "no Length", "Length, or DateBegin and DateEnd after it")
        return span
    length = parse_int(header["length"])
    if length is None or length < 1:
        raise error(source, line, f"Length={header['length'][:20]}", "the number of rings, at least 1")
    if span not in (None, length):
        raise error(
            source, line, f"Length={length}, but DateBegin={dates[0]} to DateEnd={dates[1]} are {span} years",
            "the same number", "correct the header; the year 0 counts",
        )  # fmt: skip
    return length


def _series(block: Block, source: str) -> RingSeries:
    header = block.header
    unit = UNITS_MM.get(header.get("unit", "").lower().replace(" ", "") or "1/100mm")
    if unit is None:
        raise error(source, block.line, f"Unit={header['unit'][:20]}", "mm, 1/10 mm, 1/100 mm or 1/1000 mm")
    numbers = block.numbers * unit
    if not (numbers[:, 0] <= MAX_WIDTH_MM).all():
        raise error(source, block.line, f"a width of {numbers[:, 0].max():g} mm", f"at most {MAX_WIDTH_MM:g} mm")
    early = late = None
    width = numbers[:, 0]
    if block.data_type == "earlylatewood":
        if numbers.shape[1] != 2 or header.get("seriesstart", "").lower() == "latewood":
            raise error(
                source, block.line, f"earlywood and latewood as DATA:{block.kind}, SeriesStart="
                f"{header.get('seriesstart', '')[:20]}", "DATA:Double with pairs that start with earlywood",
            )  # fmt: skip
        early, late = numbers[:, 0], numbers[:, 1]
        width = early + late
    unmeasured = [ring for ring, remark in block.remarks.items() if remark == NOT_MEASURED and width[ring] == 0]
    width = width.copy()
    width[unmeasured] = np.nan
    return RingSeries(
        header["keycode"],
        width,
        _first_year(header, len(width), block.line, source),
        early,
        late,
        remarks={ring: remark for ring, remark in block.remarks.items() if ring not in unmeasured},
        pith_years=_count(header.get("missingringsbefore", "")),
        unmeasured_outer=_count(header.get("missingringsafter", "")),
        pith=_flag(header.get("pith", "")),
        bark=_flag(header.get("bark", "")),
    )


def _first_year(header: dict[str, str], count: int, line: int, source: str) -> int | None:
    if header.get("dated", "dated").lower() != "dated":
        return None
    if header.get("datebegin"):
        return parse_year(header["datebegin"], source, line)
    return parse_year(header["dateend"], source, line) - count + 1 if header.get("dateend") else None


def _count(text: str) -> int | None:
    count = parse_int(text)
    return count if count is not None and 0 <= count <= 10_000 else None


def _flag(text: str) -> bool | None:
    return True if text.lower() in _YES else False if text.lower() in _NO else None


def _join_woods(series: list[RingSeries], kinds: list[str]) -> list[RingSeries]:
    """Attach blocks named by `dumps` as parts of the ring widths before them; others stay series of their own."""
    rings = {series[index].name: index for index, kind in enumerate(kinds) if kind == "ringwidth"}
    joined = list(series)
    parts: set[int] = set()
    for index, (one, kind) in enumerate(zip(series, kinds, strict=True)):
        ending = {"earlywood": EARLY, "latewood": LATE}.get(kind)
        ring = rings.get(one.name.removesuffix(ending)) if ending and one.name.endswith(ending) else None
        if ring is None or (len(one), one.first_year) != (len(series[ring]), series[ring].first_year):
            continue
        whole = joined[ring]
        early = kind == "earlywood"
        joined[ring] = replace(whole, earlywood_mm=one.width_mm) if early else replace(whole, latewood_mm=one.width_mm)
        parts.add(index)
    return [one for index, one in enumerate(joined) if index not in parts]
