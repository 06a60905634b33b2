"""Which stage reads what from which: checked before any pixel is read, all problems at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.problems import Problem, UsageError, did_you_mean

if TYPE_CHECKING:
    from stages.products import Product
    from stages.stage import Stage, Variable

SOURCE = "source"
BLOCK = "block"

Wired = dict[str, dict[str, tuple[str, ...]]]


@dataclass(frozen=True)
class Wiring:
    """For every stage and product: provider to the variables taken from it.

    The scan's file is ``source``; where its face lies in the wood comes from ``block``. The second pair holds the
    same for blocks, where joining the faces takes a few variables more.
    """

    stages: Wired
    products: Wired
    block_stages: Wired
    block_products: Wired

    def upstream(self, stage: str) -> list[str]:
        """Stages that `stage` reads from."""
        return [provider for provider in self.stages[stage] if provider not in (SOURCE, BLOCK)]


def wire(stages: Sequence[Stage], products: Sequence[Product] = ()) -> Wiring:
    """Connect stages and products in order; raise one `UsageError` with all that does not fit."""
    from stages.variables import DPI_PIXEL_SIZE, ENCODED, FACE_PLANE, FACE_TOP, OPAQUE

    given = {SOURCE: (ENCODED, OPAQUE, DPI_PIXEL_SIZE), BLOCK: (FACE_PLANE, FACE_TOP)}
    providers = {variable.name: name for name, variables in given.items() for variable in variables}
    known: dict[str, Variable] = {variable.name: variable for variables in given.values() for variable in variables}
    everywhere = {variable.name: stage.name for stage in stages for variable in stage.provides}
    problems: list[Problem] = []
    connected: Wired = {}
    for stage in stages:
        if stage.name in connected or stage.name in given:
            problems.append(Problem(stage.name, "is the name of two stages"))
        for variable in stage.requires:
            problems += _missing(variable, known, everywhere, stage.name)
        connected[stage.name] = _gather(stage.requires, providers)
        for variable in stage.provides:
            if variable.name in providers:
                problems.append(
                    Problem(stage.name, f"provides `{variable.name}`, which {providers[variable.name]} provides")
                )
            if stage.halo is not None and not {"y", "x"} <= set(variable.dims):
                problems.append(Problem(stage.name, f"is tile-local, but its `{variable.name}` has no dims y and x"))
            providers[variable.name], known[variable.name] = stage.name, variable
    for product in products:
        for variable in product.requires:
            problems += _missing(variable, known, everywhere, f"product {product.name}")
    problems += _mixed(stages, connected, {variable.name for variable in given[SOURCE]})
    if problems:
        raise UsageError("The stages do not fit together", problems)
    made = {product.name: _gather(product.requires, providers) for product in products}
    blocks = {stage.name: connected[stage.name] for stage in stages if stage.sees_block}
    seen = {stage.name for stage in stages if not stage.sees_block}
    joined, taken = (
        {name: _with_companions(wired, providers, seen) for name, wired in group.items()} for group in (blocks, made)
    )
    return Wiring(connected, made, joined, taken)


def _mixed(stages: Sequence[Stage], connected: Wired, of_file: set[str]) -> list[Problem]:
    """Stages that see one scan at a time and ask for what only a block has, and the other way round."""
    sees_block = {stage.name for stage in stages if stage.sees_block} | {BLOCK}
    problems = []
    for stage in stages:
        for provider, names in connected[stage.name].items():
            if stage.sees_block and provider == SOURCE and of_file.issuperset(names):
                told = f"sees a block, but requires `{names[0]}` of the scan's file"
            elif not stage.sees_block and provider in sees_block:
                told = f"sees one face at a time, but requires `{names[0]}` of {provider}; declare it `sees_block=True`"
            else:
                continue
            problems.append(Problem(stage.name, told))
    return problems


def _with_companions(
    wired: dict[str, tuple[str, ...]], providers: dict[str, str], seen: set[str]
) -> dict[str, tuple[str, ...]]:
    """What is read of a block, with what joining the faces takes beside that."""
    from stages.faces import companions

    more = {name: tuple(names) for name, names in wired.items()}
    for name in companions(name for names in wired.values() for name in names):
        if providers.get(name) in seen:
            more[providers[name]] = (*more.get(providers[name], ()), name)
    return more


def _missing(variable: Variable, known: dict[str, Variable], everywhere: dict[str, str], who: str) -> list[Problem]:
    if variable.name in known:
        if known[variable.name] == variable:
            return []
        return [
            Problem(
                who, f"requires another `{variable.name}` than is provided: {variable} is not {known[variable.name]}"
            )
        ]
    if variable.name in everywhere:
        return [Problem(who, f"requires `{variable.name}`, which {everywhere[variable.name]} provides only later")]
    return [Problem(who, f"requires `{variable.name}`, which nothing provides" + did_you_mean(variable.name, known))]


def _gather(requires: Sequence[Variable], providers: dict[str, str]) -> dict[str, tuple[str, ...]]:
    gathered: dict[str, tuple[str, ...]] = {}
    for variable in requires:
        provider = providers.get(variable.name, SOURCE)
        gathered[provider] = (*gathered.get(provider, ()), variable.name)
    return gathered
