"""Local orientation of the rings from the image gradient (paper, Sec. 3.2)."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.grids import block_mean, enlarged

FloatArray = npt.NDArray[np.float32]

#: Weight of a circle around a pith that is seen, beside that of the gradients.
_CIRCLE = 0.3


def _blur(image: npt.NDArray[Any], sigma_px: float) -> FloatArray:
    """Gaussian with reflected borders, truncated at three standard deviations."""
    size = 2 * math.ceil(3.0 * sigma_px) + 1
    return np.asarray(
        cv2.GaussianBlur(image, (size, size), sigma_px, borderType=cv2.BORDER_REFLECT_101), dtype=np.float32
    )


#: Gaussian before the gradient and window of the broad look at wood with rays, in window widths of the fine one.
_BROAD_GRADIENT, _BROAD_WINDOW = 0.5, 4.4


#: Window over which a steady slope is shading, in window widths: over a ring or more theirs cancel.
_SHADING = 2.0


def halo(gradient_sigma_px: float, window_sigma_px: float, rays: bool = False) -> int:
    """Margin in pixels beyond which nothing influences `orientation`."""
    fine = math.ceil(3.0 * gradient_sigma_px)
    for window in (window_sigma_px, _SHADING * window_sigma_px):
        fine += math.ceil(3.0 * window) + 4 * _window_step(window)
    if not rays:
        return fine
    gradient, window = _BROAD_GRADIENT * window_sigma_px, _BROAD_WINDOW * window_sigma_px
    return fine + math.ceil(3.0 * gradient) + math.ceil(3.0 * window) + 4 * _window_step(window)


def _window_step(window_sigma_px: float) -> int:
    """Pixels per cell of the grid on which the window is applied: a power of two, so that tiles align.

    A window that is four cells wide does not see single pixels.
    """
    return int(2 ** np.clip(math.floor(math.log2(window_sigma_px / 4.0)), 0, 4))


def orientation(
    value: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    gradient_sigma_px: float,
    window_sigma_px: float,
    pith: tuple[float, float] | None = None,
    rays: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Orientation of the ring boundaries and its coherence.

    The doubled angle of the gradient is averaged (the structure tensor), since an orientation has no sign; the
    result is turned by 90 degrees so that it runs along the rings.

    Parameters
    ----------
    value : array of shape (M, N)
        Grey values.
    valid : bool array of shape (M, N)
        False where there is no wood; gradients there and next to it do not count.
    gradient_sigma_px : float
        Gaussian before the Scharr operator.
    window_sigma_px : float
        Gaussian window of the average.
    pith : x, y in px, optional
        Where the pith is seen, edges count by the fourth power of the cosine between their gradient and the radius:
        saw marks, cracks, stain and rays run along it.
    rays : bool
        True where rays may be as strong as the rings, as on wood with large vessels. They stand across the rings and
        are narrower: a broad look, which they do not survive, tells which of the two an edge belongs to, and an edge of
        a ray then counts for the direction across it.

    Returns
    -------
    angle : float32 array of shape (M, N)
        Tangent in radians, 0..pi, from +x towards +y.
    coherence : float32 array of shape (M, N)
        0 (no orientation) to 1 (a single one).

    References
    ----------
    Bigun and Granlund, "Optimal orientation detection of linear symmetry", ICCV 1987.
    """
    gx, gy = _unshaded(*_gradient(value, valid, gradient_sigma_px), _SHADING * window_sigma_px)
    if pith is not None:
        away_x = np.arange(value.shape[1], dtype=np.float32)[None, :] - np.float32(pith[0])
        away_y = np.arange(value.shape[0], dtype=np.float32)[:, None] - np.float32(pith[1])
        length = (gx * gx + gy * gy) * (away_x * away_x + away_y * away_y)
        radial = (gx * away_x + gy * away_y) ** 2 / np.maximum(length, 1e-20)
        gx, gy = gx * radial, gy * radial
    cos2, sin2, energy = gx * gx - gy * gy, 2.0 * gx * gy, gx * gx + gy * gy
    if rays and pith is None:
        bx, by = _gradient(value, valid, _BROAD_GRADIENT * window_sigma_px)
        broad = _BROAD_WINDOW * window_sigma_px
        along = cos2 * _pooled(bx * bx - by * by, broad) + sin2 * _pooled(2.0 * bx * by, broad)
        sign = np.where(along < 0.0, np.float32(-1.0), np.float32(1.0))
        cos2, sin2 = cos2 * sign, sin2 * sign
    cos2, sin2, energy = (_pooled(a, window_sigma_px) for a in (cos2, sin2, energy))
    if pith is not None:
        # And a circle is the first guess.
        turn = 2.0 * np.arctan2(away_y, away_x)
        cos2 += _CIRCLE * energy * np.cos(turn)
        sin2 += _CIRCLE * energy * np.sin(turn)
    angle = (0.5 * np.arctan2(sin2, cos2) + 0.5 * np.pi) % np.pi
    coherence = np.hypot(cos2, sin2) / np.maximum(energy, 1e-12)
    return angle.astype(np.float32), np.clip(coherence, 0.0, 1.0).astype(np.float32)


def _gradient(value: npt.NDArray[Any], valid: npt.NDArray[np.bool_], sigma_px: float) -> tuple[FloatArray, FloatArray]:
    """Slopes along x and y of an image smoothed by a Gaussian; 0 off the wood and at its edge."""
    wood = valid.astype(np.float32)
    # Off the wood the grey value is continued from the wood beside it, so that the edge of the board is not a ring.
    mass = _blur(wood, sigma_px)
    smooth = _blur(np.asarray(value, np.float32) * wood, sigma_px) / np.maximum(mass, 1e-3)
    margin = 2 * math.ceil(sigma_px) + 3
    inside = wood if valid.all() else cv2.erode(wood, np.ones((margin, margin), np.uint8))
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=1.0 / 32.0) * inside
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=1.0 / 32.0) * inside
    return gx, gy


def _unshaded(gx: FloatArray, gy: FloatArray, sigma_px: float) -> tuple[FloatArray, FloatArray]:
    """Slopes less their mean about: across rings that is nothing, and light falling off is left out.

    A round core is darker at its rims than its rings are in their latewood.
    """
    wood = ((gx != 0.0) | (gy != 0.0)).astype(np.float32)
    mass = np.maximum(_pooled(wood, sigma_px), 1e-3)
    return gx - wood * _pooled(gx, sigma_px) / mass, gy - wood * _pooled(gy, sigma_px) / mass


def _pooled(image: FloatArray, sigma_px: float) -> FloatArray:
    """Gaussian window of the average, on a grid that is coarse for a wide one."""
    step = _window_step(sigma_px)
    return enlarged(_blur(block_mean(image, step), sigma_px / step), step, image.shape)
