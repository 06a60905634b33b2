"""Four small stages with the shapes of the real ones: source, tile-local, global, two inputs."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from stages.stage import Params, Stage, Variable
from stages.variables import DPI_PIXEL_SIZE, ENCODED, OPAQUE, PIXEL_SIZE, VALID, VALUE

SMOOTH = Variable("smooth", ("y", "x"), "f", "1", "Box mean of the value.")
WAVE = Variable("wave", ("y", "x"), "c", "1", "A complex wave.")
LEVEL = Variable("level", ("ring",), "f", "1", "Row means.")
SUMMARY = Variable("summary", (), "f", "1", "One number.")


class ReadParams(Params):
    gain: float = 1.0
    """Factor on the value."""


class SmoothParams(Params):
    radius: int = 2
    """Half width of the box, px."""


class LevelParams(Params):
    count: int = 5
    """Number of levels."""
    label: str = "mean"
    """A word."""


class SummaryParams(Params):
    power: float = 1.0
    """Exponent."""


def stage(**contract: Any) -> Any:
    """Declare a stage named after its function: these share one module."""
    types = {"params_type": contract.pop("params")}
    return lambda function: Stage(function.__name__, function, **types, **contract)


def _note(name: str) -> None:
    """Leave a trace of each call, and dawdle if asked to."""
    if "DUMMY_LOG" in os.environ:
        with Path(os.environ["DUMMY_LOG"]).open("a") as file:
            file.write(name + "\n")
    time.sleep(float(os.environ.get("DUMMY_SECONDS", "0")))


@stage(requires=(ENCODED, OPAQUE, DPI_PIXEL_SIZE), provides=(VALUE, VALID, PIXEL_SIZE), version=1, params=ReadParams)
def read(ds: xr.Dataset, params: ReadParams) -> xr.Dataset:
    """Mean of the channels."""
    _note("read")
    encoded = ds[ENCODED.name]
    top = float(np.iinfo(encoded.dtype).max)
    value = (encoded.astype("f4").mean("channel") * (params.gain / top)).astype("f4")
    return xr.Dataset(
        {
            VALUE.name: VALUE.array(value.data, value.coords),
            VALID.name: VALID.array(ds[OPAQUE.name].data),
            PIXEL_SIZE.name: PIXEL_SIZE.array(float(ds[DPI_PIXEL_SIZE.name])),
        }
    )


@stage(
    requires=(VALUE, PIXEL_SIZE),
    provides=(SMOOTH, WAVE),
    version=1,
    params=SmoothParams,
    halo=lambda ds, params: params.radius,
)
def smooth(ds: xr.Dataset, params: SmoothParams) -> xr.Dataset:
    """Box mean by shifted sums: every pixel's sum runs in the same order in any window."""
    _note("smooth")
    value = ds[VALUE.name].values.astype("f8")
    padded = np.pad(value, params.radius, mode="edge")
    total = np.zeros_like(value)
    span = 2 * params.radius + 1
    for dy in range(span):
        for dx in range(span):
            total += padded[dy : dy + value.shape[0], dx : dx + value.shape[1]]
    mean = (total / span**2).astype("f4")
    attrs = {"warnings": ["smooth was here"], "figures": {"radius": params.radius}}
    waves = np.exp(1j * mean).astype("c8")
    return xr.Dataset(
        {SMOOTH.name: SMOOTH.array(mean, ds[VALUE.name].coords), WAVE.name: WAVE.array(waves)}, attrs=attrs
    )


@stage(requires=(SMOOTH,), provides=(LEVEL,), version=1, params=LevelParams)
def level(ds: xr.Dataset, params: LevelParams) -> xr.Dataset:
    """Means of bands of rows."""
    _note("level")
    if os.environ.get("DUMMY_FAIL") == params.label:
        raise RuntimeError("no rings here\nand more detail")
    if os.environ.get("DUMMY_DIE") == params.label:
        os._exit(7)
    bands = np.array_split(ds[SMOOTH.name].values, params.count)
    return xr.Dataset({LEVEL.name: LEVEL.array(np.array([band.mean() for band in bands]))})


@stage(requires=(VALUE, LEVEL), provides=(SUMMARY,), version=1, params=SummaryParams)
def summary(ds: xr.Dataset, params: SummaryParams) -> xr.Dataset:
    """One number from two inputs."""
    _note("summary")
    number = float(ds[LEVEL.name].sum()) ** params.power + float(ds[VALUE.name].mean())
    return xr.Dataset({SUMMARY.name: SUMMARY.array(number)}, attrs={"figures": {"sum": np.float32(number)}})


STAGES = (read, smooth, level, summary)


@dataclass(frozen=True)
class Product:
    """What the pipeline asks of a product."""

    name: str
    filename: str
    requires: tuple[Variable, ...]
    version: int
    write: Any


def write_text(ds: xr.Dataset, path: Path, context: Any) -> None:
    """A product for the tests."""
    _note("product")
    lines = [context.scan.name, *context.warnings, *sorted(context.keys), f"{float(ds[SUMMARY.name]):.6f}"]
    path.write_text("\n".join(lines))


def write_nothing(ds: xr.Dataset, path: Path, context: Any) -> None:
    """A product that breaks its promise."""


PRODUCTS = (Product("text", "text.txt", (SUMMARY, SMOOTH), 1, write_text),)
