"""A block fitted from several faces: right inside the wood, no folds, numberings tied to one another."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr
from block_scenes import box, seen_block
from kernel_scenes import SHARED, needs_shared

from stages import STAGES
from stages.color_map import color_map
from stages.faces import Faces, join_faces
from stages.initial_distortion import initial_distortion
from stages.phase_polishing import phase_polishing
from stages.polylines import face_frame
from stages.pose import pose
from woodfit.cylinder_grid import CylinderGrid, cylindrical, sample
from woodfit.displacement import age_of_radius
from woodfit.scoring import age_share, face_score
from woodfit.synthetic import Log
from woodfit.synthetic_scenes import random_log

Array = np.ndarray
SIDE, RING = 160, 18.0
SIX = tuple(box(SIDE))


@cache
def log() -> Log:
    return random_log("quarter_sawn", (SIDE, SIDE), np.random.default_rng(11))


def fitted(ds: xr.Dataset) -> xr.Dataset:
    """With the results of the stages that see a block, up to the colors."""
    for one in (pose, initial_distortion, phase_polishing, color_map):
        result = one(ds, one.params_type())
        ds = ds.assign(result.data_vars).assign_coords(result.coords)
    return ds


@cache
def block(backwards: tuple[str, ...] = ()) -> xr.Dataset:
    return fitted(seen_block(log(), SIX, SIDE, RING, backwards))


def age_in(ds: xr.Dataset) -> Callable[[Array], Array]:
    """Ring age of a fit at board-frame points (..., 3), px."""
    field = ds["polished_displacement"]
    grid = CylinderGrid(field.radius.values, field.azimuth.values, field.height.values, bool(ds["azimuth_wraps"]))
    frame = face_frame(ds)

    def age(points: Array) -> Array:
        r, azimuth, height = cylindrical(points.reshape(-1, 3), frame.board_to_tree, frame.stem)
        moved = sample(grid, field.values, r, azimuth, height)[0]
        return np.asarray(age_of_radius(r + moved, ds["ring_radius"].values)[0].reshape(points.shape[:-1]))

    return age


def inside(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(0.0, SIDE - 1.0, (count, 3))


def test_six_faces_tell_the_rings_inside() -> None:
    points = inside(20_000)
    found = age_share(age_in(block())(points), log().age(points), 0.25)
    assert found["age_share"] > 0.95
    # Counted from the pith, which lies outside: any whole constant will do, but it is a whole one.
    assert abs(found["age_offset"] - round(found["age_offset"])) < 0.1


@pytest.mark.slow
def test_a_face_numbered_inwards_does_not_matter() -> None:
    ds = block(("right", "top"))
    assert sorted(set(ds["ring_age_sign"].values)) == [-1, 1]
    points = inside(20_000)
    assert age_share(age_in(ds)(points), log().age(points), 0.25)["age_share"] > 0.95


@pytest.mark.slow
def test_two_faces_are_better_than_one() -> None:
    points = inside(20_000)
    shares = []
    for names in (("front",), ("front", "right", "bottom")):
        ds = fitted(seen_block(log(), names, SIDE, RING))
        shares.append(age_share(age_in(ds)(points), log().age(points), 0.25)["age_share"])
    assert shares[1] > max(shares[0], 0.7)


def test_the_direction_of_the_stem_is_found() -> None:
    direction = block()["board_to_tree"].values[2, :3]
    assert np.degrees(np.arccos(min(1.0, abs(float(direction @ np.array(log().direction)))))) < 6.0


def fold(ds: xr.Dataset, count: int, low: float, high: float) -> float:
    """Least growth of ring age over a hundredth px outwards, at random points of a cube."""
    matrix, least = ds["board_to_tree"].values, np.inf
    axis = np.linalg.inv(matrix)[:3, :3]
    age = age_in(ds)
    for seed in range(-(-count // 500_000)):
        points = np.random.default_rng(seed).uniform(low, high, (min(count, 500_000), 3))
        tree = points @ matrix[:3, :3].T + matrix[:3, 3]
        outward = (tree[:, :2] / np.maximum(np.hypot(tree[:, 0], tree[:, 1]), 1e-9)[:, None]) @ axis[:, :2].T
        least = min(least, float((age(points + 0.01 * outward) - age(points)).min()))
    return least


def test_no_ring_folds_over_in_the_block() -> None:
    assert fold(block(), 200_000, 0.0, SIDE) > 0.0


@pytest.mark.slow
def test_no_ring_folds_over_at_ten_million_points() -> None:
    assert fold(block(), 10_000_000, -20.0, SIDE + 20.0) > 0.0


def test_light_of_each_face_is_told_from_the_wood() -> None:
    ds = seen_block(log(), SIX, SIDE, RING)
    dim = ds["rgb"].values.copy()
    first = int(ds["face_top"].values[1]) - 4
    dim[:first] *= np.array([0.5, 0.6, 0.7], np.float32)
    gain = fitted(ds.assign(rgb=ds["rgb"].copy(data=dim)))["face_gain"].values
    npt.assert_allclose(gain[0] / gain[1:].mean(axis=0), [0.5, 0.6, 0.7], rtol=0.12)


# --- the real block ---------------------------------------------------------------------------------------------------

#: Of a cube of side 1, y along the stem: centre of pixel (0, 0) is half a pixel inside of these corners.
CORNERS = {
    "A": ((-0.5, 0.5, 0.5), (1, 0, 0), (0, -1, 0)),
    "B": ((-0.5, 0.5, -0.5), (1, 0, 0), (0, 0, 1)),
    "C": ((-0.5, 0.5, -0.5), (0, 0, 1), (0, -1, 0)),
    "D": ((-0.5, -0.5, 0.5), (1, 0, 0), (0, 0, -1)),
    "E": ((0.5, 0.5, 0.5), (0, 0, -1), (0, -1, 0)),
    "F": ((0.5, 0.5, -0.5), (-1, 0, 0), (0, -1, 0)),
    "cut2": ((0.2, -0.5, 0.5), (0, 1, 0), (-0.575, 0, -1)),
}
PX = 256


def plane_of(name: str) -> Array:
    corner, right, down = (np.array(vector, float) for vector in CORNERS[name])
    return np.stack([PX * corner + 0.5 * (right + down), right, down])


def traced(name: str) -> xr.Dataset:
    """A face of the real block up to the anomalies."""
    encoded = cv2.imread(str(SHARED / "data" / "scans" / "blocks" / "CN03" / f"{name}_col.png"))[..., ::-1].copy()
    shape, one = encoded.shape[:2], {"units": "1"}
    ds = xr.Dataset(
        {
            "encoded": (("y", "x", "channel"), encoded, one),
            "opaque": (("y", "x"), np.ones(shape, bool), one),
            "dpi_pixel_size": ((), np.nan, {"units": "mm"}),
        },
        coords={axis: np.arange(float(n)) for axis, n in zip("yx", shape, strict=True)},
    )
    for one_stage in STAGES:
        if one_stage.sees_block:
            break
        if one_stage.name in ("ring_series", "close_up"):
            continue
        result = one_stage(ds, one_stage.params_type())
        ds = ds.assign(result.data_vars).assign_coords(result.coords)
    return ds[[name for name in ds.data_vars if name not in ("encoded", "opaque")]]


def label_share(age: Array, label: dict[str, Any]) -> float:
    """Share of the labels within 3 px of the predicted rings after the best shift of the ring age."""
    from skimage.measure import find_contours

    best = 0.0
    for shift in np.arange(24) / 24.0:
        levels = np.arange(np.floor(age.min()), np.ceil(age.max()) + 1.0) + shift
        lines = [line[:, ::-1] for level in levels for line in find_contours(age, level)]
        best = max(best, face_score(lines, label)["label_share"])
    return best


@needs_shared
@pytest.mark.shared
def test_the_real_blocks_six_faces_tell_the_cut_that_was_not_seen() -> None:
    import json

    names = "ABCDEF"
    faces = Faces(
        tuple(tuple(tuple(row) for row in plane_of(name)) for name in names), ((PX, PX),) * 6, 1.0 / PX, "side"
    )
    age = age_in(fitted(join_faces([traced(name) for name in names], faces)))
    rows, cols = np.mgrid[:PX, :PX].astype(float)
    shares = {}
    for name in CORNERS:
        origin, right, down = plane_of(name)
        label = json.loads((SHARED / "data" / "labels" / f"CN03_{name}.json").read_text())
        shares[name] = label_share(age(origin + cols[..., None] * right + rows[..., None] * down), label)
    assert np.mean([shares[name] for name in names]) >= 0.85
    assert min(shares[name] for name in names) >= 0.7
    assert shares["cut2"] >= 0.6
