"""What the commands print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from pipeline.input_files import without_texts

if TYPE_CHECKING:
    from pipeline.context import ScanRow
    from pipeline.plan import ScanPlan
    from stages.stage import Stage

PIPE_WIDTH = 400
COLORS = {"done": "green", "reused": "cyan", "partly": "yellow", "failed": "red"}
STATES = {"reuse": "done", "run": "to run", "check": "to check"}


def make_console(stderr: bool = False) -> Console:
    """Console as wide as the terminal, or wide enough that no line breaks in a file or pipe."""
    console = Console(stderr=stderr)
    return console if console.is_terminal else Console(stderr=stderr, width=PIPE_WIDTH)


def summary_table(rows: Sequence[ScanRow]) -> Table:
    """One line per scan: how it ended, rings, seconds."""
    table = _table("scan", "outcome", "rings", "seconds", "")
    for row in rows:
        notes = row.message or (f"{len(row.warnings)} warning{'s' * (len(row.warnings) > 1)}" if row.warnings else "")
        rings = "" if row.rings is None else str(row.rings)
        outcome = Text(row.outcome, style=COLORS.get(row.outcome, ""))
        table.add_row(Text(row.scan.name), outcome, rings, f"{row.seconds:.1f}", Text(notes))
    return table


def plan_table(plans: Sequence[ScanPlan]) -> Table:
    """Every scan, stage and product: reused or run, and why."""
    table = _table("scan", "stage", "", "why")
    for plan in plans:
        if plan.problem:
            table.add_row(Text(plan.scan.name), "", Text("fails", style="red"), Text(plan.problem))
        for node in plan.stages:
            table.add_row(Text(plan.scan.name), node.stage, _action(node.action), Text(node.reason))
        for product in plan.products:
            table.add_row(Text(plan.scan.name), Text(product.filename), _action(product.action), Text(product.reason))
    return table


def status_table(plans: Sequence[ScanPlan]) -> Table:
    """Scans down, stages and products across."""
    # Faces of blocks have the first stages and products, blocks the others, other scans all.
    stages = list(dict.fromkeys(node.stage for plan in plans for node in plan.stages))
    products = list(dict.fromkeys(node.product for plan in plans for node in plan.products))
    table = _table("scan", *stages, *products)
    for plan in plans:
        if plan.problem:
            table.add_row(Text(plan.scan.name), Text(plan.problem, style="red"))
            continue
        states = {("stage", node.stage): node.action for node in plan.stages}
        states |= {("product", node.product): node.action for node in plan.products}
        columns = [("stage", name) for name in stages] + [("product", name) for name in products]
        cells = [states.get(column) for column in columns]
        table.add_row(
            Text(plan.scan.name), *(Text("") if c is None else Text(STATES[c], style=_style(c)) for c in cells)
        )
    return table


def stages_text(stages: Sequence[Stage]) -> Table:
    """Every stage with what it reads and gives, and its parameters with their help."""
    table = Table.grid(padding=(0, 2))
    for _ in range(3):
        table.add_column(overflow="fold")
    for stage in stages:
        table.add_row(Text(stage.name, style="bold"), Text(f"version {stage.version}"), Text(stage.summary))
        table.add_row("", "reads", Text(", ".join(variable.name for variable in stage.requires)))
        table.add_row("", "gives", Text(", ".join(variable.name for variable in stage.provides)))
        for name, field in stage.params_type.model_fields.items():
            default = "required" if field.is_required() else f"{field.get_default(call_default_factory=True)}"
            table.add_row(
                "", Text(f"{name}: {default}", style="cyan"), Text(" ".join((field.description or "").split()))
            )
        table.add_row()
    return table


def provenance_tables(known: Mapping[str, Any]) -> list[Any]:
    """A scan's products and results, for people."""
    products = Table.grid(padding=(0, 2))
    if "faces" in known:
        named = [("block", known["stem"]), ("faces", ", ".join(known["faces"]["planes_px"]))]
    else:
        named = [("scan", known["scan"]), ("content", known["content"])]
    for label, value in (*named, *known["products"].items()):
        products.add_row(Text(label, style="bold"), Text(value))
    for name in known["missing"]:
        products.add_row(Text(name, style="bold"), Text("is gone", style="red"))
    results = _table("stage", "version", "key", "seconds", "created", "parameters")
    for name, stage in known["stages"].items():
        params = ", ".join(f"{key}={without_texts(value)}" for key, value in stage["params"].items())
        state = str(stage.get("created", "")) if stage["complete"] else "is gone"
        seconds = f"{stage.get('seconds', 0.0):.1f}"
        results.add_row(name, str(stage["version"]), stage["key"], seconds, state, Text(params))
    return [products, results, Text(f"results lie in {known['output']}/.woodpipe/results/<stage>/<key>/data.zarr")]


def _table(*columns: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def _action(action: str) -> Text:
    words = {"reuse": "reused", "run": "runs", "check": "reused?"}
    return Text(words[action], style=_style(action))


def _style(action: str) -> str:
    return {"reuse": "green", "run": "yellow", "check": "cyan"}[action]
