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


@dataclass(frozen=True)
class Wiring:
    """For every stage and product: provider to the variables taken from it; the scan's file is ``source``."""

    stages: dict[str, dict[str, tuple[str, ...]]]
    products: dict[str, dict[str, tuple[str, ...]]]

    def upstream(self, stage: str) -> list[str]:
        """Stages that `stage` reads from."""
        return [provider for provider in self.stages[stage] if provider != SOURCE]


def wire(stages: Sequence[Stage], products: Sequence[Product] = ()) -> Wiring:
    """Connect stages and products in order; raise one `UsageError` with all that does not fit."""
    from stages.variables import DPI_PIXEL_SIZE, ENCODED, OPAQUE

    providers = dict.fromkeys((ENCODED.name, OPAQUE.name, DPI_PIXEL_SIZE.name), SOURCE)
    known: dict[str, Variable] = {variable.name: variable for variable in (ENCODED, OPAQUE, DPI_PIXEL_SIZE)}
    everywhere = {variable.name: stage.name for stage in stages for variable in stage.provides}
    problems: list[Problem] = []
    connected: dict[str, dict[str, tuple[str, ...]]] = {}
    for stage in stages:
        if stage.name in connected or stage.name == SOURCE:
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
    if problems:
        raise UsageError("The stages do not fit together", problems)
    return Wiring(connected, {product.name: _gather(product.requires, providers) for product in products})


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
