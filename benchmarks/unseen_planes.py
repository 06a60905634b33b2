"""How right the rings are where no photograph was taken: planes up to 100 px inside drawn logs, and hidden halves.

Every stage runs as in `woodpipe run`, on one photograph of each log. Prints, for each log, how far the pith's direction
is off and whether it is said to be open, and the shares of pixels whose ring age is right within a quarter ring: on
planes at right angles to the face (across and down) and parallel to it (25, 50, 75 and 100 px deep), one constant per
plane allowed. With `--half`, the right or bottom half of the photograph is hidden, and the share is that of the hidden
pixels within 50 px of the seen ones, with the numbering of the seen half.

    python benchmarks/unseen_planes.py [first seed] [seeds] [--half] [--cuts CUT ...]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from stages import STAGES
from stages.variables import (
    AZIMUTH_WRAPS,
    BOARD_TO_TREE,
    FACE_PLANE,
    FACE_TOP,
    POLISHED_DISPLACEMENT,
    POSE_UNDETERMINED,
    RING_RADIUS,
    STEM,
)
from woodfit.cylinder_grid import CylinderGrid, cylindrical, sample
from woodfit.displacement import age_of_radius
from woodfit.planes import Planes
from woodfit.synthetic import Log
from woodfit.synthetic_scenes import SCENE_NAMES, random_log, scene

CUTS = ("flat_sawn", "cathedral", "quarter_sawn", "end_grain_pith", "end_grain_off")
SIZE = (735, 750)
DEPTH_PX, STEP_PX, TOLERANCE = 100, 4.0, 0.25


def fitted(encoded: np.ndarray, opaque: np.ndarray, last: str = "phase_polishing") -> xr.Dataset:
    """All that the stages up to the `last` one know of a photograph."""
    one = {"units": "1"}
    ds = xr.Dataset(
        {
            "encoded": (("y", "x", "channel"), encoded, one),
            "opaque": (("y", "x"), opaque, one),
            "dpi_pixel_size": ((), np.nan, {"units": "mm"}),
        },
        coords={axis: np.arange(float(n)) for axis, n in zip("yx", opaque.shape, strict=True)},
    )
    single = Planes.single()
    ds = ds.assign({FACE_PLANE.name: FACE_PLANE.array(single.plane), FACE_TOP.name: FACE_TOP.array(single.top)})
    for stage in STAGES:
        if stage.name not in ("ring_series", "close_up"):
            result = stage(ds, stage.params_type())
            if stage.name == "scan":
                # Large scans are read on a coarser grid, which the photograph itself does not fit.
                ds = ds.drop_dims(("y", "x"))
            ds = ds.assign(result.data_vars).assign_coords(result.coords)
        if stage.name == last:
            return ds
    raise LookupError(f"there is no stage {last}")


def age_in(ds: xr.Dataset) -> Callable[[np.ndarray], np.ndarray]:
    """Ring age at board-frame points (..., 3), px."""
    field = ds[POLISHED_DISPLACEMENT.name]
    axes = [field.coords[name].values for name in ("radius", "azimuth", "height")]
    grid = CylinderGrid(*axes, bool(ds[AZIMUTH_WRAPS.name]))
    matrix, stem, table = (ds[variable.name].values for variable in (BOARD_TO_TREE, STEM, RING_RADIUS))

    def age(points: np.ndarray) -> np.ndarray:
        radius, azimuth, height = (part.ravel() for part in cylindrical(points, matrix, stem))
        moved, _, _ = sample(grid, field.values, radius, azimuth, height)
        return age_of_radius(radius + moved, table)[0].reshape(points.shape[:-1])

    return age


def planes() -> dict[str, list[np.ndarray]]:
    """Points (H, W, 3) of planes across, down and parallel to the face."""
    height, width = SIZE
    x, y = np.arange(0.0, width, STEP_PX), np.arange(0.0, height, STEP_PX)
    z = np.arange(0.0, DEPTH_PX + 1.0, STEP_PX)
    across = [
        np.stack(np.meshgrid(x, [row], z, indexing="ij"), -1)[:, 0] for row in np.linspace(0.25, 0.75, 5) * height
    ]
    down = [
        np.stack(np.meshgrid([column], y, z, indexing="ij"), -1)[0] for column in np.linspace(0.25, 0.75, 5) * width
    ]
    parallel = [np.stack(np.meshgrid(x, y, [deep], indexing="ij"), -1)[:, :, 0] for deep in (25.0, 50.0, 75.0, 100.0)]
    return {"across": across, "down": down, "parallel": parallel}


def share_within(off: np.ndarray) -> float:
    """Largest share of differences that lie within the tolerance of one constant."""
    ordered = np.sort(off.ravel())
    last = np.searchsorted(ordered, ordered + 2.0 * TOLERANCE, side="right")
    return float((last - np.arange(len(ordered))).max() / len(ordered))


def beyond(age: Callable[[np.ndarray], np.ndarray], log: Log, hidden: np.ndarray, within: np.ndarray) -> float:
    """Share of the pixels `within` that are right by the numbering of the seen ones; all of shape (H, W)."""
    x, y = np.meshgrid(np.arange(float(SIZE[1])), np.arange(float(SIZE[0])))
    points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    off = age(points) - log.age(points)
    return float((np.abs(off[within] - np.median(off[~hidden])) < TOLERANCE).mean())


def direction_off(ds: xr.Dataset, log: Log) -> float:
    """Degrees between the fitted pith and the true one, or its mirror image in the face."""
    along = ds[BOARD_TO_TREE.name].values[2, :3]
    true = np.array(log.direction)
    best = max(abs(float(along @ true)), abs(float(along @ (true * [1.0, 1.0, -1.0]))))
    return float(np.degrees(np.arccos(min(1.0, best))))


def judge(cut: str, seed: int, half: bool) -> dict[str, Any]:
    """Figures of one log."""
    log = random_log(cut, SIZE, np.random.default_rng([seed, SCENE_NAMES.index(cut)]))
    face = scene(cut, SIZE, seed).face.rgb_encoded
    row, column = np.mgrid[: SIZE[0], : SIZE[1]]
    figures: dict[str, Any] = {}
    if half:
        for name, ahead in (("right", column - SIZE[1] // 2), ("bottom", row - SIZE[0] // 2)):
            hidden = ahead >= 0
            ds = fitted(np.where(hidden[..., None], np.uint8(0), face), ~hidden)
            figures[name] = beyond(age_in(ds), log, hidden, hidden & (ahead < 50))
        return figures
    ds = fitted(face, np.ones(SIZE, bool))
    age = age_in(ds)
    figures["off_deg"], figures["open"] = direction_off(ds, log), bool(ds[POSE_UNDETERMINED.name].values[0])
    figures["tilt_deg"] = float(np.degrees(np.arccos(min(1.0, abs(log.direction[2])))))
    for name, group in planes().items():
        figures[name] = float(np.mean([share_within(age(points) - log.age(points)) for points in group]))
    return figures


def main() -> None:
    """Print the figures of each log, and the mean over the logs of a cut."""
    parser = argparse.ArgumentParser(description="Rings where no photograph was taken.")
    parser.add_argument("first", nargs="?", type=int, default=0)
    parser.add_argument("seeds", nargs="?", type=int, default=3)
    parser.add_argument("--half", action="store_true")
    parser.add_argument("--cuts", nargs="+", choices=CUTS, default=CUTS)
    given = parser.parse_args()
    for cut in given.cuts:
        rows = []
        for seed in range(given.first, given.first + given.seeds):
            rows.append(judge(cut, seed, given.half))
            print(
                f"{cut:15s} {seed:3d} " + "  ".join(f"{key} {value:.2f}" for key, value in rows[-1].items()), flush=True
            )
        shares = ("right", "bottom") if given.half else ("across", "down", "parallel")
        print(f"{cut:15s} all " + "  ".join(f"{key} {np.mean([row[key] for row in rows]):.2f}" for key in shares))


if __name__ == "__main__":
    main()
