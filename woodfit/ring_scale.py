"""How wide the rings of a scan are, before anything else is known of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.grids import Window
from woodfit.streamlines import smooth_along
from woodfit.structure_tensor import orientation
from woodfit.wave_bank import fit_bank

FloatArray = npt.NDArray[np.float32]

#: Wavelengths tried at each level of the pyramid, in pixels of that level.
WAVELENGTHS_PX = np.array([4.0, 5.66, 8.0, 11.3, 16.0], np.float32)

#: What is seen less often than this across the window is not periodic.
LEAST_WAVES = 2.0


def level_scores(value: FloatArray, valid: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Share of the contour-smoothed profile's variance that a wave explains, per wavelength.

    Noise, pores and rays do not survive the smoothing along the contours or are not periodic across them; rings
    are both. The share has no unit, so levels of a pyramid compare.

    Parameters
    ----------
    value, valid : arrays of shape (M, N)
        Grey values and the wood.

    Returns
    -------
    array of shape (5,)
        Mean explained share over a grid of pixels, one for each of `WAVELENGTHS_PX`.
    """
    angle, _ = orientation(value, valid, 1.0, 6.0)
    smooth, support = smooth_along(value, valid, angle, 24, 10.0)
    height, width = value.shape
    rows, cols = np.mgrid[2 : height - 1 : max(3, height // 40), 2 : width - 1 : max(3, width // 60)]
    inside = valid[rows, cols]
    rows, cols = rows[inside], cols[inside]
    if rows.size == 0:
        return np.zeros(WAVELENGTHS_PX.size)
    response, explained = fit_bank(smooth, support, angle + np.pi / 2, rows, cols, 1.0 / WAVELENGTHS_PX, 48, 0.5)
    # Shading across a narrow strip (a round core, dark rims) is no ring: less than twice its length fits in.
    across = angle[rows, cols] + np.pi / 2
    wide, high = (np.maximum(np.abs(f(across)), 1e-3) for f in (np.cos, np.sin))
    room = np.minimum(width / wide, height / high)
    explained = np.where(room[:, None] >= LEAST_WAVES * WAVELENGTHS_PX, explained, 0.0)
    # A faint preference for contrast: among equally periodic scales the stronger one is the rings.
    power = (np.abs(response) ** 2).mean(axis=0)
    return np.asarray(explained.mean(axis=0) * (power / (power.max() + 1e-12)) ** 0.05, dtype=np.float64)


@dataclass(frozen=True)
class ScaleScores:
    """How periodic a scan is at wavelengths over its whole range.

    Attributes
    ----------
    wavelength_px : array of shape (C,)
        In scan px, each level of the pyramid one after the other; empty where the scan is too small to tell.
    score : array of shape (C,)
        Share of the contour-smoothed profile's variance that such a wave explains, 0..1.
    """

    wavelength_px: npt.NDArray[np.float64]
    score: npt.NDArray[np.float64]

    def with_other(self, other: ScaleScores) -> ScaleScores:
        """Scores of what is periodic in both of two signals of one scan: their geometric mean."""
        return ScaleScores(self.wavelength_px, np.sqrt(self.score * other.score))

    def near(self, scale_px: float) -> float:
        """Best score within half an octave of a scale; 0 without any."""
        close = np.abs(np.log2(self.wavelength_px / scale_px)) <= 0.6
        return float(self.score[close].max(initial=0.0))


def scale_scores(
    shape: tuple[int, int],
    window: Window,
    window_px: int = 320,
    thick_px: float | None = None,
) -> ScaleScores:
    """How periodic a signal of a scan is, from windows of a pyramid.

    Parameters
    ----------
    shape : tuple of two int
        Rows and columns of the scan.
    window : woodfit.grids.Window
        Parts of the scan.
    window_px : int
        Side of a window at its own level of the pyramid.
    thick_px : float, optional
        How thick the wood is at its thickest, where it does not fill the scan.

    Returns
    -------
    ScaleScores
    """
    height, width = shape
    candidates: list[tuple[float, float]] = []
    shorter = min(height, width) if thick_px is None else min(height, width, thick_px)
    step = 1
    while shorter / step >= 10 and max(height, width) / step >= 48:
        side = window_px * step
        scores = []
        for row in _starts(height, side):
            for col in _starts(width, side):
                value, valid = window(row, col, min(side, height), min(side, width), step)
                if valid.mean() > 0.05 and min(value.shape) >= 8:
                    scores.append((level_scores(value, valid), valid.mean()))
        if scores:
            score = np.average([s for s, _ in scores], axis=0, weights=[w for _, w in scores])
            longest = max(height, width) / 5.0
            # On a strip only a few pixels high nothing tells a ring from shading.
            score = score * min(1.0, shorter / (20.0 * step))
            candidates += [
                (float(w * step), float(s)) for s, w in zip(score, WAVELENGTHS_PX, strict=True) if w * step < longest
            ]
        step *= 2
    pairs = np.array(candidates, np.float64).reshape(-1, 2)
    return ScaleScores(pairs[:, 0], pairs[:, 1])


def ring_scale(shape: tuple[int, int], scores: ScaleScores) -> float:
    """Characteristic ring width of a scan of `shape`: where a wave explains most, by a parabola over log-wavelength.

    In scan px; an eighth of the longer side (8 px at least) where there are no scores.
    """
    best: dict[int, float] = {}
    for wavelength, score in zip(scores.wavelength_px.tolist(), scores.score.tolist(), strict=True):
        octave = round(2.0 * np.log2(wavelength))
        # Fewer waves fit into the scan the longer they are, so a long one explains the same share more easily;
        # below eight pixels pores and fibres do.
        best[octave] = max(best.get(octave, 0.0), score * wavelength**-0.05 * min(1.0, wavelength / 8.0) ** 0.2)
    if not best:
        return float(max(8.0, max(shape) / 8.0))
    top = max(best, key=lambda octave: best[octave])
    left, mid, right = (best.get(top + d, 0.0) for d in (-1, 0, 1))
    curve = left - 2.0 * mid + right
    shift = 0.5 * (left - right) / curve if curve < 0.0 else 0.0
    return float(2.0 ** ((top + np.clip(shift, -0.5, 0.5)) / 2.0))


def _starts(length: int, side: int) -> list[int]:
    """At most three window starts, spread evenly over `length`; one window in the middle of what is hardly longer."""
    count = min(3, max(1, round(length / side)))
    if count == 1:
        return [max(0, (length - side) // 2)]
    return [round(i * (length - side) / (count - 1)) for i in range(count)]


def reduce_by(image: npt.NDArray[Any], step: int) -> npt.NDArray[Any]:
    """Mean over blocks of `step` x `step`; what does not fill a block at the right and bottom is left out."""
    if step == 1:
        return image
    rows, cols = image.shape[0] // step * step, image.shape[1] // step * step
    size = (cols // step, rows // step)
    return np.asarray(cv2.resize(image[:rows, :cols], size, interpolation=cv2.INTER_AREA))
