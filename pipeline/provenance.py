"""Where a scan's results and products lie and how they came about."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipeline.context import ScanRow
from pipeline.layout import Layout, read_json
from pipeline.problems import Problem, UsageError, did_you_mean
from pipeline.store import read_meta, read_provenance, rings_found


def provenance_of(layout: Layout, stem: str) -> dict[str, Any]:
    """Collect all that is known of a scan's last run, as JSON values; paths are absolute."""
    record = read_json(layout.record(stem))
    if not isinstance(record, dict):
        known = recorded_stems(layout)
        raise UsageError(
            "Nothing to show", [Problem("", f"no run of {stem!r} in {layout.output}" + did_you_mean(stem, known))]
        )
    products = {name: layout.product(stem, entry["file"]) for name, entry in record["products"].items()}
    return {
        "scan": record["scan"],
        "stem": stem,
        "content": record["content"],
        **({"faces": record["faces"]} if "faces" in record else {}),
        "problem": record["message"],
        "output": str(layout.output),
        "folder": str(layout.output / stem),
        "products": {name: str(path) for name, path in products.items() if path.exists()},
        "missing": sorted(name for name, path in products.items() if not path.exists()),
        "stages": {name: _stage(layout, name, entry) for name, entry in record["stages"].items()},
    }


def _stage(layout: Layout, name: str, entry: dict[str, Any]) -> dict[str, Any]:
    meta = read_meta(layout, name, entry["key"])
    made = read_provenance(layout, name, entry["key"])
    return {
        **entry,
        "complete": meta is not None,
        "result": str(layout.result(name, entry["key"]) / "data.zarr"),
        "warnings": meta.warnings if meta else [],
        "figures": meta.figures if meta else {},
        "variables": meta.variables if meta else {},
        **{field: made[field] for field in ("created", "seconds", "reason", "versions") if field in made},
    }


def recorded_rows(layout: Layout, scans: Iterable[Path]) -> list[ScanRow]:
    """Lines for scans and blocks that this run left alone, from what their last run left behind."""
    rows = []
    for scan in scans:
        record = read_json(layout.record(scan.stem))
        if not isinstance(record, dict) or record["scan"] != str(scan):
            continue
        metas = [read_meta(layout, name, entry["key"]) for name, entry in record["stages"].items()]
        there = [meta for meta in metas if meta is not None]
        products = {name: entry["file"] for name, entry in record["products"].items()}
        rows.append(
            ScanRow(
                scan=scan,
                stem=scan.stem,
                outcome="failed" if record["message"] else "reused",
                message=record["message"],
                rings=rings_found(there),
                products={name: file for name, file in products.items() if layout.product(scan.stem, file).exists()},
                warnings=tuple(warning for meta in there for warning in meta.warnings),
            )
        )
    return rows


def recorded_stems(layout: Layout) -> list[str]:
    """Scans that were run in this output."""
    folder = layout.root / "scans"
    return sorted(path.stem for path in folder.glob("*.json") if not path.name.startswith("."))


def stem_of(scan: str, known: Iterable[str]) -> str:
    """Stem of a scan given by stem, file name or path."""
    return scan if scan in set(known) else Path(scan).stem
