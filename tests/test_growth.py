"""Which way the tree grew, on rings whose answer is known."""

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import Array, Image, conifer, field_of, noise, pixels, round_age, straight, wood

from woodfit.growth import Growth, find_growth, outward_flux


def growth_of(value: Image, scale: float, bright_outwards: bool | None = None) -> Growth:
    field, _ = field_of(value, scale)
    return find_growth(
        field.normal, field.asymmetry, field.explained, wood(value.shape), scale, bright_outwards=bright_outwards
    )


@pytest.mark.parametrize("polarity", [1.0, -1.0])
@pytest.mark.parametrize("center", [(110.0, 90.0), (-40.0, 100.0), (100.0, -120.0)])
def test_growth_points_away_from_the_pith_for_both_kinds_of_wood(polarity: float, center: tuple[float, float]) -> None:
    shape = (200, 220)
    age, outwards = round_age(shape, center, 14.0)
    growth = growth_of(conifer(polarity * age) + noise(shape, 0.02), 14.0)
    assert growth.bright_outwards == (polarity > 0)
    right = np.cos(growth.direction - outwards) > 0.7
    assert right[age > 2].mean() > 0.98
    assert growth.flux > 0.0
    assert 0.5 <= growth.sureness <= 1.0


def test_straight_rings_grow_as_those_of_conifers_unless_told_otherwise() -> None:
    shape = (160, 180)
    value = conifer(straight(shape, 14.0, 0.3)) + noise(shape, 0.02)
    upwards = 0.3 + np.pi / 2
    assert (np.cos(growth_of(value, 14.0).direction - upwards) > 0.9).mean() > 0.98
    told = growth_of(value, 14.0, bright_outwards=False)
    assert (np.cos(told.direction - upwards) < -0.9).mean() > 0.98
    assert told.sureness == 1.0
    assert not told.bright_outwards


def test_both_sides_of_a_flat_sawn_board_grow_away_from_its_middle() -> None:
    shape = (200, 240)
    x, _ = pixels(shape)
    distance = np.hypot(x - 110.0, 40.0)
    growth = growth_of(conifer(distance / 13.0) + noise(shape, 0.02), 13.0)
    side = np.abs(x - 110) > 40
    assert (np.sign(np.cos(growth.direction)) == np.sign(x - 110))[side].mean() > 0.98
    assert growth.bright_outwards


def test_flux_is_the_sign_of_the_spread() -> None:
    shape = (160, 160)
    _, outwards = round_age(shape, (80.0, 80.0), 10.0)
    assert outward_flux(outwards, np.ones(shape), 10.0) > 0.5
    assert outward_flux(outwards + np.pi, np.ones(shape), 10.0) < -0.5
    assert abs(outward_flux(np.full(shape, 0.4), np.ones(shape), 10.0)) < 1e-5


@pytest.mark.parametrize("polarity", [1.0, -1.0])
@pytest.mark.parametrize("pith", [(110.0, 90.0), (20.0, 150.0)])
def test_growth_is_away_from_a_pith_that_is_seen(polarity: float, pith: tuple[float, float]) -> None:
    shape = (180, 200)
    age, outwards = round_age(shape, pith, 14.0)
    value = conifer(polarity * age) + noise(shape, 0.02)
    field, _ = field_of(value, 14.0)
    fields = (field.normal, field.asymmetry, field.explained, wood(shape), 14.0)
    growth = find_growth(*fields, pith=pith)
    assert (np.cos(growth.direction - outwards) > -1e-5)[age > 0.1].all()
    assert (np.cos(growth.direction - outwards) > 0.9)[age > 2].mean() > 0.99
    # Only the kind of wood is open then.
    assert growth.bright_outwards == (polarity > 0)
    assert growth.sureness > 0.9
    assert growth.flux > 0.3
    told = find_growth(*fields, bright_outwards=polarity < 0, pith=pith)
    assert told.bright_outwards == (polarity < 0)
    npt.assert_array_equal(told.direction, growth.direction)
    assert told.sureness == 1.0


def one_sided(pith: tuple[float, float], along_stem: float) -> tuple[Growth, Array]:
    """Growth of end grain whose abrupt edges seem to lie on the wrong side over a third of it; outwards."""
    shape = (240, 360)
    _, outwards = round_age(shape, pith, 16.0)
    x, y = pixels(shape)
    wrong = x + y < 220.0
    # Edges that darken outwards: normals point inwards, but for the wrong ones.
    normal = outwards + np.where(wrong, 0.0, np.pi)
    growth = find_growth(
        normal, np.full(shape, 0.6), np.full(shape, 0.6), wood(shape), 16.0, pores=-1.6, along_stem=along_stem
    )
    return growth, outwards


def test_rings_that_all_bend_to_one_side_grow_to_the_other_whatever_some_edges_say() -> None:
    growth, outwards = one_sided((700.0, 600.0), 0.0)
    assert not growth.bright_outwards
    assert np.cos(growth.direction - outwards).min() > 0.9


def test_along_the_stem_bends_do_not_overrule_the_edges() -> None:
    growth, outwards = one_sided((700.0, 600.0), 1.0)
    assert (np.cos(growth.direction - outwards) < 0.0).mean() > 0.2


def parted(shape: tuple[int, int], middle: float) -> tuple[Array, Array]:
    """Normals and asymmetry of straight rings that grow away from the column `middle` to both sides."""
    x, _ = pixels(shape)
    return np.where(x < middle, np.pi, 0.0), np.full(shape, 0.95)


@pytest.mark.parametrize("middle", [60.0, 180.0, 300.0])
def test_growth_parts_where_the_edges_turn_round_however_near_the_border_that_is(middle: float) -> None:
    shape = (240, 360)
    normal, asymmetry = parted(shape, middle)
    growth = find_growth(normal, asymmetry, np.full(shape, 0.6), wood(shape), 16.0)
    x, _ = pixels(shape)
    sure = np.abs(x - middle) > 20.0
    assert (np.cos(growth.direction - normal) > 0.9)[sure].mean() > 0.99


def test_sides_that_part_at_the_pith_outweigh_streaks_like_those_of_vessels() -> None:
    shape = (240, 360)
    normal, asymmetry = parted(shape, 220.0)
    streaked = find_growth(normal, asymmetry, np.full(shape, 0.6), wood(shape), 16.0, pores=-1.6, along_stem=1.0)
    assert streaked.bright_outwards
    # Where the edges meet in the middle instead, the wood is ring-porous.
    meeting = find_growth(normal + np.pi, asymmetry, np.full(shape, 0.6), wood(shape), 16.0, pores=-1.6, along_stem=1.0)
    assert not meeting.bright_outwards
    npt.assert_allclose(np.cos(meeting.direction - streaked.direction), 1.0, atol=1e-6)


@pytest.mark.parametrize(("pores", "bright"), [(-0.1, True), (-1.6, False)])
def test_a_bowed_board_without_vessels_brightens_outwards(pores: float, bright: bool) -> None:
    # Rings that bow against their edges: of a stem that is not straight, or of ring-porous wood.
    shape = (260, 260)
    x, y = pixels(shape)
    field, _ = field_of(conifer((x + 14.0 * np.cos((y - 130.0) / 67.0)) / 22.0) + noise(shape, 0.02), 22.0)
    growth = find_growth(field.normal, field.asymmetry, field.explained, wood(shape), 22.0, pores=pores, along_stem=0.6)
    assert growth.bright_outwards == bright
    assert (np.sign(np.cos(growth.direction)) == (1.0 if bright else -1.0)).mean() > 0.98


@pytest.mark.parametrize("confidence_of_corner", [0.1, 0.6])
def test_growth_does_not_turn_round_along_the_rings(confidence_of_corner: float) -> None:
    # Rings along y that brighten to the right, but to the left in a corner five rings wide.
    shape, ring = (300, 320), 16.0
    x, y = pixels(shape)
    corner = (x < 5 * ring) & (y > 150)
    normal = np.where(corner, np.pi, 0.0)
    asymmetry = np.where(corner, 0.9, 0.3)
    confidence = np.where(corner, confidence_of_corner, 0.6)
    growth = find_growth(normal, asymmetry, confidence, wood(shape), ring)
    assert (np.cos(growth.direction) > 0.9).mean() > 0.98


def test_a_side_of_its_own_is_not_turned() -> None:
    # The same evidence over the whole length of a side tears no ring: it is the other side of the pith.
    shape, ring = (300, 320), 16.0
    x, _ = pixels(shape)
    side = x < 5 * ring
    growth = find_growth(np.where(side, np.pi, 0.0), np.full(shape, 0.3), np.full(shape, 0.6), wood(shape), ring)
    assert (np.cos(growth.direction) < 0.0)[x < 4 * ring].all()
    assert (np.cos(growth.direction) > 0.0)[x > 6 * ring].all()
