"""Making plans: scan by scan, and block by block from the plans of its faces."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.block_geometry import check_aspect, planes_px
from pipeline.contents import Content, FileIndex
from pipeline.keys import joint_key, product_key, source_key, stage_key
from pipeline.layout import Layout, read_json
from pipeline.plan import Action, BlockPart, ProductNode, ScanPlan, Selection, StageNode, changed_inputs
from pipeline.problems import ScanError
from pipeline.reasons import why_product, why_stage
from pipeline.store import Meta, joint_meta, read_meta
from pipeline.wiring import BLOCK, SOURCE, Wiring

if TYPE_CHECKING:
    from pipeline.blocks import Block
    from pipeline.config import Config
    from stages.faces import Faces
    from stages.products import Product
    from stages.stage import Params, Stage


def make_plan(
    config: Config, stages: Sequence[Stage], products: Sequence[Product], wiring: Wiring, selection: Selection
) -> list[ScanPlan]:
    """Plan every selected scan, then every selected block; what cannot be used comes back with a `problem`."""
    layout = Layout(config.output)
    index = FileIndex(layout.files)
    contents = {scan: index.look(scan) for scan in config.scans}
    index.save()
    clashes = _clashes(config.scans, contents)
    planner = _Planner(layout, stages, products, wiring, selection)
    faces = {scan for block in config.blocks for scan in block.scans}
    scans, blocks = config.selected(selection.scan)
    plans: dict[Path, ScanPlan] = {}
    for scan in scans:
        problem, plan = contents[scan].problem or clashes.get(scan, ""), None
        try:
            if not problem:
                plan = planner.plan(scan, contents[scan], config.params(scan, stages), is_face=scan in faces)
        except ScanError as error:
            problem = str(error)
        plans[scan] = plan or ScanPlan(scan, scan.stem, contents[scan], problem)
    for block in blocks:
        try:
            made = planner.plan_block(block, [plans[scan] for scan in block.scans], config.params(block.path, stages))
        except ScanError as error:
            made = ScanPlan(block.path, block.name, Content((-1, -1)), str(error))
        if made is not None:
            plans[block.path] = made
    return list(plans.values())


def _clashes(scans: Sequence[Path], contents: Mapping[Path, Content]) -> dict[Path, str]:
    """Scans that would share a product folder, among those that can be read at all."""
    by_stem = defaultdict(list)
    for scan in scans:
        if not contents[scan].problem:
            by_stem[scan.stem].append(scan)
    clashes = {}
    for same in by_stem.values():
        for scan in same if len(same) > 1 else ():
            others = " and ".join(str(other) for other in same if other != scan)
            clashes[scan] = f"has the same name without suffix as {others}; they would share the folder {scan.stem}/"
    return clashes


@dataclass
class _Draft:
    """A plan in the making: what is known of the stages before the one that is looked at."""

    record: Mapping[str, Any]
    keys: dict[str, str]
    nodes: dict[str, StageNode] = field(default_factory=dict)
    metas: dict[str, Meta] = field(default_factory=dict)


class _Planner:
    """Plans one scan or block at a time."""

    def __init__(
        self,
        layout: Layout,
        stages: Sequence[Stage],
        products: Sequence[Product],
        wiring: Wiring,
        selection: Selection,
    ) -> None:
        self._layout, self._stages, self._products, self._wiring = layout, stages, products, wiring
        self._forced, self._wanted = selection.forced(stages), selection.wanted(stages)

    def plan(self, scan: Path, content: Content, params: Mapping[str, Params], is_face: bool = False) -> ScanPlan:
        """Plan one scan; a face of a block only as far as a stage sees one scan at a time."""
        record = self._record(scan.stem)
        stages, products = self._stages, self._products
        if is_face:
            stages = [stage for stage in stages if not stage.sees_block]
            products = self._products_of({stage.name for stage in stages})
            record = _only(record, stages, products)
        draft = _Draft(record, {SOURCE: source_key(content.sha256), BLOCK: joint_key([])})
        self._plan_stages(stages, params, self._wiring.stages, draft)
        return self._finish(ScanPlan(scan, scan.stem, content), stages, products, self._wiring.products, draft)

    def plan_block(self, block: Block, plans: Sequence[ScanPlan], params: Mapping[str, Params]) -> ScanPlan | None:
        """Plan a block after its faces; None when nothing of it is asked for."""
        stages = [stage for stage in self._stages if stage.sees_block]
        if not any(stage.name in self._wanted for stage in stages):
            return None
        bad = [plan for plan in plans if plan.problem]
        if bad:
            raise ScanError(f"its face {bad[0].scan.name} cannot be used: {bad[0].problem}")
        faces = faces_of(block, plans)
        keys = tuple({node.stage: node.key for node in plan.stages} for plan in plans)
        part = BlockPart(tuple(plan.stem for plan in plans), faces, keys, frozenset(keys[0]))
        draft = _Draft(self._record(block.name), {SOURCE: "", BLOCK: joint_key([faces.plane, faces.size_px])})
        # The unit is told with the planes, and so is the length of a px in it.
        draft.keys[BLOCK] = joint_key([draft.keys[BLOCK], faces.pixel_size, faces.unit])
        for name in keys[0]:
            nodes = [next(node for node in plan.stages if node.stage == name) for plan in plans]
            metas = [plan.metas[name] for plan in plans if name in plan.metas]
            draft.nodes[name] = _joint_node(nodes)
            draft.keys[name] = draft.nodes[name].key
            if len(metas) == len(plans):
                draft.metas[name] = joint_meta(metas)
        self._plan_stages(stages, params, self._wiring.block_stages, draft)
        theirs = {product.name for product in self._products_of(set(keys[0]))}
        products = [product for product in self._products if product.name not in theirs]
        for product in products:
            if SOURCE in self._wiring.products[product.name]:
                raise ScanError(f"product {product.name} reads the file of a scan, and a block has none")
        plan = ScanPlan(block.path, block.name, Content((-1, -1)), block=part)
        return self._finish(plan, stages, products, self._wiring.block_products, draft)

    def _record(self, stem: str) -> dict[str, Any]:
        stored = read_json(self._layout.record(stem))
        return stored if isinstance(stored, dict) else {}

    def _products_of(self, stages: set[str]) -> list[Product]:
        """Products that are made from these stages alone."""
        return [product for product in self._products if set(self._wiring.products[product.name]) - {SOURCE} <= stages]

    def _plan_stages(
        self,
        stages: Sequence[Stage],
        params: Mapping[str, Params],
        wired: Mapping[str, Mapping[str, tuple[str, ...]]],
        draft: _Draft,
    ) -> None:
        """Add the nodes of some stages to a draft that knows what comes before them."""
        for stage in stages:
            inputs = {provider: draft.keys[provider] for provider in wired[stage.name]}
            full = params[stage.name].model_dump(mode="json")
            key = stage_key(stage.name, stage.version, params[stage.name].key_values(), inputs)
            draft.keys[stage.name] = key
            if stage.name not in self._wanted:
                continue
            meta = read_meta(self._layout, stage.name, key)
            node = StageNode(stage.name, stage.version, full, inputs, key, Action.RUN, "forced", True)
            if stage.name not in self._forced:
                action, reason = self._decide(node, meta, draft)
                node = replace(node, action=action, reason=reason, is_forced=False)
            draft.nodes[stage.name] = node
            if meta is not None:
                draft.metas[stage.name] = meta

    def _finish(
        self,
        plan: ScanPlan,
        stages: Sequence[Stage],
        products: Sequence[Product],
        wired: Mapping[str, Mapping[str, tuple[str, ...]]],
        draft: _Draft,
    ) -> ScanPlan:
        """Add the products to a draft and make it a plan."""
        mine = {stage.name for stage in stages}
        made = [
            self._plan_product(product, plan, wired[product.name], draft)
            for product in products
            if set(wired[product.name]) - {SOURCE, BLOCK} <= self._wanted
        ]
        planned = tuple(node for name, node in draft.nodes.items() if name in mine)
        return replace(
            plan,
            stages=planned,
            products=tuple(made),
            record=draft.record,
            metas=draft.metas,
            is_whole=len(planned) + len(made) == len(stages) + len(products),
        )

    def _decide(self, node: StageNode, meta: Meta | None, draft: _Draft) -> tuple[Action, str]:
        before = draft.record.get("stages", {}).get(node.stage)
        again = [name for name in node.inputs if name in draft.nodes and draft.nodes[name].action is not Action.REUSE]
        if meta is None:
            is_partial = self._layout.partial(node.stage, node.key).exists()
            return Action.RUN, why_stage(node.stage, node.record(), before, again, is_partial)
        if again:
            return Action.CHECK, f"reused unless {' or '.join(again)} gives other values"
        changed = changed_inputs(meta.input_digests, draft.metas)
        if changed:
            return Action.RUN, f"{' and '.join(changed)} gave other values since"
        return Action.REUSE, "nothing changed"

    def _plan_product(
        self, product: Product, plan: ScanPlan, wired: Mapping[str, tuple[str, ...]], draft: _Draft
    ) -> ProductNode:
        inputs = {provider: draft.keys[provider] for provider in wired if provider in {*draft.nodes, BLOCK}}
        key = product_key(product.name, product.version, plan.scan.name, inputs)
        before = draft.record.get("products", {}).get(product.name)
        path = self._layout.product(plan.stem, product.filename)
        again = [name for name in inputs if name in draft.nodes and draft.nodes[name].action is not Action.REUSE]
        reason = why_product(product.name, key, before, path, again)
        action = Action.RUN if reason else Action.CHECK if again else Action.REUSE
        if action is Action.REUSE and changed_inputs(before["digests"] if before else {}, draft.metas):
            action, reason = Action.RUN, "made from other values"
        if action is Action.CHECK:
            reason = f"reused unless {again[-1]} gives other values"
        return ProductNode(product.name, product.filename, inputs, key, action, reason or "nothing changed")


def faces_of(block: Block, plans: Sequence[ScanPlan]) -> Faces:
    """Planes of a block in px; raise `ScanError` where a photograph does not have the shape of its plane."""
    from stages.faces import Faces

    probes = [plan.content.probe for plan in plans if plan.content.probe is not None]
    for plan, plane, probe in zip(plans, block.planes, probes, strict=True):
        check_aspect(plane, probe, plan.scan.name)
    planes, size = planes_px(block.planes, probes)
    return Faces(planes, tuple((probe.width, probe.height) for probe in probes), size, block.unit)


def _joint_node(nodes: Sequence[StageNode]) -> StageNode:
    """The nodes of one stage of all faces, as one that a block's stages can refer to."""
    worst = max((node.action for node in nodes), key=[Action.REUSE, Action.CHECK, Action.RUN].index)
    return replace(nodes[0], key=joint_key([node.key for node in nodes]), action=worst)


def _only(record: Mapping[str, Any], stages: Sequence[Stage], products: Sequence[Product]) -> dict[str, Any]:
    """What a record tells of these stages and products: a scan may have been none of a block's faces before."""
    kept = {"stages": {stage.name for stage in stages}, "products": {product.name for product in products}}
    return {
        name: {key: entry for key, entry in value.items() if key in kept[name]} if name in kept else value
        for name, value in record.items()
    }
