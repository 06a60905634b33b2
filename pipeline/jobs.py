"""What is sent to a worker and what comes back: names, keys and small numbers, never arrays."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.tiles import Tile

if TYPE_CHECKING:
    from pipeline.store import Meta
    from stages.faces import Faces
    from stages.products import Product
    from stages.stage import Stage


@dataclass(frozen=True)
class StageRef:
    """A stage by the module and name it is found under: its function cannot be pickled, the name can."""

    module: str
    attribute: str

    @classmethod
    def of(cls, stage: Stage) -> StageRef:
        """Find where a stage is declared."""
        module = sys.modules[stage.function.__module__]
        for attribute, value in vars(module).items():
            if value is stage:
                return cls(module.__name__, attribute)
        raise LookupError(f"stage {stage.name} is no attribute of {module.__name__}")

    def load(self) -> Stage:
        """Import the stage."""
        import importlib

        found: Stage = getattr(importlib.import_module(self.module), self.attribute)
        return found


@dataclass(frozen=True)
class Source:
    """The scan's file as it was when the run was planned."""

    path: Path
    stamp: tuple[int, int]


@dataclass(frozen=True)
class FaceResults:
    """Results of the faces of a block, to be read as one.

    Parameters
    ----------
    faces
        Where they lie.
    keys
        For each face provider to key.
    names
        Their scans, for people.
    """

    faces: Faces
    keys: tuple[Mapping[str, str], ...]
    names: tuple[str, ...]


@dataclass(frozen=True)
class StageJob:
    """One stage of one scan or block, or one tile of it.

    Parameters
    ----------
    output
        The output folder.
    source
        The scan.
    stage
        Where the stage is found.
    key
        Key of the result.
    params
        Full parameters as JSON values.
    inputs
        Provider to key.
    wanted
        Provider to the variables read from it.
    digests
        Provider to the digest of its values.
    force
        Compute even if the result is there.
    threads
        Threads the libraries may use.
    reason
        Why it runs, for its provenance.
    tile, tile_side
        For one tile of a large scan.
    block
        For a stage of a block.
    """

    output: Path
    source: Source
    stage: StageRef
    key: str
    params: Mapping[str, Any]
    inputs: Mapping[str, str]
    wanted: Mapping[str, tuple[str, ...]]
    digests: Mapping[str, str]
    force: bool = False
    threads: int = 1
    reason: str = ""
    tile: Tile | None = None
    tile_side: int = 0
    block: FaceResults | None = None


@dataclass(frozen=True)
class ProductJob:
    """One product of one scan or block."""

    output: Path
    source: Source
    product: Product
    key: str
    wanted: Mapping[str, tuple[str, ...]]
    keys: Mapping[str, str]
    params: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    threads: int = 1
    block: FaceResults | None = None


class Status(StrEnum):
    """How a job ended."""

    COMPUTED = "computed"
    REUSED = "reused"
    BUSY = "busy"
    """Another run holds the lock; ask again later."""
    FAILED = "failed"


@dataclass(frozen=True)
class Outcome:
    """What comes back from a worker."""

    status: Status
    seconds: float = 0.0
    message: str = ""
    trace: str = ""
    is_bad_scan: bool = False
    meta: Meta | None = None
    size: int = 0
