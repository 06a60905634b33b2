"""``woodpipe series``: runs the scans up to their ring series and writes the files that dendrochronology exchanges."""

from __future__ import annotations

import json
import os
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.layout import Layout
from pipeline.problems import Problem, UsageError, did_you_mean

if TYPE_CHECKING:
    from woodfit.dendro.series import RingSeries

    Dumps = Callable[[Sequence[RingSeries]], str]

#: What ``--to`` takes; the second set needs no scale.
MM_FORMATS = ("rwl", "fh", "tridas", "csv", "csv-long", "json")
PX_FORMATS = ("pos", "boundaries")
UNITS_MM = {"0.01": 0.01, "0.001": 0.001}
LAST_STAGE = "ring_series"


@dataclass
class Exported:
    """What was written, what could not be, and what a person should know.

    Parameters
    ----------
    files
        Written.
    problems
        One line for each scan or series that is missing in them.
    notes
        About what was written.
    """

    files: list[Path] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def parse_formats(text: str) -> list[str]:
    """Formats named between commas, each once; `UsageError` names all that are unknown."""
    known = (*MM_FORMATS, *PX_FORMATS)
    names = list(dict.fromkeys(name.strip().lower() for name in text.split(",") if name.strip()))
    problems = [
        Problem("--to", f"no such format: {name}" + did_you_mean(name, known)) for name in names if name not in known
    ]
    if not names:
        problems = [Problem("--to", f"expected formats between commas, of {', '.join(known)}")]
    if problems:
        raise UsageError("The command cannot be followed", problems)
    return names


def parse_unit(text: str) -> float:
    """Unit of Tucson and Heidelberg files in mm."""
    if text not in UNITS_MM:
        problem = Problem("--unit", f"expected {' or '.join(UNITS_MM)} (mm), found {text!r}")
        raise UsageError("The command cannot be followed", [problem])
    return UNITS_MM[text]


def series_project(
    config: Path,
    formats: Sequence[str],
    out: Path | None,
    unit_mm: float,
    scan: str | None,
    execution: Mapping[str, Any],
    debug: bool,
) -> tuple[Exported, int]:
    """Run the scans of a config up to their series and write these; also the exit status."""
    from pipeline.commands import run_and_tell
    from pipeline.plan import Selection

    rows, loaded = run_and_tell(config, Selection(until=LAST_STAGE, scan=scan), execution, debug)
    layout = Layout(loaded.output)
    exported = Exported([], [f"{row.scan.name}: {row.message}" for row in rows if row.outcome == "failed"])
    documents: dict[Path, dict[str, Any]] = {}
    for row in rows:
        if row.outcome != "failed":
            documents[row.scan] = json.loads(layout.product(row.stem, "series.json").read_text(encoding="utf-8"))
    folder = loaded.output / "series" if out is None else out
    write_exports(documents, formats, folder, loaded.path.stem, unit_mm, exported)
    return exported, 1 if exported.problems else 0


def write_exports(
    documents: Mapping[Path, Mapping[str, Any]],
    formats: Sequence[str],
    folder: Path,
    name: str,
    unit_mm: float,
    exported: Exported,
) -> None:
    """Write the series of all scans in each format; what cannot be written is told and leaves the rest alone.

    Parameters
    ----------
    documents
        Scan to its ``series.json``.
    formats
        Of `MM_FORMATS` and `PX_FORMATS`.
    folder
        Made if need be.
    name
        Of the files that hold all series, without ending.
    unit_mm
        Of Tucson and Heidelberg files.
    exported
        Added to.
    """
    from woodfit.series_document import ring_series

    folder.mkdir(parents=True, exist_ok=True)
    wanted = [form for form in formats if form in MM_FORMATS]
    series: list[RingSeries] = []
    named: dict[str, str] = {}
    for scan, measured in documents.items():
        document = _without_known_names(scan, measured, named, exported)
        if document is None:
            continue
        if not any(path["rings"] for path in document["paths"]):
            exported.problems.append(f"{scan.name}: no ring was measured")
        elif document["pixel_size_mm"] is None:
            if wanted:
                exported.problems.append(
                    f"{scan.name}: no scale is known, expected one for {', '.join(wanted)}; set `scan.pixel_size_mm`"
                )
        else:
            series += ring_series(document)
        _write_marks(scan, document, formats, folder, exported)
    if series:
        undated = [one.first_year is None for one in series]
        if "rwl" in wanted and any(undated):
            told = "end in one year" if all(undated) else "start in year 1"
            exported.notes.append(f"series without a date {told} in .rwl; set `ring_series.outermost_year`")
        for form in wanted:
            _write_format(form, series, folder, name, unit_mm, exported)


def _without_known_names(
    scan: Path, document: Mapping[str, Any], named: dict[str, str], exported: Exported
) -> Mapping[str, Any] | None:
    """The document without series whose name another scan's has, since files could not tell them apart.

    ``F02b.png`` with four radii and ``F02b_N.png`` with one path give the same name. None when nothing is left.
    """
    kept = []
    for path in document["paths"]:
        if path["name"] in named:
            first = named[path["name"]]
            exported.problems.append(
                f"{scan.name}: its series {path['name']} is named as one of {first}, expected another; rename the scan"
            )
        else:
            kept.append(path)
            named[path["name"]] = scan.name
    return {**document, "paths": kept} if kept or not document["paths"] else None


def _write_marks(
    scan: Path, document: Mapping[str, Any], formats: Sequence[str], folder: Path, exported: Exported
) -> None:
    """Write a CooRecorder file for each path of a scan, and its table of boundaries."""
    from woodfit.dendro import boundary_table, coorecorder
    from woodfit.dendro.series import FormatError
    from woodfit.series_marks import boundary_marks, measured_path

    paths = [path for path in document["paths"] if path["rings"]]
    for path in paths if "pos" in formats else ():
        target = folder / f"{path['name']}.pos"
        try:
            text = coorecorder.dumps(measured_path(document, path, str(scan), str(target)))
        except FormatError as error:
            exported.problems.append(f"{scan.name}: {error}")
            continue
        exported.files.append(_write(target, text))
    if "boundaries" in formats and paths:
        text = boundary_table.dumps(boundary_marks({**document, "paths": paths}))
        exported.files.append(_write(folder / f"{scan.stem}.boundaries.csv", text))


def _write_format(
    form: str, series: Sequence[RingSeries], folder: Path, name: str, unit_mm: float, exported: Exported
) -> None:
    """Write all series in one format, those of earlywood and latewood beside where it has no place for them."""
    from woodfit.dendro import heidelberg, series_json, series_tables, tridas, tucson

    def rwl(some: Sequence[RingSeries]) -> str:
        return tucson.dumps(some, unit_mm)

    if form == "rwl":
        series = _ending_together(series)
        for ending, part in (("", series), ("e", tucson.earlywood(series)), ("l", tucson.latewood(series))):
            _write_series(folder / f"{name}{ending}.rwl", part, rwl, exported)
    elif form == "fh":
        _write_series(folder / f"{name}.fh", series, lambda some: heidelberg.dumps(some, unit_mm), exported)
    elif form == "tridas":
        _write_series(folder / f"{name}.xml", series, lambda some: tridas.dumps(some), exported)
    elif form == "csv":
        # Years and bare ring numbers cannot share a column.
        dated = [one for one in series if one.first_year is not None]
        floating = [one for one in series if one.first_year is None]
        second = f"{name}-undated.csv" if dated else f"{name}.csv"
        _write_series(folder / f"{name}.csv", dated, series_tables.dumps_wide, exported)
        _write_series(folder / second, floating, series_tables.dumps_wide, exported)
    elif form == "csv-long":
        _write_series(folder / f"{name}-long.csv", series, series_tables.dumps_long, exported)
    else:
        _write_series(folder / f"{name}.json", series, series_json.dumps, exported)


def _ending_together(series: Sequence[RingSeries]) -> Sequence[RingSeries]:
    """Series of which none is dated, with years from 1 that let all end at the bark in the same year."""
    if any(one.first_year is not None for one in series):
        return series
    outside = [one.unmeasured_outer or 0 for one in series]
    bark = max(len(one) + rings for one, rings in zip(series, outside, strict=True))
    return [replace(one, first_year=bark - rings - len(one) + 1) for one, rings in zip(series, outside, strict=True)]


def _write_series(target: Path, series: Sequence[RingSeries], dumps: Dumps, exported: Exported) -> None:
    """Write a file with all series that its format can hold; tell which it cannot."""
    from woodfit.dendro.series import FormatError

    if not series:
        return
    try:
        text = dumps(series)
    except FormatError as error:
        kept = []
        for one in series:
            try:
                dumps([one])
                kept.append(one)
            except FormatError as own:
                exported.problems.append(f"{target.name}: {own}")
        if not kept or len(kept) == len(series):
            if kept:
                exported.problems.append(f"{target.name}: {error}")
            return
        _write_series(target, kept, dumps, exported)
        return
    exported.files.append(_write(target, text))


def _write(target: Path, text: str) -> Path:
    """Write a file whole, its line ends as they are."""
    temporary = target.with_name(f".{target.name}.{uuid.uuid4().hex[:8]}")
    temporary.write_text(text, encoding="utf-8", newline="")
    os.replace(temporary, target)
    return target
