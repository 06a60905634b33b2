"""The direction of the fibres on a face, from its fine texture.

Vessels, tracheids and streaks run along the stem whatever the rings do: on a face along the stem they show the pith's
direction as the face sees it, and on a block's faces together they show it whole. On end grain they are seen end on,
and the fine texture has no direction of its own but that of rays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.planes import Planes

#: Ring boundaries are broad edges of another direction than the fibres: pixels this near to one do not count.
_BESIDE_BOUNDARY_PX = 2
#: Pixels at the edge of the wood left out, and the blur that takes the rings' own shading away.
_MARGIN_PX, _SHADING_PX = 6, 4.0

#: Scatter (rad) of the direction of perfectly coherent fibres about the stem's; it grows as coherence falls. Below the
#: least coherence a face says nothing. What a face with another direction costs at most grows with the log only:
#: rays, saw marks and narrow rings have directions of their own.
_SCATTER_RAD, _LEAST_COHERENCE = 0.03, 0.12


@dataclass(frozen=True)
class FiberSight:
    """What the fine texture of faces tells of the stem's direction.

    Attributes
    ----------
    aside : array of shape (F, 3)
        Unit vector in each face at right angles to its fibres, board frame.
    coherence : array of shape (F,)
        How clearly each face shows a direction, 0..1.
    """

    aside: npt.NDArray[np.float64]
    coherence: npt.NDArray[np.float64]

    @classmethod
    def nothing(cls) -> FiberSight:
        """Faces that tell nothing."""
        return cls(np.zeros((0, 3)), np.zeros(0))

    def cost(self, direction: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Negative log-likelihood (L,) of stem directions (L, 3), up to a constant.

        A stem at right angles to a face shows no fibres on it, and is not judged by it.
        """
        off = (direction @ self.aside.T) * self.coherence / _SCATTER_RAD
        return np.asarray(np.log1p(off**2).sum(axis=1))


def fibers_of_faces(
    rgb: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    boundaries: list[npt.NDArray[Any]],
    planes: Planes,
    x: npt.NDArray[Any],
    y: npt.NDArray[Any],
) -> FiberSight:
    """Direction of the fibres on each face.

    Parameters
    ----------
    rgb : array of shape (M, N, 3)
        Linear colors of the atlas.
    valid : bool array of shape (M, N)
        The wood.
    boundaries : list of arrays of shape (K, 2)
        Ring boundaries, atlas px.
    planes : Planes
        Where the faces lie.
    x, y : arrays of shape (N,) and (M,)
        Pixel centres, atlas px.
    """
    step = float(x[1] - x[0]) if len(x) > 1 else 1.0
    grey = np.sqrt(np.max(rgb, axis=-1))
    lines = [(line - [x[0], y[0]]) / step for line in boundaries]
    face = planes.face_of(y)
    aside, coherence = [], []
    for number in np.unique(face):
        rows = np.flatnonzero(face == number)
        shifted = [line - [0.0, rows[0]] for line in lines]
        angle, clear = fiber_orientation(grey[rows], valid[rows], shifted)
        if clear < _LEAST_COHERENCE:
            continue
        right, down = (vector / np.linalg.norm(vector) for vector in planes.plane[number, 1:])
        aside.append(np.cos(angle) * down - np.sin(angle) * right)
        coherence.append(clear)
    return FiberSight(np.array(aside).reshape(-1, 3), np.array(coherence))


def fiber_orientation(
    grey: npt.NDArray[Any], valid: npt.NDArray[np.bool_], boundaries: list[npt.NDArray[Any]]
) -> tuple[float, float]:
    """Direction of the fine texture of a face, and how clearly it has one.

    The structure tensor of the finest details, each pixel saturating so that a crack counts no more than a streak.

    Parameters
    ----------
    grey : array of shape (M, N)
        Grey value, 0..1.
    valid : bool array of shape (M, N)
        The wood.
    boundaries : list of arrays of shape (K, 2)
        Ring boundaries, x and y in array px.

    Returns
    -------
    angle : float
        Direction of the fibres in the image, rad, 0..pi, from +x towards +y.
    coherence : float
        0 (no direction) to 1; about 0.05 on end grain, 0.25 and more along the stem.
    """
    fine = np.log(np.maximum(np.asarray(grey, np.float32), 0.02))
    fine = fine - cv2.GaussianBlur(fine, (0, 0), _SHADING_PX)
    fine = cv2.GaussianBlur(fine, (0, 0), 0.7)
    down, right = (cv2.Scharr(fine, cv2.CV_32F, *order).astype(np.float64) for order in ((0, 1), (1, 0)))
    margin = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)
    counts = cv2.erode(valid.astype(np.uint8), margin, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    for line in boundaries:
        cv2.polylines(counts, [np.rint(line).astype(np.int32)], False, 0, 2 * _BESIDE_BOUNDARY_PX + 1)
    inside = counts > 0
    if inside.sum() < 400:
        return 0.0, 0.0
    x, y = right[inside], down[inside]
    power = x * x + y * y
    weight = 1.0 / (power + 3.0 * np.median(power) + 1e-12)
    xx, xy, yy = (float((weight * a * b).sum()) for a, b in ((x, x), (x, y), (y, y)))
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi
    return float(angle % np.pi), float(np.hypot(xx - yy, 2.0 * xy) / max(xx + yy, 1e-12))
