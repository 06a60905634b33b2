"""Linear color as a screen takes it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def srgb_bytes(linear: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Encode linear values 0..1 as sRGB bytes, same shape; what is not a number becomes black."""
    clipped = np.clip(np.nan_to_num(np.asarray(linear, np.float32)), 0.0, 1.0)
    curve = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** np.float32(1 / 2.4) - 0.055)
    return np.asarray(curve * 255.0 + 0.5).astype(np.uint8)
