"""Mitsuba's grid volumes (.vol): color, lateness, extinction, written slab by slab."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from pipeline.export.registry import Options
from pipeline.export.volumes import Cells, cells_of, slabs

if TYPE_CHECKING:
    from woodfit import SolidTexture


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME_color.vol``, ``NAME_lateness.vol`` and ``NAME_extinction.vol`` (1/mm).

    Layers run along z, rows along y: the board frame in `SolidTexture.unit`, whose box each file's header holds.
    """
    cells = cells_of(texture, options)
    paths = {kind: folder / f"{options.name}_{kind}.vol" for kind in ("color", "lateness", "extinction")}
    files = {kind: path.open("wb") for kind, path in paths.items()}
    try:
        for kind, file in files.items():
            _header(file, cells, 3 if kind == "color" else 1)
        for slab in slabs(texture, cells, options.detail):
            for kind, file in files.items():
                file.write(np.ascontiguousarray(getattr(slab, kind), "<f4").tobytes())
    finally:
        for file in files.values():
            file.close()
    return list(paths.values())


def _header(file: BinaryIO, cells: Cells, channels: int) -> None:
    nx, ny, nz = cells.shape
    # VOL, version 3, float32.
    file.write(b"VOL" + struct.pack("<B5i", 3, 1, nx, ny, nz, channels))
    file.write(struct.pack("<6f", *cells.extent.low, *cells.extent.high))
