"""Figures, parameters and keys as rows of text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pipeline.context import ProductContext


def number_text(value: Any) -> str:
    """A number or other value as people read it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "not set"
    if isinstance(value, float) or hasattr(value, "dtype"):
        number = float(value)
        if math.isnan(number):
            return "unknown"
        if math.isinf(number):
            return "infinite" if number > 0 else "\u2212infinite"
        text = f"{number:.4g}" if abs(number) < 10_000 else f"{number:,.0f}"
        if "e" not in text:
            return text.replace("-", "\u2212")
        mantissa, _, exponent = text.partition("e")
        return f"{mantissa}e{int(exponent)}".replace("-", "\u2212")
    if isinstance(value, int):
        return f"{value:,}".replace("-", "\u2212")
    if isinstance(value, (list, tuple)):
        return ", ".join(number_text(item) for item in value) or "none"
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {number_text(item)}" for key, item in value.items()) or "none"
    return str(value)


def seconds_text(seconds: float) -> str:
    """A time as people read it."""
    if seconds >= 90:
        return f"{int(seconds // 60)} min {seconds % 60:.0f} s"
    return f"{seconds:.1f} s" if seconds >= 0.1 else f"{1000 * seconds:.0f} ms"


def stage_rows(context: ProductContext) -> list[dict[str, Any]]:
    """What is known of each stage: time, key, figures and parameters, as text."""
    longest = max(context.seconds.values(), default=0.0)
    names = dict.fromkeys((*context.keys, *context.seconds, *context.params, *context.figures))
    return [
        {
            "name": name,
            "title": name.replace("_", " "),
            "seconds": seconds_text(context.seconds[name]) if name in context.seconds else "",
            "share": f"{100 * context.seconds.get(name, 0.0) / longest:.1f}" if longest > 0 else "0",
            "key": context.keys.get(name, ""),
            "figures": _pairs(context.figures.get(name, {})),
            "params": _pairs(context.params.get(name, {}), plain=False),
        }
        for name in names
    ]


def _pairs(values: Mapping[str, Any], plain: bool = True) -> list[dict[str, str]]:
    return [
        {"name": name.replace("_", " ") if plain else name, "value": number_text(value)}
        for name, value in values.items()
    ]
