"""Crossdating of series in files: our own figures, and segment correlations through dplPy where it is installed.

dplPy is an optional extra under the GPL; it is called here, lazily, and nowhere else.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.problems import Problem, UsageError
from woodfit.dendro.crossdating import Calendar, Comparison, compare, compare_each, on_one_calendar
from woodfit.dendro.ring_lags import mean_index
from woodfit.dendro.series import FormatError, RingSeries

FloatArray = npt.NDArray[np.float64]

EXTRA = "segment correlations need dplPy: pip install 'woodpipe[dendro]'"


@dataclass(frozen=True)
class Segment:
    """Correlation of fifty years of a series with its master, as COFECHA tests them.

    Parameters
    ----------
    first_year, last_year : int
        Of the segment.
    r : float
        Correlation as dated.
    critical : float
        What it should reach, one-tailed 99 %.
    flag : str
        ``"A"`` below that, ``"B"`` higher at another lag, else empty.
    best_lag : int
        Lag of the highest correlation; negative when the series is a ring short.
    best_r : float
        Correlation there.
    """

    first_year: int
    last_year: int
    r: float
    critical: float
    flag: str
    best_lag: int
    best_r: float


@dataclass(frozen=True)
class Crossdating:
    """What is known of all series.

    Parameters
    ----------
    calendar : Calendar
        The series.
    against : str
        What each was compared with, in words.
    comparisons : list of Comparison
        One per series.
    interseries : dict of str to float
        Correlation of each prewhitened series with its master; empty without dplPy.
    segments : dict of str to list of Segment
        Empty without dplPy.
    notes : list of str
        What a person should know.
    """

    calendar: Calendar
    against: str
    comparisons: list[Comparison]
    interseries: dict[str, float]
    segments: dict[str, list[Segment]]
    notes: list[str]


def crossdate_files(files: Sequence[Path], master: Path | None = None) -> Crossdating:
    """Crossdate the series of some files.

    Parameters
    ----------
    files
        Files of any format that is read, or product folders of scans.
    master
        A file whose series, or their mean, the others are compared with; the mean of the others when ``None``.

    Raises
    ------
    UsageError
        With every file that cannot be read and why, or when there is nothing to compare.
    """
    problems: list[Problem] = []
    series = [one for path in files for one in _read(path, problems)]
    masters = [] if master is None else _read(master, problems)
    if problems:
        raise UsageError("Cannot crossdate", problems)
    try:
        return crossdate(series, masters, "" if master is None else master.name)
    except ValueError as error:
        raise UsageError("Cannot crossdate", [Problem("", str(error))]) from None


def crossdate(series: Sequence[RingSeries], masters: Sequence[RingSeries] = (), master_name: str = "") -> Crossdating:
    """Crossdate series with each other, or with the mean of `masters`.

    Raises
    ------
    ValueError
        When there is nothing to compare.
    """
    if not series:
        raise ValueError("no series of ring widths in these files")
    notes: list[str] = []
    everything = on_one_calendar([*series, *masters])
    many = len(series)
    calendar = Calendar(
        everything.names[:many], everything.years, everything.width_mm[:many], everything.dated, everything.assumed
    )
    if masters:
        other = mean_index(everything.width_mm[many:]) if len(masters) > 1 else everything.width_mm[many]
        comparisons = [compare(calendar, row, other) for row in range(many)]
        against = master_name
    else:
        other = None
        comparisons = compare_each(calendar)
        against = "the mean of the others" if many > 2 else "the other series"
    interseries, segments = _through_dplpy(calendar, other, notes)
    return Crossdating(calendar, against, comparisons, interseries, segments, [*_words(calendar, comparisons), *notes])


def draw_segments(result: Crossdating, path: Path) -> None:
    """Write the picture of the segment correlations.

    Raises
    ------
    UsageError
        When there are none, or the suffix is of no picture.
    """
    from pipeline.report.segment_raster import write_segment_raster

    suffixes = (".png", ".svg", ".pdf")
    if path.suffix.lower() not in suffixes:
        raise UsageError("Cannot draw", [Problem(str(path), f"expected a name that ends in {', '.join(suffixes)}")])
    if not any(result.segments.values()):
        reason = next((note for note in result.notes if "dplPy" in note), "no series has a segment of fifty years")
        raise UsageError("Cannot draw the segment correlations", [Problem("", reason)])
    write_segment_raster(result, path)


def _words(calendar: Calendar, comparisons: Sequence[Comparison]) -> list[str]:
    """What the figures rest on."""
    words = []
    if not calendar.dated:
        words.append("No series is dated: all are taken to end at the bark, and rings are counted from there.")
    elif calendar.assumed:
        listed = ", ".join(calendar.assumed)
        words.append(f"Not dated, taken to end at the bark in the last year of the dated ones: {listed}.")
    if len(calendar.names) == 2 and any(comparison.findings for comparison in comparisons):
        words.append("With two series a ring missing in one looks like a false ring in the other.")
    return words


def _read(path: Path, problems: list[Problem]) -> list[RingSeries]:
    """Series of a file or product folder; what is wrong goes to `problems`."""
    from pipeline.series_files import read_series

    try:
        return read_series(path)
    except (FormatError, OSError) as error:
        problems.append(Problem(str(path), str(error).removeprefix(str(path)).lstrip(":, ")))
        return []


def _through_dplpy(
    calendar: Calendar, master: FloatArray | None, notes: list[str]
) -> tuple[dict[str, float], dict[str, list[Segment]]]:
    """Interseries correlations and segments by dplPy's COFECHA preset; empty, with a note, where it is missing."""
    frames = [calendar.width_mm] if master is None else [np.stack([row, master]) for row in calendar.width_mm]
    interseries: dict[str, float] = {}
    segments: dict[str, list[Segment]] = {}
    try:
        found = [_xdate(widths, calendar.years) for widths in frames]
    except ImportError:
        notes.append(EXTRA)
        return {}, {}
    except (ValueError, TypeError, np.linalg.LinAlgError) as error:
        notes.append(f"dplPy gives no segment correlations: {error}")
        return {}, {}
    for row, name in enumerate(calendar.names):
        result, column = (found[0], row) if master is None else (found[row], 0)
        interseries[name] = float(result["overall"]["rho"].iloc[column])
        segments[name] = [
            Segment(
                int(one["lo"]),
                int(one["hi"]),
                float(one["r0"]),
                float(one["crit"]),
                str(one["flag"]),
                int(one["best_lag"]),
                float(one["best_corr"]),
            )
            for one in result["segments"].get(str(column), [])
        ]
    return interseries, segments


def _xdate(widths: FloatArray, years: npt.NDArray[np.int64]) -> dict[str, Any]:
    """Crossdating of all rows by dplPy; columns are named by their number."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import dplpy
        import pandas

        frame = pandas.DataFrame(widths.T, index=pandas.Index(years, name="Year"), columns=_numbers(len(widths)))
        # An absent ring has no say in a segment, but the years before and after it keep theirs.
        result: dict[str, Any] = dplpy.xdate(frame, preset="COFECHA", show_flags=False, absent=frame == 0)
    return result


def _numbers(count: int) -> list[str]:
    return [str(number) for number in range(count)]


def as_json(result: Crossdating) -> dict[str, Any]:
    """Everything, as JSON can hold it: what is not a number becomes null."""
    rows = []
    for comparison in result.comparisons:
        row = asdict(comparison)
        row["interseries"] = result.interseries.get(comparison.name)
        row["segments"] = [asdict(segment) for segment in result.segments.get(comparison.name, [])]
        rows.append(row)
    text = {
        "against": result.against,
        "years": "years" if result.calendar.dated else "minus the ring's number from the bark",
        "series": rows,
        "notes": result.notes,
    }
    plain: dict[str, Any] = _plain(text)
    return plain


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
