"""The solid texture's arrays and attributes, as they stand in its file (docs/solid_texture.md)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from woodfit import zarr_zip
from woodfit.cylinder_grid import CylinderGrid
from woodfit.fine_grain import FineGrain
from woodfit.seen import Seen

if TYPE_CHECKING:
    from woodfit.solid_texture import SolidTexture

Arrays = dict[str, npt.NDArray[Any]]

FORMAT = "woodpipe solid texture"
FORMAT_VERSION = 3

#: Versions that are read. The first had no stem, no fine grain, and mm for its only unit; the second did not say what
#: was seen, and its grain, of the same statistics, lay elsewhere (64-bit hashes).
_READ = (1, 2, 3)


def write(texture: SolidTexture, path: Path) -> None:
    """Write a texture to one self-contained file."""
    grain = texture.fine_grain
    arrays: Arrays = {
        "board_to_tree": np.asarray(texture.board_to_tree, np.float64),
        "stem": np.asarray(texture.stem, np.float64),
        "displacement": np.asarray(texture.displacement, np.float32),
        "ring_radius": np.asarray(texture.ring_radius, np.float64),
        "color_strip": np.asarray(texture.color_strip, np.float32),
        "lateness_strip": np.asarray(texture.lateness_strip, np.float32),
        "grid_radius": texture.grid.radius,
        "grid_azimuth": texture.grid.azimuth,
        "grid_height": texture.grid.height,
        "grain_kind": np.asarray(grain.kind, np.int64),
        "grain_cells": np.asarray(grain.cells, np.float64),
        "grain_density": np.asarray(grain.density, np.float64),
        "grain_amplitude": np.asarray(grain.amplitude, np.float64),
        "grain_color": np.asarray(grain.color, np.float64),
        "grain_log_mean": np.asarray(grain.log_mean, np.float64),
        "seen_plane": np.asarray(texture.seen.plane, np.float64),
        "seen_size": np.asarray(texture.seen.size, np.float64),
        "seen_ages": np.asarray(texture.seen.ages, np.float64),
    }
    attributes = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "unit": texture.unit,
        "pixel_size": texture.pixel_size,
        "samples_per_ring": texture.samples_per_ring,
        "azimuth_wraps": texture.grid.wraps,
        "grain_seed": grain.seed,
        **texture.attributes,
    }
    zarr_zip.write(path, arrays, attributes)


def read(path: Path) -> dict[str, Any]:
    """Fields of the texture in a file.

    Raises
    ------
    woodfit.zarr_zip.TextureFileError
        When the file is missing, damaged, of another kind or of a later version.
    """
    arrays, attributes = zarr_zip.read(path)
    if attributes.pop("format", None) != FORMAT:
        raise zarr_zip.TextureFileError(f"{path}: a Zarr group, but not a {FORMAT}")
    version = attributes.pop("format_version", None)
    if version not in _READ:
        raise zarr_zip.TextureFileError(
            f"{path}: texture format version {version}, this woodpipe reads versions "
            + " and ".join([", ".join(str(known) for known in _READ[:-1]), str(_READ[-1])])
        )
    if version == 1:
        _from_first(arrays, attributes)
    try:
        if version < 3:
            _from_second(arrays, attributes)
        return _fields(arrays, attributes)
    except KeyError as missing:
        raise zarr_zip.TextureFileError(f"{path}: the texture lacks {missing}") from None
    except (TypeError, ValueError) as wrong:
        raise zarr_zip.TextureFileError(f"{path}: the texture is damaged ({wrong})") from None


def _from_first(arrays: Arrays, attributes: dict[str, Any]) -> None:
    """Make what a file of version 1 holds into what one of version 2 would."""
    grain = FineGrain.none()
    arrays |= {
        "stem": np.zeros(3),
        "grain_kind": grain.kind,
        "grain_cells": grain.cells,
        "grain_density": grain.density,
        "grain_amplitude": grain.amplitude,
        "grain_color": grain.color,
        "grain_log_mean": grain.log_mean,
    }
    attributes["grain_seed"] = grain.seed
    if "pixel_size_mm" in attributes:
        attributes["pixel_size"] = attributes.pop("pixel_size_mm")
        attributes["unit"] = "px" if attributes["pixel_size"] is None else "mm"


def _from_second(arrays: Arrays, attributes: dict[str, Any]) -> None:
    """As `_from_first`, from version 2 to 3: the one face of a plain scan, and every ring of the table."""
    size = attributes.get("face_size_px")
    face = isinstance(size, list) and len(size) == 2
    one = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]
    arrays["seen_plane"] = np.array(one if face else np.zeros((0, 3, 3)))
    arrays["seen_size"] = np.array([size], np.float64) - 1.0 if face else np.zeros((0, 2))
    arrays["seen_ages"] = np.array([0.0, len(arrays["ring_radius"]) - 1.0])


def _fields(arrays: Arrays, attributes: dict[str, Any]) -> dict[str, Any]:
    grid = CylinderGrid(
        arrays["grid_radius"], arrays["grid_azimuth"], arrays["grid_height"], bool(attributes.pop("azimuth_wraps"))
    )
    _check_shapes(arrays, grid)
    size, unit = attributes.pop("pixel_size"), str(attributes.pop("unit"))
    return {
        "board_to_tree": arrays["board_to_tree"],
        "grid": grid,
        "displacement": arrays["displacement"],
        "ring_radius": arrays["ring_radius"],
        "color_strip": arrays["color_strip"],
        "lateness_strip": arrays["lateness_strip"],
        "samples_per_ring": int(attributes.pop("samples_per_ring")),
        "pixel_size": None if size is None else float(size),
        "length_unit": unit if size is not None else "mm",
        "stem": arrays["stem"],
        "fine_grain": FineGrain(
            kind=arrays["grain_kind"],
            cells=arrays["grain_cells"],
            density=arrays["grain_density"],
            amplitude=arrays["grain_amplitude"],
            color=arrays["grain_color"],
            log_mean=arrays["grain_log_mean"],
            seed=int(attributes.pop("grain_seed")),
        ),
        "seen": Seen(arrays["seen_plane"], arrays["seen_size"], arrays["seen_ages"]),
        "attributes": attributes,
    }


def _check_shapes(arrays: Arrays, grid: CylinderGrid) -> None:
    """Raise `ValueError` when the arrays of a file do not fit each other."""
    samples, rings = max(2, len(arrays["color_strip"])), max(2, len(arrays["ring_radius"]))
    noises = len(arrays["grain_kind"])
    expected = {
        "board_to_tree": (4, 4),
        "stem": (3,),
        "displacement": tuple(max(2, n) for n in grid.shape),
        "ring_radius": (rings,),
        "color_strip": (samples, 3),
        "lateness_strip": (samples,),
        "grain_kind": (noises,),
        "grain_cells": (noises, 3),
        "grain_density": (noises,),
        "grain_amplitude": (noises, 2),
        "grain_color": (noises, 3),
        "grain_log_mean": (5, 3),
        "seen_plane": (len(arrays["seen_size"]), 3, 3),
        "seen_size": (len(arrays["seen_size"]), 2),
        "seen_ages": (2,),
    }
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise ValueError(f"`{name}` has shape {arrays[name].shape}, expected {shape}")
    if noises and not (arrays["grain_cells"] > 0.0).all():
        raise ValueError("`grain_cells` holds sizes that are not positive")
