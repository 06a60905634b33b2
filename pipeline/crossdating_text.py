"""Crossdating as a table and in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from woodfit.dendro.crossdating import Comparison, Finding, too_short

if TYPE_CHECKING:
    from rich.table import Table

    from pipeline.crossdating import Crossdating, Segment


def crossdating_table(result: Crossdating) -> Table:
    """One line per series: span, correlations, segments, and what is likely wrong with it."""
    from rich.table import Table
    from rich.text import Text

    dated = result.calendar.dated
    table = Table(
        box=None, pad_edge=False, header_style="bold", title=f"Against {result.against}", title_justify="left"
    )
    for name in ("series", "years" if dated else "rings from the bark"):
        table.add_column(name, no_wrap=True)
    for name in ("common", "r", "t", "GLK"):
        table.add_column(name, justify="right", no_wrap=True)
    if result.segments:
        table.add_column("interseries r", justify="right", no_wrap=True)
        table.add_column("segments", no_wrap=True)
    table.add_column("likely wrong")
    for one in result.comparisons:
        cells = [
            one.name,
            _span(one.first_year, one.last_year) if dated else _span(-one.last_year, -one.first_year),
            str(one.overlap),
            _number(one.baillie_pilcher.r, 3),
            _number(one.baillie_pilcher.t, 1),
            _number(one.glk, 3),
        ]
        if result.segments:
            cells += [_number(result.interseries[one.name], 3), segments_text(result.segments[one.name])]
        table.add_row(*(Text(cell) for cell in cells), Text(_findings(one, dated), style="yellow"))
    return table


def segments_text(segments: list[Segment]) -> str:
    """How many segments are flagged."""
    flagged = [f"{count} {flag}" for flag in "AB" if (count := sum(one.flag == flag for one in segments))]
    return f"{' '.join(flagged) or 'none'} of {len(segments)}" if segments else "too short"


def finding_text(finding: Finding, dated: bool) -> str:
    """A missing or false ring in words, with its year and how sure that is."""
    year = str(finding.year) if dated else f"ring {-finding.year} from the bark"
    low, high = finding.first_year, finding.last_year
    span = "" if low == high else ", " + (_span(low, high) if dated else _span(-high, -low))
    what = "false ring" if finding.kind == "false" else "merged rings" if finding.merged else "missing ring"
    return f"{what} {year} ({100 * finding.probability:.0f} %{span})"


def _findings(one: Comparison, dated: bool) -> str:
    if too_short(one):
        return "too few common rings to tell"
    return "; ".join(finding_text(finding, dated) for finding in one.findings)


def _span(first: int, last: int) -> str:
    """Two years, readable before the year 0 too."""
    return f"{first}-{last}" if first >= 0 else f"{first} to {last}"


def _number(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"
