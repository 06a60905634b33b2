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
    """Rings counted by the phase on one or more faces, which lie below one another.

    Attributes
    ----------
    age : array of shape (H, W)
        The phase in rings without its jumps, up to a whole number.
    tops : int array of shape (F + 1,)
        First row of each face, and the end of the last one.
    """

    age: npt.NDArray[np.float64]
    tops: npt.NDArray[np.int64]

    def numbered(self, counted: Array, age: Array, weight: Array) -> npt.NDArray[np.float64]:
        """Count with whole numbers by ring ages `age`, all of shape (H, W); NaN off the pixels that are `counted`.

        Those that hang together have one number, the one that most of the `weight` has.
        """
        part, count = np.zeros(self.age.shape, np.int64), 0
        for rows in (slice(*ends) for ends in pairwise(self.tops)):
            own, more = label(counted[rows])
            part[rows] = np.where(own > 0, own + count, 0)
            count += more
        if not count:
            return np.full(self.age.shape, np.nan)
        off = np.round(age[counted] - self.age[counted]).astype(np.int64)
        first = int(off.min())
        span = int(off.max()) - first + 1
        votes = np.bincount(part[counted] * span + off - first, weight[counted], minlength=(count + 1) * span)
        most = first + votes.reshape(-1, span).argmax(axis=1)
        return np.where(counted, self.age + most[part], np.nan)


def count_rings(phase: Array, belief: Array, least_belief: float, face: Array) -> RingCount:
    """Unwrap the phase; where it contradicts itself it is torn through wood that is believed little.

    Parameters
    ----------
    phase : array of shape (H, W)
        Ring phase, rad.
    belief : array of shape (H, W)
        Confidence of it, 0..1.
    least_belief : float
        Where it is believed less, a tear costs nothing.
    face : int array of shape (H,)
        Face of each row, growing; faces are counted apart.

    Returns
    -------
    RingCount
    """
    cost = np.where(belief > least_belief, belief, 0.0)
    tops = np.append(np.flatnonzero(np.diff(face, prepend=face[0] - 1)), len(face))
    ages = [unwrap(phase[rows], cost[rows]) for rows in (slice(*ends) for ends in pairwise(tops))]
    return RingCount(np.concatenate(ages), tops)


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
