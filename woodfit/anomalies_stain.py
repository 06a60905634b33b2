"""Stain: wood that is darker but not deeper in color.

Latewood, heartwood and resin hold more of what colors wood: the darker, the deeper. Stain is gray on top. So the
absorbance of wood, averaged over its rings, is split into a share along wood's own color and a gray remainder.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.anomalies import BoolArray, Face, FloatArray, absorbance, blurred

#: Gray absorbance of what is certainly stained, and of what belongs to it.
_SURELY, _PROBABLY = 0.22, 0.12
#: Wood whose own color is nearer to gray than this (rad) cannot be told from stain.
_LEAST_ANGLE = 0.12
#: What colors wood of all kinds, as absorbance of red, green and blue, where a face does not show it itself.
_BROWN = np.array([0.6, 1.0, 1.5]) / np.linalg.norm([0.6, 1.0, 1.5])
#: What gray counts for then.
_GUESSED = 0.45
#: A face whose blue is absorbed more than its red by less than this has no color.
_LEAST_COLOR = 0.3
_ROUNDS = 6


def wood_direction(fine: FloatArray, coarse: FloatArray, valid: BoolArray) -> npt.NDArray[np.float64]:
    """Unit vector of rgb absorbance along which earlywood turns into latewood."""
    change = (fine - coarse)[valid].astype(np.float64)
    _, vectors = np.linalg.eigh(change.T @ change)
    direction = vectors[:, -1]
    return np.asarray(direction * np.sign(direction.sum()))


def stain_absorbance(face: Face, weight: npt.NDArray[Any]) -> FloatArray:
    """Gray absorbance beyond that of the sound wood around, shape (M, N); 0 where gray and wood look alike.

    Parameters
    ----------
    face : Face
        What is seen.
    weight : array of shape (M, N)
        0 on what must not count.
    """
    ring, valid = face.ring_px, face.valid
    color = absorbance(face.rgb)
    fine = blurred(color, weight, max(0.7, 0.1 * ring))
    coarse = blurred(color, weight, max(2.0, 0.6 * ring))
    wood = wood_direction(fine, coarse, valid)
    gray = np.ones(3) / np.sqrt(3.0)
    trust = 1.0
    if np.arccos(min(1.0, float(wood @ gray))) < _LEAST_ANGLE:
        if float(np.median((coarse[..., 2] - coarse[..., 0])[valid])) < _LEAST_COLOR:
            return np.zeros(valid.shape, np.float32)
        wood, trust = _BROWN, _GUESSED
    darker = coarse.mean(axis=2)
    shares = coarse @ np.linalg.pinv(np.stack([wood, gray], axis=1)).T.astype(np.float32)
    remainder = shares[..., 1] / np.float32(np.sqrt(3.0))
    # Paler wood is grayer too, but not darker.
    added = np.minimum(remainder - _background(remainder, valid), darker - _background(darker, valid))
    return np.asarray(np.where(valid, trust * added, 0.0), np.float32)


def _background(remainder: FloatArray, valid: BoolArray) -> FloatArray:
    """Slow background of the light: a quadric through the sound part, asymmetric least squares."""
    height, width = valid.shape
    step = max(1, round(np.sqrt(height * width / 20000.0)))
    y, x = np.mgrid[:height, :width].astype(np.float32)
    y, x = 2.0 * y / max(height - 1, 1) - 1.0, 2.0 * x / max(width - 1, 1) - 1.0
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    some = valid[::step, ::step]
    matrix, values = terms[::step, ::step][some].astype(np.float64), remainder[::step, ::step][some]
    weight = np.ones(len(values))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        solution = np.linalg.lstsq(matrix * root, values * root[:, 0], rcond=None)[0]
        above = values - matrix @ solution
        scale = max(0.02, float(np.median(np.abs(above))))
        weight = np.where(above > scale, (scale / np.maximum(above, scale)) ** 2, 1.0)
    return np.asarray(terms @ solution, np.float32)


def find_stain(face: Face, stain: FloatArray, smallest_rings: float) -> BoolArray:
    """Mask of the stained wood, shape (M, N)."""
    from woodfit.anomalies_dark import connected

    size = max(3, round(smallest_rings * face.ring_px))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    found = np.zeros(face.valid.shape, bool)
    wide = cv2.morphologyEx((stain > _PROBABLY).astype(np.uint8), cv2.MORPH_OPEN, disc) > 0
    for rows, cols, part in connected(stain > _SURELY, wide):
        found[rows, cols] |= part
    return found & face.valid
