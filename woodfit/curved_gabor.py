"""Curved Gabor filter, separable form (paper, Sec. 3.2; METHOD of the curved region).

The literal filter samples (2p+1) x (2q+1) points around each pixel; `woodfit.patch_gabor` keeps it as the
reference. Here the sum along the contours is done once for all pixels, so that 2p+1 + 2q+1 samples are left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit import frequency as frequency_field
from woodfit.streamlines import fit_across, smooth_along

FloatArray = npt.NDArray[np.float32]
ComplexArray = npt.NDArray[np.complex64]


@dataclass(frozen=True)
class Region:
    """Size and window of the curved region around a pixel.

    Attributes
    ----------
    p, q : int
        Steps of one pixel across and along the rings, to each side.
    sigma_along_px : float
        Standard deviation of the window along the rings.
    cycles : float
        Standard deviation of the window across the rings, in wavelengths.
    """

    p: int = 80
    q: int = 80
    sigma_along_px: float = 27.0
    cycles: float = 0.5


@dataclass(frozen=True)
class GaborField:
    """Result of the filter on an image of shape (M, N); angles in rad, frequency per pixel of the image."""

    response: ComplexArray
    explained: FloatArray
    normal: FloatArray
    asymmetry: FloatArray
    frequency: FloatArray
    curvature: FloatArray
    orientation: FloatArray


def respond(
    value: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    orientation: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    region: Region,
) -> tuple[ComplexArray, FloatArray]:
    """Centre response of the curved Gabor filter at every pixel, for a given field of frequency.

    Parameters
    ----------
    value, valid, orientation, frequency : arrays of shape (M, N)
        Grey values, wood mask, ring tangent in rad (the phase grows towards tangent + 90 degrees), cycles per pixel.
    region : Region
        The curved region.

    Returns
    -------
    response : complex64 array of shape (M, N)
        Unit gain for a sinusoid of unit amplitude.
    explained : float32 array of shape (M, N)
        Share of the local variance across the rings that the response explains.
    """
    smooth, support = smooth_along(value, valid, orientation, region.q, region.sigma_along_px)
    return _fit_everywhere(smooth, support, np.asarray(orientation) + np.pi / 2, frequency, region)


def _fit_everywhere(
    smooth: FloatArray, support: FloatArray, normal: npt.NDArray[Any], frequency: npt.NDArray[Any], region: Region
) -> tuple[ComplexArray, FloatArray]:
    height, width = smooth.shape
    rows, cols = np.divmod(np.arange(height * width), width)
    per_pixel = np.asarray(frequency, np.float32).reshape(-1, 1)
    response, explained = fit_across(smooth, support, normal, rows, cols, per_pixel, region.p, region.cycles)
    return response.reshape(height, width), explained.reshape(height, width)


def halo(ring_scale_px: float, region: Region) -> int:
    """Margin in pixels beyond which nothing influences `curved_gabor`, both passes."""
    cell = grid_step(ring_scale_px)
    pool = math.ceil(2.5 * ring_scale_px) + cell * (frequency_field.ROUNDS + 2)
    one_pass = region.p + region.q + pool
    return 2 * one_pass + math.ceil(3.0 * 1.5 * ring_scale_px) + 8


def grid_step(ring_scale_px: float) -> int:
    """Spacing in pixels of the grid on which the frequency is sought: a power of two, so that tiles align."""
    return int(2 ** np.clip(round(math.log2(ring_scale_px / 5.0)), 0, 4))


def curved_gabor(
    value: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    orientation: npt.NDArray[Any],
    ring_scale_px: float,
    region: Region,
    shortest_px: float,
    longest_px: float,
) -> GaborField:
    """Frequency, phase and refined orientation of the rings.

    Two passes: the first follows the gradient's orientation, the second the orientation of the first one's phase.

    Parameters
    ----------
    value, valid, orientation : arrays of shape (M, N)
        Grey values, wood mask, ring tangent in rad.
    ring_scale_px : float
        Characteristic ring width in pixels of this image.
    region : Region
        The curved region.
    shortest_px, longest_px : float
        Range of ring widths looked for.

    Returns
    -------
    GaborField
        Of the image's shape.
    """
    bank = frequency_field.log_bank(shortest_px, longest_px, per_octave=5)
    angle = np.asarray(orientation, np.float32)
    for turn in range(2):
        smooth, support = smooth_along(value, valid, angle, region.q, region.sigma_along_px)
        normal = angle + np.float32(np.pi / 2)
        frequency = find_frequency(smooth, support, normal, bank, ring_scale_px, region)
        response, explained = _fit_everywhere(smooth, support, normal, frequency, region)
        if turn == 0:
            angle = refine_orientation(response, explained, normal, frequency, 0.35 * ring_scale_px)
    signed, asymmetry = growth_normal(smooth, support, angle, ring_scale_px)
    flip = np.cos(signed - normal) < 0.0
    response = np.where(flip, response.conj(), response).astype(np.complex64)
    return GaborField(
        response=response,
        explained=explained * np.minimum(support / 0.5, 1.0),
        normal=signed,
        asymmetry=asymmetry,
        frequency=frequency,
        curvature=curvature(angle, 0.3 * ring_scale_px),
        orientation=angle,
    )


def find_frequency(
    smooth: FloatArray,
    support: FloatArray,
    normal: FloatArray,
    bank: FloatArray,
    ring_scale_px: float,
    region: Region,
) -> FloatArray:
    """Smooth field of ring frequency (cycles per pixel) of a contour-smoothed image of shape (M, N)."""
    height, width = smooth.shape
    step = grid_step(ring_scale_px)
    grid_rows = np.minimum(np.arange(0, height + step - 1, step), height - 1)
    grid_cols = np.minimum(np.arange(0, width + step - 1, step), width - 1)
    rows, cols = (a.ravel() for a in np.meshgrid(grid_rows, grid_cols, indexing="ij"))
    frequencies = np.broadcast_to(bank, (rows.size, bank.size))
    response, explained = fit_across(smooth, support, normal, rows, cols, frequencies, region.p, region.cycles)
    # Amplitude alone prefers shading, the explained share alone prefers noise: rings have both. The bell over
    # log-frequency is a faint reminder of the scan's own scale where there is no evidence at all.
    prior = np.exp(-0.5 * (np.log2(bank * ring_scale_px) / 2.0) ** 2)
    evidence = np.abs(response) ** 2 * explained * prior
    evidence = evidence.T.reshape(bank.size, grid_rows.size, grid_cols.size)
    ring_cells = ring_scale_px / step
    chosen, _ = frequency_field.smooth_frequency(evidence, bank, 0.8 * ring_cells, 0.15 / ring_cells)
    sigma = 0.5 * ring_scale_px / step
    size = 2 * math.ceil(3.0 * sigma) + 1
    chosen = np.exp(cv2.GaussianBlur(np.log(chosen), (size, size), sigma, borderType=cv2.BORDER_REFLECT_101))
    map_x, map_y = np.meshgrid(
        np.arange(width, dtype=np.float32) / step, np.arange(height, dtype=np.float32) / step
    )
    return np.asarray(cv2.remap(chosen, map_x, map_y, cv2.INTER_LINEAR), dtype=np.float32)


def refine_orientation(
    response: ComplexArray, explained: FloatArray, normal: FloatArray, frequency: FloatArray, window_px: float
) -> FloatArray:
    """Ring tangent (rad, 0..pi) from the gradient of the phase, averaged as a doubled angle.

    The phase grows along `normal`, which is only defined up to its sign, so neighbours whose normals oppose are
    compared through the conjugate.
    """

    def change(axis: int) -> FloatArray:
        ahead = np.roll(response, -1, axis)
        behind = np.roll(response, 1, axis)
        for other in (ahead, behind):
            opposed = np.cos(np.roll(normal, -1 if other is ahead else 1, axis) - normal) < 0.0
            other[opposed] = other[opposed].conj()
        rate = np.angle(ahead * behind.conj()) / 2.0
        # Neighbours across the picture's edge are not neighbours.
        np.moveaxis(rate, axis, 0)[[0, -1]] = 0.0
        return np.asarray(rate, dtype=np.float32)

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
    smooth: FloatArray, support: FloatArray, orientation: FloatArray, ring_scale_px: float
) -> tuple[FloatArray, FloatArray]:
    """Direction towards the bright side of the abrupt edge of each ring.

    A ring darkens slowly and brightens abruptly, so the cube of the slope across the rings, averaged over more
    than a ring, keeps the sign of the abrupt edge, and as a vector it does not depend on which of the two normals
    the slope was taken along.

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
    slope = (cv2.Scharr(image, cv2.CV_32F, 1, 0) * nx + cv2.Scharr(image, cv2.CV_32F, 0, 1) * ny) * (support > 0.3)
    cube = slope**3
    window = 1.5 * ring_scale_px
    reach = 2 * math.ceil(3.0 * window) + 1

    def blur(a: FloatArray) -> FloatArray:
        return np.asarray(
            cv2.GaussianBlur(a, (reach, reach), window, borderType=cv2.BORDER_REFLECT_101), dtype=np.float32
        )

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
