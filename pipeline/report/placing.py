"""Where the board sat in the tree, in numbers and words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.report.reading import Frame, Scan
from stages.variables import BOARD_TO_TREE, POSE_SPREAD, RING_RADIUS

Array = npt.NDArray[Any]

#: Above these a parameter counts as not determined: rad, and share of the face's longer side.
OPEN_RAD, OPEN_SHARE = 0.17, 0.35


@dataclass(frozen=True)
class Place:
    """The pose of a board.

    Parameters
    ----------
    board_to_tree
        Rigid 4x4 transform, px.
    frame
        Extent of the face.
    radii
        Ring boundaries, px.
    spread
        One standard deviation of turn, tilt (rad) and two offsets (px); NaN where unknown.
    depth
        z of the middle, px: 0 on a face, more inside of a block.
    """

    board_to_tree: Array
    frame: Frame
    radii: Array
    spread: Array
    depth: float = 0.0

    @property
    def pith(self) -> Array:
        """Unit vector of the pith, board frame, growing tree z."""
        return np.asarray(self.board_to_tree[2, :3])

    @property
    def centre(self) -> Array:
        """Middle of the face or block, board frame, px."""
        x, y = self.frame.left + 0.5 * self.frame.width, self.frame.top + 0.5 * self.frame.height
        return np.array([x, y, self.depth])

    @property
    def foot(self) -> Array:
        """Point of the pith nearest to the middle of the face, board frame, px."""
        middle = self.tree(self.centre)
        return np.asarray(self.board_to_tree[:3, :3].T @ (np.array([0.0, 0.0, middle[2]]) - self.board_to_tree[:3, 3]))

    @property
    def tilt_rad(self) -> float:
        """Angle between the pith and the face, 0..pi/2."""
        return float(np.arcsin(np.clip(abs(self.pith[2]), 0.0, 1.0)))

    @property
    def is_end_grain(self) -> bool:
        """Whether the face cuts across the stem rather than along it."""
        return self.tilt_rad > np.pi / 4

    def tree(self, points: Array) -> Array:
        """Points (..., 3) of the board frame in the tree frame, px."""
        return np.asarray(points @ self.board_to_tree[:3, :3].T + self.board_to_tree[:3, 3])


def place_of(scan: Scan) -> Place | None:
    """The pose; ``None`` when it was not found."""
    frame = scan.frame
    if frame is None or not scan.has(BOARD_TO_TREE):
        return None
    spread = scan.values(POSE_SPREAD).astype(float) if scan.has(POSE_SPREAD) else np.full(4, np.nan)
    radii = scan.values(RING_RADIUS).astype(float) if scan.has(RING_RADIUS) else np.empty(0)
    spread = spread if spread.shape == (4,) else np.full(4, np.nan)
    return Place(scan.values(BOARD_TO_TREE).astype(float), frame, radii[np.isfinite(radii)], spread)


def cut_of(place: Place) -> str:
    """The cut in words."""
    if place.is_end_grain:
        return "end grain"
    outward = place.centre - place.foot
    length = float(np.linalg.norm(outward))
    if length < 1e-6:
        return "through the pith"
    if abs(outward[0]) < 0.5 * place.frame.width and abs(outward[1]) < 0.5 * place.frame.height:
        # Somewhere on the face the rings touch it.
        return "cathedral" if place.tilt_rad > np.radians(8) else "flat-sawn"
    steep = float(np.degrees(np.arccos(np.clip(abs(outward[2]) / length, 0.0, 1.0))))
    return "flat-sawn" if steep < 35 else "quarter-sawn" if steep > 60 else "rift-sawn"


def pose_rows(place: Place, pixel_size: float | None) -> list[dict[str, str]]:
    """Name, value and spread of each parameter that places the pith."""
    turn, tilt, across, depth = place.spread
    if place.is_end_grain:
        x, y = _pierces(place)
        lean = float(np.hypot(turn, tilt) / np.sqrt(2.0))
        return [
            row_of("Lean of the pith from the normal of the face", *_degrees(np.pi / 2 - place.tilt_rad, lean)),
            row_of("Pith on the face, x", *_length(x, across, pixel_size)),
            row_of("Pith on the face, y", *_length(y, depth, pixel_size)),
        ]
    # An axis has no sense: -89 and 91 degrees are the same turn.
    angle = float((np.arctan2(place.pith[0], -place.pith[1]) + np.pi / 2) % np.pi - np.pi / 2)
    away = place.foot - place.centre
    return [
        row_of("Turn of the pith in the face, from upright, clockwise", *_degrees(angle, turn)),
        row_of("Tilt of the pith out of the face", *_degrees(place.tilt_rad, tilt)),
        row_of("Pith beside the middle of the face", *_length(float(np.hypot(away[0], away[1])), across, pixel_size)),
        row_of("Pith below the face", *_length(float(away[2]), depth, pixel_size)),
    ]


def open_words(place: Place) -> list[str]:
    """What the image does not determine, in words."""
    words = []
    if not place.is_end_grain:
        words.append(
            "A photograph of one face cannot tell a pith behind the face from its mirror image before it; "
            "here it is taken to lie " + ("behind." if place.foot[2] >= 0 else "before, as asked for.")
        )
    size = max(place.frame.width, place.frame.height)
    names = ("lean", "lean", "place of the pith", "place of the pith")
    if not place.is_end_grain:
        names = (
            "turn of the pith in the face",
            "tilt of the pith out of the face",
            "place of the pith beside the face",
            "depth of the pith, which trades off against the width of the rings",
        )
    limits = (OPEN_RAD, OPEN_RAD, OPEN_SHARE * size, OPEN_SHARE * size)
    loose = [name for name, s, limit in zip(names, place.spread, limits, strict=True) if np.isfinite(s) and s > limit]
    words += [f"Hardly determined by this image: the {name}." for name in dict.fromkeys(loose)]
    if not loose and np.isfinite(place.spread).all():
        words.append("All four parameters of the pith line are determined by the rings that were traced.")
    return words


def _pierces(place: Place) -> tuple[float, float]:
    """Where the pith passes through the plane of the face, px."""
    foot, pith = place.foot, place.pith
    point = foot - foot[2] / pith[2] * pith
    return float(point[0]), float(point[1])


def row_of(name: str, value: str, spread: str) -> dict[str, str]:
    """A line of the table."""
    return {"name": name, "value": value, "spread": spread}


def _degrees(angle_rad: float, spread_rad: float) -> tuple[str, str]:
    return _signed(f"{np.degrees(angle_rad):.1f}°"), _spread(f"{np.degrees(spread_rad):.1f}°", spread_rad)


def _length(length_px: float, spread_px: float, pixel_size: float | None) -> tuple[str, str]:
    unit, factor = ("px", 1.0) if pixel_size is None else ("mm", pixel_size)
    return _signed(f"{length_px * factor:.3g} {unit}"), _spread(f"{spread_px * factor:.2g} {unit}", spread_px)


def _signed(text: str) -> str:
    return _plain(text).replace("-", "\u2212")


def _spread(text: str, spread: float) -> str:
    return f"± {_plain(text)}" if np.isfinite(spread) else "unknown"


def _plain(text: str) -> str:
    """A length without an exponent."""
    number, _, unit = text.partition(" ")
    return f"{float(number):.0f} {unit}" if "e" in number else text
