"""Rings laid straight, and the border between earlywood and latewood in each of them.

A ring is sampled between its two boundaries at many places beside the path and averaged along the boundaries: noise,
resin canals and single vessels fade, however curved or slanted the ring is. Darkness is inverted HSL lightness of the
encoded image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from woodfit.boundary import sample_image
from woodfit.measuring import Boundaries, Crossings, path_length
from woodfit.measuring_path import Grid
from woodfit.photograph import srgb_encode
from woodfit.ring_widths import PathRings

FloatArray = npt.NDArray[np.float64]

#: Least contrast between earlywood and latewood, in lightness 0..1.
LEAST_CONTRAST = 0.03

#: Borders less sure than this are not given.
LEAST_SURENESS = 0.3


def darkness(rgb: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Inverted HSL lightness, 0..1, shape (M, N), of linear RGB (M, N, 3)."""
    brightest, darkest = (srgb_encode(np.asarray(side, np.float32)) for side in (rgb.max(axis=-1), rgb.min(axis=-1)))
    return np.asarray(1.0 - 0.5 * (brightest + darkest), dtype=np.float32)


@dataclass(frozen=True)
class StraightRings:
    """Mean profile of each ring from its inner to its outer boundary.

    Parameters
    ----------
    profile : float array of shape (m, F)
        Mean darkness over the corridor at F fractions of the ring, ``(k + 0.5) / F``; NaN where unknown.
    noise : float array of shape (m,)
        One standard deviation of a profile's values.
    """

    profile: FloatArray
    noise: FloatArray


def straighten(
    dark: npt.NDArray[np.float32],
    valid: npt.NDArray[np.bool_],
    grid: Grid,
    found: Crossings,
    rings: PathRings,
    boundaries: Boundaries,
    corridor_px: float,
    fractions: int = 64,
) -> StraightRings:
    """Sample every ring of a path between its boundaries and average along them.

    Parameters
    ----------
    dark, valid : arrays of shape (M, N)
        Darkness and the wood, on `grid`.
    grid : Grid
        Where the arrays lie on the scan.
    found, rings : Crossings, PathRings
        Of one path.
    boundaries : Boundaries
        What was crossed.
    corridor_px : float
        Width of the corridor along the boundaries, scan px, centred on the path.
    fractions : int
        Samples across each ring.

    Returns
    -------
    StraightRings
    """
    beside = np.arange(-0.5 * corridor_px, 0.5 * corridor_px + 1e-9, grid.step)
    fraction = (np.arange(fractions) + 0.5) / fractions
    profile, noise = np.full((len(rings), fractions), np.nan), np.full(len(rings), np.nan)
    edges = [_along(found, i, boundaries, beside) for i in range(len(found))]
    for k in np.flatnonzero(rings.width_px > 0.0):
        inner, outer = edges[rings.inner[k]], edges[rings.outer[k]]
        points = inner[:, None, :] + fraction[None, :, None] * (outer - inner)[:, None, :]
        known = np.isfinite(points).all(axis=-1)
        points = np.where(known[..., None], points, 0.0)
        known &= grid.inside(points) & grid.nearest(valid, points)
        place = grid.place(points)
        values = np.where(known, sample_image(dark, place[..., 0], place[..., 1]), np.nan)
        profile[k], noise[k] = _robust_mean(values)
    return StraightRings(profile, noise)


def _along(found: Crossings, i: int, boundaries: Boundaries, beside: FloatArray) -> FloatArray:
    """Points (S, 2) of a crossed boundary at ways (S,) from its crossing, all to the same side; NaN past its ends."""
    tangent = np.array([-np.sin(found.angle[i]), np.cos(found.angle[i])])
    straight = found.point[i] + beside[:, None] * tangent
    if found.beside[i] or found.line[i] < 0:
        return np.asarray(straight)
    loop = boundaries.loop(int(found.line[i]))
    way = path_length(loop)
    near = np.array([np.interp(found.place[i] + d, way, axis) for d in (-1.0, 1.0) for axis in loop.T]).reshape(2, 2)
    sign = 1.0 if (near[1] - near[0]) @ tangent >= 0.0 else -1.0
    place = found.place[i] + sign * beside
    if boundaries.closed[found.line[i]]:
        place = np.mod(place, way[-1])
    curved = np.column_stack([np.interp(place, way, loop[:, 0]), np.interp(place, way, loop[:, 1])])
    off = (place < way[0]) | (place > way[-1])
    # A boundary that ends within the corridor is carried on straight for a little.
    carried = off & (np.abs(beside) <= 3.0)
    return np.where(off[:, None], np.where(carried[:, None], straight, np.nan), curved)


def _robust_mean(values: FloatArray) -> tuple[FloatArray, float]:
    """Mean over the first axis without the far-off quarter, and one standard deviation of it."""
    count = np.isfinite(values).sum(axis=0)
    if (count == 0).any():
        return np.full(values.shape[1], np.nan), np.nan
    median = np.nanmedian(values, axis=0)
    miss = np.abs(values - median)
    scale = 1.4826 * np.nanmedian(miss) + 1e-6
    weight = np.where(np.isfinite(values), 1.0 / (1.0 + (miss / (2.0 * scale)) ** 4), 0.0)
    mean = (weight * np.nan_to_num(values)).sum(axis=0) / weight.sum(axis=0)
    return mean, float(scale / np.sqrt(np.median(count)))


@dataclass(frozen=True)
class Onsets:
    """Where latewood begins in each ring.

    Parameters
    ----------
    fraction : float array of shape (m,)
        0 at the inner boundary, 1 at the outer; NaN where it cannot be told.
    sureness : float array of shape (m,)
        0..1: how much of the ring's change of tone is one step, and how far it stands out of the noise.
    """

    fraction: FloatArray
    sureness: FloatArray


def latewood_onsets(straight: StraightRings, width_px: FloatArray, step_px: float, late_is_dark: bool) -> Onsets:
    """Border between earlywood and latewood of each ring.

    The border is where the smoothed profile passes the middle between the ring's earlywood and latewood levels, at
    the step that splits the ring best into two tones. In conifers the ring darkens there; in ring-porous wood the
    dark pore zone ends.

    Parameters
    ----------
    straight : StraightRings
        Profiles.
    width_px : array of shape (m,)
        Ring widths, scan px.
    step_px : float
        Scan px per sample of the image: what lies within one of them of a boundary belongs to both rings.
    late_is_dark : bool
        Whether latewood is the darker part.

    Returns
    -------
    Onsets
    """
    fraction, sureness = np.full(len(width_px), np.nan), np.zeros(len(width_px))
    for k, profile in enumerate(straight.profile if late_is_dark else -straight.profile):
        if np.isfinite(profile).all() and width_px[k] >= 4.0 * step_px:
            fraction[k], sureness[k] = _onset(profile, float(straight.noise[k]), step_px / float(width_px[k]))
    fraction[sureness < LEAST_SURENESS] = np.nan
    return Onsets(fraction, np.where(np.isfinite(fraction), sureness, 0.0))


def with_marked(onsets: Onsets, rings: PathRings, marks: FloatArray) -> Onsets:
    """Onsets with those that a person marked (K, 2), scan px, in place of what was found; they are sure.

    A mark belongs to the ring on whose measured line it lies, within a fifth of the ring's width to the sides or 3 px.
    """
    fraction, sureness = onsets.fraction.copy(), onsets.sureness.copy()
    for k in np.flatnonzero(rings.width_px > 0.0):
        across = (rings.end[k] - rings.start[k]) / rings.width_px[k]
        offset = marks - rings.start[k]
        share = offset @ across / rings.width_px[k]
        aside = np.abs(offset @ np.array([-across[1], across[0]]))
        own = np.flatnonzero((share > 0.0) & (share < 1.0) & (aside <= max(3.0, 0.2 * rings.width_px[k])))
        if len(own):
            fraction[k], sureness[k] = share[own[aside[own].argmin()]], 1.0
    return Onsets(fraction, sureness)


def _onset(profile: FloatArray, noise: float, pixel: float) -> tuple[float, float]:
    """Border (fraction, NaN for none) and sureness, of a profile in which latewood is high; `pixel` in fractions."""
    count = len(profile)
    place = (np.arange(count) + 0.5) / count
    smooth = gaussian_filter1d(profile, 0.5 * pixel * count, mode="nearest")
    # Near its boundaries a ring shares its pixels with its neighbours.
    own = np.flatnonzero((place > 1.2 * pixel) & (place < 1.0 - 1.2 * pixel))
    if len(own) < 6:
        return np.nan, 0.0
    inner = smooth[own]
    split, share = _best_split(inner)
    crossing = split
    early = late = 0.0
    for _ in range(3):
        early = float(np.quantile(inner[:crossing], 0.25))
        late = float(np.quantile(inner[crossing:], 0.75))
        rising = np.flatnonzero((inner[:-1] < 0.5 * (early + late)) & (inner[1:] >= 0.5 * (early + late)))
        if len(rising) == 0:
            return np.nan, 0.0
        # Where the tone passes the middle more than once, nearest to the best split.
        crossing = int(rising[np.abs(rising + 1 - split).argmin()]) + 1
    contrast = late - early
    if contrast < LEAST_CONTRAST:
        return np.nan, 0.0
    low, high = inner[crossing - 1], inner[crossing]
    exact = crossing - 1 + (0.5 * (early + late) - low) / (high - low)
    stands_out = float(np.clip(contrast / (6.0 * noise + 1e-9), 0.0, 1.0))
    return float(np.interp(exact, np.arange(len(own)), place[own])), share * stands_out


def _best_split(values: FloatArray) -> tuple[int, float]:
    """First sample of the higher second part of the best two-tone fit, and the share of variance it explains."""
    count = np.arange(1, len(values))
    before = np.cumsum(values)[:-1]
    total = float(values.sum())
    rise = (total - before) / (len(values) - count) - before / count
    between = np.where(rise > 0.0, rise**2 * count * (len(values) - count) / len(values), 0.0)
    whole = float(((values - values.mean()) ** 2).sum())
    best = int(between.argmax())
    return best + 1, float(between[best] / whole) if whole > 0.0 else 0.0
