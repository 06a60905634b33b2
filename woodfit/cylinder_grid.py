"""A scalar on a cylindrical grid (radius, azimuth, height): the texture's own coordinates.

Azimuth is carried so that the two sides of a flat-sawn face do not contradict each other. Outside the grid the
nearest value holds along radius and height, and the azimuth closes round the tree, so that a texture carved beyond the
photograph stays wood without a seam.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class CylinderGrid:
    """Evenly spaced nodes.

    Attributes
    ----------
    radius, azimuth, height : arrays
        Node coordinates in px, rad and px; each has at least two entries.
    wraps : bool
        True when the azimuth goes all the way round (the last node is one step short of the first).
    """

    radius: npt.NDArray[np.float64]
    azimuth: npt.NDArray[np.float64]
    height: npt.NDArray[np.float64]
    wraps: bool

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along radius, azimuth and height."""
        return len(self.radius), len(self.azimuth), len(self.height)

    @property
    def steps(self) -> tuple[float, float, float]:
        """Spacing in px, rad and px."""
        radius, azimuth, height = (float(axis[1] - axis[0]) for axis in (self.radius, self.azimuth, self.height))
        return radius, azimuth, height

    def coarser(self, factor: int) -> CylinderGrid:
        """Return a grid over the same wood with about `factor` times the spacing."""
        if self.wraps:
            count = max(8, math.ceil(len(self.azimuth) / factor))
            azimuth = self.azimuth[0] + np.arange(count) * (2.0 * np.pi / count)
        else:
            azimuth = _fewer(self.azimuth, factor)
        return CylinderGrid(_fewer(self.radius, factor), azimuth, _fewer(self.height, factor), self.wraps)


def _fewer(nodes: npt.NDArray[np.float64], factor: int) -> npt.NDArray[np.float64]:
    return np.linspace(nodes[0], nodes[-1], max(2, math.ceil((len(nodes) - 1) / factor) + 1))


def refine(coarse: CylinderGrid, values: npt.NDArray[Any], fine: CylinderGrid) -> npt.NDArray[np.float32]:
    """Values on a coarse grid interpolated at the nodes of a fine one, of the fine grid's shape."""
    r, a, h = np.meshgrid(fine.radius, fine.azimuth, fine.height, indexing="ij")
    at_nodes, _, _ = sample(coarse, values, r.ravel(), a.ravel(), h.ravel())
    return at_nodes.reshape(fine.shape)


def towards_pith(grid: CylinderGrid, values: npt.NDArray[Any]) -> tuple[CylinderGrid, npt.NDArray[np.float32]]:
    """Grid and displacement carried on to the pith, where there is none: in proportion to the radius.

    So eccentric and oval growth goes on, and no disc of one age is left about the pith. A grid that begins farther out
    than it is wide stays as it is: its pith is far from the wood that was seen.
    """
    step = grid.steps[0]
    more = _nodes_to_pith(float(grid.radius[0]), step, len(grid.radius))
    if more == 0:
        return grid, np.asarray(values, np.float32)
    inner = grid.radius[0] - step * np.arange(more, 0, -1)
    share = (inner / grid.radius[0])[:, None, None]
    wider = CylinderGrid(np.concatenate([inner, grid.radius]), grid.azimuth, grid.height, grid.wraps)
    return wider, np.concatenate([share * values[:1], values]).astype(np.float32)


def _nodes_to_pith(innermost: float, step: float, count: int) -> int:
    """Number of radii that lie `step` apart inside of the innermost one, 0 where there would be more than `count`."""
    more = int(innermost / step)
    return more if more <= count else 0


def cylindrical(
    points: npt.NDArray[Any], board_to_tree: npt.NDArray[Any], stem: npt.ArrayLike = (0.0, 0.0, 0.0)
) -> tuple[Floats, Floats, Floats]:
    """Radius (px), azimuth (rad, -pi..pi) and height (px) of board-frame points (..., 3) in px.

    `stem` is the stem's shape (bend_x, bend_y, taper) in 1/px: the pith runs through tree x = bend_x h², y = bend_y h²
    at height h, and distances from it are multiplied by 1 + taper h. Zeros are a straight cylinder.
    """
    matrix = np.asarray(board_to_tree)
    x, y, z = (points @ matrix[row, :3] + matrix[row, 3] for row in range(3))
    bend_x, bend_y, taper = (float(part) for part in np.asarray(stem))
    if bend_x or bend_y:
        x, y = x - bend_x * z**2, y - bend_y * z**2
    radius = np.hypot(x, y)
    if taper:
        radius = radius * widening(z, taper)
    return radius, np.arctan2(y, x), z


def widening(height: npt.NDArray[Any], taper: float) -> Floats:
    """What a tapering stem's radii are multiplied by at heights (px): 1 + taper h, but never less than a twentieth."""
    # A cone has a tip; far beyond the wood that was seen the stem stays as thin as there.
    return np.asarray(np.maximum(1.0 + taper * height, 0.05))


def grid_for(
    radius: Floats, azimuth: Floats, height: Floats, spacing_px: float, most_nodes: int, wider: float = 1.0
) -> CylinderGrid:
    """Grid that covers points, with about `spacing_px` between nodes and at most about `most_nodes` of them.

    Parameters
    ----------
    radius, azimuth, height : arrays of equal shape
        Tree coordinates of the points in px, rad, px.
    spacing_px : float
        Wanted spacing; made wider when the nodes would be too many.
    most_nodes : int
        Bound on the number of nodes.
    wider : float
        Spacing along the arc and along the stem over that along the radius, where growth changes fastest.

    Returns
    -------
    CylinderGrid
    """
    low_r, high_r = float(radius.min()), float(radius.max())
    low_h, high_h = float(height.min()), float(height.max())
    gap = _widest_gap(azimuth)
    if gap is None:
        low_a, high_a, wraps = -np.pi, np.pi, True
    else:
        low_a, high_a, wraps = float(azimuth.min()), float(azimuth.max()), False
    arc = 0.5 * (low_r + high_r) * (high_a - low_a) if not wraps else np.pi * high_r
    for _ in range(40):
        nr = max(2, math.ceil((high_r - low_r) / spacing_px) + 1)
        na = max(2 if not wraps else 8, math.ceil(arc / (wider * spacing_px)) + 1)
        nh = max(2, math.ceil((high_h - low_h) / (wider * spacing_px)) + 1)
        # Those that `towards_pith` will add count too.
        inside = _nodes_to_pith(low_r, max((high_r - low_r) / (nr - 1), 1e-3), nr)
        if (nr + inside) * na * nh <= most_nodes:
            break
        spacing_px *= 1.08
    if wraps:
        azimuths = np.asarray(low_a + np.arange(na) * (2 * np.pi / na), np.float64)
    else:
        azimuths = np.linspace(low_a, max(high_a, low_a + 1e-6), na)
    return CylinderGrid(
        np.linspace(low_r, max(high_r, low_r + 1e-3), nr),
        azimuths,
        np.linspace(low_h, max(high_h, low_h + 1e-3), nh),
        wraps,
    )


def _widest_gap(azimuth: Floats) -> float | None:
    """Free arc opposite the board around azimuth pi, in rad; None when points lie all around."""
    counts, _ = np.histogram(azimuth, bins=72, range=(-np.pi, np.pi))
    if counts[0] or counts[-1]:
        # The board reaches the branch cut: treat the azimuth as a full circle.
        return None
    return 2.0 * np.pi - float(np.ptp(azimuth))


def corners(
    grid: CylinderGrid, radius: npt.NDArray[Any], azimuth: npt.NDArray[Any], height: npt.NDArray[Any]
) -> tuple[list[npt.NDArray[np.int64]], list[npt.NDArray[np.float32]]]:
    """For each axis the lower node's index and the fraction towards the next, for points of shape (N,)."""
    low: list[npt.NDArray[np.int64]] = []
    part: list[npt.NDArray[np.float32]] = []
    for axis, (value, nodes, step) in enumerate(
        zip((radius, azimuth, height), (grid.radius, grid.azimuth, grid.height), grid.steps, strict=True)
    ):
        position = (np.asarray(value) - nodes[0]) / step
        if axis == 1:
            turn = len(nodes) if grid.wraps else 2.0 * np.pi / step
            position = np.mod(position, turn)
            if not grid.wraps:
                # The arc that the face does not show is one wide cell: the texture closes round the tree.
                last = len(nodes) - 1
                position = np.where(position > last, last + (position - last) / (turn - last), position)
            index = np.minimum(position.astype(np.int64), len(nodes) - 1)
        else:
            position = np.clip(position, 0.0, len(nodes) - 1)
            index = np.minimum(position.astype(np.int64), len(nodes) - 2)
        low.append(index)
        part.append((position - index).astype(np.float32))
    return low, part


def trilinear(
    grid: CylinderGrid, radius: npt.NDArray[Any], azimuth: npt.NDArray[Any], height: npt.NDArray[Any]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]:
    """Flat node indices and weights, both of shape (N, 8), that interpolate at N points."""
    low, part = corners(grid, radius, azimuth, height)
    _, na, nh = grid.shape
    index = np.empty((len(low[0]), 8), np.int64)
    weight = np.empty((len(low[0]), 8), np.float32)
    for corner in range(8):
        dr, da, dh = corner >> 2 & 1, corner >> 1 & 1, corner & 1
        column = low[1] + da
        column = np.where(column >= na, column - na, column)
        index[:, corner] = ((low[0] + dr) * na + column) * nh + low[2] + dh
        weight[:, corner] = (
            (part[0] if dr else 1 - part[0]) * (part[1] if da else 1 - part[1]) * (part[2] if dh else 1 - part[2])
        )
    return index, weight


def sample(
    grid: CylinderGrid,
    values: npt.NDArray[Any],
    radius: npt.NDArray[Any],
    azimuth: npt.NDArray[Any],
    height: npt.NDArray[Any],
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Trilinear value at N points, with its slopes along radius and height (per px; 0 outside the grid)."""
    low, part = corners(grid, radius, azimuth, height)
    _, na, nh = grid.shape
    flat = np.ascontiguousarray(values, np.float32).ravel()
    column = low[1] + 1
    column = np.where(column >= na, column - na, column)

    def row(dr: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        base = (low[0] + dr) * na
        near, far = (base + low[1]) * nh + low[2], (base + column) * nh + low[2]
        lower = flat[near] * (1 - part[1]) + flat[far] * part[1]
        upper = flat[near + 1] * (1 - part[1]) + flat[far + 1] * part[1]
        return lower * (1 - part[2]) + upper * part[2], upper - lower

    inner, inner_rise = row(0)
    outer, outer_rise = row(1)
    value = inner * (1 - part[0]) + outer * part[0]
    inside_r = (radius >= grid.radius[0]) & (radius <= grid.radius[-1])
    inside_h = (height >= grid.height[0]) & (height <= grid.height[-1])
    slope_r = (outer - inner) / grid.steps[0] * inside_r
    slope_h = (inner_rise * (1 - part[0]) + outer_rise * part[0]) / grid.steps[2] * inside_h
    return value, slope_r.astype(np.float32), slope_h.astype(np.float32)


def without_fold(values: npt.NDArray[Any], radius: npt.NDArray[Any], least_slope: float = 0.15) -> npt.NDArray[Any]:
    """Nearest-looking displacement whose ``r + m_r`` grows by at least `least_slope` per px of radius.

    The mean of the smallest increasing field above and the largest below: increasing, and unchanged where it
    already was.

    Parameters
    ----------
    values : array of shape (R, A, H)
        Displacement in px.
    radius : array of shape (R,)
        Node radii in px.
    least_slope : float
        Least slope of ``r + m_r``.

    Returns
    -------
    array of shape (R, A, H)
    """
    ramp = ((1.0 - least_slope) * np.asarray(radius))[:, None, None]
    level = values + ramp
    above = np.maximum.accumulate(level, axis=0)
    below = np.minimum.accumulate(level[::-1], axis=0)[::-1]
    return np.asarray(0.5 * (above + below) - ramp)
