"""How many rings the phase counts from place to place on a face: the phase without its jumps of a whole ring.

The cyclic loss of `woodfit.displacement.polish` sees the phase modulo one ring. Where the start is a ring off (a line
was traced that is no boundary, a boundary was not traced, or nothing was traced and the ideal radii stand for the
rings) it stays off, and a wall is left between two counts. The unwrapped phase leaves no such choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label

from woodfit.unwrapping import unwrap

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class RingCount:
    """Rings counted by the phase on a face.

    Attributes
    ----------
    age : array of shape (H, W)
        The phase in rings without its jumps, up to one whole number in each part.
    part : int array of shape (H, W)
        Pixels that hang together, from 1; 0 where nothing is counted.
    """

    age: npt.NDArray[np.float64]
    part: npt.NDArray[np.int32]

    def numbered(self, age: Array, weight: Array) -> npt.NDArray[np.float64]:
        """Count with the whole number in each part that most of the `weight` has by ring ages `age`, both (H, W).

        NaN where nothing is counted.
        """
        counted = self.part > 0
        part, weight = self.part[counted], weight[counted]
        off = np.round(age[counted] - self.age[counted]).astype(np.int64)
        if not off.size:
            return np.full(self.age.shape, np.nan)
        first = int(off.min())
        span = int(off.max()) - first + 1
        votes = np.bincount(part * span + off - first, weight, minlength=(int(part.max()) + 1) * span)
        most = first + votes.reshape(-1, span).argmax(axis=1)
        return np.where(counted, self.age + most[self.part], np.nan)


def count_rings(phase: Array, belief: Array, least_belief: float, face: Array | None = None) -> RingCount:
    """Unwrap the phase; where it contradicts itself it is torn through wood that is believed little.

    Parameters
    ----------
    phase : array of shape (H, W)
        Ring phase, rad.
    belief : array of shape (H, W)
        Confidence of it, 0..1.
    least_belief : float
        Pixels that are believed less are not counted across.
    face : int array of shape (H,), optional
        Face of each row, growing; faces are counted apart.

    Returns
    -------
    RingCount
    """
    seen = belief > least_belief
    first = np.zeros(1, int) if face is None else np.flatnonzero(np.diff(face, prepend=-1))
    ages, parts, count = [], [], 0
    for rows in (slice(*ends) for ends in pairwise([*first, len(phase)])):
        ages.append(unwrap(phase[rows], np.where(seen[rows], belief[rows], 0.0)))
        part, more = label(seen[rows])
        parts.append(np.where(part > 0, part + count, 0).astype(np.int32))
        count += more
    return RingCount(np.concatenate(ages), np.concatenate(parts))


def outward_signs(phase: Array, age: Array, weight: Array, face: Array) -> npt.NDArray[np.float32]:
    """Per row 1 where the phase of its face grows with the ring age, -1 where it runs backwards.

    Faces of a block are numbered outwards or inwards as they are traced, and where one shows a single boundary its
    number does not tell; the phase between the boundaries does. A face alone sets the direction itself.

    Parameters
    ----------
    phase, age, weight : arrays of shape (H, W)
        Ring phase (rad), about the ring age, and how much each pixel counts.
    face : int array of shape (H,)
        Face of each row.
    """
    signs = np.ones(len(face), np.float32)
    faces = np.unique(face)
    for one in faces if len(faces) > 1 else ():
        rows = face == one
        turns = 2.0 * np.pi * age[rows]
        along, against = (abs((weight[rows] * np.exp(1j * (s * phase[rows] - turns))).sum()) for s in (1, -1))
        signs[rows] = 1.0 if along >= against else -1.0
    return signs
