"""The figures of `unseen_planes.py` on logs drawn by other rules than those that the kernels were tried on.

The samples' logs wave by a few cosines and are nearly round. These follow what is published of Liu-type models: places
displaced by noise that is long along the stem, eccentric and oval stems (up to 0.17 and 0.05 of the radius), rings
from 9 to 75 px wide, a short darkening and a sharp edge, no fine fibre. On top of that may come streaks of fibers that
darken and brighten by 5 % (faces along the stem only), or vessels: all over the rings or in their earlywood. A failing
here that the samples do not show is a habit that was learnt from them. Prints one line per log: the share of the face
and of planes inside it whose ring age is right within a quarter ring (one constant per plane allowed), and how far the
pith's direction is off.

    python benchmarks/other_logs.py [--cuts CUT ...] [--styles STYLE ...] [--seeds SEED ...] [--texture TEXTURE]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy.ndimage import map_coordinates, zoom
from unseen_planes import SIZE, STEP_PX, age_in, direction_off, fitted, planes, share_within

from stages.variables import POSE_UNDETERMINED
from woodfit.synthetic import srgb_decode, srgb_encode

CUTS = ("flat_sawn", "cathedral", "quarter_sawn", "rift_sawn", "end_grain_pith", "end_grain_off")
COLORS = (
    ((222, 184, 135), (160, 100, 60)),
    ((240, 225, 195), (200, 165, 120)),
    ((200, 140, 110), (110, 60, 45)),
    ((190, 180, 170), (130, 115, 105)),
    ((214, 190, 140), (190, 150, 100)),
)


@dataclass(frozen=True)
class Style:
    """Ring widths (px) and their scatter; noise, its length and waves in ring widths; whether the stem is oval."""

    width: tuple[float, float]
    scatter: float
    noise: float = 0.0
    length: float = 1.0
    wave: float = 0.0
    oval: bool = False


STYLES = {
    "even": Style((22, 30), 0.06),
    "liu": Style((25, 40), 0.2, 0.5, 9.0, 0.15),
    "oval": Style((15, 30), 0.15, 0.15, 10.0, oval=True),
    "strong": Style((25, 35), 0.2, 0.9, 12.0, 0.35, oval=True),
    "wide": Style((50, 75), 0.15, 0.3, 5.0),
    "narrow": Style((9, 13), 0.2, 0.3, 14.0, oval=True),
}


class OtherLog:
    """A log with known ring age; `pith`, `direction` and `age` as those of `woodfit.synthetic.Log`."""

    def __init__(self, cut: str, style: str, seed: int) -> None:
        self.rng = np.random.default_rng([seed, CUTS.index(cut), list(STYLES).index(style)])
        self.style = STYLES[style]
        self.width = self.rng.uniform(*self.style.width)
        widths = self.width * np.exp(self.rng.normal(0.0, self.style.scatter, 400))
        if self.style.oval:
            widths *= 0.8 + 0.6 * np.exp(-np.arange(400) / 12.0)
        self.boundaries = np.concatenate([[0.0], np.cumsum(widths)])
        self.late = self.rng.uniform(0.15, 0.35)
        self.shift, self.part = self.rng.uniform(0.0, 2.0 * np.pi, 6), self.rng.uniform(0.6, 1.4, 6)
        self.colors = srgb_decode(np.array(COLORS[self.rng.integers(len(COLORS))]) / 255.0)
        self.yearly = self.rng.normal(0.0, 0.05, 401)
        grids = self.rng.normal(0.0, 1.0, (3, 8, 8, 8))
        self.grids = [zoom(grid, 8, order=3, mode="grid-wrap", grid_mode=True) for grid in grids]
        point, along = self._place(cut)
        self.pith, self.direction = tuple(point), tuple(along / np.linalg.norm(along))

    def _place(self, cut: str) -> tuple[np.ndarray, np.ndarray]:
        """A point of the pith line and its direction, board frame."""
        rng, (height, width) = self.rng, SIZE
        side, turn, far = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(60.0, 500.0)
        along = np.array([rng.normal(0.0, 0.03), 1.0, rng.normal(0.0, 0.02)])
        tilt = np.radians(rng.uniform(0.0, 3.0))
        across = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        if cut == "flat_sawn":
            return np.array([rng.uniform(0.25, 0.75) * width, height / 2, rng.uniform(80, 260)]), along
        if cut == "cathedral":
            along[2] = side * np.tan(rng.uniform(0.2, 0.5))
            depth = rng.uniform(40, 120) + abs(along[2]) * height / 2
            return np.array([rng.uniform(0.35, 0.65) * width, height / 2, depth]), along
        if cut == "quarter_sawn":
            return np.array([width / 2 + side * (width / 2 + far), height / 2, rng.uniform(0, 80)]), along
        if cut == "rift_sawn":
            depth = rng.uniform(200, 500)
            return np.array([width / 2 + side * (width / 2 + 0.5 * depth), height / 2, depth]), along
        if cut == "end_grain_pith":
            return np.array([rng.uniform(0.2, 0.8) * width, rng.uniform(0.2, 0.8) * height, 0.0]), across
        away = 0.5 * np.hypot(width, height) + far
        return np.array([width / 2 + away * np.sin(turn), height / 2 + away * np.cos(turn), 0.0]), across

    @cached_property
    def axes(self) -> np.ndarray:
        """Tree axes as rows, the pith last."""
        along = np.array(self.direction)
        first = np.cross(np.eye(3)[np.argmin(np.abs(along))], along)
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(along, first), along])

    def _noise(self, number: int, tree: np.ndarray, across_px: float, along_px: float) -> np.ndarray:
        places = np.moveaxis(8.0 * tree / [across_px, across_px, along_px], -1, 0)
        return map_coordinates(self.grids[number], places, order=1, mode="grid-wrap")

    def _tree(self, points: np.ndarray) -> np.ndarray:
        return (np.asarray(points, float) - self.pith) @ self.axes.T

    def age(self, points: np.ndarray) -> np.ndarray:
        """Ring age (...) at board-frame points (..., 3), px."""
        tree, style = self._tree(points), self.style
        length = style.length * self.width
        x, y = (tree[..., i] + style.noise * self.width * self._noise(i, tree, length, length / 0.3) for i in (0, 1))
        radius, azimuth = np.hypot(x, y), np.arctan2(y, x)
        onset = style.wave * self.width * -np.expm1(-((radius / (2.0 * self.width)) ** 2))
        for n in range(3):
            phase = 2.0 * np.pi * tree[..., 2] / (900.0 * self.part[n]) + self.shift[n] + n * azimuth
            radius = radius + onset * np.cos(phase)
        if style.oval:
            uneven = 0.12 * self.part[3] * np.cos(azimuth + self.shift[3]) + 0.05 * np.cos(2 * azimuth + self.shift[4])
            radius = radius * (1.0 + uneven)
        return np.interp(radius, self.boundaries, np.arange(len(self.boundaries)))

    def photograph(self) -> np.ndarray:
        """sRGB-encoded photograph (H, W, 3), uint8, of the plane z = 0."""
        total = np.zeros((*SIZE, 3))
        for shift in ((-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25)):
            x, y = np.meshgrid(np.arange(SIZE[1]) + shift[1], np.arange(SIZE[0]) + shift[0])
            points = np.stack([x, y, np.zeros(SIZE)], axis=-1)
            age = self.age(points)
            fraction, onset = age % 1.0, 0.6 * (1.0 - self.late)
            late = np.clip((fraction - onset) / (1.0 - onset), 0.0, 1.0) ** 1.2
            late = late * np.clip((1.0 - fraction) / 0.03, 0.0, 1.0)
            tone = self.yearly[np.minimum(age.astype(int), 400)] + 0.05 * self._noise(2, self._tree(points), 128, 1280)
            early, dark = np.log(self.colors)
            total += 0.25 * np.exp(early + late[..., None] * (dark - early) + tone[..., None])
        blurred = cv2.GaussianBlur(total, (0, 0), 0.6) + self.rng.normal(0.0, 0.008, total.shape)
        return np.round(255.0 * srgb_encode(blurred)).astype(np.uint8)


TEXTURES = ("plain", "fibers", "diffuse_porous", "ring_porous")


def textured(image: np.ndarray, log: OtherLog, cut: str, texture: str, rng: np.random.Generator) -> np.ndarray:
    """Photograph with fine texture, uint8."""
    along = not cut.startswith("end_grain")
    if texture == "plain" or (texture == "fibers" and not along):
        return image
    if texture == "fibers":
        streaks = cv2.GaussianBlur(rng.normal(0.0, 1.0, SIZE), (0, 0), sigmaX=1.0, sigmaY=30.0)
        factor = 1.0 + 0.05 * streaks / streaks.std()
    else:
        x, y = np.meshgrid(np.arange(float(SIZE[1])), np.arange(float(SIZE[0])))
        chance = np.full(SIZE, 0.0012 if along else 0.006)
        if texture == "ring_porous":
            chance *= 3.0 * np.exp(-(log.age(np.stack([x, y, np.zeros(SIZE)], axis=-1)) % 1.0) / 0.15)
        spots = (rng.random(SIZE) < chance).astype(np.float32)
        vessel = np.ones((41, 2), np.uint8) if along else cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
        factor = 1.0 - 0.35 * cv2.GaussianBlur(cv2.dilate(spots, vessel), (0, 0), 0.7)
    return np.clip(np.round(image * factor[..., None]), 0, 255).astype(np.uint8)


def judge(cut: str, style: str, seed: int, texture: str) -> dict[str, float]:
    """Figures of one log."""
    log = OtherLog(cut, style, seed)
    image = textured(log.photograph(), log, cut, texture, np.random.default_rng(seed))
    ds = fitted(image, np.ones(SIZE, bool))
    age = age_in(ds)
    x, y = np.meshgrid(np.arange(0.0, SIZE[1], STEP_PX), np.arange(0.0, SIZE[0], STEP_PX))
    face = np.stack([x, y, np.zeros_like(x)], axis=-1)
    figures = {"face": share_within(age(face) - log.age(face))}
    for name, group in planes().items():
        figures[name] = float(np.mean([share_within(age(points) - log.age(points)) for points in group]))
    figures["off_deg"], figures["open"] = direction_off(ds, log), float(ds[POSE_UNDETERMINED.name].values[0])
    return figures


def main() -> None:
    """Print the figures of each log, and the mean over the logs of a cut."""
    parser = argparse.ArgumentParser(description="Logs drawn by other rules.")
    parser.add_argument("--cuts", nargs="+", choices=CUTS, default=CUTS)
    parser.add_argument("--styles", nargs="+", choices=STYLES, default=list(STYLES))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--texture", choices=TEXTURES, default="plain")
    given = parser.parse_args()
    for cut in given.cuts:
        rows = []
        for style in given.styles:
            for seed in given.seeds:
                rows.append(judge(cut, style, seed, given.texture))
                print(
                    f"{cut:15s} {style:7s} {seed} " + "  ".join(f"{k} {v:.2f}" for k, v in rows[-1].items()), flush=True
                )
        print(
            f"{cut:15s} all " + "  ".join(f"{k} {np.mean([row[k] for row in rows]):.2f}" for k in rows[0]), flush=True
        )


if __name__ == "__main__":
    main()
