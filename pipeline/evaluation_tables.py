"""What `woodpipe evaluate` prints and writes: the paper's table, and what dendrochronologists ask besides."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from pipeline.evaluation import ALL, Evaluation, Figure

NOTHING = "–"

# Figure and heading; a table is shown when a scan has one of its figures.
BOUNDARIES = {
    "boundaries": "rings",
    "sensitivity": "sen\n{px}",
    "precision": "pre\n{px}",
    "f": "F\n{px}",
    "fine_sensitivity": "sen\n0.1 mm",
    "fine_precision": "pre\n0.1 mm",
    "fine_f": "F\n0.1 mm",
    "position_median_px": "error\npx",
    "position_p95_px": "95 %\npx",
    "position_median_mm": "error\nmm",
    "position_p95_mm": "95 %\nmm",
    "width_r": "width\nr",
    "width_rmse_mm": "width\nrmse mm",
    "series_r": "series\nr",
}
FACES = {"label_share": "labels traced", "traced_share": "traced labelled", "label_median_px": "median px"}
DISCS = {
    "influence_rings": "rings",
    "influence_recall": "R",
    "influence_precision": "P",
    "influence_f": "F",
    "influence_rmse_px": "rmse px",
    "influence_rmse_mm": "rmse mm",
}
COUNTS = ("boundaries", "influence_rings")


def evaluation_parts(evaluation: Evaluation) -> list[Table | Text]:
    """Tables and lines for the terminal; only those that have something to say."""
    scans = {name: judgement.figures() for name, judgement in evaluation.scans.items()}
    pooled = evaluation.pooled()
    tolerance = f"{evaluation.tolerance_px:g} px"
    parts: list[Table | Text] = []
    kinds: Sequence[tuple[str, Mapping[str, str]]] = (
        ("Boundaries along labelled paths", {key: name.format(px=tolerance) for key, name in BOUNDARIES.items()}),
        (f"Faces: share of length within {tolerance}", FACES),
        ("Discs: rings by area of influence (CS-TRD)", DISCS),
    )
    for title, columns in kinds:
        rows = {name: figures for name, figures in scans.items() if not columns.keys().isdisjoint(figures)}
        if rows:
            several = {name: row for name, row in pooled.items() if not columns.keys().isdisjoint(row)}
            parts += [Text(title, style="bold"), _figures(rows, several if len(rows) > 1 else {}, columns), Text("")]
    parts += _missed_and_false(scans)
    scenes = {name: judgement.scene for name, judgement in evaluation.scans.items() if judgement.scene}
    if scenes:
        names = list(dict.fromkeys(name for figures in scenes.values() for name in figures))
        table = _table("scan", *names)
        for scan, figures in scenes.items():
            table.add_row(Text(scan), *(_number(figures.get(name), name) for name in names))
        parts += [Text("Synthetic truth", style="bold"), table, Text("")]
    reliability = evaluation.reliability()
    if any(row["boundaries"] for row in reliability):
        parts += [Text("Is confidence worth its name", style="bold"), _reliability(reliability)]
    return parts


def _figures(
    rows: Mapping[str, Mapping[str, Figure]], pooled: Mapping[str, Mapping[str, Figure]], columns: Mapping[str, str]
) -> Table:
    """Scans, then species and all together."""
    table = _table("", *columns.values())
    for name, figures in rows.items():
        table.add_row(Text(name), *(_number(figures.get(key), key) for key in columns))
    if pooled:
        table.add_section()
    for name, figures in pooled.items():
        title = f"{'all scans' if name == ALL else name} ({figures['images']:g})"
        style = "bold" if name == ALL else "italic"
        table.add_row(Text(title, style=style), *(_number(figures.get(key), key) for key in columns))
    return table


def _missed_and_false(scans: Mapping[str, Mapping[str, Figure]]) -> list[Table | Text]:
    lines: list[Table | Text] = []
    for scan, figures in scans.items():
        for name in ("missed_years", "false_years", "missed_rings", "false_rings", "influence_missed_rings"):
            found = figures.get(name)
            if isinstance(found, list) and found:
                label = {"influence_missed_rings": "rings without a match by area"}.get(name, name.replace("_", " "))
                lines.append(Text(f"{scan}: {label} {_listed(found)}"))
    return [*lines, Text("")] if lines else []


def _listed(found: Iterable[int | str]) -> str:
    """Each once; how often when it is more."""
    return ", ".join(f"{name} (×{count})" if count > 1 else f"{name}" for name, count in Counter(found).items())


def _reliability(rows: Sequence[Mapping[str, float]]) -> Table:
    table = _table("confidence", "boundaries", "right", "share", "mean confidence")
    for row in rows:
        table.add_row(
            f"{row['above']:g} to {row['up_to']:g}",
            f"{row['boundaries']:.0f}",
            f"{row['right']:.0f}",
            _number(row["share"], "share"),
            _number(row["confidence"], "confidence"),
        )
    return table


def _number(value: Figure | None, name: str) -> str:
    if not isinstance(value, (int, float)) or not math.isfinite(value):
        return NOTHING
    if name in COUNTS:
        return f"{value:.0f}"
    return f"{value:.2f}" if name.endswith("_px") else f"{value:.3f}" if abs(value) < 100 else f"{value:.4g}"


def _table(*columns: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for number, column in enumerate(columns):
        table.add_column(column, overflow="fold", justify="left" if number == 0 else "right")
    return table


# --- files --------------------------------------------------------------------------------------------------
def write_csv(path: Path, evaluation: Evaluation) -> None:
    """Every figure as a table: a row for each scan, then for each species and all; empty where nothing is known."""
    content = evaluation.as_json()
    rows: list[dict[str, Any]] = [{"row": "scan", "name": name, **row} for name, row in content["images"].items()]
    rows += [
        {"row": "all" if name == ALL else "species", "name": name, "species": "" if name == ALL else name, **row}
        for name, row in content["pooled"].items()
    ]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: _cell(value) for name, value in row.items()})


def _cell(value: Any) -> Any:
    if isinstance(value, list):
        return " ".join(str(item) for item in value)
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else value
