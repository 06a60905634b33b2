"""Blender: a script that builds the wood as a node group and a material, and its tables as EXR."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.export.registry import Options
from pipeline.export.table_images import ROW, Atlas, displacement_atlas, write_tables
from woodfit.appearance import SATIN
from woodfit.shader_tables import Axis, ShaderTables, tables_of

if TYPE_CHECKING:
    from woodfit import SolidTexture


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``woodpipe_NAME.py`` and the tables that its node group looks up."""
    known = tables_of(texture)
    atlas = displacement_atlas(known)
    files = write_tables(known, atlas, folder, options.name)
    about = json.dumps(_about(known, atlas, options.name), indent=1)
    script = (resources.files("pipeline.export") / "blender_script.py.txt").read_text(encoding="utf-8")
    path = folder / f"woodpipe_{options.name}.py"
    path.write_text(script.replace("@ABOUT@", about), encoding="utf-8")
    return [path, *files]


def _about(known: ShaderTables, atlas: Atlas, name: str) -> dict[str, Any]:
    """The numbers of the node group."""

    def axis(one: Axis) -> dict[str, float]:
        return {"first": one.first, "step": one.step, "count": one.count}

    return {
        "name": name,
        "unit": known.unit,
        "row": ROW,
        "axes": (known.axes * np.array([1.0, -1.0, -1.0]) / known.pixel_size).tolist(),
        "origin": known.origin.tolist(),
        "stem": known.stem.tolist(),
        "radius": axis(known.radius),
        "azimuth": axis(known.azimuth),
        "height": axis(known.height),
        "wraps": known.wraps,
        "turn": float(known.azimuth.count) if known.wraps else 2.0 * np.pi / known.azimuth.step,
        "columns": atlas.columns,
        "atlas": list(atlas.image.shape),
        "rings": {
            "first": float(known.ring_radius[0]),
            "last": float(known.ring_radius[-1]),
            "age_step": known.age_step,
            "ages": len(known.age_table),
            "first_age": known.first_age,
            "mean_width": known.mean_width,
            "first_width": known.first_width,
        },
        "strip": {
            "size": known.strip_size,
            "period": known.strip_period,
            "samples": known.samples_per_ring,
            "count": len(known.strip),
        },
        "roughness": [SATIN.roughness_early, SATIN.roughness_late],
        "relief": SATIN.relief * known.ring_width,
    }
