"""What stands behind the commands that take more than one call."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.problems import Problem, UsageError

if TYPE_CHECKING:
    from pipeline.cleaning import Leftover
    from pipeline.config import Config
    from pipeline.context import ScanRow
    from pipeline.evaluation import Evaluation
    from pipeline.layout import Layout
    from pipeline.plan import Selection


def run_project(config: Path, selection: Selection, execution: Mapping[str, Any], debug: bool) -> int:
    """Run a config and tell how it went; returns the exit status."""
    rows, _ = run_and_tell(config, selection, execution, debug)
    return 1 if any(row.outcome == "failed" for row in rows) else 0


def run_and_tell(
    config: Path, selection: Selection, execution: Mapping[str, Any], debug: bool
) -> tuple[list[ScanRow], Config]:
    """Run a config, print the summary and write the overview page; a row for each scan, and the config."""
    from pipeline.layout import Layout
    from pipeline.progress import reporter_for
    from pipeline.project import Project
    from pipeline.provenance import recorded_rows
    from pipeline.tables import make_console, summary_table
    from pipeline.threads import HEAVY

    console = make_console()
    project = Project.load(config)
    results = project.run(selection, reporter_for(console), execution, debug, HEAVY)
    rows = [row for _, row in results]
    if debug:
        for run, row in results:
            if run.trace:
                console.print(f"{row.scan.name}:\n{run.trace}", markup=False, highlight=False)
    console.print(summary_table(rows))
    others = [name for name in project.config.names if name not in {row.scan for row in rows}]
    layout = Layout(project.config.output)
    owner = {scan: block.name for block in project.config.blocks for scan in block.scans}
    every = [replace(row, block=owner.get(row.scan, "")) for row in (*rows, *recorded_rows(layout, others))]
    every.sort(key=lambda row: row.scan)
    index = write_index(project.config.output, every)
    if index is not None:
        console.print(f"open {index}", markup=False, highlight=False, soft_wrap=True)
    return rows, project.config


def write_index(output: Path, rows: Sequence[ScanRow]) -> Path | None:
    """Write the overview page if a scan has anything to look at."""
    import os

    if not any(row.products for row in rows):
        return None
    from pipeline.report import write_index as write

    final = output / "index.html"
    temporary = output / ".woodpipe" / "index.html"
    write(rows, temporary, output)
    os.replace(temporary, final)
    return final


def output_folder(config: Path, output: Path | None) -> Path:
    """Output folder named directly or by a config."""
    from pipeline.project import Project

    if output is not None:
        if not (output / ".woodpipe").is_dir():
            raise UsageError("Nothing to show", [Problem("--output", f"{output} is not the output of a run")])
        return output.absolute()
    return Project.load(config).config.output


def parse_size(size: str) -> tuple[int, int]:
    """Width and height from ``750x735``."""
    match = re.fullmatch(r"\s*(\d+)\s*[x×X]\s*(\d+)\s*", size)
    if match is None or min(int(part) for part in match.groups()) < 16:
        raise UsageError("The command cannot be followed", [Problem("--size", f"expected WxH, found {size!r}")])
    return int(match[1]), int(match[2])


def evaluate_project(
    config: Path, labels: Path | None, scan: str | None, by_folder: bool = False, tolerance_px: float = 3.0
) -> Evaluation:
    """Judge every scan whose truth is known; with notes on those that could not be judged."""
    from pipeline.evaluation import Evaluation, judge
    from pipeline.labels import TruthError, find_truth, read_species
    from pipeline.layout import Layout
    from pipeline.plan import Selection
    from pipeline.project import Project

    if labels is not None and not labels.is_dir():
        raise UsageError("The command cannot be followed", [Problem("--labels", f"there is no folder {labels}")])
    try:
        species = read_species(labels)
    except TruthError as error:
        raise UsageError("The command cannot be followed", [Problem("--labels", str(error))]) from error
    project = Project.load(config)
    project.select(Selection(scan=scan))
    layout = Layout(project.config.output)
    judged = {}
    notes = []
    for path in project.selected(scan):
        truth = find_truth(path, labels)
        rings, texture = (layout.product(path.stem, name) for name in ("rings.json", "texture.zarr.zip"))
        if truth is None:
            notes.append(f"{path.name}: no truth and no labels")
        elif not rings.exists():
            notes.append(f"{path.name}: no rings yet; run the pipeline first")
        else:
            solid = texture if texture.exists() else None
            try:
                judgement = judge(rings, truth, solid, path, tolerance_px, species, by_folder)
            except TruthError as error:
                notes.append(f"{path.name}: {error}")
                continue
            judged[path.name] = judgement
            notes += [f"{path.name}: {judgement.note}"] * bool(judgement.note)
    return Evaluation(judged, notes, tolerance_px)


def leftovers_of(config: Path, output: Path | None) -> tuple[Layout, list[Leftover], list[Path]]:
    """What could be removed from an output folder, and the configs that hold on to the rest."""
    from pipeline.cleaning import all_plans, find_leftovers, known_configs, reachable_keys
    from pipeline.layout import Layout
    from pipeline.project import all_stages

    layout = Layout(output_folder(config, output))
    configs = sorted({*known_configs(layout), *([config.absolute()] if output is None else [])})
    plans = all_plans(layout, configs, all_stages())
    return layout, find_leftovers(layout, reachable_keys(plans)), configs
