"""The faces of a block side by side on a sheet, where the stages had them below one another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from stages.faces import SIZES, UNIT
from stages.variables import FACE_PLANE, FACE_TOP, RENDERED, RGB
from woodfit.planes import Planes

Array = npt.NDArray[Any]

_ASPECT = 1.5
_GAP_SHARE = 0.03

#: Linear gray between the faces, near the color of the page.
_PAPER = 0.93


@dataclass(frozen=True)
class BlockView:
    """A block as its page shows it.

    Parameters
    ----------
    corners
        Outer corners of each face, in order around it, board frame, px; shape (F, 4, 3).
    places
        x, y of each face's outer top-left corner on the sheet, px.
    sizes
        Width and height of each photograph, px.
    """

    corners: Array
    places: tuple[tuple[float, float], ...]
    sizes: tuple[tuple[int, int], ...]

    @property
    def box(self) -> tuple[Array, Array]:
        """Opposite corners of the box that holds all faces, board frame, px; a lone face gets some depth."""
        points = self.corners.reshape(-1, 3)
        extent = np.ptp(points, axis=0)
        if extent.min() < 0.05 * extent.max():
            right, down = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 3] - self.corners[:, 0]
            inward = np.cross(right, down)
            inward /= np.linalg.norm(inward, axis=1, keepdims=True)
            depth = 0.4 * min(np.linalg.norm(right, axis=1).min(), np.linalg.norm(down, axis=1).min())
            points = np.concatenate([points, (self.corners + depth * inward[:, None]).reshape(-1, 3)])
        return points.min(axis=0), points.max(axis=0)


def block_view(ds: xr.Dataset) -> tuple[xr.Dataset, BlockView | None]:
    """A block's dataset laid out on a sheet, and where its faces lie; a single scan's as it is, and None."""
    if FACE_PLANE.name not in ds or not ds[FACE_PLANE.name].attrs.get(UNIT):
        return ds, None
    sizes = [(int(width), int(height)) for width, height in ds[FACE_PLANE.name].attrs[SIZES]]
    planes = Planes(ds[FACE_PLANE.name].values, ds[FACE_TOP.name].values)
    y = np.asarray(ds["y"].values, float)
    step = round(float(y[1] - y[0])) if len(y) > 1 else 1
    cells = [(width // step, height // step) for width, height in sizes]
    spots, shape = _arrange(cells)
    rows = [round(float(top)) // step for top in planes.top]
    centre = 0.5 * (step - 1)
    coords = {"y": np.arange(shape[0]) * float(step) + centre, "x": np.arange(shape[1]) * float(step) + centre}
    laid = {
        name: _sheet(array, rows, cells, spots, shape)
        for name, array in ds.data_vars.items()
        if {"y", "x"} <= set(array.dims)
    }
    moved = _moved(ds, planes, spots, step)
    sheet = ds.drop_vars([*laid, *moved, "y", "x"]).assign({**laid, **moved}).assign_coords(coords)
    places = tuple((column * step - 0.5, row * step - 0.5) for row, column in spots)
    return sheet, BlockView(_corners(planes, sizes), places, tuple(sizes))


def _arrange(cells: Sequence[tuple[int, int]]) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Row and column of each face on the sheet whose shape suits a screen best, and the sheet's shape."""
    gap = max(2, round(_GAP_SHARE * max(max(cell) for cell in cells)))
    best: tuple[float, list[tuple[int, int]], tuple[int, int]] | None = None
    for per_row in range(1, len(cells) + 1):
        spots, top, widest = [], 0, 0
        for start in range(0, len(cells), per_row):
            left = 0
            for width, _ in cells[start : start + per_row]:
                spots.append((top, left))
                left += width + gap
            widest = max(widest, left - gap)
            top += max(height for _, height in cells[start : start + per_row]) + gap
        shape = (top - gap, widest)
        badness = abs(math.log(shape[1] / shape[0] / _ASPECT))
        if best is None or badness < best[0]:
            best = badness, spots, shape
    assert best is not None
    return best[1], best[2]


def _sheet(
    array: xr.DataArray,
    rows: Sequence[int],
    cells: Sequence[tuple[int, int]],
    spots: Sequence[tuple[int, int]],
    shape: tuple[int, int],
) -> xr.DataArray:
    """One image variable on the sheet, lazy if it is."""
    fill = array.dtype.type(_PAPER if array.name in (RGB.name, RENDERED.name) else 0)
    bands = []
    tops = sorted({top for top, _ in spots})
    for top, below in zip(tops, [*tops[1:], shape[0]], strict=True):
        parts, right = [], 0
        members = [number for number, spot in enumerate(spots) if spot[0] == top]
        for number in members:
            (width, height), left = cells[number], spots[number][1]
            face = array.variable.isel(y=slice(rows[number], rows[number] + height), x=slice(0, width))
            is_last = number == members[-1]
            end = shape[1] - left - width if is_last else 0
            padding = {"y": (0, below - top - height), "x": (left - right, end)}
            parts.append(face.pad(padding, mode="constant", constant_values=fill).astype(array.dtype).data)
            right = left + width
        bands.append(_concatenated(parts, array.dims.index("x")))
    joined = _concatenated(bands, array.dims.index("y"))
    return xr.DataArray(joined, dims=array.dims, attrs=array.attrs, name=array.name)


def _concatenated(parts: Sequence[Any], axis: int) -> Any:
    if all(isinstance(part, np.ndarray) for part in parts):
        return np.concatenate(parts, axis=axis)
    import dask.array as da

    return da.concatenate(parts, axis=axis)


def _moved(ds: xr.Dataset, planes: Planes, spots: Sequence[tuple[int, int]], step: int) -> dict[str, xr.DataArray]:
    """Places in px, x and y apart, carried from below one another to their face's spot on the sheet."""
    places = np.array(spots, float) * step
    moved = {}
    for name in map(str, ds.data_vars):
        if ds[name].dims[-1:] == ("side",) and ds[name].attrs.get("units") == "px":
            box = ds[name].values
            face = planes.face_of(box[..., 1])
            across, down = places[face, 1], places[face, 0] - planes.top[face]
            moved[name] = ds[name].copy(data=box + np.stack([across, down, across, down], axis=-1))
            continue
        other = f"{name[:-2]}_x"
        if not (name.endswith("_y") and other in ds and ds[name].dims and ds[name].attrs.get("units") == "px"):
            continue
        x, y = ds[other].values, ds[name].values
        face = planes.face_of(np.nan_to_num(y))
        moved[other] = ds[other].copy(data=x + places[face, 1])
        moved[name] = ds[name].copy(data=y - planes.top[face] + places[face, 0])
    return moved


def _corners(planes: Planes, sizes: Sequence[tuple[int, int]]) -> Array:
    return np.stack(
        [
            planes.plane[face, 0]
            + np.array([[x, y] for x, y in ((-0.5, -0.5), (w - 0.5, -0.5), (w - 0.5, h - 0.5), (-0.5, h - 0.5))])
            @ planes.plane[face, 1:]
            for face, (w, h) in enumerate(sizes)
        ]
    )
