"""A block during a run: it goes on where the last of its faces is done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.scan_run import ScanRun


@dataclass(frozen=True)
class BlockRun:
    """The run of a block, and those of its faces in order."""

    run: ScanRun
    faces: tuple[ScanRun, ...]

    def take(self, face: ScanRun, stage: str) -> bool:
        """Note that a face is done with a stage; whether all faces now are, and the block may go on."""
        part = self.run.plan.block
        if part is None or face not in self.faces or stage not in part.stages or stage in self.run.joined:
            return False
        if not all(stage in one.metas for one in self.faces):
            return False
        self.run.join(stage, self.faces)
        return True

    def fail(self, face: ScanRun, message: str) -> str:
        """Note that a face failed; what to tell of the block, empty if it is no face of it or failed before."""
        if face not in self.faces or self.run.failed:
            return ""
        told = f"its face {face.plan.scan.name} failed: {message}"
        self.run.fail(f"face {face.plan.stem}", told)
        return told


def block_runs(runs: Sequence[ScanRun]) -> list[BlockRun]:
    """Blocks among the runs, with their faces."""
    by_stem = {run.plan.stem: run for run in runs if run.plan.block is None and not run.plan.problem}
    return [BlockRun(run, tuple(by_stem[stem] for stem in run.plan.block.stems)) for run in runs if run.plan.block]
