"""Files in which a person marks boundaries: our table and CooRecorder's points, read as the same kind of path."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from woodfit.dendro import boundary_table, coorecorder
from woodfit.dendro.boundary_table import Mark
from woodfit.dendro.coorecorder import MeasuredPath, PathPoint
from woodfit.dendro.marked_files import read_marked_paths
from woodfit.dendro.series import FormatError
from woodfit.marked_path import MarkedPath

HEAD = "path,ring,x_px,y_px,kind\n"
TABLE = HEAD + (
    "north,1,100,50.5,boundary\n"
    "north,2,120,50,latewood\n"
    "north,2,131.25,50,boundary\n"
    "\n"
    "north,3,,,absent\n"
    "north,4,160,50,boundary\n"
    "north,,170,50,gap\n"
    "south,1,100,90,pith\n"
    "north,,175,50,gap\n"
    "north,5,190,50,boundary\n"
    "south,1,100,100,boundary\n"
    "south,2,100,120,Boundary\n"
)


def assert_same(path: MarkedPath, other: MarkedPath, atol: float = 0.0) -> None:
    for first, second in ((path.borders, other.borders), (path.gaps, other.gaps)):
        assert [len(points) for points in first] == [len(points) for points in second]
        for a, b in zip(first, second, strict=True):
            npt.assert_allclose(a, b, atol=atol)
    assert path.rings == other.rings
    npt.assert_allclose(path.latewood, other.latewood, atol=atol)
    assert (path.pith is None) == (other.pith is None)


def test_a_table_says_boundaries_absent_rings_gaps_and_latewood() -> None:
    north, south = read_marked_paths(TABLE, "x.csv")
    npt.assert_array_equal(np.concatenate(north.borders), [[100, 50.5], [131.25, 50], [160, 50], [190, 50]])
    assert north.rings == (1, 2, 0)
    assert [len(gap) for gap in north.gaps] == [0, 0, 2]
    npt.assert_array_equal(north.latewood, [[120, 50]])
    npt.assert_array_equal(north.stretches()[2], [[[160, 50], [170, 50]], [[175, 50], [190, 50]]])
    assert south.pith is not None
    assert (len(south.borders), south.rings) == (2, (1,))
    assert south.name == "x.csv, path 'south'"


@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_table_that_a_spreadsheet_wrote_with_decimal_commas_says_the_same(separator: str) -> None:
    rows = [line.split(",") for line in TABLE.splitlines()]
    local = "\r\n".join(separator.join(field.replace(".", ",") for field in row) for row in rows)
    for path, other in zip(read_marked_paths(local, "x"), read_marked_paths(TABLE, "x"), strict=True):
        assert_same(path, other)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "x.csv, line 1: ''; expected a CooRecorder file"),
        ("year,a\n1900,1.2\n", "x.csv, line 1: 'year,a'; expected a CooRecorder file"),
        (HEAD, "x.csv: no boundaries; expected a line path,ring,x_px,y_px,kind"),
        (HEAD + "a,1,2,3,boundary\n", "x.csv, line 2: 1 boundaries on a path; expected at least two"),
        (HEAD + "a,1,2,3,border\n", "x.csv, line 2: kind 'border'; expected one of boundary, untraced, absent"),
        (HEAD + "a,1,2,boundary\n", "x.csv, line 2: 4 fields; expected 5"),
        (HEAD + "a,1,2,,boundary\n", "x.csv, line 2: y_px ''; expected a number of px"),
        (HEAD + "a,1,nan,1,boundary\n", "x.csv, line 2: x_px 'nan'; expected a number of px"),
        (HEAD + "a,1,1e9,1,boundary\n", "x.csv, line 2: x_px '1e9'; expected a number of px"),
        (HEAD + "a,1,1,1,absent\n", "x.csv, line 2: an absent ring with coordinates; expected none"),
        (HEAD + 'a,1,"1,1,boundary\n', "x.csv, line 2: "),
        (HEAD + "a,1,1,1,boundary\na,2,1,1,boundary\n", "line 3: the boundary of line 2 again"),
        (HEAD + "a,1,1,1,boundary\na,2,9,1,boundary\na,3,5,1,boundary\n", "line 4: a path that turns back at line 3"),
        (HEAD + "a,1,,,absent\na,2,9,1,boundary\n", "line 3: absent rings or a gap before the first boundary"),
        (HEAD + "a,1,1,1,boundary\na,2,9,1,boundary\na,3,,,absent\n", "line 4: absent rings or a gap after the last"),
        (HEAD + "a,1,1,1,boundary\na,1,0,0,pith\n", "line 3: the pith among the boundaries"),
        ("#DENDRO\n#DPI 1200\nSCALE 1\n1,1\n", "x.csv: 1 ring borders; expected at least two"),
        ("#DENDRO\nSCALE 1\n1,1\n2,1\n", "x.csv: no line '#DPI'; expected the resolution"),
    ],
)
def test_a_malformed_file_is_refused_with_its_name_and_line(text: str, expected: str) -> None:
    with pytest.raises(FormatError) as caught:
        read_marked_paths(text, "x.csv")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


number = st.floats(-9000, 9000).map(lambda value: round(value, 3))


@st.composite
def marks(draw: st.DrawFn) -> list[Mark]:
    """Rows of paths that run to the right."""
    rows = []
    for name in draw(st.lists(st.text(min_size=1, max_size=6).map(lambda t: " ".join(t.split())), unique=True)):
        x = draw(number)
        between = st.lists(st.sampled_from(["latewood", "absent"]), max_size=3) | st.just(["gap", "gap"])
        for ring in range(draw(st.integers(2, 6))):
            kinds = draw(between) if ring else []
            rows += [Mark(name, kind, None if kind == "absent" else (x + 0.5, 1.0), ring) for kind in kinds]
            x = round(x + draw(st.integers(1, 50)), 3)
            rows.append(Mark(name, "boundary", (x, draw(st.sampled_from([0.0, 0.125]))), ring))
    return rows


@given(marks())
def test_a_written_table_is_read_as_it_was(rows: list[Mark]) -> None:
    if not rows:
        return
    paths = boundary_table.loads(boundary_table.dumps(rows))
    names = list(dict.fromkeys(row.path for row in rows))
    assert len(paths) == len(names)
    for path, name in zip(paths, names, strict=True):
        own = [row for row in rows if row.path == name]
        borders = [row.xy for row in own if row.kind == "boundary"]
        npt.assert_allclose(np.concatenate(path.borders), borders, atol=5.1e-4)
        assert len(path.latewood) == sum(row.kind == "latewood" for row in own)
        has_gap = any(row.kind == "gap" for row in own)
        assert has_gap == (0 in path.rings)
        if not has_gap:
            assert sum(path.rings) == len(borders) - 1 + sum(row.kind == "absent" for row in own)


@given(st.text(max_size=300) | st.binary(max_size=300).map(lambda data: data.decode("latin-1")))
def test_any_text_is_a_path_or_a_clear_error(text: str) -> None:
    for whole in (text, HEAD + text, TABLE + text, "#DENDRO\n" + text):
        assert_read_or_refused(whole)


def assert_read_or_refused(text: str) -> None:
    told = ""
    try:
        paths = read_marked_paths(text, "x.csv")
    except FormatError as error:
        paths, told = [], str(error)
    assert told.startswith("x.csv") if told else paths
    assert all(np.isfinite(border).all() for path in paths for border in path.borders)


@given(st.integers(0, len(TABLE) - 1), st.characters(codec="utf-8"), st.booleans())
def test_a_table_with_one_wrong_character_is_a_path_or_a_clear_error(at: int, wrong: str, inserts: bool) -> None:
    text = TABLE[:at] + wrong + TABLE[at + (not inserts) :]
    assert_read_or_refused(text)


def test_a_file_of_coorecorder_runs_from_the_bark_and_is_turned_outwards() -> None:
    dpi = 1200.0
    px = [(300.0, 10.0), (250.0, 12.0), (240.0, 12.0), (200.0, 11.0), (190.0, 11.0), (185.0, 11.0), (150.0, 10.0)]
    mm = [tuple(coorecorder.mm_from_px(np.array(xy), dpi).tolist()) for xy in px]
    points = (
        PathPoint(mm[0], zeros=2),
        PathPoint(mm[1], mm[2]),
        PathPoint(mm[3], kind="latewood"),
        PathPoint(mm[4]),
        PathPoint(mm[5], kind="gap"),
        PathPoint(mm[6]),
    )
    keys = {"PithCoordinates": f"{mm[6][0]},{mm[6][1]}"}
    (path,) = read_marked_paths(coorecorder.dumps(MeasuredPath(points, dpi=dpi)), "x.pos")
    npt.assert_allclose(path.borders[0], [px[6]], atol=0.003)
    npt.assert_allclose(path.borders[2], [px[2], px[1]], atol=0.003)
    npt.assert_allclose(path.borders[3], [px[0]], atol=0.003)
    assert path.rings == (0, 1, 3)
    # A gap without an end reaches to the next border in the direction of the file.
    npt.assert_allclose(path.stretches()[0], [[px[6], px[6]], [px[5], px[4]]], atol=0.003)
    npt.assert_allclose(path.latewood, [px[3]], atol=0.003)
    (pithed,) = read_marked_paths(coorecorder.dumps(MeasuredPath(points, dpi=dpi, keys=keys)), "x.pos")
    assert pithed.pith is not None
    npt.assert_allclose(pithed.borders[0], [px[4]], atol=0.003)
    assert pithed.rings == (1, 3)


def test_a_boundary_that_nobody_saw_is_counted_and_not_made_one() -> None:
    rows = HEAD + "a,1,10,5,boundary\na,2,20,5,untraced\na,3,30,5,boundary\n"
    (path,) = read_marked_paths(rows, "x.csv")
    assert (len(path.borders), path.rings) == (2, (2,))
    (path,) = read_marked_paths(rows.replace("untraced", "boundary"), "x.csv")
    assert (len(path.borders), path.rings) == (3, (1, 1))
    for moved, expected in ((0.0, (2,)), (4.0, (1, 1))):
        marks = ((30.0, ""), (20.0 + moved, "not traced"), (10.0, ""))
        points = tuple(PathPoint((x * 25.4 / 1200.0, 0.1), label=label) for x, label in marks)
        (path,) = read_marked_paths(coorecorder.dumps(MeasuredPath(points, dpi=1200.0)), "x.pos")
        assert path.rings == expected
    # Without the label it is a boundary wherever it lies.
    points = tuple(PathPoint((x * 25.4 / 1200.0, 0.1)) for x in (30.0, 20.0, 10.0))
    (path,) = read_marked_paths(coorecorder.dumps(MeasuredPath(points, dpi=1200.0)), "x.pos")
    assert path.rings == (1, 1)


def test_a_path_turned_twice_and_scaled_back_is_the_same() -> None:
    for path in read_marked_paths(TABLE, "x"):
        assert_same(path.reversed().reversed(), path)
        assert_same(path.scaled((3.0, -2.0), 2.0).scaled((-1.5, 1.0), 0.5), path, atol=1e-9)
        for ours, theirs in zip(path.reversed().stretches(), path.stretches()[::-1], strict=True):
            npt.assert_array_equal(ours[::-1, ::-1], theirs)
