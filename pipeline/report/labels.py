"""Where to write the numbers of the rings so that they can be read: a greedy placement without overlaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

#: A ring's index and what is written behind it: nothing, or a question mark.
Name = tuple[int, str]

_CANDIDATES = 48
# A boundary in several pieces is numbered on so many of them, if they are far from each other.
_ROUNDS = 3


@dataclass(frozen=True)
class Label:
    """A number on the picture.

    Parameters
    ----------
    name
        The ring's index and what is written behind it.
    x, y
        Its middle, in the coordinates of the lines.
    """

    name: Name
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
    lines: Mapping[Name, Sequence[Array]],
    extent: tuple[float, float, float, float],
    unit: float,
    height: float = 14.0,
) -> list[Label]:
    """Place the numbers of rings on their lines, in a row across the rings where they fit.

    Parameters
    ----------
    lines
        A ring's index and suffix to the pieces of its boundary, points (N, 2) each.
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
    pieces = {name: [_inside(points, extent, margin) for points in parts] for name, parts in lines.items()}
    taken = _Taken()
    labels: list[Label] = []
    size = float(np.hypot(extent[2], extent[3]))
    for _ in range(_ROUNDS):
        pieces = {name: [points for points in parts if len(points)] for name, parts in pieces.items()}
        anchors = _walk({name: parts for name, parts in pieces.items() if parts}, extent)
        for name in sorted(anchors, key=_rank):
            which, anchor = anchors[name]
            points = pieces[name].pop(which)
            text = f"{name[0]}{name[1]}"
            half = 0.5 * unit * np.array([0.56 * height * len(text) + 5.0, height])
            distance = np.hypot(*(points - anchor).T)
            possible = taken.free(points, half) & (distance <= 0.3 * size)
            for label in labels:
                if label.name == name:
                    possible &= np.hypot(points[:, 0] - label.x, points[:, 1] - label.y) > 0.2 * size
            if possible.any():
                x, y = points[np.argmin(np.where(possible, distance, np.inf))]
                taken.boxes.append((float(x), float(y), float(half[0]), float(half[1])))
                labels.append(Label(name, float(x), float(y)))
    return sorted(labels, key=lambda label: label.name)


def _rank(name: Name) -> tuple[int, Name]:
    return (0 if name[0] % 10 == 0 else 1 if name[0] % 5 == 0 else 2, name)


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
    pieces: Mapping[Name, Sequence[Array]], extent: tuple[float, float, float, float]
) -> dict[Name, tuple[int, Array]]:
    """Which piece gets each number and where it would stand best: a walk from the middle ring by shortest steps."""
    order = sorted(pieces)
    if not order:
        return {}
    centre = np.array([extent[0] + 0.5 * extent[2], extent[1] + 0.5 * extent[3]])
    start = len(order) // 2
    anchors: dict[Name, tuple[int, Array]] = {}
    for walk in (order[start:], order[start::-1]):
        place = centre
        for name in walk:
            if name in anchors:
                place = anchors[name][1]
                continue
            nearest = [points[np.argmin(np.hypot(*(points - place).T))] for points in pieces[name]]
            which = int(np.argmin([np.hypot(*(point - place)) for point in nearest]))
            place = nearest[which]
            anchors[name] = which, place
    return anchors
