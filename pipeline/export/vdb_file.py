"""A writer of OpenVDB files, format version 224: dense float and vector grids, uncompressed, memory bounded.

No package on PyPI writes OpenVDB from numpy. The layout follows OpenVDB's own ``io/Archive.cc`` and ``tree/*.h``: a
root, internal nodes of 32³ and 16³ children, leaves of 8³ values with x slowest; a grid's topology, then its leaves.
"""

from __future__ import annotations

import struct
import tempfile
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

_LEAF, _LOWER, _UPPER = 8, 128, 4096

#: All values are stored, whatever the mask says.
_ALL_VALUES = b"\x06"


class GridWriter:
    """Values of one grid, collected slab by slab in a temporary file as leaves.

    Parameters
    ----------
    folder : Path
        Where the temporary file goes.
    name : str
        Of the grid.
    channels : int
        1 or 3.
    """

    def __init__(self, folder: Path, name: str, channels: int) -> None:
        self.name, self.channels = name, channels
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  (closed by `remove`)
        self.blocks = (0, 0)

    def add(self, values: npt.NDArray[np.float32]) -> None:
        """Append eight layers, or the last ones: (n, ny, nx) or (n, ny, nx, 3), z slowest."""
        n, ny, nx = values.shape[:3]
        padded = np.zeros((_LEAF, -(-ny // _LEAF) * _LEAF, -(-nx // _LEAF) * _LEAF, self.channels), "<f4")
        padded[:n, :ny, :nx] = values.reshape(n, ny, nx, self.channels)
        by, bx = padded.shape[1] // _LEAF, padded.shape[2] // _LEAF
        self.blocks = (bx, by)
        leaves = padded.reshape(_LEAF, by, _LEAF, bx, _LEAF, self.channels).transpose(3, 1, 4, 2, 0, 5)
        self._file.write(np.ascontiguousarray(leaves).tobytes())

    def leaf(self, place: tuple[int, int, int]) -> bytes:
        """Values of a leaf, x slowest."""
        bx, by = self.blocks
        size = 4 * _LEAF**3 * self.channels
        x, y, z = place
        self._file.seek(((z * bx + x) * by + y) * size)
        return self._file.read(size)

    def remove(self) -> None:
        """Give the temporary file back."""
        self._file.close()


def write_vdb(path: Path, grids: Sequence[GridWriter], place: Array, shape: tuple[int, int, int], unit: str) -> None:
    """Write grids of one shape.

    Parameters
    ----------
    path : Path
        File to write.
    grids : sequence of GridWriter
        All layers added.
    place : array of shape (4, 4)
        From index to world, for row vectors (translation in the last row).
    shape : tuple of int
        nx, ny, nz.
    unit : str
        Of the world, kept as metadata.
    """
    with path.open("wb") as file:
        file.write(struct.pack("<qIII", 0x56444220, 224, 10, 0) + b"\x01")
        # Of the contents' name alone, so that equal grids are equal files.
        file.write(str(uuid.uuid5(uuid.NAMESPACE_URL, f"woodpipe {path.name}")).encode("ascii"))
        file.write(_metadata({"creator": "woodpipe", "unit": unit}))
        file.write(struct.pack("<i", len(grids)))
        for grid in grids:
            _write_grid(file, grid, place, shape)


def _write_grid(file: BinaryIO, grid: GridWriter, place: Array, shape: tuple[int, int, int]) -> None:
    kind = "Tree_float_5_4_3" if grid.channels == 1 else "Tree_vec3s_5_4_3"
    file.write(_text(grid.name) + _text(kind) + _text(""))
    offsets = file.tell()
    file.write(bytes(24))
    start = file.tell()
    file.write(struct.pack("<I", 0) + _metadata({"class": "fog volume", "name": grid.name}))
    file.write(_text("AffineMap") + np.asarray(place, "<f8").tobytes())
    file.write(struct.pack("<i", 1) + bytes(4 * grid.channels))
    leaves = [-(-count // _LEAF) for count in shape]
    uppers = _children((0, 0, 0), [-(-count * _LEAF // _UPPER) for count in leaves], leaves, _UPPER)
    file.write(struct.pack("<II", 0, len(uppers)))
    order: list[tuple[int, int, int]] = []
    for upper in uppers:
        file.write(struct.pack("<3i", *(part * _UPPER for part in upper)))
        inside = _children(upper, [_UPPER // _LOWER] * 3, leaves, _LOWER)
        file.write(_node(inside, upper, _UPPER // _LOWER, grid.channels))
        for lower in inside:
            within = _children(lower, [_LOWER // _LEAF] * 3, leaves, _LEAF)
            file.write(_node(within, lower, _LOWER // _LEAF, grid.channels))
            for leaf in within:
                file.write(_active(leaf, shape))
            order += within
    blocks = file.tell()
    for leaf in order:
        file.write(_active(leaf, shape) + _ALL_VALUES + grid.leaf(leaf))
    end = file.tell()
    file.seek(offsets)
    file.write(struct.pack("<3q", start, blocks, end))
    file.seek(end)


def _children(
    parent: tuple[int, int, int], counts: Sequence[int], leaves: Sequence[int], side: int
) -> list[tuple[int, int, int]]:
    """Children of a node that hold leaves, x slowest, each counted in its own size of `side` voxels."""
    reach = [-(-count * _LEAF // side) for count in leaves]
    spans = [
        range(one * count, min((one + 1) * count, most)) for one, count, most in zip(parent, counts, reach, strict=True)
    ]
    return [(x, y, z) for x in spans[0] for y in spans[1] for z in spans[2]]


def _node(children: Sequence[tuple[int, int, int]], parent: tuple[int, int, int], count: int, channels: int) -> bytes:
    """Child mask, value mask and (unused) values of an internal node."""
    mask = np.zeros(count**3, np.uint8)
    own = np.array(children) - np.array(parent) * count
    mask[(own[:, 0] * count + own[:, 1]) * count + own[:, 2]] = 1
    bits = np.packbits(mask, bitorder="little").tobytes()
    return bits + bytes(len(bits)) + _ALL_VALUES + bytes(4 * channels * count**3)


def _active(leaf: tuple[int, int, int], shape: tuple[int, int, int]) -> bytes:
    """Value mask of a leaf: what lies within the grid's shape."""
    inside = [np.arange(place * _LEAF, (place + 1) * _LEAF) < count for place, count in zip(leaf, shape, strict=True)]
    mask = inside[0][:, None, None] & inside[1][None, :, None] & inside[2][None, None, :]
    return np.packbits(mask.ravel(), bitorder="little").tobytes()


def _metadata(values: dict[str, str]) -> bytes:
    parts = [struct.pack("<I", len(values))]
    parts += [_text(name) + _text("string") + _text(value) for name, value in values.items()]
    return b"".join(parts)


def _text(text: str) -> bytes:
    data = text.encode("utf-8")
    return struct.pack("<I", len(data)) + data
