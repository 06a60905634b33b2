"""Calendar years of measured rings, from the year of the outermost wood inwards."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Dating:
    """What is known of a sample's years; astronomical years (0 is 1 BC).

    Parameters
    ----------
    outermost_year : int or None
        Year of the outermost wood; None when not dated.
    complete : bool
        Whether the last boundary ends that year's ring; False when wood of that year lies outside of it.
    absent_years : tuple of int
        Years without a ring at this place.
    """

    outermost_year: int | None = None
    complete: bool = True
    absent_years: tuple[int, ...] = ()

    def years_inwards(self, absent: Sequence[bool]) -> list[int]:
        """Years of rings from the sample's last boundary inwards; [] when undated.

        Parameters
        ----------
        absent : sequence of bool
            For each ring whether it is known to be absent: such a ring takes a year of `absent_years` if it meets one;
            the others pass those over.
        """
        if self.outermost_year is None:
            return []
        year = self.outermost_year - (0 if self.complete else 1)
        years: list[int] = []
        for is_absent in absent:
            while not is_absent and year in self.absent_years:
                year -= 1
            years.append(year)
            year -= 1
        return years

    def absent_between(self, first: int, last: int) -> list[int]:
        """Absent years from `first` to `last`, both included."""
        return sorted({year for year in self.absent_years if first <= year <= last})


def year_from_name(stem: str, pattern: str) -> int | None:
    """Year that the one group of a regular expression finds in a scan's name; None when it finds none."""
    match = re.search(pattern, stem)
    if match is None or match.group(1) is None:
        return None
    try:
        return int(match.group(1))
    except ValueError:
        return None


def dating_for(
    stem: str,
    outermost_year: int | None,
    year_pattern: str | None,
    outermost_complete: bool,
    absent_years: Sequence[int],
) -> tuple[Dating, list[str]]:
    """Dating of a scan and what to say about it; a year given outright comes before the one in the scan's name."""
    said = []
    year = outermost_year
    if year is None and year_pattern is not None:
        year = year_from_name(stem, year_pattern)
        if year is None:
            said.append(f"year_pattern {year_pattern!r} finds no year in {stem!r}: not dated")
    if year is None and absent_years:
        said.append("absent_years are left out: the series is not dated")
    return Dating(year, outermost_complete, tuple(absent_years)), said
