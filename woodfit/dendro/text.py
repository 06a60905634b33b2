"""What all text formats share: bytes to lines, numbers taken strictly, limits, and errors that say where and why."""

from __future__ import annotations

import re

from woodfit.dendro.series import FormatError

MAX_BYTES = 16 * 2**20
"""Largest file that is read; the largest of the public archives have under 5 MB."""
MAX_RINGS = 100_000
"""Most rings of one series, years without a value included."""
MAX_TOTAL_RINGS = 4_000_000
"""Most rings of one file: a few characters can name two far years, and memory must not follow them."""
MAX_YEAR = 100_000
MAX_WIDTH_MM = 10_000.0

_INTEGER = re.compile(r"[+-]?[0-9]{1,9}")
_DECIMAL = re.compile(r"[+-]?(?:[0-9]{1,12}(?:\.[0-9]{0,25})?|\.[0-9]{1,25})(?:[eE][+-]?[0-9]{1,2})?")


def error(source: str, line: int | None, found: str, expected: str, advice: str = "") -> FormatError:
    """Make the one kind of error of all readers.

    Parameters
    ----------
    source : str
        File or other origin of the text.
    line : int or None
        Line, counted from 1.
    found, expected, advice : str
        What stands there, what should, and what the reader of the message can do.
    """
    where = source if line is None else f"{source}, line {line}"
    text = f"{where}: {found}; expected {expected}"
    return FormatError(f"{text}; {advice}" if advice else text)


def excerpt(text: str, length: int = 40) -> str:
    """Quote the beginning of a text for a message."""
    return repr(text if len(text) <= length else text[:length] + "...")


def decode(data: bytes, source: str) -> str:
    """Text of a file's bytes.

    UTF-8 and UTF-16 with byte order mark, plain UTF-8, else the Windows code page 1252, in which most programs of the
    field write; bytes that it does not know are taken as ISO 8859-1.

    Raises
    ------
    FormatError
        When the file is too large, binary or broken UTF-16.
    """
    check_size(len(data), source)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            text = data.decode("utf-16")
        except UnicodeDecodeError as reason:
            raise error(source, None, f"broken UTF-16 ({reason.reason})", "text", "save it again as UTF-8") from None
    else:
        text = _decode_bytewise(data)
    if "\0" in text:
        raise error(source, None, "a NUL character", "text", "the file is binary, or UTF-16 without byte order mark")
    return text


def check_size(size: int, source: str) -> None:
    """Refuse more bytes than `MAX_BYTES`."""
    if size > MAX_BYTES:
        raise error(source, None, f"{size} bytes", f"at most {MAX_BYTES}", "split the file")


def _decode_bytewise(data: bytes) -> str:
    for encoding in ("utf-8-sig", "cp1252"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return data.decode("latin-1")


def lines(text: str) -> list[str]:
    r"""Lines ended by LF, CR LF, CR or CR CR LF (which some archived files have); a final Ctrl-Z of DOS is dropped."""
    for ending in ("\r\r\n", "\r\n", "\r"):
        text = text.replace(ending, "\n")
    return text.rstrip("\x1a\n").split("\n")


def parse_int(token: str) -> int | None:
    """Integer of at most nine ASCII digits, or None."""
    return int(token) if _INTEGER.fullmatch(token) else None


def parse_float(token: str) -> float | None:
    """Decimal number in ASCII digits (no NaN, no infinity), or None."""
    return float(token) if _DECIMAL.fullmatch(token) else None


def parse_year(token: str, source: str, line: int | None) -> int:
    """Year of at most `MAX_YEAR`."""
    year = parse_int(token.strip())
    if year is None or abs(year) > MAX_YEAR:
        raise error(source, line, f"the year {excerpt(token)}", f"an integer within ±{MAX_YEAR}")
    return year


class RingBudget:
    """Counts the rings of a file while it is read.

    Parameters
    ----------
    source : str
        Origin, for the message.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self.total = 0

    def take(self, count: int, name: str) -> None:
        """Allow one series of `count` rings, or raise `FormatError`."""
        if count > MAX_RINGS:
            raise error(self.source, None, f"{count} rings in series {excerpt(name)}", f"at most {MAX_RINGS}")
        self.total += count
        if self.total > MAX_TOTAL_RINGS:
            raise error(
                self.source, None, f"more than {MAX_TOTAL_RINGS} rings, years without value included", "fewer",
                "look for a mistyped year, or split the file",
            )  # fmt: skip
