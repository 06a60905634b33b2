"""The block of wood that the photographs support: where renders, exports and carving take their wood from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from woodfit.solid_texture import SolidTexture

#: Depth of the block behind a single photograph, in its shorter sides.
DEPTH_SHARE = 0.4

#: Side of the block of a texture that does not say what was seen, in mean ring widths.
_SIDE_WIDTHS = 20.0


@dataclass(frozen=True)
class Extent:
    """A box along the axes of the board frame.

    Attributes
    ----------
    low, high : arrays of shape (3,)
        Corners, in `SolidTexture.unit`.
    """

    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]

    @property
    def size(self) -> npt.NDArray[np.float64]:
        """Width, height and depth."""
        return self.high - self.low

    @property
    def centre(self) -> npt.NDArray[np.float64]:
        """Middle of the box."""
        return 0.5 * (self.low + self.high)

    def corners(self) -> npt.NDArray[np.float64]:
        """The eight corners, shape (8, 3)."""
        pick = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], bool)
        return np.where(pick, self.high, self.low)

    def points(self, shape: tuple[int, int, int]) -> npt.NDArray[np.float64]:
        """Centres of nx x ny x nz cells, shape (nz, ny, nx, 3)."""
        x, y, z = (
            low + (np.arange(count) + 0.5) / count * (high - low)
            for low, high, count in zip(self.low, self.high, shape, strict=True)
        )
        return np.stack(np.broadcast_arrays(x[None, None], y[None, :, None], z[:, None, None]), axis=-1)

    def cells(self, longest: int) -> tuple[int, int, int]:
        """Numbers of about cubic cells along x, y and z, `longest` of them along the longest side."""
        counts = np.maximum(1, np.round(longest * self.size / self.size.max())).astype(int)
        return int(counts[0]), int(counts[1]), int(counts[2])


def block_extent(texture: SolidTexture) -> Extent:
    """Box around the photographed faces; behind a single one, 0.4 of its shorter side deep."""
    seen, scale = texture.seen, texture.pixel_size or 1.0
    if not len(seen.plane):
        half = 0.5 * _SIDE_WIDTHS * texture.ring_width
        return Extent(np.full(3, -half), np.full(3, half))
    corners: list[Any] = []
    for (corner, right, down), (width, height) in zip(seen.plane, seen.size, strict=True):
        # A pixel reaches half its size beyond its centre.
        for u in (-0.5, width + 0.5):
            corners += [corner + u * right + v * down for v in (-0.5, height + 0.5)]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    thin = int(np.argmin(high - low))
    if high[thin] - low[thin] < 0.02 * (high - low).max():
        # All faces lie in one plane; the wood is behind it, to where the photograph's x and y turn right-handed.
        depth = DEPTH_SHARE * float(np.sort(high - low)[1])
        behind = float(np.cross(seen.plane[0, 1], seen.plane[0, 2])[thin])
        low[thin], high[thin] = sorted([low[thin], low[thin] + np.copysign(depth, behind)])
    return Extent(low * scale, high * scale)
