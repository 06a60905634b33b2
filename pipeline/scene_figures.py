"""Figures of rings and texture against synthetic truth, where everything about the log is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.labels import TruthError
from woodfit import scoring
from woodfit.synthetic import srgb_decode


def ring_figures(
    polylines: tuple[NDArray[np.float64], ...], age: NDArray[np.float32], tolerance_px: float
) -> dict[str, float]:
    """Recall and precision of boundary pixels, and F along lines across the grain."""
    lines = scoring.line_f(polylines, age, tolerance_px=tolerance_px)
    strict = scoring.line_f(polylines, age, tolerance_px=tolerance_px, grazing_deg=90.0, edge_px=0.0)
    pixels = scoring.boundary_recall_precision(polylines, age, tolerance_px)
    return (
        pixels
        | {f"line_{name}": lines[name] for name in ("f", "sensitivity", "precision")}
        | {"line_f_strict": strict["f"]}
    )


def texture_figures(path: Path, known: Mapping[str, NDArray[Any]], scan: Path | None) -> dict[str, float]:
    """Figures of ring age and color of a solid texture on the face and on hidden planes."""
    # Lazily: the command line must not pay for the texture's imports, and rings can be judged without it.
    from woodfit import SolidTexture

    texture = SolidTexture.open(path)
    unit = px_to_texture_unit(texture)
    height, width = known["age"].shape
    face = np.zeros((height, width, 3))
    face[..., 1], face[..., 0] = np.mgrid[:height, :width]
    drawn = texture.evaluate(face * unit)
    figures = scoring.age_share(np.asarray(drawn.ring_age), known["age"])
    figures["age_correlation"] = scoring.age_correlation(np.asarray(drawn.ring_age), known["age"])
    if scan is not None:
        figures["psnr"] = scoring.psnr_blurred(np.asarray(drawn.rgb), _read_linear(scan))
    for name in (key.removesuffix("_points") for key in known if key.endswith("_points")):
        age = np.asarray(texture.evaluate(known[f"{name}_points"].astype(float) * unit).ring_age)
        # The planes keep the constant of the face: only a wrong depth may make them differ.
        error = np.abs(age - figures["age_offset"] - known[f"{name}_age"])
        figures[f"{name}_correlation"] = scoring.age_correlation(age, known[f"{name}_age"])
        figures[f"{name}_median_error"] = float(np.median(error))
    return figures


def px_to_texture_unit(texture: Any) -> float:
    """Length of a scan px in the texture's unit: its ``pixel_size`` in mm, or 1 when it knows no scale."""
    size = getattr(texture, "pixel_size", None)
    return 1.0 if size is None or not math.isfinite(size) or size <= 0 else float(size)


def _read_linear(scan: Path) -> NDArray[np.float64]:
    """Linear rgb 0..1, shape (H, W, 3), of a sample scan (8 bit)."""
    import cv2

    pixels = cv2.imread(str(scan), cv2.IMREAD_COLOR)
    if pixels is None:
        raise TruthError(f"{scan}: cannot be read as an image.")
    return srgb_decode(np.asarray(pixels[..., ::-1], dtype=float) / 255.0)
