"""The page over a run's scans."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pipeline.context import ScanRow, woodpipe_version
from pipeline.report.tables import seconds_text
from pipeline.report.templating import render

_THUMBNAIL = re.compile(r'<meta name="woodpipe-thumbnail" content="(data:image/jpeg;base64,[A-Za-z0-9+/=]+)">')
_HEAD_BYTES = 200_000
_WORDS = {"done": "done", "reused": "reused", "partly": "stopped where asked", "failed": "failed"}


def render_index(rows: Sequence[ScanRow], folder: Path) -> str:
    """HTML of the index.

    Parameters
    ----------
    rows
        One per scan.
    folder
        Where the scans' product folders lie.

    Returns
    -------
    str
        A page that needs nothing beside it but the pages it links to.
    """
    blocks = {row.stem for row in rows} & {row.block for row in rows}
    # Faces have no page and no picture of their own: they stand with their block, unless it failed.
    made = {row.stem for row in rows if row.stem in blocks and row.outcome != "failed"}
    scans = [_scan(row, folder) for row in rows if row.block not in made]
    for scan in scans:
        scan["faces"] = [_scan(row, folder) for row in rows if row.block and row.block == scan["stem"]]
    counts = Counter(row.outcome for row in rows)
    return render(
        "index.html.j2",
        scans=[scan for scan in scans if not scan["failed"]],
        failed=[scan for scan in scans if scan["failed"]],
        count=len(rows) - len(blocks),
        blocks=len(blocks),
        summary=[f"{counts[outcome]} {_WORDS.get(outcome, outcome)}" for outcome in counts],
        seconds=seconds_text(sum(row.seconds for row in rows)),
        version=woodpipe_version(),
    )


def _scan(row: ScanRow, folder: Path) -> dict[str, Any]:
    files = {product: f"{quote(row.stem)}/{quote(file)}" for product, file in row.products.items()}
    report = next((link for link in files.values() if link.endswith(".html")), None)
    page = next((file for file in row.products.values() if file.endswith(".html")), "report.html")
    return {
        "name": row.scan.name,
        "stem": row.stem,
        "outcome": _WORDS.get(row.outcome, row.outcome),
        "failed": row.outcome == "failed",
        "message": row.message,
        "rings": "" if row.rings is None else f"{row.rings:,}",
        "seconds": seconds_text(row.seconds),
        "report": report,
        "others": [
            {"name": Path(file).name, "link": files[product]}
            for product, file in sorted(row.products.items())
            if not file.endswith(".html")
        ],
        "warnings": row.warnings,
        "thumbnail": read_thumbnail(folder / row.stem / page),
    }


def read_thumbnail(report: Path) -> str | None:
    """Data URI of the small picture that a scan's page carries in its head; ``None`` if there is none."""
    try:
        with report.open(encoding="utf-8", errors="replace") as file:
            found = _THUMBNAIL.search(file.read(_HEAD_BYTES))
    except OSError:
        return None
    return found[1] if found else None
