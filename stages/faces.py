"""Several faces of one block as one dataset: their images below one another, their polylines in a row (an atlas).

Stages that see a block read this dataset as if it were one scan; `FACE_PLANE` and `FACE_TOP` tell where each face
lies in the wood. A single scan is the block of one face.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from stages.stage import Variable, scalar
from stages.variables import (
    BRIGHT_OUTWARDS,
    CROSSING_GROUP,
    FACE_PITH_X,
    FACE_PITH_Y,
    FACE_PLANE,
    FACE_TOP,
    GAP_SERIES,
    GRAIN_RATIO,
    GROWTH_SURENESS,
    PIXEL_SIZE,
    REDUCTION,
    RING_GROUP,
    RING_SCALE,
    SERIES_KIND,
    STRAIGHT_RUN,
)

#: Rows of nothing between two faces, on the analysed grid.
GAP_ROWS = 4

#: Attributes of `FACE_PLANE`: what the block's lengths are in, empty for a single scan; and of a block, the width
#: and height of each photograph, px.
UNIT, SIZES = "block_unit", "face_size_px"

_IDENTITY = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

Vectors = tuple[tuple[float, float, float], ...]


class FacesError(ValueError):
    """Faces that cannot be joined; the message says in one line why."""


@dataclass(frozen=True)
class Faces:
    """Where the faces of a block lie.

    Parameters
    ----------
    plane
        For each face three vectors (board frame, px): the point of its own pixel (0, 0), then what one px to the
        right and one px down add.
    size_px
        Width and height of each photograph, px.
    pixel_size
        Block units per px.
    unit
        What a block unit is, in words.
    """

    plane: tuple[Vectors, ...]
    size_px: tuple[tuple[int, int], ...]
    pixel_size: float
    unit: str

    def tops(self, step: int) -> list[int]:
        """Row of the atlas at which each face begins, and how many rows there are in all."""
        rows = [height // step for _, height in self.size_px]
        starts = np.concatenate([[0], np.cumsum([count + GAP_ROWS for count in rows])])
        return [int(start) for start in starts[:-1]] + [int(starts[-1]) - GAP_ROWS]

    def scale(self, face: int) -> float:
        """Px of the block (board frame) for a px of one face's photograph."""
        right, down = np.array(self.plane[face][1]), np.array(self.plane[face][2])
        return float(np.sqrt(np.linalg.norm(right) * np.linalg.norm(down)))


def single_face() -> xr.Dataset:
    """`FACE_PLANE` and `FACE_TOP` of a scan that belongs to no block: z = 0, x right, y down."""
    return _face_variables((_IDENTITY,), [0.0], "")


def companions(names: Iterable[str]) -> tuple[str, ...]:
    """Names of variables that joining needs beside those that are asked for, as far as they were computed."""
    wanted = set(names)
    more = [REDUCTION.name]
    more += [GROWTH_SURENESS.name] * (BRIGHT_OUTWARDS.name in wanted)
    more += [RING_GROUP.name] * (CROSSING_GROUP.name in wanted)
    more += [SERIES_KIND.name] * (GAP_SERIES.name in wanted)
    return tuple(name for name in more if name not in wanted)


def join_faces(parts: Sequence[xr.Dataset], faces: Faces) -> xr.Dataset:
    """One dataset of several faces.

    Images ``(y, x)`` are stacked below one another, 0 or False beside and between them; their coordinates go on in
    equal steps. Ragged arrays follow one another: every ``…_y`` in px and every box (dim ``side``: left, top, right,
    bottom) moves with its face, groups and series are numbered on. What a face has one number of is joined as
    `_SCALARS` says, else the first face's is taken.

    Parameters
    ----------
    parts
        The same variables of each face, each in the frame of its own photograph; in memory or lazy.
    faces
        Where they lie.

    Returns
    -------
    xr.Dataset
        Those variables, and `FACE_PLANE` and `FACE_TOP`.

    Raises
    ------
    FacesError
        When the faces are analysed at different reductions or stored with different depths.
    """
    step = _common_step(parts)
    tops = faces.tops(step)
    plain = _face_variables(faces.plane, [float(top * step) for top in tops[:-1]], faces.unit)
    plain[FACE_PLANE.name].attrs[SIZES] = [list(size) for size in faces.size_px]
    # A variable that has the name of some dimension counts as a coordinate once it was stored.
    names = [str(name) for name, variable in parts[0].variables.items() if variable.dims != (name,)]
    joined = {name: _join(name, parts, faces, tops, step) for name in names}
    coords = {}
    if any("y" in array.dims for array in joined.values()):
        rows, columns = tops[-1], max(width // step for width, _ in faces.size_px)
        centre = 0.5 * (step - 1)
        coords = {"y": np.arange(rows) * float(step) + centre, "x": np.arange(columns) * float(step) + centre}
    return xr.Dataset({**joined, **plain.data_vars}, coords=coords)


def _face_variables(plane: Sequence[Vectors], tops: Sequence[float], unit: str) -> xr.Dataset:
    planes = FACE_PLANE.array(np.array(plane, float))
    planes.attrs[UNIT] = unit
    return xr.Dataset({FACE_PLANE.name: planes, FACE_TOP.name: FACE_TOP.array(np.array(tops, float))})


def _common_step(parts: Sequence[xr.Dataset]) -> int:
    """Scan px per array element, which all faces must share; 1 where none was chosen."""
    steps = [int(scalar(part, REDUCTION)) if REDUCTION.name in part else 1 for part in parts]
    if len(set(steps)) > 1:
        told = ", ".join(f"1:{step}" for step in steps)
        raise FacesError(f"the faces are analysed at different reductions ({told}); set `scan.reduction`")
    return steps[0]


def _join(name: str, parts: Sequence[xr.Dataset], faces: Faces, tops: Sequence[int], step: int) -> xr.DataArray:
    """One variable of all faces."""
    arrays = [_bare(part, name) for part in parts]
    first = arrays[0]
    if first.dtype.kind == "u" and len({array.dtype for array in arrays}) > 1:
        told = ", ".join(str(array.dtype) for array in arrays)
        raise FacesError(f"`{name}` of the faces has values of different ranges ({told}); store them with equal depth")
    if {"y", "x"} <= set(first.dims):
        return _below_one_another(arrays, faces, tops, step)
    if not first.dims:
        joined = _SCALARS[name](parts, faces) if name in _SCALARS else first.values
        return xr.DataArray(np.asarray(joined, first.dtype), attrs=first.attrs, name=name)
    if name.endswith("_y") and first.attrs.get("units") == "px":
        arrays = [array + float(top * step) for array, top in zip(arrays, tops, strict=False)]
    elif first.dims[-1] == "side" and first.attrs.get("units") == "px":
        # Left, top, right, bottom.
        moves = [xr.DataArray(np.array([0.0, 1.0, 0.0, 1.0]) * top * step, dims="side") for top in tops]
        arrays = [array + move for array, move in zip(arrays, moves, strict=False)]
    elif name in _NUMBERED:
        arrays = [array + shift for array, shift in zip(arrays, _offsets(parts, *_NUMBERED[name], name), strict=True)]
    return _row([array.astype(first.dtype).variable for array in arrays], first, 0)


def _bare(part: xr.Dataset, name: str) -> xr.DataArray:
    """A variable without coordinates; labels of things on one face do not name things on another."""
    variable = part.variables[name]
    return xr.DataArray(variable.data, dims=variable.dims, attrs=variable.attrs, name=name)


def _below_one_another(arrays: Sequence[xr.DataArray], faces: Faces, tops: Sequence[int], step: int) -> xr.DataArray:
    """Images padded to one width, with rows of nothing between them."""
    wide = max(width // step for width, _ in faces.size_px)
    padded = []
    for number, (array, (width, height)) in enumerate(zip(arrays, faces.size_px, strict=True)):
        found, expected = (array.sizes["y"], array.sizes["x"]), (height // step, width // step)
        if found != expected:
            raise FacesError(f"`{array.name}` of face {number} has {found} rows and columns, expected {expected}")
        below = GAP_ROWS if number + 1 < len(arrays) else 0
        # 0 and not NaN: a weight beside the wood has to be no weight at all.
        nothing = array.dtype.type(0)
        image = array.variable.pad(
            y=(0, below), x=(0, wide - array.sizes["x"]), mode="constant", constant_values=nothing
        )
        padded.append(image.astype(array.dtype))
    return _row(padded, arrays[0], arrays[0].dims.index("y"))


def _row(variables: Sequence[xr.Variable], like: xr.DataArray, axis: int) -> xr.DataArray:
    """Arrays after one another along an axis, lazy if they are."""
    data: Any = [variable.data for variable in variables]
    if like.chunks:
        import dask.array as da

        joined = da.concatenate(data, axis=axis)
    else:
        joined = np.concatenate(data, axis=axis)
    return xr.DataArray(joined, dims=like.dims, attrs=like.attrs, name=like.name)


def _offsets(parts: Sequence[xr.Dataset], told_by: Variable, is_count: bool, name: str) -> list[int]:
    """What to add to each face's numbers so that no two faces share one."""
    leader = told_by.name if told_by.name in parts[0] else name
    offsets = [0]
    for part in parts[:-1]:
        values = part[leader].values
        used = len(values) if is_count and leader == told_by.name else int(values.max()) + 1 if len(values) else 0
        offsets.append(offsets[-1] + used)
    return offsets


#: Variables that number things: whose values tell how many numbers a face uses, and whether by its length.
_NUMBERED: dict[str, tuple[Variable, bool]] = {
    RING_GROUP.name: (RING_GROUP, False),
    CROSSING_GROUP.name: (RING_GROUP, False),
    GAP_SERIES.name: (SERIES_KIND, True),
}

Rule = Callable[[Sequence[xr.Dataset], Faces], object]


def _each(parts: Sequence[xr.Dataset], variable: Variable) -> list[float]:
    return [scalar(part, variable) for part in parts]


def _least_length(variable: Variable) -> Rule:
    """Rule: the least of the faces' lengths, in px of the block."""

    def rule(parts: Sequence[xr.Dataset], faces: Faces) -> float:
        lengths = [length * faces.scale(number) for number, length in enumerate(_each(parts, variable))]
        return float(np.nanmin(lengths)) if np.isfinite(lengths).any() else float("nan")

    return rule


def _median(variable: Variable) -> Rule:
    def rule(parts: Sequence[xr.Dataset], faces: Faces) -> float:
        values = [value for value in _each(parts, variable) if np.isfinite(value)]
        return float(np.median(values)) if values else float("nan")

    return rule


def _only_of_one(variable: Variable) -> Rule:
    """Rule: a place on a photograph says nothing about the others."""

    def rule(parts: Sequence[xr.Dataset], faces: Faces) -> float:
        return scalar(parts[0], variable) if len(parts) == 1 else float("nan")

    return rule


def _surest(parts: Sequence[xr.Dataset], faces: Faces) -> float:
    return float(np.nanmax(_each(parts, GROWTH_SURENESS)))


def _brightens(parts: Sequence[xr.Dataset], faces: Faces) -> bool:
    """Majority of the faces, each with the weight by which it is more than a guess."""
    votes = [1.0 if vote else -1.0 for vote in _each(parts, BRIGHT_OUTWARDS)]
    weights = [1.0] * len(parts)
    if GROWTH_SURENESS.name in parts[0]:
        weights = [max(sure - 0.5, 1e-6) for sure in _each(parts, GROWTH_SURENESS)]
    return float(np.dot(votes, weights)) >= 0


_SCALARS: dict[str, Rule] = {
    PIXEL_SIZE.name: lambda parts, faces: faces.pixel_size,
    RING_SCALE.name: _least_length(RING_SCALE),
    STRAIGHT_RUN.name: _least_length(STRAIGHT_RUN),
    GRAIN_RATIO.name: _median(GRAIN_RATIO),
    GROWTH_SURENESS.name: _surest,
    BRIGHT_OUTWARDS.name: _brightens,
    FACE_PITH_X.name: _only_of_one(FACE_PITH_X),
    FACE_PITH_Y.name: _only_of_one(FACE_PITH_Y),
}
