"""The color map: the strip over ring age, and the same rings stacked over the fraction of their growth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.report.axes import Tick, ticks_between
from pipeline.report.pictures import jpeg, png, srgb_bytes
from pipeline.report.plots import ACCENT, MUTED, svg
from pipeline.report.reading import Scan
from stages.variables import COLOR_STRIP, LATENESS_STRIP, STRIP_SUPPORT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[Any]


def strip_section(scan: Scan) -> dict[str, Any] | None:
    """The color map's pictures; ``None`` before the color map."""
    if not scan.has(COLOR_STRIP):
        return None
    rgb = scan.values(COLOR_STRIP)
    age = _ages(scan, len(rgb))
    if len(age) < 2:
        return None
    lateness = scan.values(LATENESS_STRIP) if scan.has(LATENESS_STRIP) else np.full(len(age), np.nan)
    support = scan.values(STRIP_SUPPORT) if scan.has(STRIP_SUPPORT) else np.ones(len(age))
    half = 0.5 * float(np.median(np.diff(age)))
    low, high = float(age[0]) - half, float(age[-1]) + half
    seen = support > 0
    return {
        "long": _row(rgb),
        "seen_spans": _spans(seen, age, low, high, half),
        "curve": _curve(age, lateness, low, high),
        "ticks": [Tick(f"{100 * (v - low) / (high - low):.2f}", f"{v:g}") for v in ticks_between(low, high, 12)],
        "stack": _stack(age, rgb),
        "profile": _profile(age, lateness, seen),
        "share_seen": f"{100 * float(np.mean(seen)):.0f} %",
        "rings": int(np.floor(high + 1e-6) - np.floor(low + 1e-6)),
    }


def _ages(scan: Scan, size: int) -> Array:
    array = scan.ds[COLOR_STRIP.name]
    return np.asarray(array["strip"].values, float) if "strip" in array.coords else np.arange(size) + 0.5


def _row(rgb: Array) -> Any:
    """The strip as a picture one row high (two: some browsers smooth a single row away)."""
    line: Array = rgb[None].astype(np.float32)
    if line.shape[1] > 2400:
        line = np.asarray(cv2.resize(line, (2400, 1), interpolation=cv2.INTER_AREA))
    return png(srgb_bytes(np.repeat(line, 2, axis=0)), "Color over ring age, from the pith side outwards.")


def _spans(seen: Array, age: Array, low: float, high: float, half: float) -> list[dict[str, str]]:
    """Parts of the strip that the face shows, in per cent."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(int)))
    spans = []
    for first, end in zip(change[::2], change[1::2], strict=True):
        left, right = float(age[first]) - half, float(age[end - 1]) + half
        spans.append(
            {"left": f"{100 * (left - low) / (high - low):.2f}", "width": f"{100 * (right - left) / (high - low):.2f}"}
        )
    return spans


def _curve(age: Array, lateness: Array, low: float, high: float) -> str:
    """SVG path of the lateness in a frame of 1000 x 100."""
    stride = max(1, len(age) // 3000)
    places = 1000.0 * (age[::stride] - low) / (high - low)
    known = [(x, y) for x, y in zip(places, lateness[::stride], strict=True) if np.isfinite(y)]
    return "M" + "L".join(f"{x:.1f} {97 - 94 * y:.1f}" for x, y in known) if known else ""


def _table(age: Array, values: Array) -> tuple[Array, Array]:
    """Values of each ring at even fractions, shape (rings, fractions, ...), and the rings' numbers."""
    samples = max(2, int(np.clip(round(1.0 / float(np.median(np.diff(age)))), 2, 256)))
    rings = np.arange(int(np.floor(age[0] + 1e-9)), int(np.floor(age[-1] - 1e-9)) + 1)
    wanted = rings[:, None] + (np.arange(samples) + 0.5) / samples
    flat = values.reshape(len(values), -1)
    table = np.stack([np.interp(wanted, age, column) for column in flat.T], axis=-1)
    return table.reshape(*wanted.shape, *values.shape[1:]), rings


def _stack(age: Array, rgb: Array) -> dict[str, Any]:
    table, rings = _table(age, rgb)
    height = int(np.clip(360 // len(rings), 3, 16))
    wide = cv2.resize(table.astype(np.float32), (720, len(rings)), interpolation=cv2.INTER_LINEAR)
    tall = np.repeat(wide.reshape(len(rings), 720, 3), height, axis=0)
    ticks = [v for v in ticks_between(float(rings[0]), float(rings[-1]), 8) if v == round(v)]
    span = len(rings)
    return {
        "picture": jpeg(
            srgb_bytes(tall), f"Colors of {span} rings, one row each, from earlywood on the left to latewood.", 90
        ),
        "ticks": [Tick(f"{100 * (v - rings[0] + 0.5) / span:.2f}", f"{v:g}") for v in ticks],
    }


def _profile(age: Array, lateness: Array, seen: Array) -> str:
    """Lateness over the fraction of the ring: each ring thin, their median bold."""
    table, rings = _table(age, lateness)
    shown, _ = _table(age, seen.astype(float))
    kept = shown.mean(axis=1) > 0.5
    table = table[kept] if kept.any() else table
    fraction = (np.arange(table.shape[1]) + 0.5) / table.shape[1]

    def draw(axes: Axes) -> None:
        for row in table[:: max(1, len(table) // 60)]:
            axes.plot(fraction, row, color=MUTED, linewidth=0.5, alpha=0.28)
        axes.plot(fraction, np.median(table, axis=0), color=ACCENT, linewidth=2.2)
        axes.set(xlim=(0, 1), ylim=(-0.02, 1.02), xlabel="fraction of the ring", ylabel="lateness")

    return svg("profile", f"Lateness over the fraction of {len(rings)} rings, with their median.", (400, 190), draw)
