"""From encoded pixels to what the stages need: linear color, grey value, wood mask, analysis resolution."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.structure_tensor import orientation

FloatArray = npt.NDArray[np.float32]

#: Ring width in analysed pixels that serves well: wide enough for narrow rings beside it, small enough to be fast.
_WIDE_RING_PX, _USUAL_RING_PX = 64.0, 20.0
_SMALL_SCAN_PX = 1_000_000

#: Coherence of lines, and their contrast over that of the rest of the scan, from which an even area is wood.
LINES_COHERE, LINES_SHARE = 0.6, 0.2

#: Least share of the middle of a scan that is taken for wood on a background.
LEAST_WOOD = 0.02


def srgb_decode(encoded: npt.NDArray[Any]) -> FloatArray:
    """Linear value 0..1 of sRGB-encoded pixels: uint8, uint16, or floats in 0..1."""
    array = np.asarray(encoded)
    if array.dtype.kind == "u":
        top = np.iinfo(array.dtype).max
        table = _curve(np.arange(top + 1, dtype=np.float64) / top)
        return np.asarray(table[array], dtype=np.float32)
    return _curve(array.astype(np.float64))


def _curve(value: npt.NDArray[Any]) -> FloatArray:
    linear = np.where(value <= 0.04045, value / 12.92, ((np.maximum(value, 0.04045) + 0.055) / 1.055) ** 2.4)
    return np.asarray(linear, dtype=np.float32)


def srgb_encode(linear: npt.NDArray[Any]) -> FloatArray:
    """sRGB-encoded value 0..1 of linear values, clipped to 0..1."""
    value = np.clip(linear, 0.0, 1.0)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * np.maximum(value, 0.0031308) ** (1 / 2.4) - 0.055)
    return np.asarray(encoded, dtype=np.float32)


def grey_value(encoded: npt.NDArray[Any]) -> FloatArray:
    """HSV value, 0..1, of encoded pixels of shape (..., 3)."""
    brightest = np.maximum(np.maximum(encoded[..., 0], encoded[..., 1]), encoded[..., 2])
    return np.asarray(brightest, dtype=np.float32) / np.float32(np.iinfo(encoded.dtype).max)


def develop(
    encoded: npt.NDArray[Any], opaque: npt.NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Linear color, grey value and opacity of encoded pixels (..., 3)."""
    return srgb_decode(encoded), grey_value(encoded), np.asarray(opaque)


def reduction_for(shape: tuple[int, int], ring_width_px: float, wood_share: float = 1.0) -> int:
    """Scan pixels per analysed pixel along each axis.

    Small scans keep their pixels unless their rings are wider than the curved region serves; large ones are reduced
    until a typical ring is some twenty pixels wide.
    """
    if shape[0] * shape[1] * wood_share <= _SMALL_SCAN_PX:
        return 1 if ring_width_px <= _WIDE_RING_PX else max(1, int(ring_width_px / 40.0))
    return max(1, int(ring_width_px / _USUAL_RING_PX))


def wood_mask(
    encoded: npt.NDArray[Any], opaque: npt.NDArray[np.bool_], white: float, black: float
) -> npt.NDArray[np.bool_]:
    """Where there is wood rather than background, on an overview of a scan.

    Background is what is colorless and nearly white, or nearly black, or of the one color that a whole side of the scan
    has and its middle has not (unless lines run through it, as through heartwood), and reaches the edge of the scan;
    small islands of it inside the wood (cracks, filler) stay wood here and are left to the confidence of the phase.

    Parameters
    ----------
    encoded : unsigned array of shape (M, N, 3)
        Encoded pixels.
    opaque : bool array of shape (M, N)
        Alpha.
    white, black : float
        Encoded values beyond which an area may be background.

    Returns
    -------
    bool array of shape (M, N)
    """
    pixels = encoded.astype(np.float32) / np.float32(np.iinfo(encoded.dtype).max)
    brightest, darkest = pixels.max(axis=-1), pixels.min(axis=-1)
    colorless = brightest - darkest < 0.10 * np.maximum(brightest, 0.1)
    candidates = [(darkest > white) & colorless, brightest < black, ~opaque, *_plain_sides(pixels)]
    background = np.zeros(opaque.shape, bool)
    for candidate in candidates:
        closed = cv2.morphologyEx(candidate.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        _, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
        left, top = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
        right, bottom = left + stats[:, cv2.CC_STAT_WIDTH], top + stats[:, cv2.CC_STAT_HEIGHT]
        edge = (left == 0) | (top == 0) | (right == opaque.shape[1]) | (bottom == opaque.shape[0])
        large = stats[:, cv2.CC_STAT_AREA] > 1e-3 * opaque.size
        chosen = edge & large
        chosen[0] = False
        background |= chosen[labels]
    if not background.any():
        return np.ones(opaque.shape, bool)
    # The rim of the background is blurred wood.
    return np.asarray(cv2.dilate(background.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0)


def _plain_sides(pixels: FloatArray, spread: float = 0.05, unlike: float = 0.2) -> list[npt.NDArray[np.bool_]]:
    """Pixels colored like a side of the scan, for each side that is of one color and unlike the scan's middle.

    A color that at least three sides have is compared with what is not of that color there, and half as unlike is
    enough: rings are not all around.
    """
    height, width = pixels.shape[:2]
    half = slice(height // 4, -(height // 4) or None), slice(width // 4, -(width // 4) or None)
    middle = np.median(pixels[half], axis=(0, 1))
    even = []
    for side in (pixels[:2], pixels[-2:], pixels[:, :2], pixels[:, -2:]):
        color = np.median(side, axis=(0, 1))
        if (np.abs(side - color) < spread).all(axis=-1).mean() > 0.9:
            even.append(color)
    found = []
    for color in even:
        around = sum(np.abs(color - other).max() < spread for other in even) >= 3
        away = np.abs(pixels - color).max(axis=-1)
        rest = away[half] > 2.0 * spread
        # A core may be so thin that most of the scan's middle is background, too.
        other = np.median(pixels[half][rest], axis=0) if around and rest.mean() > LEAST_WOOD else middle
        if np.abs(color - other).max() > (0.5 * unlike if around else unlike):
            alike = away < 1.2 * spread
            # Wood may have the color here and there, but not all around.
            plain = (alike & (cv2.blur(away, (15, 15)) < 0.6 * spread)).astype(np.uint8)
            area = alike & (cv2.dilate(plain, np.ones((17, 17), np.uint8)) > 0)
            if not _grown(pixels, area):
                found.append(area)
    return found


def _grown(pixels: FloatArray, area: npt.NDArray[np.bool_]) -> bool:
    """Whether an even area is wood: lines run through it one way, for its light not much fainter than elsewhere.

    Felt is rough every way (coherence 0.1 to 0.3, wood 0.95), and card that is lit from one side has no lines.
    """
    light = np.log(pixels.max(axis=-1) + np.float32(0.05))
    lines = np.abs(cv2.GaussianBlur(light, (0, 0), 1.5) - cv2.GaussianBlur(light, (0, 0), 8.0))
    filled = cv2.morphologyEx(area.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    inside, outside = (cv2.erode(part, np.ones((25, 25), np.uint8)) > 0 for part in (filled, 1 - filled))
    if not inside.any() or not outside.any():
        return False
    _, coherence = orientation(light, filled > 0, 1.5, 8.0)
    return bool(
        np.median(coherence[inside]) > LINES_COHERE
        and np.median(lines[inside]) > LINES_SHARE * np.median(lines[outside])
    )


def thickness(mask: npt.NDArray[np.bool_]) -> float:
    """Diameter in pixels of the largest disk that fits into a mask."""
    return 2.0 * float(cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, 5).max())


def mask_window(
    mask: npt.NDArray[np.bool_], mask_step: int, row: int, col: int, shape: tuple[int, int]
) -> npt.NDArray[np.bool_]:
    """Part of an overview mask, brought to the scan's own pixels."""
    rows = np.minimum((row + np.arange(shape[0])) // mask_step, mask.shape[0] - 1)
    cols = np.minimum((col + np.arange(shape[1])) // mask_step, mask.shape[1] - 1)
    return np.asarray(mask[rows[:, None], cols[None, :]])


def mask_at(mask: npt.NDArray[np.bool_], mask_step: int, step: int, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    """An overview mask at the analysis resolution (`step` scan px per element), array of `shape`."""
    rows = np.minimum((np.arange(shape[0]) * step + step // 2) // mask_step, mask.shape[0] - 1)
    cols = np.minimum((np.arange(shape[1]) * step + step // 2) // mask_step, mask.shape[1] - 1)
    return np.asarray(mask[rows[:, None], cols[None, :]])
