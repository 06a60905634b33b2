"""What goes into the measuring of a scan and what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.latewood import Onsets, StraightRings
from woodfit.measuring import Boundaries, Crossings
from woodfit.measuring_path import Grid
from woodfit.ring_widths import PathRings

FloatArray = npt.NDArray[np.float64]


class Kind(IntEnum):
    """How a path came about."""

    CORE = 0
    RADIUS = 1
    LINE = 2
    GIVEN = 3


@dataclass(frozen=True)
class Face:
    """A scan as the measuring sees it.

    Parameters
    ----------
    boundaries : Boundaries
        Traced, scan px.
    growth : float array of shape (M, N)
        Outward direction, rad.
    frequency : float array of shape (M, N)
        Rings per scan px.
    valid : bool array of shape (M, N)
        The wood.
    dark : float32 array of shape (M, N)
        See `woodfit.latewood.darkness`.
    grid : Grid
        Where these arrays lie.
    late_is_dark : bool
        Whether latewood is darker than earlywood.
    along_stem : bool
        Whether the face lies along the stem, so that its rings are no circles.
    pith : float array of shape (2,)
        Roughly where an overview of the face shows the pith, scan px; NaN where it does not.
    """

    boundaries: Boundaries
    growth: npt.NDArray[Any]
    frequency: npt.NDArray[Any]
    valid: npt.NDArray[np.bool_]
    dark: npt.NDArray[np.float32]
    grid: Grid
    late_is_dark: bool
    along_stem: bool
    pith: FloatArray


@dataclass(frozen=True)
class Route:
    """A path to measure along.

    Parameters
    ----------
    points : float array of shape (P, 2)
        Scan px.
    kind : Kind
        How it came about.
    bearing_deg : float
        Of a radius: degrees clockwise from up; NaN for others.
    reach_px : float
        How far from it a boundary may end and still count.
    """

    points: FloatArray
    kind: Kind
    bearing_deg: float
    reach_px: float


@dataclass(frozen=True)
class Gap:
    """Part of a path in which nobody can say how many rings there are.

    Parameters
    ----------
    start, end : float
        Ways along the path, px.
    boundaries : int
        Boundaries traced beyond the gap that are not tied to the series by counting.
    """

    start: float
    end: float
    boundaries: int


@dataclass(frozen=True)
class PithSeen:
    """Where the pith is, seen from a series' innermost boundary; `years` None when no ring was measured.

    Parameters
    ----------
    on_sample : bool
        Whether it lies on the scan and starts the path.
    x, y : float
        Scan px.
    distance_px, least_px, most_px : float
        From the series' inner end, with the range of one standard deviation.
    years : int or None
        Rings between the series' inner end and the pith.
    """

    on_sample: bool
    x: float
    y: float
    distance_px: float
    least_px: float
    most_px: float
    years: int | None


@dataclass(frozen=True)
class Measured:
    """One series: path from the inside out, crossings, rings, latewood, and what is missing.

    Parameters
    ----------
    route : Route
        The path.
    found : Crossings
        Boundaries along it.
    rings : PathRings
        Between them.
    straight : StraightRings
        Profiles of the rings.
    onsets : Onsets
        Latewood onsets.
    gaps : list of Gap
        Inside and outside of the series.
    unfit : int
        Crossings left out because their index contradicts the others'.
    pith : PithSeen or None
        None when nothing tells.
    inner_rest_px, outer_rest_px : float
        Wood before the first and after the last boundary, at right angles to them.
    """

    route: Route
    found: Crossings
    rings: PathRings
    straight: StraightRings
    onsets: Onsets
    gaps: list[Gap]
    unfit: int
    pith: PithSeen | None
    inner_rest_px: float
    outer_rest_px: float
