"""Power spectra of a face along and across its grain, measured on straight lines.

A line of some 128 px runs through a place on the face along the local direction of the fibre (on end grain: along
the rings), or at right angles to it. The power spectra of many such lines, each less its mean and under a Hann
window (Welch), are averaged and gathered in bands of half an octave. Lines stay within the wood, and what they are
long against the bend of the grain does not matter as long as photograph and texture are read on the same ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
FloatArray = npt.NDArray[np.float64]

#: Middles of the bands, cycles per px: 1/64 to 1/4 in half octaves.
BANDS: FloatArray = 2.0 ** np.arange(-6.0, -1.99, 0.5)

#: Lengths of lines in px, the longest that fits is taken.
LENGTHS = (128, 64, 32)


@dataclass(frozen=True)
class Lines:
    """Straight lines of equal length on an image.

    Attributes
    ----------
    x, y : float32 arrays of shape (S, L)
        Samples one px apart, image frame, px.
    """

    x: npt.NDArray[np.float32]
    y: npt.NDArray[np.float32]

    def read(self, image: Array) -> npt.NDArray[np.float32]:
        """Image of shape (M, N) or (M, N, C) at the samples, (S, L) or (S, L, C); Lanczos, so that fine grain stays."""
        # remap takes at most 32767 rows.
        parts = [
            cv2.remap(
                np.asarray(image, np.float32),
                self.x[start : start + 16384],
                self.y[start : start + 16384],
                cv2.INTER_LANCZOS4,
                borderMode=cv2.BORDER_REPLICATE,
            )
            for start in range(0, len(self.x), 16384)
        ]
        return np.concatenate(parts) if parts else np.zeros((*self.x.shape, *np.shape(image)[2:]), np.float32)


def place_lines(valid: npt.NDArray[np.bool_], angle: Array, most: int = 1500, length: int | None = None) -> Lines:
    """Lines spread evenly over the wood.

    Parameters
    ----------
    valid : bool array of shape (M, N)
        The wood.
    angle : array of shape (M, N)
        Direction of the lines, rad, from +x towards +y.
    most : int
        About how many lines at most.
    length : int, optional
        Samples of each; the longest of `LENGTHS` of which at least 20 fit when not given.

    Returns
    -------
    Lines
        None of them leaves the wood; there may be none at all.
    """
    step = max(1, int(np.sqrt(valid.size / (2.0 * most))))
    # Every other row is shifted by half a step, so that lines along an axis do not lie on each other.
    rows, cols = np.mgrid[step // 2 : valid.shape[0] : step, step // 2 : valid.shape[1] : step]
    cols = np.minimum(cols + (np.arange(len(rows)) % 2 * (step // 2))[:, None], valid.shape[1] - 1)
    rows, cols = rows.ravel(), cols.ravel()
    inside = valid[rows, cols]
    rows, cols = rows[inside], cols[inside]
    turn = np.asarray(angle, np.float64)[rows, cols]
    lines = Lines(np.zeros((0, length or LENGTHS[0]), np.float32), np.zeros((0, length or LENGTHS[0]), np.float32))
    for samples in LENGTHS if length is None else (length,):
        along = np.arange(samples) - 0.5 * (samples - 1)
        x = cols[:, None] + along * np.cos(turn)[:, None]
        y = rows[:, None] + along * np.sin(turn)[:, None]
        nearest_x, nearest_y = np.rint(x).astype(np.int64), np.rint(y).astype(np.int64)
        within = (nearest_x >= 0) & (nearest_y >= 0) & (nearest_x < valid.shape[1]) & (nearest_y < valid.shape[0])
        whole = within.all(axis=1)
        whole[whole] = valid[nearest_y[whole], nearest_x[whole]].all(axis=1)
        lines = Lines(x[whole].astype(np.float32), y[whole].astype(np.float32))
        if len(lines.x) >= 20:
            break
    return lines


def line_power(values: Array) -> FloatArray:
    """Mean power spectrum of lines (S, L), per cycle per px, at the frequencies ``numpy.fft.rfftfreq(L)``."""
    values = np.asarray(values, np.float64)
    count, length = values.shape
    if count == 0:
        return np.full(length // 2 + 1, np.nan)
    window = np.hanning(length + 2)[1:-1]
    # The weighted mean is what a window would let leak into the lowest bands.
    values = values - (values @ window / window.sum())[:, None]
    spectrum = np.abs(np.fft.rfft(values * window, axis=1)) ** 2
    return np.asarray(2.0 * spectrum.mean(axis=0) / (window**2).sum(), dtype=np.float64)


def band_power(power: FloatArray, bands: FloatArray = BANDS) -> FloatArray:
    """Mean power in bands of half an octave around `bands`; NaN where a band holds no frequency of the lines."""
    length = 2 * (len(power) - 1)
    frequency = np.fft.rfftfreq(length)
    octave = np.log2(np.maximum(frequency, 1e-9)[None, :] / bands[:, None])
    member = (np.abs(octave) <= 0.25) & (frequency > 0.0)
    count = member.sum(axis=1)
    total = np.where(member, power[None, :], 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def grain_spectrum(image: Array, valid: npt.NDArray[np.bool_], angle: Array, most: int = 4000) -> FloatArray:
    """Band power of an image along a direction field.

    Parameters
    ----------
    image : array of shape (M, N)
        Luminance, in whatever encoding.
    valid : bool array of shape (M, N)
        The wood.
    angle : array of shape (M, N)
        Direction in rad, from +x towards +y; add pi/2 for the spectrum across.
    most : int
        About how many lines at most.

    Returns
    -------
    array of shape (9,)
        Power per cycle per px in the bands `BANDS`; NaN where no line fits.
    """
    return band_power(line_power(place_lines(valid, angle, most).read(image)))


def difference_db(found: FloatArray, wanted: FloatArray) -> FloatArray:
    """How much stronger `found` is than `wanted`, dB; NaN where either is unknown or nothing."""
    known = np.isfinite(found) & np.isfinite(wanted) & (found > 0.0) & (wanted > 0.0)
    ratio = np.divide(found, wanted, out=np.ones(np.shape(found)), where=known)
    return np.where(known, 10.0 * np.log10(ratio), np.nan)


def grain_angle(fiber: Array, outward: Array, right: Array, down: Array) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Direction on a face that counts as along the grain.

    Parameters
    ----------
    fiber, outward : arrays of shape (..., 3)
        Unit vectors along the fibre and away from the pith, board frame.
    right, down : arrays of shape (3,) or (..., 3)
        What one px to the right and one px down add on the face, board frame.

    Returns
    -------
    angle : array of shape (...)
        Image direction of the fibre; on end grain that of the rings; rad, from +x towards +y.
    end_grain : bool array of shape (...)
        True where the fibre leaves the face at more than 60 degrees, so that what is seen along it is the ring.
    """
    unit_right = right / np.linalg.norm(right, axis=-1, keepdims=True)
    unit_down = down / np.linalg.norm(down, axis=-1, keepdims=True)
    along_x, along_y = (fiber * unit_right).sum(axis=-1), (fiber * unit_down).sum(axis=-1)
    out_x, out_y = (outward * unit_right).sum(axis=-1), (outward * unit_down).sum(axis=-1)
    end_grain = np.hypot(along_x, along_y) < 0.5
    return np.where(end_grain, np.arctan2(out_x, -out_y), np.arctan2(along_y, along_x)), end_grain
