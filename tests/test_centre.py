"""The pith in the picture: found on discs whatever they suffered, and nowhere else."""

from functools import cache

import cv2
import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import SHARED, Array, Image, conifer, needs_shared, noise, pixels, round_age, straight, wood
from scipy.ndimage import gaussian_filter

from woodfit import photograph
from woodfit.centre import find_centre
from woodfit.structure_tensor import orientation
from woodfit.synthetic_scenes import scene

SIDE = 320
PITH = (138.0, 171.0)


def eccentric_age(shift: tuple[float, float] = (1.2, -0.8), width: float = 11.0) -> Array:
    """Ring age of circles whose centres move by `shift` px a ring, away from the pith."""
    x, y = pixels((SIDE, SIDE))
    away = np.stack([x - PITH[0], y - PITH[1]], axis=-1)
    along, square = away @ np.array(shift), (away**2).sum(axis=-1)
    room = width**2 - shift[0] ** 2 - shift[1] ** 2
    # |away - age shift| = age width, solved for the age.
    return np.asarray((np.sqrt(along**2 + room * square) - along) / room)


@cache
def disc(damage: str = "") -> tuple[Image, np.ndarray]:
    """A disc on a white ground, and where the wood is."""
    age = eccentric_age()
    x, y = pixels((SIDE, SIDE))
    radius, azimuth = np.hypot(x - PITH[0], y - PITH[1]), np.arctan2(y - PITH[1], x - PITH[0])
    value = conifer(age) + noise((SIDE, SIDE), 0.02)
    valid = age < 12.0
    if "cracks" in damage:
        for at, wide in ((1.0, 0.03), (2.4, 0.02), (-1.9, 0.015)):
            gap = (np.abs(np.angle(np.exp(1j * (azimuth - at)))) < wide) & (radius > 15)
            value = np.where(gap, 0.1, value)
    if "stain" in damage:
        # Streaks along the rays, over a seventh of the disc, stronger than the rings.
        rng = np.random.default_rng(3)
        streaks = gaussian_filter(rng.normal(0.0, 1.0, 720), 1.5, mode="wrap")
        turn = ((azimuth / (2 * np.pi)) % 1.0 * 720).astype(int) % 720
        value = value - np.where(np.abs(azimuth - 1.2) < 0.45, 0.25 + 0.2 * streaks[turn] / streaks.std(), 0.0)
    value = gaussian_filter(np.where(valid, value, 1.0), 0.6).astype(np.float32)
    return value, valid


def centre_of(value: Image, valid: np.ndarray) -> tuple[float, float, float] | None:
    value, valid = np.ascontiguousarray(value), np.ascontiguousarray(valid)
    angle, coherence = orientation(value, valid, 1.5, 5.0)
    return find_centre(angle, coherence * valid)


@pytest.mark.parametrize("damage", ["", "cracks", "stain", "cracks and stain"])
def test_the_pith_of_an_eccentric_disc_is_found(damage: str) -> None:
    found = centre_of(*disc(damage))
    assert found is not None
    assert np.hypot(found[0] - PITH[0], found[1] - PITH[1]) < 3.0
    assert 0.7 < found[2] <= 1.0 + 1e-9
    assert found[2] > 0.95 or damage


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_the_pith_turns_with_the_picture(turns: int) -> None:
    value, valid = disc("cracks and stain")
    found, turned = centre_of(value, valid), centre_of(np.rot90(value, turns), np.rot90(valid, turns))
    assert found is not None
    assert turned is not None
    x, y = found[:2]
    for _ in range(turns):
        x, y = y, SIDE - 1 - x
    npt.assert_allclose(turned[:2], (x, y), atol=0.5)
    assert turned[2] == pytest.approx(found[2], abs=0.02)


def test_the_pith_is_mirrored_with_the_picture_and_does_not_see_the_light() -> None:
    value, valid = disc("stain")
    found = centre_of(value, valid)
    assert found is not None
    mirrored = centre_of(value[:, ::-1], valid[:, ::-1])
    assert mirrored is not None
    npt.assert_allclose(mirrored[:2], (SIDE - 1 - found[0], found[1]), atol=0.5)
    for other in (0.3 * value + 0.1, 1.0 - value):
        again = centre_of(other, valid)
        assert again is not None
        npt.assert_allclose(again[:2], found[:2], atol=0.5)


@pytest.mark.parametrize("center", [(31.0, 40.5), (120.25, 75.0), (60.0, 20.0)])
def test_perfect_circles_give_their_centre_exactly(center: tuple[float, float]) -> None:
    _, outwards = round_age((110, 150), center, 10.0)
    found = find_centre(outwards + np.pi / 2, np.ones((110, 150)))
    assert found is not None
    npt.assert_allclose(found[:2], center, atol=0.01)
    assert found[2] == pytest.approx(1.0, abs=0.01)
    # Belief has no unit.
    assert find_centre(outwards + np.pi / 2, np.full((110, 150), 7.0)) == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize("seed", [1, 3])
def test_the_pith_of_a_drawn_log_is_found(seed: int) -> None:
    drawn = scene("end_grain_pith", (220, 220), seed)
    found = centre_of(photograph.grey_value(drawn.face.rgb_encoded), wood((220, 220)))
    assert found is not None
    npt.assert_allclose(found[:2], drawn.log.pith[:2], atol=2.0)


@pytest.mark.parametrize("name", ["cathedral", "flat_sawn", "quarter_sawn", "end_grain_off", "core"])
def test_faces_that_do_not_show_the_pith_have_none(name: str) -> None:
    drawn = scene(name, (240, 240), 0)
    value = photograph.grey_value(drawn.face.rgb_encoded)
    assert centre_of(value, wood(value.shape)) is None


@pytest.mark.parametrize("tangent", [0.0, 0.4, np.pi / 2, 2.5])
def test_parallel_rings_and_noise_go_round_nothing(tangent: float) -> None:
    shape = (160, 200)
    value = conifer(straight(shape, 12.0, tangent)) + noise(shape, 0.02)
    assert centre_of(value, wood(shape)) is None
    assert find_centre(np.full(shape, tangent), np.ones(shape)) is None
    assert centre_of(noise(shape, 0.1, seed=int(10 * tangent)), wood(shape)) is None


def test_rings_about_a_point_beside_the_picture_have_no_pith_in_it() -> None:
    shape = (160, 200)
    for center in ((-20.0, 80.0), (100.0, 190.0), (230.0, -30.0)):
        age, _ = round_age(shape, center, 12.0)
        assert centre_of(conifer(age), wood(shape)) is None
    # Half of a disc is not gone round either.
    age, _ = round_age(shape, (3.0, 80.0), 12.0)
    assert centre_of(conifer(age), wood(shape)) is None


def test_without_wood_there_is_no_pith() -> None:
    _, outwards = round_age((90, 90), (45.0, 45.0), 10.0)
    assert find_centre(outwards + np.pi / 2, np.zeros((90, 90))) is None
    speck = np.zeros((90, 90))
    speck[:9, :9] = 1.0
    assert find_centre(outwards + np.pi / 2, speck) is None


# --- real scans -----------------------------------------------------------------------------------------------------


def real_centre(name: str) -> tuple[float, float] | None:
    """Pith in scan px, looked for on the overview that the scan stage looks at."""
    read = cv2.imread(str(SHARED / "data" / "scans" / name))
    assert read is not None, name
    step = max(1, -(-max(read.shape[:2]) // 1200))
    overview = np.ascontiguousarray(read[::step, ::step, ::-1])
    valid = photograph.wood_mask(overview, np.ones(overview.shape[:2], bool), 0.92, 0.06)
    found = centre_of(photograph.grey_value(overview), valid)
    return None if found is None else (found[0] * step, found[1] * step)


@pytest.mark.shared
@needs_shared
@pytest.mark.parametrize(
    ("name", "pith", "within_px"), [("F02b.png", (879.0, 903.0), 40.0), ("A05b.jpeg", (900.0, 872.0), 25.0)]
)
def test_the_pith_of_real_discs_is_found(name: str, pith: tuple[float, float], within_px: float) -> None:
    found = real_centre(f"discs/{name}")
    assert found is not None
    assert np.hypot(found[0] - pith[0], found[1] - pith[1]) < within_px


@pytest.mark.shared
@needs_shared
@pytest.mark.parametrize(
    "name",
    [
        *(f"cores/{core}" for core in ("mtreering_001.png", "mtreering_incline.png", "p105_a.tif", "uaa_core.jpg")),
        *(f"boards/{board}" for board in ("walnut_flatsawn.jpg", "red_birch.jpg", "red_oak_endgrain.jpg")),
        *(f"blocks/CN03/{face}_col.png" for face in ("A", "B", "C", "D", "E", "F", "cut2")),
    ],
)
def test_boards_cores_and_blocks_show_no_pith(name: str) -> None:
    assert real_centre(name) is None
