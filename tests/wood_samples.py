"""Solid textures that tests of renders and exports share: every trait that a texture can have, and small."""

from dataclasses import replace

import numpy as np
from test_shader_tables import GRAIN
from test_solid_texture import STEM, texture

from woodfit import SolidTexture
from woodfit.fine_grain import FineGrain
from woodfit.seen import Seen

FACE = Seen(np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]]), np.array([[300.0, 200.0]]), np.array([1.5, 9.0]))

#: All the way round in px; a sector of a bent, tapering stem in mm; rings alone.
WOODS: dict[str, SolidTexture] = {
    "round": replace(texture(), fine_grain=GRAIN, seen=FACE),
    "sector": replace(texture(False, 0.2), stem=STEM, fine_grain=GRAIN, seen=FACE),
    "plain": replace(texture(), fine_grain=FineGrain.none(), seen=FACE),
}


def old_wood() -> SolidTexture:
    """A tree of more rings than the shaders' tables hold, fine ones."""
    one, rings = WOODS["plain"], 300
    ages = np.arange(rings * one.samples_per_ring)
    wave = (0.5 + 0.3 * np.sin(ages / 7.0)[:, None] * np.array([1.0, 0.8, 0.5])).astype(np.float32)
    return replace(
        one,
        ring_radius=np.cumsum([0.0, *np.random.default_rng(1).uniform(0.5, 1.0, rings)]),
        color_strip=wave,
        lateness_strip=np.clip(wave[:, 0], 0.0, 1.0),
        seen=replace(FACE, ages=np.array([200.0, 299.0])),
    )


def in_block(wood: SolidTexture, count: int, seed: int = 0) -> np.ndarray:
    """Points on the photographed face and through the block behind it, (count, 3), in the wood's unit."""
    from woodfit.block_extent import block_extent

    extent = block_extent(wood)
    points = np.random.default_rng(seed).uniform(extent.low, extent.high, (count, 3))
    points[::2, 2] = extent.low[2]
    return points
