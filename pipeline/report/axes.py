"""Color bars and scales as plain HTML, whose text keeps its size on every screen."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pipeline.report.palettes import css_gradient


@dataclass(frozen=True)
class Tick:
    """A mark on a scale: place in per cent from the left, and its text."""

    place: str
    text: str


@dataclass(frozen=True)
class Bar:
    """A color bar.

    Parameters
    ----------
    gradient
        CSS gradient.
    ticks
        From left to right.
    unit
        Written behind the last tick.
    """

    gradient: str
    ticks: tuple[Tick, ...]
    unit: str


def ticks_between(low: float, high: float, most: int = 6) -> list[float]:
    """Round numbers from `low` to `high`, at most about `most` of them."""
    span = high - low
    if not (math.isfinite(span) and span > 0):
        return [low]
    rough = span / max(most - 1, 1)
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(unit * factor for factor in (1, 2, 5, 10) if unit * factor >= rough * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [round(i * step, 12) for i in range(first, math.floor(high / step + 1e-9) + 1)]


def _tick(share: float, value: float) -> Tick:
    return Tick(f"{100 * share:.2f}", f"{value:.4g}".replace("-", "\u2212"))


def linear_bar(name: str, low: float, high: float, unit: str) -> Bar:
    """Bar of evenly spaced values."""
    ticks = tuple(_tick((value - low) / (high - low), value) for value in ticks_between(low, high))
    return Bar(css_gradient(name), ticks, unit)


def log_bar(name: str, low: float, high: float, unit: str) -> Bar:
    """Bar of values evenly spaced in their logarithm."""
    span = math.log(high / low)
    if high / low > 4.0:
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        values = [m * 10.0**e for e in decades for m in ((1, 2, 5) if high / low < 200 else (1,))]
        values = [value for value in values if low <= value <= high]
    else:
        values = ticks_between(low, high, 5)
    return Bar(css_gradient(name), tuple(_tick(math.log(value / low) / span, value) for value in values), unit)


def phase_bar() -> Bar:
    """Bar of one turn."""
    ticks = (
        Tick("0", "0"),
        Tick("25", "\u00bd\u03c0"),
        Tick("50", "\u03c0"),
        Tick("75", "1\u00bd\u03c0"),
        Tick("100", "2\u03c0"),
    )
    return Bar(css_gradient("phase"), ticks, "")
