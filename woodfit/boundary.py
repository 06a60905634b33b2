"""Move a traced boundary onto the true edge: the abrupt step from latewood to earlywood.

A sinusoid's phase only approximates the edge, by a fraction of a ring that changes with the share of latewood.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from woodfit.streamlines import smooth_along

FloatArray = npt.NDArray[np.float32]


def edge_strength(
    value: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    orientation: npt.NDArray[Any],
    edge_direction: npt.NDArray[Any],
    ring_scale_px: float,
    dotted: bool = False,
) -> FloatArray:
    """Brightening per pixel along `edge_direction`, smoothed a little along the rings.

    Parameters
    ----------
    value, valid : arrays of shape (M, N)
        Grey values and wood mask.
    orientation : array of shape (M, N)
        Ring tangent in rad.
    edge_direction : array of shape (M, N)
        Direction in rad across the rings towards the bright side of the abrupt edge.
    ring_scale_px : float
        Characteristic ring width in pixels.
    dotted : bool
        True for wood whose boundaries are rows of vessels: it is smoothed farther along the rings.

    Returns
    -------
    float32 array of shape (M, N)
        Positive at the edges sought, negative where the ring darkens.
    """
    along = float(np.clip(1.6 * ring_scale_px, 6.0, 24.0) if dotted else np.clip(0.25 * ring_scale_px, 1.5, 6.0))
    smooth, _ = smooth_along(value, valid, orientation, int(3 * along), along)
    sigma = float(np.clip(0.02 * ring_scale_px, 0.6, 1.2))
    smooth = np.asarray(cv2.GaussianBlur(smooth, (0, 0), sigma, borderType=cv2.BORDER_REFLECT_101), np.float32)
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0) / 32.0
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1) / 32.0
    return np.asarray(gx * np.cos(edge_direction) + gy * np.sin(edge_direction), dtype=np.float32)


def edge_offsets(
    strength: FloatArray,
    points: npt.NDArray[np.float64],
    direction_rad: npt.NDArray[Any],
    ring_width_px: npt.NDArray[Any],
    centre_rings: float,
    spread_rings: float,
    closed: bool,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Smoothest strong edge near a traced boundary, by dynamic programming over offsets across the rings.

    Parameters
    ----------
    strength : array of shape (M, N)
        From `edge_strength`.
    points : array of shape (K, 2)
        x, y of the vertices in pixels.
    direction_rad : array of shape (K,)
        Direction across the rings in which offsets are counted.
    ring_width_px : array of shape (K,)
        Local ring width.
    centre_rings, spread_rings : float
        Where the edge is expected relative to the traced line, and one standard deviation, in ring widths.
    closed : bool
        Whether the last vertex is next to the first.

    Returns
    -------
    offset_px, contrast : arrays of shape (K,)
        Offset along `direction_rad`, and the edge strength found there relative to the profile's mean slope size.
    """
    count = len(points)
    bins = 41
    # Offsets in units of the local ring width, so that narrow and wide stretches of one boundary share bins.
    relative = centre_rings + np.linspace(-2.0, 2.0, bins) * spread_rings
    offsets = relative[None, :] * np.asarray(ring_width_px)[:, None]
    xs = points[:, 0:1] + offsets * np.cos(direction_rad)[:, None]
    ys = points[:, 1:2] + offsets * np.sin(direction_rad)[:, None]
    profile = sample_image(strength, xs, ys, cv2.INTER_CUBIC)
    typical = np.abs(profile).mean(axis=1, keepdims=True) + 0.25 * np.abs(profile).mean() + 1e-9
    reward = profile / typical - 0.5 * ((relative - centre_rings) / spread_rings)[None, :] ** 2
    step_px = float(np.median(ring_width_px)) * (relative[1] - relative[0])
    # A boundary may turn away from the traced one by about 1:3; each bin per pixel beyond that costs.
    path = _best_path(reward, cost=2.0 * step_px, wraps=closed)
    inner = np.clip(path, 1, bins - 2)
    rows = np.arange(count)
    # The exact place is the profile's own peak: the prior only chooses between peaks.
    left, mid, right = (profile[rows, inner + d] for d in (-1, 0, 1))
    curve = left - 2.0 * mid + right
    shift = np.where(curve < -1e-9, 0.5 * (left - right) / np.minimum(curve, -1e-9), 0.0)
    shift = np.where(inner == path, np.clip(shift, -0.5, 0.5), 0.0)
    exact = np.interp(path + shift, np.arange(bins), relative) * np.asarray(ring_width_px)
    exact = _smooth(exact, closed)
    contrast = profile[rows, path] / typical[:, 0]
    return exact, contrast


def edges_between(
    strength: npt.NDArray[Any], ways: npt.NDArray[np.float64], least_share: float
) -> npt.NDArray[np.int64]:
    """How many edges lie on the way from one boundary to another.

    Parameters
    ----------
    strength : array of shape (M, N)
        From `edge_strength`.
    ways : array of shape (K, 4)
        x, y of the start and of the end of each way, both on boundaries.
    least_share : float
        Least strength of an edge, as a share of the weaker one of the two boundaries.

    Returns
    -------
    int array of shape (K,)
    """
    most = 16384
    if len(ways) > most:
        # In parts: the profiles of all walks on a large disc would take hundreds of megabytes.
        parts = np.array_split(ways, -(-len(ways) // most))
        return np.concatenate([edges_between(strength, part, least_share) for part in parts])
    # A boundary's own edge may lie a little outside it; the ends of the way are searched for it on either side.
    end = 0.12
    at = np.linspace(-end, 1.0 + end, 79)
    x, y = (ways[:, i : i + 1] + at * (ways[:, i + 2 : i + 3] - ways[:, i : i + 1]) for i in (0, 1))
    profile = sample_image(np.asarray(strength, np.float32), x, y)
    least = least_share * np.minimum(profile[:, at <= end].max(axis=1), profile[:, at >= 1.0 - end].max(axis=1))
    between = profile[:, (at > end) & (at < 1.0 - end)]
    count = np.zeros(len(ways), np.int64)
    # Rise and fall in turn, each by at least `least`: an edge stands out of the slopes on either side of it.
    lowest, highest = between[:, 0].copy(), np.full(len(ways), -np.inf)
    for here in between.T[1:]:
        rising = np.isneginf(highest)
        lowest = np.where(rising, np.minimum(lowest, here), lowest)
        begun = rising & (here > lowest + least)
        highest = np.where(begun | ~rising, np.maximum(highest, here), highest)
        done = ~rising & (here < highest - least)
        count += done
        lowest, highest = np.where(done, here, lowest), np.where(done, -np.inf, highest)
    return count


def latewood_foot(
    value: npt.NDArray[Any],
    points: npt.NDArray[np.float64],
    direction_rad: npt.NDArray[Any],
    ring_width_px: npt.NDArray[Any],
    closed: bool,
    level: float = 0.8,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Way in px from the steepest point of a step inwards to where latewood is reached.

    A boundary is the outer edge of the last latewood cells. The step is blurred and often has two parts, so its
    steepest point lies outside them, by about a pixel at 1200 dpi. Latewood counts as reached where `level` of the
    step's height is behind.

    Parameters
    ----------
    value : array of shape (M, N)
        Grey values, smoothed along the rings only.
    points, direction_rad, ring_width_px
        Vertices on the steepest points (K, 2), outward direction (K,), local ring width (K,).
    closed : bool
        Whether the last vertex is next to the first.
    level : float
        Share of the step's height.

    Returns
    -------
    way : array of shape (K,)
        Inwards, smooth along the boundary; at most 2.5 % of the ring width (0.5 px where that is less), and 0 where
        latewood is not reached within that.
    sharp : bool array of shape (K,)
        Where it was reached: elsewhere the step is out of focus.
    """
    most = np.maximum(0.5, 0.025 * np.asarray(ring_width_px))
    reach = np.linspace(-2.0, 2.0, 33)
    ways = reach[None, :] * most[:, None]
    xs = points[:, 0:1] - ways * np.cos(direction_rad)[:, None]
    ys = points[:, 1:2] - ways * np.sin(direction_rad)[:, None]
    profile = sample_image(np.asarray(value, np.float32), xs, ys)
    bright, dark = profile[:, :17].max(axis=1), profile[:, 16:].min(axis=1)
    reached = profile[:, 16:] <= (bright - level * (bright - dark))[:, None]
    first = reached.argmax(axis=1)
    way = ways[np.arange(len(points)), 16 + first]
    # A step wider than that is out of focus: its steepest point is then the best guess.
    sharp = reached.any(axis=1) & (way <= most)
    return _smooth(np.where(sharp, way, 0.0), closed, sigma=4.0), sharp


def sample_image(
    image: FloatArray, xs: npt.NDArray[Any], ys: npt.NDArray[Any], interpolation: int = cv2.INTER_LINEAR
) -> npt.NDArray[np.float64]:
    """Image at points of shape (K, L), edge pixels repeated; in parts, since OpenCV takes at most 32,767 rows."""
    rows = 16384
    parts = [
        cv2.remap(
            image,
            xs[start : start + rows].astype(np.float32),
            ys[start : start + rows].astype(np.float32),
            interpolation,
            borderMode=cv2.BORDER_REPLICATE,
        )
        for start in range(0, len(xs), rows)
    ]
    return np.concatenate(parts).astype(np.float64) if parts else np.zeros(np.shape(xs))


def _best_path(reward: npt.NDArray[np.float64], cost: float, wraps: bool) -> npt.NDArray[np.intp]:
    """Bin per row with the greatest sum of rewards less `cost` times the squared change of bin."""
    if wraps:
        # Twice round, and the middle turn kept: no seam at the start.
        turn = reward.shape[0]
        return _viterbi(np.concatenate([reward, reward, reward]), cost)[turn : 2 * turn]
    return _viterbi(reward, cost)


@njit(cache=True)
def _viterbi(reward: npt.NDArray[np.float64], cost: float) -> npt.NDArray[np.intp]:
    count, bins = reward.shape
    score = reward[0].copy()
    back = np.zeros((count, bins), np.int8)
    for row in range(1, count):
        ahead = np.empty(bins, np.float64)
        for k in range(bins):
            best = -np.inf
            for change in range(-2, 3):
                source = k + change
                if 0 <= source < bins and score[source] - cost * change * change > best:
                    best = score[source] - cost * change * change
                    back[row, k] = change
            ahead[k] = best + reward[row, k]
        score = ahead
    path = np.empty(count, np.intp)
    path[count - 1] = int(score.argmax())
    for row in range(count - 1, 0, -1):
        path[row - 1] = path[row] + back[row, path[row]]
    return path


def _smooth(offset: npt.NDArray[np.float64], closed: bool, sigma: float = 2.0) -> npt.NDArray[np.float64]:
    """Gaussian along the boundary, in vertices."""
    reach = min(int(3 * sigma), len(offset) - 1)
    if reach < 1:
        return offset
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    padded = np.pad(offset, reach, mode="wrap" if closed else "reflect")
    return np.convolve(padded, kernel / kernel.sum(), mode="valid")
