"""What a run would do: for every scan and stage whether its result is reused or computed, and why."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.contents import Content, FileIndex
from pipeline.keys import product_key, source_key, stage_key
from pipeline.layout import Layout, read_json
from pipeline.problems import ScanError
from pipeline.reasons import why_product, why_stage
from pipeline.store import Meta, read_meta
from pipeline.wiring import SOURCE, Wiring

if TYPE_CHECKING:
    from pipeline.config import Config
    from stages.products import Product
    from stages.stage import Params, Stage


class Action(StrEnum):
    """What is to be done about a result."""

    REUSE = "reuse"
    RUN = "run"
    CHECK = "check"
    """Reuse it, unless a stage before it that runs again gives other values."""


@dataclass(frozen=True)
class StageNode:
    """One stage of one scan."""

    stage: str
    version: int
    params: Mapping[str, Any]
    inputs: Mapping[str, str]
    key: str
    action: Action
    reason: str
    is_forced: bool = False

    def record(self) -> dict[str, Any]:
        """What is kept to explain the next plan."""
        return {"key": self.key, "version": self.version, "params": self.params, "inputs": self.inputs}


@dataclass(frozen=True)
class ProductNode:
    """One product of one scan."""

    product: str
    filename: str
    inputs: Mapping[str, str]
    key: str
    action: Action
    reason: str


@dataclass(frozen=True)
class ScanPlan:
    """Everything to be done for one scan; with a `problem`, nothing."""

    scan: Path
    stem: str
    content: Content
    problem: str = ""
    stages: tuple[StageNode, ...] = ()
    products: tuple[ProductNode, ...] = ()
    record: Mapping[str, Any] = field(default_factory=dict)
    metas: Mapping[str, Meta] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """What the scan is called while it runs; bad files by their whole name, which alone tells them apart."""
        return self.scan.name if self.problem else self.stem

    @property
    def nodes(self) -> tuple[StageNode | ProductNode, ...]:
        """Stages, then products."""
        return (*self.stages, *self.products)

    @property
    def is_idle(self) -> bool:
        """Whether nothing has to be computed."""
        return not self.problem and all(node.action is Action.REUSE for node in self.nodes)


@dataclass(frozen=True)
class Selection:
    """What the command line asks for beyond bringing everything up to date."""

    stage: str | None = None
    from_stage: str | None = None
    until: str | None = None
    force: bool = False
    scan: str | None = None

    def forced(self, stages: Sequence[Stage]) -> set[str]:
        """Stages that run even if their results are there."""
        names = [stage.name for stage in stages]
        forced = set(names) if self.force else set()
        if self.from_stage:
            forced.update(names[names.index(self.from_stage) :])
        if self.stage:
            forced.add(self.stage)
        return forced

    def wanted(self, stages: Sequence[Stage]) -> set[str]:
        """Stages that are brought up to date."""
        names = [stage.name for stage in stages]
        return set(names[: names.index(self.until) + 1] if self.until else names)


def make_plan(
    config: Config, stages: Sequence[Stage], products: Sequence[Product], wiring: Wiring, selection: Selection
) -> list[ScanPlan]:
    """Plan every selected scan; bad files and scans that would share a folder come back with a `problem`."""
    from pipeline.config import matches

    layout = Layout(config.output)
    index = FileIndex(layout.files)
    contents = {scan: index.look(scan) for scan in config.scans}
    index.save()
    clashes = _clashes(config.scans, contents)
    planner = _Planner(layout, stages, products, wiring, selection)
    plans = []
    for scan in config.scans:
        if selection.scan and not matches(scan, selection.scan, config.path.parent):
            continue
        problem, plan = contents[scan].problem or clashes.get(scan, ""), None
        try:
            plan = None if problem else planner.plan(scan, contents[scan], config.params(scan, stages))
        except ScanError as error:
            problem = str(error)
        plans.append(plan or ScanPlan(scan, scan.stem, contents[scan], problem))
    return plans


def _clashes(scans: Sequence[Path], contents: Mapping[Path, Content]) -> dict[Path, str]:
    """Scans that would share a product folder, among those that can be read at all."""
    by_stem = defaultdict(list)
    for scan in scans:
        if not contents[scan].problem:
            by_stem[scan.stem].append(scan)
    clashes = {}
    for same in by_stem.values():
        for scan in same if len(same) > 1 else ():
            others = " and ".join(str(other) for other in same if other != scan)
            clashes[scan] = f"has the same name without suffix as {others}; they would share the folder {scan.stem}/"
    return clashes


class _Planner:
    """Plans one scan at a time."""

    def __init__(
        self,
        layout: Layout,
        stages: Sequence[Stage],
        products: Sequence[Product],
        wiring: Wiring,
        selection: Selection,
    ) -> None:
        self._layout, self._stages, self._products, self._wiring = layout, stages, products, wiring
        self._forced, self._wanted = selection.forced(stages), selection.wanted(stages)

    def plan(self, scan: Path, content: Content, params: Mapping[str, Params]) -> ScanPlan:
        """Plan one scan."""
        stored = read_json(self._layout.record(scan.stem))
        record: dict[str, Any] = stored if isinstance(stored, dict) else {}
        keys = {SOURCE: source_key(content.sha256)}
        nodes: dict[str, StageNode] = {}
        metas: dict[str, Meta] = {}
        for stage in self._stages:
            inputs = {provider: keys[provider] for provider in self._wiring.stages[stage.name]}
            full = params[stage.name].model_dump(mode="json")
            keys[stage.name] = stage_key(stage.name, stage.version, params[stage.name].key_values(), inputs)
            if stage.name not in self._wanted:
                continue
            meta = read_meta(self._layout, stage.name, keys[stage.name])
            node = StageNode(stage.name, stage.version, full, inputs, keys[stage.name], Action.RUN, "forced", True)
            if stage.name not in self._forced:
                before = record.get("stages", {}).get(stage.name)
                action, reason = self._decide(node, meta, metas, nodes, before)
                node = replace(node, action=action, reason=reason, is_forced=False)
            nodes[stage.name] = node
            if meta is not None:
                metas[stage.name] = meta
        made = tuple(
            self._plan_product(product, scan, nodes, metas, record)
            for product in self._products
            if set(self._wiring.products[product.name]) - {SOURCE} <= self._wanted
        )
        return ScanPlan(scan, scan.stem, content, "", tuple(nodes.values()), made, record, metas)

    def _decide(
        self,
        node: StageNode,
        meta: Meta | None,
        metas: Mapping[str, Meta],
        nodes: Mapping[str, StageNode],
        before: Mapping[str, Any] | None,
    ) -> tuple[Action, str]:
        again = [
            provider for provider in node.inputs if provider in nodes and nodes[provider].action is not Action.REUSE
        ]
        if meta is None:
            is_partial = self._layout.partial(node.stage, node.key).exists()
            return Action.RUN, why_stage(node.stage, node.record(), before, again, is_partial)
        if again:
            return Action.CHECK, f"reused unless {' or '.join(again)} gives other values"
        changed = changed_inputs(meta.input_digests, metas)
        if changed:
            return Action.RUN, f"{' and '.join(changed)} gave other values since"
        return Action.REUSE, "nothing changed"

    def _plan_product(
        self,
        product: Product,
        scan: Path,
        nodes: Mapping[str, StageNode],
        metas: Mapping[str, Meta],
        record: Mapping[str, Any],
    ) -> ProductNode:
        inputs = {
            provider: nodes[provider].key for provider in self._wiring.products[product.name] if provider in nodes
        }
        key = product_key(product.name, product.version, scan.name, inputs)
        before = record.get("products", {}).get(product.name)
        path = self._layout.product(scan.stem, product.filename)
        again = [provider for provider in inputs if nodes[provider].action is not Action.REUSE]
        reason = why_product(product.name, key, before, path, again)
        action = Action.RUN if reason else Action.CHECK if again else Action.REUSE
        if action is Action.REUSE and changed_inputs(before["digests"] if before else {}, metas):
            action, reason = Action.RUN, "made from other values"
        if action is Action.CHECK:
            reason = f"reused unless {again[-1]} gives other values"
        return ProductNode(product.name, product.filename, inputs, key, action, reason or "nothing changed")


def changed_inputs(digests: Mapping[str, str], metas: Mapping[str, Meta]) -> list[str]:
    """Providers whose values are no longer those that were read."""
    return [name for name, digest in digests.items() if name in metas and metas[name].digest != digest]
