"""Finding and removing results that no config reaches any more."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.layout import Layout, read_json, write_json
from pipeline.locks import Lock

if TYPE_CHECKING:
    from pipeline.plan import ScanPlan
    from stages.stage import Stage


@dataclass(frozen=True)
class Leftover:
    """A result, or part of one, that nothing reaches."""

    stage: str
    key: str
    path: Path
    size: int


def reachable_keys(plans: Iterable[ScanPlan]) -> set[tuple[str, str]]:
    """Stage and key of every result that the plans name."""
    return {(node.stage, node.key) for plan in plans for node in plan.stages}


def find_leftovers(layout: Layout, reached: set[tuple[str, str]]) -> list[Leftover]:
    """List everything in the cache that is not reached, and pieces that interrupted runs left of it."""
    found = []
    for path in sorted(layout.results.glob("*/*")):
        key, _, rest = path.name.partition(".")
        if rest.startswith("old-") or (path.parent.name, key) not in reached:
            size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
            found.append(Leftover(path.parent.name, key, path, size))
    return found


def remove(layout: Layout, leftovers: Sequence[Leftover]) -> int:
    """Remove what no run is at just now; returns how many were removed."""
    removed = 0
    for leftover in leftovers:
        lock = Lock.try_acquire(layout.lock(leftover.stage, leftover.key))
        if lock is None:
            continue
        shutil.rmtree(leftover.path, ignore_errors=True)
        lock.release(remove=True)
        removed += 1
    return removed


def known_configs(layout: Layout) -> list[Path]:
    """Configs that wrote to this output and still exist; those that are gone are forgotten."""
    stored = read_json(layout.configs)
    paths = [Path(path) for path in stored] if isinstance(stored, list) else []
    there = [path for path in paths if path.exists()]
    if len(there) != len(paths):
        write_json(layout.configs, [str(path) for path in there])
    return there


def all_plans(layout: Layout, configs: Iterable[Path], stages: Sequence[Stage]) -> list[ScanPlan]:
    """Plan every config that writes to this output."""
    from pipeline.project import Project

    plans: list[ScanPlan] = []
    for path in configs:
        project = Project.load(path, stages, ())
        if Layout(project.config.output) == layout:
            plans += project.plan()
    return plans


def human_size(size: float) -> str:
    """``1.2 GB`` and the like."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} TB"
