"""Series on one calendar, each compared with the mean of the others or with a master."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from woodfit.dendro.agreement import Agreement, baillie_pilcher, gleichlaeufigkeit, hollstein
from woodfit.dendro.misdating import FEWEST_RINGS, Kind, find_misdating
from woodfit.dendro.ring_lags import mean_index
from woodfit.dendro.series import RingSeries

FloatArray = npt.NDArray[np.float64]

#: Longest calendar, in years; longer ones come from mistyped years.
LONGEST_CALENDAR = 30_000


@dataclass(frozen=True)
class Calendar:
    """Ring widths of several series, year by year.

    Parameters
    ----------
    names : tuple of str
        One per series.
    years : int64 array of shape (years,)
        Consecutive. Without any date, minus the ring's number from the bark: -1 is the outermost ring.
    width_mm : float64 array of shape (series, years)
        NaN where a series has no ring or no width; 0 for absent rings.
    dated : bool
        Whether the years are years.
    assumed : tuple of str
        Undated series that were laid with their bark at the last year of the dated ones.
    """

    names: tuple[str, ...]
    years: npt.NDArray[np.int64]
    width_mm: FloatArray
    dated: bool
    assumed: tuple[str, ...]


@dataclass(frozen=True)
class Finding:
    """A ring that is likely missing or false.

    Parameters
    ----------
    kind : "missing" or "false"
        A ring too few or one too many. Where a ring is missing, all older rings are dated too young.
    year : int
        The likeliest year of the calendar.
    first_year, last_year : int
        Between these it lies with nine tenths of the probability.
    probability : float
        That there is such a ring, 0..1.
    merged : bool
        Missing only: rather measured as one with the ring before than not there.
    """

    kind: Kind
    year: int
    first_year: int
    last_year: int
    probability: float
    merged: bool


@dataclass(frozen=True)
class Comparison:
    """One series against what it is compared with.

    Parameters
    ----------
    name : str
        The series.
    first_year, last_year : int
        Of the calendar.
    rings : int
        Rings of the series with a width or absent.
    overlap : int
        Of these, rings in years that the other has too.
    baillie_pilcher, hollstein : Agreement
        Correlations and their t.
    glk : float
        Gleichläufigkeit, 0..1; NaN without an overlap.
    findings : tuple of Finding
        From the youngest to the oldest.
    """

    name: str
    first_year: int
    last_year: int
    rings: int
    overlap: int
    baillie_pilcher: Agreement
    hollstein: Agreement
    glk: float
    findings: tuple[Finding, ...]


def on_one_calendar(series: Sequence[RingSeries]) -> Calendar:
    """Lay series side by side.

    Undated series end at the bark: in the last year of the dated ones, or, when none is dated, all in one year.

    Parameters
    ----------
    series : sequence of RingSeries
        With at least one ring that has a width each; names are made unique by a number.

    Returns
    -------
    Calendar
        With every year from the first ring to the last.

    Raises
    ------
    ValueError
        Without any series, for a series without a width, and for a calendar longer than `LONGEST_CALENDAR`.
    """
    if not series:
        raise ValueError("no series of ring widths")
    for one in series:
        if not np.isfinite(one.width_mm).any():
            raise ValueError(f"series {one.name!r} has no ring with a width")
    ends = [one.last_year + (one.unmeasured_outer or 0) for one in series if one.last_year is not None]
    bark = max(ends) if ends else -1
    last = [bark - (one.unmeasured_outer or 0) if one.last_year is None else one.last_year for one in series]
    first = [end - len(one) + 1 for end, one in zip(last, series, strict=True)]
    start, length = min(first), max(last) - min(first) + 1
    if length > LONGEST_CALENDAR:
        raise ValueError(f"the series span {length} years, from {start} to {max(last)}; is a year mistyped?")
    width = np.full((len(series), length), np.nan)
    for row, (one, year) in enumerate(zip(series, first, strict=True)):
        width[row, year - start : year - start + len(one)] = one.width_mm
    names = _unique([one.name for one in series])
    assumed = tuple(name for name, one in zip(names, series, strict=True) if one.first_year is None and ends)
    return Calendar(names, np.arange(start, start + length), width, bool(ends), assumed)


def compare_each(calendar: Calendar, surest: float = 0.5) -> list[Comparison]:
    """Each series against the mean of the others.

    Parameters
    ----------
    calendar : Calendar
        Of at least two series.
    surest : float
        Least probability of a finding.

    Returns
    -------
    list of Comparison
        In the calendar's order.

    Raises
    ------
    ValueError
        For fewer than two series.
    """
    count = len(calendar.names)
    if count < 2:
        raise ValueError("one series alone cannot be crossdated; give a partner or a master")
    rows = np.arange(count)
    return [compare(calendar, row, mean_index(calendar.width_mm[rows != row]), surest) for row in range(count)]


def compare(calendar: Calendar, row: int, other: FloatArray, surest: float = 0.5) -> Comparison:
    """One series against another or a master.

    Parameters
    ----------
    calendar : Calendar
        With the series.
    row : int
        Which series.
    other : float64 array of shape (years,)
        Widths or indices in the calendar's years, NaN where there are none.
    surest : float
        Least probability of a finding.

    Returns
    -------
    Comparison
        The figures; findings only where at least `FEWEST_RINGS` are common.
    """
    width = calendar.width_mm[row]
    held = np.flatnonzero(np.isfinite(width))
    first, last = int(held[0]), int(held[-1])
    found = find_misdating(width[first : last + 1], other[: last + 1], surest)
    end = int(calendar.years[last])
    return Comparison(
        calendar.names[row],
        int(calendar.years[first]),
        end,
        len(held),
        int((np.isfinite(width) & np.isfinite(other)).sum()),
        baillie_pilcher(width, other),
        hollstein(width, other),
        gleichlaeufigkeit(width, other),
        tuple(
            Finding(
                event.kind,
                end - event.ring,
                end - event.spread[1],
                end - event.spread[0],
                event.probability,
                event.merged,
            )
            for event in found
        ),
    )


def too_short(comparison: Comparison) -> bool:
    """Whether too few rings are common to look for missing and false ones."""
    return comparison.overlap < FEWEST_RINGS


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    """Names, with a number after those that were there before."""
    used: set[str] = set()
    unique = []
    for name in names:
        fresh, number = name, 2
        while fresh in used:
            fresh, number = f"{name}#{number}", number + 1
        used.add(fresh)
        unique.append(fresh)
    return tuple(unique)
