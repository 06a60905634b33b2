"""The commands: each reads its options, calls one function, prints, and sets the exit status."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline import cli_carve, cli_export, cli_gallery, cli_render, cli_view
from pipeline.cli_app import (
    DEFAULT_CONFIG,
    DebugOption,
    ForceOption,
    FromOption,
    JsonOption,
    OptionalConfig,
    ScanOption,
    StageOption,
    UntilOption,
    app,
    told_to_people,
)

__all__ = ["app", "cli_carve", "cli_export", "cli_gallery", "cli_render", "cli_view"]


@app.command()
def run(
    config: OptionalConfig = DEFAULT_CONFIG,
    stage: StageOption = None,
    from_stage: FromOption = None,
    until: UntilOption = None,
    force: ForceOption = False,
    scan: ScanOption = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="'local' cluster, tcp://... of an existing one, or 'threads' for this process.")
    ] = None,
    tile: Annotated[int | None, typer.Option(metavar="PX", help="Side of the tiles of large scans.")] = None,
    debug: DebugOption = False,
) -> None:
    """Bring every scan up to date."""
    with told_to_people(debug):
        from pipeline.commands import run_project
        from pipeline.plan import Selection

        options = {"workers": workers, "scheduler": scheduler, "tile": tile}
        given = {name: value for name, value in options.items() if value is not None}
        selection = Selection(stage, from_stage, until, force, scan)
        status = run_project(config, selection, given, debug)
    raise typer.Exit(status)


@app.command()
def plan(
    config: OptionalConfig = DEFAULT_CONFIG,
    stage: StageOption = None,
    from_stage: FromOption = None,
    until: UntilOption = None,
    force: ForceOption = False,
    scan: ScanOption = None,
    debug: DebugOption = False,
) -> None:
    """Say for every scan and stage whether it would be reused or run, and why."""
    with told_to_people(debug):
        from pipeline.plan import Selection
        from pipeline.project import Project
        from pipeline.tables import make_console, plan_table

        plans = Project.load(config).plan(Selection(stage, from_stage, until, force, scan))
        make_console().print(plan_table(plans))


@app.command()
def status(config: OptionalConfig = DEFAULT_CONFIG, debug: DebugOption = False) -> None:
    """Show which results and products are there, scan by scan."""
    with told_to_people(debug):
        from pipeline.project import Project
        from pipeline.tables import make_console, status_table

        make_console().print(status_table(Project.load(config).plan()))


@app.command()
def stages(json_output: JsonOption = False, debug: DebugOption = False) -> None:
    """List the stages with their parameters, defaults and help."""
    with told_to_people(debug):
        from pipeline.project import all_stages

        if json_output:
            _print_json({item.name: item.params_type.model_json_schema() for item in all_stages()})
            return
        from pipeline.tables import make_console, stages_text

        make_console().print(stages_text(all_stages()))


@app.command()
def show(
    scan: Annotated[str, typer.Argument(metavar="SCAN", help="The scan: its name without suffix, or its path.")],
    config: Annotated[Path, typer.Option("--config", help="The YAML file.")] = DEFAULT_CONFIG,
    output: Annotated[Path | None, typer.Option("--output", help="The output folder, instead of a config.")] = None,
    json_output: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Show where a scan's results and products lie and how they came about."""
    with told_to_people(debug):
        from pipeline.commands import output_folder
        from pipeline.layout import Layout
        from pipeline.provenance import provenance_of, recorded_stems, stem_of

        layout = Layout(output_folder(config, output))
        known = provenance_of(layout, stem_of(scan, recorded_stems(layout)))
        if json_output:
            _print_json(known)
            return
        from pipeline.tables import make_console, provenance_tables

        for part in provenance_tables(known):
            make_console().print(part)


@app.command()
def sample(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Where to write; made if need be.")],
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of the scans, px.")] = "750x735",
    seed: Annotated[int, typer.Option(min=0, help="Another seed, other trees.")] = 0,
    debug: DebugOption = False,
) -> None:
    """Draw sample scans of boards whose truth is known, and the truth beside them."""
    with told_to_people(debug):
        from pipeline.commands import parse_size
        from woodfit.synthetic_scenes import write_sample

        width, height = parse_size(size)
        for path in write_sample(directory, (height, width), seed):
            print(path)


@app.command()
def evaluate(
    config: OptionalConfig = DEFAULT_CONFIG,
    labels: Annotated[Path | None, typer.Option("--labels", metavar="DIR", help="Folder with label files.")] = None,
    scan: ScanOption = None,
    species: Annotated[
        bool, typer.Option("--species", help="Take a scan's folder for its species where none is said.")
    ] = False,
    tolerance: Annotated[float, typer.Option(min=0.0, metavar="PX", help="How far from a label is a hit.")] = 3.0,
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Write every figure to a table.")] = None,
    json_output: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Compare rings, widths and textures with hand labels or the truth of drawn samples."""
    with told_to_people(debug):
        from pipeline.commands import evaluate_project
        from pipeline.evaluation_tables import evaluation_parts, write_csv

        evaluation = evaluate_project(config, labels, scan, species, tolerance)
        if csv is not None:
            write_csv(csv, evaluation)
        if json_output:
            _print_json(evaluation.as_json())
        else:
            from pipeline.tables import make_console

            make_console().print(*evaluation_parts(evaluation), sep="\n")
    for note in evaluation.notes:
        print(note, file=sys.stderr)
    raise typer.Exit(0 if evaluation.scans else 1)


@app.command()
def series(
    config: OptionalConfig = DEFAULT_CONFIG,
    to: Annotated[
        str,
        typer.Option(
            "--to", metavar="FORMATS", help="rwl, fh, tridas, csv, csv-long, json, pos, boundaries; between commas."
        ),
    ] = "rwl,pos",
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where to write; default: series in the output folder.")
    ] = None,
    unit: Annotated[str, typer.Option("--unit", metavar="MM", help="Unit of .rwl and .fh: 0.01 or 0.001.")] = "0.001",
    scan: ScanOption = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="'local' cluster, tcp://... of an existing one, or 'threads' for this process.")
    ] = None,
    debug: DebugOption = False,
) -> None:
    """Measure ring widths and write them in the formats of dendrochronology.

    One file holds the series of all scans; pos is written for each path, and
    boundaries for each scan: these a person can correct. What fails or has no
    scale is told in a line and left out, and the exit status is then 1.
    """
    with told_to_people(debug):
        from pipeline.series import parse_formats, parse_unit, series_project

        options = {"workers": workers, "scheduler": scheduler}
        given = {name: value for name, value in options.items() if value is not None}
        exported, status = series_project(config, parse_formats(to), out, parse_unit(unit), scan, given, debug)
    for file in exported.files:
        print(file)
    for line in (*exported.notes, *exported.problems):
        print(line, file=sys.stderr)
    raise typer.Exit(status)


@app.command()
def crossdate(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES...", help="Series: .rwl, .pos, .fh, .xml, .csv, .json, or a scan's product folder."
        ),
    ],
    master: Annotated[
        Path | None, typer.Option("--master", metavar="FILE", help="Compare with its mean, not with the other series.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Draw the segment correlations: .png, .svg or .pdf.")
    ] = None,
    json_output: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Compare ring width series year by year, and name the years of rings likely missing or false."""
    with told_to_people(debug):
        from pipeline.crossdating import as_json, crossdate_files, draw_segments

        result = crossdate_files(files, master)
        if plot is not None:
            draw_segments(result, plot)
        if json_output:
            _print_json(as_json(result))
        else:
            from pipeline.crossdating_text import crossdating_table
            from pipeline.tables import make_console

            make_console().print(crossdating_table(result))
    for note in result.notes:
        print(note, file=sys.stderr)


@app.command()
def ablate(
    scan: Annotated[str, typer.Argument(metavar="SCAN", help="The scan: its name without suffix, or its path.")],
    config: Annotated[Path, typer.Option("--config", help="The YAML file.")] = DEFAULT_CONFIG,
    steps: Annotated[int, typer.Option(min=1, help="Steps of gradient descent on the image loss.")] = 500,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="PNG to write; default: ablation.png beside its rings.")
    ] = None,
    debug: DebugOption = False,
) -> None:
    """Draw why the phase is fitted and not the image: both fits of a scan side by side, front and inside."""
    with told_to_people(debug):
        from pipeline.ablation import ablate_scan

        path = ablate_scan(config, scan, steps, out, debug)
        if path is not None:
            print(path)
    raise typer.Exit(0 if path is not None else 1)


@app.command()
def clean(
    config: OptionalConfig = DEFAULT_CONFIG,
    output: Annotated[Path | None, typer.Option("--output", help="The output folder, instead of a config.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    debug: DebugOption = False,
) -> None:
    """Remove results that no config reaches any more, after saying which."""
    with told_to_people(debug):
        from pipeline.cleaning import human_size, remove
        from pipeline.commands import leftovers_of

        layout, leftovers, configs = leftovers_of(config, output)
        print("reached by: " + (", ".join(str(path) for path in configs) or "no config"))
        for leftover in leftovers:
            print(f"{human_size(leftover.size):>10}  {leftover.stage}  {leftover.path.name}")
        if not leftovers:
            print("nothing to remove")
            return
        total = human_size(sum(leftover.size for leftover in leftovers))
        if not yes and not typer.confirm(f"Remove these {len(leftovers)} results, {total}?"):
            raise typer.Exit(1)
        print(f"removed {remove(layout, leftovers)} of {len(leftovers)} results, {total}")


def _print_json(value: Any) -> None:
    import json

    print(json.dumps(value, indent=2, default=str))
