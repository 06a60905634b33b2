"""Where jobs are computed: a Dask cluster of our own, an existing one, or threads of this process."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, Protocol

from pipeline.jobs import Outcome, Status
from pipeline.problems import Problem, UsageError
from pipeline.threads import preload_in_background

Done = Callable[[Outcome | None], None]

#: Free memory that a worker keeps. With the little that Dask leaves it, every array of half a megabyte is asked from
#: the system and given back: iterations over such arrays then take two to three times as long.
KEPT_BYTES = 64 << 20


class Executor(Protocol):
    """Takes jobs, calls back with their outcome; ``None`` when the worker died under a job."""

    slots: int
    link: str

    def submit(self, task: Callable[[Any], Outcome], job: Any, key: tuple[str, ...], done: Done) -> None:
        """Start a job; `done` is called from another thread."""

    def close(self, abort: bool = False) -> None:
        """Give everything back; with `abort`, without waiting for running jobs."""


class ThreadExecutor:
    """Threads of this process, for tests and for a debugger."""

    link = ""

    def __init__(self, workers: int) -> None:
        self.slots = workers
        self._pool = ThreadPoolExecutor(workers)

    def submit(self, task: Callable[[Any], Outcome], job: Any, key: tuple[str, ...], done: Done) -> None:
        """Start a job; `done` is called from another thread."""
        self._pool.submit(task, job).add_done_callback(lambda future: done(future.result()))

    def close(self, abort: bool = False) -> None:
        """Give everything back; with `abort`, without waiting for running jobs."""
        self._pool.shutdown(wait=not abort, cancel_futures=True)


class DaskExecutor:
    """Worker processes of a Dask cluster.

    A worker that dies fails its job at once (``allowed-failures: 0``): whether to try again, and whose fault it
    was, is decided by the engine, which knows what else ran there.
    """

    def __init__(self, client: Any, cluster: Any = None) -> None:
        self._client, self._cluster = client, cluster
        self.slots = max(sum(client.nthreads().values()), 1)
        self.link = str(client.dashboard_link or "")

    @classmethod
    def local(cls, workers: int, threads: int, preload: tuple[str, ...], debug: bool) -> DaskExecutor:
        """Start a cluster of our own on the loopback interface."""
        import dask
        from distributed import Client, LocalCluster

        cores = os.cpu_count() or 1
        settings = {
            "distributed.scheduler.allowed-failures": 0,
            "distributed.nanny.pre-spawn-environ": {
                "OMP_NUM_THREADS": cores,
                "OPENBLAS_NUM_THREADS": max(1, cores // workers),
                "MALLOC_TRIM_THRESHOLD_": KEPT_BYTES,
                "MALLOC_MMAP_THRESHOLD_": KEPT_BYTES // 4,
            },
            "distributed.admin.system-monitor.gil.enabled": False,
        }
        with dask.config.set(settings), _deaf_to_sigint(), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Port .* is already in use")
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=threads,
                processes=True,
                dashboard_address="127.0.0.1:8787",
                worker_dashboard_address="127.0.0.1:0",
                silence_logs=logging.WARNING if debug else logging.CRITICAL,
            )
            client = Client(cluster)
            client.register_plugin(_worker_plugin(preload, is_own=True, debug=debug))
        return cls(client, cluster)

    @classmethod
    def remote(cls, address: str, preload: tuple[str, ...], debug: bool) -> DaskExecutor:
        """Join an existing cluster."""
        from distributed import Client

        try:
            client = Client(address, timeout=5)
            client.get_versions(check=True)
        except (OSError, ValueError) as error:
            line = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise UsageError("The run cannot start", [Problem("scheduler", f"{address}: {line}")]) from None
        if not client.nthreads():
            client.close()
            raise UsageError("The run cannot start", [Problem("scheduler", f"{address} has no workers")])
        client.register_plugin(_worker_plugin(preload, is_own=False, debug=debug))
        return cls(client)

    def submit(self, task: Callable[[Any], Outcome], job: Any, key: tuple[str, ...], done: Done) -> None:
        """Start a job; `done` is called from another thread."""
        from distributed import KilledWorker

        future = self._client.submit(task, job, key=key, pure=False, retries=0)

        def report(finished: Any) -> None:
            if finished.status == "finished":
                done(finished.result())
                return
            error = finished.exception() if finished.status == "error" else None
            lost = error is None or isinstance(error, KilledWorker)
            done(None if lost else Outcome(Status.FAILED, message=f"{type(error).__name__}: {error}"))

        future.add_done_callback(report)

    def close(self, abort: bool = False) -> None:
        """Give everything back; with `abort`, without waiting for running jobs."""
        with contextlib.suppress(Exception), _deaf_to_sigint():
            if self._cluster is not None:  # they hold nothing that is not on disk, and asking takes a second
                _kill_workers(self._cluster)
            self._client.close(timeout=2)
            if self._cluster is not None:
                self._cluster.close(timeout=2)


def start_executor(scheduler: str, workers: int, threads: int, preload: tuple[str, ...], debug: bool) -> Executor:
    """Start what the execution options name."""
    if scheduler == "threads":
        return ThreadExecutor(workers * threads)
    if not debug:
        import distributed  # noqa: F401  importing it sets its loggers' levels, so it comes first

        theirs = ("distributed", "distributed.batched", "distributed.nanny", "distributed.worker")
        for name in (*theirs, "tornado.application", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    if scheduler in ("auto", "local"):
        return DaskExecutor.local(workers, threads, preload, debug)
    return DaskExecutor.remote(scheduler, preload, debug)


@contextmanager
def _deaf_to_sigint() -> Iterator[None]:
    """Ignore Ctrl-C within the block, so that processes started in it inherit that."""
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not in the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _kill_workers(cluster: Any) -> None:
    for nanny in list(cluster.workers.values()):
        nanny.auto_restart = False
        if (pid := getattr(nanny, "pid", None)) is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


def _worker_plugin(preload: tuple[str, ...], is_own: bool, debug: bool) -> Any:
    from distributed import WorkerPlugin

    class Prepared(WorkerPlugin):
        """Imports while it waits; a worker of our own leaves Ctrl-C to the main process and says nothing."""

        name = "woodpipe"

        def setup(self, worker: Any) -> None:
            if is_own:
                with contextlib.suppress(ValueError):  # not in the main thread
                    signal.signal(signal.SIGINT, signal.SIG_IGN)
            if is_own and not debug:
                silence = os.open(os.devnull, os.O_WRONLY)
                os.dup2(silence, 2)  # libpng and others write there directly
                os.close(silence)
                logging.getLogger("distributed").setLevel(logging.CRITICAL)
            preload_in_background(preload)

    return Prepared()
