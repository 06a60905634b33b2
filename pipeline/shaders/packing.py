"""The tables of a texture as one array of floats, and the #defines with which wood.glsl reads them."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from woodfit.seen import HALVING_WIDTHS
from woodfit.shader_tables import ShaderTables, tables_of

if TYPE_CHECKING:
    from woodfit import SolidTexture

#: Texels in a row of the tables' texture.
ROW = 2048


@dataclass(frozen=True)
class Packed:
    """What a GLSL program needs of a texture.

    Attributes
    ----------
    tables : float32 array of shape (M, ROW)
        Texture of one channel, fetched without filtering.
    defines : str
        Lines of ``#define``, to stand before ``fine_grain.glsl`` and ``wood.glsl``.
    """

    tables: npt.NDArray[np.float32]
    defines: str

    @property
    def source(self) -> str:
        """Defines, fine grain and wood: all but the `#version` and `precision` lines and a main function."""
        return "\n".join([self.defines, shader_text("fine_grain.glsl"), shader_text("wood.glsl")])


def shader_text(name: str) -> str:
    """A file of this package."""
    return (resources.files("pipeline.shaders") / name).read_text(encoding="utf-8")


def pack(texture: SolidTexture) -> Packed:
    """Tables and defines of a texture."""
    known = tables_of(texture)
    seen, grain = texture.seen, known.grain
    seeds = np.stack([grain.seed & 0xFFFF, grain.seed >> 16], axis=-1)
    noises = np.column_stack([grain.kind, grain.cells, grain.density, grain.amplitude, grain.color, seeds])
    faces = np.column_stack([seen.plane.reshape(-1, 9), seen.size])
    parts = {
        "DISPLACEMENT": known.displacement,
        "RING_RADIUS": known.ring_radius,
        "STRIP": known.strip,
        "GRAIN": noises,
        "LOG_MEAN": grain.log_mean,
        "SEEN": faces,
    }
    lines, flat, start = [], [], 0
    for name, values in parts.items():
        lines.append(f"#define WP_{name} {start}")
        flat.append(np.asarray(values, np.float32).ravel())
        start += flat[-1].size
    table = np.zeros(-(-start // ROW) * ROW, np.float32)
    table[:start] = np.concatenate(flat)
    lines += [f"#define WP_{name} {value}" for name, value in _numbers(known, texture).items()]
    return Packed(table.reshape(-1, ROW), "\n".join(lines))


def _numbers(known: ShaderTables, texture: SolidTexture) -> dict[str, str]:
    """Values of the other defines."""
    turn = float(known.azimuth.count) if known.wraps else 2.0 * np.pi / known.azimuth.step
    halving = HALVING_WIDTHS * known.ring_width / known.pixel_size
    ages = np.nan_to_num(texture.seen.ages, posinf=1e9)
    return {
        "ROW": str(ROW),
        "PIXEL_SIZE": _float(known.pixel_size),
        **{f"AXIS_{name}": _vector(axis) for name, axis in zip("XYZ", known.axes, strict=True)},
        "ORIGIN": _vector(known.origin),
        "BEND": _vector(known.stem[:2]),
        "TAPER": _float(known.stem[2]),
        "RADIUS_FIRST": _float(known.radius.first),
        "RADIUS_STEP": _float(known.radius.step),
        "RADII": str(known.radius.count),
        "AZIMUTH_FIRST": _float(known.azimuth.first),
        "AZIMUTH_STEP": _float(known.azimuth.step),
        "AZIMUTHS": str(known.azimuth.count),
        "AZIMUTH_TURN": _float(turn),
        "WRAPS": str(int(known.wraps)),
        "HEIGHT_FIRST": _float(known.height.first),
        "HEIGHT_STEP": _float(known.height.step),
        "HEIGHTS": str(known.height.count),
        "MIDDLE": _float(known.middle),
        "RINGS": str(len(known.ring_radius)),
        "RING_FIRST": _float(known.ring_radius[0]),
        "RING_LAST": _float(known.ring_radius[-1]),
        "FIRST_AGE": str(known.first_age),
        "FIRST_WIDTH": _float(known.first_width),
        "MEAN_WIDTH": _float(known.mean_width),
        "SAMPLES": _float(known.samples_per_ring),
        "STRIP_SIZE": _float(known.strip_size),
        "STRIP_PERIOD": _float(known.strip_period),
        "NOISES": str(len(known.grain.kind)),
        "FACES": str(len(texture.seen.plane)),
        "SEEN_FROM": _float(ages[0]),
        "SEEN_TO": _float(ages[1]),
        "HALVING": _float(halving),
    }


def _float(value: float) -> str:
    """A float literal of GLSL; negative ones in brackets."""
    text = f"{float(value):.9g}"
    text = text if any(mark in text for mark in ".en") else text + ".0"
    return f"({text})" if value < 0 else text


def _vector(values: npt.NDArray[np.float64]) -> str:
    return f"vec{len(values)}({', '.join(f'{float(value):.9g}' for value in values)})"
