"""Tile-local stages of large scans: one task per tile, each reads its window and writes its core.

A tile is a whole number of stored chunks, so every chunk has one writer. A marker per finished tile lets an
interrupted run go on where it stopped. The first tile also lays out the store, since only the stage's own
answer tells the dtypes and further dims of what it provides.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.jobs import Outcome, StageJob, Status
from pipeline.layout import Layout, read_json, write_json
from pipeline.store import CHUNK, Meta, publish, write_data
from pipeline.tasks import guarded, provenance, read_inputs, said, threaded_dask
from pipeline.threads import limit_threads
from pipeline.tiles import Tile, tiles

if TYPE_CHECKING:
    import xarray as xr


def begin_tiles(partial: Path, shape: tuple[int, int], side: int, digests: Mapping[str, str]) -> set[str]:
    """Prepare the partial result; returns the names of tiles that are already done.

    What was done with other tiles, or from other values, is thrown away.
    """
    wanted = {"shape": list(shape), "side": side, "digests": dict(digests)}
    if read_json(partial / "layout.json") != wanted or not (partial / "template.json").exists():
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        write_json(partial / "layout.json", wanted)
    return {marker.stem for marker in (partial / "tiles").glob("*.json") if not marker.name.startswith(".")}


@guarded
def run_tile(job: StageJob) -> Outcome:
    """Compute one tile and write its core. The driver holds the result's lock."""
    assert job.tile is not None
    start = time.perf_counter()
    limit_threads(job.threads)
    stage, layout = job.stage.load(), Layout(job.output)
    params = stage.params_type.model_validate(job.params)
    partial = layout.partial(stage.name, job.key)
    with threaded_dask(job.threads):
        whole = read_inputs(layout, job.source, job.inputs, job.wanted, partial / "scratch", load=False)
        shape = whole.sizes["y"], whole.sizes["x"]
        window = job.tile.window(stage.halo(whole, params) if stage.halo else 0, shape)
        result = stage(whole.isel(window).load(), params)
        expected = {dim: part.stop - part.start for dim, part in window.items()}
        found = {dim: result.sizes.get(dim) for dim in expected}
        if found != expected:
            raise ValueError(f"tile-local stage returned size {found}, expected that of its window {expected}")
        core = result.isel(job.tile.core(window))
        if not (partial / "template.json").exists():
            _write_template(core, whole, partial)
        _write_core(core, job.tile, partial)
    warnings, figures = said(result.attrs)
    seconds = time.perf_counter() - start
    marker = {"warnings": warnings, "figures": figures, "seconds": seconds}
    write_json(partial / "tiles" / f"{job.tile.name}.json", marker)
    return Outcome(Status.COMPUTED)


@guarded
def finish_tiles(job: StageJob) -> Outcome:
    """Publish a result whose tiles are all there. The driver holds the result's lock."""
    stage, layout = job.stage.load(), Layout(job.output)
    partial = layout.partial(stage.name, job.key)
    plan = read_json(partial / "layout.json")
    all_tiles = list(tiles((plan["shape"][0], plan["shape"][1]), plan["side"]))
    markers = [read_json(partial / "tiles" / f"{tile.name}.json") for tile in all_tiles]
    if None in markers:
        raise RuntimeError(f"{markers.count(None)} of {len(markers)} tiles are missing")
    areas = [(tile.y1 - tile.y0) * (tile.x1 - tile.x0) for tile in all_tiles]
    meta = Meta(
        stage=stage.name,
        version=stage.version,
        params=job.params,
        inputs=job.inputs,
        input_digests=job.digests,
        warnings=list(dict.fromkeys(warning for marker in markers for warning in marker["warnings"])),
        figures=_mean_figures([marker["figures"] for marker in markers], areas),
    )
    shutil.rmtree(partial / "tiles")
    (partial / "template.json").unlink()
    (partial / "layout.json").unlink()
    details = provenance(
        sum(marker["seconds"] for marker in markers),
        job.reason,
        job.threads,
        tiles=len(all_tiles),
        tile_side=plan["side"],
    )
    return Outcome(Status.COMPUTED, meta=publish(layout, stage.name, job.key, meta, details))


def _write_template(core: xr.Dataset, whole: xr.Dataset, partial: Path) -> None:
    """Lay out the whole store: metadata and coordinates, no values."""
    import dask.array as da
    import xarray as xr

    variables = {}
    for name, array in core.data_vars.items():
        shape = tuple(whole.sizes[dim] if dim in ("y", "x") else size for dim, size in array.sizes.items())
        chunks = tuple(CHUNK if dim in ("y", "x") else size for dim, size in array.sizes.items())
        variables[name] = (array.dims, da.zeros(shape, dtype=array.dtype, chunks=chunks), array.attrs)
    coords = {name: coord for name, coord in core.coords.items() if not {"y", "x"} & set(coord.dims)}
    coords |= {name: whole.coords[name] for name in ("y", "x") if name in whole.coords}
    attrs = {name: value for name, value in core.attrs.items() if name not in ("warnings", "figures")}
    write_data(xr.Dataset(variables, coords=coords, attrs=attrs), partial, compute=False)
    write_json(partial / "template.json", {})


def _write_core(core: xr.Dataset, tile: Tile, partial: Path) -> None:
    from pipeline.store import storable

    region: dict[str, Any] = dict(tile.region)
    bare = storable(core.drop_vars(list(core.coords)))
    bare.to_zarr(partial / "data.zarr", region=region, zarr_format=3, consolidated=False, mode="r+")


def _mean_figures(figures: list[Mapping[str, float | str]], areas: list[int]) -> dict[str, float | str]:
    """Figures of the whole: numbers averaged over the area, texts kept where all tiles agree."""
    merged: dict[str, float | str] = {}
    for name in dict.fromkeys(name for tile in figures for name in tile):
        pairs = [(tile[name], area) for tile, area in zip(figures, areas, strict=True) if name in tile]
        numbers = [(value, area) for value, area in pairs if not isinstance(value, str)]
        if len(numbers) == len(pairs):
            merged[name] = sum(value * area for value, area in numbers) / sum(area for _, area in numbers)
        elif len({value for value, _ in pairs}) == 1:
            merged[name] = pairs[0][0]
    return merged
