"""Logs with blemishes of known place: branches, drying cracks and stain, drawn into a synthetic log.

A branch deflects the wood around it: the log is the plain one seen through a warp, so that age and color follow
the same bend. All lengths are px, angles rad; places are in the tree frame of :class:`woodfit.synthetic.Log`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from woodfit.anomalies import CRACK, KNOT, STAIN
from woodfit.synthetic import Floats, Log

_LEAST_DISTANCE = 1e-6
#: Absorbance of red, green and blue that makes branch wood darker than latewood: it is brown, not gray.
_BRANCH_COLOR = np.array([0.6, 1.0, 1.4])


@dataclass(frozen=True)
class Knot:
    """A branch: a cone from the pith outwards with rings of its own.

    Parameters
    ----------
    height, azimuth, rise
        Where it starts on the pith, its direction around the pith and its angle above the horizontal.
    slenderness
        Radius of the branch per px of its length.
    swell
        How far growth layers bulge outwards beside it, in its radii.
    darkness
        Absorbance (natural logarithm) that branch wood has beyond the latewood of the stem.
    ring
        Width of the branch's own rings, px.
    """

    height: float
    azimuth: float
    rise: float = 0.35
    slenderness: float = 0.1
    swell: float = 0.9
    darkness: float = 0.35
    ring: float = 5.0

    def place(self, tree: Floats) -> tuple[Floats, Floats, Floats]:
        """Distance along and from the branch's axis and radius of the branch there, shape (...) px, of tree points."""
        axis = np.array(
            [np.cos(self.azimuth) * np.cos(self.rise), np.sin(self.azimuth) * np.cos(self.rise), np.sin(self.rise)]
        )
        offset = tree - np.array([0.0, 0.0, self.height])
        along = offset @ axis
        away = np.linalg.norm(offset - along[..., None] * axis, axis=-1)
        return along, away, self.slenderness * np.maximum(along, 0.0)

    def inside(self, tree: Floats) -> NDArray[np.bool_]:
        """True in the branch, shape (...)."""
        _, away, radius = self.place(tree)
        return np.asarray(away < radius)

    def bent(self, tree: Floats) -> Floats:
        """Where a tree point (..., 3) would have been without the branch."""
        _, away, radius = self.place(tree)
        share = np.minimum(radius / np.maximum(away, _LEAST_DISTANCE), 1.0) ** 2
        side = np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])
        # Fibre flows around the branch as water around a pile: its lines are those of one stream function.
        lateral = tree @ side
        moved = tree - (share * lateral)[..., None] * side
        across = np.hypot(moved[..., 0], moved[..., 1])
        lift = self.swell * radius * np.exp(-0.5 * (away / np.maximum(1.5 * radius, 1.0)) ** 2)
        inwards = np.maximum(1.0 - lift / np.maximum(across, 1.0), 0.1)
        return np.asarray(moved * np.stack([inwards, inwards, np.ones_like(inwards)], axis=-1), dtype=float)


@dataclass(frozen=True)
class Crack:
    """A drying crack in a radial plane: dark, widest at `outer`, closed at `inner` (radii, px).

    `width` is its width at `outer`; `lowest` and `highest` bound its height along the pith.
    """

    azimuth: float
    inner: float
    outer: float
    width: float = 4.0
    lowest: float = -np.inf
    highest: float = np.inf

    def openness(self, tree: Floats) -> Floats:
        """1 in the crack to 0 outside, shape (...), of tree points (..., 3)."""
        x, y, height = tree[..., 0], tree[..., 1], tree[..., 2]
        along = x * np.cos(self.azimuth) + y * np.sin(self.azimuth)
        across = y * np.cos(self.azimuth) - x * np.sin(self.azimuth) + 1.5 * np.sin(along / 23.0)
        share = np.clip((along - self.inner) / (self.outer - self.inner), 0.0, 1.0)
        within = (along < self.outer) & (height > self.lowest) & (height < self.highest)
        opened = 0.5 * self.width * np.sqrt(share) - np.abs(across) + 0.5
        return np.asarray(np.clip(opened, 0.0, 1.0) * within * (share > 0.0), dtype=float)


@dataclass(frozen=True)
class Stain:
    """Blue stain: a wedge along the rays from radius `inner` outwards, within `half_width` rad of `azimuth`.

    `strength` is the gray absorbance (natural logarithm) that it adds at its heart.
    """

    azimuth: float
    half_width: float
    inner: float
    outer: float = np.inf
    strength: float = 0.6

    def depth(self, tree: Floats) -> Floats:
        """1 in the stain to 0 outside with soft sides, shape (...), of tree points (..., 3)."""
        x, y = tree[..., 0], tree[..., 1]
        radius = np.hypot(x, y)
        turn = np.abs((np.arctan2(y, x) - self.azimuth + np.pi) % (2.0 * np.pi) - np.pi)
        side = np.clip((self.half_width - turn) * radius / 12.0, 0.0, 1.0)
        ends = np.clip((radius - self.inner) / 12.0, 0.0, 1.0) * np.clip((self.outer - radius) / 12.0, 0.0, 1.0)
        return np.asarray(side * ends, dtype=float)


@dataclass(frozen=True)
class BlemishedLog(Log):
    """A log with blemishes; without any it is the plain log, to the last bit."""

    knots: tuple[Knot, ...] = ()
    cracks: tuple[Crack, ...] = ()
    stains: tuple[Stain, ...] = ()

    @classmethod
    def of(
        cls,
        log: Log,
        knots: tuple[Knot, ...] = (),
        cracks: tuple[Crack, ...] = (),
        stains: tuple[Stain, ...] = (),
    ) -> BlemishedLog:
        """The same log with blemishes."""
        return cls(
            log.pith,
            log.direction,
            log.taper,
            log.boundaries,
            log.distortion,
            log.palette,
            log.seed,
            knots,
            cracks,
            stains,
        )

    def tree(self, points: ArrayLike) -> Floats:
        """Points (..., 3) of the board frame in the tree frame, the bend around the branches undone; px."""
        tree = super().tree(points)
        for knot in self.knots:
            tree = knot.bent(tree)
        return tree

    def color(self, points: ArrayLike) -> Floats:
        """Linear rgb 0..1, shape (..., 3), of board-frame points (..., 3) in px."""
        straight = super().tree(points)
        rgb = super().color(points)
        palette = self.palette
        for knot in self.knots:
            _, away, radius = knot.place(straight)
            inside = away < radius
            share = np.sqrt(np.clip(away / knot.ring % 1.0, 0.0, 1.0))
            late = np.minimum(palette.late, palette.early).mean(axis=0)
            absorbance = (knot.darkness + 0.25 * share)[..., None] * _BRANCH_COLOR
            rgb = np.where(inside[..., None], late * np.exp(-absorbance), rgb)
        for stain in self.stains:
            rgb = rgb * np.exp(-stain.strength * stain.depth(straight)[..., None] * np.array([1.1, 1.0, 0.8]))
        for crack in self.cracks:
            opened = crack.openness(straight)[..., None]
            rgb = (1.0 - opened) * rgb + opened * np.array([0.012, 0.009, 0.007])
        return np.asarray(rgb, dtype=float)

    def kind(self, points: ArrayLike) -> NDArray[np.uint8]:
        """What is there, as :mod:`woodfit.anomalies` codes it, shape (...), of board-frame points (..., 3) in px."""
        straight = super().tree(points)
        kind = np.zeros(straight.shape[:-1], np.uint8)
        for stain in self.stains:
            kind[stain.depth(straight) > 0.5] = STAIN
        for knot in self.knots:
            kind[knot.inside(straight)] = KNOT
        for crack in self.cracks:
            kind[crack.openness(straight) > 0.5] = CRACK
        return kind
