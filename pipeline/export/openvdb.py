"""OpenVDB files (.vdb): color, lateness and extinction of the block as grids, written slab by slab."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.export.registry import Options, mm_or_one
from pipeline.export.vdb_file import GridWriter, write_vdb
from pipeline.export.volumes import cells_of, slabs

if TYPE_CHECKING:
    from woodfit import SolidTexture


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.vdb`` with the grids ``color`` (linear RGB), ``lateness`` and ``extinction`` (1/mm).

    Grid points lie at the middles of cubic cells, in the board frame turned upright (x right, y up, z towards the
    camera), in mm where the size of the wood is known, else in the texture's unit.
    """
    cells = cells_of(texture, options)
    scale = mm_or_one(texture, options)
    step = cells.size * scale
    origin = (cells.extent.low * scale + 0.5 * step) * [1.0, -1.0, -1.0]
    nx, ny, nz = cells.shape
    # Upright: index y and z run against those of the board.
    place = np.diag([*step, 1.0])
    place[3, :3] = origin - [0.0, (ny - 1) * step[1], (nz - 1) * step[2]]
    path = folder / f"{options.name}.vdb"
    grids = [GridWriter(folder, "color", 3), GridWriter(folder, "lateness", 1), GridWriter(folder, "extinction", 1)]
    try:
        # Eight layers at a time, so that leaves of 8³ come complete.
        for slab in slabs(texture, cells, options.detail, 8, upright=True):
            for grid, values in zip(grids, (slab.color, slab.lateness, slab.extinction), strict=True):
                grid.add(values)
        write_vdb(path, grids, place, (nx, ny, nz), texture.unit if scale == 1.0 and texture.unit != "mm" else "mm")
    finally:
        for grid in grids:
            grid.remove()
    return [path]
