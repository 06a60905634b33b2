"""Colors over continuous ring age: an unrolled strip of rings, without a seam at the ring boundaries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

Array = npt.NDArray[Any]

#: How many rings away others tell the brightness of one that was not seen.
NEAR_RINGS = 3.0


@dataclass(frozen=True)
class ColorStrip:
    """Color and lateness over ring age.

    Attributes
    ----------
    age : float64 array of shape (S,)
        Ring age at the sample centres: ``(i + 0.5) / samples_per_ring``.
    rgb : float32 array of shape (S, 3)
        Linear RGB.
    lateness : float32 array of shape (S,)
        0 earlywood to 1 latewood.
    support : float32 array of shape (S,)
        Face pixels behind each sample; 0 where it was filled.
    """

    age: npt.NDArray[np.float64]
    rgb: npt.NDArray[np.float32]
    lateness: npt.NDArray[np.float32]
    support: npt.NDArray[np.float32]


def fit_color_strip(
    age: Array, rgb: Array, weight: Array, rings: int, samples_per_ring: int, latewood_is_dark: bool
) -> ColorStrip:
    """Robust color of every ring at every fraction of its growth.

    Parameters
    ----------
    age : array of shape (N,)
        Ring age of face pixels.
    rgb : array of shape (N, 3)
        Their linear color.
    weight : array of shape (N,)
        How far each counts.
    rings, samples_per_ring : int
        Size of the strip.
    latewood_is_dark : bool
        True for conifers; False for ring-porous wood, whose dark pores are earlywood.

    Returns
    -------
    ColorStrip
        Unseen rings take the face's mean profile at the brightness of the nearest seen ones.
    """
    size = rings * samples_per_ring
    position = np.asarray(age) * samples_per_ring
    cell = np.floor(position).astype(np.int64)
    inside = (cell >= 0) & (cell < size) & (np.asarray(weight) > 0)
    cell, values, mass = cell[inside], np.asarray(rgb, np.float64)[inside], np.asarray(weight, np.float64)[inside]
    mean, support = _robust_mean(cell, values, mass, size)
    table = mean.reshape(rings, samples_per_ring, 3)
    counts = support.reshape(rings, samples_per_ring, 1)
    profile = (table * counts).sum(axis=0) / np.maximum(counts.sum(axis=0), 1e-9)
    profile = _fill_cyclic(profile, counts.sum(axis=0)[:, 0])
    level = _ring_levels(table, counts, profile)
    prior = profile[None] * level[:, None, :]
    # A sample that few pixels back leans on what its ring and its fraction are like elsewhere.
    lean = 6.0
    blended = (table * counts + prior * lean) / (counts + lean)
    strip = gaussian_filter1d(blended.reshape(size, 3), 0.6, axis=0, mode="nearest")
    return ColorStrip(
        (np.arange(size) + 0.5) / samples_per_ring,
        np.clip(strip, 0.0, None).astype(np.float32),
        _lateness(strip, rings, samples_per_ring, latewood_is_dark),
        support.astype(np.float32),
    )


def fit_balanced(
    age: Array,
    rgb: Array,
    weight: Array,
    face: Array,
    faces: int,
    rings: int,
    samples_per_ring: int,
    latewood_is_dark: bool,
    rounds: int = 3,
) -> tuple[ColorStrip, npt.NDArray[np.float32]]:
    """Color of every ring from several faces, each under its own light.

    End grain is darker than the other faces of a block, and every photograph has its own white balance: colors of a
    face are those of the wood times a gain of its own, found together with them in turns.

    Parameters
    ----------
    age, rgb, weight, rings, samples_per_ring, latewood_is_dark
        As of `fit_color_strip`, of the pixels of all faces.
    face : int array of shape (N,)
        Which face each pixel lies on.
    faces, rounds : int
        How many there are, and how many turns.

    Returns
    -------
    strip : ColorStrip
        Color of the wood under the mean light.
    gain : float32 array of shape (faces, 3)
        Of each face; 1 for a single one. Their mean over all pixels, in log, is 1.
    """
    gain = np.ones((faces, 3))
    strip = fit_color_strip(age, rgb, weight, rings, samples_per_ring, latewood_is_dark)
    if faces == 1:
        return strip, gain.astype(np.float32)
    rgb, weight, face = np.asarray(rgb, np.float64), np.asarray(weight, np.float64), np.asarray(face)
    for _ in range(rounds):
        expected = color_at(strip, age, samples_per_ring)
        mass = np.maximum(np.bincount(face, weight, faces), 1e-12)
        for channel in range(3):
            seen = np.bincount(face, weight * rgb[:, channel], faces)
            model = np.bincount(face, weight * expected[:, channel], faces)
            gain[:, channel] = np.where(model > 0, seen / np.maximum(model, 1e-12), 1.0)
        gain = np.clip(gain, 0.05, 20.0)
        gain /= np.exp(np.average(np.log(gain), axis=0, weights=mass))
        strip = fit_color_strip(age, rgb / gain[face], weight, rings, samples_per_ring, latewood_is_dark)
    return strip, gain.astype(np.float32)


def _robust_mean(cell: Array, values: Array, mass: Array, size: int) -> tuple[Array, Array]:
    """Mean per cell in which far-off pixels (pores, cracks, dust) fade; two rounds of reweighting."""
    support = np.bincount(cell, mass, minlength=size)
    weight = mass
    mean = np.zeros((size, 3))
    for _ in range(3):
        total = np.bincount(cell, weight, minlength=size)
        for channel in range(3):
            mean[:, channel] = np.bincount(cell, weight * values[:, channel], minlength=size) / np.maximum(total, 1e-12)
        miss = np.abs(values - mean[cell]).sum(axis=1)
        scale = 3.0 * np.average(miss, weights=mass) + 1e-6 if len(miss) else 1.0
        weight = mass / (1.0 + (miss / scale) ** 2)
    return mean, support


def _fill_cyclic(profile: Array, counts: Array) -> Array:
    """Mean ring with empty fractions taken from their neighbours."""
    seen = counts > 0
    if not seen.any():
        return np.full_like(profile, 0.5)
    where = np.arange(len(profile))
    filled = profile.copy()
    for channel in range(3):
        filled[:, channel] = np.interp(where, where[seen], profile[seen, channel])
    return filled


def _ring_levels(table: Array, counts: Array, profile: Array) -> Array:
    """Color of each ring relative to the mean ring, smooth over rings that were not seen; shape (rings, 3).

    A ring of which only a part was seen says little of the rest: its level is mixed with that of the rings about it.
    """
    mass = counts.sum(axis=(1, 2))
    seen = mass > 0
    if not seen.any():
        return np.ones((len(mass), 3))
    ratio = (table * counts).sum(axis=1) / np.maximum((profile[None] * counts).sum(axis=1), 1e-9)
    log_ratio = np.log(np.clip(ratio, 0.2, 5.0)) * seen[:, None]
    covered = (counts[..., 0] > 0).mean(axis=1)
    trust = covered**2 * np.minimum(1.0, mass / np.median(mass[seen]))
    apart = np.arange(len(mass))[:, None] - np.arange(len(mass))[None]
    # A heavy tail: far inside of what was seen it is the rings nearest to it that count, however far they are.
    near = trust[None] / (1.0 + (apart / NEAR_RINGS) ** 2) ** 2
    about = near @ log_ratio / np.maximum(near.sum(axis=1, keepdims=True), 1e-12)
    return np.asarray(np.exp(trust[:, None] * log_ratio + (1.0 - trust[:, None]) * about))


def _lateness(strip: Array, rings: int, samples: int, latewood_is_dark: bool) -> npt.NDArray[np.float32]:
    """Inverted HSL lightness of each ring, stretched between its own lightest and darkest parts."""
    lightness = 0.5 * (strip.max(axis=1) + strip.min(axis=1)).reshape(rings, samples)
    lightness = gaussian_filter1d(lightness, 1.0, axis=1, mode="nearest")
    low, high = np.percentile(lightness, [4, 96], axis=1)
    # A ring with hardly any contrast of its own is stretched no more than the typical one.
    contrast = np.maximum(high - low, 0.35 * np.median(high - low) + 1e-6)
    middle = 0.5 * (high + low)
    darkness = 0.5 - (lightness - middle[:, None]) / contrast[:, None]
    late = darkness if latewood_is_dark else 1.0 - darkness
    return np.asarray(np.clip(late, 0.0, 1.0).reshape(-1), dtype=np.float32)


def color_at(strip: ColorStrip, age: Array, samples_per_ring: int) -> npt.NDArray[np.float32]:
    """Linear RGB of shape (..., 3) at ring ages (...), linear between samples."""
    position = np.clip(np.asarray(age) * samples_per_ring - 0.5, 0.0, len(strip.rgb) - 1.0)
    low = np.minimum(position.astype(np.int64), len(strip.rgb) - 2)
    part = (position - low)[..., None].astype(np.float32)
    return np.asarray(strip.rgb[low] * (1.0 - part) + strip.rgb[low + 1] * part, dtype=np.float32)


def psnr_blurred(found: Array, wanted: Array, valid: npt.NDArray[np.bool_], sigma_px: float = 1.5) -> float:
    """Peak signal-to-noise ratio in dB of linear images (M, N, 3), both blurred, over the wood."""
    difference = cv2.GaussianBlur(np.asarray(found - wanted, np.float32), (0, 0), sigma_px)
    square = float((difference[valid] ** 2).mean()) if valid.any() else 0.0
    return float(-10.0 * np.log10(max(square, 1e-12)))
