"""A texture's tables as images that shaders look up bilinearly: for MaterialX, OSL and Blender.

Row 0 is the upper one, v is 1 there; pixel centres lie at halves. All values are float32 and linear. No mip-maps must
be made of them: the displacement is an atlas, the others are tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.shader_tables import ShaderTables

Array = npt.NDArray[Any]

#: Entries to a row of a table; the last of each row comes again as the first of the next.
ROW = 4096


@dataclass(frozen=True)
class Atlas:
    """The displacement's azimuth slices as tiles.

    Attributes
    ----------
    image : float32 array of shape (H, W)
        Tile (i, j) begins at column ``j radii`` and row ``i heights``; radius runs right, height down.
    columns : int
        Tiles in a row.
    """

    image: npt.NDArray[np.float32]
    columns: int


def displacement_atlas(known: ShaderTables) -> Atlas:
    """Slices of the displacement side by side, about as wide as high."""
    radii, azimuths, heights = known.displacement.shape
    columns = int(np.clip(round(np.sqrt(azimuths * heights / radii)), 1, azimuths))
    rows = -(-azimuths // columns)
    image = np.zeros((rows * heights, columns * radii), np.float32)
    for number in range(azimuths):
        i, j = divmod(number, columns)
        image[i * heights : (i + 1) * heights, j * radii : (j + 1) * radii] = known.displacement[:, number, :].T
    return Atlas(image, columns)


def table_rows(values: Array) -> npt.NDArray[np.float32]:
    """A table (N,) or (N, C) in rows of `ROW`: each ends with the next one's first entry, the last repeats its end."""
    count = len(values)
    if count <= ROW:
        return np.asarray(values[None], np.float32)
    rows = -(-(count - 1) // (ROW - 1))
    index = np.minimum(np.arange(rows)[:, None] * (ROW - 1) + np.arange(ROW)[None], count - 1)
    return np.asarray(values[index], np.float32)


def write_exr(path: Path, image: Array) -> Path:
    """Write (H, W) or (H, W, 3) float32 as OpenEXR, lossless."""
    import OpenImageIO as oiio  # noqa: N813

    values = np.ascontiguousarray(image if image.ndim == 3 else image[..., None], np.float32)
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], "float")
    spec.attribute("compression", "zip")
    spec.attribute("oiio:ColorSpace", "lin_rec709")
    out = oiio.ImageOutput.create(str(path))
    if out is None or not out.open(str(path), spec):
        raise OSError(f"{path} cannot be written: {oiio.geterror() if out is None else out.geterror()}")
    try:
        if not out.write_image(values):
            raise OSError(f"{path} cannot be written: {out.geterror()}")
    finally:
        out.close()
    return path


def write_tables(known: ShaderTables, atlas: Atlas, folder: Path, name: str) -> list[Path]:
    """The tables as EXR images: displacement, age, color, lateness."""
    return [
        write_exr(folder / f"{name}_displacement.exr", atlas.image),
        write_exr(folder / f"{name}_age.exr", table_rows(known.age_table)),
        write_exr(folder / f"{name}_color.exr", np.maximum(table_rows(known.strip[:, :3]), 0.0)),
        write_exr(folder / f"{name}_lateness.exr", table_rows(known.strip[:, 3])),
    ]
