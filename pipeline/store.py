"""Results on disk: written aside, checked, renamed, never changed afterwards.

``results/<stage>/<key>/`` holds ``data.zarr``, ``meta.json`` (what it is and where it comes from; the same
whenever and wherever it is computed) and ``provenance.json`` (when, how long, with which versions).
"""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.keys import hash_tree, joint_key
from pipeline.layout import Layout, read_json, write_json

if TYPE_CHECKING:
    import xarray as xr

CHUNK = 1024
FORMAT = 1


@dataclass(frozen=True)
class Meta:
    """What a complete result is.

    Parameters
    ----------
    stage, version, params
        The stage and its full parameters.
    inputs
        Provider to the key of its result.
    input_digests
        Provider to the digest of its values when they were read.
    digest
        Hash of the stored values.
    variables
        Variable name to its dims and shape.
    warnings, figures
        What the stage had to say.
    """

    stage: str
    version: int
    params: Mapping[str, Any]
    inputs: Mapping[str, str]
    input_digests: Mapping[str, str]
    digest: str = ""
    variables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    figures: Mapping[str, float | str] = field(default_factory=dict)
    format: int = FORMAT


def rings_found(metas: Iterable[Meta]) -> int | None:
    """Different ring boundaries that a scan's results tell of; ``None`` before they were traced."""
    from stages.variables import RING_COUNT_FIGURE

    counts = [meta.figures[RING_COUNT_FIGURE] for meta in metas if RING_COUNT_FIGURE in meta.figures]
    return int(counts[0]) if counts else None


def joint_meta(metas: Sequence[Meta]) -> Meta:
    """The results of one stage of all faces of a block as one: other values of any face are other values."""
    first = metas[0]
    return Meta(first.stage, first.version, {}, {}, {}, joint_key([meta.digest for meta in metas]))


def read_meta(layout: Layout, stage: str, key: str) -> Meta | None:
    """What is known of a complete result; ``None`` if there is none."""
    stored = read_json(layout.result(stage, key) / "meta.json")
    if not isinstance(stored, dict) or stored.get("format") != FORMAT:
        return None
    return Meta(**stored)


def read_provenance(layout: Layout, stage: str, key: str) -> dict[str, Any]:
    """When and how a result was computed."""
    stored = read_json(layout.result(stage, key) / "provenance.json")
    return stored if isinstance(stored, dict) else {}


def open_data(folder: Path) -> xr.Dataset:
    """Open a stored dataset lazily, without dask."""
    import xarray as xr

    options: dict[str, Any] = {"chunks": None, "consolidated": False, "zarr_format": 3}
    ds: xr.Dataset = xr.open_zarr(folder / "data.zarr", decode_times=False, mask_and_scale=False, **options)
    return ds


def write_data(ds: xr.Dataset, folder: Path, compute: bool = True) -> None:
    """Write a dataset as ``data.zarr`` in `folder`; with ``compute=False`` leave dask-backed values out."""
    ds = storable(ds)
    encoding = {str(name): _encoding(ds[name]) for name in ds.variables}
    options: dict[str, Any] = {"zarr_format": 3, "consolidated": False, "encoding": encoding, "compute": compute}
    ds.to_zarr(folder / "data.zarr", mode="w", **options)


def storable(ds: xr.Dataset) -> xr.Dataset:
    """The dataset without old encodings, in chunks that match the store's, with plain attributes."""
    import numpy as np

    ds = ds.drop_encoding()
    texts = {
        name: coord.astype(np.dtypes.StringDType()) for name, coord in ds.coords.items() if coord.dtype.kind == "U"
    }
    ds = ds.assign_coords(texts)
    ds.attrs = plain(ds.attrs)
    for variable in ds.variables.values():
        variable.attrs = plain(variable.attrs)
    if ds.chunks:
        ds = ds.chunk({dim: _aligned(sizes) if dim in ("y", "x") else -1 for dim, sizes in ds.chunksizes.items()})
    return ds


def plain(value: Any) -> Any:
    """Python values from numpy's, for JSON."""
    import numpy as np

    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def publish(layout: Layout, stage: str, key: str, meta: Meta, provenance: Mapping[str, Any]) -> Meta:
    """Make the partial result the result, in place of any that is there.

    The caller holds the result's lock.
    """
    partial, final = layout.partial(stage, key), layout.result(stage, key)
    meta = Meta(**{**asdict(meta), "digest": hash_tree(partial / "data.zarr"), "variables": _variables(partial)})
    write_json(partial / "provenance.json", provenance)
    write_json(partial / "meta.json", asdict(meta))
    if final.exists():
        aside = final.with_name(f"{key}.old-{uuid.uuid4().hex[:8]}")
        os.rename(final, aside)
        os.rename(partial, final)
        shutil.rmtree(aside, ignore_errors=True)
    else:
        os.rename(partial, final)
    return meta


def _variables(partial: Path) -> dict[str, dict[str, Any]]:
    with open_data(partial) as ds:
        return {
            str(name): {"dims": list(array.dims), "shape": list(array.shape)} for name, array in ds.data_vars.items()
        }


def _aligned(sizes: tuple[int, ...]) -> int:
    """Chunk length for writing: the array's own, rounded up to whole stored chunks."""
    return -(-max(sizes) // CHUNK) * CHUNK


def _encoding(array: xr.DataArray) -> dict[str, Any]:
    from zarr.codecs import ZstdCodec

    encoding: dict[str, Any] = {"_FillValue": None}
    if array.dtype.kind not in "TOSU":
        encoding["compressors"] = (ZstdCodec(level=1),)
    if array.ndim and array.size:
        encoding["chunks"] = tuple(
            min(CHUNK, size) if dim in ("y", "x") else max(size, 1) for dim, size in array.sizes.items()
        )
    return encoding
