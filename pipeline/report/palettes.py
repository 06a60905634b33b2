"""Colors for numbers: a cyclic palette of even lightness, and maps from matplotlib."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.report.pictures import srgb_bytes

Array = npt.NDArray[Any]
Bytes = npt.NDArray[np.uint8]

#: Rings with the same last digit share a color.
RING_CYCLE = 10

#: Shown where there is no wood or no number.
NOTHING = np.array([128, 124, 119], dtype=np.uint8)


def oklch(lightness: Array, chroma: Array, hue_rad: Array) -> Array:
    """Linear sRGB (..., 3), unclipped, of OKLCH coordinates."""
    a, b = chroma * np.cos(hue_rad), chroma * np.sin(hue_rad)
    roots = [
        lightness + 0.3963377774 * a + 0.2158037573 * b,
        lightness - 0.1055613458 * a - 0.0638541728 * b,
        lightness - 0.0894841775 * a - 1.2914855480 * b,
    ]
    cubes = np.stack(roots, axis=-1) ** 3
    to_rgb = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    return np.asarray(cubes @ to_rgb.T)


@cache
def _wheel(size: int, lightness: float, chroma: float, start_rad: float) -> Array:
    hue = start_rad + 2 * np.pi * np.arange(size) / size
    return np.clip(oklch(np.full(size, lightness), np.full(size, chroma), hue), 0.0, 1.0)


def phase_colors(phase_rad: Array, confidence: Array) -> Bytes:
    """SRGB bytes of a phase as hue, darkened by ``1 - confidence``."""
    wheel = _wheel(512, 0.76, 0.135, 0.5)
    spot = np.floor(np.nan_to_num(phase_rad) / (2 * np.pi) * 512).astype(np.int64) % 512
    return srgb_bytes(wheel[spot] * (np.clip(np.nan_to_num(confidence), 0.0, 1.0) ** 1.5)[..., None])


def ring_color(index: int) -> str:
    """CSS color of a ring number."""
    wheel = srgb_bytes(_wheel(RING_CYCLE, 0.80, 0.15, 0.35))
    red, green, blue = wheel[(index * 3) % RING_CYCLE]
    return f"#{red:02x}{green:02x}{blue:02x}"


def css_gradient(name: str, stops: int = 13) -> str:
    """CSS gradient from left to right of a map."""
    if name == "phase":
        colors = phase_colors(np.linspace(0.0, 2 * np.pi, stops), np.ones(stops))
    else:
        colors = mapped(np.linspace(0.0, 1.0, stops), name)
    return "linear-gradient(90deg," + ",".join(f"rgb({r} {g} {b})" for r, g, b in colors.tolist()) + ")"


def mapped(share: Array, name: str) -> Bytes:
    """SRGB bytes of values 0..1 through one of matplotlib's maps; gray where they are not numbers."""
    import matplotlib

    table = np.asarray(matplotlib.colormaps[name](np.linspace(0.0, 1.0, 256)))[:, :3]
    table = np.round(table * 255.0).astype(np.uint8)
    known = np.isfinite(share)
    spot = np.clip(np.where(known, share, 0.0) * 255.0 + 0.5, 0, 255).astype(np.int64)
    return np.where(known[..., None], table[spot], NOTHING)
