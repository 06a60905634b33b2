"""The wood as parameters of a Liu-type model that a person can edit (docs/liu.md)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.export.registry import Options
from woodfit.block_extent import block_extent

if TYPE_CHECKING:
    from woodfit import SolidTexture

_POINTS = 2500


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME_liu.json``, fitted at points of the photographed faces."""
    from woodfit.liu_fit import agreement, fit_liu

    points = seen_points(texture, _POINTS)
    model = fit_liu(texture, points)
    path = folder / f"{options.name}_liu.json"
    off = agreement(model, texture, points)
    path.write_text(model.to_json(image=options.name, off_the_texture_on_the_face=off), encoding="utf-8")
    return [path]


def seen_points(texture: SolidTexture, count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Points spread over the photographed faces, or through the block when none is known; (K, 3)."""
    rng, scale = np.random.default_rng(0), texture.pixel_size or 1.0
    if not len(texture.seen.plane):
        extent = block_extent(texture)
        return np.asarray(rng.uniform(extent.low, extent.high, (count, 3)))
    each = -(-count // len(texture.seen.plane))
    points = [
        corner + rng.uniform(0, size[0], (each, 1)) * right + rng.uniform(0, size[1], (each, 1)) * down
        for (corner, right, down), size in zip(texture.seen.plane, texture.seen.size, strict=True)
    ]
    return np.asarray(np.concatenate(points)[:count] * scale)
