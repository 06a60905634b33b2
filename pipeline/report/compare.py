"""The re-rendered face against the photograph."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.report.palettes import NOTHING
from pipeline.report.pictures import jpeg, srgb_bytes
from pipeline.report.reading import Scan
from stages.variables import RENDERED, RGB, VALID

_GAIN = 4
_SIGMA_PX = 1.5
_MOST_PX = 2048


def compare_section(scan: Scan) -> dict[str, Any] | None:
    """Both pictures, their difference, and how close they are; ``None`` before the color map."""
    if not scan.has(RENDERED, RGB):
        return None
    side = round(0.92 * scan.longer)
    photograph, rendered = srgb_bytes(scan.image(RGB, side)), srgb_bytes(scan.image(RENDERED, side))
    difference = np.clip(128 + _GAIN * (rendered.astype(np.int16) - photograph), 0, 255).astype(np.uint8)
    if scan.has(VALID):
        wood = scan.image(VALID, side) > 0.5
        if wood.shape == difference.shape[:2]:
            difference = np.where(wood[..., None], difference, NOTHING)
    psnr, part = _psnr(scan)
    return {
        "photograph": jpeg(photograph, "The photograph.", 84),
        "rendered": jpeg(rendered, "The face as the solid texture gives it.", 84),
        "difference": jpeg(difference, f"Difference of the two, {_GAIN} times amplified; gray where they agree.", 80),
        "gain": _GAIN,
        "psnr": None if psnr is None else ("infinite" if np.isinf(psnr) else f"{psnr:.1f} dB"),
        "sigma": f"{_SIGMA_PX:g}",
        "part": part,
    }


def _psnr(scan: Scan) -> tuple[float | None, str]:
    """PSNR in dB of the blurred linear images on wood, and the part of a large scan that it was taken on."""
    from woodfit.scoring import psnr_blurred

    rgb, rendered = scan.ds[RGB.name], scan.ds[RENDERED.name]
    if rgb.shape != rendered.shape:
        return None, ""
    rows, columns = (
        slice(max(0, (size - _MOST_PX) // 2), max(0, (size - _MOST_PX) // 2) + _MOST_PX) for size in rgb.shape[:2]
    )
    window = {"y": rows, "x": columns}
    valid = np.asarray(scan.ds[VALID.name].isel(window).values) if scan.has(VALID) else np.ones(1, bool)
    if not valid.any():
        return None, ""
    frame = scan.frame
    first, second = np.asarray(rgb.isel(window).values), np.asarray(rendered.isel(window).values)
    sigma = _SIGMA_PX / (frame.step if frame is not None else 1.0)
    known = np.isfinite(first).all(axis=-1) & np.isfinite(second).all(axis=-1)
    valid = known & (valid if valid.shape == known.shape else True)
    if not valid.any():
        return None, ""
    value = psnr_blurred(np.nan_to_num(first), np.nan_to_num(second), sigma, valid)
    whole = rgb.shape[0] <= _MOST_PX and rgb.shape[1] <= _MOST_PX
    return float(value), "" if whole else f"on the middle {_MOST_PX} px of the scan"
