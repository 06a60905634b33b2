"""What workers do: read a stage's inputs, call it, store the result under its key.

Nothing raised in a task leaves it: a failure comes back as an `Outcome` with one line for people.
"""

from __future__ import annotations

import shutil
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline.contents import file_stamp
from pipeline.jobs import FaceResults, Outcome, Source, StageJob, Status
from pipeline.layout import Layout
from pipeline.locks import try_lock
from pipeline.problems import ScanError
from pipeline.store import CHUNK, Meta, open_data, plain, publish, read_meta, write_data
from pipeline.threads import limit_threads
from pipeline.wiring import BLOCK, SOURCE

if TYPE_CHECKING:
    import xarray as xr

    from stages.stage import Stage

J = TypeVar("J")


def guarded(task: Callable[[J], Outcome]) -> Callable[[J], Outcome]:
    """Turn whatever a task raises into an `Outcome`, and time it."""

    @wraps(task)
    def run(job: J) -> Outcome:
        start = time.perf_counter()
        try:
            outcome = task(job)
        except ScanError as error:
            return Outcome(Status.FAILED, message=str(error), trace=traceback.format_exc(), is_bad_scan=True)
        except Exception as error:
            message = f"{type(error).__name__}: {flat(str(error))}".rstrip(": ")
            return Outcome(Status.FAILED, message=message, trace=traceback.format_exc())
        return Outcome(outcome.status, time.perf_counter() - start, meta=outcome.meta, size=outcome.size)

    return run


def flat(text: str, limit: int = 400) -> str:
    """A text on one line; items of a list are separated by semicolons."""
    lines = [line.strip().removeprefix("- ") for line in text.splitlines() if line.strip()]
    joined = " ".join(lines[:1]) + (" " + "; ".join(lines[1:]) if len(lines) > 1 else "")
    return joined if len(joined) <= limit else joined[: limit - 1] + "…"


@guarded
def run_stage(job: StageJob) -> Outcome:
    """Compute one stage of one scan as a whole and publish the result."""
    stage, layout = job.stage.load(), Layout(job.output)
    with try_lock(layout.lock(stage.name, job.key)) as held:
        if not held:
            return Outcome(Status.BUSY)
        if (meta := valid_meta(job, stage)) is not None:
            return Outcome(Status.REUSED, meta=meta)
        limit_threads(job.threads)
        start = time.perf_counter()
        partial = layout.partial(stage.name, job.key)
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        try:
            warnings, figures = _compute(stage, job, partial)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        meta = Meta(
            stage=stage.name,
            version=stage.version,
            params=job.params,
            inputs=job.inputs,
            input_digests=job.digests,
            warnings=warnings,
            figures=figures,
        )
        seconds = time.perf_counter() - start
        meta = publish(layout, stage.name, job.key, meta, provenance(seconds, job.reason, job.threads))
    return Outcome(Status.COMPUTED, meta=meta)


def _compute(stage: Stage, job: StageJob, partial: Path) -> tuple[list[str], dict[str, float | str]]:
    """Call the stage and write its result into `partial`; returns its warnings and figures."""
    with threaded_dask(job.threads):
        layout = Layout(job.output)
        if job.block is not None:
            ds = read_block(layout, job.block, job.inputs, job.wanted)
        else:
            ds = read_inputs(layout, job.source, job.inputs, job.wanted, partial / "scratch")
        result = stage(ds, stage.params_type.model_validate(job.params))
        write_data(result, partial)
    shutil.rmtree(partial / "scratch", ignore_errors=True)
    return said(result.attrs)


def valid_meta(job: StageJob, stage: Stage) -> Meta | None:
    """The result that is there, if it is wanted: another run may have just made it."""
    if job.force:
        return None
    meta = read_meta(Layout(job.output), stage.name, job.key)
    return meta if meta is not None and dict(meta.input_digests) == dict(job.digests) else None


def read_inputs(
    layout: Layout,
    source: Source,
    keys: Mapping[str, str],
    wanted: Mapping[str, tuple[str, ...]],
    scratch: Path,
    window: Mapping[str, slice] | None = None,
    load: bool = True,
) -> xr.Dataset:
    """Gather variables from the results they lie in, or from the scan's file.

    Parameters
    ----------
    keys, wanted
        Provider to key, and to the variables read from it.
    scratch
        Folder for a large scan; has to outlive the dataset.
    window
        Part along ``y`` and ``x``; variables without these dims are read whole.
    load
        Read stored variables now; a large scan's own pixels stay lazy.
    """
    parts = []
    for provider, names in wanted.items():
        if provider == SOURCE:
            parts.append(read_source(source, scratch)[list(names)])
        elif provider == BLOCK:
            from stages.faces import single_face

            parts.append(single_face()[list(names)])
        else:
            part = open_data(layout.result(provider, keys[provider]))[list(names)]
            part = part.isel(window, missing_dims="ignore") if window else part
            parts.append(part.load() if load else part)
    return _merged(parts, wanted)


def read_block(
    layout: Layout,
    block: FaceResults,
    keys: Mapping[str, str],
    wanted: Mapping[str, tuple[str, ...]],
    load: bool = True,
) -> xr.Dataset:
    """Gather variables of a block: its own results, and those of its faces joined.

    Parameters
    ----------
    block
        Its faces.
    keys, wanted
        As for `read_inputs`; providers that the faces have are read from every face.
    load
        Read now; otherwise the joined images stay lazy.
    """
    from stages.faces import FacesError, join_faces

    theirs = {provider: names for provider, names in wanted.items() if provider in block.keys[0]}
    parts = []
    for face in block.keys:
        opened = [open_data(layout.result(provider, face[provider]))[list(names)] for provider, names in theirs.items()]
        one = _merged(opened, theirs)
        parts.append(one.load() if load else one.chunk({dim: CHUNK for dim in ("y", "x") if dim in one.dims}))
    try:
        joined = join_faces(parts, block.faces)
    except FacesError as error:
        raise ScanError(str(error)) from error
    own = [
        open_data(layout.result(provider, keys[provider]))[list(names)]
        for provider, names in wanted.items()
        if provider not in theirs and provider != BLOCK
    ]
    return _merged([joined, *(part.load() if load else part for part in own)], wanted)


def _merged(parts: Sequence[xr.Dataset], wanted: Iterable[str]) -> xr.Dataset:
    """Variables of several results in one dataset; they have to share their grid."""
    import xarray as xr

    try:
        bare = [part.drop_attrs(deep=False) for part in parts]
        return xr.merge(bare, compat="override", join="exact", combine_attrs="override")
    except ValueError as error:
        raise ValueError(f"inputs of {' and '.join(wanted)} are not on one grid: {error}") from error


def read_source(source: Source, scratch: Path) -> xr.Dataset:
    """Read the scan, if its file is still the one that was planned."""
    from pipeline.reading import read_scan

    if not source.path.exists() or file_stamp(source.path) != source.stamp:
        raise ScanError("the file changed during the run; run again")
    return read_scan(source.path, scratch)


def said(attrs: Mapping[str, Any]) -> tuple[list[str], dict[str, float | str]]:
    """Warnings and figures that a stage left in its result's attributes."""
    warnings = [str(warning) for warning in attrs.get("warnings", ())]
    figures = plain(dict(attrs.get("figures", {})))
    return warnings, figures


def provenance(seconds: float, reason: str, threads: int, **more: Any) -> dict[str, Any]:
    """When and with what a result was made: kept beside it, never part of it."""
    import datetime
    import importlib.metadata
    import platform

    from pipeline.context import woodpipe_version

    versions = {"python": platform.python_version(), "woodpipe": woodpipe_version()}
    for name in ("numpy", "scipy", "xarray", "zarr", "dask", "torch", "OpenImageIO"):
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    created = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return {
        "created": created,
        "seconds": round(seconds, 3),
        "reason": reason,
        "threads": threads,
        "versions": versions,
        **more,
    }


@contextmanager
def threaded_dask(threads: int) -> Iterator[None]:
    """Let lazy arrays be computed by threads of this worker, not by its cluster."""
    import dask

    with dask.config.set(scheduler="threads", num_workers=threads):
        yield
