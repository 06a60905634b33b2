"""Writing TRiDaS 1.2.2 documents that the schema accepts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from woodfit.dendro.series import FloatArray, FormatError, RingSeries

NAMESPACE = "http://www.tridas.org/1.2.2"
NOT_MEASURED = "not measured"
"""Remark that tells an unmeasured ring from an absent one, both 0."""
CONFIDENCE = "ring boundary confidence"
PITH_DISTANCE = "pithDistance_mm"
REMARKS = frozenset((
    "fire damage", "frost damage", "crack", "false ring(s)", "compression wood", "tension wood", "traumatic ducts",
    "unspecified injury", "single pinned", "double pinned", "triple pinned", "missing ring", "radius shift up",
    "radius shift down", "moon ring(s)", "diffuse latewood", "density fluctuation", "wide late wood",
    "wide early wood",
))  # fmt: skip

_ILLEGAL = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class Project:
    """What the standard demands about the origin of the series.

    Parameters
    ----------
    title, type, laboratory, category, investigator, period : str
        The project, for instance ``type="Dating"``, ``period="2024-2026"``.
    object_title, object_type : str
        Site or building.
    taxon : str
        Species, for all series.
    sample_type : str
        For instance ``core`` or ``cross section``.
    """

    title: str = "unnamed project"
    type: str = "unknown"
    laboratory: str = "unknown"
    category: str = "unknown"
    investigator: str = "unknown"
    period: str = "unknown"
    object_title: str = "unnamed object"
    object_type: str = "unknown"
    taxon: str = "unknown"
    sample_type: str = "unknown"


def dumps(series: Sequence[RingSeries], project: Project | None = None) -> str:
    """Write a TRiDaS 1.2.2 document, widths in whole micrometres, one element, sample and radius to a series.

    Estimated rings to the pith are unmeasured inner rings where the pith is on the sample, and missing heartwood rings
    otherwise. Boundary confidences and the distance to the pith have no place in the standard and go into a
    unitless variable and a generic field. An unmeasured ring is 0 with the remark "not measured"; a ring narrower
    than half a micrometre is 1.

    Raises
    ------
    FormatError
        For empty series.
    """
    project = project or Project()
    empty = [one.name for one in series if len(one) == 0]
    if empty or not series:
        raise FormatError(f"series without rings cannot be written: {', '.join(map(repr, empty)) or 'there are none'}")
    out = ['<?xml version="1.0" encoding="UTF-8"?>', f'<tridas xmlns="{NAMESPACE}">', "<project>"]
    out += [_text("title", project.title), _text("type", project.type)]
    out += [f"<laboratory>{_text('name', project.laboratory)}<address/></laboratory>"]
    out += [_text(name, getattr(project, name)) for name in ("category", "investigator", "period")]
    out += ["<object>", _text("title", project.object_title), _text("type", project.object_type)]
    for one in series:
        out += ["<element>", _text("title", one.name), _text("taxon", project.taxon)]
        out += ["<sample>", _text("title", one.name), _text("type", project.sample_type)]
        out += ["<radius>", _text("title", one.name), *_measurement(one), "</radius>", "</sample>", "</element>"]
    out += ["</object>", "</project>", "</tridas>"]
    return "\n".join(out) + "\n"


def _measurement(series: RingSeries) -> Iterator[str]:
    yield "<measurementSeries>"
    yield _text("title", series.name)
    yield from _wood(series)
    yield '<measuringMethod normalTridas="onscreen measuring"/>'
    if series.first_year is None or series.last_year is None:
        yield "<interpretationUnsolved/>"
    else:
        years = _year("firstYear", series.first_year) + _year("lastYear", series.last_year)
        yield f"<interpretation>{years}</interpretation>"
    if series.pith_distance_mm is not None:
        yield f'<genericField name="{PITH_DISTANCE}" type="xs:float">{series.pith_distance_mm:.6g}</genericField>'
    yield from _values("ring width", series.width_mm, series.remarks)
    for variable, part in (("earlywood width", series.earlywood_mm), ("latewood width", series.latewood_mm)):
        if part is not None:
            yield from _values(variable, part, {})
    if series.confidence is not None:
        yield f"<values><variable>{CONFIDENCE}</variable><unitless/>"
        yield from (_value(f"{np.nan_to_num(value):.4f}", bool(np.isnan(value)), "") for value in series.confidence)
        yield "</values>"
    yield "</measurementSeries>"


def _wood(series: RingSeries) -> Iterator[str]:
    yield f"<woodCompleteness><ringCount>{len(series)}</ringCount>"
    if series.pith and series.pith_years is not None:
        yield f"<nrOfUnmeasuredInnerRings>{series.pith_years}</nrOfUnmeasuredInnerRings>"
    if series.unmeasured_outer is not None:
        yield f"<nrOfUnmeasuredOuterRings>{series.unmeasured_outer}</nrOfUnmeasuredOuterRings>"
    yield f'<pith presence="{ {None: "unknown", True: "complete", False: "absent"}[series.pith] }"/>'
    if series.pith_years is not None and not series.pith:
        missing = f"<missingHeartwoodRingsToPith>{series.pith_years}</missingHeartwoodRingsToPith>"
        yield f'<heartwood presence="unknown">{missing}</heartwood>'
    else:
        yield '<heartwood presence="unknown"/>'
    yield '<sapwood presence="unknown"/>'
    yield f'<bark presence="{ {None: "unknown", True: "present", False: "absent"}[series.bark] }"/></woodCompleteness>'


def _values(variable: str, width_mm: FloatArray, remarks: Mapping[int, str]) -> Iterator[str]:
    yield f'<values><variable normalTridas="{variable}"/><unit normalTridas="micrometres"/>'
    for ring, width in enumerate(width_mm):
        if not (np.isnan(width) or 0 <= width < 1e6):
            raise FormatError(f"a {variable} of {width:g} mm cannot be written; expected 0 to 1000000")
        unmeasured = bool(np.isnan(width))
        number = 0 if unmeasured else max(round(width * 1000), int(width > 0))
        yield _value(str(number), unmeasured, remarks.get(ring, ""))
    yield "</values>"


def _value(number: str, unmeasured: bool, remark: str) -> str:
    words = [word.strip() for word in remark.split(";") if word.strip()] + [NOT_MEASURED] * unmeasured
    inner = "".join(f'<remark normalTridas="{word}"/>' if word in REMARKS else _text("remark", word) for word in words)
    return f'<value value="{number}">{inner}</value>' if inner else f'<value value="{number}"/>'


def _year(name: str, year: int) -> str:
    """Year with its era; the standard has no year 0."""
    number, era = (year, "AD") if year > 0 else (1 - year, "BC")
    return f'<{name} suffix="{era}">{number}</{name}>'


def _text(name: str, text: str) -> str:
    return f"<{name}>{escape(_ILLEGAL.sub('�', text), quote=False)}</{name}>"
