"""What a product's writer is told besides the arrays, and what the run's index is told about each scan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class ProductContext:
    """One scan's or block's story, for its products.

    Parameters
    ----------
    scan
        The scan's file; for a block, a path that only carries its name.
    stem
        Name of its product folder.
    params
        Stage name to that stage's full parameters, defaults included.
    keys
        Stage name to the key of the result used.
    seconds
        Stage name to the time it took when it was computed.
    warnings
        What the stages want a person to know, in words, in stage order.
    figures
        Stage name to its figures, each a number or a short text.
    version
        Version of woodpipe that writes the product.
    faces
        Of a block: the names of its faces, in order.
    """

    scan: Path
    stem: str
    params: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    keys: Mapping[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    figures: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    version: str = "unknown"
    faces: tuple[str, ...] = ()


@dataclass(frozen=True)
class ScanRow:
    """One line of the summary and of ``index.html``.

    Parameters
    ----------
    scan
        The scan's file.
    stem
        Name of its product folder, beside ``index.html``.
    outcome
        ``"done"``, ``"reused"``, ``"partly"`` (stopped where asked) or ``"failed"``.
    message
        One line: why it failed, else empty.
    rings
        Ring boundaries found; ``None`` when not traced.
    seconds
        Time spent on this scan in this run.
    products
        Product name to file name within the product folder, of those that exist.
    warnings
        What the stages want a person to know.
    block
        Name of the block whose face it is; empty for other scans.
    """

    scan: Path
    stem: str
    outcome: str
    message: str = ""
    rings: int | None = None
    seconds: float = 0.0
    products: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    block: str = ""


def woodpipe_version() -> str:
    """Version of the installed distribution."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("woodpipe")
    except PackageNotFoundError:
        return "unknown"
