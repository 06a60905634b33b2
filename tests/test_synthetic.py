"""The forward model: a log's truth is what it says it is."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.testing as npt
import pytest

from woodfit.matching import level_crossings
from woodfit.scoring import boundary_pixels
from woodfit.synthetic import Log, photograph, plane_points, srgb_decode, srgb_encode
from woodfit.synthetic_scenes import SCENE_NAMES, random_log, scene, write_sample

SMALL = (120, 130)
SEEDS = (0, 1, 2)


def _log(name: str, seed: int, size: tuple[int, int] = (735, 750)) -> Log:
    return random_log(name, size, np.random.default_rng([seed, SCENE_NAMES.index(name)]))


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_age_is_zero_along_the_pith_line(name: str) -> None:
    log = _log(name, 1)
    along = np.linspace(-800, 800, 50)[:, None] * np.asarray(log.direction)
    npt.assert_allclose(log.age(np.asarray(log.pith) + along), 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", SCENE_NAMES)
def test_age_increases_along_every_ray_from_the_pith(name: str, seed: int) -> None:
    log = _log(name, seed)
    rng = np.random.default_rng(seed)
    azimuth, height = rng.uniform(0, 2 * np.pi, 60), rng.uniform(-600, 600, 60)
    ray = np.cos(azimuth)[:, None] * log.axes[0] + np.sin(azimuth)[:, None] * log.axes[1]
    start = np.asarray(log.pith) + height[:, None] * log.axes[2]
    radius = np.arange(0.0, 1200.0, 1.0)
    age = log.age(start[:, None] + radius[:, None] * ray[:, None])
    assert (np.diff(age, axis=1) > 0).all()


def test_distortion_bound_holds_for_the_measured_slope() -> None:
    distortion = _log("end_grain_pith", 3).distortion
    rng = np.random.default_rng(0)
    radius = np.arange(0.0, 1500.0, 0.5)
    azimuth, height = rng.uniform(0, 2 * np.pi, (200, 1)), rng.uniform(-900, 900, (200, 1))
    grid = np.broadcast_to(radius, (200, len(radius)))
    slope = np.diff(distortion(grid, np.broadcast_to(azimuth, grid.shape), np.broadcast_to(height, grid.shape))) / 0.5
    assert 0.02 < np.abs(slope).max() <= distortion.bound() < 1.0


def test_distortion_varies_with_azimuth_and_with_height() -> None:
    log = _log("flat_sawn", 0)
    radius = np.full(200, 300.0)
    around = log.distortion(radius, np.linspace(0, 2 * np.pi, 200), np.zeros(200))
    up = log.distortion(radius, np.zeros(200), np.linspace(-400, 400, 200))
    assert np.ptp(around) > 2.0
    assert np.ptp(up) > 2.0
    assert abs(around[0] - around[-1]) < 1e-6


def test_boundaries_lie_where_the_undistorted_radii_say() -> None:
    log = _log("end_grain_pith", 0)
    still = replace(log.distortion, amplitude=0 * log.distortion.amplitude, share=0 * log.distortion.share)
    plain = replace(log, distortion=still, taper=0.0)
    places = np.asarray(log.pith) + log.boundaries[:, None] * plain.axes[0]
    npt.assert_allclose(plain.age(places), np.arange(len(log.boundaries)), atol=1e-9)


@pytest.mark.parametrize("name", ["end_grain_off", "flat_sawn", "quarter_sawn"])
def test_conifer_brightens_abruptly_at_the_true_boundary_and_darkens_slowly(name: str) -> None:
    log = _log(name, 2)
    dim = replace(log, palette=replace(log.palette, streak=0.0))
    age = np.arange(12, 15)[:, None] + np.array([0.999, 1.001, 0.3, 0.9])
    color = dim.palette.base(age).sum(axis=-1)
    assert (color[:, 1] > 1.2 * color[:, 0]).all()
    assert (color[:, 2] > color[:, 3]).all()
    # and the photograph's steepest edges are at the truth's boundaries, not beside them
    face = photograph(dim, (260, 260), rng=np.random.default_rng(0), noise=0.0)
    value = face.rgb_encoded.sum(axis=-1).astype(float)
    edge = np.hypot(cv2.Sobel(value, -1, 1, 0), cv2.Sobel(value, -1, 0, 1))
    inner = np.s_[5:-5, 5:-5]
    near = cv2.dilate(boundary_pixels(face.age).astype(np.uint8), np.ones((5, 5))) > 0
    assert near[inner][edge[inner] > np.quantile(edge[inner], 0.98)].mean() > 0.99


@pytest.mark.parametrize("seed", SEEDS)
def test_ring_porous_pore_band_is_darker_than_the_latewood_before_it(seed: int) -> None:
    shot = scene("ring_porous_end", (240, 250), seed)
    fraction = shot.face.age % 1.0
    value = srgb_decode(shot.face.rgb_encoded / 255.0).sum(axis=-1)
    band = value[(fraction > 0.04) & (fraction < 0.5 * shot.log.palette.pore_share)]
    assert np.median(band) < np.median(value[fraction > 0.7])
    assert band.std() > 1.5 * value[fraction > 0.7].std()


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_scene_shows_its_cut(name: str) -> None:
    for seed in range(12):
        log = _log(name, seed)
        point, direction = np.asarray(log.pith), np.asarray(log.direction)
        assert np.linalg.norm(direction) == pytest.approx(1.0)
        inside = bool(0 <= point[0] <= 749 and 0 <= point[1] <= 734)
        if name in ("end_grain_pith", "end_grain_off", "core"):
            assert abs(direction[2]) > 0.98
        if name in ("flat_sawn", "cathedral", "quarter_sawn", "ring_porous"):
            ends = point[2] + np.array([-367, 367]) * direction[2] / direction[1]
            assert (ends > 0).all()  # behind the face all along it
        if name in ("flat_sawn", "cathedral", "end_grain_pith"):
            assert inside
        if name in ("end_grain_off", "quarter_sawn"):
            assert not inside
        if name == "cathedral":
            assert abs(direction[2]) > 0.15
        widths = np.diff(log.boundaries)
        assert ((widths > 7.999) & (widths < 48.001)).all()
        assert ((widths >= 10) & (widths <= 40)).mean() > 0.6


def test_planes_meet_the_face_and_go_into_the_wood() -> None:
    shot = scene("flat_sawn", SMALL)
    along_x, along_y = shot.planes
    npt.assert_allclose(along_x.age[0], shot.face.age[int(along_x.origin[1])], rtol=1e-6)
    npt.assert_allclose(along_y.age[0], shot.face.age[:, int(along_y.origin[0])], rtol=1e-6)
    assert along_x.points[-1, 0, 2] == 100.0
    assert along_x.age.shape == (101, 130)
    assert along_y.age.shape == (101, 120)


def test_photograph_of_a_shifted_plane_is_the_cut_of_the_larger_one() -> None:
    log = _log("cathedral", 0)
    u, v = np.array([0.8, 0.0, 0.6]), np.array([0.0, 1.0, 0.0])
    whole = photograph(log, (60, 70), (5.0, 6.0, 7.0), u, v, rng=np.random.default_rng(0), noise=0.0)
    part = photograph(
        log, (40, 40), np.array([5.0, 6.0, 7.0]) + 10 * u + 9 * v, u, v, rng=np.random.default_rng(0), noise=0.0
    )
    npt.assert_array_equal(part.age, whole.age[9:49, 10:50])
    npt.assert_allclose(part.rgb_encoded[4:-4, 4:-4], whole.rgb_encoded[13:45, 14:46], atol=1)


def test_color_is_that_of_the_same_wood_on_every_plane() -> None:
    log = _log("ring_porous", 0)
    points = plane_points((20, 20), (40.0, 30.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    npt.assert_allclose(log.color(points)[7, 3], log.color(points[7, 3][None])[0], rtol=1e-9)


def test_srgb_round_trip() -> None:
    values = np.linspace(0, 1, 101)
    npt.assert_allclose(srgb_decode(srgb_encode(values)), values, atol=1e-12)


def test_same_seed_same_scene_and_other_seed_other_log() -> None:
    one, again, other = (scene("end_grain_off", SMALL, seed) for seed in (5, 5, 6))
    npt.assert_array_equal(one.face.rgb_encoded, again.face.rgb_encoded)
    assert one.log.pith != other.log.pith
    assert one.log.boundaries[3] != other.log.boundaries[3]


def test_unknown_scene_is_named() -> None:
    with pytest.raises(ValueError, match=r"flatsawn.*known: flat_sawn"):
        scene("flatsawn")


def test_sample_bytes_are_the_same_each_time(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        write_sample(tmp_path / folder, SMALL, names=("flat_sawn", "core"))
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert files == ["core.json", "core.png", "core.truth.npz", "flat_sawn.png", "flat_sawn.truth.npz"]
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_sample_holds_truth_and_resolution(tmp_path: Path) -> None:
    from PIL import Image

    scans = write_sample(tmp_path, SMALL, names=("flat_sawn", "cathedral"))
    assert [path.name for path in scans] == ["flat_sawn.png", "cathedral.png"]
    with Image.open(scans[0]) as tagged, Image.open(scans[1]) as untagged:
        assert tagged.info["dpi"] == pytest.approx((300, 300), abs=0.1)
        assert "dpi" not in untagged.info
        npt.assert_array_equal(np.asarray(tagged), scene("flat_sawn", SMALL).face.rgb_encoded)
    with np.load(tmp_path / "flat_sawn.truth.npz") as truth:
        shot = scene("flat_sawn", SMALL)
        npt.assert_array_equal(truth["age"], shot.face.age)
        npt.assert_allclose(truth["pith_point"], shot.log.pith)
        npt.assert_allclose(truth["pith_direction"], shot.log.direction)
        npt.assert_allclose(shot.log.age(truth["along_y_points"]), truth["along_y_age"], rtol=1e-4)


def test_core_labels_are_the_truth_along_their_row() -> None:
    from woodfit.synthetic_scenes import core_labels

    shot = scene("core", (367, 200))
    labels = core_labels(shot)
    for path in labels["paths"]:
        row = int(path["start"][1])
        expected = level_crossings(shot.face.age[row])
        npt.assert_allclose([x for x, _ in path["positions"]], expected, atol=0.2)
        assert len(expected) > 5
