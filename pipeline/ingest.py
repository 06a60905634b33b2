"""Where the bands of a scan are gathered upright: in memory, or in a scratch store for large scans."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

CHUNK = 1024


class Target(Protocol):
    """Takes bands of stored rows, gives the upright scan."""

    def write(self, row: int, encoded: NDArray[Any], opaque: NDArray[np.bool_]) -> None:
        """Place a band whose first stored row is `row`."""

    def arrays(self) -> tuple[Any, Any]:
        """Return `encoded` and `opaque`."""


def upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Apply an EXIF orientation (1 to 8) to the first two axes, as a view."""
    if orientation >= 5:
        array = array.swapaxes(0, 1)
    rows, columns = _reversed(orientation)
    return array[:: -1 if rows else 1, :: -1 if columns else 1]


def _reversed(orientation: int) -> tuple[bool, bool]:
    """Whether rows and columns run backwards, after any exchange of the axes."""
    return orientation in (3, 4, 7, 8), orientation in (2, 3, 6, 7)


def _place(row: int, count: int, stored_rows: int, orientation: int) -> tuple[slice, slice]:
    """Where a band of stored rows lies in the upright image."""
    axis = 1 if orientation >= 5 else 0
    start = stored_rows - row - count if _reversed(orientation)[axis] else row
    band = slice(start, start + count)
    return (slice(None), band) if axis else (band, slice(None))


class MemoryTarget:
    """Gathers the scan in numpy arrays."""

    def __init__(self, stored_shape: tuple[int, int], dtype: str, orientation: int) -> None:
        self._stored_rows, self._orientation = stored_shape[0], orientation
        shape = stored_shape[::-1] if orientation >= 5 else stored_shape
        self._encoded: Any = self._allocate("encoded", (*shape, 3), dtype)
        self._opaque: Any = self._allocate("opaque", shape, "bool")

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: str) -> Any:
        return np.zeros(shape, dtype)

    def write(self, row: int, encoded: NDArray[Any], opaque: NDArray[np.bool_]) -> None:
        """Place a band whose first stored row is `row`."""
        place = _place(row, len(encoded), self._stored_rows, self._orientation)
        self._encoded[place] = upright(encoded, self._orientation)
        self._opaque[place] = upright(opaque, self._orientation)

    def arrays(self) -> tuple[Any, Any]:
        """Return `encoded` and `opaque`."""
        return self._encoded, self._opaque


class ScratchTarget(MemoryTarget):
    """Gathers the scan in an uncompressed store under `folder` and gives dask arrays on it."""

    def __init__(self, folder: Path, stored_shape: tuple[int, int], dtype: str, orientation: int) -> None:
        self._folder = folder
        super().__init__(stored_shape, dtype, orientation)

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: str) -> Any:
        import zarr

        chunks = (CHUNK, CHUNK, *shape[2:])
        return zarr.create_array(str(self._folder / name), shape=shape, chunks=chunks, dtype=dtype, compressors=None)

    def arrays(self) -> tuple[Any, Any]:
        """Return `encoded` and `opaque` as dask arrays in chunks that line up with the results' own."""
        import dask.array as da

        tile = (2 * CHUNK, 2 * CHUNK)
        encoded = da.from_array(self._encoded, chunks=(*tile, 3), name=f"encoded-{id(self)}")
        return encoded, da.from_array(self._opaque, chunks=tile, name=f"opaque-{id(self)}")
