"""The belief in a boundary: grows with what speaks for it, has no unit, and is right as often as it says."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.testing as npt
import pytest
from kernel_scenes import Array, Image, conifer, noise, round_age, straight, wood
from scipy.ndimage import gaussian_filter, map_coordinates

from woodfit.boundary import edge_strength
from woodfit.curved_gabor import Region, curved_gabor
from woodfit.ring_belief import believe, mean_slope, without_doubtful, without_faint
from woodfit.rings import find_rings
from woodfit.structure_tensor import orientation
from woodfit.tracing import Trace

SHAPE = (120, 160)
RING = 15.0


def edges(contrast: float = 3.0) -> Image:
    """Slopes across horizontal rings: a ridge every ring width among slopes of size one."""
    rows = np.arange(SHAPE[0])[:, None]
    ridge = np.exp(-0.5 * ((np.mod(rows + RING / 2, RING) - RING / 2) / 1.0) ** 2)
    across = np.where(ridge > 0.5, contrast * ridge, np.where(rows % 2, 1.0, -1.0))
    return np.asarray(across * np.ones(SHAPE), np.float32)


def on_row(row: float, wave: float = 0.8) -> Trace:
    x = np.arange(5.0, 155.0)
    return Trace(np.stack([x, np.full(150, row)], axis=1), np.full(150, wave), False)


def believed(
    traces: list[Trace], strength: Image, valid: np.ndarray, frequency: Array, width: float = RING
) -> list[Trace]:
    return believe(traces, strength, mean_slope(strength, valid, width), frequency)


def belief(strength: Image, *traces: Trace, width: float = RING) -> list[Array]:
    found = believed(list(traces), strength, wood(SHAPE), np.full(SHAPE, 1 / width), width)
    for after, before in zip(found, traces, strict=True):
        npt.assert_array_equal(after.points, before.points)
        assert after.closed == before.closed
        assert ((after.confidence > 0.0) & (after.confidence < 1.0)).all()
    return [t.confidence for t in found]


def test_belief_grows_with_the_contrast() -> None:
    found = [float(belief(edges(contrast), on_row(60))[0].mean()) for contrast in (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)]
    assert (np.diff(found) > 0).all()
    assert found[0] < 0.2
    assert found[-1] > 0.9


def test_belief_grows_with_the_confidence_of_the_wave() -> None:
    found = [float(belief(edges(1.5), on_row(60, wave))[0].mean()) for wave in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert (np.diff(found) > 0).all()


def test_a_line_between_the_edges_is_not_believed() -> None:
    on, between = belief(edges(), on_row(60), on_row(52.5))
    assert on.min() > 0.9
    assert between.max() < 0.4


def test_a_line_is_believed_less_where_its_edge_fades() -> None:
    fading = edges()
    fading[58:63, 100:] = 0.0
    (along,) = belief(fading, on_row(60))
    x = on_row(60).points[:, 0]
    assert along[x < 70].min() > along[x > 130].max()


@pytest.mark.parametrize("factor", [1e-3, 0.2, 40.0])
def test_belief_does_not_depend_on_the_grey_scale(factor: float) -> None:
    strength = edges(1.5) + noise(SHAPE, 0.3)
    for scaled, plain in zip(
        belief(factor * strength, on_row(60), on_row(52)), belief(strength, on_row(60), on_row(52)), strict=True
    ):
        npt.assert_allclose(scaled, plain, atol=2e-3)


def test_belief_does_not_depend_on_the_other_lines_or_on_what_is_off_the_wood() -> None:
    strength = edges(1.5) + noise(SHAPE, 0.3)
    (alone,) = belief(strength, on_row(60))
    npt.assert_array_equal(belief(strength, on_row(30), on_row(60), on_row(90))[1], alone)
    valid = wood(SHAPE)
    valid[90:] = False
    dirty = strength.copy()
    dirty[90:] = 50.0
    clean = strength.copy()
    clean[90:] = 0.0
    frequency = np.full(SHAPE, 1 / RING)
    first, second = (believed([on_row(60)], s, valid, frequency)[0].confidence for s in (dirty, clean))
    npt.assert_allclose(first, second, atol=1e-6)


def test_closed_traces_have_no_seam() -> None:
    shape = (160, 160)
    age, outwards = round_age(shape, (80.0, 80.0), RING)
    strength = edge_strength(conifer(age) + noise(shape, 0.05), wood(shape), outwards + np.pi / 2, outwards, RING)
    turn = np.linspace(0, 2 * np.pi, 280, endpoint=False)
    points = 80.0 + 45.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    frequency = np.full(shape, 1 / RING)

    def around(start: int, closed: bool = True) -> Array:
        trace = Trace(np.roll(points, -start, axis=0), np.full(280, 0.5), closed)
        return np.roll(believed([trace], strength, wood(shape), frequency)[0].confidence, start)

    for start in (1, 90, 201):
        npt.assert_allclose(around(start), around(0), atol=1e-9)
    assert np.abs(around(90, closed=False) - around(0, closed=False)).max() > 1e-6


# --- what is left out -----------------------------------------------------------------------------------------------


def of(*confidence: float, closed: bool = False) -> Trace:
    """A trace with these beliefs."""
    return Trace(np.arange(2.0 * len(confidence)).reshape(-1, 2), np.array(confidence), closed)


def test_doubtful_traces_and_ends_are_left_out() -> None:
    sure, doubtful = of(*[0.9] * 10), of(*[0.45] * 10)
    (kept,) = without_doubtful([doubtful, sure, of(*[0.1] * 10)])
    npt.assert_array_equal(kept.confidence, sure.confidence)
    assert len(without_doubtful([doubtful, sure], least=0.3)) == 2
    (cut,) = without_doubtful([of(0.1, 0.2, 0.9, 0.9, 0.05, 0.9, 0.9, 0.2)])
    npt.assert_array_equal(cut.confidence, [0.9, 0.9, 0.05, 0.9, 0.9])
    npt.assert_array_equal(cut.points[0], [4.0, 5.0])
    # A closed one has no ends, and what is left of another must be a line.
    (whole,) = without_doubtful([of(0.1, *[0.9] * 9, closed=True)])
    assert whole.closed
    assert len(whole.points) == 10
    assert without_doubtful([of(0.1, 0.9, 0.9, 0.9, 0.1)]) == []


def test_lines_on_a_faint_wave_are_fibre_unless_they_are_clear() -> None:
    rows = np.arange(SHAPE[0])[:, None]
    faint = (rows > 85) & np.ones(SHAPE, bool)
    response = np.where(faint, 0.02, 0.2).astype(np.complex64)
    strength = np.where(faint, 0.1, 1.0).astype(np.float32) * edges()
    lines = [replace(on_row(row), confidence=np.full(150, 0.8)) for row in (15, 30, 45, 60, 75, 90)]
    assert [t.points[0, 1] for t in without_faint(lines, response, strength)] == [15, 30, 45, 60, 75]
    clear = [*lines[:5], replace(lines[5], confidence=np.full(150, 0.97))]
    assert len(without_faint(clear, response, strength)) == 6
    # A pale boundary on a wave that goes on is a ring, and nothing is compared among three.
    assert len(without_faint(lines, np.full(SHAPE, 0.2, np.complex64), strength)) == 6
    assert len(without_faint(lines[3:], response, strength)) == 3
    for factor in (1e-3, 50.0):
        assert len(without_faint(lines, factor * response, factor * strength)) == 5


# --- whether it is true ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Judged:
    """Beliefs of the vertices of several boards, and whether they lie on a true boundary."""

    belief: Array
    right: np.ndarray


def board(kind: str, spoilt: float, seed: int) -> tuple[Judged, Judged]:
    """A noisy board's own boundaries, and lines drawn half a ring beside them, as wavy and on the same wave."""
    shape = (200, 260)
    age = round_age(shape, (-70.0, 90.0), 15.0)[0] if kind == "round" else straight(shape, 15.0, 0.4)
    rng = np.random.default_rng(seed)
    # Patches where nothing of the rings is left.
    spot = gaussian_filter(rng.normal(0.0, 1.0, shape), 12.0)
    lost = np.clip(3.0 * spot / spot.std() - 2.0, 0.0, 1.0) * min(1.0, 3.0 * spoilt)
    rest = conifer(age) * (1.0 - lost) + 0.65 * lost
    value = (rest + noise(shape, spoilt, seed)).astype(np.float32)
    angle, _ = orientation(value, wood(shape), 1.8, 12.0)
    field = curved_gabor(value, wood(shape), angle, 15.0, Region(50, 36, 12.0), 5.0, 60.0)
    found = find_rings(
        value,
        wood(shape),
        field.response,
        field.explained,
        field.normal,
        field.asymmetry,
        field.frequency,
        field.orientation,
        15.0,
        bright_outwards=True,
    )

    def judge(traces: list[Trace]) -> Judged:
        points = np.concatenate([t.points for t in traces])
        at = map_coordinates(age, points.T[::-1], order=1, mode="nearest")
        return Judged(np.concatenate([t.confidence for t in traces]), np.abs(at - np.round(at)) < 0.2)

    beside = []
    for trace in found.traces:
        cols, rows = np.clip(np.round(trace.points).astype(int), 0, [shape[1] - 1, shape[0] - 1]).T
        away = found.growth.direction[rows, cols]
        points = trace.points + 7.5 * np.stack([np.cos(away), np.sin(away)], axis=1)
        beside.append(replace(trace, points=points, confidence=found.confidence[rows, cols].astype(float)))
    return judge(found.traces), judge(believed(beside, found.strength, wood(shape), field.frequency))


def pooled(parts: list[Judged]) -> Judged:
    return Judged(np.concatenate([p.belief for p in parts]), np.concatenate([p.right for p in parts]))


@cache
def boards() -> tuple[Judged, Judged]:
    """Boundaries found on boards whose noise is up to half as strong again as their rings, and lines beside them."""
    spoilt = (0.15, 0.3, 0.45, 0.6)
    judged = [board(kind, noisy, seed) for kind in ("round", "straight") for noisy in spoilt for seed in (7, 8)]
    return pooled([own for own, _ in judged]), pooled([beside for _, beside in judged])


def test_of_boundaries_believed_with_nine_tenths_nearly_all_are_right() -> None:
    found, _ = boards()
    sure = found.belief >= 0.9
    assert sure.mean() > 0.5
    assert found.right[sure].mean() >= 0.95


def test_what_is_believed_less_is_right_less_often_and_about_as_often_as_said() -> None:
    found, beside = boards()
    everything = pooled([found, beside])
    share = []
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 0.7), (0.7, 0.9), (0.9, 1.0)):
        chosen = (everything.belief >= low) & (everything.belief <= high)
        assert chosen.sum() > 100
        share.append(float(everything.right[chosen].mean()))
    assert share[0] < 0.1
    assert min(share[2:4]) > max(share[:2])
    assert share[4] > max(share[:4])


def test_on_boards_beyond_reading_belief_is_modest() -> None:
    found = pooled([board(kind, 0.7, 7)[0] for kind in ("round", "straight")])
    assert found.right.mean() < 0.95
    assert -0.15 < found.belief.mean() - found.right.mean() < 0.05


def test_lines_beside_the_boundaries_are_seldom_believed() -> None:
    found, beside = boards()
    assert np.median(found.belief) > 0.9
    assert np.percentile(beside.belief[~beside.right], 95) < 0.4
