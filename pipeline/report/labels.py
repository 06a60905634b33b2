"""Where to write the numbers of the rings so that they can be read: a greedy placement without overlaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

_CANDIDATES = 48
# A boundary in several pieces is numbered on so many of them, if they are far from each other.
_ROUNDS = 3


@dataclass(frozen=True)
class Label:
    """A number on the picture.

    Parameters
    ----------
    index
        The ring's index.
    x, y
        Its middle, in the coordinates of the lines.
    """

    index: int
    x: float
    y: float


@dataclass
class _Taken:
    """Boxes that are already written on."""

    boxes: list[tuple[float, float, float, float]] = field(default_factory=list)

    def free(self, points: Array, half: Array) -> npt.NDArray[np.bool_]:
        """Which of `points` (N, 2) can carry a box of half size `half` (2,)."""
        if not self.boxes:
            return np.ones(len(points), dtype=bool)
        boxes = np.array(self.boxes)
        apart = np.abs(points[:, None, :] - boxes[None, :, :2]) >= half + boxes[None, :, 2:]
        return np.asarray(apart.any(axis=2).all(axis=1))


def place_labels(
    lines: Mapping[int, Sequence[Array]],
    extent: tuple[float, float, float, float],
    unit: float,
    height: float = 14.0,
) -> list[Label]:
    """Place the numbers of rings on their lines, in a row across the rings where they fit.

    Parameters
    ----------
    lines
        Ring index to the pieces of its boundary, points (N, 2) each.
    extent
        Left, top, width and height of the picture, in the unit of the points.
    unit
        Length of one screen px in the unit of the points.
    height
        Height of a number in screen px; a digit is half as wide.

    Returns
    -------
    list of Label
        Every tenth ring has the first choice, then every fifth, then the others; who finds no place has none.
    """
    margin = height * unit
    pieces = {index: [_inside(points, extent, margin) for points in parts] for index, parts in lines.items()}
    taken = _Taken()
    labels: list[Label] = []
    size = float(np.hypot(extent[2], extent[3]))
    for _ in range(_ROUNDS):
        pieces = {index: [points for points in parts if len(points)] for index, parts in pieces.items()}
        anchors = _walk({index: parts for index, parts in pieces.items() if parts}, extent)
        for index in sorted(anchors, key=_rank):
            which, anchor = anchors[index]
            points = pieces[index].pop(which)
            half = 0.5 * unit * np.array([0.56 * height * len(str(index)) + 5.0, height])
            distance = np.hypot(*(points - anchor).T)
            possible = taken.free(points, half) & (distance <= 0.3 * size)
            for label in labels:
                if label.index == index:
                    possible &= np.hypot(points[:, 0] - label.x, points[:, 1] - label.y) > 0.2 * size
            if possible.any():
                x, y = points[np.argmin(np.where(possible, distance, np.inf))]
                taken.boxes.append((float(x), float(y), float(half[0]), float(half[1])))
                labels.append(Label(index, float(x), float(y)))
    return sorted(labels, key=lambda label: label.index)


def _rank(index: int) -> tuple[int, int]:
    return (0 if index % 10 == 0 else 1 if index % 5 == 0 else 2, index)


def _inside(points: Array, extent: tuple[float, float, float, float], margin: float) -> Array:
    """Evenly spaced points of a line that keep away from the picture's edges."""
    left, top, width, height = extent
    margin = min(margin, 0.2 * min(width, height))
    low, high = np.array([left, top]) + margin, np.array([left + width, top + height]) - margin
    kept = np.asarray(points[((points >= low) & (points <= high)).all(axis=1)])
    if len(kept) <= _CANDIDATES:
        return kept
    return np.asarray(kept[np.linspace(0, len(kept) - 1, _CANDIDATES).astype(int)])


def _walk(
    pieces: Mapping[int, Sequence[Array]], extent: tuple[float, float, float, float]
) -> dict[int, tuple[int, Array]]:
    """Which piece gets each number and where it would stand best: a walk from the middle ring by shortest steps."""
    order = sorted(pieces)
    if not order:
        return {}
    centre = np.array([extent[0] + 0.5 * extent[2], extent[1] + 0.5 * extent[3]])
    start = len(order) // 2
    anchors: dict[int, tuple[int, Array]] = {}
    for walk in (order[start:], order[start::-1]):
        place = centre
        for index in walk:
            if index in anchors:
                place = anchors[index][1]
                continue
            nearest = [points[np.argmin(np.hypot(*(points - place).T))] for points in pieces[index]]
            which = int(np.argmin([np.hypot(*(point - place)) for point in nearest]))
            place = nearest[which]
            anchors[index] = which, place
    return anchors
