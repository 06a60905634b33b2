"""Series of ring widths from files of any format that is read, and from the product folders of scans."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from woodfit.dendro import formats
from woodfit.dendro.series import FormatError, RingSeries
from woodfit.series_document import FORMAT, VERSION, ring_series

SERIES_FILE = "series.json"


def read_series(path: Path) -> list[RingSeries]:
    """Read the series of a file, or of the product folder of a scan.

    Widths of a scan without a scale are in px: enough to compare years, not to write them to a file of widths.

    Raises
    ------
    FormatError
        When it cannot be read: where, what was found, what was expected.
    """
    if path.is_dir():
        inside = path / SERIES_FILE
        if not inside.is_file():
            raise FormatError(f"{path}: a folder without {SERIES_FILE}; expected a scan's product folder or a file")
        return read_series(inside)
    if path.suffix.lower() == ".json" and path.is_file():
        text = formats.read_text(path)
        try:
            document = json.loads(text)
        except (ValueError, RecursionError):
            document = None
        # Anything else in JSON is the other reader's, whose message also serves for what is no JSON.
        if isinstance(document, dict) and document.get("format") == FORMAT:
            return _series(document, path)
    return formats.read(path)


def _series(document: Mapping[str, Any], path: Path) -> list[RingSeries]:
    if document.get("version") != VERSION:
        raise FormatError(f"{path}: version {document.get('version')!r}, expected {VERSION}; write it again")
    try:
        if document["pixel_size_mm"] is None:
            document = {**document, "pixel_size_mm": 1.0, "paths": [_in_px(one) for one in document["paths"]]}
        return ring_series(document)
    except (KeyError, TypeError, AttributeError, IndexError, ValueError) as reason:
        found = f"{type(reason).__name__}: {reason}"
        raise FormatError(f"{path}: not a whole document of ring series ({found}); write it again") from None


def _in_px(one: Mapping[str, Any]) -> dict[str, Any]:
    """A path whose widths in mm are those in px."""
    same = {f"{name}_mm": f"{name}_px" for name in ("width", "earlywood", "latewood")}
    rings = [{**ring, **{mm: ring[px] for mm, px in same.items()}} for ring in one["rings"]]
    return {**one, "rings": rings}
