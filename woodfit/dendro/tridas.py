"""TRiDaS, the Tree-Ring Data Standard 1.2 (XML): ring, earlywood and latewood widths with what is known of the wood.

Jansma, Brewer & Zandhuis, "TRiDaS 1.1: The tree-ring data standard", Dendrochronologia 28, 2010.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from woodfit.dendro.safe_xml import Element, parse
from woodfit.dendro.series import FloatArray, FormatError, RingSeries
from woodfit.dendro.text import MAX_WIDTH_MM, RingBudget, error, excerpt, parse_float, parse_int, parse_year
from woodfit.dendro.tridas_writing import (
    CONFIDENCE,
    NAMESPACE,
    NOT_MEASURED,
    PITH_DISTANCE,
    Project,
    dumps,
)

__all__ = ["Project", "dumps", "loads"]

UNITS_MM = {
    "micrometres": 0.001, "1/100th millimetres": 0.01, "1/50th millimetres": 0.02, "1/20th millimetres": 0.05,
    "1/10th millimetres": 0.1, "millimetres": 1.0, "centimetres": 10.0, "metres": 1000.0,
}  # fmt: skip
_WIDTHS = {
    "ring width": "ring", "total ring width": "ring", "earlywood width": "early", "latewood width": "late",
}  # fmt: skip
_PRESENCE = {"complete": True, "incomplete": True, "present": True, "absent": False}


def loads(data: str | bytes, source: str = "text") -> list[RingSeries]:
    """Read the measurement series of a TRiDaS document; chronologies (derived series) are left out.

    A series whose first and last year contradict the number of its values comes without a date, with a remark at its
    first ring. Where values have no unit, that of another block of the same variable in the same series counts.

    Parameters
    ----------
    data : str or bytes
        The document, version 1.2.x.
    source : str
        Its name, for messages.

    Raises
    ------
    FormatError
        With line and reason: broken or dangerous XML, unknown units, no ring widths at all.
    """
    root = parse(data, source)
    if root.name not in ("tridas", "project") or not root.namespace.startswith(NAMESPACE.rpartition(".")[0]):
        raise error(
            source, root.line, f"the element {excerpt(root.name)} of {excerpt(root.namespace)}",
            f"'tridas' or 'project' of {NAMESPACE}", "other versions are not read",
        )  # fmt: skip
    budget = RingBudget(source)
    series, others = [], set()
    for found in _descend(root):
        one = _series(*found, budget)
        if one is None:
            others |= {_variable(values) for values in found[0].all("values")}
        else:
            series.append(one)
    if not series:
        raise error(source, None, f"no ring widths, but {sorted(others) or 'no values'}", "a variable 'ring width'")
    return series


def _descend(element: Element, radius: Element | None = None) -> Iterator[tuple[Element, Element | None]]:
    """All measurement series, each with its radius."""
    for child in element.children:
        if child.name == "measurementSeries":
            yield child, radius
        else:
            yield from _descend(child, child if child.name == "radius" else radius)


def _series(element: Element, radius: Element | None, budget: RingBudget) -> RingSeries | None:
    source = budget.source
    widths: dict[str, FloatArray] = {}
    confidence: FloatArray | None = None
    remarks: dict[int, str] = {}
    for values in element.all("values"):
        count = sum(1 for _ in values.all("value"))
        name = _variable(values)
        if not count or name not in (*_WIDTHS, CONFIDENCE):
            continue
        budget.take(count, name)
        if name == CONFIDENCE:
            confidence = _numbers(values, 1.0, 1.0, source)[0]
            continue
        if _WIDTHS[name] in widths:
            raise error(source, values.line, f"a second block of {name!r} in one series", "one block per variable")
        unit = _unit_mm(values, element, source)
        widths[_WIDTHS[name]], words = _numbers(values, unit, MAX_WIDTH_MM, source)
        remarks |= {ring: f"{remarks[ring]}; {word}" if ring in remarks else word for ring, word in words.items()}
    ring = widths.get("ring")
    if ring is None and "early" in widths and "late" in widths and len(widths["early"]) == len(widths["late"]):
        ring = widths["early"] + widths["late"]
    if ring is None:
        return None
    unequal = [len(part) for part in (*widths.values(), confidence) if part is not None and len(part) != len(ring)]
    if unequal:
        raise error(source, element.line, f"{unequal[0]} values beside {len(ring)} ring widths", "as many of each")
    first_year, complaint = _first_year(element, len(ring), source)
    if complaint:
        remarks[0] = f"{remarks[0]}; {complaint}" if 0 in remarks else complaint
    title = element.first("title")
    wood = element.first("woodCompleteness") or (radius and radius.first("woodCompleteness"))
    fields = {field.attributes.get("name"): field.text for field in element.all("genericField")}
    return RingSeries(
        title.text if title and title.text else "unnamed",
        ring,
        first_year,
        widths.get("early"),
        widths.get("late"),
        confidence,
        remarks,
        pith_distance_mm=parse_float(fields.get(PITH_DISTANCE, "")),
        pith_years=_pith_years(wood, source),
        pith=_presence(wood, "pith"),
        bark=_presence(wood, "bark"),
        unmeasured_outer=_count(wood, source, "nrOfUnmeasuredOuterRings"),
    )


def _variable(values: Element) -> str:
    variable = values.first("variable")
    if variable is None:
        return ""
    return (variable.attributes.get("normalTridas") or variable.attributes.get("normal") or variable.text).lower()


def _unit_mm(values: Element, series: Element, source: str) -> float:
    blocks = [values, *(other for other in series.all("values") if _variable(other) == _variable(values))]
    named = [unit for block in blocks if (unit := block.first("unit")) is not None]
    if not named:
        raise error(
            source, values.line, "widths without a unit", f"one of {', '.join(UNITS_MM)}", "add <unit normalTridas=...>"
        )
    name = (named[0].attributes.get("normalTridas") or named[0].text).strip().lower()
    if name not in UNITS_MM:
        raise error(source, named[0].line, f"the unit {excerpt(name)}", f"one of {', '.join(UNITS_MM)}")
    return UNITS_MM[name]


def _numbers(values: Element, unit: float, top: float, source: str) -> tuple[FloatArray, dict[int, str]]:
    numbers: list[float] = []
    remarks: dict[int, str] = {}
    for index, value in enumerate(values.all("value")):
        words = [remark.attributes.get("normalTridas") or remark.text for remark in value.all("remark")]
        number = parse_float(value.attributes.get("value", "").strip())
        if number is None or not 0 <= number * unit <= top:
            raise error(
                source, value.line, f"the value {excerpt(value.attributes.get('value', ''))}",
                f"a number between 0 and {top / unit:g}",
            )  # fmt: skip
        if NOT_MEASURED in words and number == 0:
            words.remove(NOT_MEASURED)
            number = np.nan
        numbers.append(number * unit)
        if any(words):
            remarks[index] = "; ".join(word for word in words if word)
    return np.array(numbers, np.float64), remarks


def _first_year(series: Element, count: int, source: str) -> tuple[int | None, str]:
    first = _year(series.first("interpretation", "firstYear"), source)
    last = _year(series.first("interpretation", "lastYear"), source)
    if first is not None and last is not None and last - first + 1 != count:
        return None, f"undated: {count} rings, but the file says {first} to {last}"
    if first is None and last is not None:
        return last - count + 1, ""
    return first, ""


def _year(element: Element | None, source: str) -> int | None:
    if element is None:
        return None
    year = parse_year(element.text, source, element.line)
    suffix = element.attributes.get("suffix", "AD")
    if suffix == "relative":
        return None
    if suffix not in ("AD", "BC", "BP"):
        raise error(source, element.line, f"the year suffix {excerpt(suffix)}", "AD, BC, BP or relative")
    return {"AD": year, "BC": 1 - year, "BP": 1950 - year}[suffix]


def _presence(wood: Element | None, name: str) -> bool | None:
    element = None if wood is None else wood.first(name)
    return None if element is None else _PRESENCE.get(element.attributes.get("presence", ""))


def _pith_years(wood: Element | None, source: str) -> int | None:
    """Rings on the sample that nobody measured, and rings that it lacks."""
    inner = _count(wood, source, "nrOfUnmeasuredInnerRings")
    missing = _count(wood, source, "heartwood", "missingHeartwoodRingsToPith")
    return None if inner is None and missing is None else (inner or 0) + (missing or 0)


def _count(wood: Element | None, source: str, *path: str) -> int | None:
    element = None if wood is None else wood.first(*path)
    if element is None or not element.text:
        return None
    count = parse_int(element.text)
    if count is None or not 0 <= count <= 10_000:
        raise FormatError(f"{source}, line {element.line}: {path[-1]} is {excerpt(element.text)}; expected a count")
    return count
