"""Wood with vessels: whether a scan shows them, and how densely they stand.

In ring-porous wood the large vessels begin abruptly at the ring boundary. They are dark spots or, along the stem, dark
streaks in tissue that is lighter than the latewood, so that the mean grey hardly changes over a ring while the density
of the vessels does. There the rings are sought in that density.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.grids import Window, block_mean, enlarged
from woodfit.ring_scale import ScaleScores
from woodfit.streamlines import smooth_along
from woodfit.structure_tensor import orientation

FloatArray = npt.NDArray[np.float32]

#: Fine texture whose darkest hundredth lies this much farther out than its brightest comes from vessels. Measured on
#: nineteen scans: 1.26 and above for the ring-porous ones, 1.13 and below for all others.
VESSELS = 1.24

#: Where the density of vessels is less periodic than this share of the grey values, rings are not made of them: 0.82
#: and above for ring-porous scans, 0.75 and below for most drawn diffuse-porous end grain.
PERIODIC = 0.78

#: Disk that vessels do not fill, and blur of what they leave, at the reduction at which they are small spots.
_RADIUS_PX, _BLUR_PX = 3, 2.0

#: Ring width in px below which no vessels are sought, and at a reduction. A ring as wide as two disks is the least
#: whose density of vessels changes; in narrower ones the thin latewood, which no two pixels of a streamline meet alike,
#: passes for vessels.
_LEAST_RING_PX, _LEAST_REDUCED_PX = 2.0 * (2 * _RADIUS_PX + 1), 20.0


def vessel_evidence(value: FloatArray, valid: npt.NDArray[np.bool_]) -> float:
    """How much farther dark spots stand out of the fine texture than bright ones; about 1 without vessels.

    What runs on along the rings is taken out first, so that thin dark latewood does not pass for vessels.

    Parameters
    ----------
    value, valid : arrays of shape (M, N)
        Grey values and the wood.

    Returns
    -------
    float
        Ratio of the 99th percentiles of the darkness and of the brightness; 1 where there is too little wood to tell.
    """
    angle, _ = orientation(value, valid, 1.0, 6.0)
    smooth, _ = smooth_along(value, valid, angle, 9, 3.0)
    inside = cv2.erode(np.pad(valid.astype(np.uint8), 1), np.ones((9, 9), np.uint8))[1:-1, 1:-1] > 0
    return darker_side((value - smooth)[inside])


def darker_side(fine: npt.NDArray[Any]) -> float:
    """How much farther the darkest hundredth of fine texture (K,) lies out than the brightest; 1 where it is little."""
    if fine.size < 500:
        return 1.0
    dark, bright = np.percentile(-fine, 99), np.percentile(fine, 99)
    return float(dark / max(float(bright), 1e-6))


def vessel_scale(
    shape: tuple[int, int],
    window: Window,
    ring_scale_px: float,
    window_px: int = 384,
) -> int:
    """Reduction at which vessels are small spots, from windows along the middle of a scan; 0 without vessels.

    Parameters
    ----------
    shape : tuple of two int
        Rows and columns of the scan.
    window : woodfit.grids.Window
        Parts of the scan.
    ring_scale_px : float
        Characteristic ring width: rings must stay wide compared to what is taken for a vessel.
    window_px : int
        Side of a window at its own level.
    """
    height, width = shape
    best, found = VESSELS, 0
    step = 1
    while ring_scale_px / step >= (_LEAST_RING_PX if step == 1 else _LEAST_REDUCED_PX):
        side = window_px * step
        evidence = []
        for part in (0.2, 0.5, 0.8):
            row, col = (max(0, min(int(part * n - 0.5 * side), n - side)) for n in (height, width))
            value, valid = window(row, col, min(side, height), min(side, width), step)
            if min(value.shape) >= 16 and valid.mean() > 0.2:
                evidence.append(vessel_evidence(value, valid))
        if evidence and float(np.median(evidence)) > best:
            best, found = float(np.median(evidence)), step
        step *= 2
    return found


def crowd_by_rings(grey: ScaleScores, density: ScaleScores, scale_px: float) -> bool:
    """Whether vessels crowd once a ring, as in ring-porous wood, and do not stand everywhere alike.

    Parameters
    ----------
    grey, density : ScaleScores
        How periodic the grey values and the density of the vessels are.
    scale_px : float
        Ring width that both agree on the best, px.
    """
    return density.near(scale_px) >= PERIODIC * grey.near(scale_px)


def density_signal(value: npt.NDArray[Any], scale: int, coarser: float = 1.0) -> FloatArray:
    """Negative density of vessels: dark where they crowd, 1 where there are none.

    Spots and streaks narrower than a disk are what its closing fills (black top hat).

    Parameters
    ----------
    value : array of shape (M, N)
        Grey values.
    scale : int
        From `vessel_scale`.
    coarser : float
        Factor on the blur.

    Returns
    -------
    float32 array of shape (M, N)
    """
    reduced = block_mean(np.asarray(value, np.float32), scale)
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _RADIUS_PX + 1, 2 * _RADIUS_PX + 1))
    spots = cv2.morphologyEx(reduced, cv2.MORPH_BLACKHAT, disk, borderType=cv2.BORDER_REPLICATE)
    blurred = cv2.GaussianBlur(spots, (0, 0), _BLUR_PX * coarser, borderType=cv2.BORDER_REFLECT_101)
    return enlarged(np.asarray(1.0 - 4.0 * blurred, np.float32), scale, np.shape(value))


def density_halo(scale: int) -> int:
    """Margin in pixels beyond which nothing influences `density_signal`: whole blocks."""
    return scale * (2 * _RADIUS_PX + int(4 * _BLUR_PX) + 4)
