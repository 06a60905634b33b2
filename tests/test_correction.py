"""Boundaries corrected by a person: exact round trips, one boundary more or less, and what follows elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr
from conftest import write_image
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_scenes import SHARED, Array, needs_shared
from stage_scenes import added, source

from pipeline.plan import Selection
from pipeline.progress import Silent
from pipeline.project import Project
from stages import STAGES
from stages.polylines import polylines_of
from stages.ring_tracing import RingTracingParams, ring_tracing
from stages.stage import InputFile
from woodfit.contested import cut_contested
from woodfit.dendro import boundary_table, coorecorder
from woodfit.dendro.boundary_table import Mark
from woodfit.dendro.coorecorder import MeasuredPath, PathPoint
from woodfit.dendro.marked_files import read_marked_paths
from woodfit.dendro.series import FormatError
from woodfit.matching import locate_crossings
from woodfit.ring_order import Order
from woodfit.synthetic_scenes import Scene, scene
from woodfit.tracing import Trace

DPI = 1200.0
SIZES = {"core": (460, 300), "end_grain_pith": (300, 320)}


@cache
def drawn(name: str) -> Scene:
    return scene(name, SIZES[name], 3)


@cache
def before_tracing(name: str) -> xr.Dataset:
    """All that `ring_tracing` reads."""
    return until_tracing(source(drawn(name).face.rgb_encoded))


def until_tracing(ds: xr.Dataset) -> xr.Dataset:
    # A large scan is analysed at a lower resolution than its file has.
    ds = STAGES[0](ds, STAGES[0].params_type())
    for one in STAGES[1 : STAGES.index(ring_tracing)]:
        ds = added(ds, one(ds, one.params_type()))
    return ds


@cache
def traced(name: str, *files: InputFile) -> xr.Dataset:
    return ring_tracing(before_tracing(name), RingTracingParams(corrected=files))


def loops(rings: xr.Dataset) -> list[Array]:
    """Polylines, closed ones with their first point again."""
    return [
        np.concatenate([line, line[:1]]) if closed else line
        for line, closed in zip(polylines_of(rings)[0], rings.ring_closed.values, strict=True)
    ]


def crossings(rings: xr.Dataset, start: Sequence[float], end: Sequence[float]) -> tuple[Array, Array, Array]:
    """Points, indices and polylines in order along a straight path."""
    met = locate_crossings(loops(rings), start, end)
    step = np.subtract(end, start) / np.hypot(*np.subtract(end, start))
    points = np.asarray(start, float) + met.position[:, None] * step
    return points, rings.ring_index.values[met.polyline], met.polyline


def path_in(name: str) -> tuple[Sequence[float], Sequence[float]]:
    """A straight path outwards that no pixel grid knows."""
    log = drawn(name).log
    height, width = SIZES[name]
    if name == "core":
        rows = drawn(name).face.age.shape[0]
        ends = [(3.3, 0.43 * rows), (2 * width - 4.7, 0.52 * rows)]
        return (ends[0], ends[1]) if log.pith[0] < 0 else (ends[1], ends[0])
    return (log.pith[0] + 12.2, log.pith[1] + 3.1), (width - 3.3, 0.5 * height)


def pos(points: Array, dpi: float = DPI, zeros: dict[int, int] | None = None, late: Sequence[Array] = ()) -> InputFile:
    """CooRecorder's file of boundaries given outwards; `zeros` counts the absent rings inside of a boundary."""
    marks = [
        PathPoint(tuple(coorecorder.mm_from_px(point, dpi).tolist()), zeros=(zeros or {}).get(i, 0))
        for i, point in enumerate(points)
    ]
    # CooRecorder may write latewood points after all borders.
    after = [PathPoint(tuple(coorecorder.mm_from_px(point, dpi).tolist()), kind="latewood") for point in late]
    text = coorecorder.dumps(MeasuredPath((*marks[::-1], *after), dpi=dpi))
    return InputFile(name="x.pos", text=text)


def table(points: Array) -> InputFile:
    """Our table of boundaries given outwards."""
    rows = [Mark("a", "boundary", (float(x), float(y)), i) for i, (x, y) in enumerate(points)]
    return InputFile(name="x.csv", text=boundary_table.dumps(rows))


def figures(rings: xr.Dataset) -> tuple[int, int, int]:
    return tuple(rings.attrs["figures"][f"boundaries {word} by hand"] for word in ("confirmed", "added", "removed"))


def places(rings: xr.Dataset) -> list[tuple[int, int]]:
    return list(zip(rings.ring_group.values.tolist(), rings.ring_index.values.tolist(), strict=True))


def assert_apart(rings: xr.Dataset, least_px: float = 1.0) -> None:
    """No two boundaries cross or touch."""
    lines = loops(rings)
    for i, line in enumerate(lines):
        others = np.concatenate([other for j, other in enumerate(lines) if j != i])
        low, high = line.min(axis=0) - 5, line.max(axis=0) + 5
        near = others[((others > low) & (others < high)).all(axis=1)]
        if len(near):
            assert np.hypot(*(line[:, None] - near[None]).transpose(2, 0, 1)).min() >= least_px


each_scene = pytest.mark.parametrize("name", SIZES)
each_format = pytest.mark.parametrize("file_of", [pos, table])


# --- round trips ------------------------------------------------------------------------------------------------------


@each_scene
@each_format
def test_an_unchanged_file_gives_the_same_rings(name: str, file_of: type) -> None:
    rings = traced(name)
    points, _, lines = crossings(rings, *path_in(name))
    again = traced(name, file_of(points))
    assert len(set(lines.tolist())) == len(lines) > 5
    assert figures(again) == (len(points), 0, 0)
    assert places(again) == places(rings)
    assert (again.ring_confidence.values[lines] == 1.0).all()
    for ours, theirs in zip(loops(again), loops(rings), strict=True):
        npt.assert_allclose(ours, theirs, atol=0.01)


@each_scene
def test_a_boundary_deleted_is_gone_and_later_indices_are_one_less(name: str) -> None:
    rings = traced(name)
    points, index, lines = crossings(rings, *path_in(name))
    for which in range(1, len(points) - 1, 3):
        again = traced(name, pos(np.delete(points, which, axis=0)))
        assert figures(again) == (len(points) - 1, 0, 1)
        left = np.delete(np.arange(len(loops(rings))), lines[which])
        shifted = rings.ring_index.values - (rings.ring_index.values > index[which])
        # Pieces of the same ring elsewhere keep their place; all else is the traced boundary, unmoved.
        kept = [(int(rings.ring_group[i]), int(shifted[i]), loops(rings)[i][0].tolist()) for i in left]
        found = [(*place, line[0].tolist()) for place, line in zip(places(again), loops(again), strict=True)]
        assert sorted(found) == sorted(kept)


@each_scene
@given(which=st.floats(0.0, 1.0, exclude_max=True), share=st.floats(0.3, 0.7))
@settings(max_examples=12, deadline=None)
def test_a_boundary_added_is_one_more_at_its_place_and_crosses_no_other(name: str, which: float, share: float) -> None:
    rings = traced(name)
    points, index, lines = crossings(rings, *path_in(name))
    at = int(which * (len(points) - 1))
    new = (1 - share) * points[at] + share * points[at + 1]
    again = traced(name, pos(np.insert(points, at + 1, new, axis=0)))
    assert figures(again) == (len(points), 1, 0)
    assert len(loops(again)) == len(loops(rings)) + 1
    _, indices, polylines = crossings(again, points[0] - 1e-3, points[-1])
    npt.assert_array_equal(np.diff(crossings(again, *path_in(name))[1]), 1)
    # The files round to 0.1 um.
    ours = next(line for line, old in zip(loops(again), is_new(again, rings), strict=True) if old)
    assert distance(new, ours) < 0.01
    assert_apart(again, least_px=min(1.0, 0.25 * float(np.hypot(*(points[at + 1] - points[at])))))
    own = int(polylines[at + 1]) if len(polylines) > at + 1 else -1
    assert float(again.ring_confidence[own]) == 1.0
    assert indices[at + 1] == index[at] + 1
    # It is followed as far as its neighbours go, or until they come too near.
    shorter = min(len(loops(rings)[line]) for line in lines[at : at + 2])
    assert len(ours) > 0.5 * shorter


def is_new(again: xr.Dataset, rings: xr.Dataset) -> list[bool]:
    known = {tuple(line[0].tolist()) for line in loops(rings)}
    return [tuple(line[0].tolist()) not in known for line in loops(again)]


def distance(point: Array, line: Array) -> float:
    """From a point to a polyline."""
    chord = np.diff(line, axis=0)
    share = np.clip(((point - line[:-1]) * chord).sum(axis=1) / (chord**2).sum(axis=1), 0, 1)
    return float(np.hypot(*(line[:-1] + share[:, None] * chord - point).T).min())


@each_scene
def test_boundaries_removed_and_given_back_lie_where_they_were_traced(name: str) -> None:
    from woodfit import correction, rings

    ds = before_tracing(name)
    points, _, lines = crossings(traced(name), *path_in(name))
    step, origin = float(ds.reduction), (float(ds.x[0]), float(ds.y[0]))
    frequency, scale = ds.frequency.values * step, float(ds.ring_scale) / step

    def corrected(found: rings.Rings, marked: Array) -> correction.Corrected:
        paths = [path.scaled(origin, step) for path in read_marked_paths(table(marked).text, "x")]
        return correction.apply_corrections(found, paths, ds.valid.values, frequency)

    found = rings.find_rings(
        *[ds[key].values for key in ("value", "valid", "response", "explained", "normal", "asymmetry")],
        frequency,
        ds.ring_orientation.values,
        scale,
    )
    for which in range(2, len(points) - 2, 4):
        without = corrected(found, np.delete(points, which, axis=0))
        assert (without.removed, without.added) == (1, 0)
        back = corrected(without.rings, points)
        assert (back.removed, back.added) == (0, 1)
        npt.assert_array_equal(back.rings.order.index, found.order.index)
        old, new = found.traces[lines[which]], back.rings.traces[lines[which]]
        assert new.closed == old.closed
        gaps = np.array([distance(point, old.points) for point in new.points])
        assert np.median(gaps) < 0.8
        assert len(new.points) > 0.8 * len(old.points)


# --- what a mark says -------------------------------------------------------------------------------------------------


@each_scene
def test_a_moved_mark_moves_its_boundary_there_and_not_elsewhere(name: str) -> None:
    rings = traced(name)
    points, _, lines = crossings(rings, *path_in(name))
    which = len(points) // 2
    along = (points[which + 1] - points[which]) / np.hypot(*(points[which + 1] - points[which]))
    moved = points.copy()
    moved[which] += 1.5 * along
    again = traced(name, pos(moved))
    assert figures(again) == (len(points), 0, 0)
    assert places(again) == places(rings)
    ours, theirs = loops(again)[lines[which]], loops(rings)[lines[which]]
    assert distance(moved[which], ours) < 0.01
    shift = np.hypot(*(ours - theirs).T)
    assert 1.0 < shift.max() <= 1.51
    assert shift[np.hypot(*(theirs - points[which]).T) > 62].max(initial=0.0) == 0.0
    belief = np.split(again.vertex_confidence.values, np.cumsum(again.vertex_count.values)[:-1])[lines[which]]
    assert belief.max() == 1.0
    assert_apart(again)
    for i in set(range(len(loops(rings)))) - {int(lines[which])}:
        npt.assert_array_equal(loops(again)[i], loops(rings)[i])


def test_absent_rings_are_counted() -> None:
    name = "core"
    rings = traced(name)
    points, index, _ = crossings(rings, *path_in(name))
    # In the file the label stands at the outer boundary and speaks of the rings inside of it.
    again = traced(name, pos(points, zeros={6: 2}))
    npt.assert_array_equal(crossings(again, *path_in(name))[1], index + 2 * (np.arange(len(index)) >= 6))
    where = np.column_stack([again.corrected_absent_x.values, again.corrected_absent_y.values])
    npt.assert_allclose(where, np.stack([points[6], points[6]]), atol=0.01)
    assert len(traced(name).corrected_absent_x) == 0


def test_a_ring_that_was_only_counted_is_not_called_absent() -> None:
    points, index, _ = crossings(traced("core"), *path_in("core"))
    rows = [Mark("a", "boundary", tuple(point)) for point in points]
    places = {"absent": None, "untraced": tuple(0.5 * (points[5] + points[6]))}
    for kind, absent in (("absent", 1), ("untraced", 0)):
        marked = [*rows[:6], Mark("a", kind, places[kind]), *rows[6:]]
        again = traced("core", InputFile(name="x.csv", text=boundary_table.dumps(marked)))
        npt.assert_array_equal(crossings(again, *path_in("core"))[1], index + (np.arange(len(index)) >= 6))
        assert len(again.corrected_absent_x) == absent


def test_across_a_gap_the_tracing_counts() -> None:
    name = "core"
    rings = traced(name)
    points, index, _ = crossings(rings, *path_in(name))
    rows = [Mark("a", "boundary", tuple(point)) for point in points]
    between = [tuple((1 - share) * points[4] + share * points[7]) for share in (0.1, 0.95)]
    hidden = [*rows[:5], *(Mark("a", "gap", xy) for xy in between), *rows[7:]]
    again = traced(name, InputFile(name="x.csv", text=boundary_table.dumps(hidden)))
    assert figures(again) == (len(points) - 2, 0, 0)
    assert places(again) == places(rings)
    # Outside of its ends the person sees the wood: what is not marked there is no boundary.
    seen = [*rows[:5], Mark("a", "gap", tuple(0.5 * (points[5] + points[6]))), *rows[7:]]
    again = traced(name, InputFile(name="x.csv", text=boundary_table.dumps(seen)))
    assert figures(again) == (len(points) - 2, 0, 1)
    npt.assert_array_equal(crossings(again, *path_in(name))[1], np.delete(index, 5) - (np.arange(len(index) - 1) >= 5))


def test_latewood_points_are_kept() -> None:
    points = crossings(traced("core"), *path_in("core"))[0]
    late = 0.3 * points[:-1] + 0.7 * points[1:]
    again = traced("core", pos(points, late=list(late)))
    given_back = np.column_stack([again.corrected_latewood_x.values, again.corrected_latewood_y.values])
    npt.assert_allclose(given_back[np.argsort(given_back[:, 0])], late[np.argsort(late[:, 0])], atol=0.01)
    assert len(traced("core").corrected_latewood_x) == 0


def test_a_path_against_the_growth_is_turned_and_told() -> None:
    points, _, _ = crossings(traced("core"), *path_in("core"))
    again = traced("core", pos(points[::-1]))
    assert places(again) == places(traced("core"))
    assert any("x.pos runs against the growth" in said for said in again.attrs["warnings"])


def test_two_paths_that_disagree_cut_the_boundary_between_them() -> None:
    rings = traced("core")
    (x0, y0), (x1, y1) = path_in("core")
    paths = [crossings(rings, (x0, y0 + shift), (x1, y1 + shift)) for shift in (-30, 30)]
    upper, lower = (points for points, _, _ in paths)
    which = len(upper) // 2
    line = int(paths[0][2][which])
    again = traced("core", pos(upper), pos(np.delete(lower, list(paths[1][2]).index(line), axis=0)))
    warnings = again.attrs["warnings"]
    assert any("denies a boundary that another path marks" in said for said in warnings)
    left = [piece for piece in loops(again) if distance(upper[which], piece) < 0.01]
    assert len(left) == 1
    assert 0.2 * len(loops(rings)[line]) < len(left[0]) < 0.8 * len(loops(rings)[line])
    assert min(distance(lower[list(paths[1][2]).index(line)], piece) for piece in loops(again)) > 2.0


def test_a_file_of_another_scan_is_refused() -> None:
    points = crossings(traced("core"), *path_in("core"))[0]
    with pytest.raises(FormatError, match=r"x.pos: \d+ of \d+ points lie outside of the scan; expected"):
        traced("core", InputFile(name="x.pos", text=pos(points).text.replace("#DPI 1200.0", "#DPI 2400.0")))


def test_marks_where_nothing_was_traced_become_boundaries() -> None:
    from woodfit import correction
    from woodfit.boundary import edge_strength
    from woodfit.growth import Growth
    from woodfit.rings import Rings

    shape = (60, 200)
    growth = Growth(direction=np.zeros(shape, np.float32), bright_outwards=True, sureness=1.0, flux=1.0)
    nothing = np.zeros(0, np.int64)
    # Latewood ends at x = 50, 80, 110.
    value = 1.0 - 0.5 * (np.arange(200) % 30 < 20).astype(np.float32)[None, :].repeat(60, axis=0)
    flat = np.ones(shape, np.float32)
    found = Rings(
        traces=[],
        order=Order(nothing, nothing, np.zeros(0)),
        growth=growth,
        phase=flat,
        confidence=flat,
        grain_ratio=1.0,
        strength=edge_strength(value, flat > 0, flat * np.pi / 2, growth.direction, 30.0),
    )
    marks = np.array([[50.5, 20.0], [80.0, 25.0], [109.0, 30.0]])
    paths = read_marked_paths(table(marks).text, "x")
    result = correction.apply_corrections(found, paths, flat > 0, flat / 30)
    assert (result.confirmed, result.added, result.removed) == (0, 3, 0)
    assert result.rings.order.index.tolist() == [1, 2, 3]
    assert any("Only 0 of 3 boundaries of x" in said for said in result.notes)
    for trace, edge, mark in zip(result.rings.traces, (49.5, 79.5, 109.5), marks, strict=True):
        assert np.ptp(trace.points[:, 1]) > 55
        assert distance(mark, trace.points) < 0.01
        npt.assert_allclose(np.median(trace.points[:, 0]), edge, atol=1.0)


def test_two_paths_that_mark_one_line_at_two_places_do_not_leave_two_lines_on_one_edge() -> None:
    """The second path moves the line that the first one's later mark has onto the first one's earlier mark."""
    (x0, y0), (x1, y1) = path_in("end_grain_pith")
    paths, points = [], []
    for share in ([0.046875, 0.109375], [0.046875, 0.296875]):
        here = [(x0 + t * (x1 - x0), y0 + t * (y1 - y0)) for t in share]
        points += here
        rows = [Mark("a", "boundary", point) for point in here]
        paths.append(InputFile(name=f"{share[1]}.csv", text=boundary_table.dumps(rows)))
    again = ring_tracing(before_tracing("end_grain_pith"), RingTracingParams(corrected=tuple(paths)))
    assert_apart(again)
    for point in points:
        assert min(distance(np.array(point), line) for line in loops(again)) <= 0.06


@each_scene
@given(data=st.data())
@settings(max_examples=15, deadline=None)
def test_whatever_is_marked_lies_on_a_boundary_and_counts_consecutively(name: str, data: st.DataObject) -> None:
    (x0, y0), (x1, y1) = path_in(name)
    height, width = drawn(name).face.age.shape
    paths, marked = [], []
    for number in range(data.draw(st.integers(1, 2))):
        aside = data.draw(st.floats(-20, 20))
        share = np.cumsum(data.draw(st.lists(st.floats(0.04, 0.3), min_size=2, max_size=12)))
        share = share[share < 1.0]
        points = np.column_stack([x0 + share * (x1 - x0), y0 + aside + share * (y1 - y0)])
        points += data.draw(st.floats(-3, 3)) * np.array([0.0, 1.0]) * (np.arange(len(points)) % 2)[:, None]
        points = points[(points > 0).all(axis=1) & (points < [width - 1, height - 1]).all(axis=1)]
        if len(points) < 2:
            continue
        count = len(points)
        skipped = data.draw(st.lists(st.sampled_from(["", "absent", "gap"]), min_size=count, max_size=count))
        rows = []
        for i, (point, kind) in enumerate(zip(points, skipped, strict=True)):
            if i and kind == "absent":
                rows.append(Mark("a", "absent", None))
            if i and kind == "gap":
                rows += [Mark("a", "gap", tuple((1 - t) * points[i - 1] + t * point)) for t in (0.2, 0.8)]
            rows.append(Mark("a", "boundary", tuple(point)))
        paths.append(InputFile(name=f"{number}.csv", text=boundary_table.dumps(rows)))
        marked.append((points, [{"absent": 2, "gap": 0}.get(kind, 1) for kind in skipped[1:]]))
    again = ring_tracing(before_tracing(name), RingTracingParams(corrected=tuple(paths)))
    assert ring_tracing.provides[0].problems(again) == []
    assert_apart(again, least_px=0.3)
    if len(marked) == 1:
        # Two paths may contradict each other.
        points, steps = marked[0]
        gaps = np.array([[distance(point, line) for line in loops(again)] for point in points])
        assert gaps.min(axis=1).max() <= 0.06
        index = again.ring_index.values[gaps.argmin(axis=1)]
        assert all(a == b or b == 0 < a for a, b in zip(np.diff(index).tolist(), steps, strict=True))
        assert len(set(again.ring_group.values[gaps.argmin(axis=1)].tolist())) == 1


def test_a_boundary_that_one_path_has_moved_takes_the_mark_of_another_at_the_same_place() -> None:
    (x0, y0), (x1, y1) = path_in("end_grain_pith")
    shares = np.array([[0.125, 0.375], [0.125, 0.1875]])
    places = np.stack([x0 + shares * (x1 - x0), y0 + shares * (y1 - y0)], axis=-1)
    assert_apart(traced("end_grain_pith", *(table(points) for points in places)), least_px=0.3)


def test_of_two_pieces_of_one_ring_the_one_without_a_mark_is_cut() -> None:
    y = np.arange(100.0)
    rows = [Trace(np.column_stack([np.full(100, x), y]), np.ones(100), False) for x in (20.0, 50.0, 55.0, 80.0)]
    places = [(0, 1), (0, 2), (0, 2), (0, 3)]
    (path,) = read_marked_paths(table(np.array([[20.0, 40.5], [50.0, 40.5], [80.0, 40.5]])).text, "x")
    lines, old, notes = cut_contested(rows, places, [path], np.full((100, 100), 1 / 12))
    assert old == [0, 1, 2, 2, 3]
    assert notes == []
    npt.assert_array_equal(lines[2].points[[0, -1], 1], [0, 28])
    npt.assert_array_equal(lines[3].points[[0, -1], 1], [53, 99])
    # A false ring of its own is not cut but removed as a whole, later.
    assert cut_contested(rows, [(0, 1), (0, 2), (0, 3), (0, 4)], [path], np.full((100, 100), 1 / 12))[1] == [0, 1, 2, 3]


# --- in a run ---------------------------------------------------------------------------------------------------------


def test_a_corrected_file_reruns_its_scan_only_and_a_bad_one_stops_no_other(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "corrections").mkdir()
    for shade, name in enumerate("ab"):
        pixels = drawn("core").face.rgb_encoded.copy()
        # Two scans with the same content would share their results.
        pixels[0, 0] = shade
        write_image(tmp_path / f"scans/{name}.png", pixels)
    config = tmp_path / "c.yaml"
    config.write_text("scans: scans\noutput: out\nstages:\n  ring_tracing: {corrected: 'corrections/{stem}*.pos'}\n")
    chain = STAGES[: STAGES.index(ring_tracing) + 1]
    options = {"scheduler": "threads", "workers": 1}

    def plan() -> dict[tuple[str, str], str]:
        plans = Project.load(config, chain, ()).plan(Selection())
        return {(one.stem, node.stage): node.reason for one in plans for node in one.stages if node.action != "reuse"}

    def run() -> dict[str, tuple[str, str, int | None]]:
        rows = Project.load(config, chain, ()).run(Selection(), Silent(), options)
        return {row.stem: (row.outcome, row.message, row.rings) for _, row in rows}

    first = run()
    assert [first[name][:2] for name in "ab"] == [("done", "")] * 2
    points = crossings(traced("core"), *path_in("core"))[0]
    path = tmp_path / "corrections/b_north.pos"
    path.write_text(pos(np.delete(points, 4, axis=0)).text)
    assert plan() == {("b", "ring_tracing"): "parameter `corrected` of ring_tracing: b_north.pos is new"}
    second = run()
    assert second["a"] == ("reused", "", first["a"][2])
    assert second["b"] == ("done", "", first["b"][2] - 1)
    path.write_text("#DENDRO\n#DPI 1200\nSCALE 1\n1,1\n2,x\n")
    (tmp_path / "corrections/a.pos").write_text(pos(points).text)
    assert plan() == {
        ("a", "ring_tracing"): "parameter `corrected` of ring_tracing: a.pos is new",
        ("b", "ring_tracing"): "parameter `corrected` of ring_tracing: b_north.pos was edited",
    }
    third = run()
    assert third["a"] == ("done", "", first["a"][2])
    assert third["b"][0] == "failed"
    assert third["b"][1].startswith("ring_tracing: FormatError: b_north.pos, line 5: '2,x'; expected")


@pytest.mark.shared
@needs_shared
def test_a_real_core_goes_through_the_correction_loop() -> None:
    from pipeline.reading import read_scan

    scans = sorted((SHARED / "data" / "scans").rglob("mtreering_001.*"))
    ds = until_tracing(read_scan(scans[0], Path("unused")).load())
    rings = ring_tracing(ds, RingTracingParams())
    middle = 0.5 * float(ds.y[-1])
    first, last = float(ds.x[0]) + 1.0, float(ds.x[-1]) - 1.0
    points, index, lines = crossings(rings, (first, middle), (last, middle))
    if index[0] > index[-1]:
        points, index, lines = points[::-1], index[::-1], lines[::-1]
    once = [i for i in range(len(lines)) if (index[:i] < index[i]).all()]
    points, index = points[once], index[once]
    assert len(points) > 20
    again = ring_tracing(ds, RingTracingParams(corrected=(pos(points),)))
    whole = ring_tracing(ds, RingTracingParams(corrected=(table(points),)))
    assert places(whole) == places(again)
    settled = crossings(again, (first, middle), (last, middle))[0]
    for which in (3, len(points) // 2):
        less = ring_tracing(ds, RingTracingParams(corrected=(pos(np.delete(points, which, axis=0)),)))
        assert figures(less)[1:] == (0, figures(again)[2] + 1)
        assert len(crossings(less, (first, middle), (last, middle))[0]) == len(settled) - 1
    assert [b > a for a, b in pairwise(index)] == [True] * (len(index) - 1)
