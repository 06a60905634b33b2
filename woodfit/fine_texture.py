"""What the fine texture of a face says: along which way it is streaked, and whether vessels make the boundaries."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.streamlines import smooth_along
from woodfit.vessels import darker_side

FloatArray = npt.NDArray[np.float32]


def grain_ratio(value: npt.NDArray[Any], orientation: npt.NDArray[Any], valid: npt.NDArray[np.bool_]) -> float:
    """Mean square slope of the fine texture across the rings over that along them, rings themselves removed.

    A large face is looked at in every third block of 128 px both ways.
    """
    rows, cols = (np.arange(n) // 128 % 3 for n in value.shape)
    if min(value.shape) >= 512:
        valid = valid & ((rows[:, None] == 1) & (cols[None, :] == 1))
    smooth, _ = smooth_along(value, valid, orientation, 20, 8.0)
    fine = cv2.GaussianBlur(np.asarray(value, np.float32) - smooth, (0, 0), 0.7)
    gx, gy = cv2.Scharr(fine, cv2.CV_32F, 1, 0), cv2.Scharr(fine, cv2.CV_32F, 0, 1)
    inside = cv2.erode(np.pad(valid.astype(np.uint8), 1), np.ones((7, 7), np.uint8))[1:-1, 1:-1] > 0
    if not inside.any():
        return 1.0
    power = gx * gx + gy * gy
    # Cracks and dirt must not outvote the wood.
    weight = inside * np.minimum(1.0, np.percentile(power[inside], 95) / np.maximum(power, 1e-12))
    across = -gx * np.sin(orientation) + gy * np.cos(orientation)
    along = gx * np.cos(orientation) + gy * np.sin(orientation)
    return float((weight * across**2).sum() / max(float((weight * along**2).sum()), 1e-12))


#: Fine texture more skewed than `PORES` (see `pore_evidence`) comes from vessels. So does what is streaked along the
#: rings more than `STREAKED` (see `grain_ratio`), if its dark side is the longer by `DARKER` (see
#: `woodfit.vessels.darker_side`): fibres make streaks to both sides alike, 1.05 and below on drawn boards, and vessels
#: 1.07 and above. Where rings are under some 15 px wide, thin latewood that is not quite smoothed away is streaked and
#: dark, too, but not in the second quarter of a ring behind its edge: there vessels reach 1.03, latewood hardly ever.
PORES, STREAKED, DARKER, DARKER_BEHIND = -0.8, 3.5, 1.06, 1.03


def pore_evidence(
    value: npt.NDArray[Any],
    smooth: npt.NDArray[Any],
    wave_phase: npt.NDArray[Any],
    confidence: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
) -> float:
    """Whether the wood is full of vessels: skewness of the fine texture, summed over the dark and bright halves.

    Vessels are dark spots and streaks on either half of a ring; tracheids, fibres and sensor noise are nearly
    symmetric. Measured on nineteen real scans and on synthetic wood: below -0.8 for every ring-porous one, above for
    every other. Vessels stand all over the wood, while a label, a crack or a scratch does not: the median over sixteen
    parts of the face counts.

    Parameters
    ----------
    value, smooth : arrays of shape (M, N)
        Grey values; the same smoothed a few pixels along the rings.
    wave_phase : array of shape (M, N)
        Phase of the fitted wave in rad: 0 where the ring is brightest.
    confidence, valid : arrays of shape (M, N)
        Where to look.

    Returns
    -------
    float
        Sum of the two skewnesses; 0 when there is too little to tell.
    """
    fine = np.asarray(value, np.float32) - smooth
    trusted = (confidence > 0.3) & valid
    wave = np.cos(wave_phase)
    rows, cols = (np.linspace(0, n, 5).astype(int) for n in fine.shape)
    parts = [(slice(*r), slice(*c)) for r in pairwise(rows) for c in pairwise(cols)]
    told = [one for part in parts if (one := _skewness(fine[part], wave[part], trusted[part])) is not None]
    if len(told) < 4:
        told = [_skewness(fine, wave, trusted) or 0.0]
    return float(np.median(told))


def _skewness(fine: FloatArray, wave: npt.NDArray[Any], trusted: npt.NDArray[np.bool_]) -> float | None:
    """Skewness in the bright and the dark half of the rings, added; None where there is too little to tell."""
    total = 0.0
    for half in (wave, -wave):
        part = fine[trusted & (half > 0.3)].astype(np.float64)
        if part.size < 500:
            return None
        part = part - part.mean()
        total += float((part**3).mean() / max(float((part**2).mean()) ** 1.5, 1e-12))
    return total


#: Vessels of ring-porous wood stand nearly all on the dark side of the abrupt edges, which they make: differences over
#: sums up to -0.85. In wood whose latewood is dark they stand on both sides or on the bright one, mostly from -0.75 on.
CROWDED = -0.8


def vessel_side(
    value: npt.NDArray[Any],
    smooth: npt.NDArray[Any],
    wave_phase: npt.NDArray[Any],
    weight: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
) -> float:
    """On which side of the abrupt edges vessels stand: -1 all on the dark side, 1 all on the bright one.

    Parameters
    ----------
    value, smooth : arrays of shape (M, N)
        Grey values; the same smoothed along the rings, farther than a vessel's streak is long.
    wave_phase : array of shape (M, N)
        Phase of the fitted wave in rad, growing towards the bright side of the edges: 0 where the ring is brightest.
    weight : array of shape (M, N)
        How surely the edges are abrupt and where.
    valid : bool array of shape (M, N)
        The wood.

    Returns
    -------
    float
        Difference over sum of the shares of dark spots in the third of a ring behind the edge and before it; 0 where
        there is too little to tell.
    """
    fine = (np.asarray(value, np.float32) - smooth) / np.maximum(smooth, 0.05)
    trusted = valid & (weight > 0.0)
    if np.count_nonzero(trusted) < 500:
        return 0.0
    # Dark beyond what the bright side of the texture shows: noise goes both ways.
    dark = fine < -np.percentile(fine[trusted], 98)
    after = np.mod(wave_phase / (2.0 * np.pi) + 0.25, 1.0)
    shares = []
    for part in (after < 1.0 / 3.0, after > 2.0 / 3.0):
        mass = weight * (part & trusted)
        shares.append(float((mass * dark).sum() / max(float(mass.sum()), 1e-9)))
    return (shares[0] - shares[1]) / max(sum(shares), 1e-9)


def _streaked_dark(fine: FloatArray, wave_phase: npt.NDArray[Any], trusted: npt.NDArray[np.bool_]) -> bool:
    """Whether fine texture is darker by far than bright, over all and in the second quarter of a ring."""
    after = np.mod(wave_phase / (2.0 * np.pi) + 0.25, 1.0)
    behind = fine[trusted & (after >= 0.25) & (after < 0.5)]
    if behind.size == 0:
        return False
    return darker_side(fine[trusted]) > DARKER and darker_side(behind - np.median(behind)) > DARKER_BEHIND


@dataclass(frozen=True)
class Texture:
    """What the fine texture of a face says.

    Attributes
    ----------
    grain_ratio : float
        See `grain_ratio`.
    pores : float
        Evidence for vessels at the abrupt edges, for `woodfit.growth.find_growth`: from `pore_evidence`, 0 where
        vessels stand everywhere.
    dotted : bool
        Whether vessels make the boundaries.
    """

    grain_ratio: float
    pores: float
    dotted: bool


def read_texture(
    value: npt.NDArray[Any],
    along: FloatArray,
    valid: npt.NDArray[np.bool_],
    response: npt.NDArray[Any],
    explained: npt.NDArray[Any],
    asymmetry: npt.NDArray[Any],
    orientation: npt.NDArray[Any],
    vessels: bool,
) -> Texture:
    """What the fine texture says; the arguments are those of `woodfit.rings.find_rings`, `along` smoothed a little."""
    # The density of vessels is blurred, which takes more from what is fine across the rings.
    grain = grain_ratio(value, orientation, valid) * (1.4 if vessels else 1.0)
    if vessels:
        return Texture(grain, 2.0 * PORES, True)
    dotted = grain > STREAKED and _streaked_dark(value - along, np.angle(response), (explained > 0.3) & valid)
    pores = pore_evidence(value, along, np.angle(response), explained, valid)
    if dotted:
        pores = min(pores, 2.0 * PORES)
    if pores < PORES:
        farther, _ = smooth_along(value, valid, orientation, 20, 8.0)
        sure = asymmetry * np.where(explained > 0.3, explained, 0.0)
        if vessel_side(value, farther, np.angle(response), sure, valid) > CROWDED:
            # Vessels that stand everywhere do not make the edges: dark latewood does.
            return Texture(grain, 0.0, False)
    return Texture(grain, pores, dotted)
