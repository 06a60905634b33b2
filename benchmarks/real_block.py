"""How right a real block is inside: CN03, from all six faces and from its end-grain face B alone.

Every stage up to the polished displacement runs as in `woodpipe run`. Prints, for each face and for the slanted cut
that no fit has seen, the share of the labels within 3 px of the predicted rings (one shift per face allowed), and how
much of the photograph's variance the ring age explains (eta²: band-passed luminance in 96 bins of ring age) beside the
same for the photograph mirrored left to right.

    WOODPIPE_SHARED=folder python benchmarks/real_block.py
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

BINS, FINE_PX, COARSE_PX = 96, 1.0, 25.0


def explained(age: np.ndarray, encoded: np.ndarray) -> float:
    """Variance of the band-passed luminance between bins of ring age over its total."""
    grey = cv2.cvtColor(encoded, cv2.COLOR_RGB2GRAY).astype(np.float64)
    band = cv2.GaussianBlur(grey, (0, 0), FINE_PX) - cv2.GaussianBlur(grey, (0, 0), COARSE_PX)
    place = (age - age.min()) / max(float(np.ptp(age)), 1e-9) * BINS
    bins = np.minimum(place.astype(int), BINS - 1).ravel()
    count = np.bincount(bins, minlength=BINS)
    mean = np.bincount(bins, band.ravel(), BINS) / np.maximum(count, 1)
    return float((count * (mean - band.mean()) ** 2).sum() / band.size / band.var())


def main() -> None:
    """Print the figures of both fits."""
    if not os.environ.get("WOODPIPE_SHARED"):
        print("WOODPIPE_SHARED names no folder of real scans: nothing to measure")
        return
    from test_block_fit import CORNERS, PX, SHARED, age_in, fitted, label_share, plane_of, traced

    from stages.faces import Faces, join_faces

    for names in ("ABCDEF", "B"):
        begun = time.perf_counter()
        planes = tuple(tuple(tuple(row) for row in plane_of(name)) for name in names)
        faces = Faces(planes, ((PX, PX),) * len(names), 1.0 / PX, "side")
        age = age_in(fitted(join_faces([traced(name) for name in names], faces)))
        print(f"\nfitted: {names}, {time.perf_counter() - begun:.0f} s\nface   labels within 3 px   eta2   mirrored")
        rows, cols = np.mgrid[:PX, :PX].astype(float)
        shares, etas = {}, {}
        for name in CORNERS:
            origin, right, down = plane_of(name)
            here = age(origin + cols[..., None] * right + rows[..., None] * down)
            label = json.loads((SHARED / "data" / "labels" / f"CN03_{name}.json").read_text())
            scan = SHARED / "data" / "scans" / "blocks" / "CN03" / f"{name}_col.png"
            encoded = cv2.imread(str(scan))[..., ::-1].copy()
            shares[name], etas[name] = label_share(here, label), explained(here, encoded)
            control = explained(here, np.ascontiguousarray(encoded[:, ::-1]))
            print(f"{name:5s}  {shares[name]:17.3f}  {etas[name]:6.3f}  {control:6.3f}")
        six = [name for name in CORNERS if len(name) == 1]
        print(f"mean   {np.mean([shares[n] for n in six]):17.3f}  {np.mean([etas[n] for n in six]):6.3f}   (six faces)")


if __name__ == "__main__":
    main()
