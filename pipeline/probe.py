"""A first look at a scan's file: can it be opened, is it whole as far as its structure says, is it large enough."""

from __future__ import annotations

import os
import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.problems import ScanError

MINIMUM_SIDE = 16
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Probe:
    """Size of the upright image, px."""

    width: int
    height: int


def probe_scan(path: Path) -> Probe:
    """Size of the scan, or a `ScanError` with one line that says what is wrong with the file."""
    check_file(path)
    spec = open_image(path).spec()
    check_spec(spec)
    turned = int(spec.get_int_attribute("Orientation", 1)) >= 5
    return Probe(spec.height, spec.width) if turned else Probe(spec.width, spec.height)


def check_file(path: Path) -> None:
    """Raise `ScanError` if the file is not there, not a file, not readable, empty, or a cut-off PNG."""
    if not path.exists():
        raise ScanError("the file is gone" if not path.is_symlink() else "is a link to nothing")
    if path.is_dir():
        raise ScanError("is a folder, not an image")
    if not path.is_file():
        raise ScanError("is not a regular file")
    try:
        with path.open("rb") as file:
            head = file.read(len(PNG_SIGNATURE))
    except OSError as error:
        raise ScanError(f"cannot be read: {os.strerror(error.errno or 0).lower()}") from None
    if not head:
        raise ScanError("is empty (0 bytes)")
    if head == PNG_SIGNATURE:
        _check_png_chunks(path)


def open_image(path: Path) -> Any:
    """OpenImageIO's input for the file, colors as stored, not multiplied by alpha."""
    import OpenImageIO as oiio  # noqa: N813

    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    image = oiio.ImageInput.open(str(path), hints)
    if image is None:
        error = one_line(oiio.geterror())
        reason = "it is a text file" if _is_text(path) else error
        kind = path.suffix.lstrip(".").upper() or "image"
        article = "an" if kind[0] in "AEIOU" else "a"
        raise ScanError(f"cannot be opened as {article} {kind} image: {reason or 'unknown format'}")
    return image


def check_spec(spec: Any) -> None:
    """Raise `ScanError` for an image that no stage could use."""
    if spec.width < MINIMUM_SIDE or spec.height < MINIMUM_SIDE:
        raise ScanError(f"is too small: {spec.width}×{spec.height} px, at least {MINIMUM_SIDE} px per side are needed")
    if spec.depth > 1 or spec.deep:
        raise ScanError("is a volume or deep image, expected a flat one")


def one_line(text: str, limit: int = 160) -> str:
    """First line of an error text, without a quoted path, shortened."""
    lines = [re.sub(r'\s*\(?"[^"]*[/\\][^"]*"\)?\s*', " ", line).strip() for line in text.splitlines() if line.strip()]
    first = lines[0] if lines else ""
    return first if len(first) <= limit else first[: limit - 1] + "…"


def _is_text(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(512)
    return all(byte in b"\t\n\r" or 32 <= byte < 127 for byte in head)


def _check_png_chunks(path: Path) -> None:
    """Walk the chunks: libpng says nothing of a file cut after its last row, and too much to stderr before."""
    size = path.stat().st_size
    position = len(PNG_SIGNATURE)
    with path.open("rb") as file:
        while position + 12 <= size:
            file.seek(position)
            length, kind = struct.unpack(">I4s", file.read(8))
            position += 12 + length
            if kind == b"IEND" and position <= size:
                return
    raise ScanError(f"is truncated: the PNG ends early, after {size} bytes")
