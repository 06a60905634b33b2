"""Where a block sat in the tree, in numbers and words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.report.placing import OPEN_RAD, OPEN_SHARE, Place, row_of
from pipeline.report.reading import Frame
from pipeline.report.sheet import BlockView

Array = npt.NDArray[Any]


def place_in_block(place: Place, block: BlockView) -> Place:
    """The pose seen from the middle of the block rather than of a face."""
    low, high = block.box
    frame = Frame(float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1]), place.frame.step)
    return Place(place.board_to_tree, frame, place.radii, place.spread, 0.5 * float(low[2] + high[2]))


def cut_of_face(place: Place, corners: Array) -> tuple[float, str]:
    """Angle between the pith and a face, degrees, and the cut in a word."""
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    tilt = float(np.degrees(np.arcsin(np.clip(abs(place.pith @ normal) / np.linalg.norm(normal), 0.0, 1.0))))
    return tilt, "end grain" if tilt > 45.0 else "along the stem"


def block_rows(
    place: Place, block: BlockView, names: Sequence[str], pixel_size: float | None, unit: str
) -> list[dict[str, str]]:
    """Name, value and spread of what places the pith, and how each face is cut."""
    factor, unit = (1.0, "px") if pixel_size is None else (pixel_size, unit)
    turn = float(np.hypot(*place.spread[:2]) / np.sqrt(2.0))
    away = float(np.hypot(*place.spread[2:]) / np.sqrt(2.0))
    pith = place.pith if place.pith[np.argmax(np.abs(place.pith))] > 0 else -place.pith
    rows = [
        row_of("Direction of the pith (x, y, z)", _triple(pith, 3), _spread(np.degrees(turn), "\u00b0")),
        row_of(
            f"Its point nearest to the block's middle (x, y, z), {unit}",
            _triple(place.foot * factor, 1),
            _spread(away * factor, f" {unit}"),
        ),
    ]
    for name, corners in zip(names, block.corners, strict=True):
        tilt, cut = cut_of_face(place, corners)
        rows.append(row_of(f"Angle between pith and {name}", f"{tilt:.1f}\u00b0", cut))
    return rows


def block_words(place: Place, block: BlockView) -> list[str]:
    """What the faces together leave open."""
    low, high = block.box
    size = float((high - low).max())
    limits = (OPEN_RAD, OPEN_RAD, OPEN_SHARE * size, OPEN_SHARE * size)
    names = ("direction of the pith", "direction of the pith", "place of the pith", "place of the pith")
    loose = [name for name, s, most in zip(names, place.spread, limits, strict=True) if np.isfinite(s) and s > most]
    return [f"Hardly determined by these faces: the {name}." for name in dict.fromkeys(loose)]


def _triple(values: Array, digits: int) -> str:
    return ", ".join(f"{value + 0.0:.{digits}f}".replace("-", "\u2212") for value in values)


def _spread(value: float, unit: str) -> str:
    return f"\u00b1 {value:.2g}{unit}" if np.isfinite(value) else "unknown"
