"""Errors for people: every problem at once, each with where it is and what was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError


@dataclass(frozen=True, order=True)
class Problem:
    """One thing wrong: `where` is a path such as ``stages.pose.spread``, `what` says found and expected."""

    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}" if self.where else self.what


class UsageError(ValueError):
    """The config or the command cannot be followed; the message lists every problem."""

    def __init__(self, title: str, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__(title + ":\n" + "\n".join(f"  - {problem}" for problem in self.problems))


class ScanError(ValueError):
    """A scan that cannot be used; the message is one clear line."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """``" (did you mean 'sigma'?)"``, or the list of what there is when nothing is close."""
    names = sorted(known)
    close = difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    if close:
        return f" (did you mean '{close[0]}'?)"
    return f" (there is: {', '.join(names)})" if names else ""


def join_path(*parts: str | int) -> str:
    """Write a YAML path: keys joined by dots, list positions in brackets."""
    text = ""
    for part in parts:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
    return text


def validation_problems(error: ValidationError, known: Iterable[str], *prefix: str | int) -> list[Problem]:
    """Translate pydantic's errors; `known` are the field names for suggestions."""
    return [problem_of(item, known, *prefix) for item in error.errors()]


def problem_of(item: Any, known: Iterable[str], *prefix: str | int) -> Problem:
    """Translate one line of pydantic's errors."""
    where = join_path(*prefix, *item["loc"])
    if item["type"] == "extra_forbidden":
        return Problem(where, "unknown key" + did_you_mean(str(item["loc"][-1]), known))
    if item["type"] == "missing":
        return Problem(where, "is missing")
    message = item["msg"][0].lower() + item["msg"][1:]
    found = "" if isinstance(item["input"], dict | list) else f", found {item['input']!r}"
    return Problem(where, message.removeprefix("value error, ") + found)
