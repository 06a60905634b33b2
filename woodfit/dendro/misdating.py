"""Where a series of ring widths has lost a ring or gained a false one, seen against a partner or a master.

An event within `EDGE` rings of either end shifts too few rings to be seen; none is looked for there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d

from woodfit.dendro.ring_lags import LARGEST_LAG, event_probabilities

FloatArray = npt.NDArray[np.float64]
Kind = Literal["missing", "false"]

#: Rings at either end of the overlap in which no event is looked for.
EDGE = 5
#: Fewest rings common to series and partner.
FEWEST_RINGS = 20

# Events of one kind closer than this are told as one.
_APART = 10


@dataclass(frozen=True)
class Misdating:
    """A ring that is likely missing or false.

    Parameters
    ----------
    kind : "missing" or "false"
        What the series suffers from: a ring too few, or one too many.
    ring : int
        The ring counted from the outer end, 0 the outermost, by the count of the *series* corrected for the events
        further out. Missing: the ring of this count is absent or merged with the next inner one. False: the ring of
        this count was cut in two.
    spread : tuple of int
        First and last ring, outer and inner, that hold nine tenths of the probability.
    probability : float
        That such an event lies here, 0..1.
    merged : bool
        Missing only: whether the widths rather say two rings measured as one than a ring that is not there.
    """

    kind: Kind
    ring: int
    spread: tuple[int, int]
    probability: float
    merged: bool = False


def find_misdating(
    width_mm: FloatArray, partner: FloatArray, surest: float = 0.5, per_ring: float = 1.0 / 300.0
) -> list[Misdating]:
    """Find the rings that are missing from a series or false in it.

    Parameters
    ----------
    width_mm : float64 array of shape (n,)
        Widths from the oldest ring to the youngest; 0 for an absent ring, NaN where not measured.
    partner : float64 array of shape (m,)
        Widths, or a master of positive indices; its last ring grew in the year of the series' last ring. NaN where
        there are none.
    surest : float
        Least probability of what is reported.
    per_ring : float
        Events expected per ring before looking.

    Returns
    -------
    list of Misdating
        From the outside inwards. Empty when nothing is likely, or the two have fewer than `FEWEST_RINGS` in common.

    Raises
    ------
    ValueError
        For arrays of more than one dimension, infinite or negative widths.
    """
    x, y = _inwards(width_mm, "the series"), _inwards(partner, "the partner")
    common = min(len(x), len(y))
    known = np.flatnonzero(np.isfinite(x[:common]) & np.isfinite(y[:common]))
    if len(known) < FEWEST_RINGS:
        return []
    chances = event_probabilities(x, y, (int(known[0]) + EDGE, int(known[-1]) + 1 - EDGE), per_ring)
    return _peaks(chances, surest)


def _peaks(chances: FloatArray, surest: float) -> list[Misdating]:
    """Where the probability gathers, by the ring's corrected count."""
    _, n, size = chances.shape
    counted = np.zeros((3, n + size))
    for column in range(size):
        counted[:, column : column + n] += chances[..., column]
    # Counts run from -LARGEST_LAG on; what lies at a count is never negative where an event is allowed.
    counted = counted[:, LARGEST_LAG:]
    found = []
    masses: tuple[tuple[Kind, FloatArray], ...] = (("missing", counted[0] + counted[1]), ("false", counted[2].copy()))
    for kind, mass in masses:
        while True:
            # A little more weight in the middle: a single sharp ring is named itself.
            middle = int(np.argmax(convolve1d(mass, [1.0, 1.05, 1.1, 1.05, 1.0], mode="constant")))
            low, high = max(middle - _APART, 0), middle + _APART + 1
            probability = float(mass[low:high].sum())
            if probability < surest:
                break
            share = np.cumsum(mass[low:high]) / probability
            spread = low + int(np.searchsorted(share, 0.05)), low + int(np.searchsorted(share, 0.95))
            merged = kind == "missing" and bool(counted[0, low:high].sum() > counted[1, low:high].sum())
            found.append(Misdating(kind, middle, spread, min(probability, 1.0), merged))
            mass[low:high] = 0.0
    return sorted(found, key=lambda event: event.ring)


def _inwards(width: FloatArray, what: str) -> FloatArray:
    array = np.asarray(width, np.float64)
    if array.ndim != 1:
        raise ValueError(f"{what} has shape {array.shape}, expected one width per ring, (n,)")
    if np.isinf(array).any() or (array < 0).any():
        raise ValueError(f"{what} has infinite or negative widths; absent rings are 0, unknown ones NaN")
    return array[::-1]
