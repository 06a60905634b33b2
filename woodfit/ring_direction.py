"""Direction of the rings from the filter's phase, of growth from their profile, and how the rings bend."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.grids import Window, block_mean, enlarged, grid_step
from woodfit.structure_tensor import orientation

FloatArray = npt.NDArray[np.float32]
ComplexArray = npt.NDArray[np.complex64]


def refine_orientation(
    response: ComplexArray, explained: FloatArray, normal: FloatArray, frequency: FloatArray, window_px: float
) -> FloatArray:
    """Ring tangent (rad, 0..pi) from the gradient of the phase, averaged as a doubled angle.

    The phase grows along `normal`, which is only defined up to its sign, so neighbours whose normals oppose are
    compared through the conjugate.
    """
    nx, ny = np.cos(normal), np.sin(normal)

    def change(axis: int) -> FloatArray:
        wave, x, y = (np.moveaxis(a, axis, 0) for a in (response, nx, ny))
        opposed = x[1:] * x[:-1] + y[1:] * y[:-1] < 0.0
        ahead = np.where(opposed, wave[1:].conj(), wave[1:]) * wave[:-1].conj()
        # From each pixel to the next, and the same seen from the next.
        turn = np.arctan2(ahead.imag, ahead.real)
        back = np.where(opposed, -turn, turn)
        # At the picture's edge there is a neighbour on one side only.
        rate = 0.5 * (np.concatenate([turn, back[-1:]]) + np.concatenate([turn[:1], back]))
        return np.asarray(np.moveaxis(rate, 0, axis), dtype=np.float32)

    gx, gy = change(1), change(0)
    power = np.hypot(gx, gy)
    # Confident places lead; a phase that turns much faster or slower than the frequency is a tear.
    expected = 2.0 * np.pi * frequency
    fits = np.exp(-2.0 * np.log(np.maximum(power, 1e-6) / expected) ** 2)
    weight = explained**2 * fits / np.maximum(power * power, 1e-12)
    blank = power < 1e-6
    weight[blank] = 0.0
    size = 2 * math.ceil(3.0 * window_px) + 1

    def blur(a: FloatArray) -> FloatArray:
        return np.asarray(
            cv2.GaussianBlur(a, (size, size), window_px, borderType=cv2.BORDER_REFLECT_101), dtype=np.float32
        )

    tangent = normal - np.pi / 2
    faint = 1e-3
    cos2 = blur((weight * (gx * gx - gy * gy)).astype(np.float32)) - faint * np.cos(2.0 * tangent)
    sin2 = blur((weight * 2.0 * gx * gy).astype(np.float32)) - faint * np.sin(2.0 * tangent)
    return np.asarray((0.5 * np.arctan2(sin2, cos2) + 0.5 * np.pi) % np.pi, dtype=np.float32)


def growth_normal(
    smooth: FloatArray, counted: npt.NDArray[np.bool_], orientation: FloatArray, ring_scale_px: float
) -> tuple[FloatArray, FloatArray]:
    """Direction towards the bright side of the abrupt edge of each ring.

    A ring darkens slowly and brightens abruptly, so the cube of the slope across the rings, averaged over more
    than a ring, keeps the sign of the abrupt edge, and as a vector it does not depend on which of the two normals
    the slope was taken along. Only the slopes of `counted` pixels take part.

    Returns
    -------
    normal : float32 array of shape (M, N)
        Direction in rad, -pi..pi.
    asymmetry : float32 array of shape (M, N)
        0 where both directions look alike, 1 where every steep edge has the same sign.
    """
    nx, ny = -np.sin(orientation), np.cos(orientation)
    sigma = max(0.7, 0.04 * ring_scale_px)
    size = 2 * math.ceil(3.0 * sigma) + 1
    image = cv2.GaussianBlur(smooth, (size, size), sigma, borderType=cv2.BORDER_REFLECT_101)
    slope = (cv2.Scharr(image, cv2.CV_32F, 1, 0) * nx + cv2.Scharr(image, cv2.CV_32F, 0, 1) * ny) * counted
    cube = slope * slope * slope
    # So wide a window does not see single pixels.
    step = grid_step(ring_scale_px)
    window = 1.5 * ring_scale_px / step
    reach = 2 * math.ceil(3.0 * window) + 1

    def blur(a: FloatArray) -> FloatArray:
        coarse = block_mean(a, step)
        wide = cv2.GaussianBlur(coarse, (reach, reach), window, borderType=cv2.BORDER_REFLECT_101)
        return enlarged(np.asarray(wide, np.float32), step, smooth.shape)

    vx, vy, total = blur(cube * nx), blur(cube * ny), blur(np.abs(cube))
    along = vx * nx + vy * ny
    sign = np.where(along < 0.0, -1.0, 1.0)
    return (
        np.arctan2(sign * ny, sign * nx).astype(np.float32),
        np.clip(np.abs(along) / np.maximum(total, 1e-20), 0.0, 1.0).astype(np.float32),
    )


def curvature(orientation: FloatArray, sigma_px: float) -> FloatArray:
    """Absolute curvature (1/px) of the contours of an orientation field: how fast the tangent turns along itself."""
    size = 2 * math.ceil(3.0 * sigma_px) + 1
    cos2, sin2 = (
        cv2.GaussianBlur(a, (size, size), sigma_px, borderType=cv2.BORDER_REFLECT_101)
        for a in (np.cos(2.0 * orientation), np.sin(2.0 * orientation))
    )
    turn_x = cos2 * cv2.Scharr(sin2, cv2.CV_32F, 1, 0) - sin2 * cv2.Scharr(cos2, cv2.CV_32F, 1, 0)
    turn_y = cos2 * cv2.Scharr(sin2, cv2.CV_32F, 0, 1) - sin2 * cv2.Scharr(cos2, cv2.CV_32F, 0, 1)
    length = np.maximum(cos2 * cos2 + sin2 * sin2, 1e-6)
    turn = (turn_x * np.cos(orientation) + turn_y * np.sin(orientation)) / (32.0 * length)
    return np.asarray(np.abs(turn / 2.0), dtype=np.float32)


#: Mean square of the coherence below which bends are those of noise and of rays: 0.05 on an end grain of red oak full
#: of rays, 0.16 and above on eight other scans of ring-porous wood.
_NOISE = 0.1


def straight_run(
    shape: tuple[int, int],
    window: Window,
    ring_scale_px: float,
    step: int,
    window_px: int = 384,
    thick_px: float | None = None,
    rays: bool = False,
) -> float:
    """How far rings may be followed before their bends matter, from windows of a scan.

    Parameters
    ----------
    shape : tuple of two int
        Rows and columns of the scan.
    window : woodfit.grids.Window
        Parts of the scan.
    ring_scale_px : float
        Characteristic ring width in scan px.
    step : int
        Scan px per analysed px.
    window_px : int
        Side of a window, analysed px.
    thick_px : float, optional
        How thick the wood is at its thickest, in scan px, where it does not fill the scan.
    rays : bool
        As in `woodfit.structure_tensor.orientation`; only heeded where hardly anything is coherent without it, since it
        blunts bends.

    Returns
    -------
    float
        In scan px: a twelfth of the radius that nine tenths of the contours exceed, over which a circle leaves its
        tangent by less than a third of a hundredth of that radius; at most a quarter of the wood's thickness.
    """
    ring = ring_scale_px / step
    looks = _windows(shape, window, window_px * step, step)
    bend, weight = _bends(looks, ring, rays=False)
    if rays and weight.sum() < _NOISE * np.count_nonzero(weight):
        bend, weight = _bends(looks, ring, rays=True)
    shorter = 0.25 * (min(shape) if thick_px is None else thick_px)
    if not bend.size:
        return float(shorter)
    order = np.argsort(bend)
    total = np.cumsum(weight[order])
    sharp = bend[order][min(np.searchsorted(total, 0.9 * total[-1]), len(bend) - 1)]
    return float(min(shorter, 0.08 * step / max(float(sharp), 1e-6)))


def _windows(
    shape: tuple[int, int], window: Window, side: int, step: int
) -> list[tuple[FloatArray, npt.NDArray[np.bool_]]]:
    """Up to nine windows of a scan with wood in them: each is read once, since that takes long on a large scan."""
    height, width = shape
    looks = []
    for row in sorted({max(0, int(part * (height - side))) for part in (0.0, 0.5, 1.0)}):
        for col in sorted({max(0, int(part * (width - side))) for part in (0.0, 0.5, 1.0)}):
            value, valid = window(row, col, min(side, height), min(side, width), step)
            if min(value.shape) >= 8 and valid.mean() >= 0.05:
                looks.append((value, valid))
    return looks


def _bends(
    looks: list[tuple[FloatArray, npt.NDArray[np.bool_]]], ring_px: float, rays: bool
) -> tuple[FloatArray, FloatArray]:
    """Curvature of the contours (1/px, analysed) and its weight at all pixels of windows."""
    bends, weights = [np.zeros(0, np.float32)], [np.zeros(0, np.float32)]
    for value, valid in looks:
        angle, coherence = orientation(value, valid, max(0.8, 0.12 * ring_px), max(3.0, 0.8 * ring_px), rays=rays)
        bends.append(curvature(angle, 0.3 * ring_px).ravel())
        weights.append((coherence * coherence * valid).ravel())
    return np.concatenate(bends), np.concatenate(weights)
