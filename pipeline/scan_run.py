"""One scan or block on its way through the stages: what is done, what can start, what is left."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pipeline.context import ScanRow
from pipeline.jobs import Status
from pipeline.layout import Layout, read_json, write_json
from pipeline.plan import Action, ProductNode, ScanPlan, StageNode
from pipeline.store import Meta, joint_meta, rings_found
from pipeline.wiring import BLOCK, SOURCE


@dataclass(eq=False)
class ScanRun:
    """State of one scan or block during a run; lives in the driver only."""

    plan: ScanPlan
    index: int
    metas: dict[str, Meta] = field(default_factory=dict)
    joined: set[str] = field(default_factory=set)
    ended: dict[str, Status] = field(default_factory=dict)
    started: set[str] = field(default_factory=set)
    seconds: float = 0.0
    message: str = ""
    trace: str = ""
    products: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.message = self.plan.problem
        stored = self.plan.record.get("products", {})
        self.products = {name: dict(entry) for name, entry in stored.items()}

    @property
    def failed(self) -> bool:
        """Whether something went wrong; only what depends on it is not started then."""
        return bool(self.message)

    @property
    def finished(self) -> bool:
        """Whether all that could start has ended."""
        return self.started <= set(self.ended) and not any(True for _ in self.ready())

    def ready(self) -> Iterator[StageNode | ProductNode]:
        """Nodes whose inputs are there and that have not started."""
        there = {name for name, status in self.ended.items() if status is not Status.FAILED}
        there |= {SOURCE, BLOCK, *self.joined}
        for node in self.plan.nodes:
            if node_name(node) not in self.started and there.issuperset(node.inputs):
                yield node

    def must_run(self, node: StageNode | ProductNode) -> tuple[bool, str]:
        """Whether a ready node has to be computed, and why; looks at what its inputs turned out to be."""
        if node.action is Action.RUN:
            return True, node.reason
        if isinstance(node, StageNode):
            known = self.plan.metas[node.stage].input_digests
        else:
            known = self.products.get(node.product, {}).get("digests", {})
        changed = [name for name, digest in self.digests(node).items() if known.get(name) != digest]
        return bool(changed), f"{' and '.join(changed)} gave other values" if changed else node.reason

    def digests(self, node: StageNode | ProductNode) -> dict[str, str]:
        """What the node's inputs hold now."""
        return {name: self.metas[name].digest for name in node.inputs if name not in (SOURCE, BLOCK)}

    def keys(self) -> dict[str, str]:
        """Stage name to key, of all stages that are done."""
        return {node.stage: node.key for node in self.plan.stages if node.stage in self.metas}

    def end_stage(self, node: StageNode, status: Status, meta: Meta) -> None:
        """Note that a stage's result is there."""
        self.ended[node.stage], self.metas[node.stage] = status, meta

    def join(self, stage: str, faces: Sequence[ScanRun]) -> None:
        """Note that a stage's result is there for all faces of this block."""
        self.joined.add(stage)
        self.metas[stage] = joint_meta([face.metas[stage] for face in faces])

    def end_product(self, node: ProductNode, status: Status, size: int) -> None:
        """Note that a product is there."""
        self.ended[node_name(node)] = status
        self.products[node.product] = {
            "key": node.key,
            "digests": self.digests(node),
            "file": node.filename,
            "size": size,
        }

    def fail(self, name: str, message: str, trace: str = "") -> None:
        """Note why the scan cannot go on; the first reason counts."""
        self.ended[name] = Status.FAILED
        self.message, self.trace = self.message or message, self.trace or trace

    def rings(self) -> int | None:
        """Ring boundaries found, if they were traced."""
        return rings_found(self.metas.values())

    def row(self, complete: bool, layout: Layout) -> ScanRow:
        """The scan's line in the summary."""
        if self.failed:
            outcome = "failed"
        elif all(status is Status.REUSED for status in self.ended.values()):
            outcome = "reused"
        else:
            outcome = "done" if complete else "partly"
        made = {name: entry["file"] for name, entry in self.products.items()}
        return ScanRow(
            scan=self.plan.scan,
            stem=self.plan.stem,
            outcome=outcome,
            message=self.message,
            rings=self.rings() if not self.plan.problem else None,
            seconds=self.seconds,
            products={name: file for name, file in made.items() if layout.product(self.plan.stem, file).exists()},
            warnings=tuple(warning for meta in self.metas.values() for warning in meta.warnings),
        )

    def save(self, layout: Layout) -> None:
        """Keep what was done, to explain the next plan."""
        before: Mapping[str, Any] = self.plan.record.get("stages", {})
        done = {node.stage: node.record() for node in self.plan.stages if node.stage in self.metas}
        record = {
            "scan": str(self.plan.scan),
            "content": self.plan.content.sha256,
            "stages": {**before, **done},
            "products": self.products,
            "message": self.message,
        }
        if self.plan.block is not None:
            record["faces"] = self.plan.block.record()
        # What the plan knows of it may leave out what the scan made before it became a face.
        if record != read_json(layout.record(self.plan.stem)):
            write_json(layout.record(self.plan.stem), record)


def node_name(node: StageNode | ProductNode) -> str:
    """Name of a node among all of a scan's."""
    return node.stage if isinstance(node, StageNode) else f"product {node.product}"
