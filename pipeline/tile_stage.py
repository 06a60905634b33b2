"""A tile-local stage of a large scan during a run, as the driver sees it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

from pipeline.jobs import Outcome, StageJob, Status
from pipeline.layout import Layout
from pipeline.locks import Lock
from pipeline.plan import StageNode
from pipeline.store import read_meta
from pipeline.tile_tasks import begin_tiles, finish_tiles, run_tile
from pipeline.tiles import Tile, tiles


class Push(Protocol):
    """Queues a job."""

    def __call__(self, task: Callable[[Any], Outcome], job: StageJob, then: Callable[[Outcome], None]) -> None:
        """Queue `job`; call `then` with its outcome."""


class TileStage:
    """Hands out one job per tile, the first one alone, since it lays out the store; then publishes.

    The driver holds the result's lock all the while, so that its workers can write without one.
    """

    def __init__(
        self,
        node: StageNode,
        job: StageJob,
        shape: tuple[int, int],
        side: int,
        push: Push,
        progress: Callable[[int, int], None],
        end: Callable[[Outcome], None],
    ) -> None:
        self._node, self._job, self._shape, self._side = node, job, shape, side
        self._push, self._progress, self._end = push, progress, end
        self._layout = Layout(job.output)
        self._lock: Lock | None = None
        self._tiles: list[Tile] = []
        self._total = self._open = 0
        self._seconds = 0.0
        self._failed = False

    def begin(self) -> bool:
        """Queue the first jobs; ``False`` if another run is at this result."""
        self._lock = Lock.try_acquire(self._layout.lock(self._node.stage, self._node.key))
        if self._lock is None:
            return False
        meta = None if self._job.force else read_meta(self._layout, self._node.stage, self._node.key)
        if meta is not None and dict(meta.input_digests) == dict(self._job.digests):
            self._finish(Outcome(Status.REUSED, meta=meta))
            return True
        partial = self._layout.partial(self._node.stage, self._node.key)
        if self._job.force:
            shutil.rmtree(partial, ignore_errors=True)
        done = begin_tiles(partial, self._shape, self._side, self._job.digests)
        every = list(tiles(self._shape, self._side))
        self._total = len(every)
        self._tiles = [tile for tile in every if tile.name not in done]
        self._progress(len(done), self._total)
        self._continue(first=not (partial / "template.json").exists())
        return True

    def release(self) -> None:
        """Give the lock back."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def _continue(self, first: bool) -> None:
        if not self._tiles and not self._open:
            self._push(finish_tiles, self._job, self._finish)
            return
        batch = self._tiles[:1] if first else self._tiles
        self._tiles = self._tiles[len(batch) :]
        self._open += len(batch)
        for tile in batch:
            self._push(run_tile, replace(self._job, tile=tile, tile_side=self._side), self._tile_done)

    def _tile_done(self, outcome: Outcome) -> None:
        self._open -= 1
        self._seconds += outcome.seconds
        if outcome.status is Status.FAILED:
            if not self._failed:
                self._failed = True
                self._finish(outcome)
            return
        if not self._failed:
            self._progress(self._total - self._open - len(self._tiles), self._total)
            self._continue(first=False)

    def _finish(self, outcome: Outcome) -> None:
        self.release()
        self._end(replace(outcome, seconds=self._seconds + outcome.seconds))
