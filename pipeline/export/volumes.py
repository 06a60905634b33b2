"""Grids of the block, slab by slab: what volume formats have in common."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.export.registry import Options
from woodfit.block_extent import Extent, block_extent
from woodfit.volume_optics import extinction_per_mm

if TYPE_CHECKING:
    from woodfit import SolidTexture

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Slab:
    """Some layers of the block's cells.

    Attributes
    ----------
    first : int
        Number of the first layer along z.
    color : float32 array of shape (n, ny, nx, 3)
        Linear.
    lateness, extinction : float32 arrays of shape (n, ny, nx)
        0..1, and 1/mm.
    """

    first: int
    color: npt.NDArray[np.float32]
    lateness: npt.NDArray[np.float32]
    extinction: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Cells:
    """Cubic cells over the block.

    Attributes
    ----------
    extent : Extent
        What they fill.
    shape : tuple of int
        nx, ny, nz.
    """

    extent: Extent
    shape: tuple[int, int, int]

    @property
    def size(self) -> npt.NDArray[np.float64]:
        """Sides of a cell, in the texture's unit."""
        return np.asarray(self.extent.size / np.array(self.shape), np.float64)


def cells_of(texture: SolidTexture, options: Options) -> Cells:
    """The cells of an export."""
    extent = block_extent(texture)
    return Cells(extent, extent.cells(options.cells))


def slabs(texture: SolidTexture, cells: Cells, detail: bool, layers: int = 8, upright: bool = False) -> Iterator[Slab]:
    """The block in slabs of `layers` layers along z: memory does not grow with the depth.

    `upright` goes through y and z the other way: y up, and from the far side towards the camera.
    """
    nx, ny, nz = cells.shape
    low, step = cells.extent.low, cells.size
    x = low[0] + (np.arange(nx) + 0.5) * step[0]
    y = low[1] + (np.arange(ny) + 0.5) * step[1]
    depths = low[2] + (np.arange(nz) + 0.5) * step[2]
    if upright:
        y, depths = y[::-1], depths[::-1]
    for first in range(0, nz, layers):
        z = depths[first : first + layers]
        points = np.stack(np.broadcast_arrays(x[None, None], y[None, :, None], z[:, None, None]), axis=-1)
        wood = texture.evaluate(points, detail)
        yield Slab(first, np.clip(wood.rgb, 0.0, None), wood.lateness, extinction_per_mm(wood.lateness))
