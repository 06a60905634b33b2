"""What a run would do: for every scan and stage whether its result is reused or computed, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.contents import Content
from pipeline.store import Meta

if TYPE_CHECKING:
    from stages.faces import Faces
    from stages.stage import Stage


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
class BlockPart:
    """What is particular about the plan of a block: its stages begin where those of its faces end.

    Parameters
    ----------
    stems
        Names of the faces' scans, in order.
    faces
        Where they lie.
    keys
        For each face stage name to key.
    stages
        Stages of the faces that the block reads from.
    """

    stems: tuple[str, ...]
    faces: Faces
    keys: tuple[Mapping[str, str], ...]
    stages: frozenset[str]

    def record(self) -> dict[str, Any]:
        """What is kept for people to look up."""
        planes = zip(self.stems, self.faces.plane, strict=True)
        return {
            "planes_px": {stem: [list(vector) for vector in plane] for stem, plane in planes},
            "pixel_size": self.faces.pixel_size,
            "unit": self.faces.unit,
        }


@dataclass(frozen=True)
class ScanPlan:
    """Everything to be done for one scan, or one block; with a `problem`, nothing.

    `is_whole` tells that no stage and no product was left out by what the command line asks for.
    """

    scan: Path
    stem: str
    content: Content
    problem: str = ""
    stages: tuple[StageNode, ...] = ()
    products: tuple[ProductNode, ...] = ()
    record: Mapping[str, Any] = field(default_factory=dict)
    metas: Mapping[str, Meta] = field(default_factory=dict)
    is_whole: bool = True
    block: BlockPart | None = None

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


def changed_inputs(digests: Mapping[str, str], metas: Mapping[str, Meta]) -> list[str]:
    """Providers whose values are no longer those that were read."""
    return [name for name, digest in digests.items() if name in metas and metas[name].digest != digest]
