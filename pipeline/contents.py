"""What a scan's file holds: its hash and a first look at it, remembered by path, size and time."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.keys import hash_file
from pipeline.layout import read_json, write_json
from pipeline.probe import Probe, probe_scan
from pipeline.problems import ScanError


@dataclass(frozen=True)
class Content:
    """One version of a file; `problem` says in one line why it cannot be a scan."""

    stamp: tuple[int, int]
    sha256: str = ""
    probe: Probe | None = None
    problem: str = ""


class FileIndex:
    """Remembers the content of files between runs; losing it costs only time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        stored = read_json(path)
        self._known: dict[str, Any] = stored if isinstance(stored, dict) else {}
        self._changed = False

    def look(self, path: Path) -> Content:
        """Content of a file, hashed and opened only if it changed since the last look."""
        try:
            stamp = file_stamp(path)
        except OSError:
            stamp = (-1, -1)
        known = self._known.get(str(path))
        if known and tuple(known["stamp"]) == stamp:
            return Content(stamp, known["sha256"], Probe(**known["probe"]))
        try:
            probe = probe_scan(path)
            content = Content(stamp, hash_file(path), probe)
        except ScanError as error:
            return Content(stamp, problem=str(error))
        self._known[str(path)] = {"stamp": list(stamp), "sha256": content.sha256, "probe": asdict(probe)}
        self._changed = True
        return content

    def save(self) -> None:
        """Write the index if it learned something."""
        if self._changed:
            write_json(self._path, self._known)


def file_stamp(path: Path) -> tuple[int, int]:
    """Size and time of last change; if they are the same, so is the content."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns
