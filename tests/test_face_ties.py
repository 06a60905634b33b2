"""Faces in space: places lifted into the wood, rings tied across edges, and the direction of the fibres."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.measure import find_contours

from woodfit.face_ties import tie_groups
from woodfit.fiber import fiber_orientation
from woodfit.planes import Planes
from woodfit.synthetic import Log, photograph, plane_points
from woodfit.synthetic_scenes import random_log, scene

SIDE = 200
#: Four neighbouring faces of a cube: pixel (0, 0), right, down.
BOX = {
    "front": ((0, 0, 0), (1, 0, 0), (0, 1, 0)),
    "right": ((SIDE - 1, 0, 0), (0, 0, 1), (0, 1, 0)),
    "top": ((0, 0, SIDE - 1), (1, 0, 0), (0, 0, -1)),
    "bottom": ((0, SIDE - 1, 0), (1, 0, 0), (0, 0, 1)),
}


@cache
def log() -> Log:
    return random_log("flat_sawn", (SIDE, SIDE), np.random.default_rng(5))


def boundaries(
    names: tuple[str, ...], numbering: dict[str, tuple[int, int]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Vertices of the true rings on faces, numbered ``sign * age + shift`` on each; face, index and group."""
    points, face, index = [], [], []
    for number, name in enumerate(names):
        origin, u, v = (np.array(vector, float) for vector in BOX[name])
        age = log().age(plane_points((SIDE, SIDE), origin, u, v))
        sign, shift = numbering[name]
        for ring in range(int(np.ceil(age.min())), int(np.floor(age.max())) + 1):
            for line in find_contours(age, float(ring)):
                points.append(origin + line[:, 1:] * u + line[:, :1] * v)
                face.append(np.full(len(line), number))
                index.append(np.full(len(line), sign * ring + shift))
    faces = np.concatenate(face)
    return np.concatenate(points), faces, np.concatenate(index), faces


@given(st.floats(-50, 50), st.floats(0, 80), st.integers(0, 2))
def test_a_place_lifted_from_an_atlas_is_the_place_lifted_from_its_own_face(x: float, y: float, face: int) -> None:
    plane = np.arange(27.0).reshape(3, 3, 3) % 7.0
    together = Planes(plane, np.array([0.0, 100.0, 200.0]))
    alone = Planes(plane[face : face + 1], np.zeros(1))
    at = y + 100.0 * face
    npt.assert_allclose(together.lift(np.array(x), np.array(at)), alone.lift(np.array(x), np.array(y)), atol=1e-9)
    assert together.face_of(np.array([at]))[0] == face


def test_the_single_face_is_the_picture_at_depth_zero() -> None:
    npt.assert_array_equal(Planes.single().lift(np.array([3.0]), np.array([5.0])), [[3.0, 5.0, 0.0]])
    npt.assert_array_equal(Planes.single().turn(np.array([0.6]), np.array([0.8]), np.array([9.0])), [[0.6, 0.8, 0.0]])


def test_a_face_alone_is_seen_as_if_it_faced_the_camera() -> None:
    plane = np.array([[[5.0, -3.0, 2.0], [0.0, 0.0, 1.5], [0.0, -1.5, 0.0]]])
    planes = Planes(plane, np.zeros(1))
    facing, there = planes.facing()
    x, y = np.array([0.0, 4.0, 7.0]), np.array([0.0, 2.0, 30.0])
    npt.assert_allclose(facing.lift(x, y), np.stack([1.5 * x, 1.5 * y, 0 * x], axis=-1), atol=1e-9)
    npt.assert_allclose(planes.lift(x, y) @ there[:3, :3].T + there[:3, 3], facing.lift(x, y), atol=1e-9)
    npt.assert_allclose(there[:3, :3] @ there[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(there[:3, :3]) == pytest.approx(1.0)


def test_faces_round_a_block_stay_where_they_are() -> None:
    both = Planes(np.array([BOX["front"], BOX["right"]], float), np.array([0.0, 300.0]))
    facing, there = both.facing()
    assert facing is both
    npt.assert_array_equal(there, np.eye(4))
    npt.assert_array_equal(Planes.single().facing()[1], np.eye(4))


@pytest.mark.parametrize("names", [("front", "right"), ("front", "top", "bottom"), tuple(BOX)])
def test_rings_numbered_anew_on_every_face_are_tied_to_one_numbering(names: tuple[str, ...]) -> None:
    shifts = dict(zip(BOX, ((1, 0), (1, -4), (1, 11), (1, 3)), strict=True))
    points, face, index, group = boundaries(names, shifts)
    ties = tie_groups(points, face, index, group, ring_px=15.0)
    assert len(set(ties.root)) == 1
    assert ties.conflicts == 0
    true = (index - np.array([shifts[name][1] for name in names])[face]).astype(int)
    together = ties.sign[group] * index + ties.shift[group]
    assert len(np.unique(together - true)) == 1


def test_a_face_numbered_backwards_is_turned_round() -> None:
    backwards = {"front": (1, 0), "right": (-1, 5), "top": (1, 2), "bottom": (1, 0)}
    points, face, index, group = boundaries(tuple(BOX), backwards)
    ties = tie_groups(points, face, index, group, ring_px=15.0)
    assert len(set(ties.root)) == 1
    assert list(ties.sign * ties.sign[0]) == [1, -1, 1, 1]
    sign, shift = (np.array([backwards[name][k] for name in BOX]) for k in (0, 1))
    true = sign[face] * (index - shift[face])
    together = ties.sign[group] * index + ties.shift[group]
    assert len(np.unique(together - ties.sign[0] * true)) == 1


def test_faces_that_do_not_touch_stay_apart() -> None:
    points, face, index, group = boundaries(("right", "front"), {"right": (1, 0), "front": (1, 0)})
    ties = tie_groups(points + 40.0 * face[:, None], face, index, group, ring_px=15.0)
    npt.assert_array_equal(ties.root, [0, 1])


def test_no_boundaries_are_no_groups() -> None:
    none = np.zeros(0, int)
    assert len(tie_groups(np.zeros((0, 3)), none, none, none, 20.0).root) == 0


@pytest.mark.parametrize(("name", "seed"), [("flat_sawn", 0), ("quarter_sawn", 1), ("ring_porous", 0)])
def test_fibres_show_the_piths_direction_on_a_face_along_the_stem(name: str, seed: int) -> None:
    drawn = scene(name, (300, 320), seed)
    grey = drawn.face.rgb_encoded.max(axis=-1) / 255.0
    angle, coherence = fiber_orientation(grey, np.ones(grey.shape, bool), [])
    x, y, _ = drawn.log.direction
    off = np.angle(np.exp(2j * (angle - np.arctan2(y, x)))) / 2
    assert abs(np.degrees(off)) < 4.0
    assert coherence > 0.3


def test_end_grain_shows_no_fibre_direction() -> None:
    drawn = scene("end_grain_pith", (300, 320), 1)
    grey = drawn.face.rgb_encoded.max(axis=-1) / 255.0
    assert fiber_orientation(grey, np.ones(grey.shape, bool), [])[1] < 0.1


def test_a_turned_photograph_has_turned_fibres() -> None:
    face = photograph(log(), (SIDE, SIDE), rng=np.random.default_rng(0)).rgb_encoded.max(axis=-1) / 255.0
    whole = np.ones(face.shape, bool)
    upright, turned = (fiber_orientation(np.rot90(face, k).copy(), whole, []) for k in (0, 1))
    assert abs(np.angle(np.exp(2j * (turned[0] - upright[0] - 0.5 * np.pi)))) < 0.01
    npt.assert_allclose(turned[1], upright[1], rtol=0.02)


def test_too_little_wood_says_nothing() -> None:
    assert fiber_orientation(np.random.default_rng(0).random((40, 40)), np.zeros((40, 40), bool), []) == (0.0, 0.0)
