"""The wood for three.js and any other GLSL: shader source, tables, and a module that makes a material of them."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.export.registry import Options
from pipeline.shaders.packing import ROW, pack
from woodfit.appearance import SATIN
from woodfit.block_extent import block_extent

if TYPE_CHECKING:
    from woodfit import SolidTexture


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.glsl``, ``NAME.bin`` (float32 tables), ``NAME.json`` and ``wood_material.js``."""
    packed, extent = pack(texture), block_extent(texture)
    described = {
        "unit": texture.unit,
        "row": ROW,
        "rows": len(packed.tables),
        "tables": f"{options.name}.bin",
        "shader": f"{options.name}.glsl",
        "detail": options.detail,
        "roughness": {"early": SATIN.roughness_early, "late": SATIN.roughness_late},
        "block": {"low": extent.low.tolist(), "high": extent.high.tolist()},
    }
    contents = {
        f"{options.name}.glsl": packed.source.encode(),
        f"{options.name}.bin": np.ascontiguousarray(packed.tables, "<f4").tobytes(),
        f"{options.name}.json": json.dumps(described, indent=2).encode(),
        "wood_material.js": (resources.files("pipeline.export") / "wood_material.js").read_bytes(),
    }
    files = []
    for name, content in contents.items():
        path = folder / name
        path.write_bytes(content)
        files.append(path)
    return files
