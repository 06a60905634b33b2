"""A solid texture as the few numbers and tables that a shader needs, whatever its language.

With p a point of the board frame in px (points in `SolidTexture.unit` divided by `pixel_size`):

    t       = axes p + origin                    tree frame, px
    t.xy   -= (bend_x, bend_y) t.z²              where the stem bends
    r       = |t.xy| max(1 + taper t.z, 0.05)
    azimuth = atan2(t.y, t.x), height = t.z
    radius  = r + m(r, azimuth, height)          `displacement`, trilinear, see `CylinderTable`
    age     = F(radius) counted from first_age   `ring_radius` inverted by search, or `age_table` by look-up
    color   = strip(age), lateness               `strip`, linear, its first and last rings again and again
    u       = radius - m(r, azimuth, middle)     radius of the fibre, for the fine grain
    rgb     = color exp(L(u, azimuth, height, lateness))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from woodfit.solid_texture import SolidTexture

Array = npt.NDArray[Any]

#: Rings in the tables: with 64 samples each, and eight rings again, they fit into the widest texture of a GPU (16,384).
MOST_RINGS = 240


@dataclass(frozen=True)
class Axis:
    """Evenly spaced nodes: the first one, the step, and how many."""

    first: float
    step: float
    count: int

    @classmethod
    def of(cls, nodes: Array) -> Axis:
        """Return the axis of a grid's nodes."""
        return cls(float(nodes[0]), float(nodes[1] - nodes[0]), len(nodes))


@dataclass(frozen=True)
class Grain:
    """The fine grain's noises, see `woodfit.fine_grain.FineGrain`; seeds are below 2³²."""

    kind: npt.NDArray[np.int32]
    cells: npt.NDArray[np.float32]
    density: npt.NDArray[np.float32]
    amplitude: npt.NDArray[np.float32]
    color: npt.NDArray[np.float32]
    log_mean: npt.NDArray[np.float32]
    seed: npt.NDArray[np.uint32]


@dataclass(frozen=True)
class ShaderTables:
    """Numbers and tables of a texture.

    Attributes
    ----------
    unit, pixel_size : str and float
        Unit of points, and of how many of it a px has (1 for px).
    axes : array of shape (3, 3), origin : array of shape (3,)
        Tree axes x, y, z as rows, in the board frame; the tree coordinates (px) of the board frame's origin.
    stem : array of shape (3,)
        bend_x, bend_y, taper, 1/px.
    radius, azimuth, height : Axis
        Nodes of `displacement`. Radius and height are clamped to them. Where `wraps`, the azimuth's last node is one
        step before its first; else the arc from the last node round to the first is one wider cell.
    wraps : bool
        See there.
    displacement : float32 array of shape (R, A, H)
        m at the nodes, px.
    middle : float
        Mean of the first and last height, px.
    first_age : int
        Ring age that `ring_radius`, `age_table` and `strip` begin with; their ages are counted from there. Above 0
        when the tree has more rings than `MOST_RINGS`: the tables hold those that the faces show, and what fits.
    ring_radius : float64 array of shape (N,)
        Ideal radius at ring age `first_age`, `first_age` + 1, ..., px.
    mean_width : float
        Rings beyond the last radius are as wide as this, px.
    first_width : float
        Rings inside of the first radius are as wide as this, px: age is ``(radius - ring_radius[0]) / first_width``.
        Nothing is there when `first_age` is 0: age is 0.
    ring_width : float
        Mean ring width, in `unit`.
    age_table : float32 array of shape (M,)
        Ring age, counted from `first_age`, at radius ``ring_radius[0]`` and every `age_step` from there; the last
        entry is that of the last radius.
    age_step : float
        px.
    strip : float32 array of shape (S + P + 1, 4)
        Linear RGB and lateness at age ``first_age + (i + 0.5) / samples_per_ring``. Position ``q = age
        samples_per_ring - 0.5``; where q ≥ S - 0.5 it is ``S - 0.5 + (q - S + 0.5) mod P``; where the age is below
        0 it is that of ``age mod (P / samples_per_ring)``; then, below 0, it is 0.
    strip_size, strip_period : int
        S and P.
    samples_per_ring : int
        Of the strip.
    grain : Grain
        Of K noises, K may be 0.
    """

    unit: str
    pixel_size: float
    axes: npt.NDArray[np.float64]
    origin: npt.NDArray[np.float64]
    stem: npt.NDArray[np.float64]
    radius: Axis
    azimuth: Axis
    height: Axis
    wraps: bool
    displacement: npt.NDArray[np.float32]
    middle: float
    first_age: int
    ring_radius: npt.NDArray[np.float64]
    mean_width: float
    first_width: float
    ring_width: float
    age_table: npt.NDArray[np.float32]
    age_step: float
    strip: npt.NDArray[np.float32]
    strip_size: int
    strip_period: int
    samples_per_ring: int
    grain: Grain


def tables_of(texture: SolidTexture, most_ages: int = 8192) -> ShaderTables:
    """Tables of a texture; `age_table` has at most `most_ages` entries, about a 1/64 of the narrowest ring apart."""
    strip, period = texture.repeated_strip
    first = _first_ring(texture)
    radii = np.asarray(texture.ring_radius[first:], np.float64)
    span, widths = float(radii[-1] - radii[0]), np.diff(radii)
    count = int(np.clip(np.ceil(span / (float(widths.min()) / 64.0)) + 1, 2, most_ages))
    step = span / (count - 1)
    fine = texture.fine_grain
    return ShaderTables(
        unit=texture.unit,
        pixel_size=texture.pixel_size or 1.0,
        axes=np.asarray(texture.board_to_tree[:3, :3], np.float64),
        origin=np.asarray(texture.board_to_tree[:3, 3], np.float64),
        stem=np.asarray(texture.stem, np.float64),
        radius=Axis.of(texture.grid.radius),
        azimuth=Axis.of(texture.grid.azimuth),
        height=Axis.of(texture.grid.height),
        wraps=texture.grid.wraps,
        displacement=np.ascontiguousarray(texture.displacement, np.float32),
        middle=texture.middle_height,
        first_age=first,
        ring_radius=radii,
        mean_width=texture.mean_width,
        first_width=float(widths[:10].mean()),
        ring_width=texture.ring_width,
        age_table=(texture.age_of_radius(radii[0] + step * np.arange(count)) - first).astype(np.float32),
        age_step=step,
        strip=np.ascontiguousarray(strip[first * texture.samples_per_ring :]),
        strip_size=len(texture.color_strip) - first * texture.samples_per_ring,
        strip_period=period,
        samples_per_ring=texture.samples_per_ring,
        grain=Grain(
            fine.kind.astype(np.int32),
            fine.cells.astype(np.float32),
            fine.density.astype(np.float32),
            fine.amplitude.astype(np.float32),
            fine.color.astype(np.float32),
            fine.log_mean.astype(np.float32),
            fine.seeds.astype(np.uint32),
        ),
    )


def _first_ring(texture: SolidTexture) -> int:
    """Innermost ring that the tables hold."""
    rings = max(len(texture.ring_radius) - 1, len(texture.color_strip) // texture.samples_per_ring)
    return max(0, min(rings - MOST_RINGS, len(texture.ring_radius) - 2))
