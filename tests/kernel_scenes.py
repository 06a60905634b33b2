"""Ideal wood for the tests of the kernels: gratings, concentric rings, a log cut by a plane."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from woodfit.curved_gabor import GaborField, Region, curved_gabor
from woodfit.streamlines import FloatArray
from woodfit.structure_tensor import orientation

Array = NDArray[np.float64]
Image = NDArray[np.float32]

SHARED = Path(os.environ.get("WOODPIPE_SHARED", Path(__file__).resolve().parents[2] / "shared"))
needs_shared = pytest.mark.skipif(not (SHARED / "data" / "scans").is_dir(), reason="no folder of real scans")


def pixels(shape: tuple[int, int]) -> tuple[Array, Array]:
    """x and y of every pixel."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    return x, y


def straight(shape: tuple[int, int], width: float, tangent: float, shift: float = 0.0) -> Array:
    """Ring age of parallel rings of `width` px that run along `tangent` (rad); it grows towards tangent + 90 deg."""
    x, y = pixels(shape)
    return np.asarray((-np.sin(tangent) * x + np.cos(tangent) * y) / width + shift)


def round_age(shape: tuple[int, int], center: tuple[float, float], width: float) -> tuple[Array, Array]:
    """Ring age of circles about `center` (x, y), and the outward direction in rad."""
    x, y = pixels(shape)
    return np.hypot(x - center[0], y - center[1]) / width, np.arctan2(y - center[1], x - center[0])


def wave(age: Array, amplitude: float = 0.2, mean: float = 0.5, phase: float = 0.0) -> Image:
    """Grey values ``mean + amplitude cos(2 pi age + phase)``."""
    return np.asarray(mean + amplitude * np.cos(2 * np.pi * age + phase), dtype=np.float32)


def conifer(age: Array, blur_px: float = 0.7) -> Image:
    """Slow darkening through each ring and an abrupt brightening at its outer boundary."""
    return np.asarray(gaussian_filter(0.8 - 0.4 * np.mod(age, 1.0) ** 2, blur_px), dtype=np.float32)


def wood(shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Everything is wood."""
    return np.ones(shape, np.bool_)


def noise(shape: tuple[int, int], sigma: float, seed: int = 0) -> Image:
    """White noise."""
    return np.asarray(np.random.default_rng(seed).normal(0.0, sigma, shape), dtype=np.float32)


def angle_between(a: Array, b: Array) -> Array:
    """Absolute difference of two orientations (rad, no sign), 0..pi/2."""
    turn = np.mod(np.asarray(a, float) - b, np.pi)
    return np.asarray(np.minimum(turn, np.pi - turn))


def wrapped(angle: Array) -> Array:
    """Angle in rad brought to -pi..pi."""
    return np.asarray(np.angle(np.exp(1j * np.asarray(angle, float))))


def correlation(a: NDArray[np.complex64], b: NDArray[np.complex64]) -> float:
    """Size of the complex correlation of two responses."""
    return float(abs(np.vdot(a, b)) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real))


def field_of(value: Image, scale: float) -> tuple[GaborField, FloatArray]:
    """Answer of the curved Gabor filter for rings of about `scale` px, and the orientation it followed."""
    angle, _ = orientation(value, wood(value.shape), 1.0, 0.5 * scale)
    return curved_gabor(value, wood(value.shape), angle, scale, Region(40, 40, 13.0), 5.0, 60.0), angle
