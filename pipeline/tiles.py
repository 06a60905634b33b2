"""Cutting a large scan into tiles: each has a core it owns and a window it sees."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

ALIGNMENT = 64


@dataclass(frozen=True)
class Tile:
    """A core ``[y0, y1) x [x0, x1)``, in array elements; cores cover the image without overlap."""

    y0: int
    y1: int
    x0: int
    x1: int

    @property
    def name(self) -> str:
        """Name of its marker."""
        return f"{self.y0}-{self.x0}"

    @property
    def region(self) -> dict[str, slice]:
        """The core's place in the image."""
        return {"y": slice(self.y0, self.y1), "x": slice(self.x0, self.x1)}

    def window(self, halo: int, shape: tuple[int, int]) -> dict[str, slice]:
        """What the tile has to see: its core and a halo rounded up to `ALIGNMENT`, within the image.

        The rounding keeps every window's origin on one grid, so that stages that work at a reduced
        resolution see the same reduced pixels in every tile.
        """
        margin = -(-halo // ALIGNMENT) * ALIGNMENT
        return {
            "y": slice(max(self.y0 - margin, 0), min(self.y1 + margin, shape[0])),
            "x": slice(max(self.x0 - margin, 0), min(self.x1 + margin, shape[1])),
        }

    def core(self, window: dict[str, slice]) -> dict[str, slice]:
        """The core's place within the window."""
        y, x = window["y"].start, window["x"].start
        return {"y": slice(self.y0 - y, self.y1 - y), "x": slice(self.x0 - x, self.x1 - x)}


def tiles(shape: tuple[int, int], side: int) -> Iterator[Tile]:
    """Tiles of an image in reading order."""
    for y in range(0, shape[0], side):
        for x in range(0, shape[1], side):
            yield Tile(y, min(y + side, shape[0]), x, min(x + side, shape[1]))


def is_tiled(shape: tuple[int, int], side: int) -> bool:
    """Whether the image is cut at all: only when it is larger than a whole tile."""
    return shape[0] * shape[1] > side * side
