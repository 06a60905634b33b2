"""What a face shows beside its rings: its colors, its shares of early- and latewood, and how skew its dark side is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from woodfit.photograph import srgb_encode

Array = npt.NDArray[Any]
FloatArray = npt.NDArray[np.float64]

#: Weights of linear red, green and blue in the luminance.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

#: The three ranges of scale (fine, middle, coarse): from and up to which frequency (cycles per px), and up to which
#: width of its streaks (px) a noise belongs to the range.
RANGES = ((0.125, 0.5, 2.0), (0.03125, 0.125, 8.0), (0.0, 0.03125, np.inf))


@dataclass(frozen=True)
class LineSamples:
    """What lines on the face show, and where in the tree they run; all lines of one direction.

    Attributes
    ----------
    photo, base : float32 arrays of shape (S, L, 3)
        Linear RGB of the photograph and of the color map.
    lateness : float32 array of shape (S, L)
        0..1.
    radius, azimuth, height : float64 arrays of shape (S, L)
        Tree coordinates; the radius is that of the fibre (`SolidTexture.fiber_radius`), px, rad, px.
    direction : {"along", "across", "x", "y"}
        Along or across the grain (on end grain: the rings), or along an axis of the photograph.
    end_grain : bool
        Whether they lie on end grain.
    """

    photo: npt.NDArray[np.float32]
    base: npt.NDArray[np.float32]
    lateness: npt.NDArray[np.float32]
    radius: FloatArray
    azimuth: FloatArray
    height: FloatArray
    direction: str
    end_grain: bool


@dataclass(frozen=True)
class Measured:
    """Colors and shares of early- and latewood in the three ranges of scale, and how skew the dark side is.

    Attributes
    ----------
    color : array of shape (3, 3)
        Range by channel: change of the channel's logarithm for one of the luminance's.
    profile : array of shape (3, 2)
        Range by (early, late): standard deviation relative to the face's.
    skewness : array of shape (3,)
        Of each range across the grain; negative where there are dark spots or streaks.
    """

    color: FloatArray
    profile: FloatArray
    skewness: FloatArray


def luminance(rgb: Array) -> npt.NDArray[np.float32]:
    """Encoded luminance (...) of linear rgb (..., 3): the grey value that spectra are compared in."""
    return srgb_encode(np.clip(rgb @ LUMINANCE.astype(np.float32), 0.0, 1.0))


def measure(directions: Sequence[LineSamples]) -> Measured:
    """Color, share by lateness and skewness of what is left of the photograph without its color map."""
    color, profile, skew = np.ones((3, 3)), np.ones((3, 2)), np.zeros(3)
    left = [_residual(lines) for lines in directions]
    for number, (low, high, _) in enumerate(RANGES):
        parts = [band_pass(rest, low, high) for rest in left]
        rest = np.concatenate([part.reshape(-1, 4) for part in parts])
        square = float((rest[:, 3] ** 2).mean())
        if square > 0.0:
            color[number] = np.clip((rest[:, :3] * rest[:, 3:]).mean(axis=0) / square, 0.2, 3.0)
            late = np.concatenate([lines.lateness.ravel() for lines in directions]).astype(np.float64)
            early, later = nnls(np.column_stack([1.0 - late, late]), rest[:, 3] ** 2 / square)[0]
            profile[number] = np.sqrt(np.clip([early, later], 0.05, 8.0))
            across = [
                part[..., 3].ravel()
                for part, lines in zip(parts, directions, strict=True)
                if lines.direction == "across"
            ]
            skew[number] = skewness(np.concatenate(across)) if across else 0.0
    return Measured(color, profile, skew)


def skewness(values: Array) -> float:
    """Third moment over the 3/2 power of the second, about the mean."""
    values = np.asarray(values, np.float64) - np.mean(values, dtype=np.float64)
    return float((values**3).mean() / max(float((values**2).mean()) ** 1.5, 1e-30))


def _residual(lines: LineSamples) -> FloatArray:
    """Logarithm of photograph over color map: red, green, blue, luminance; (S, L, 4)."""
    with_luminance = (np.concatenate([rgb, rgb @ LUMINANCE[:, None]], axis=-1) for rgb in (lines.photo, lines.base))
    photo, base = (np.log(np.maximum(rgb, 0.004)) for rgb in with_luminance)
    return np.asarray(photo - base, dtype=np.float64)


def band_pass(values: Array, low: float, high: float) -> FloatArray:
    """Part of lines (S, L, C) between two frequencies."""
    length = values.shape[1]
    spectrum = np.fft.rfft(values - values.mean(axis=1, keepdims=True), axis=1)
    frequency = np.fft.rfftfreq(length)
    spectrum *= ((frequency > low) & (frequency <= high))[None, :, None]
    return np.asarray(np.fft.irfft(spectrum, length, axis=1), dtype=np.float64)
