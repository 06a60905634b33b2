"""Compile every numba kernel once: ``python -m woodfit.warm`` (part of ``make setup``).

The compiled code is kept on disk, so that no scan waits for the compiler.
"""

from __future__ import annotations

import time

import numpy as np

from woodfit import patch_gabor
from woodfit.curved_gabor import Region, curved_gabor
from woodfit.fine_grain import FineGrain
from woodfit.ring_scale import level_scores
from woodfit.rings import find_rings
from woodfit.structure_tensor import orientation


def warm() -> None:
    """Take a small grating of slanted rings through everything that is compiled."""
    scale_px = 8.0
    y, x = np.mgrid[:64, :72].astype(np.float32)
    value = (0.6 - 0.3 * np.mod((x + 0.3 * y) / scale_px, 1.0)).astype(np.float32)
    valid = np.ones(value.shape, np.bool_)
    region = Region(p=8, q=8, sigma_along_px=4.0)
    level_scores(value, valid)
    angle, _ = orientation(value, valid, 1.0, 4.0)
    field = curved_gabor(value, valid, angle, scale_px, region, 5.0, 16.0)
    patch_gabor.respond(value, valid, angle, field.frequency, region, np.array([32]), np.array([36]))
    line = np.linspace(1.0, 50.0, 64)
    FineGrain.of(np.arange(4), np.full((4, 3), 4.0), np.ones(4), np.ones((4, 2)), np.ones((4, 3))).log_factor(
        line, line, line, line
    )
    rings = find_rings(
        value,
        valid,
        field.response,
        field.explained,
        field.normal,
        field.asymmetry,
        field.frequency,
        field.orientation,
        scale_px,
    )
    if len(rings.traces) < 3:
        raise RuntimeError(f"the warm-up grating has 11 rings, but {len(rings.traces)} were traced")


def main() -> None:
    """Warm the kernels and say how long it took."""
    start = time.perf_counter()
    warm()
    print(f"numba kernels compiled and cached in {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
