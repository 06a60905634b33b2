"""Where everything lies below the output folder, and writing small files whole."""

from __future__ import annotations

import json
import os
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Layout:
    """Paths below one output folder.

    Products lie in ``<output>/<stem>/``; what woodpipe keeps for itself lies in ``<output>/.woodpipe/``.
    """

    output: Path

    @property
    def root(self) -> Path:
        """Folder of the cache and the records."""
        return self.output / ".woodpipe"

    @property
    def results(self) -> Path:
        """Folder of the stages' results."""
        return self.root / "results"

    @property
    def scratch(self) -> Path:
        """Folder for what lives only as long as a task."""
        return self.root / "scratch"

    @property
    def files(self) -> Path:
        """Index of the scans' contents."""
        return self.root / "files.json"

    @property
    def configs(self) -> Path:
        """List of the configs that wrote here."""
        return self.root / "configs.json"

    def result(self, stage: str, key: str) -> Path:
        """A whole result; its being there means that it is complete."""
        return self.results / stage / key

    def partial(self, stage: str, key: str) -> Path:
        """A result in the making."""
        return self.results / stage / f"{key}.partial"

    def lock(self, stage: str, key: str) -> Path:
        """Lock file of one result or product."""
        return self.root / "locks" / f"{stage}-{key}"

    def record(self, stem: str) -> Path:
        """What was last done for a scan."""
        return self.root / "scans" / f"{stem}.json"

    def product(self, stem: str, filename: str) -> Path:
        """A product."""
        return self.output / stem / filename


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file so that readers see the old or the new one, never half of one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    temporary.write_text(json.dumps(value, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    os.replace(temporary, path)


def read_json(path: Path) -> Any:
    """Read a JSON file; ``None`` if there is none or it cannot be understood."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
