"""Config, stages and products put together: what the commands call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from pipeline.config import Config, Execution, load_config
from pipeline.layout import Layout, read_json, write_json
from pipeline.plan import ScanPlan, Selection
from pipeline.planner import make_plan
from pipeline.problems import Problem, UsageError, did_you_mean, validation_problems
from pipeline.wiring import Wiring, wire

if TYPE_CHECKING:
    import xarray as xr

    from pipeline.context import ProductContext, ScanRow
    from pipeline.progress import Reporter
    from pipeline.scan_run import ScanRun
    from stages.products import Product
    from stages.stage import Stage


@dataclass(frozen=True)
class Project:
    """A checked config with the stages and products it is run with."""

    config: Config
    stages: tuple[Stage, ...]
    products: tuple[Product, ...]
    wiring: Wiring

    @classmethod
    def load(
        cls, path: Path, stages: Sequence[Stage] | None = None, products: Sequence[Product] | None = None
    ) -> Project:
        """Read a config; without `stages` and `products` those of woodpipe are used."""
        stages = all_stages() if stages is None else tuple(stages)
        products = all_products(stages) if products is None else tuple(products)
        return cls(load_config(path, stages), stages, products, wire(stages, products))

    def select(self, selection: Selection) -> None:
        """Raise `UsageError` if the selection names stages or scans that do not exist."""
        names = [stage.name for stage in self.stages]
        problems = [
            Problem(option, f"no such stage: {name}" + did_you_mean(name, names))
            for option, name in (
                ("--stage", selection.stage),
                ("--from", selection.from_stage),
                ("--until", selection.until),
            )
            if name is not None and name not in names
        ]
        if not problems and selection.until is not None:
            last = names.index(selection.until)
            for option, name in (("--stage", selection.stage), ("--from", selection.from_stage)):
                if name is not None and names.index(name) > last:
                    problems.append(Problem(option, f"{name} comes after --until {selection.until}"))
        if selection.scan and not self.selected(selection.scan):
            problems.append(
                Problem("--scan", f"{selection.scan!r} matches no scan" + did_you_mean(selection.scan, self.stems()))
            )
        if problems:
            raise UsageError("The command cannot be followed", problems)

    def stems(self) -> list[str]:
        """Names of the scans without suffix, and of the blocks."""
        return [name.stem for name in self.config.names]

    def selected(self, scan: str | None) -> list[Path]:
        """Scans with such a name, and those of blocks with such a name; all of them without one."""
        return self.config.selected(scan)[0]

    def plan(self, selection: Selection | None = None) -> list[ScanPlan]:
        """Plan every selected scan."""
        selection = selection or Selection()
        self.select(selection)
        return make_plan(self.config, self.stages, self.products, self.wiring, selection)

    def run(
        self,
        selection: Selection,
        reporter: Reporter,
        execution: Mapping[str, Any] | None = None,
        debug: bool = False,
        preload: tuple[str, ...] = (),
    ) -> list[tuple[ScanRun, ScanRow]]:
        """Bring every selected scan up to date."""
        from pipeline.engine import Engine

        options = self._execution(execution or {})
        plans = self.plan(selection)
        remember_config(Layout(self.config.output), self.config.path)
        engine = Engine(self.config.output, self.stages, self.products, self.wiring, options, reporter, debug, preload)
        runs = engine.run(plans)
        return list(zip(runs, engine.rows(runs), strict=True))

    def _execution(self, given: Mapping[str, Any]) -> Execution:
        """Options of the config, replaced by those of the command line."""
        try:
            return Execution.model_validate(self.config.execution.model_dump() | dict(given))
        except ValidationError as error:
            problems = validation_problems(error, Execution.model_fields)
            raise UsageError("The command cannot be followed", problems) from None


def all_stages() -> tuple[Stage, ...]:
    """The stages of woodpipe in order."""
    from stages import STAGES

    return tuple(STAGES)


def all_products(stages: Sequence[Stage]) -> tuple[Product, ...]:
    """The stages' products, the page to hold the wood in the hand, and the report, which needs everything there is."""
    from stages.products import PRODUCTS, SERIES, TEXTURE, Product
    from stages.variables import FACE_PLANE, FACE_TOP, RING_AGE_SHIFT, RING_AGE_SIGN

    everything = (*(variable for stage in stages for variable in stage.provides), FACE_PLANE, FACE_TOP)
    report = Product(
        name="report", filename="report.html", requires=everything, version=_report_version(), write=report_of
    )
    shown = (*TEXTURE.requires, *SERIES.requires, RING_AGE_SHIFT, RING_AGE_SIGN)
    viewer = Product("viewer", "viewer.html", tuple(dict.fromkeys(shown)), 1, viewer_of)
    return (*PRODUCTS, viewer, report)


def viewer_of(ds: xr.Dataset, path: Path, context: ProductContext) -> None:
    """Write the page of a texture."""
    from pipeline.viewer import write_viewer
    from pipeline.viewer.years import years_of
    from stages.products import solid_texture_of

    write_viewer(solid_texture_of(ds), path, context.stem, years_of(ds, context))


def report_of(ds: xr.Dataset, path: Path, context: ProductContext) -> None:
    """Write a scan's page."""
    from pipeline.report import write_scan_report

    write_scan_report(ds, path, context)


def _report_version() -> int:
    from pipeline import report

    return int(getattr(report, "VERSION", 1))


def remember_config(layout: Layout, path: Path) -> None:
    """Note that a config writes to this output, so that cleaning knows what is still wanted."""
    stored = read_json(layout.configs)
    known = set(stored) if isinstance(stored, list) else set()
    if str(path) not in known:
        write_json(layout.configs, sorted(known | {str(path)}))
