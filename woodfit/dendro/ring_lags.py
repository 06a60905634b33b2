"""Probability of lost and false rings, by a hidden Markov model of the lag between a series and its partner.

The series and its partner are laid side by side at their outer ends. Going inwards, ring ``j`` of the series belongs
to ring ``j + lag`` of the partner; a lost ring raises the lag by one from there on, a false ring lowers it. Three
events are told apart: two rings *merged* into one (a boundary was missed), a ring that is *absent*, and a *false*
boundary within a ring. Lags and events are the states and transitions of a hidden Markov model [1]_ over
high-pass filtered log widths, whose pairs are bivariate normal with a share of outliers. At an event the filter runs
over the corrected widths: the partner's two rings added up, its ring left out, or the series' two rings added up.
The forward and backward sums give the probability of each event at each ring, over all numbers of events and all
strengths of the common signal, none included.

References
----------
.. [1] Durbin et al., "Biological sequence analysis", chapter 4: pair hidden Markov models, 1998.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d
from scipy.special import logsumexp

FloatArray = npt.NDArray[np.float64]

#: Largest sum of events that is followed, in rings.
LARGEST_LAG = 3

# Standard deviation of the high-pass filter in rings, and the reach of its kernel.
_SIGMA, _REACH = 3.0, 12
# Share of the local mean added to each width before the logarithm, so that narrow and absent rings do not rule.
_SOFTENED = 0.4
_CLIP = 3.0
_OUTLIERS = 0.07
# Correlations of the common signal; the first one is for strangers, to whom no event can be proved.
_STRENGTHS = np.array([0.0, 0.3, 0.45, 0.6, 0.7, 0.8, 0.87, 0.93])
# Rings on both sides of an event whose filtered values differ from the unedited ones.
_NEAR = 12


def mean_index(width_mm: FloatArray) -> FloatArray:
    """Mean of several series, each over its own local mean; can serve as a partner.

    Parameters
    ----------
    width_mm : float64 array of shape (series, years)
        Widths in the same years, NaN where a series has none.

    Returns
    -------
    float64 array of shape (years,)
        Near 1; NaN in years without any width.
    """
    width = np.asarray(width_mm, np.float64)
    level = _smooth(width)
    ratio = np.divide(width, level, out=np.full_like(width, np.nan), where=level > 0)
    many = np.isfinite(ratio).sum(axis=0)
    total = np.nansum(ratio, axis=0)
    return np.asarray(np.divide(total, many, out=np.full_like(total, np.nan), where=many > 0))


def event_probabilities(x: FloatArray, y: FloatArray, span: tuple[int, int], per_ring: float) -> FloatArray:
    """Probability of each event at each ring and lag.

    Parameters
    ----------
    x, y : float64 arrays of shape (n,) and (m,)
        Widths of the series and its partner, from the outermost ring inwards; 0 and NaN as in `find_misdating`.
    span : tuple of int
        First ring in which an event may lie, and the one after the last.
    per_ring : float
        Events expected per ring.

    Returns
    -------
    float64 array of shape (3, n, 2 LARGEST_LAG + 1)
        Of merged, absent and false rings; by ring of the series and by the lag further out.
    """
    keep, events = _scores(x, y)
    closed = np.ones(len(x), dtype=bool)
    closed[span[0] : span[1]] = False
    events[:, :, closed] = -np.inf
    return path_probabilities(keep, events + np.log(per_ring / 3.0))


def _scores(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Log likelihood ratios of going on, (strength, ring, lag), and of events, (event, strength, ring, lag).

    Each is of the rings that the step uses up; an event's contains what the corrected filter changes around it.
    """
    flat_x, flat_y = _high_pass(x[None])[0], _high_pass(y[None])[0]
    scale_x, scale_y = _scale(flat_x), _scale(flat_y)
    rings, size = np.arange(len(x)), 2 * LARGEST_LAG + 1

    def compared(rows_x: FloatArray, rows_y: FloatArray) -> FloatArray:
        """Summed likelihood of the rows, (strength, ring)."""
        ratio = _likelihood(_normal(rows_x, scale_x), _normal(rows_y, scale_y))
        return np.asarray(ratio.sum(axis=-1))

    keep = np.stack(
        [
            _likelihood(_normal(flat_x, scale_x), _normal(_windows(flat_y, rings + lag, 0)[:, 0], scale_y))
            for lag in range(-LARGEST_LAG, LARGEST_LAG + 1)
        ],
        axis=-1,
    )
    events = np.full((3, *keep.shape), -np.inf)
    plain_x, cut_x = _windows(flat_x, rings, _NEAR), _edited(x, rings, merge=True)
    for column in range(size):
        partner = rings + column - LARGEST_LAG
        outer = _sum_near(keep[..., column], -_NEAR)
        if column + 1 < size:
            inner = _sum_near(keep[..., column + 1], 1)
            events[0, ..., column] = compared(plain_x, _edited(y, partner, merge=True)) - outer - inner
            events[1, ..., column] = compared(plain_x, _edited(y, partner, merge=False)) - outer - inner
        if column > 0:
            inner = _sum_near(keep[..., column - 1], 2)
            events[2, ..., column] = compared(cut_x, _windows(flat_y, partner, _NEAR)) - outer - inner
    return keep, events


def path_probabilities(keep: FloatArray, events: FloatArray) -> FloatArray:
    """Probability of each event over all paths, by sums forwards and backwards.

    A path takes the rings one by one. Going on uses up a ring and keeps the lag; the events merged and absent use up
    a ring and raise the lag, a false ring uses up two and lowers it. All paths begin with lag 0.

    Parameters
    ----------
    keep : float64 array of shape (strengths, n, lags)
        Logarithm of what a ring contributes when the path goes on.
    events : float64 array of shape (3, strengths, n, lags)
        The same of events merged, absent and false that begin with this ring, at this lag before.

    Returns
    -------
    float64 array of shape (3, n, lags)
        Strengths are equally likely beforehand.
    """
    strengths, n, size = keep.shape
    ahead = np.full((n + 3, strengths, size), -np.inf)
    behind = np.full((n + 3, strengths, size), -np.inf)
    ahead[0, :, LARGEST_LAG] = 0.0
    behind[n] = 0.0
    for j in range(n):
        here = ahead[j]
        longer = here + np.logaddexp(events[0, :, j], events[1, :, j])
        ahead[j + 1] = np.logaddexp(ahead[j + 1], here + keep[:, j])
        ahead[j + 1, :, 1:] = np.logaddexp(ahead[j + 1, :, 1:], longer[:, :-1])
        ahead[j + 2, :, :-1] = np.logaddexp(ahead[j + 2, :, :-1], (here + events[2, :, j])[:, 1:])
    for j in range(n - 1, -1, -1):
        total = behind[j + 1] + keep[:, j]
        longer = np.logaddexp(events[0, :, j], events[1, :, j])[:, :-1] + behind[j + 1, :, 1:]
        total[:, :-1] = np.logaddexp(total[:, :-1], longer)
        total[:, 1:] = np.logaddexp(total[:, 1:], events[2, :, j, 1:] + behind[j + 2, :, :-1])
        behind[j] = total
    evidence = logsumexp(behind[0, :, LARGEST_LAG])
    after = np.full((3, n, strengths, size), -np.inf)
    after[:2, :, :, :-1] = behind[1 : n + 1, :, 1:]
    after[2, :, :, 1:] = behind[2 : n + 2, :, :-1]
    paths = ahead[None, :n] + events.transpose(0, 2, 1, 3) + after - evidence
    return np.asarray(np.exp(paths).sum(axis=2))


def _edited(width: FloatArray, rings: npt.NDArray[np.int64], merge: bool) -> FloatArray:
    """Filtered widths around each of the rings once that ring is left out, or added to the next inner one."""
    reach = _NEAR + 2 * _REACH
    steps = np.arange(-reach, reach + 1)
    kept = _at(width, rings[:, None] + steps + ((steps > 0) if merge else (steps >= 0)))
    if merge:
        kept[:, reach] = _at(width, rings) + _at(width, rings + 1)
    return _high_pass(kept)[:, 2 * _REACH : -2 * _REACH]


def _windows(values: FloatArray, rings: npt.NDArray[np.int64], reach: int) -> FloatArray:
    """Values around each of the rings, (ring, 2 reach + 1), NaN outside."""
    return _at(values, rings[:, None] + np.arange(-reach, reach + 1))


def _at(values: FloatArray, places: npt.NDArray[np.int64]) -> FloatArray:
    inside = (places >= 0) & (places < len(values))
    return np.where(inside, values[np.clip(places, 0, len(values) - 1)], np.nan)


def _sum_near(ratios: FloatArray, first: int) -> FloatArray:
    """Sum, for each ring, over `_NEAR` rings that begin `first` rings further in."""
    total = np.pad(np.cumsum(ratios, axis=-1), ((0, 0), (1, 0)))
    n = ratios.shape[-1]
    start = np.clip(np.arange(n) + first, 0, n)
    return np.asarray(total[:, np.clip(np.arange(n) + first + _NEAR, 0, n)] - total[:, start])


def _high_pass(width: FloatArray) -> FloatArray:
    """Logarithm of the widths along the last axis, softened, less its local mean."""
    curve = np.log(width + _SOFTENED * _smooth(width) + 1e-9)
    return np.asarray(curve - _smooth(curve))


def _smooth(values: FloatArray) -> FloatArray:
    """Gaussian mean over what is known along the last axis."""
    kernel = np.exp(-0.5 * (np.arange(-_REACH, _REACH + 1) / _SIGMA) ** 2)
    known = np.isfinite(values)
    total = convolve1d(np.where(known, values, 0.0), kernel, axis=-1, mode="constant")
    share = convolve1d(known.astype(np.float64), kernel, axis=-1, mode="constant")
    return np.asarray(np.divide(total, share, out=np.zeros_like(total), where=share > 1e-12))


def _scale(flat: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation that a few odd rings do not rule."""
    values = flat[np.isfinite(flat)]
    for _ in range(3):
        mean, spread = float(values.mean()), float(values.std()) + 1e-9
        values = np.clip(values, mean - _CLIP * spread, mean + _CLIP * spread)
    return mean, spread


def _normal(flat: FloatArray, scale: tuple[float, float]) -> FloatArray:
    return np.clip((flat - scale[0]) / scale[1], -_CLIP, _CLIP)


def _likelihood(one: FloatArray, other: FloatArray) -> FloatArray:
    """Log ratio of common signal to none, for each strength (first axis); 0 where a ring has no partner."""
    strength = _STRENGTHS.reshape((-1,) + (1,) * one.ndim)
    left = 1.0 - strength**2
    known = np.isfinite(one) & np.isfinite(other)
    a, b = np.where(known, one, 0.0), np.where(known, other, 0.0)
    ratio = -0.5 * np.log(left) - (strength**2 * (a * a + b * b) - 2.0 * strength * a * b) / (2.0 * left)
    return np.where(known, np.log((1.0 - _OUTLIERS) * np.exp(ratio) + _OUTLIERS), 0.0)
