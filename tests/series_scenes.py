"""Ideal boundaries for the tests of measuring: straight ones across a strip, circles about a pith."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from woodfit.measured import Face
from woodfit.measuring import Boundaries
from woodfit.measuring_path import Grid

Array = NDArray[np.float64]

WIDTHS = np.array([31.0, 22.5, 40.0, 18.2, 27.7, 35.1, 12.4, 25.0, 30.3, 21.9])


def boundaries(lines: list[Array], index: list[int] | None = None, **other: object) -> Boundaries:
    """Boundaries numbered from 1, surely known, in one group, open."""
    count = len(lines)
    return Boundaries(
        lines,
        np.array(index or range(1, count + 1), np.int64),
        np.asarray(other.get("group", np.zeros(count)), np.int64),
        np.asarray(other.get("closed", np.zeros(count)), np.bool_),
        np.asarray(other.get("confidence", np.ones(count)), np.float64),
    )


def slanted(widths: Array, slant_deg: float, height: int = 120, first: float = 60.0) -> list[Array]:
    """Straight boundaries whose outward normal is turned by `slant_deg` from +x; through y = 0 at the first."""
    slant = np.radians(slant_deg)
    y = np.arange(-height, 2.0 * height)
    offsets = first + np.concatenate([[0.0], np.cumsum(widths)])
    return [np.column_stack([(d - y * np.sin(slant)) / np.cos(slant), y]) for d in offsets]


def circles(pith: tuple[float, float], radii: Array, start: float = 0.0, end: float = 2 * np.pi) -> list[Array]:
    """Arcs about a pith, a vertex per px."""
    lines = []
    for radius in radii:
        turn = np.linspace(start, end, int(radius * (end - start)) + 8, endpoint=False)
        lines.append(np.column_stack([pith[0] + radius * np.cos(turn), pith[1] + radius * np.sin(turn)]))
    return lines


def outward(lines: list[Array], pith: tuple[float, float]) -> Array:
    """Outward direction at every vertex."""
    points = np.concatenate(lines)
    return np.asarray(np.arctan2(points[:, 1] - pith[1], points[:, 0] - pith[0]))


def face(
    lines: Boundaries,
    dark: NDArray[np.float32],
    growth: Array,
    width_px: float,
    step: float = 1.0,
    valid: NDArray[np.bool_] | None = None,
    late_is_dark: bool = True,
    along_stem: bool = False,
    pith: tuple[float, float] = (np.nan, np.nan),
) -> Face:
    """A face of the shape of `dark`."""
    grid = Grid((0.5 * (step - 1.0), 0.5 * (step - 1.0)), step, (dark.shape[0], dark.shape[1]))
    frequency = np.full(dark.shape, 1.0 / width_px)
    wood = np.ones(dark.shape, np.bool_) if valid is None else valid
    return Face(lines, growth, frequency, wood, dark, grid, late_is_dark, along_stem, np.array(pith))
