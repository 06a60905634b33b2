"""Writing Heidelberg files (.fh)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from woodfit.dendro.series import FloatArray, FormatError, RingSeries

NOT_MEASURED = "not measured"
"""Comment that tells an unmeasured ring from an absent one, both 0."""
EARLY, LATE = "_EW", "_LW"
"""Endings of the names of earlywood and latewood blocks."""


def dumps(series: Sequence[RingSeries], unit_mm: float = 0.001) -> str:
    """Write a Heidelberg file.

    Earlywood and latewood follow as blocks of their own, named with ``_EW`` and ``_LW``. A series with remarks or
    unmeasured rings is written one ring per line with comments; an unmeasured ring is 0 with the comment "not
    measured". A ring narrower than half a unit is written as 1, since 0 means an absent ring.

    Parameters
    ----------
    series : sequence of RingSeries
        With distinct names.
    unit_mm : float
        0.01 or 0.001.

    Raises
    ------
    FormatError
        For equal or unprintable names and widths that need more than five digits.
    """
    if unit_mm not in (0.01, 0.001):
        raise FormatError(f"a Heidelberg file is not written in units of {unit_mm} mm; expected 0.01 or 0.001")
    blocks: list[tuple[str, str, RingSeries, FloatArray]] = []
    for one in series:
        blocks.append((one.name, "Ringwidth", one, one.width_mm))
        for ending, kind, part in ((EARLY, "Earlywood", one.earlywood_mm), (LATE, "Latewood", one.latewood_mm)):
            if part is not None:
                blocks.append((one.name + ending, kind, one, part))
    names = [name for name, *_ in blocks]
    if len(set(names)) < len(names):
        raise FormatError("several series of a Heidelberg file would have the same name; give each its own")
    return "".join(_write(name, kind, one, width, unit_mm) for name, kind, one, width in blocks)


def _write(name: str, kind: str, series: RingSeries, width_mm: FloatArray, unit_mm: float) -> str:
    if not name.strip() or not name.isprintable() or len(series) == 0:
        raise FormatError(f"series {name!r} cannot be written; expected a printable name and at least one ring")
    first = series.first_year
    header = {
        "KeyCode": name.strip(),
        "DataFormat": "Tree",
        "DataType": kind,
        "Unit": f"1/{round(1 / unit_mm)} mm",
        "Length": str(len(series)),
        "DateBegin": None if first is None else str(first),
        "DateEnd": None if first is None else str(series.last_year),
        "Dated": "Undated" if first is None else "Dated",
        "Pith": None if series.pith is None else "P" if series.pith else "-",
        "Bark": None if series.bark is None else "B" if series.bark else "-",
        "MissingRingsBefore": None if series.pith_years is None else str(series.pith_years),
        "MissingRingsAfter": None if series.unmeasured_outer is None else str(series.unmeasured_outer),
    }
    out = ["HEADER:", *(f"{key}={value}" for key, value in header.items() if value is not None), "DATA:Tree"]
    cells = [_cell(width, name, unit_mm) for width in width_mm]
    words = {ring: _word(remark) for ring, remark in series.remarks.items()} if kind == "Ringwidth" else {}
    words |= {int(ring): NOT_MEASURED for ring in np.flatnonzero(np.isnan(width_mm))}
    if words:
        out += [f"{cell};;{words.get(ring, '')}" for ring, cell in enumerate(cells)]
    else:
        padded = cells + [0] * (-len(cells) % 10)
        out += ["".join(f"{cell:6d}" for cell in padded[at : at + 10]) for at in range(0, len(padded), 10)]
    return "\r\n".join(out) + "\r\n"


def _word(remark: str) -> str:
    return "; ".join(" ".join(part.split()) for part in remark.split(";"))


def _cell(width_mm: float, name: str, unit_mm: float) -> int:
    if np.isnan(width_mm):
        return 0
    if not 0 <= width_mm / unit_mm < 99999.5:
        raise FormatError(f"series {name!r}: a width of {width_mm:g} mm does not fit into the columns of the file")
    return max(round(width_mm / unit_mm), int(width_mm > 0))
