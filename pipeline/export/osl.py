"""Open Shading Language: one shader with color, roughness, relief, ring age and lateness, and its tables as EXR."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.export.grain_source import osl_grain
from pipeline.export.registry import Options
from pipeline.export.table_images import ROW, Atlas, displacement_atlas, write_tables
from pipeline.shaders.packing import shader_text
from woodfit.appearance import SATIN
from woodfit.shader_tables import ShaderTables, tables_of

if TYPE_CHECKING:
    from woodfit import SolidTexture


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.osl`` and the tables that it looks up."""
    known = tables_of(texture)
    atlas = displacement_atlas(known)
    files = write_tables(known, atlas, folder, options.name)
    path = folder / f"{options.name}.osl"
    path.write_text(osl_source(known, atlas, options.name, options.detail), encoding="utf-8")
    return [path, *files]


def osl_source(known: ShaderTables, atlas: Atlas, name: str, detail: bool) -> str:
    """The shader's text, its numbers put in."""
    values = _values(known, atlas, detail)
    body = shader_text("wood.osl.txt").replace("WP_NAME", name)
    # Longest names first, so that none is taken for the beginning of another.
    pattern = re.compile("|".join(f"WP_{key}" for key in sorted(values, key=len, reverse=True)))
    return osl_grain(known.grain) + "\n" + pattern.sub(lambda found: values[found[0].removeprefix("WP_")], body)


def _values(known: ShaderTables, atlas: Atlas, detail: bool) -> dict[str, str]:
    def number(value: Any) -> str:
        text = f"{float(value):.9g}"
        text = text if any(mark in text for mark in ".en") else f"{text}.0"
        return f"({text})" if value < 0 else text

    axes = known.axes * np.array([1.0, -1.0, -1.0]) / known.pixel_size
    turn = float(known.azimuth.count) if known.wraps else 2.0 * np.pi / known.azimuth.step
    floats = {
        "COLUMNS": atlas.columns,
        "ATLAS_WIDTH": atlas.image.shape[1],
        "ATLAS_HEIGHT": atlas.image.shape[0],
        "RADIUS_FIRST": known.radius.first,
        "RADIUS_STEP": known.radius.step,
        "RADII": known.radius.count,
        "HEIGHT_FIRST": known.height.first,
        "HEIGHT_STEP": known.height.step,
        "HEIGHTS": known.height.count,
        "AZIMUTH_FIRST": known.azimuth.first,
        "AZIMUTH_STEP": known.azimuth.step,
        "AZIMUTHS": known.azimuth.count,
        "AZIMUTH_TURN": turn,
        "ORIGIN_X": known.origin[0],
        "ORIGIN_Y": known.origin[1],
        "ORIGIN_Z": known.origin[2],
        "BEND_X": known.stem[0],
        "BEND_Y": known.stem[1],
        "TAPER": known.stem[2],
        "RING_FIRST": known.ring_radius[0],
        "RING_LAST": known.ring_radius[-1],
        "AGE_STEP": known.age_step,
        "MEAN_WIDTH": known.mean_width,
        "FIRST_WIDTH": known.first_width,
        "STRIP_PERIOD": known.strip_period,
        "STRIP_SIZE": known.strip_size,
        "SAMPLES": known.samples_per_ring,
        "MIDDLE": known.middle,
        "ROUGH_EARLY": SATIN.roughness_early,
        "ROUGH_LATE": SATIN.roughness_late,
        "RELIEF": SATIN.relief * known.ring_width,
    }
    whole = {
        "ROW": ROW,
        "AGES": len(known.age_table),
        "STRIP": len(known.strip),
        "FIRST_AGE": known.first_age,
        "WRAPS": int(known.wraps),
        "DETAIL": int(detail and len(known.grain.kind) > 0),
    }
    vectors = {
        f"AXIS_{name}": f"vector({', '.join(number(value) for value in axis)})"
        for name, axis in zip("XYZ", axes, strict=True)
    }
    return {key: number(value) for key, value in floats.items()} | {k: str(v) for k, v in whole.items()} | vectors
