"""Ring series as JSON, with all that is known of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np

from woodfit.dendro.series import FloatArray, FormatError, RingSeries
from woodfit.dendro.text import MAX_WIDTH_MM, MAX_YEAR, RingBudget, error, excerpt, parse_int

FORMAT = "woodpipe ring series"
VERSION = 1
_PLAIN = ("name", "first_year", "pith_years", "unmeasured_outer", "pith", "bark", "pith_distance_mm")
_LISTS = ("width_mm", "earlywood_mm", "latewood_mm", "confidence")
Entry = Mapping[str, object]


def dumps(series: Sequence[RingSeries]) -> str:
    """Write all that is known of the series, NaN as null."""
    entries = []
    for one in series:
        entry: dict[str, object] = {key: getattr(one, key) for key in _PLAIN}
        for key in _LISTS:
            values = getattr(one, key)
            entry[key] = None if values is None else [None if np.isnan(value) else value for value in values.tolist()]
        entry["remarks"] = {str(ring): word for ring, word in sorted(one.remarks.items())}
        entries.append(entry)
    return json.dumps({"format": FORMAT, "version": VERSION, "series": entries}, indent=1, allow_nan=False) + "\n"


def loads(text: str, source: str = "text") -> list[RingSeries]:
    """Read what `dumps` wrote.

    Raises
    ------
    FormatError
        For broken JSON, another format, and values of another kind or range.
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as reason:
        raise error(source, getattr(reason, "lineno", None), f"broken JSON ({reason})", "a JSON object") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT or document.get("version") != VERSION:
        raise error(source, None, "another JSON document", f"'format': {FORMAT!r} and 'version': {VERSION}")
    entries = document.get("series")
    if not isinstance(entries, list) or not entries:
        raise error(source, None, "no list 'series'", "a list of at least one series")
    budget = RingBudget(source)
    return [_series(entry, index, budget) for index, entry in enumerate(entries)]


def _series(entry: object, index: int, budget: RingBudget) -> RingSeries:
    source = budget.source
    name = entry.get("name") if isinstance(entry, dict) else None
    if not isinstance(entry, dict) or not isinstance(name, str) or not name.isprintable():
        raise error(source, None, f"series {index} without a printable name", "an object with 'name' and 'width_mm'")
    width, early, late = (_array(entry, key, MAX_WIDTH_MM, budget) for key in _LISTS[:3])
    confidence = _array(entry, "confidence", 1.0, budget)
    if width is None or any(part is not None and len(part) != len(width) for part in (early, late, confidence)):
        raise error(source, None, f"series {excerpt(name)} with missing or unequal lists", "'width_mm', others as long")
    return RingSeries(
        name,
        width,
        _integer(entry, "first_year", source),
        early,
        late,
        confidence,
        _remarks(entry, len(width), source),
        _decimal(entry, "pith_distance_mm", source),
        _integer(entry, "pith_years", source),
        _flag(entry, "pith", source),
        _flag(entry, "bark", source),
        _integer(entry, "unmeasured_outer", source),
    )


def _array(entry: Entry, key: str, top: float, budget: RingBudget) -> FloatArray | None:
    values = entry.get(key)
    if values is None:
        return None
    if not isinstance(values, list):
        raise _wrong(entry, key, "a list of numbers and nulls", budget.source)
    budget.take(len(values), str(entry["name"]))
    out = np.full(len(values), np.nan)
    for ring, value in enumerate(values):
        if value is not None:
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= top:
                raise _wrong(entry, key, f"numbers from 0 to {top:g} and nulls", budget.source)
            out[ring] = value
    return out


def _decimal(entry: Entry, key: str, source: str) -> float | None:
    value = entry.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MAX_YEAR:
        raise _wrong(entry, key, f"a number within ±{MAX_YEAR}, or null", source)
    return float(value)


def _integer(entry: Entry, key: str, source: str) -> int | None:
    value = _decimal(entry, key, source)
    if value is not None and not value.is_integer():
        raise _wrong(entry, key, "an integer or null", source)
    return None if value is None else int(value)


def _flag(entry: Entry, key: str, source: str) -> bool | None:
    value = entry.get(key)
    if value is not None and not isinstance(value, bool):
        raise _wrong(entry, key, "true, false or null", source)
    return value


def _remarks(entry: Entry, count: int, source: str) -> dict[int, str]:
    remarks = entry.get("remarks") or {}
    if not isinstance(remarks, dict):
        raise _wrong(entry, "remarks", "words by number of ring", source)
    found: dict[int, str] = {}
    for ring, word in remarks.items():
        number = parse_int(ring)
        if number is None or not 0 <= number < count or not isinstance(word, str):
            raise _wrong(entry, "remarks", f"words by number of ring, 0 to {count - 1}", source)
        found[number] = word
    return found


def _wrong(entry: Entry, key: str, expected: str, source: str) -> FormatError:
    found = json.dumps(entry.get(key))[:40]
    return error(source, None, f"{key} of series {excerpt(str(entry['name']))} is {found}", expected)
