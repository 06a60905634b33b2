"""The pith line from rings that are exactly round, and the radii of the rings about it."""

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import Array
from skimage.measure import find_contours

from woodfit.fiber import FiberSight
from woodfit.pith import Fixed, Pith, board_to_tree, fit_pith
from woodfit.pith_energy import RingPoints, frame_of, radii, sample_rings
from woodfit.pith_evidence import TRACED_WITHIN, Evidence, Growth
from woodfit.pith_search import Cost, Known
from woodfit.pith_stem import with_stem
from woodfit.planes import Planes
from woodfit.pose_story import Face, describe, undetermined
from woodfit.ring_radii import ring_radii

SHAPE = (400, 480)
CENTER = np.array([239.5, 199.5, 0.0])


def face_points() -> Array:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return np.stack([x, y, np.zeros(SHAPE)], axis=-1)


def line(point: tuple[float, float, float], direction: tuple[float, float, float]) -> tuple[Array, Array]:
    along = np.asarray(direction) / np.linalg.norm(direction)
    return np.asarray(point, float), along


def drawn_rings(point: Array, along: Array, boundaries: Array) -> tuple[Array, RingPoints]:
    """True age of every boundary that the face shows (one line each), and samples of all."""
    radius = radii(face_points(), point, along)
    lines, ages = [], []
    for age, boundary in enumerate(boundaries):
        for contour in find_contours(radius, boundary) if age else ():
            if len(contour) >= 30:
                lines.append(contour[:, ::-1].copy())
                ages.append(age)
    found = np.array(ages)
    beliefs = [np.ones(len(one)) for one in lines]
    return found, sample_rings(lines, beliefs, found - found.min() + 1, np.zeros(len(found), int))


def even(width: float, count: int = 120) -> Array:
    """Boundaries of rings that all are `width` px wide."""
    return width * np.arange(count)


def natural(seed: int, count: int = 120) -> Array:
    """Boundaries of rings whose width varies from year to year, the first one of them of the usual width."""
    widths = 14.0 * np.exp(np.random.default_rng(seed).normal(0.0, 0.2, count))
    widths[0] = 14.0
    return np.concatenate([[0.0], np.cumsum(widths)])


def apart(pith: Pith, point: Array, along: Array) -> tuple[float, float, float]:
    """Angle (degrees) between found and true line, and their distance (px) across the face and in depth there."""
    angle = np.degrees(np.arccos(min(1.0, abs(float(pith.direction @ along)))))
    gap = pith.point - point - ((CENTER - point) @ along) * along
    across, inward = frame_of(along)
    return float(angle), abs(float(gap @ across)), abs(float(gap @ inward))


# Point and direction of the pith, and how far from the truth the angle (degrees) and the two offsets (px) may be:
# wide where the face hardly tells (tilt on end grain, depth on a flat-sawn board, both on a cathedral).
CUTS = {
    "end_grain": ((260.0, 180.0, 0.0), (0.03, -0.02, 1.0), (3.5, 0.5, 0.5)),
    "end_grain_off": ((700.0, -60.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)),
    "flat_sawn": ((200.0, 200.0, 160.0), (0.03, 1.0, 0.01), (1.0, 1.0, 60.0)),
    "flat_sawn_along_x": ((240.0, 220.0, 120.0), (1.0, 0.05, 0.0), (1.0, 1.0, 60.0)),
    "cathedral": ((250.0, 200.0, 150.0), (0.05, 1.0, 0.35), (0.5, 1.5, 4.0)),
}


@pytest.mark.parametrize("cut", CUTS)
def test_the_pith_line_of_round_rings_is_found(cut: str) -> None:
    place, direction, most = CUTS[cut]
    point, along = line(place, direction)
    _, rings = drawn_rings(point, along, even(14.0))
    pith = fit_pith(rings, 480.0)
    assert (np.array(apart(pith, point, along)) <= most).all()
    assert np.linalg.norm(pith.direction) == pytest.approx(1.0)
    assert pith.spread.shape == (4,)
    assert np.isfinite(pith.spread).all()
    assert (pith.spread > 0).all()


def test_a_quarter_sawn_board_tells_the_direction_but_not_the_distance() -> None:
    point, along = line((-300.0, 200.0, 40.0), (0.02, 1.0, 0.0))
    _, rings = drawn_rings(point, along, natural(1))
    pith = fit_pith(rings, 480.0)
    assert apart(pith, point, along)[0] < 1.5
    assert undetermined(pith, Face(0.0, 0.0, 479.0, 399.0), 14.0)[2]
    assert np.diff(radii(np.array([[0.0, 200, 0], [240, 200, 0], [480, 200, 0]]), pith.point, pith.direction)).min() > 0


@pytest.mark.parametrize(("cut", "seed"), [("flat_sawn", 1), ("end_grain_off", 2)])
def test_uneven_years_do_not_turn_the_pith_line(cut: str, seed: int) -> None:
    point, along = line(*CUTS[cut][:2])
    _, rings = drawn_rings(point, along, natural(seed))
    angle, across, _ = apart(fit_pith(rings, 480.0), point, along)
    assert angle < 2.0
    assert across < 10.0


def elliptic_rings(aspect: float, width: float = 14.0) -> RingPoints:
    """Boundaries around (260, 180) that are `aspect` times as long along one way as across it."""
    x, y = np.moveaxis(face_points(), -1, 0)[:2] - np.array([260.0, 180.0])[:, None, None]
    radius = np.hypot(0.8 * x + 0.6 * y, (0.8 * y - 0.6 * x) / aspect)
    lines = [(age, line) for age in range(1, 18) for line in find_contours(radius, width * age) if len(line) >= 30]
    ages = np.array([age for age, _ in lines])
    vertices = [line[:, ::-1].copy() for _, line in lines]
    return sample_rings(vertices, [np.ones(len(one)) for one in vertices], ages, np.zeros(len(ages), int))


def uneven_rings(point: Array, along: Array, turn: float, shape: tuple[float, float], scatter: float) -> RingPoints:
    """Boundaries of a stem that is narrower towards `turn` (rad, from the face) by two shares of its radius."""
    away, (across, inward) = face_points() - point, frame_of(along)
    radius, azimuth = np.hypot(away @ across, away @ inward), np.arctan2(away @ inward, away @ across) - turn
    radius = radius * (1.0 + shape[0] * np.cos(azimuth) + shape[1] * np.cos(2.0 * azimuth))
    boundaries = np.cumsum(5.0 * np.exp(np.random.default_rng(3).normal(0.0, scatter, 200)))
    found = [(age, one) for age, at in enumerate(boundaries) for one in find_contours(radius, at) if len(one) >= 30]
    ages = np.array([age for age, _ in found])
    vertices = [one[:, ::-1].copy() for _, one in found]
    return sample_rings(vertices, [np.ones(len(one)) for one in vertices], ages - ages.min() + 1, np.zeros_like(ages))


@pytest.mark.parametrize("turn", [0.0, 2.5])
def test_a_stem_that_is_not_round_does_not_pass_for_a_shallow_pith(turn: float) -> None:
    point, along = line((240.0, 200.0, 160.0), (0.02, 1.0, 0.0))
    pith = fit_pith(uneven_rings(point, along, turn, (0.12, 0.05), 0.1), 480.0)
    assert 0.75 * 160.0 < pith.point[2] < 1.25 * 160.0
    assert apart(pith, point, along)[0] < 1.0


@pytest.mark.parametrize("turn", [0.0, 1.0, 4.0])
def test_the_direction_of_a_cathedral_whose_stem_is_not_round_is_open_or_right(turn: float) -> None:
    point, along = line((250.0, 200.0, 150.0), (0.05, 1.0, 0.45))
    pith = fit_pith(uneven_rings(point, along, turn, (0.12, 0.05), 0.1), 480.0)
    assert undetermined(pith, Face(0.0, 0.0, 479.0, 399.0), 5.0)[0] or apart(pith, point, along)[0] < 2.0


@pytest.mark.parametrize("aspect", [1.0, 1.06, 1.12])
def test_an_oval_end_grain_is_square_to_its_stem_and_its_tilt_is_open(aspect: float) -> None:
    # A round stem would have to be cut up to 27 degrees aslant.
    pith = fit_pith(elliptic_rings(aspect), 480.0)
    assert abs(pith.direction[2]) > np.cos(np.radians(1.0))
    assert np.hypot(*(pith.point[:2] - [260.0, 180.0])) < 0.3 * 14.0
    face = Face(0.0, 0.0, 479.0, 399.0)
    assert undetermined(pith, face, 14.0).tolist() == [True, True, False, False]
    assert any("taken as square to the stem" in warning for warning in describe(pith, face, 14.0).warnings)


def test_rings_longer_than_any_tree_is_oval_are_cut_aslant() -> None:
    pith = fit_pith(elliptic_rings(2.0), 480.0)
    assert np.degrees(np.arccos(abs(pith.direction[2]))) == pytest.approx(60.0, abs=3.0)


def test_a_known_tilt_is_kept_on_oval_end_grain() -> None:
    pith = fit_pith(elliptic_rings(1.06), 480.0, fixed=Fixed((None, None, None), 19.0, None))
    assert np.degrees(np.arccos(abs(pith.direction[2]))) == pytest.approx(19.0, abs=1e-6)


def test_a_pith_under_the_face_is_expected_neither_next_to_it_nor_far_below() -> None:
    _, rings = drawn_rings(*line((200.0, 0.0, 120.0), (0.0, 1.0, 0.0)), even(16.0))
    size, centre = 400.0, np.array([200.0, 150.0, 0.0])
    cost = Cost(Evidence(rings.thinned(50), 16.0, Growth()), size, centre, 0.0, Known(), FiberSight.nothing())

    def prior(beside: float, depths: Array, direction: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> Array:
        origin = centre + size * np.stack([np.full(len(depths), beside), np.zeros(len(depths)), depths], axis=1)
        return cost.prior(origin, np.tile(direction, (len(depths), 1)))

    depths = np.geomspace(0.03, 3.0, 100)
    under = prior(0.1, depths)
    assert 0.15 < depths[under.argmin()] < 0.35
    assert np.all(under[(depths < 0.08) | (depths > 1.0)] > under.min() + 1.5)
    # Beside the face a pith may lie as deep as it likes, and so may one that runs through it.
    assert np.ptp(prior(2.0, depths[depths < 0.5])) < 0.2
    assert np.ptp(prior(0.3, depths, (0.0, 0.0, 1.0))) < 1e-6


def test_tracing_is_never_taken_for_more_exact_than_its_convention() -> None:
    exact, usual = Growth().scaled(0.03, 0.03), Growth().scaled(0.5, 2.0)
    assert (exact.tracing, exact.piece) == (TRACED_WITHIN, TRACED_WITHIN)
    assert (usual.strength, usual.tracing, usual.piece) == (0.1, 0.2, 0.1)


def test_the_mirrored_pith_line_explains_the_face_as_well() -> None:
    point, along = line(*CUTS["flat_sawn"][:2])
    _, rings = drawn_rings(point, along, even(20.0))
    behind, before = fit_pith(rings, 480.0), fit_pith(rings, 480.0, pith_behind=False)
    assert behind.point[2] > 0 > before.point[2]
    npt.assert_allclose(
        radii(rings.points, behind.point, behind.direction),
        radii(rings.points, before.point, before.direction),
        atol=1e-6,
    )


def test_rings_too_short_to_place_the_pith_are_an_error() -> None:
    stub = np.stack([np.arange(5.0), np.zeros(5)], axis=1)
    with pytest.raises(ValueError, match="at least 8 vertices"):
        sample_rings([stub], [np.ones(5)], np.array([1]), np.array([0]))


# --- samples and frames -------------------------------------------------------------------------------------
def test_samples_lie_on_their_boundary_with_its_tangent_and_pieces_are_merged() -> None:
    turn = np.linspace(0.0, 2.0, 120)
    arcs = [100.0 * np.stack([np.cos(turn + o), np.sin(turn + o)], axis=1) for o in (0.0, 3.0)]
    rings = sample_rings(arcs, [np.ones(120)] * 2, np.array([4, 4]), np.array([0, 0]), per_ring=10)
    assert rings.index.tolist() == [4]
    assert set(rings.ring) == {0}
    assert len(rings.points) == 20
    npt.assert_allclose(np.linalg.norm(rings.points, axis=1), 100.0)
    npt.assert_allclose(np.linalg.norm(rings.tangents, axis=1), 1.0)
    npt.assert_allclose((rings.points * rings.tangents).sum(axis=1), 0.0, atol=1.0)


@pytest.mark.parametrize("cut", CUTS)
def test_the_tree_frame_is_rigid_and_has_the_pith_as_its_axis(cut: str) -> None:
    point, along = line(*CUTS[cut][:2])
    pith = Pith(point, along, 0.0, np.ones(4))
    points = np.random.default_rng(0).uniform(0, 400, (50, 3))
    matrix = board_to_tree(pith, CENTER)
    rotation = matrix[:3, :3]
    npt.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    npt.assert_allclose(matrix[3], [0, 0, 0, 1])
    tree = points @ rotation.T + matrix[:3, 3]
    npt.assert_allclose(np.hypot(tree[:, 0], tree[:, 1]), radii(points, point, along), atol=1e-9)
    npt.assert_allclose(tree[1:, 2] - tree[0, 2], (points[1:] - points[0]) @ along, atol=1e-9)
    x, y, z = (matrix @ [*CENTER, 1.0])[:3]
    npt.assert_allclose([y, z], 0.0, atol=1e-9)
    assert x > 0


def test_a_pith_through_the_centre_of_the_face_has_a_frame_too() -> None:
    matrix = board_to_tree(Pith(CENTER, np.array([0.0, 0.0, 1.0]), 0.0, np.ones(4)), CENTER)
    npt.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
    npt.assert_allclose(matrix @ [*CENTER, 1.0], [0, 0, 0, 1], atol=1e-12)


@pytest.mark.parametrize(
    ("cut", "named"),
    [
        ("end_grain", "end grain with the pith in the picture"),
        ("end_grain_off", "end grain beside the pith"),
        ("flat_sawn", "flat-sawn"),
        ("cathedral", "cathedral"),
    ],
)
def test_the_cut_is_named_by_where_the_pith_lies(cut: str, named: str) -> None:
    point, along = line(*CUTS[cut][:2])
    story = describe(Pith(point, along, 0.0, np.full(4, 0.01)), Face(0.0, 0.0, 479.0, 399.0), 14.0)
    assert named in str(story.figures["cut"])
    behind = [w for w in story.warnings if "pith_side" in w]
    assert len(behind) == (0 if cut.startswith("end_grain") else 1)


def test_what_the_face_does_not_tell_is_said() -> None:
    point, along = line(*CUTS["flat_sawn"][:2])
    face = Face(0.0, 0.0, 479.0, 399.0)
    open_pose = Pith(point, along, 0.0, np.array([0.5, 0.01, 400.0, 1.0]))
    story = describe(open_pose, face, 14.0)
    assert any("direction is undetermined" in w for w in story.warnings)
    assert any("place is undetermined" in w for w in story.warnings)
    assert story.figures["undetermined"] == "direction, place"
    assert story.undetermined.tolist() == [True, True, True, False]
    sure = describe(Pith(point, along, 0.0, np.array([0.01, 0.01, 3.0, 3.0])), face, 14.0)
    assert not sure.undetermined.any()


@pytest.mark.parametrize(("spread", "said"), [(0.9, False), (1.1, True)])
def test_a_parameter_is_open_exactly_when_its_spread_exceeds_what_is_allowed(spread: float, said: bool) -> None:
    face = Face(0.0, 0.0, 479.0, 399.0)
    allowed = np.radians(1.6) / np.sqrt(2.0)
    inside, along = line(*CUTS["end_grain"][:2])
    ring = Pith(inside, along, 0.0, spread * np.array([allowed, allowed, 14.0 / np.sqrt(2), 14.0 / np.sqrt(2)]))
    assert undetermined(ring, face, 14.0).tolist() == [said] * 4
    outside, along = line((-300.0, 200.0, 40.0), (0.0, 1.0, 0.0))
    share = 0.05 * (300.0 + 239.5)
    assert undetermined(Pith(outside, along, 0.0, np.array([0.0, 0.0, spread * share, 0.0])), face, 14.0)[2] == said


def test_what_the_user_knows_overrules_the_fit() -> None:
    point, along = line(*CUTS["cathedral"][:2])
    kept, same = Fixed((None, None, None), None, None).overrule(point, along)
    npt.assert_array_equal(kept, point)
    npt.assert_array_equal(same, along)
    moved, turned = Fixed((None, None, 77.0), 90.0, 30.0).overrule(point, along)
    npt.assert_allclose(moved, [*point[:2], 77.0])
    npt.assert_allclose(turned, [np.cos(np.pi / 6), 0.5, 0.0], atol=1e-12)
    _, tilted = Fixed((None, None, None), 10.0, None).overrule(point, along)
    assert np.degrees(np.arccos(tilted[2])) == pytest.approx(10.0)
    assert np.arctan2(tilted[1], tilted[0]) == pytest.approx(np.arctan2(along[1], along[0]))


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.2, -0.3)])
def test_the_frame_across_a_line_is_orthonormal_and_points_inwards(direction: tuple[float, float, float]) -> None:
    along = np.asarray(direction) / np.linalg.norm(direction)
    across, inward = frame_of(along)
    basis = np.stack([along, across, inward])
    npt.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
    assert across[2] == 0.0
    assert inward[2] >= 0.0


# --- radii --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("cut", CUTS)
def test_the_radii_about_the_true_pith_are_those_drawn(cut: str) -> None:
    point, along = line(*CUTS[cut][:2])
    boundaries = even(14.0)
    ages, rings = drawn_rings(point, along, boundaries)
    radius, shift, width, innermost = ring_radii(rings, Pith(point, along, 0.0, np.ones(4)))
    npt.assert_allclose(radius[innermost:], boundaries[ages.min() : ages.max() + 1], atol=0.1)
    # Rings that were not seen may be wider, as young trees grow, so there may be fewer of them; never more.
    assert 0.6 * ages.min() <= innermost <= ages.min()
    assert shift.tolist() == [innermost - 1]
    assert float(width) == pytest.approx(14.0, rel=0.02)


def test_uneven_radii_are_kept_and_missing_ones_lie_between_their_neighbours() -> None:
    point, along = line(*CUTS["end_grain"][:2])
    boundaries = natural(3)
    _, rings = drawn_rings(point, along, boundaries)
    keep = rings.index[rings.ring] != 7
    part = RingPoints(
        rings.points[keep],
        rings.tangents[keep],
        rings.ring[keep] - (rings.ring[keep] > 6),
        rings.weight[keep],
        np.delete(rings.index, 6),
        np.delete(rings.group, 6),
    )
    radius, shift, _, _ = ring_radii(part, Pith(point, along, 0.0, np.ones(4)))
    assert shift.tolist() == [0]
    assert (np.diff(radius) > 0).all()
    expected = boundaries[: len(radius)].copy()
    expected[7] = (expected[6] + expected[8]) / 2
    npt.assert_allclose(radius, expected, atol=0.2)


def test_a_group_without_votes_is_shifted_to_where_its_radii_fit() -> None:
    point, along = line(*CUTS["end_grain_off"][:2])
    ages, rings = drawn_rings(point, along, even(14.0))
    late = rings.index > 20
    split = RingPoints(
        rings.points,
        rings.tangents,
        rings.ring,
        rings.weight,
        np.where(late, rings.index - rings.index[late].min() + 1, rings.index),
        late.astype(np.int64),
    )
    radius, shift, _, innermost = ring_radii(split, Pith(point, along, 0.0, np.ones(4)))
    assert shift.tolist() == [innermost - 1, innermost - 1 + 20]
    npt.assert_allclose(radius[innermost:], even(14.0)[ages.min() : ages.max() + 1], atol=0.1)


def test_radii_increase_even_where_the_rings_contradict_it() -> None:
    point, along = line(*CUTS["end_grain"][:2])
    _, rings = drawn_rings(point, along, even(14.0))
    swapped = rings.index.copy()
    swapped[[4, 5, 6]] = swapped[[6, 4, 5]]
    order = np.argsort(swapped)
    jumbled = RingPoints(
        rings.points, rings.tangents, np.argsort(order)[rings.ring], rings.weight, swapped[order], rings.group
    )
    radius, _, width, _ = ring_radii(jumbled, Pith(point, along, 0.0, np.ones(4)), smallest_share=0.2)
    assert np.diff(radius).min() >= 0.2 * float(width) - 1e-9


def test_groups_of_an_eccentric_tree_are_tied_by_vertices_near_one_another() -> None:
    # Rings are ellipses with one focus at the pith: mean radii of left and right differ by several rings.
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    half = [(turn > np.pi / 2) & (turn < 1.5 * np.pi), (turn < np.pi / 2) | (turn > 1.5 * np.pi)]
    lines, index, group = [], [], []
    for age in range(10, 25):
        for side, part in enumerate(half):
            radius = 10.0 * age / (1.0 + 0.2 * np.cos(turn[part]))
            ring = np.stack([radius * np.cos(turn[part]), radius * np.sin(turn[part])], axis=1)
            lines.append(
                ring[np.argsort(np.unwrap(np.where(turn[part] > np.pi, turn[part] - side * 2 * np.pi, turn[part])))]
            )
            index.append(age - 9 - 3 * side)
            group.append(side)
    rings = sample_rings(lines, [np.ones(len(one)) for one in lines], np.array(index), np.array(group))
    _, shift, _, _ = ring_radii(rings, Pith(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0, np.ones(4)))
    assert shift[1] - shift[0] == 3


# --- blocks and stems ---------------------------------------------------------------------------------------
def box_rings(point: Array, along: Array, seed: int = 0, bend: tuple[float, float] = (0.0, 0.0)) -> RingPoints:
    """Rings of natural widths on the top, the right and the front side of a box; `bend` along the line's two frames."""
    sides = np.array(
        [
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[480.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
            [[0.0, 400.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        ]
    )
    planes = Planes(sides, np.array([0.0, 500.0, 1000.0]))
    boundaries = natural(seed, 200)
    lines, ages, faces = [], [], []
    for face, (width, height) in enumerate(((480, 400), (200, 400), (480, 200))):
        y, x = np.mgrid[:height, :width].astype(float)
        place = planes.lift(x, y + 500.0 * face)
        away = place - point
        up = away @ along
        across, inward = frame_of(along)
        away = away - (up**2)[..., None] * (bend[0] * across + bend[1] * inward)
        radius = np.sqrt((away**2).sum(axis=-1) - (away @ along) ** 2)
        for age, boundary in enumerate(boundaries):
            for contour in find_contours(radius, boundary) if age else ():
                if len(contour) >= 30:
                    lines.append(contour[:, ::-1] + [0.0, 500.0 * face])
                    ages.append(age)
                    faces.append(face)
    # Each face counts from its own first ring.
    first = np.array([min(a for a, f in zip(ages, faces, strict=True) if f == face) for face in range(3)])
    index = np.array(ages) - first[np.array(faces)] + 1
    return sample_rings(lines, [np.ones(len(one)) for one in lines], index, np.array(faces), planes=planes)


@pytest.mark.parametrize("depth", [150.0, -120.0])
def test_three_faces_of_a_block_tell_the_pith_and_its_side(depth: float) -> None:
    point, along = line((200.0, 200.0, depth), (0.05, 1.0, 0.1))
    rings = box_rings(point, along)
    assert rings.solid
    pith = fit_pith(rings, 480.0, centre=np.array([240.0, 200.0, 100.0]))
    assert not pith.mirrors
    assert np.degrees(np.arccos(abs(float(pith.direction @ along)))) < 0.5
    gap = (pith.point - point) - ((pith.point - point) @ along) * along
    assert np.linalg.norm(gap) < 5.0
    _, shift, _, _ = ring_radii(rings, pith)
    # The faces' own counts are tied to one age.
    ages = rings.index + shift[rings.group]
    inner = np.array([radii(rings.points[rings.ring == i], point, along).mean() for i in range(len(ages))])
    npt.assert_allclose(
        inner,
        np.interp(
            ages - ages.min(),
            np.unique(ages - ages.min()),
            np.sort(np.unique(np.array([inner[ages == a].mean() for a in np.unique(ages)]))),
        ),
        atol=2.0,
    )


def test_a_bending_pith_is_found_where_the_faces_show_it_and_a_straight_one_stays_straight() -> None:
    point, along = line((200.0, 200.0, -120.0), (0.0, 1.0, 0.0))
    centre = np.array([240.0, 200.0, 100.0])
    pith = Pith(point, along, 0.0, np.ones(4), False, centre)
    straight, none = with_stem(box_rings(point, along), pith, centre, True, (None, None, None))
    npt.assert_array_equal(none, 0.0)
    npt.assert_array_equal(straight.point, pith.point)
    bend = 3e-4
    _, found = with_stem(box_rings(point, along, bend=(0.0, bend)), pith, centre, True, (None, None, None))
    outward = np.linalg.inv(board_to_tree(pith, centre))[:3, :2]
    _, inward = frame_of(along)
    npt.assert_allclose(outward @ found[:2], bend * inward, atol=0.25 * bend)


def test_a_given_stem_is_taken_as_it_is() -> None:
    point, along = line((200.0, 200.0, -120.0), (0.0, 1.0, 0.0))
    pith = Pith(point, along, 0.0, np.ones(4))
    same, stem = with_stem(box_rings(point, along), pith, CENTER, False, (1e-5, None, -2e-5))
    assert same is pith
    npt.assert_array_equal(stem, [1e-5, 0.0, -2e-5])


def test_a_known_ring_width_decides_the_distance() -> None:
    point, along = line((-300.0, 200.0, 40.0), (0.02, 1.0, 0.0))
    _, rings = drawn_rings(point, along, even(14.0))
    for width in (13.0, 14.0):
        pith = fit_pith(rings, 480.0, fixed=Fixed((None, None, None), None, None, width))
        radius, _, found, _ = ring_radii(rings, pith)
        assert len(radius) > 1
        assert float(found) == pytest.approx(width, rel=0.04)


def test_inputs_are_not_modified() -> None:
    point, along = line(*CUTS["end_grain"][:2])
    _, rings = drawn_rings(point, along, even(25.0))
    before = {name: value.copy() for name, value in vars(rings).items() if value is not None}
    pith = fit_pith(rings, 480.0)
    ring_radii(rings, pith)
    board_to_tree(pith, CENTER)
    for name, value in before.items():
        npt.assert_array_equal(getattr(rings, name), value)
