"""What shaders get of a texture: enough to give the same wood, point by point."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from shader_twin import color_at
from test_solid_texture import STEM, texture

from woodfit import SolidTexture
from woodfit.appearance import Finish
from woodfit.fine_grain import FineGrain
from woodfit.seen import HALVING_WIDTHS, Seen
from woodfit.shader_tables import MOST_RINGS, tables_of

GRAIN = FineGrain.of(
    kind=np.array([0, 1, 2, 3]),
    cells=np.array([[3.0, 3.0, 60.0], [5.0, 5.0, 90.0], [4.0, 12.0, 40.0], [2.0, 30.0, 50.0]]),
    density=np.array([0.0, 0.3, 0.0, 0.0]),
    amplitude=np.array([[0.10, 0.05], [0.6, 0.1], [0.08, 0.08], [0.05, 0.12]]),
    color=np.array([[1.0, 1.0, 1.0], [1.0, 1.1, 1.2], [1.0, 0.9, 0.8], [1.0, 1.0, 1.0]]),
    seed=3,
)


def points(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-80, -80, -40], [380, 280, 160], (count, 3))


@pytest.mark.parametrize("wraps", [True, False])
@pytest.mark.parametrize("pixel_size", [None, 0.2])
def test_the_tables_give_the_same_wood_in_a_language_without_arrays(wraps: bool, pixel_size: float | None) -> None:
    wood = replace(texture(wraps, pixel_size), stem=STEM, fine_grain=GRAIN)
    where = points(400) * (pixel_size or 1.0)
    tables, known = tables_of(wood), wood.evaluate(where)
    twin = [color_at(tables, point) for point in where]
    npt.assert_allclose([one[0] for one in twin], known.ring_age, atol=2e-5)
    npt.assert_allclose([one[1] for one in twin], known.lateness, atol=2e-3)
    npt.assert_allclose([one[2] for one in twin], known.rgb, atol=2e-3)


def test_without_detail_the_twin_gives_the_rings_alone() -> None:
    wood = replace(texture(), fine_grain=GRAIN)
    where = points(200, 1)
    twin = np.array([color_at(tables_of(wood), point, detail=False)[2] for point in where])
    npt.assert_allclose(twin, wood.evaluate(where, detail=False).rgb, atol=2e-3)
    assert np.abs(twin - wood.evaluate(where).rgb).mean() > 0.01


def test_the_age_table_is_the_inverse_of_the_ring_radii() -> None:
    wood = texture()
    tables = tables_of(wood)
    radius = np.linspace(0.0, tables.ring_radius[-1], 100_000)
    assert tables.first_age == 0
    looked_up = np.interp(radius / tables.age_step, np.arange(len(tables.age_table)), tables.age_table)
    assert np.abs(looked_up - wood.age_of_radius(radius)).max() < 1 / 64
    few = tables_of(wood, most_ages=50)
    assert len(few.age_table) == 50
    assert few.age_table[-1] == pytest.approx(len(wood.ring_radius) - 1)


def test_of_a_tree_with_very_many_rings_the_tables_hold_the_outer_ones() -> None:
    one, rings = texture(), MOST_RINGS + 60
    ages = np.arange(rings * one.samples_per_ring)
    wave = (0.5 + 0.3 * np.sin(ages / 7.0)[:, None] * np.array([1.0, 0.8, 0.5])).astype(np.float32)
    old = replace(
        one,
        ring_radius=np.cumsum([0.0, *np.random.default_rng(1).uniform(0.5, 1.0, rings)]),
        color_strip=wave,
        lateness_strip=wave[:, 0],
    )
    tables = tables_of(old)
    assert tables.first_age == 60
    assert len(tables.strip) <= 16_384 * one.samples_per_ring / 64
    where = points(600, 4)
    known = old.evaluate(where)
    held = known.ring_age >= 60
    assert 100 < held.sum() < 590
    twin = [color_at(tables, point) for point in where]
    npt.assert_allclose(np.array([part[0] for part in twin])[held], known.ring_age[held], atol=2e-4)
    npt.assert_allclose(np.array([part[2] for part in twin])[held], known.rgb[held], atol=4e-3)
    further_in = [age for (age, _, _), inside in zip(twin, ~held, strict=True) if inside]
    assert max(further_in) < 60, "rings go on inside of the tables"


def test_distance_from_a_face_is_that_from_its_nearest_point() -> None:
    turned = np.array([[10.0, 5.0, 2.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]])
    seen = Seen(np.stack([np.eye(3) * 0.0 + [[0, 0, 0], [1, 0, 0], [0, 1, 0]], turned]), np.array([[30.0, 20], [8, 9]]))
    where = points(50, 2) * 0.2
    u, v = np.meshgrid(np.linspace(0, 1, 241), np.linspace(0, 1, 241))
    every = np.concatenate(
        [
            (corner + u[..., None] * size[0] * right + v[..., None] * size[1] * down).reshape(-1, 3)
            for (corner, right, down), size in zip(seen.plane, seen.size, strict=True)
        ]
    )
    twin = np.array([np.linalg.norm(every - point, axis=1).min() for point in where])
    npt.assert_allclose(seen.distance(where), twin, atol=0.05)


def test_confidence_is_one_on_the_face_and_halves_away_from_it() -> None:
    face = Seen(np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]]), np.array([[300.0, 200.0]]), np.array([0.0, 99.0]))
    wood = replace(texture(pixel_size=0.5), seen=face)
    width = wood.ring_width
    depths = np.array([0.0, HALVING_WIDTHS, 2 * HALVING_WIDTHS]) * width
    where = np.column_stack([np.full(3, 50.0), np.full(3, 40.0), depths])
    npt.assert_allclose(wood.evaluate(where).confidence, [1.0, 0.5, 0.25], rtol=1e-5)
    narrow = replace(wood, seen=replace(face, ages=np.array([0.0, 0.0])))
    assert (narrow.evaluate(where).confidence < wood.evaluate(where).confidence).all(), "rings that no face shows"
    assert (texture().evaluate(where).confidence == 0.0).all(), "nothing was seen"


def test_what_was_seen_comes_back_from_the_file(tmp_path: Path) -> None:
    seen = Seen(np.arange(9.0).reshape(1, 3, 3), np.array([[300.0, 200.0]]), np.array([2.5, 7.0]))
    path = tmp_path / "texture.zarr.zip"
    replace(texture(), seen=seen).save(path)
    back = SolidTexture.open(path).seen
    npt.assert_array_equal(back.plane, seen.plane)
    npt.assert_array_equal(back.size, seen.size)
    npt.assert_array_equal(back.ages, seen.ages)


def test_latewood_is_smoother_and_stands_out() -> None:
    finish, late = Finish(), np.linspace(-0.1, 1.1, 20)
    assert (np.diff(finish.roughness(late)) <= 0.0).all()
    assert (np.diff(finish.height(late, 2.0)) >= 0.0).all()
    assert finish.height(np.array([1.0]), 2.0)[0] == pytest.approx(2.0 * finish.relief)
