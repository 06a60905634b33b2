"""Where to measure: through the middle of a core, along the radii of a disc, across the rings of a board.

Points are x, y in scan px; masks and fields are arrays whose element (0, 0) lies at `origin` and which are `step` px
apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d, median_filter

from woodfit.centre import normals_meet
from woodfit.measuring import Boundaries
from woodfit.ring_walks import draw_labels

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

#: A piece of wood so many times longer than wide is a core or a strip.
CORE_ASPECT = 4.0

#: Share of the full turn that the boundaries must surround the pith for a disc.
SURROUNDED = 0.7


@dataclass(frozen=True)
class Grid:
    """Where the elements of an array lie on the scan.

    Parameters
    ----------
    origin : tuple of two float
        x, y of element (0, 0), scan px.
    step : float
        Scan px from element to element.
    shape : tuple of two int
        Rows and columns.
    """

    origin: tuple[float, float]
    step: float
    shape: tuple[int, int]

    def place(self, points: FloatArray) -> FloatArray:
        """Columns and rows (..., 2) of points (..., 2)."""
        return np.asarray((points - np.array(self.origin)) / self.step)

    def point(self, place: FloatArray) -> FloatArray:
        """Points (..., 2) of columns and rows (..., 2)."""
        return np.asarray(place * self.step + np.array(self.origin))

    def nearest(self, image: npt.NDArray[Any], points: FloatArray) -> npt.NDArray[Any]:
        """Values of the elements nearest to points (..., 2); those of the rim beyond it."""
        place = np.rint(self.place(points)).astype(np.int64)
        cols = np.clip(place[..., 0], 0, self.shape[1] - 1)
        rows = np.clip(place[..., 1], 0, self.shape[0] - 1)
        return np.asarray(image[rows, cols])

    def inside(self, points: FloatArray) -> BoolArray:
        """Whether points (..., 2) lie on the scan."""
        place = self.place(points)
        low, high = -0.5, np.array(self.shape[::-1]) - 0.5
        return np.asarray(((place >= low) & (place <= high)).all(axis=-1))


def largest_piece(valid: BoolArray) -> BoolArray:
    """The largest connected piece of wood."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(valid.astype(np.uint8), connectivity=4)
    if len(stats) < 2:
        return valid
    return np.asarray(labels == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()))


def long_axis(piece: BoolArray) -> tuple[float, float]:
    """Direction of a piece's long axis (rad, 0..pi) and how many times longer than wide its smallest box is."""
    rows, cols = np.nonzero(piece)
    stride = max(1, len(rows) // 200_000)
    points = np.column_stack([cols[::stride], rows[::stride]]).astype(np.float32)
    if len(points) < 3:
        return 0.0, 1.0
    corners = cv2.boxPoints(cv2.minAreaRect(points))
    sides = np.diff(corners[:3], axis=0)
    lengths = np.hypot(*sides.T) + 1.0
    side = sides[int(lengths.argmax())]
    return float(np.arctan2(side[1], side[0]) % np.pi), float(lengths.max() / lengths.min())


def core_path(piece: BoolArray, grid: Grid, axis_rad: float) -> tuple[FloatArray, float]:
    """Path through the middle of a long piece of wood that follows its bends, and half the piece's width in px."""
    rows, cols = np.nonzero(piece)
    along = cols * np.cos(axis_rad) + rows * np.sin(axis_rad)
    across = -cols * np.sin(axis_rad) + rows * np.cos(axis_rad)
    first = float(along.min())
    bin_of = np.floor(along - first).astype(np.int64)
    count = int(bin_of.max()) + 1
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, bin_of, across)
    np.maximum.at(high, bin_of, across)
    seen = np.isfinite(low)
    where = np.arange(count)
    middle = np.interp(where, where[seen], 0.5 * (low + high)[seen])
    half = 0.5 * float(np.median((high - low)[seen])) * grid.step
    # A chip off one edge must not bend the path: only what is as long as several widths of the core does.
    width = max(3, int(2.0 * half / grid.step))
    middle = median_filter(middle, size=min(2 * width + 1, count), mode="nearest")
    middle = gaussian_filter1d(middle, float(width), mode="nearest")
    u, v = where + first + 0.5, middle
    line = np.column_stack([u * np.cos(axis_rad) - v * np.sin(axis_rad), u * np.sin(axis_rad) + v * np.cos(axis_rad)])
    slim = cv2.approxPolyDP(line.astype(np.float32)[:, None], 0.3, False)[:, 0].astype(np.float64)
    return grid.point(slim), half


def find_pith(
    boundaries: Boundaries, growth_rad: FloatArray, grid: Grid, piece: BoolArray, seen: FloatArray
) -> FloatArray | None:
    """Pith on a disc: where the boundaries' directions of growth come from, if it lies in the wood they surround.

    The search starts where an overview shows the pith; where the boundaries say nothing that place stands.

    Parameters
    ----------
    boundaries : Boundaries
        Of the scan.
    growth_rad : array of shape (V,)
        Outward direction of growth at all vertices.
    grid : Grid
        Of `piece`.
    piece : bool array of shape (M, N)
        The wood.
    seen : array of shape (2,)
        Roughly where an overview shows the pith, scan px; NaN where it does not.

    Returns
    -------
    array of shape (2,) or None
        x, y in scan px; None when the rings do not go round a point of the wood.
    """
    if len(growth_rad) < 8:
        return _on_wood(seen, grid, piece)
    points = np.concatenate(list(boundaries.lines))
    across = np.concatenate([_tangents(line) for line in boundaries.lines])
    stride = max(1, len(points) // 20_000)
    points, across, growth_rad = points[::stride], across[::stride], growth_rad[::stride]
    pith, reach = (seen if np.isfinite(seen).all() else np.median(points, axis=0)), np.inf
    found = None
    # Rings far out are oval and wavy: each round looks at nearer ones only, as long as they still go all round.
    for _ in range(8):
        distance = np.hypot(*(points - pith).T)
        near = distance <= reach
        centre = _meeting_point(points[near], across[near], pith, grid.step)
        if centre is None or not _surrounded(points[near], growth_rad[near], centre):
            break
        pith = found = centre
        reach = 0.6 * float(np.quantile(np.hypot(*(points[near] - pith).T), 0.9))
    found = None if found is None else _on_wood(found, grid, piece)
    return _on_wood(seen, grid, piece) if found is None else _centre_of_innermost(boundaries, found)


def _on_wood(place: FloatArray, grid: Grid, piece: BoolArray) -> FloatArray | None:
    """The place itself, None if it is unknown or not on the wood."""
    is_there = np.isfinite(place).all() and grid.inside(place) and bool(grid.nearest(piece, place))
    return place if is_there else None


def _tangents(line: FloatArray, reach: int = 6) -> FloatArray:
    """Unit tangents (K, 2) of a line from vertices up to `reach` before and after."""
    where = np.arange(len(line))
    way = line[np.minimum(where + reach, len(line) - 1)] - line[np.maximum(where - reach, 0)]
    return np.asarray(way / np.maximum(np.hypot(*way.T), 1e-9)[:, None])


def _meeting_point(points: FloatArray, across: FloatArray, start: FloatArray, step: float) -> FloatArray | None:
    """Where the normals of boundaries meet, robustly; None when they are parallel."""
    pith = start
    for _ in range(40):
        offset = points - pith
        distance = np.maximum(np.hypot(*offset.T), step)
        miss = (across * offset).sum(axis=1)
        # Angles count, not lengths, and what points elsewhere (knots, cracks) fades.
        weight = 1.0 / (distance**2 * (0.05 + (miss / distance) ** 2))
        met = normals_meet(points, across, weight) if len(points) >= 8 else None
        if met is None:
            return None
        move, pith = met - pith, met
        if np.hypot(*move) < 0.01:
            break
    return pith


def _surrounded(points: FloatArray, growth_rad: FloatArray, pith: FloatArray) -> bool:
    """Whether boundaries lie on nearly all sides of a point and grow away from it."""
    bearing = np.arctan2(*(points - pith).T[::-1])
    sector = np.floor((bearing + np.pi) / (2.0 * np.pi) * 24).astype(np.int64) % 24
    outwards = np.cos(bearing - growth_rad) > 0.7
    good = np.bincount(sector, outwards, minlength=24) > 0.6 * np.maximum(np.bincount(sector, minlength=24), 1)
    return bool(good.mean() >= SURROUNDED)


def _centre_of_innermost(boundaries: Boundaries, pith: FloatArray) -> FloatArray:
    """Centre of the innermost boundary if it is closed round a point; else the point itself."""
    radii = np.array([float(np.median(np.hypot(*(line - pith).T))) for line in boundaries.lines])
    line = boundaries.lines[int(radii.argmin())].astype(np.float32)
    around = cv2.pointPolygonTest(line[:, None], (float(pith[0]), float(pith[1])), False) > 0
    moments = cv2.moments(line[:, None])
    if not boundaries.closed[int(radii.argmin())] or not around or moments["m00"] <= 0.0:
        return pith
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


def radius_path(pith: FloatArray, bearing_deg: float, grid: Grid, piece: BoolArray) -> FloatArray:
    """Straight path from the pith to the last wood in a direction: degrees clockwise from up on the image."""
    turn = np.radians(bearing_deg)
    ahead = np.array([np.sin(turn), -np.cos(turn)])
    way = np.arange(0.0, np.hypot(*grid.shape) * grid.step, 0.5 * grid.step)
    line = pith + way[:, None] * ahead
    wood = grid.inside(line) & grid.nearest(piece, line)
    last = int(np.flatnonzero(wood)[-1]) if wood.any() else 1
    return np.stack([pith, line[max(last, 1)]])


def line_across(
    boundaries: Boundaries, growth: npt.NDArray[Any], frequency: npt.NDArray[Any], grid: Grid, piece: BoolArray
) -> FloatArray:
    """Straight line that crosses the most boundaries of one group, the surest ones first.

    Lines of 24 directions and 15 offsets each are tried on a picture of the boundaries; `growth` (rad, outwards),
    `frequency` (rings per scan px) and the wood `piece` have shape (M, N) on `grid`.
    """
    rows, cols = np.nonzero(piece)
    centre = grid.point(np.array([cols.mean(), rows.mean()])) if len(rows) else grid.point(np.zeros(2))
    half = 0.5 * float(np.hypot(*grid.shape)) * grid.step
    way = np.arange(-half, half, 0.5 * grid.step)
    labels = _labels(boundaries, grid)
    best, found = -1.0, np.stack([centre, centre + grid.step])
    for turn in np.arange(24) * np.pi / 24:
        ahead, aside = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        for offset in np.linspace(-0.8, 0.8, 15) * half:
            line = centre + offset * aside + way[:, None] * ahead
            wood = grid.inside(line) & grid.nearest(piece, line)
            if wood.sum() < 4:
                continue
            slant = np.abs(np.cos(grid.nearest(growth, line[wood]) - turn))
            expected = 0.5 * grid.step * float((grid.nearest(frequency, line[wood]) * slant).sum())
            met, first = np.unique(grid.nearest(labels, line[wood]), return_index=True)
            # Of equals, the one straight across the rings and through the middle, that misses none it should meet.
            worth = _worth(met[met > 0] - 1, boundaries) * (0.7 + 0.3 * float(slant.mean()))
            worth *= min(1.0, (met > 0).sum() / max(expected, 1.0)) * (1.0 - 0.1 * abs(offset) / half)
            worth /= 1.0 + 0.1 * _holes(np.sort(first[met > 0]))
            if worth > best:
                ends = np.flatnonzero(wood)[[0, -1]]
                best, found = worth, line[ends]
    return found


def _holes(position: npt.NDArray[Any]) -> float:
    """How many rings seem to be missed in intervals more than twice as wide as those next to them."""
    width = np.diff(position).astype(np.float64)
    if len(width) < 3:
        return 0.0
    beside = np.stack([np.roll(width, 1), np.roll(width, -1)])
    beside[0, 0], beside[1, -1] = width[1], width[-2]
    return float(np.maximum(width / np.maximum(beside.max(axis=0), 1.0) - 2.0, 0.0).sum())


def _labels(boundaries: Boundaries, grid: Grid) -> npt.NDArray[np.int32]:
    """Picture of the boundaries with their numbers, from 1."""
    return draw_labels([grid.place(line) for line in boundaries.lines], boundaries.closed.tolist(), grid.shape)


def _worth(lines: npt.NDArray[Any], boundaries: Boundaries) -> float:
    """Sum of the confidence of different boundaries of one group among those met."""
    worth: dict[int, dict[int, float]] = {}
    for i in lines:
        of_group = worth.setdefault(int(boundaries.group[i]), {})
        index = int(boundaries.index[i])
        of_group[index] = max(of_group.get(index, 0.0), float(boundaries.confidence[i]) + 0.1)
    return max((sum(of_group.values()) for of_group in worth.values()), default=0.0)


#: Compass points on the image, degrees clockwise from up.
COMPASS = {"N": 0.0, "NE": 45.0, "E": 90.0, "SE": 135.0, "S": 180.0, "SW": 225.0, "W": 270.0, "NW": 315.0}


def bearings(names: Sequence[str | float]) -> list[float]:
    """Degrees clockwise from up of compass points or of degrees given as numbers."""
    return [COMPASS[name.upper()] if isinstance(name, str) else float(name) % 360.0 for name in names]


def bearing_name(bearing_deg: float) -> str:
    """Name of a radius: its compass point, or its degrees."""
    for name, value in COMPASS.items():
        if abs((bearing_deg - value + 180.0) % 360.0 - 180.0) < 0.01:
            return name
    return f"{bearing_deg:03.0f}"
