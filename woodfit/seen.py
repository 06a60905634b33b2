"""How far a point is from what the photographs show: what a texture knows, and what it continues."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

#: Confidence halves over this many mean ring widths away from the photographed faces, and over each ring beyond those
#: seen. A convention, not a calibrated probability; docs/solid_texture.md says how often unseen planes were right.
HALVING_WIDTHS = 5.0


@dataclass(frozen=True)
class Seen:
    """The photographed rectangles and the rings that they show.

    Attributes
    ----------
    plane : float64 array of shape (F, 3, 3)
        For each face the point of a corner, and what one px to the right and one px down add; board frame, px.
    size : float64 array of shape (F, 2)
        Extent to the right and down, px.
    ages : float64 array of shape (2,)
        Least and greatest ring age on the faces.
    """

    plane: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    size: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    ages: npt.NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, np.inf]))

    def distance(self, points: Array) -> npt.NDArray[np.float64]:
        """Distance (px) of points (K, 3) of the board frame, in px, from the nearest face; infinite without faces."""
        least = np.full(len(points), np.inf)
        for (corner, right, down), (width, height) in zip(self.plane, self.size, strict=True):
            offset = points - corner
            # right and down stand at right angles and are as long as a px of that face is in the board frame.
            u = np.clip(offset @ right / (right @ right), 0.0, width)
            v = np.clip(offset @ down / (down @ down), 0.0, height)
            nearest = u[:, None] * right + v[:, None] * down
            least = np.minimum(least, np.linalg.norm(offset - nearest, axis=1))
        return least

    def confidence(self, points: Array, age: Array, ring_width: float) -> npt.NDArray[np.float32]:
        """Between 1 where the wood was seen and 0 far from it, at points (K, 3) in px with ring ages (K,)."""
        beyond = np.maximum(self.ages[0] - age, 0.0) + np.maximum(age - self.ages[1], 0.0)
        exponent = self.distance(points) / (HALVING_WIDTHS * ring_width) + beyond
        return np.asarray(np.exp2(-exponent), np.float32)


def seen_on(
    plane: Array, top: Array, valid: npt.NDArray[np.bool_], x: Array, y: Array, face: Array, age: Array
) -> Seen:
    """Rectangles around the wood of each face of an atlas, and the ages on it.

    Parameters
    ----------
    plane, top
        As of `woodfit.planes.Planes`.
    valid : bool array of shape (M, N)
        Where there is wood.
    x, y : arrays of shape (N,) and (M,)
        Pixel centres, atlas px.
    face : int array of shape (M,)
        Face of each row.
    age : array of shape (M, N)
        Ring age.
    """
    planes, sizes = [], []
    for number, (corner, right, down) in enumerate(plane):
        rows = np.flatnonzero(valid.any(axis=1) & (face == number))
        if not rows.size:
            continue
        columns = np.flatnonzero(valid[rows].any(axis=0))
        left, upper = float(x[columns[0]]), float(y[rows[0]] - top[number])
        planes.append(np.stack([corner + left * right + upper * down, right, down]))
        sizes.append((float(x[columns[-1]]) - left, float(y[rows[-1]] - y[rows[0]])))
    ages = age[valid]
    span = (float(ages.min()), float(ages.max())) if ages.size else (0.0, np.inf)
    return Seen(np.array(planes).reshape(-1, 3, 3), np.array(sizes).reshape(-1, 2), np.array(span))
