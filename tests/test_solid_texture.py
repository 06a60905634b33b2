"""The solid texture: what is saved comes back, wood is continuous wherever one asks, fibres lie in their layers."""

import json
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import Array
from numpy.typing import NDArray

from woodfit import SolidTexture
from woodfit.cylinder_grid import CylinderGrid
from woodfit.displacement import age_of_radius
from woodfit.fine_grain import FineGrain
from woodfit.pith import Pith, board_to_tree
from woodfit.zarr_zip import TextureFileError, read, write

SAMPLES, RINGS = 32, 14
STEM = np.array([4e-4, -2e-4, 1e-3])
DIRECTION = np.array([0.15, 0.95, 0.25]) / np.linalg.norm([0.15, 0.95, 0.25])
PITH = Pith(np.array([150.0, 100.0, 120.0]), DIRECTION, 0.0, np.zeros(4))
MATRIX = board_to_tree(PITH, np.array([150.0, 100.0, 0.0]))


def texture(wraps: bool = True, pixel_size: float | None = None) -> SolidTexture:
    """Uneven rings, a smooth displacement, colors that differ from ring to ring and jump at their boundaries."""
    rng = np.random.default_rng(0)
    azimuth = -np.pi + np.arange(24) * np.pi / 12 if wraps else np.linspace(-0.8, 0.9, 14)
    grid = CylinderGrid(np.linspace(10.0, 210.0, 26), azimuth, np.linspace(-160.0, 160.0, 15), wraps)
    r, a, h = np.meshgrid(grid.radius, grid.azimuth, grid.height, indexing="ij")
    field = 5.0 * np.sin(r / 50.0) * np.cos(a + 0.3) + 4.0 * np.sin(h / 80.0 + a)
    fraction = (np.arange(SAMPLES) + 0.5) / SAMPLES
    level = rng.uniform(0.8, 1.2, (RINGS, 1, 1))
    colors = level * (np.array([0.6, 0.4, 0.2]) * (1.0 - 0.7 * fraction[:, None] ** 2))
    return SolidTexture(
        board_to_tree=MATRIX,
        grid=grid,
        displacement=field.astype(np.float32),
        ring_radius=np.cumsum([0.0, *rng.uniform(9.0, 22.0, RINGS)]),
        color_strip=colors.reshape(-1, 3).astype(np.float32),
        lateness_strip=np.tile(fraction**2, RINGS).astype(np.float32),
        samples_per_ring=SAMPLES,
        pixel_size=pixel_size,
        attributes={"face_size_px": [300, 200]},
    )


def from_tree(radius: Array, azimuth: Array, height: Array) -> Array:
    """Board-frame points of places in the tree."""
    radius, azimuth, height = np.broadcast_arrays(radius, azimuth, height)
    tree = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height, np.ones(radius.shape)], axis=-1)
    return np.asarray((tree @ np.linalg.inv(MATRIX).T)[..., :3])


def plain(wraps: bool = True) -> SolidTexture:
    """Without displacement: the age is known from the radius alone."""
    one = texture(wraps)
    return replace(one, displacement=np.zeros_like(one.displacement))


# --- evaluation ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(), (1,), (7,), (4, 5), (2, 3, 4), (0,)])
def test_the_result_has_the_shape_of_the_points(shape: tuple[int, ...]) -> None:
    wood = texture().evaluate(np.random.default_rng(1).uniform(0, 200, (*shape, 3)))
    for values in (wood.ring_age, wood.ring_index, wood.fraction, wood.lateness):
        assert values.shape == shape
    assert wood.rgb.shape == wood.fiber_direction.shape == (*shape, 3)
    assert (wood.ring_age.dtype, wood.ring_index.dtype, wood.rgb.dtype) == (np.float64, np.int64, np.float32)


@pytest.mark.parametrize("shape", [(), (2,), (3, 2), (3, 4)])
def test_points_of_another_shape_are_an_error(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"expected \(\.\.\., 3\)"):
        texture().evaluate(np.zeros(shape))


def test_a_point_does_not_depend_on_the_company_it_keeps() -> None:
    points = np.random.default_rng(2).uniform(-100, 400, (140_000, 3))
    whole, few = texture().evaluate(points), texture().evaluate(points[131_000:131_500])
    npt.assert_array_equal(whole.ring_age[131_000:131_500], few.ring_age)
    npt.assert_array_equal(whole.rgb[131_000:131_500], few.rgb)


def test_without_displacement_rings_are_round_and_have_their_radii() -> None:
    one = plain()
    rng = np.random.default_rng(3)
    azimuth, height = rng.uniform(-np.pi, np.pi, (2, 500))
    for age, radius in enumerate(one.ring_radius):
        npt.assert_allclose(one.evaluate(from_tree(radius, azimuth, 100 * height)).ring_age, age, atol=1e-9)


def test_index_and_fraction_make_up_the_age() -> None:
    wood = texture().evaluate(np.random.default_rng(4).uniform(-100, 400, (2000, 3)))
    npt.assert_allclose(wood.ring_index + wood.fraction, wood.ring_age)
    assert wood.fraction.min() >= 0.0
    assert wood.fraction.max() < 1.0


def test_the_age_is_that_of_the_fit() -> None:
    one = plain()
    radius = np.linspace(0.0, 400.0, 1000)
    npt.assert_allclose(
        one.evaluate(from_tree(radius, 0.3, 9.0)).ring_age, age_of_radius(radius, one.ring_radius)[0], atol=1e-9
    )


def test_mm_and_px_are_the_same_wood() -> None:
    points = np.random.default_rng(5).uniform(-100, 400, (3000, 3))
    px, mm = texture(), texture(pixel_size=0.085)
    assert (px.unit, mm.unit) == ("px", "mm")
    one, other = px.evaluate(points), mm.evaluate(points * 0.085)
    npt.assert_allclose(other.ring_age, one.ring_age, atol=1e-5)
    npt.assert_allclose(other.rgb, one.rgb, atol=1e-3)
    npt.assert_allclose(other.fiber_direction, one.fiber_direction, atol=1e-5)


@pytest.mark.parametrize("wraps", [True, False])
def test_the_age_is_continuous_all_round_the_tree(wraps: bool) -> None:
    one = texture(wraps)
    turn = np.linspace(-np.pi, np.pi, 20_001)
    for radius, height in ((40.0, -30.0), (120.0, 0.0), (190.0, 77.0)):
        age = one.evaluate(from_tree(radius, turn, height)).ring_age
        assert np.abs(np.diff(np.append(age, age[0]))).max() < 0.002


def test_the_color_has_no_seam_anywhere_along_the_radius() -> None:
    one = plain()
    strip = np.column_stack([one.color_strip, one.lateness_strip])
    # From the pith over all ring boundaries, past the strip's end and the eight rings that come again, twice.
    radius = np.linspace(0.0, one.ring_radius[-1] + 20 * one.mean_width, 400_001)
    wood = one.evaluate(from_tree(radius, 0.2, 5.0))
    per_sample = np.diff(wood.ring_age).max() * SAMPLES
    # The widest step between samples, the one from the last ring back to its eighth last included.
    widest = max(np.abs(np.diff(strip, axis=0)).max(), np.abs(strip[-1] - strip[-8 * SAMPLES]).max())
    found = np.column_stack([wood.rgb, wood.lateness])
    assert np.abs(np.diff(found, axis=0)).max() < 1.1 * widest * per_sample + 1e-6


def test_samples_of_the_strip_lie_at_their_ages() -> None:
    one = plain()
    age = (np.arange(RINGS * SAMPLES) + 0.5) / SAMPLES
    radius = np.interp(age, np.arange(RINGS + 1), one.ring_radius)
    wood = one.evaluate(from_tree(radius, 0.0, 0.0))
    npt.assert_allclose(wood.rgb, one.color_strip, atol=1e-5)
    npt.assert_allclose(wood.lateness, one.lateness_strip, atol=1e-5)


def test_beyond_the_last_ring_there_is_still_wood() -> None:
    one = plain()
    beyond = one.ring_radius[-1] + np.linspace(0.5, 16.0, 1000) * one.mean_width
    wood = one.evaluate(from_tree(beyond, 0.4, 0.0))
    npt.assert_allclose(wood.ring_age, RINGS + np.linspace(0.5, 16.0, 1000), atol=1e-9)
    assert wood.rgb.std(axis=0).min() > 0.5 * one.color_strip.std(axis=0).min()
    assert wood.lateness.max() > 0.9
    assert wood.lateness.min() < 0.1
    # The last eight rings come again: color of age is color of age minus eight.
    again = one.evaluate(from_tree(beyond + 8 * one.mean_width, 0.4, 0.0))
    npt.assert_allclose(again.rgb, wood.rgb, atol=1e-4)
    shown = np.interp(RINGS - 8 + np.linspace(0.5, 7.5, 100), np.arange(RINGS + 1), one.ring_radius)
    first = one.evaluate(from_tree(one.ring_radius[-1] + np.linspace(0.5, 7.5, 100) * one.mean_width, 0.4, 0.0))
    npt.assert_allclose(first.rgb, one.evaluate(from_tree(shown, 0.4, 0.0)).rgb, atol=1e-4)


def test_a_strip_of_less_than_eight_rings_repeats_what_it_has() -> None:
    one = plain()
    short = replace(one, color_strip=one.color_strip[: 3 * SAMPLES], lateness_strip=one.lateness_strip[: 3 * SAMPLES])
    radius = np.interp([2.5, 5.5, 8.5], np.arange(RINGS + 1), one.ring_radius)
    rgb = short.evaluate(from_tree(radius, 0.0, 0.0)).rgb
    npt.assert_allclose(rgb[1:], rgb[:1].repeat(2, axis=0), atol=1e-5)


def test_fibres_lie_within_their_growth_layers() -> None:
    one = texture()
    rng = np.random.default_rng(6)
    points = from_tree(rng.uniform(20, 200, 3000), rng.uniform(-np.pi, np.pi, 3000), rng.uniform(-150, 150, 3000))
    fiber = one.evaluate(points).fiber_direction
    npt.assert_allclose(np.linalg.norm(fiber, axis=-1), 1.0, atol=1e-6)
    steps = 0.02 * np.eye(3)
    gradient = np.stack([one.evaluate(points + d).ring_age - one.evaluate(points - d).ring_age for d in steps], -1)
    gradient /= np.linalg.norm(gradient, axis=-1, keepdims=True)
    off = np.abs((fiber * gradient).sum(axis=-1))
    # Where the small step meets a node of the grid, the slope is that of neither side.
    assert np.percentile(off, 95) < 2e-3
    assert np.percentile(np.abs(gradient @ DIRECTION), 50) > 0.01, "the pith's direction alone would not do"
    # Along the stem, not across it.
    assert (fiber @ DIRECTION).min() > 0.9


def test_fibres_of_a_bent_and_tapering_stem_lie_within_their_growth_layers() -> None:
    one = replace(plain(), stem=STEM)
    rng = np.random.default_rng(6)
    points = from_tree(rng.uniform(40, 180, 3000), rng.uniform(-np.pi, np.pi, 3000), rng.uniform(-150, 150, 3000))
    fiber = one.evaluate(points).fiber_direction
    steps = 0.02 * np.eye(3)
    gradient = np.stack([one.evaluate(points + d).ring_age - one.evaluate(points - d).ring_age for d in steps], -1)
    gradient /= np.linalg.norm(gradient, axis=-1, keepdims=True)
    # The table of radii is linear between rings: a step across a boundary sees both sides' slopes, in one direction.
    assert np.percentile(np.abs((fiber * gradient).sum(axis=-1)), 95) < 2e-3
    assert np.percentile(np.abs(gradient @ DIRECTION), 50) > 0.03, "the pith's direction alone would not do"


def test_the_pith_of_a_bent_stem_is_where_its_parabola_runs() -> None:
    one = replace(plain(), stem=STEM)
    height = np.linspace(-150, 150, 50)
    tree = np.stack([STEM[0] * height**2, STEM[1] * height**2, height, np.ones(50)], axis=-1)
    wood = one.evaluate((tree @ np.linalg.inv(MATRIX).T)[:, :3])
    npt.assert_allclose(wood.ring_age, 0.0, atol=1e-6)


def test_a_taper_makes_rings_narrower_further_up() -> None:
    one = replace(plain(), stem=np.array([0.0, 0.0, 2e-3]))
    for height in (-100.0, 0.0, 150.0):
        radius = one.ring_radius[3:8] / (1 + 2e-3 * height)
        npt.assert_allclose(one.evaluate(from_tree(radius, 0.4, height)).ring_age, np.arange(3, 8), atol=1e-9)


def test_evaluation_keeps_the_points() -> None:
    points = np.random.default_rng(7).uniform(0, 100, (50, 3))
    kept = points.copy()
    texture(pixel_size=0.1).evaluate(points)
    npt.assert_array_equal(points, kept)


# --- the file --------------------------------------------------------------------------------------------------------

ARRAYS = ("board_to_tree", "stem", "displacement", "ring_radius", "color_strip", "lateness_strip")
GRAIN = ("kind", "cells", "density", "amplitude", "color", "log_mean")


@pytest.mark.parametrize("pixel_size", [None, 0.0847])
@pytest.mark.parametrize("wraps", [True, False])
def test_what_is_saved_comes_back(tmp_path: Path, wraps: bool, pixel_size: float | None) -> None:
    one = texture(wraps, pixel_size)
    one.save(tmp_path / "t.zarr.zip")
    other = SolidTexture.open(tmp_path / "t.zarr.zip")
    for name in ARRAYS:
        npt.assert_array_equal(getattr(other, name), getattr(one, name))
        assert getattr(other, name).dtype == getattr(one, name).dtype
    for name in ("radius", "azimuth", "height", "wraps"):
        npt.assert_array_equal(getattr(other.grid, name), getattr(one.grid, name))
    assert (other.samples_per_ring, other.pixel_size, other.attributes) == (SAMPLES, pixel_size, one.attributes)
    points = np.random.default_rng(8).uniform(0, 20, (100, 3))
    npt.assert_array_equal(other.evaluate(points).rgb, one.evaluate(points).rgb)


def test_stem_grain_and_unit_come_back(tmp_path: Path) -> None:
    grain = FineGrain.of(
        np.array([0, 1]),
        np.full((2, 3), [2.0, 2.0, 40.0]),
        np.array([1.0, 0.2]),
        np.full((2, 2), 0.3),
        np.ones((2, 3)),
        9,
    )
    one = replace(texture(True, 0.05), stem=STEM, fine_grain=grain, length_unit="inch")
    one.save(tmp_path / "t.zarr.zip")
    other = SolidTexture.open(tmp_path / "t.zarr.zip")
    assert (other.unit, other.pixel_size, other.fine_grain.seed, other.attributes) == ("inch", 0.05, 9, one.attributes)
    npt.assert_array_equal(other.stem, STEM)
    for name in GRAIN:
        npt.assert_array_equal(getattr(other.fine_grain, name), getattr(grain, name))
    points = np.random.default_rng(8).uniform(0, 20, (100, 3))
    npt.assert_array_equal(other.evaluate(points).rgb, one.evaluate(points).rgb)
    assert (other.evaluate(points).rgb != one.evaluate(points, detail=False).rgb).any()


@pytest.mark.parametrize("pixel_size", [None, 0.0847])
def test_a_file_of_the_first_version_still_opens(tmp_path: Path, pixel_size: float | None) -> None:
    path = tmp_path / "t.zarr.zip"
    one = texture(pixel_size=pixel_size)
    one.save(path)
    arrays, attributes = read(path)
    for name in ("stem", *(f"grain_{name}" for name in GRAIN)):
        del arrays[name]
    for name in ("unit", "pixel_size", "grain_seed"):
        del attributes[name]
    write(path, arrays, {**attributes, "format_version": 1, "pixel_size_mm": pixel_size})
    found = SolidTexture.open(path)
    assert (found.unit, found.pixel_size, found.attributes) == (one.unit, pixel_size, one.attributes)
    points = np.random.default_rng(8).uniform(0, 20, (100, 3))
    npt.assert_array_equal(found.evaluate(points).rgb, one.evaluate(points).rgb)


def test_equal_textures_are_equal_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texture().save(tmp_path / "a.zarr.zip")
    monkeypatch.setattr("time.time", lambda: 2e9)
    texture().save(tmp_path / "b.zarr.zip")
    SolidTexture.open(tmp_path / "a.zarr.zip").save(tmp_path / "c.zarr.zip")
    first = (tmp_path / "a.zarr.zip").read_bytes()
    assert (tmp_path / "b.zarr.zip").read_bytes() == first
    assert (tmp_path / "c.zarr.zip").read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zarr.zip", "b.zarr.zip", "c.zarr.zip"]


def test_the_zarr_library_reads_the_same_arrays(tmp_path: Path) -> None:
    import zarr

    one = texture(pixel_size=0.05)
    one.save(tmp_path / "t.zarr.zip")
    store = zarr.storage.ZipStore(tmp_path / "t.zarr.zip", mode="r")
    try:
        group = zarr.open_group(store, mode="r")
        for name in ARRAYS:
            npt.assert_array_equal(group[name][...], getattr(one, name))
        npt.assert_array_equal(group["grid_azimuth"][...], one.grid.azimuth)
        assert group.attrs["samples_per_ring"] == SAMPLES
        assert group.attrs["pixel_size"] == 0.05
        assert group.attrs["unit"] == "mm"
    finally:
        store.close()


def test_the_file_is_small(tmp_path: Path) -> None:
    one = texture()
    one.save(tmp_path / "t.zarr.zip")
    raw = sum(getattr(one, name).nbytes for name in ARRAYS)
    # Each array of the group costs some 800 bytes for its names and its description.
    assert (tmp_path / "t.zarr.zip").stat().st_size < raw + 14_000


def test_a_failed_save_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "t.zarr.zip"
    texture().save(path)
    before = path.read_bytes()
    with pytest.raises(TypeError, match="`wrong` has dtype"):
        write(path, {"fine": np.zeros(3), "wrong": np.zeros(3, complex)}, {})
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


Spoil = Callable[[Path], None]


def text(path: Path) -> None:
    path.write_text("this is not wood\n" * 50)


def truncated(path: Path) -> None:
    texture().save(path)
    path.write_bytes(path.read_bytes()[:-300])


def beheaded(path: Path) -> None:
    texture().save(path)
    path.write_bytes(path.read_bytes()[5000:])


def other_zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("letter.txt", "dear carpenter")


def other_group(path: Path) -> None:
    write(path, {"x": np.zeros(3)}, {"what": "something else"})


def later_version(path: Path) -> None:
    texture().save(path)
    arrays, attributes = read(path)
    write(path, arrays, {**attributes, "format_version": 4})


def without_an_array(path: Path) -> None:
    texture().save(path)
    arrays, attributes = read(path)
    del arrays["ring_radius"]
    write(path, arrays, attributes)


def folder(path: Path) -> None:
    path.mkdir()


def nothing(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (text, "not a readable solid texture"),
        (truncated, "not a readable solid texture"),
        (beheaded, "not a readable solid texture"),
        (other_zip, "not a readable solid texture"),
        (nothing, "not a readable solid texture"),
        (folder, "not a readable solid texture"),
        (other_group, "not a woodpipe solid texture"),
        (later_version, "version 4, this woodpipe reads versions 1, 2 and 3"),
        (without_an_array, "lacks 'ring_radius'"),
    ],
)
def test_a_file_that_is_no_texture_is_one_clear_error(tmp_path: Path, spoil: Spoil, said: str) -> None:
    path = tmp_path / "t.zarr.zip"
    spoil(path)
    with pytest.raises(TextureFileError) as caught:
        SolidTexture.open(path)
    assert said in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    with pytest.raises(TextureFileError, match="there is no such file"):
        SolidTexture.open(tmp_path / "t.zarr.zip")


def test_damage_is_noticed_or_harmless(tmp_path: Path) -> None:
    path = tmp_path / "t.zarr.zip"
    one = texture()
    one.save(path)
    whole = np.frombuffer(path.read_bytes(), np.uint8)
    rng = np.random.default_rng(9)
    noticed = 0
    for place in rng.integers(0, len(whole), 150):
        damaged: NDArray[np.uint8] = whole.copy()
        damaged[place] ^= np.uint8(1 << rng.integers(8))
        path.write_bytes(damaged.tobytes())
        try:
            with warnings.catch_warnings():
                # zipfile grumbles at names that come twice.
                warnings.simplefilter("ignore")
                found = SolidTexture.open(path)
        except TextureFileError:
            noticed += 1
            continue
        for name in ARRAYS:
            npt.assert_array_equal(getattr(found, name), getattr(one, name))
    assert noticed > 100


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("samples_per_ring", None),
        ("samples_per_ring", "many"),
        ("pixel_size", "small"),
        ("grain_seed", "seven"),
        ("format_version", None),
    ],
)
def test_attributes_of_another_kind_are_one_clear_error(tmp_path: Path, name: str, value: object) -> None:
    path = tmp_path / "t.zarr.zip"
    texture().save(path)
    arrays, attributes = read(path)
    write(path, arrays, {**attributes, name: value})
    with pytest.raises(TextureFileError):
        SolidTexture.open(path)


def test_arrays_that_do_not_fit_each_other_are_one_clear_error(tmp_path: Path) -> None:
    path = tmp_path / "t.zarr.zip"
    texture().save(path)
    arrays, attributes = read(path)
    write(path, {**arrays, "displacement": arrays["displacement"][:-1]}, attributes)
    with pytest.raises(TextureFileError, match="displacement"):
        SolidTexture.open(path)


def test_an_array_that_claims_more_than_it_holds_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "t.zarr.zip"
    texture().save(path)
    with zipfile.ZipFile(path) as file:
        entries = {entry: file.read(entry) for entry in file.namelist()}
    meta = json.loads(entries["ring_radius/zarr.json"])
    for shape in ([10**12], [RINGS + 2], [-3], ["x"]):
        entries["ring_radius/zarr.json"] = json.dumps({**meta, "shape": shape}).encode()
        with zipfile.ZipFile(path, "w") as file:
            for entry, data in entries.items():
                file.writestr(entry, data)
        with pytest.raises(TextureFileError):
            SolidTexture.open(path)


def test_a_chunk_that_is_not_gzip_inside_a_sound_zip_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "t.zarr.zip"
    texture().save(path)
    with zipfile.ZipFile(path) as file:
        entries = {entry: file.read(entry) for entry in file.namelist()}
    chunk = bytearray(entries["displacement/c/0/0/0"])
    # The head of a gzip stream, and then nothing that can be unpacked.
    chunk[10:] = b"\xff" * (len(chunk) - 10)
    entries["displacement/c/0/0/0"] = bytes(chunk)
    with zipfile.ZipFile(path, "w") as file:
        for entry, data in entries.items():
            file.writestr(entry, data)
    with pytest.raises(TextureFileError):
        SolidTexture.open(path)
