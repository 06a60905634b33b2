"""Named arrays in one file: a Zarr v3 group in an uncompressed zip, each array a single gzip chunk.

Any Zarr library opens the file; this module needs none, so that a texture can be read with numpy alone. The bytes
depend on the contents only (no time stamps), so equal textures are equal files.
"""

from __future__ import annotations

import gzip
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

_TYPES = {"float32": "<f4", "float64": "<f8", "int32": "<i4", "int64": "<i8", "uint8": "|u1"}

#: What broken or foreign files make the libraries raise (RuntimeError: encrypted or packed in an unknown way).
_UNREADABLE = (OSError, zipfile.BadZipFile, zlib.error, KeyError, ValueError, TypeError, EOFError, RuntimeError)

#: A texture of a large scan has some tens of MB; far more is not one of ours.
_MOST_BYTES = 2_000_000_000


class TextureFileError(ValueError):
    """A file is not a readable texture; the message says what was found."""


def write(path: Path, arrays: Mapping[str, npt.NDArray[Any]], attributes: Mapping[str, Any]) -> None:
    """Write arrays and JSON attributes; an existing file is replaced only when the new one is whole.

    Parameters
    ----------
    path : Path
        File to write.
    arrays : mapping of str to array
        float32, float64, int32, int64 or uint8.
    attributes : mapping
        Attributes of the group; anything JSON can say.
    """
    temporary = path.with_name(path.name + ".partial")
    try:
        _write(temporary, arrays, attributes)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    temporary.replace(path)


def _write(path: Path, arrays: Mapping[str, npt.NDArray[Any]], attributes: Mapping[str, Any]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        group = {"zarr_format": 3, "node_type": "group", "attributes": dict(attributes)}
        _put(file, "zarr.json", json.dumps(group, indent=1).encode())
        for name, values in arrays.items():
            array = np.ascontiguousarray(values)
            if array.dtype.name not in _TYPES:
                raise TypeError(f"array `{name}` has dtype {array.dtype}, expected one of {', '.join(_TYPES)}")
            meta = {
                "zarr_format": 3,
                "node_type": "array",
                "shape": list(array.shape),
                "data_type": array.dtype.name,
                "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(array.shape)}},
                "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
                "fill_value": 0,
                "codecs": [
                    {"name": "bytes", "configuration": {"endian": "little"}},
                    {"name": "gzip", "configuration": {"level": 6}},
                ],
                "attributes": {},
            }
            chunk = "/".join(["c", *["0"] * array.ndim])
            _put(file, f"{name}/zarr.json", json.dumps(meta, indent=1).encode())
            data = array.astype(_TYPES[array.dtype.name]).tobytes()
            _put(file, f"{name}/{chunk}", gzip.compress(data, compresslevel=6, mtime=0))


def _put(file: zipfile.ZipFile, name: str, data: bytes) -> None:
    file.writestr(zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0)), data)


def read(path: Path) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
    """Arrays and attributes of a file written by `write`.

    Raises
    ------
    TextureFileError
        When the file is missing, truncated or something else.
    """
    try:
        with zipfile.ZipFile(path) as file:
            group = json.loads(file.read("zarr.json"))
            arrays = {}
            for entry in file.namelist():
                if entry.endswith("/zarr.json"):
                    name = entry.removesuffix("/zarr.json")
                    arrays[name] = _array(file, name, json.loads(file.read(entry)))
            return arrays, dict(group["attributes"])
    except FileNotFoundError:
        raise TextureFileError(f"{path}: there is no such file") from None
    except _UNREADABLE as error:
        raise TextureFileError(
            f"{path}: not a readable solid texture ({error}); expected a Zarr v3 group in a zip, as SolidTexture.save "
            "writes it"
        ) from error


def _array(file: zipfile.ZipFile, name: str, meta: Mapping[str, Any]) -> npt.NDArray[Any]:
    shape, kind = tuple(int(n) for n in meta["shape"]), _TYPES[meta["data_type"]]
    size = int(np.prod(shape, dtype=np.float64)) * np.dtype(kind).itemsize
    if min(shape, default=0) < 0 or size > _MOST_BYTES:
        raise ValueError(f"array `{name}` claims the shape {shape}")
    packed = file.read("/".join([name, "c", *["0"] * len(shape)]))
    with gzip.GzipFile(fileobj=io.BytesIO(packed)) as stream:
        data = stream.read(size + 1)
    if len(data) != size:
        raise ValueError(f"array `{name}` holds {len(data)} bytes, expected {size}")
    values: npt.NDArray[Any] = np.frombuffer(data, kind).reshape(shape).astype(meta["data_type"])
    return values
