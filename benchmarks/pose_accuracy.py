"""How well the pith is placed on drawn logs of every cut, and whether the stated spread covers the error.

Prints one line per cut: median error and share within tolerance (direction 2 degrees; projected place one ring width
where it lies in the image, 5 % of its distance outside), share called undetermined, share of what is called determined
and is wrong, and share of scenes whose truth lies within two spreads. Rings are level sets of the true age, so that
tracing does not matter. Exits with 1 when determined parameters are wrong in more than one scene of ten.

    python benchmarks/pose_accuracy.py [first seed] [seeds]
"""

from __future__ import annotations

import sys
import time

import numpy as np
from skimage.measure import find_contours

from woodfit.pith import fit_pith
from woodfit.pith_energy import feet, frame_of, sample_rings
from woodfit.pose_story import Face, undetermined
from woodfit.synthetic import Log
from woodfit.synthetic_scenes import SCENE_NAMES, random_log

CUTS = ("flat_sawn", "cathedral", "quarter_sawn", "end_grain_pith", "end_grain_off", "core")
ALONG = ("flat_sawn", "cathedral", "quarter_sawn")


def rings_of(log: Log, size_yx: tuple[int, int], step: int = 3) -> tuple[list[np.ndarray], np.ndarray, float]:
    """Boundaries (x, y), their ages, and the mean ring width in px."""
    x, y = np.meshgrid(np.arange(0.0, size_yx[1], step), np.arange(0.0, size_yx[0], step))
    points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    age = log.age(points)
    lines, ages = [], []
    for level in range(max(1, int(np.ceil(age.min()))), int(age.max()) + 1):
        for contour in find_contours(age, level):
            if len(contour) >= 12:
                lines.append(contour[:, ::-1] * step)
                ages.append(level)
    radius = np.hypot(*np.moveaxis(log.tree(points)[..., :2], -1, 0))
    return lines, np.array(ages), float(np.ptp(radius) / np.ptp(age))


def judge(name: str, seed: int) -> tuple[float, float, bool, bool, bool, float]:
    """Direction error (degrees), place error in tolerances, what is said to be open of both, coverage, seconds."""
    size = ((735, 750), (600, 660), (480, 640))[seed % 3]
    if name == "core":
        size = (round(size[0] * 160 / 735), 2 * size[1])
    log = random_log(name, size, np.random.default_rng([seed, SCENE_NAMES.index(name)]))
    lines, ages, width = rings_of(log, size)
    face = Face(0.0, 0.0, size[1] - 1.0, size[0] - 1.0)
    rings = sample_rings(lines, [np.ones(len(one)) for one in lines], ages, np.zeros(len(ages), int))
    start = time.process_time()
    grain = 1.25 if name in ALONG else 1.08
    pith = fit_pith(rings, face.size_px, True, grain, face.aspect, centre=face.centre)
    seconds = time.process_time() - start
    best = (np.inf, np.inf, False)
    for flip in ([1.0, 1.0, 1.0], [1.0, 1.0, -1.0]):
        along = np.array(log.direction) * flip
        along = along if along @ pith.direction >= 0.0 else -along
        angle = float(np.degrees(np.arccos(min(1.0, along @ pith.direction))))
        foot = feet(np.array(log.pith) * flip, along, face.centre)
        across, inward = frame_of(pith.direction)
        gap = foot - pith.point
        apart = np.array([along @ across, along @ inward, gap @ across, gap @ inward])
        covered = bool((np.abs(apart) < 2.0 * np.maximum(pith.spread, [0.005, 0.005, 1.0, 1.0])).all())
        if name in ALONG:
            sideways, _ = frame_of(along)
            place = face.centre + ((foot - face.centre) @ sideways) * sideways
            error = abs(float((foot - pith.point) @ sideways))
        else:
            place = foot - foot[2] / along[2] * along
            error = float(np.linalg.norm(place - (pith.point - pith.point[2] / pith.direction[2] * pith.direction)))
        allowed = width if face.shows(place) else 0.05 * float(np.linalg.norm(place - face.centre))
        best = min(best, (angle, error / allowed, covered))
    left_open = undetermined(pith, face, width)
    return best[0], best[1], bool(left_open[0]), bool(left_open[2]), best[2], seconds


def main(first: int, count: int) -> int:
    """Print the table; 1 when what is called determined is wrong too often."""
    wrong, judged = 0, 0
    print("cut              direction: median  <2 deg  open  wrong | place: median  within  open  wrong | covered  s")
    for name in CUTS:
        rows = [judge(name, seed) for seed in range(first, first + count)]
        angle, place = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
        angle_open, place_open, covered = (np.array([row[i] for row in rows]) for i in (2, 3, 4))
        angle_wrong, place_wrong = (angle > 2.0) & ~angle_open, (place > 1.0) & ~place_open
        wrong, judged = wrong + int(angle_wrong.sum() + place_wrong.sum()), judged + 2 * len(rows)
        print(
            f"{name:15s} {np.median(angle):18.2f} {(angle < 2).mean():7.2f} {angle_open.mean():5.2f} "
            f"{angle_wrong.mean():6.2f} | {np.median(place):13.2f} {(place < 1).mean():7.2f} {place_open.mean():5.2f} "
            f"{place_wrong.mean():6.2f} | {covered.mean():7.2f} {np.median([row[5] for row in rows]):4.1f}",
            flush=True,
        )
    print(f"called determined and wrong: {wrong} of {judged}")
    return int(wrong > 0.1 * judged)


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:3]]
    sys.exit(main(*(given + [0, 8][len(given) :])))
