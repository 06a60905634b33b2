"""Writing a scan's products: the files people and other programs take away."""

from __future__ import annotations

import os
import shutil

from pipeline.context import ProductContext, woodpipe_version
from pipeline.jobs import FaceResults, Outcome, ProductJob, Status
from pipeline.layout import Layout
from pipeline.locks import try_lock
from pipeline.store import read_meta, read_provenance
from pipeline.tasks import guarded, read_block, read_inputs, threaded_dask
from pipeline.threads import limit_threads


@guarded
def write_product(job: ProductJob) -> Outcome:
    """Write one product beside its place and move it there."""
    layout, product = Layout(job.output), job.product
    stem = job.source.path.stem
    final = layout.product(stem, product.filename)
    with try_lock(layout.lock(f"product-{product.name}", stem)) as held:
        if not held:
            return Outcome(Status.BUSY)
        limit_threads(job.threads)
        aside = final.parent / f".{product.name}.part"
        shutil.rmtree(aside, ignore_errors=True)
        aside.mkdir(parents=True)
        try:
            with threaded_dask(job.threads):
                if job.block is not None:
                    ds = read_block(layout, job.block, job.keys, job.wanted, load=False)
                else:
                    ds = read_inputs(layout, job.source, job.keys, job.wanted, aside / "scratch", load=False)
                product.write(ds, aside / product.filename, context_of(job))
            os.replace(aside / product.filename, final)
        finally:
            shutil.rmtree(aside, ignore_errors=True)
    return Outcome(Status.COMPUTED, size=final.stat().st_size)


def context_of(job: ProductJob) -> ProductContext:
    """Collect what the results of a scan tell beside their arrays."""
    layout = Layout(job.output)
    metas = {stage: read_meta(layout, stage, key) for stage, key in job.keys.items()}
    there = {stage: meta for stage, meta in metas.items() if meta is not None}
    warnings = [warning for meta in there.values() for warning in meta.warnings]
    return ProductContext(
        scan=job.source.path,
        stem=job.source.path.stem,
        params={stage: job.params[stage] for stage in there if stage in job.params},
        keys={stage: job.keys[stage] for stage in there},
        seconds={stage: float(read_provenance(layout, stage, job.keys[stage]).get("seconds", 0.0)) for stage in there},
        warnings=(*warnings, *_warnings_of_faces(layout, job.block)),
        figures={stage: meta.figures for stage, meta in there.items()},
        version=woodpipe_version(),
        faces=() if job.block is None else job.block.names,
    )


def _warnings_of_faces(layout: Layout, block: FaceResults | None) -> list[str]:
    """What was told of a block's faces, which have no page of their own to say it on; each text once."""
    told: dict[str, list[str]] = {}
    for name, keys in zip(block.names, block.keys, strict=True) if block else ():
        for stage, key in keys.items():
            meta = read_meta(layout, stage, key)
            for warning in meta.warnings if meta else ():
                told.setdefault(warning, []).append(name)
    every = len(block.names) if block else 0
    return [
        f"{'Every face' if len(set(names)) == every > 1 else ', '.join(dict.fromkeys(names))}: {warning}"
        for warning, names in told.items()
    ]
