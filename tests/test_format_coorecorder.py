"""CooRecorder coordinate files: grammar, widths of hand-made paths, round trips."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from woodfit.dendro import coorecorder
from woodfit.dendro.coorecorder import MeasuredPath
from woodfit.dendro.path_widths import PathPoint
from woodfit.dendro.series import FormatError, RingSeries

HEAD = (
    coorecorder.FIRST_LINE + "C:\\cores\\a.pos 2024-12-13 17:02:10\r\n#Imagefile a b.png\r\n#DPI 1200.0\r\nSCALE 1\r\n"
)


def series_of(*points: str, head: str = HEAD + "#C DATED 2020\r\n") -> RingSeries:
    return coorecorder.loads(head + "\r\n".join(points) + "\r\n").series("a")


# --- widths -------------------------------------------------------------------------------------------------
def test_rings_run_from_pith_to_bark_and_the_outermost_has_the_year_of_the_file() -> None:
    series = series_of("10.0,0.0 ", "9.0,0.0 ", "7.0,0.0 ", "4.0,0.0 ")
    np.testing.assert_allclose(series.width_mm, [3, 2, 1])
    assert (series.first_year, series.last_year) == (2018, 2020)


def test_width_starts_at_the_second_point_of_a_shifted_border() -> None:
    series = series_of("10,0 ", "9,0  9,5 ", "6,9 ")
    np.testing.assert_allclose(series.width_mm, [5, 1])


def test_latewood_lies_on_the_bark_side_of_its_border() -> None:
    series = series_of("10,0 ", "D9.75,0 #W#", "9,0 ", "7,0 ")
    np.testing.assert_allclose(series.width_mm, [2, 1])
    np.testing.assert_allclose(series.latewood_mm, [np.nan, 0.25])
    np.testing.assert_allclose(series.earlywood_mm, [np.nan, 0.75])


@pytest.mark.parametrize(
    ("between", "width", "late"),
    [
        (["D9,0 #%gap", "D7,0 #%gap"], 8.0, math.nan),
        (["D9,0 #%gap"], 1.0, math.nan),
        (["D9.5,0 #W#", "D9,0 #%gap", "D7,0 #%gap"], 8.0, 0.5),
        (["D9,0 #%gap", "D7,0 #%gap", "D2,0 #W#"], 8.0, 6.0),
        (["D9,0 #%gap", "D8,0 #%gap", "D4,0 #%gap", "D1,0 #%gap"], 6.0, math.nan),
    ],
)
def test_what_lies_between_gap_marks_is_no_wood(between: list[str], width: float, late: float) -> None:
    series = series_of("10,0 ", *between, "0,0 ")
    np.testing.assert_allclose(series.width_mm, [width])
    assert series.latewood_mm is None if math.isnan(late) else series.latewood_mm == pytest.approx(late)
    assert series.remarks == {0: "crack"}


def test_absent_rings_stand_between_their_point_and_the_next_ring() -> None:
    series = series_of("10,0 ", "9,0 #ZERO2#frost", "7,0 ")
    np.testing.assert_allclose(series.width_mm, [2, 0, 0, 1])
    assert series.first_year == 2017
    assert series.remarks == {0: "frost"}


def test_labels_become_remarks_of_their_rings() -> None:
    series = series_of("10,0 #first", "D9.5,0 #W##dark", "9,0 ", "7,0 #innermost")
    assert series.remarks == {0: "innermost", 1: "first; dark"}


def test_latewood_points_behind_all_borders_go_to_their_rings() -> None:
    borders = ["10,0 ", "9,0 ", "7,0 ", "4,0 "]
    inside = series_of("10,0 ", "D9.5,0 #W#", "9,0 ", "D8.6,0 #W#", "7,0 ", "D6.5,0 #W#", "4,0 ")
    behind = series_of(*borders, "D6.5,0 #W#", "D9.5,0 #W#", "D8.6,0 #W#")
    np.testing.assert_allclose(behind.latewood_mm, inside.latewood_mm)
    np.testing.assert_allclose(behind.width_mm, inside.width_mm)


def test_latewood_point_on_a_border_goes_to_the_ring_that_lacks_one() -> None:
    series = series_of("10,0 ", "9,0 ", "7,0 ", "4,0 ", "D9.5,0 #W#", "D7,0 #W#", "D6.5,0 #W#")
    np.testing.assert_allclose(series.latewood_mm, [0.5, 2.0, 0.5])


def test_latewood_point_beyond_the_innermost_border_belongs_to_no_ring() -> None:
    series = series_of("10,0 ", "9,0 ", "D8,0 #W#")
    assert series.latewood_mm is None
    np.testing.assert_allclose(series.width_mm, [1])


def test_two_borders_of_latewood_in_a_ring_are_doubt() -> None:
    series = series_of("10,0 ", "D9.5,0 #W#", "D9.2,0 #W#", "9,0 ", "D8,0 #W#", "7,0 ")
    assert series.latewood_mm is not None
    assert np.isnan(series.latewood_mm[1])
    assert "2 earlywood/latewood borders" in series.remarks[1]


@given(st.lists(st.floats(0.01, 5), min_size=2, max_size=30), st.floats(-math.pi, math.pi))
def test_widths_do_not_depend_on_the_direction_of_the_path(widths: list[float], angle: float) -> None:
    """A path drawn with known widths, turned by any angle, gives these widths to the printed 0.0001 mm."""
    along = np.concatenate([[0], np.cumsum(widths)])
    xy = 500 + along[:, None] * [math.cos(angle), math.sin(angle)]
    points = tuple(PathPoint((float(x), float(y))) for x, y in xy)
    series = coorecorder.loads(coorecorder.dumps(MeasuredPath(points, dated=2000))).series("a")
    np.testing.assert_allclose(series.width_mm[::-1], widths, rtol=0, atol=1.5e-4)


# --- header -------------------------------------------------------------------------------------------------
def test_header_is_read() -> None:
    head = HEAD + "#C 1980 LA\r\n#C PithCoordinates=1.5,2.5; DistanceToPith=0.4; YearsToPith=3; \r\n#C Radius=9; \r\n"
    path = coorecorder.loads(head + "10,0 \r\n9,0 \r\n")
    assert (path.image, path.dpi, path.dated) == ("a b.png", 1200.0, None)
    assert (path.written_as, path.written_at) == ("C:\\cores\\a.pos", "2024-12-13 17:02:10")
    assert path.comments == ("1980 LA",)
    assert (path.pith_xy_mm, path.pith_distance_mm, path.pith_years) == ((1.5, 2.5), 0.4, 3)
    assert path.key("radius") == "9"
    series = path.series("a")
    assert (series.pith_distance_mm, series.pith_years, series.first_year) == (0.4, 3, None)


def test_date_without_a_year_is_no_date() -> None:
    assert series_of("10,0 ", "9,0 ", head=HEAD + "#C DATED \r\n").first_year is None


BROKEN = {
    "another program": ("RingNumber DistanceFromPith RingWidth\n1 0 2\n", 1, "#DENDRO"),
    "no points": (HEAD, None, "0 ring borders"),
    "one border": (HEAD + "1,2 \r\nD1,3 #W#\r\n", None, "1 ring borders"),
    "three positions": (HEAD + "1,2 3,4 5,6\r\n2,2 \r\n", 5, "'1,2 3,4 5,6'"),
    "no number": (HEAD + "1,2 \r\n1,nan \r\n", 6, "'1,nan'"),
    "mark unknown": (HEAD + "1,2 \r\nD1,2 #X#\r\n", 6, "'#W#' or '#%gap'"),
    "pixels": (HEAD + "#All coordinates in pixels\r\n1,2 \r\n2,2 \r\n", 5, "millimeters"),
    "scale": (HEAD + "SCALE 2\r\n1,2 \r\n2,2 \r\n", 5, "'SCALE 1'"),
    "absent rings without end": (HEAD + "1,2 #ZERO999999\r\n2,2 \r\n", 5, "999999 absent rings"),
    "year": (HEAD + "#C DATED 20x\r\n1,2 \r\n2,2 \r\n", 5, "the year '20x'"),
    "resolution": (HEAD + "#DPI 0\r\n1,2 \r\n2,2 \r\n", 5, "the resolution '0'"),
    "far away": (HEAD + "1,2 \r\n1,99999999 \r\n", 6, "a point such as"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_file_is_refused_with_line_and_reason(case: str) -> None:
    text, number, reason = BROKEN[case]
    with pytest.raises(FormatError) as caught:
        coorecorder.loads(text, "a.pos")
    assert str(caught.value).startswith("a.pos: " if number is None else f"a.pos, line {number}: ")
    assert reason in str(caught.value)


# --- round trip ---------------------------------------------------------------------------------------------
xy = st.tuples(*[st.integers(-10_000_000, 10_000_000).map(lambda unit: unit / 10_000)] * 2)
label = st.sampled_from(["", "FRST", "reaction wood", "ZERO", "a#b", "%gap", "W#"])
borders = st.builds(PathPoint, xy, st.none() | xy, st.just("border"), label, st.integers(0, 3))
inner = st.builds(PathPoint, xy, st.none(), st.sampled_from(["latewood", "gap"]), label)
paths = st.builds(
    MeasuredPath,
    st.tuples(borders, borders, inner, borders, inner).map(tuple),
    st.sampled_from(["", "a.png", "C:\\x y\\z.jpg"]),
    st.none() | st.floats(1, 1e5),
    st.none() | st.integers(-9999, 9999),
    st.sampled_from([(), ("1980 LA",), ("a=b", "two; three")]),
    st.sampled_from([{}, {"PithCoordinates": "1.0,2.0", "licensedTo": "A. B, a@b.org"}]),
    st.sampled_from(["", "a.pos"]),
    st.sampled_from(["", "2024-12-13 17:02:10"]),
)


@given(paths)
def test_what_is_written_is_read_as_equal(path: MeasuredPath) -> None:
    again = coorecorder.loads(coorecorder.dumps(path))
    if not path.written_as and path.written_at:
        # A time without a path reads as a path; nobody writes it.
        return
    assert again == path


@pytest.mark.parametrize(
    "path",
    [
        MeasuredPath(()),
        MeasuredPath((PathPoint((0, 0)), PathPoint((1, 0), label="ZERO3"))),
        MeasuredPath((PathPoint((0, 0)), PathPoint((1, 0), label="a\nb"))),
        MeasuredPath((PathPoint((0, 0)), PathPoint((math.nan, 0)))),
        MeasuredPath((PathPoint((0, 0)), PathPoint((1, 0))), image="a\nb"),
        MeasuredPath((PathPoint((0, 0)), PathPoint((1, 0))), comments=("DATED 2000",)),
        MeasuredPath((PathPoint((0, 0)), PathPoint((1, 0))), comments=("a=b;",)),
        MeasuredPath((PathPoint((0, 0)), PathPoint((1, 0))), keys={"a b": "c"}),
        MeasuredPath((PathPoint((0, 0)), PathPoint((1, 0))), keys={"a": "b; c"}),
    ],
)
def test_what_would_not_be_read_again_is_not_written(path: MeasuredPath) -> None:
    with pytest.raises(FormatError):
        coorecorder.dumps(path)


@given(st.lists(st.tuples(st.floats(0, 1e5), st.floats(0, 1e5)), min_size=1, max_size=20), st.floats(72, 20_000))
def test_px_and_mm_turn_into_each_other(xy_px: list[tuple[float, float]], dpi: float) -> None:
    points = np.array(xy_px)
    np.testing.assert_allclose(
        coorecorder.px_from_mm(coorecorder.mm_from_px(points, dpi), dpi), points, rtol=1e-12, atol=1e-9
    )
    assert coorecorder.mm_from_px(np.array([[dpi, 0.0]]), dpi)[0, 0] == pytest.approx(25.4)


def test_other_points_have_neither_a_second_position_nor_absent_rings() -> None:
    with pytest.raises(ValueError, match="neither"):
        PathPoint((0, 0), kind="gap", zeros=1)
