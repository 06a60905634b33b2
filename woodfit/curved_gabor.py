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
from woodfit.grids import between, grid_step
from woodfit.ring_direction import curvature, growth_normal, refine_orientation
from woodfit.streamlines import grown, smooth_along
from woodfit.wave_bank import fit_bank
from woodfit.wave_fit import fit_across

FloatArray = npt.NDArray[np.float32]
ComplexArray = npt.NDArray[np.complex64]

#: The first pass is asked at every so many pixels: the direction of the rings, which it is for, is smooth.
_FIRST_STRIDE = 2
#: The wave is fitted this far off the wood too, so that its phase has neighbours up to the edge.
_RIM_PX = 3


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
    spread_octaves : float
        How far the rings' widths are expected to lie from the characteristic one: standard deviation.
    """

    p: int = 80
    q: int = 80
    sigma_along_px: float = 27.0
    cycles: float = 0.5
    spread_octaves: float = 2.0


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
        Share of the local variance across the rings that the response explains; both are 0 off the wood.
    """
    smooth, support = smooth_along(value, valid, orientation, region.q, region.sigma_along_px)
    return _fit_everywhere(smooth, support, np.asarray(orientation) + np.pi / 2, frequency, region, valid)


def _fit_everywhere(
    smooth: FloatArray,
    support: FloatArray,
    normal: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    region: Region,
    valid: npt.NDArray[np.bool_],
    stride: int = 1,
) -> tuple[ComplexArray, FloatArray]:
    """The wave at every `stride`-th pixel on and next to the wood."""
    chosen = grown(valid, _RIM_PX)[::stride, ::stride]
    rows, cols = np.nonzero(chosen)
    response = np.zeros(chosen.shape, np.complex64)
    explained = np.zeros(chosen.shape, np.float32)
    per_pixel = np.asarray(frequency)[::stride, ::stride][chosen]
    response[chosen], explained[chosen] = fit_across(
        smooth, support, normal, rows * stride, cols * stride, per_pixel, region.p, region.cycles
    )
    return response, explained


def halo(ring_scale_px: float, region: Region) -> int:
    """Margin in pixels beyond which nothing influences `curved_gabor`, both passes."""
    cell = grid_step(ring_scale_px)
    pool = math.ceil(2.5 * ring_scale_px) + cell * (frequency_field.ROUNDS + 2)
    one_pass = region.p + region.q + pool
    # The last term is for what is interpolated or rounded up.
    return 2 * one_pass + math.ceil(3.0 * 1.5 * ring_scale_px) + 16


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
    wood = np.asarray(valid, np.bool_)
    bank = frequency_field.log_bank(shortest_px, longest_px, per_octave=5)
    search = (value, wood, bank, ring_scale_px, region)
    first = _one_pass(np.asarray(orientation, np.float32), *search, _FIRST_STRIDE)
    angle = _tangent(first, wood, ring_scale_px, _FIRST_STRIDE)
    wave = _one_pass(angle, *search, 1)
    signed, asymmetry = growth_normal(wave.smooth, wood & (wave.support > 0.3), angle, ring_scale_px)
    flip = np.cos(signed - wave.normal) < 0.0
    response = np.where(flip, wave.response.conj(), wave.response).astype(np.complex64)
    return GaborField(
        response=response,
        explained=wave.explained * np.minimum(wave.support / 0.5, 1.0),
        normal=signed,
        asymmetry=asymmetry,
        frequency=wave.frequency,
        curvature=curvature(angle, 0.3 * ring_scale_px),
        orientation=angle,
    )


@dataclass(frozen=True)
class _Wave:
    """What one pass of the filter finds along the orientation that it is given."""

    smooth: FloatArray
    support: FloatArray
    normal: FloatArray
    frequency: FloatArray
    response: ComplexArray
    explained: FloatArray


def _one_pass(
    angle: FloatArray,
    value: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    bank: FloatArray,
    ring_scale_px: float,
    region: Region,
    stride: int,
) -> _Wave:
    """The wave at every `stride`-th pixel; all else at all pixels."""
    smooth, support = smooth_along(value, valid, angle, region.q, region.sigma_along_px)
    normal = angle + np.float32(np.pi / 2)
    frequency = find_frequency(smooth, support, normal, bank, ring_scale_px, region, valid)
    response, explained = _fit_everywhere(smooth, support, normal, frequency, region, valid, stride)
    return _Wave(smooth, support, normal, frequency, response, explained)


def _tangent(wave: _Wave, valid: npt.NDArray[np.bool_], ring_scale_px: float, stride: int) -> FloatArray:
    """Ring tangent (rad, 0..pi) at every pixel from a wave known at every `stride`-th."""
    some = (slice(None, None, stride), slice(None, None, stride))
    window = 0.35 * ring_scale_px / stride
    tangent = refine_orientation(
        wave.response, wave.explained * valid[some], wave.normal[some], wave.frequency[some] * stride, window
    )
    if stride == 1:
        return tangent
    cos2, sin2 = (between(turn(2.0 * tangent), stride, valid.shape) for turn in (np.cos, np.sin))
    return np.asarray((0.5 * np.arctan2(sin2, cos2)) % np.pi, dtype=np.float32)


def find_frequency(
    smooth: FloatArray,
    support: FloatArray,
    normal: FloatArray,
    bank: FloatArray,
    ring_scale_px: float,
    region: Region,
    valid: npt.NDArray[np.bool_],
) -> FloatArray:
    """Smooth field of ring frequency (cycles per pixel) of a contour-smoothed image of shape (M, N)."""
    height, width = smooth.shape
    step = grid_step(ring_scale_px)
    grid_rows = np.minimum(np.arange(0, height + step - 1, step), height - 1)
    grid_cols = np.minimum(np.arange(0, width + step - 1, step), width - 1)
    rows, cols = np.nonzero(valid[np.ix_(grid_rows, grid_cols)])
    response, explained = fit_bank(
        smooth, support, normal, grid_rows[rows], grid_cols[cols], bank, region.p, region.cycles
    )
    # Amplitude alone prefers shading, the explained share alone prefers noise: rings have both. The bell over
    # log-frequency is a faint reminder of the scan's own scale where there is no evidence at all.
    prior = np.exp(-0.5 * (np.log2(bank * ring_scale_px) / region.spread_octaves) ** 2)
    evidence = np.zeros((bank.size, grid_rows.size, grid_cols.size), np.float32)
    evidence[:, rows, cols] = ((response.real**2 + response.imag**2) * explained * prior).T
    ring_cells = ring_scale_px / step
    chosen, _ = frequency_field.smooth_frequency(evidence, bank, 0.8 * ring_cells, 0.15 / ring_cells)
    sigma = 0.5 * ring_scale_px / step
    size = 2 * math.ceil(3.0 * sigma) + 1
    chosen = np.exp(cv2.GaussianBlur(np.log(chosen), (size, size), sigma, borderType=cv2.BORDER_REFLECT_101))
    return between(np.asarray(chosen, np.float32), step, smooth.shape)
