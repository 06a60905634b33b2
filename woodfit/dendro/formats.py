"""One door to all formats of ring series: reading by the ending of a file's name, writing by the name of a format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType

from woodfit.dendro import coorecorder, heidelberg, series_json, series_tables, tridas, tucson
from woodfit.dendro.series import RingSeries
from woodfit.dendro.text import check_size, decode, error

Dumps = Callable[[Sequence[RingSeries]], str]

FORMATS: MappingProxyType[str, tuple[str, Dumps]] = MappingProxyType(
    {
        "rwl": (".rwl", partial(tucson.dumps, unit_mm=0.001)),
        "rwl_hundredths": (".rwl", partial(tucson.dumps, unit_mm=0.01)),
        "fh": (".fh", heidelberg.dumps),
        "tridas": (".xml", tridas.dumps),
        "csv": (".csv", series_tables.dumps_wide),
        "csv_long": (".csv", series_tables.dumps_long),
        "json": (".json", series_json.dumps),
    }
)
"""Ending of the file name and writer of each format; a .pos file holds a path and is written by `coorecorder`."""


def read(path: Path) -> list[RingSeries]:
    """Read the ring series of a file.

    Parameters
    ----------
    path : Path
        ``.rwl``, ``.raw`` or ``.tuc`` (Tucson), ``.pos`` (CooRecorder; the series has the name of the file), ``.fh``
        (Heidelberg), ``.xml`` or ``.tridas`` (TRiDaS), ``.csv``, ``.json``; upper or lower case.

    Raises
    ------
    FormatError
        When the ending is none of these, and when the file is missing, empty, too large, binary or broken.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise error(str(path), None, f"the ending {path.suffix!r}", f"one of {' '.join(_READERS)}", "rename the file")
    return reader(read_bytes(path), path)


def read_bytes(path: Path) -> bytes:
    """Bytes of a file of limited size that is not empty."""
    try:
        check_size(path.stat().st_size, str(path))
        data = path.read_bytes()
    except OSError as reason:
        raise error(str(path), None, reason.strerror or "an unreadable file", "a file that can be read") from None
    if not data.strip():
        raise error(str(path), None, "an empty file", "ring widths")
    return data


def read_text(path: Path) -> str:
    """Text of a file, see `woodfit.dendro.text.decode`."""
    return decode(read_bytes(path), str(path))


def _textual(loads: Callable[[str, str], list[RingSeries]]) -> Callable[[bytes, Path], list[RingSeries]]:
    return lambda data, path: loads(decode(data, str(path)), str(path))


def _pos(data: bytes, path: Path) -> list[RingSeries]:
    return [coorecorder.loads(decode(data, str(path)), str(path)).series(path.stem)]


_tucson, _tridas = _textual(tucson.loads), lambda data, path: tridas.loads(data, str(path))
_READERS: dict[str, Callable[[bytes, Path], list[RingSeries]]] = {
    ".rwl": _tucson,
    ".raw": _tucson,
    ".tuc": _tucson,
    ".pos": _pos,
    ".fh": _textual(heidelberg.loads),
    ".xml": _tridas,
    ".tridas": _tridas,
    ".csv": _textual(series_tables.loads_csv),
    ".json": _textual(series_json.loads),
}
