"""Arrays as pictures inside a page: shrinking, sRGB encoding, data URIs."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.srgb import srgb_bytes

__all__ = ["LONGER_SIDE", "Bytes", "Picture", "block_mean", "fit", "jpeg", "png", "srgb_bytes"]

Array = npt.NDArray[Any]
Bytes = npt.NDArray[np.uint8]

#: Longer side of the pictures of a page, px.
LONGER_SIDE = 1100


@dataclass(frozen=True)
class Picture:
    """An encoded picture.

    Parameters
    ----------
    uri
        ``data:image/…``.
    width, height
        In px of the picture.
    alt
        What a person who cannot see it is told.
    """

    uri: str
    width: int
    height: int
    alt: str


def jpeg(rgb: Bytes, alt: str, quality: int = 84, fine_color: bool = False) -> Picture:
    """Encode sRGB bytes (H, W, 3) as JPEG; `fine_color` keeps the color at full resolution."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    if fine_color:
        options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    return _encode(".jpg", "image/jpeg", rgb, alt, options)


def png(rgb: Bytes, alt: str) -> Picture:
    """Encode sRGB bytes (H, W, 3) as PNG."""
    return _encode(".png", "image/png", rgb, alt, [cv2.IMWRITE_PNG_COMPRESSION, 7])


def _encode(suffix: str, kind: str, rgb: Bytes, alt: str, options: list[int]) -> Picture:
    done, data = cv2.imencode(suffix, np.ascontiguousarray(rgb[..., ::-1]), options)
    if not done:
        raise ValueError(f"cannot encode a picture of shape {rgb.shape} as {kind}")
    text = base64.b64encode(data.tobytes()).decode("ascii")
    return Picture(f"data:{kind};base64,{text}", rgb.shape[1], rgb.shape[0], alt)


def fit(image: Array, longer: int = LONGER_SIDE) -> Array:
    """Shrink an image (H, W) or (H, W, C), real or complex, so that its longer side is at most `longer` px."""
    if np.iscomplexobj(image):
        both = fit(np.stack([image.real, image.imag], axis=-1), longer)
        return np.asarray(both[..., 0] + 1j * both[..., 1])
    height, width = image.shape[:2]
    scale = longer / max(height, width)
    if scale >= 1.0:
        return image
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def block_mean(values: Any, step: int, rows: int = 256) -> Array:
    """Mean over blocks of `step` x `step` elements along the first two axes, read in bands; float32 or complex64.

    Blocks at the right and bottom edge may be smaller. `values` is anything that can be sliced into arrays.
    """
    height, width = values.shape[:2]
    across = np.arange(0, width, step)
    share = np.diff(np.append(across, width)).reshape((1, -1) + (1,) * (len(values.shape) - 2))
    bands = []
    for top in range(0, height, rows * step):
        band = np.asarray(values[top : top + rows * step])
        band = band.astype(np.complex64 if np.iscomplexobj(band) else np.float32)
        if step > 1:
            down = np.arange(0, len(band), step)
            many = np.diff(np.append(down, len(band))).reshape((-1, 1) + (1,) * (band.ndim - 2))
            band = np.add.reduceat(np.add.reduceat(band, down, axis=0), across, axis=1) / (many * share)
            band = band.astype(np.complex64 if np.iscomplexobj(band) else np.float32)
        bands.append(band)
    return np.concatenate(bands)
