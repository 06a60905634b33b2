"""How well two series of ring widths agree year by year: t of Baillie and Pilcher, of Hollstein, and Gleichläufigkeit.

Both series hold one width per year and have the same years. Years in which a series has no width (NaN) or an absent
ring (0) are left out of both before anything else is computed, as the field's programs do.

References
----------
.. [1] Baillie & Pilcher, "A simple crossdating program for tree-ring research", Tree-Ring Bulletin 33, 1973.
.. [2] Hollstein, "Mitteleuropäische Eichenchronologie", 1980.
.. [3] Huber, "Über die Sicherheit jahrringchronologischer Datierung", Holz als Roh- und Werkstoff 6, 1943.
.. [4] Buras & Wilmking, "Correcting the calculation of Gleichläufigkeit", Dendrochronologia 34, 2015.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: Fewest common years for which a correlation is given.
FEWEST_YEARS = 8


@dataclass(frozen=True)
class Agreement:
    """Correlation of two filtered series.

    Parameters
    ----------
    r : float
        Pearson's correlation; NaN when too few years are common or a series does not vary.
    t : float
        ``r sqrt(n - 2) / sqrt(1 - r²)``; infinite for equal series.
    n : int
        Years compared.
    """

    r: float
    t: float
    n: int


def baillie_pilcher(width_mm: FloatArray, other_mm: FloatArray) -> Agreement:
    """Agreement of ``ln(100 w / mean of the five rings around)`` [1]_.

    Parameters
    ----------
    width_mm, other_mm : float64 arrays of shape (n,)
        Widths of the same years, in mm or any other unit.

    Returns
    -------
    Agreement
        Over the common years but two at either end.

    Raises
    ------
    ValueError
        When the shapes differ.
    """
    return _agreement(*(_over_five(widths) for widths in _common(width_mm, other_mm)))


def hollstein(width_mm: FloatArray, other_mm: FloatArray) -> Agreement:
    """Agreement of ``100 ln(w_t / w_(t-1))`` [2]_; parameters and errors as `baillie_pilcher`."""
    return _agreement(*(100.0 * np.diff(np.log(widths)) for widths in _common(width_mm, other_mm)))


def gleichlaeufigkeit(width_mm: FloatArray, other_mm: FloatArray) -> float:
    """Share of year-to-year changes of the same sign [3]_; a change in one series only counts half [4]_.

    Parameters and errors as `baillie_pilcher`; NaN with fewer than two common years.
    """
    one, other = (np.sign(np.diff(widths)) for widths in _common(width_mm, other_mm))
    return float(np.mean(1.0 - 0.5 * np.abs(one - other))) if len(one) else float("nan")


def _common(width_mm: FloatArray, other_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    one, other = np.asarray(width_mm, np.float64), np.asarray(other_mm, np.float64)
    if one.shape != other.shape or one.ndim != 1:
        raise ValueError(f"series of the same years expected, found shapes {one.shape} and {other.shape}")
    # Comparisons with NaN are False: missing values go the way of absent rings.
    both = (one > 0) & (other > 0)
    return one[both], other[both]


def _over_five(width: FloatArray) -> FloatArray:
    if len(width) < 5:
        return np.empty(0)
    return np.log(100.0 * width[2:-2] / np.convolve(width, np.full(5, 0.2), "valid"))


def _agreement(one: FloatArray, other: FloatArray) -> Agreement:
    n = len(one)
    if n < FEWEST_YEARS or np.ptp(one) < 1e-12 or np.ptp(other) < 1e-12:
        return Agreement(float("nan"), float("nan"), n)
    r = float(np.clip(np.corrcoef(one, other)[0, 1], -1.0, 1.0))
    left = 1.0 - r * r
    return Agreement(r, float(np.copysign(np.inf, r) if left < 1e-12 else r * np.sqrt((n - 2) / left)), n)
