"""Running a plan: hands jobs to workers as their inputs come in, and never lets one scan stop another."""

from __future__ import annotations

import heapq
import os
import queue
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from pipeline.block_run import BlockRun, block_runs
from pipeline.config import Execution
from pipeline.executors import Executor, start_executor
from pipeline.job_making import product_job, stage_job
from pipeline.jobs import Outcome, ProductJob, StageJob, Status
from pipeline.layout import Layout
from pipeline.plan import ProductNode, ScanPlan, StageNode
from pipeline.product_tasks import write_product
from pipeline.scan_run import ScanRun, node_name
from pipeline.tasks import run_stage
from pipeline.tile_stage import TileStage
from pipeline.tiles import is_tiled
from pipeline.wiring import BLOCK, SOURCE, Wiring

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.context import ScanRow
    from pipeline.progress import Reporter
    from stages.products import Product
    from stages.stage import Stage

ATTEMPTS = 3
RETRY_SECONDS = 0.3


@dataclass(order=True)
class Work:
    """One job on its way to a worker; earlier scans and then earlier stages go first."""

    priority: tuple[int, ...]
    run: ScanRun = field(compare=False)
    name: str = field(compare=False)
    task: Callable[[Any], Outcome] = field(compare=False)
    job: StageJob | ProductJob = field(compare=False)
    then: Callable[[Outcome], None] = field(compare=False)
    attempts: int = field(default=0, compare=False)


class Engine:
    """Runs the plans of one config.

    Parameters
    ----------
    output
        The output folder.
    stages, products, wiring
        What there is to run and how it is connected.
    execution
        Workers, tile size, scheduler.
    reporter
        Is told what happens.
    debug
        Let workers and libraries say more.
    preload
        Modules that workers import while they wait for their first job.
    """

    def __init__(
        self,
        output: Path,
        stages: Sequence[Stage],
        products: Sequence[Product],
        wiring: Wiring,
        execution: Execution,
        reporter: Reporter,
        debug: bool = False,
        preload: tuple[str, ...] = (),
    ) -> None:
        self._layout = Layout(output)
        self._stages = {stage.name: stage for stage in stages}
        self._order = {name: index for index, name in enumerate(self._stages)}
        self._products = {product.name: product for product in products}
        self._wiring, self._execution, self._reporter = wiring, execution, reporter
        self._debug, self._preload = debug, preload
        self._cores = os.cpu_count() or 1
        self._waiting: list[Work] = []
        self._later: list[tuple[float, Callable[[], None]]] = []
        self._in_flight = 0
        self._answers: queue.SimpleQueue[tuple[Work, Outcome | None]] = queue.SimpleQueue()
        self._tile_stages: list[TileStage] = []
        self._blocks: list[BlockRun] = []
        self._counter = 0

    def run(self, plans: Sequence[ScanPlan]) -> list[ScanRun]:
        """Bring every plan up to date; starts no worker if there is nothing to compute."""
        runs = [ScanRun(plan, index) for index, plan in enumerate(plans)]
        self._blocks = block_runs(runs)
        executor = None
        try:
            if all(plan.problem or plan.is_idle for plan in plans):
                self._reporter.begin(plans, "")
            else:
                executor = self._start(plans)
                self._reporter.begin(plans, executor.link)
            for run in runs:
                if run.failed:
                    self._reporter.failed(run.plan.label, run.message)
                self._advance(run)
            while executor is not None and not all(run.finished for run in runs):
                self._dispatch(executor)
                self._listen()
        except BaseException:
            if executor is not None:
                executor.close(abort=True)
                executor = None
            raise
        finally:
            self._reporter.finish()
            for tile_stage in self._tile_stages:
                tile_stage.release()
            for run in runs:
                if not run.plan.problem:
                    run.save(self._layout)
            if executor is not None:
                executor.close()
        return runs

    def rows(self, runs: Sequence[ScanRun]) -> list[ScanRow]:
        """Summary of the run."""
        return [run.row(run.plan.is_whole, self._layout) for run in runs]

    def _start(self, plans: Sequence[ScanPlan]) -> Executor:
        """Start as many workers as can be busy; one scan of few pixels alone is computed in this process."""
        busy = [plan for plan in plans if not plan.problem and not plan.is_idle]
        workers = self._execution.workers or self._cores
        side = self._execution.tile
        probes = [plan.content.probe for plan in busy if plan.content.probe]
        threads, scheduler = 1, self._execution.scheduler
        if not any(is_tiled((probe.height, probe.width), side) for probe in probes):
            if len(busy) == 1:
                threads = min(2, workers)
                scheduler = "threads" if scheduler == "auto" else scheduler
            workers = min(workers, len(busy))
        return start_executor(scheduler, workers, threads, self._preload, self._debug)

    def _advance(self, run: ScanRun) -> None:
        """Settle what is reused and queue what can start now."""
        while (node := next(run.ready(), None)) is not None:
            run.started.add(node_name(node))
            is_needed, reason = run.must_run(node)
            if is_needed:
                self._reporter.started(run.plan.label, node_name(node), reason)
                self._queue(run, node, reason)
                continue
            if isinstance(node, StageNode):
                run.end_stage(node, Status.REUSED, run.plan.metas[node.stage])
            else:
                run.end_product(node, Status.REUSED, run.products[node.product]["size"])
            self._reporter.ended(run.plan.label, node_name(node), Status.REUSED, 0.0)
            if isinstance(node, StageNode):
                self._tell_blocks(run, node.stage)

    def _tell_blocks(self, run: ScanRun, stage: str) -> None:
        """Let blocks go on that waited for a stage of this face."""
        for block in self._blocks:
            if block.take(run, stage):
                self._advance(block.run)

    def _queue(self, run: ScanRun, node: StageNode | ProductNode, reason: str) -> None:
        """Queue the job, or the jobs, of a node."""
        if isinstance(node, ProductNode):
            end = partial(self._end_product, run, node)
            made = product_job(self._layout, self._wiring, self._products[node.product], run, node)
            self._push(run, node_name(node), len(self._order), write_product, made, end)
            return
        job = stage_job(self._layout, self._wiring, self._stages[node.stage], run, node, reason)
        shape = self._tiled_shape(run, node)
        if shape is None:
            end = partial(self._end_stage, run, node)
            self._push(run, node.stage, self._order[node.stage], run_stage, job, end)
            return
        tile_stage = TileStage(
            node,
            job,
            shape,
            self._execution.tile,
            push=partial(self._push, run, node.stage, self._order[node.stage]),
            progress=partial(self._reporter.tile, run.plan.label, node.stage),
            end=partial(self._end_stage, run, node),
        )
        self._tile_stages.append(tile_stage)
        self._begin(tile_stage)

    def _begin(self, tile_stage: TileStage) -> None:
        if not tile_stage.begin():
            self._later.append((time.monotonic() + RETRY_SECONDS, partial(self._begin, tile_stage)))

    def _tiled_shape(self, run: ScanRun, node: StageNode) -> tuple[int, int] | None:
        """Shape of what a stage reads, if it is to be cut into tiles; blocks are not."""
        if self._stages[node.stage].halo is None or SOURCE in node.inputs or run.plan.block is not None:
            return None
        for provider, names in self._wiring.stages[node.stage].items():
            for name in names if provider != BLOCK else ():
                variable = run.metas[provider].variables[name]
                if {"y", "x"} <= set(variable["dims"]):
                    sizes = dict(zip(variable["dims"], variable["shape"], strict=True))
                    shape = (sizes["y"], sizes["x"])
                    return shape if is_tiled(shape, self._execution.tile) else None
        return None

    def _push(
        self,
        run: ScanRun,
        name: str,
        order: int,
        task: Callable[[Any], Outcome],
        job: StageJob | ProductJob,
        then: Callable[[Outcome], None],
    ) -> None:
        self._counter += 1
        heapq.heappush(self._waiting, Work((run.index, order, self._counter), run, name, task, job, then))

    def _push_again(self, work: Work) -> None:
        heapq.heappush(self._waiting, work)

    def _dispatch(self, executor: Executor) -> None:
        """Give every free slot a job; the cores are shared among the jobs there are."""
        now = time.monotonic()
        due = [action for when, action in self._later if when <= now]
        self._later = [(when, action) for when, action in self._later if when > now]
        for action in due:
            action()
        while self._waiting and self._in_flight < executor.slots:
            busy = min(executor.slots, self._in_flight + len(self._waiting))
            work = heapq.heappop(self._waiting)
            if work.name in work.run.ended:  # another tile of it has failed
                continue
            is_remote = self._execution.scheduler not in ("auto", "local", "threads")
            job = replace(work.job, threads=1 if is_remote else max(1, self._cores // busy))
            self._in_flight += 1
            self._counter += 1
            key = (f"{work.name.replace(' ', '-')}-{job.key[:8]}", f"{work.run.plan.stem}-{self._counter}")
            executor.submit(work.task, job, key, partial(self._answer, work))

    def _answer(self, work: Work, outcome: Outcome | None) -> None:
        """Take an outcome over from the executor's thread."""
        self._answers.put((work, outcome))

    def _listen(self) -> None:
        """Take one answer, or none for a moment."""
        try:
            work, outcome = self._answers.get(timeout=0.1)
        except queue.Empty:
            return
        self._in_flight -= 1
        if outcome is None:
            work.attempts += 1
            if work.attempts < ATTEMPTS:
                self._push_again(work)
                return
            outcome = Outcome(Status.FAILED, message=f"its worker process died {ATTEMPTS} times (out of memory?)")
        if outcome.status is Status.BUSY:
            self._later.append((time.monotonic() + RETRY_SECONDS, partial(self._push_again, work)))
            return
        work.run.seconds += outcome.seconds
        work.then(outcome)

    def _end_stage(self, run: ScanRun, node: StageNode, outcome: Outcome) -> None:
        if outcome.status is Status.FAILED or outcome.meta is None:
            self._fail(run, node.stage, outcome)
            return
        run.end_stage(node, outcome.status, outcome.meta)
        self._reporter.ended(run.plan.label, node.stage, outcome.status, outcome.seconds)
        self._advance(run)
        self._tell_blocks(run, node.stage)

    def _end_product(self, run: ScanRun, node: ProductNode, outcome: Outcome) -> None:
        if outcome.status is Status.FAILED:
            self._fail(run, node_name(node), outcome)
            return
        run.end_product(node, outcome.status, outcome.size)
        self._reporter.ended(run.plan.label, node_name(node), outcome.status, outcome.seconds)

    def _fail(self, run: ScanRun, name: str, outcome: Outcome) -> None:
        message = outcome.message if outcome.is_bad_scan else f"{name}: {outcome.message}"
        run.fail(name, message, outcome.trace)
        self._reporter.failed(run.plan.label, message)
        for block in self._blocks:
            # A face without one of its products can still be a face.
            if name in self._order and (told := block.fail(run, message)):
                self._reporter.failed(block.run.plan.label, told)
