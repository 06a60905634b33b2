"""The three header lines that may stand before the data of a Tucson file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from woodfit.dendro.series import FormatError, RingSeries
from woodfit.dendro.text import parse_int
from woodfit.dendro.tucson_lines import HEADER_LINES, split_lines

KINDS = {"__": "ring width", "E_": "earlywood width", "L_": "latewood width"}


@dataclass(frozen=True)
class TucsonHeader:
    """Site of a Tucson file.

    Parameters
    ----------
    site_id : str
        Up to 6 characters.
    site, country, species, investigators : str
        Names of up to 52, 13, 18 and 63 characters.
    species_code : str
        Four letters, for example ``PISY``.
    elevation : str
        With its unit, for example ``320M``.
    coordinates : str
        Latitude and longitude as degrees and minutes, for example ``6700-2707``.
    kind : str
        ``__`` ring width, ``E_`` earlywood width, ``L_`` latewood width.
    date : str
        Day of completion, 8 characters.
    """

    site_id: str
    site: str = ""
    species_code: str = ""
    country: str = ""
    species: str = ""
    elevation: str = ""
    coordinates: str = ""
    kind: str = "__"
    investigators: str = ""
    date: str = ""

    def lines(self, series: Sequence[RingSeries]) -> list[str]:
        """Write the header of a file with these series, whose years it names.

        Raises
        ------
        FormatError
            When an entry is too long, or would be read as a year.
        """
        years = [year for one in series for year in (one.first_year, one.last_year) if year is not None]
        span = f"{min(years):5d}{max(years):5d}" if years else ""
        rows: list[list[tuple[int, int, str]]] = [
            [(10, 61, self.site), (62, 65, self.species_code)],
            [(10, 22, self.country), (23, 40, self.species), (41, 45, self.elevation), (48, 57, self.coordinates),
             (62, 63, self.kind), (67, 76, span)],
            [(10, 72, self.investigators), (73, 80, self.date)],
        ]  # fmt: skip
        out = []
        for number, row in enumerate(rows, 1):
            line = ""
            for first, last, entry in [(1, 6, self.site_id), (8, 8, str(number)), *row]:
                if len(entry) > last - first + 1 or not entry.isprintable():
                    raise FormatError(f"Tucson header: {entry!r} exceeds columns {first}-{last} of line {number}")
                line = f"{line:<{first - 1}}{entry}"
            if parse_int(line[8:12].strip()) is not None:
                raise FormatError(f"Tucson header: {line[8:].strip()!r} would read as a year; begin it with a letter")
            out.append(line.rstrip())
        return out


def read_header(text: str, source: str = "text") -> TucsonHeader | None:
    """Header of a Tucson file, None when it has none of three lines."""
    lines, _ = split_lines(text, source)
    if len(lines) != HEADER_LINES:
        return None
    first, second, third = lines
    return TucsonHeader(
        site_id=first[:6].strip(),
        site=first[9:61].strip(),
        species_code=first[61:65].strip(),
        country=second[9:22].strip(),
        species=second[22:40].strip(),
        elevation=second[40:45].strip(),
        coordinates=second[47:57].strip(),
        kind=second[61:63].strip() if second[61:63].strip() in KINDS else "__",
        investigators=third[9:72].strip(),
        date=third[72:80].strip(),
    )
