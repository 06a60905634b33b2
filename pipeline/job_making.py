"""From a node of a plan to the job that a worker is sent."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.jobs import FaceResults, ProductJob, Source, StageJob, StageRef

if TYPE_CHECKING:
    from pipeline.layout import Layout
    from pipeline.plan import ProductNode, StageNode
    from pipeline.scan_run import ScanRun
    from pipeline.wiring import Wiring
    from stages.products import Product
    from stages.stage import Stage


def stage_job(layout: Layout, wiring: Wiring, stage: Stage, run: ScanRun, node: StageNode, reason: str) -> StageJob:
    """Job of a stage whose inputs are there."""
    wired = wiring.stages if run.plan.block is None else wiring.block_stages
    return StageJob(
        output=layout.output,
        source=Source(run.plan.scan, run.plan.content.stamp),
        stage=StageRef.of(stage),
        key=node.key,
        params=node.params,
        inputs=node.inputs,
        wanted=wired[stage.name],
        digests=run.digests(node),
        force=node.is_forced,
        reason=reason,
        block=_face_results(run),
    )


def product_job(layout: Layout, wiring: Wiring, product: Product, run: ScanRun, node: ProductNode) -> ProductJob:
    """Job of a product whose inputs are there."""
    wired = wiring.products if run.plan.block is None else wiring.block_products
    return ProductJob(
        output=layout.output,
        source=Source(run.plan.scan, run.plan.content.stamp),
        product=product,
        key=node.key,
        wanted=wired[product.name],
        keys=run.keys(),
        params={stage.stage: stage.params for stage in run.plan.stages},
        block=_face_results(run),
    )


def _face_results(run: ScanRun) -> FaceResults | None:
    """What the jobs of a block are told of its faces."""
    part = run.plan.block
    return None if part is None else FaceResults(part.faces, part.keys, part.stems)
