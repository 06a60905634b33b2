"""Names cut to the few columns of an old format, without two of them becoming one."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Sequence

from woodfit.dendro.series import FormatError


def short_names(names: Sequence[str], lengths: Sequence[int]) -> dict[str, str]:
    """Map names to distinct ASCII names of limited length.

    A name that fits stays as it is. Others lose accents, get ``_`` for blanks and signs that readers stumble over, and
    are cut; where the cut name is taken (upper and lower case count as the same), its end becomes a number. The same
    names in the same order always give the same result.

    Parameters
    ----------
    names : sequence of str
        Distinct names.
    lengths : sequence of int
        Columns for each.

    Raises
    ------
    FormatError
        When two names are equal.
    """
    doubled = sorted(name for name, count in Counter(names).items() if count > 1)
    if doubled:
        raise FormatError(f"several series are named {', '.join(map(repr, doubled))}; give each its own name")
    short: dict[str, str] = {}
    taken: set[str] = set()
    cleaned = {name: _clean(name, length) for name, length in zip(names, lengths, strict=True)}
    for name, length in zip(names, lengths, strict=True):
        if cleaned[name] == name and len(name) <= length:
            short[name] = name
            taken.add(name.lower())
    numbers: dict[str, int] = {}
    for name, length in zip(names, lengths, strict=True):
        if name not in short:
            short[name] = _free(cleaned[name], length, taken, numbers)
            taken.add(short[name].lower())
    return {name: short[name] for name in names}


def _clean(name: str, length: int) -> str:
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode("ascii")
    plain = "".join(sign if sign.isalnum() or sign in "-_.+/()" else "_" for sign in plain) or "_"
    # A minus in the last column would read as the sign of a four-digit year.
    return plain[: length - 1] + "_" if len(plain) == length and plain.endswith("-") else plain


def _free(name: str, length: int, taken: set[str], numbers: dict[str, int]) -> str:
    """A name that is not taken; `numbers` holds the next number to try for each cut name."""
    candidate = cut = name[:length].rstrip("-") or "_"
    number = numbers.get(cut, 2)
    while candidate.lower() in taken:
        digits = str(number)
        candidate = name[: length - len(digits)] + digits
        number += 1
    numbers[cut] = number
    return candidate
