"""Curved Gabor filter: the separable form against the literal one and against a bank of straight filters.

``python benchmarks/curved_gabor_speed.py`` prints ratios of one run; it fails where one is too low.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from woodfit import patch_gabor
from woodfit.curved_gabor import Region, curved_gabor, respond
from woodfit.structure_tensor import orientation
from woodfit.synthetic_scenes import scene

SHARED = Path(os.environ.get("WOODPIPE_SHARED", Path(__file__).resolve().parents[2] / "shared"))
DISC = SHARED / "data" / "scans" / "discs" / "F02b.png"

REGION = Region(p=80, q=80)
CONFIDENT = 0.5
ORIENTATIONS, FREQUENCIES, KERNEL_PX = 16, 9, 161
ROUNDS = 3
LITERAL_AT_LEAST, CORRELATION_AT_LEAST, BANK_AT_LEAST = 40.0, 0.98, 1.0

FloatArray = npt.NDArray[np.float32]
T = TypeVar("T")


def board() -> FloatArray:
    """HSV value of a synthetic cathedral board, 0..1, shape (735, 750)."""
    return np.asarray(scene("cathedral", (735, 750), 1).face.rgb_encoded.max(axis=-1) / 255.0, dtype=np.float32)


def crop(side: int = 256) -> tuple[str, FloatArray]:
    """Name and HSV value (0..1, square of `side` px) of a piece of a real disc, or of a synthetic one without it."""
    pixels = cv2.imread(str(DISC)) if DISC.is_file() else None
    if pixels is None:
        name, pixels = "synthetic end grain", scene("end_grain_off", (side, side), 0).face.rgb_encoded
    else:
        top = pixels.shape[0] // 3 - side // 2
        name, pixels = DISC.name, pixels[top : top + side, top : top + side]
    return name, np.asarray(pixels.max(axis=-1) / 255.0, dtype=np.float32)


def seconds(call: Callable[[], T], repeats: int = 1) -> tuple[float, T]:
    """Shortest of `repeats` wall-clock times of a call, and its last result."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - start)
    return min(times), result


def straight_bank(value: FloatArray, shortest_px: float = 8.0, longest_px: float = 48.0) -> FloatArray:
    """Greatest magnitude over a bank of straight complex Gabor filters, by `cv2.filter2D`."""
    best = np.zeros_like(value)
    for theta in np.arange(ORIENTATIONS) * np.pi / ORIENTATIONS:
        for wavelength in np.geomspace(shortest_px, longest_px, FREQUENCIES):
            even, odd = (
                cv2.filter2D(
                    value,
                    cv2.CV_32F,
                    cv2.getGaborKernel(
                        (KERNEL_PX, KERNEL_PX), REGION.cycles * wavelength, theta, wavelength, 1.0, psi, cv2.CV_32F
                    ),
                )
                for psi in (0.0, -np.pi / 2)
            )
            np.maximum(best, cv2.magnitude(even, odd), out=best)
    return best


def against_literal() -> tuple[float, float]:
    """Speed ratio and complex correlation of `respond` and the literal patch form on one 256 x 256 crop."""
    name, value = crop()
    valid = np.ones(value.shape, np.bool_)
    angle, _ = orientation(value, valid, 1.0, 10.0)
    field = curved_gabor(value, valid, angle, 20.0, REGION, 5.0, 80.0)
    inputs = (value, valid, field.orientation, field.frequency, REGION)
    patch_gabor.respond(*inputs, np.array([128]), np.array([128]))
    fast_s, (fast, explained) = seconds(lambda: respond(*inputs), repeats=5)
    literal_s, literal = seconds(lambda: patch_gabor.respond(*inputs))
    a, b = fast[explained >= CONFIDENT], literal[explained >= CONFIDENT]
    alike = float(abs(np.vdot(a, b)) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real))
    print(f"256 x 256 of {name}, p = q = 80, confident pixels {a.size / value.size:.0%}")
    print(f"  literal patch form      {literal_s:7.2f} s")
    print(f"  separable form          {fast_s:7.3f} s    ratio {literal_s / fast_s:.0f} (>= {LITERAL_AT_LEAST:.0f})")
    print(f"  complex correlation     {alike:7.4f}      (>= {CORRELATION_AT_LEAST})")
    return literal_s / fast_s, alike


def against_bank() -> tuple[float, float]:
    """Speed ratios of `respond` and of the whole of `curved_gabor` to a bank of straight filters, 750 x 735."""
    value = board()
    valid = np.ones(value.shape, np.bool_)
    angle, _ = orientation(value, valid, 1.0, 10.0)
    field = curved_gabor(value, valid, angle, 20.0, REGION, 5.0, 80.0)
    calls: tuple[Callable[[], object], ...] = (
        lambda: straight_bank(value),
        lambda: respond(value, valid, field.orientation, field.frequency, REGION),
        lambda: curved_gabor(value, valid, angle, 20.0, REGION, 5.0, 80.0),
    )
    # In turns, so that whatever else the machine does meets all three alike.
    rounds = [[seconds(call)[0] for call in calls] for _ in range(ROUNDS)]
    bank_s, respond_s, whole_s = np.min(rounds, axis=0).tolist()
    print(f"{value.shape[1]} x {value.shape[0]}, p = q = 80")
    print(f"  OpenCV bank {ORIENTATIONS} x {FREQUENCIES}      {bank_s:7.2f} s    ({KERNEL_PX} x {KERNEL_PX}, complex)")
    print(f"  respond                 {respond_s:7.2f} s    ratio {bank_s / respond_s:.1f} (>= {BANK_AT_LEAST:.0f})")
    print(f"  curved_gabor, 2 passes  {whole_s:7.2f} s    ratio {bank_s / whole_s:.1f} (>= {BANK_AT_LEAST:.0f})")
    return bank_s / respond_s, bank_s / whole_s


def main() -> int:
    """Run both comparisons; 1 where a figure is missed."""
    faster, alike = against_literal()
    ratios = against_bank()
    return int(faster < LITERAL_AT_LEAST or alike < CORRELATION_AT_LEAST or min(ratios) < BANK_AT_LEAST)


if __name__ == "__main__":
    sys.exit(main())
