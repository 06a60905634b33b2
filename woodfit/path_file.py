"""Measurement paths from a file: CooRecorder .pos, or JSON ``{"paths": [{"points": [[x, y], ...]}]}``."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.dendro import coorecorder
from woodfit.dendro.series import FormatError

FloatArray = npt.NDArray[np.float64]

_EXPECTED = 'expected {"paths": [{"points": [[x, y], ...]}]} in scan px, or a CooRecorder .pos file'

_FARTHEST_PX = 1e7


def read_paths(text: str, source: str) -> list[FloatArray]:
    """Paths (P, 2) in scan px that a file holds.

    Parameters
    ----------
    text : str
        Content.
    source : str
        Name for messages.

    Raises
    ------
    FormatError
        With what was found and what was expected.
    """
    if text.lstrip().startswith("#DENDRO"):
        measured = coorecorder.loads(text, source)
        if measured.dpi is None:
            raise FormatError(f"{source}: no #DPI line, expected one: without it mm cannot be turned into scan px")
        marked = [point.xy_mm for point in measured.points if point.kind == "border"]
        return [checked_path(coorecorder.px_from_mm(np.array(marked), measured.dpi), source)]
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{source}: neither .pos nor JSON ({error}), {_EXPECTED}") from None
    paths = content.get("paths") if isinstance(content, dict) else None
    if not isinstance(paths, list) or not paths:
        raise FormatError(f"{source}: no list of `paths`, {_EXPECTED}")
    return [_points(path, f"{source}, path {number}") for number, path in enumerate(paths, 1)]


def _points(path: Any, source: str) -> FloatArray:
    """Points of one entry."""
    points = path.get("points") if isinstance(path, dict) else None
    if not isinstance(points, list) or not all(_is_point(point) for point in points):
        raise FormatError(f"{source}: its `points` are not a list of [x, y], {_EXPECTED}")
    return checked_path(np.array(points, np.float64).reshape(-1, 2), source)


def _is_point(point: Any) -> bool:
    return isinstance(point, list) and len(point) == 2 and all(type(value) in (int, float) for value in point)


def checked_path(points: FloatArray, source: str) -> FloatArray:
    """A path without repeated points; `FormatError` when it goes nowhere or is not finite."""
    if not np.isfinite(points).all() or np.abs(points).max(initial=0.0) > _FARTHEST_PX:
        raise FormatError(f"{source}: a coordinate is not a finite number of px")
    kept = np.concatenate([points[:1], points[1:][(np.diff(points, axis=0) != 0.0).any(axis=1)]])
    if len(kept) < 2 or not math.isfinite(float(np.abs(np.diff(kept, axis=0)).sum())):
        raise FormatError(f"{source}: {len(kept)} different points, expected at least two")
    return kept


def check_on_scan(paths: Sequence[FloatArray], width_px: float, height_px: float) -> None:
    """Raise `FormatError` for a path that leads past the scan: it was drawn on another one."""
    for number, path in enumerate(paths, 1):
        low, high = path.min(axis=0), path.max(axis=0)
        if (low > [width_px, height_px]).any() or (high < 0.0).any():
            raise FormatError(
                f"path {number} runs from x {low[0]:.0f} to {high[0]:.0f} and y {low[1]:.0f} to {high[1]:.0f}, "
                f"expected places on the scan of {width_px:.0f} x {height_px:.0f} px; was it drawn on another one?"
            )
