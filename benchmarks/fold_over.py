"""Fold-over, checked densely: along the way out from the pith the ring age never falls.

Takes ten million random points in and around each block (its bounds widened by half) and looks at the ring age a tenth
of a ring farther out. Prints how many points fell, and the least slope of the ideal radius.

    python benchmarks/fold_over.py texture.zarr.zip ...     textures of `woodpipe run`; without any, those in out/
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from woodfit.solid_texture import SolidTexture

POINTS, PART = 10_000_000, 500_000


def fallen(texture: SolidTexture, rng: np.random.Generator) -> tuple[int, float]:
    """How many of the points have a lower ring age a tenth of a ring farther out, and the least slope of r + m_r."""
    grid = texture.grid
    step = 0.1 * texture.mean_width
    worst, count = np.inf, 0
    outer, middle = float(grid.radius[-1]), 0.5 * float(grid.height[0] + grid.height[-1])
    half = 0.75 * max(float(np.ptp(grid.height)), 10.0 * step)
    to_board = np.linalg.inv(texture.board_to_tree)
    for _ in range(POINTS // PART):
        # Even in area over a disc about the pith that reaches half as far again as the wood that was seen.
        r = 1.5 * outer * np.sqrt(rng.random(PART))
        azimuth = rng.uniform(-np.pi, np.pi, PART)
        height = middle + rng.uniform(-half, half, PART)
        tree = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), height, np.ones(PART)])
        points = (to_board @ tree)[:3].T
        here = texture.place(points)
        there = texture.place(points + step * here.outward)
        slope = (there.radius - here.radius) / step
        worst = min(worst, float(slope.min()))
        count += int((texture.age_of_radius(there.radius) < texture.age_of_radius(here.radius)).sum())
    return count, worst


def main() -> None:
    """Print a line per texture; fails if any point fell."""
    paths = [Path(name) for name in sys.argv[1:]] or sorted(Path("out").glob("*/texture.zarr.zip"))
    if not paths:
        print("no textures: give their paths, or run `woodpipe run` first")
        return
    total = 0
    for path in paths:
        count, worst = fallen(SolidTexture.open(path), np.random.default_rng(0))
        total += count
        print(f"{path.parent.name:24s} {count:8d} of {POINTS} fell, least slope {worst:.3f}", flush=True)
    sys.exit(total > 0)


if __name__ == "__main__":
    main()
