"""What a stage is: a named pure function with a declared contract.

A stage takes one labelled dataset and its own frozen parameters and returns one labelled dataset. What it
requires and provides is said once, with the `Variable` objects of :mod:`stages.variables`, and checked from
metadata alone, before a pixel is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from pydantic import (
    BaseModel,
    ConfigDict,
    GetJsonSchemaHandler,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    model_serializer,
)
from pydantic.json_schema import JsonSchemaValue

KEY_CONTEXT = {"names_of_files": False}


class InputFile(BaseModel):
    """A text file as a parameter: the YAML names it, the stage gets what is in it.

    A field is declared ``InputFile | None`` or ``tuple[InputFile, ...]`` and written as a path relative to the YAML,
    with ``{stem}`` for the scan's name without suffix; for a tuple as a glob, or a list of paths and globs.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    name: str
    """Name without folders, for messages; no part of any key."""
    text: str
    """Content."""

    @model_serializer(mode="wrap")
    def _without_name(self, handler: SerializerFunctionWrapHandler, info: SerializationInfo) -> dict[str, Any]:
        fields: dict[str, Any] = handler(self)
        if info.context == KEY_CONTEXT:
            fields.pop("name")
        return fields

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        # As it is written in the YAML.
        return {"type": "string", "format": "path", "description": "Path of a text file."}

    def __str__(self) -> str:
        return self.name


class Params(BaseModel):
    """Frozen parameters of one stage; the string under a field is its help text."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    def key_values(self) -> dict[str, Any]:
        """JSON values that decide the stage's result: all but the names of files."""
        return self.model_dump(mode="json", context=KEY_CONTEXT)


class ContractError(ValueError):
    """A dataset does not carry what a stage declared; the message lists every problem, sorted."""


@dataclass(frozen=True)
class Variable:
    """One quantity that flows between stages.

    Parameters
    ----------
    name
        Name in the dataset.
    dims
        Dimension names in order; ``y, x`` for images, never ``x, y``.
    kind
        Allowed numpy dtype kinds, for example ``"f"``, ``"iu"``, ``"b"`` or ``"c"``.
    units
        Units as stored in ``attrs["units"]``; ``"1"`` for a plain number.
    doc
        One sentence that says what it is.
    """

    name: str
    dims: tuple[str, ...]
    kind: str
    units: str
    doc: str

    def array(self, values: Any, coords: Any = None) -> xr.DataArray:
        """Label `values` as this variable, with its units and meaning as attributes."""
        attrs = {"units": self.units, "long_name": self.doc}
        return xr.DataArray(values, dims=self.dims, coords=coords, name=self.name, attrs=attrs)

    def problems(self, ds: xr.Dataset) -> list[str]:
        """What of this variable's declaration `ds` does not meet (metadata only)."""
        if self.name not in ds:
            return [f"`{self.name}` is missing ({self.doc})"]
        array = ds[self.name]
        found = []
        if array.dims != self.dims:
            found.append(f"`{self.name}` has dims {array.dims}, expected {self.dims}")
        if array.dtype.kind not in self.kind:
            found.append(f"`{self.name}` has dtype {array.dtype}, expected a kind among '{self.kind}'")
        if array.attrs.get("units") != self.units:
            found.append(f"`{self.name}` has units {array.attrs.get('units')!r}, expected {self.units!r}")
        return found


def check_variables(ds: xr.Dataset, variables: Iterable[Variable], who: str) -> None:
    """Raise `ContractError` naming every variable that `ds` lacks or labels otherwise."""
    problems = sorted(problem for variable in variables for problem in variable.problems(ds))
    if problems:
        raise ContractError(f"{who}:\n" + "\n".join(f"  - {problem}" for problem in problems))


@dataclass(frozen=True)
class Stage:
    """A stage as the pipeline sees it.

    Parameters
    ----------
    name
        The module's name: the YAML key, the folder of its results, its test file and its docs page.
    function
        ``function(ds, params) -> xr.Dataset``; pure: the input is not modified.
    params_type
        Its own frozen parameters.
    requires, provides
        Variables read from the stages before, and variables added.
    version
        Goes up when the same inputs and parameters give other numbers.
    halo
        For tile-local stages: ``halo(ds, params)`` gives the margin in array elements along ``y`` and ``x``
        that a tile needs around it for its core to equal the whole image's. `ds` carries at least the 0-d
        variables. ``None`` for stages that see the whole scan at once.
    sees_block
        Whether the faces of a block are seen together, as one dataset (:mod:`stages.faces`). Such stages come
        after all that see one scan at a time; a scan that belongs to no block is a block of one face.
    """

    name: str
    function: Callable[[xr.Dataset, Any], xr.Dataset]
    params_type: type[Params]
    requires: tuple[Variable, ...]
    provides: tuple[Variable, ...]
    version: int
    halo: Callable[[xr.Dataset, Any], int] | None = None
    sees_block: bool = False

    @property
    def summary(self) -> str:
        """First line of the function's docstring."""
        return (self.function.__doc__ or "").strip().splitlines()[0]

    def __call__(self, ds: xr.Dataset, params: Params) -> xr.Dataset:
        """Run the function between the two contract checks."""
        check_variables(ds, self.requires, f"Stage `{self.name}` cannot start")
        result = self.function(ds, params)
        check_variables(result, self.provides, f"Stage `{self.name}` broke its promise")
        declared = {variable.name for variable in self.provides}
        extra = sorted(str(name) for name in set(result.data_vars) - declared)
        if extra:
            raise ContractError(f"Stage `{self.name}` returned undeclared variables: {', '.join(extra)}")
        return result


def stage(
    *,
    requires: tuple[Variable, ...],
    provides: tuple[Variable, ...],
    version: int,
    params: type[Params],
    halo: Callable[[xr.Dataset, Any], int] | None = None,
    sees_block: bool = False,
) -> Callable[[Callable[[xr.Dataset, Any], xr.Dataset]], Stage]:
    """Declare the decorated function as the stage that its module is named after."""

    def declare(function: Callable[[xr.Dataset, Any], xr.Dataset]) -> Stage:
        name = function.__module__.rpartition(".")[2]
        return Stage(name, function, params, requires, provides, version, halo, sees_block)

    return declare


def scalar(ds: xr.Dataset, variable: Variable) -> float:
    """Value of a 0-d variable as a Python float."""
    return float(np.asarray(ds[variable.name].values))


def place_in_array(ds: xr.Dataset, x: Variable, y: Variable) -> tuple[float, float] | None:
    """Column and row of a point given in scan px by two 0-d variables; None where they are NaN."""
    place = []
    for variable, axis in ((x, "x"), (y, "y")):
        centres = ds.coords[axis].values
        spacing = float(centres[1] - centres[0]) if len(centres) > 1 else 1.0
        place.append((scalar(ds, variable) - float(centres[0])) / spacing)
    return (place[0], place[1]) if np.isfinite(place).all() else None


def like_image(ds: xr.Dataset, values: dict[Variable, Any], attrs: dict[str, Any] | None = None) -> xr.Dataset:
    """Dataset of image variables that keeps the pixel coordinates of `ds`."""
    coords = {name: ds.coords[name] for name in ("y", "x") if name in ds.coords}
    return xr.Dataset(
        {variable.name: variable.array(array) for variable, array in values.items()}, coords=coords, attrs=attrs
    )
