"""Tucson decadal files: columns, codes, end marks, names; dplPy as the judge of what we write."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ring_series_samples import assert_same, full_series, ring_series

from woodfit.dendro import tucson
from woodfit.dendro.series import FormatError, RingSeries
from woodfit.dendro.short_names import short_names
from woodfit.dendro.tucson_header import TucsonHeader, read_header


def line(name: str, year: int, *cells: int) -> str:
    return f"{name:<8}{year:4d}" + "".join(f"{cell:6d}" for cell in cells)


def one(*rows: str) -> RingSeries:
    (series,) = tucson.loads("\n".join(rows))
    return series


# --- reading ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("stop", "unit_mm"), [(999, 0.01), (-9999, 0.001)])
def test_end_mark_tells_the_unit(stop: int, unit_mm: float) -> None:
    series = one(line("A", 1998, 125, 0), line("A", 2000, 77, stop))
    np.testing.assert_allclose(series.width_mm, [125 * unit_mm, 0, 77 * unit_mm])
    assert (series.first_year, series.last_year) == (1998, 2000)


def test_end_mark_of_a_series_that_ends_with_a_decade_stands_alone() -> None:
    assert one(line("A", 1998, 125, 130), line("A", 2000, 999)).last_year == 1999


def test_width_of_0_999_mm_is_a_width_in_a_file_of_micrometres() -> None:
    series = one(line("A", 1988, 1, 999), line("A", 1990, *range(1, 10), 999), line("A", 2000, -9999))
    np.testing.assert_allclose(series.width_mm[[1, 11]], 0.999)


@pytest.mark.parametrize("padding", [(0, 0, 0), (0,), (-999, -999), (999,)])
def test_padding_after_the_end_mark_is_dropped(padding: tuple[int, ...]) -> None:
    assert len(one(line("A", 1990, 5, 6, 999, *padding))) == 2


def test_negative_codes_blank_cells_and_years_without_line_are_unmeasured_rings() -> None:
    blank = line("A", 1990, 1, 2) + " " * 6 + f"{4:6d}{-999:6d}"
    series = one(blank, line("A", 2010, 7, 999))
    known = {1990: 0.01, 1991: 0.02, 1993: 0.04, 2010: 0.07}
    assert series.first_year == 1990
    assert len(series) == 21
    for year, width in zip(series.years.tolist(), series.width_mm, strict=True):
        assert width == pytest.approx(known[year]) if year in known else np.isnan(width)


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r", "\r\r\n"])
def test_line_endings_comments_and_blank_lines_do_not_matter(ending: str) -> None:
    rows = ["# a comment", line("A", 1998, 5, 6), "", line("A", 2000, 7, 999) + "  # done", "\x1a"]
    (series,) = tucson.loads(ending.join(rows))
    assert_same(series, RingSeries("A", np.array([0.05, 0.06, 0.07]), 1998))


def test_tabs_between_cells_are_read() -> None:
    assert_same(one("CAM 1\t1998\t5\t6", "CAM 1\t2000\t999"), RingSeries("CAM 1", np.array([0.05, 0.06]), 1998))


def test_site_behind_the_last_cell_is_no_value() -> None:
    full = line("A", 1990, *range(1, 11)) + "  TUB7"
    assert len(one(full, line("A", 2000, 999))) == 10


def test_end_mark_as_eleventh_cell_is_taken() -> None:
    assert len(one(line("A", 1990, *range(1, 11), 999))) == 10


def test_blocks_of_one_name_that_do_not_overlap_are_one_series() -> None:
    rows = [line("A", 1995, 5, 999), line("B", 1990, 1, 999), line("A", 1990, 7, 8, -9999)]
    series = tucson.loads("\n".join(rows))
    assert [entry.name for entry in series] == ["A", "B"]
    np.testing.assert_allclose(series[0].width_mm, [0.007, 0.008, np.nan, np.nan, np.nan, 0.05])


@pytest.mark.parametrize("first", [-1234, -1230, -1005, -384, -5, 0])
def test_years_before_zero_run_through(first: int) -> None:
    series = RingSeries("ABCDEFG", np.arange(1, 31) / 100, first)
    assert_same(one(*tucson.dumps([series]).splitlines()), series)


def test_name_of_eight_characters_that_ends_with_a_minus_is_told_from_a_sign_by_its_lines() -> None:
    rows = [line("ABCDEFG-", 1234, *range(1, 7)), line("ABCDEFG-", 1240, 7, 999)]
    assert (one(*rows).name, one(*rows).first_year) == ("ABCDEFG-", 1234)
    rows = ["ABCDEFG-1234" + "".join(f"{cell:6d}" for cell in range(1, 5)), "ABCDEFG-1230     7   999"]
    assert (one(*rows).name, one(*rows).first_year) == ("ABCDEFG", -1234)


REFUSED = {
    "values shifted by a column": ([line("A", 1990, 1, 2, 3)[:12] + " 10 30 50   999"], 1, "misaligned"),
    "name too long": ([line("A", 1990, 1, 999), f"{'ABCDEFGHI':<9}{1990:4d}     1   999"], 2, "'ABCDEFGHI199'"),
    "no end mark": ([line("A", 1990, 1, 2)], 1, "without an end mark"),
    "data after the mark in a line": ([line("A", 1990, 1, 999, 2, 999)], 1, "9.99 mm"),
    "too many values for the decade": ([line("A", 1995, 1, 2, 3, 4, 5, 6, 999)], 1, "at most 5"),
    "decade out of step": ([line("A", 1998, 1, 2), line("A", 2005, 3, 999)], 2, "the year 2005"),
    "decade going back": ([line("A", 1998, 1, 2), line("A", 1990, 3, 999)], 2, "the year 1990"),
    "two blocks overlap": (
        [line("A", 1998, 1, 999), line("B", 1990, 1, 999), line("A", 1998, 1, 999)], 3, "though lines 1-1 give it 1998",
    ),
    "data of another series after its mark": (
        [line("A", 1990, 1, 999), line("B", 1990, 1), line("A", 2000, 1, 999)], 3, "data of series 'A' after",
    ),
    "both marks": ([line("A", 1998, 1, -9999), line("A", 2000, 1, 999)], 1, "-9999 within"),
    "name or sign": ([f"ABCDEFG-1235{1:6d}{999:6d}"], 1, "either the name 'ABCDEFG-'"),
    "four header lines": (["x" * 20] * 4 + [line("A", 1990, 1, 999)], 4, "at most three header lines"),
    "no number in a cell": ([line("A", 1990, 1) + "  1.25   999"], 1, "'  1.25' in columns 19-24"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_broken_file_is_refused_with_line_and_reason(case: str) -> None:
    rows, number, reason = REFUSED[case]
    with pytest.raises(FormatError) as caught:
        tucson.loads("\n".join(rows), "core.rwl")
    assert f"core.rwl, line {number}: " in str(caught.value)
    assert reason in str(caught.value)
    assert "expected" in str(caught.value)


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n", "\x1a", "ABCDEFGHI1990     1   999"])
def test_text_without_series_is_refused(text: str) -> None:
    with pytest.raises(FormatError, match="no series"):
        tucson.loads(text)


# --- writing ------------------------------------------------------------------------------------------------
@given(st.sampled_from([(0.001, 1), (0.01, 10)]), st.data())
def test_what_is_written_is_read_again(unit: tuple[float, int], data: st.DataObject) -> None:
    series = data.draw(ring_series(unit_um=unit[1]))
    if unit[1] == 10:
        series = RingSeries(series.name, series.width_mm / 10, series.first_year)
        series = RingSeries(series.name, np.round(series.width_mm, 2), series.first_year)
    (again,) = tucson.loads(tucson.dumps([series], unit_mm=unit[0]))
    expected = np.where(np.isclose(series.width_mm, 999 * unit[0]), 998 * unit[0], series.width_mm)
    np.testing.assert_allclose(again.width_mm, expected, rtol=0, atol=1e-9, equal_nan=True)
    assert again.first_year == series.first_year


@pytest.mark.parametrize(("unit_mm", "width_mm"), [(0.01, 9.99), (0.001, 0.999)])
def test_the_number_of_an_end_mark_is_never_written_for_a_width(unit_mm: float, width_mm: float) -> None:
    (again,) = tucson.loads(tucson.dumps([RingSeries("A", np.array([1.0, width_mm, 2.0]), 2000)], unit_mm))
    np.testing.assert_allclose(again.width_mm, [1.0, 998 * unit_mm, 2.0])


def test_a_very_narrow_ring_does_not_become_an_absent_one() -> None:
    (again,) = tucson.loads(tucson.dumps([RingSeries("A", np.array([0.0, 0.001, 0.004]), 2000)], 0.01))
    np.testing.assert_allclose(again.width_mm, [0.0, 0.01, 0.01])


def test_earlywood_and_latewood_go_into_files_of_their_own_and_come_back() -> None:
    series = full_series()
    files = [tucson.loads(tucson.dumps(part, 0.001)) for part in ([series], *(f([series]) for f in WOODS))]
    (again,) = tucson.join_woods(*files)
    assert_same(again, series)


WOODS = (tucson.earlywood, tucson.latewood)


def test_series_without_a_part_is_left_out_of_its_file() -> None:
    plain = RingSeries("A", np.ones(3), 2000)
    blank = RingSeries("B", np.ones(3), 2000, np.full(3, np.nan))
    assert [entry.name for entry in tucson.earlywood([plain, blank, full_series("C")])] == ["C"]


def test_header_is_written_on_request_and_read() -> None:
    header = TucsonHeader("F02", "Forest", "PISY", "Finland", "Scots pine", "320M", "6700-2707", "E_", "A. Person")
    text = tucson.dumps([full_series()], header=header)
    assert read_header(text) == header
    assert text.splitlines()[1][67:76].split() == ["1897", "1908"]
    assert len(tucson.loads(text)) == 1
    assert read_header(tucson.dumps([full_series()])) is None


def test_header_that_would_read_as_data_is_refused() -> None:
    with pytest.raises(FormatError, match="begin it with a letter"):
        tucson.dumps([full_series()], header=TucsonHeader("F02", "195 stand"))


@pytest.mark.parametrize(
    ("series", "reason"),
    [
        (RingSeries("A", np.array([1000.0]), 2000), "does not fit"),
        (RingSeries("A", np.array([-0.1]), 2000), "does not fit"),
        (RingSeries("A", np.array([np.inf]), 2000), "does not fit"),
        (RingSeries("A", np.ones(3), 9998), "years -9999 to 9998"),
        (RingSeries("A", np.ones(3), -10_000), "years -9999 to 9998"),
        (RingSeries("A", np.ones(0), 2000), "no rings"),
    ],
)
def test_series_that_the_columns_cannot_hold_is_refused(series: RingSeries, reason: str) -> None:
    with pytest.raises(FormatError, match=reason):
        tucson.dumps([series])


def test_equal_names_are_refused() -> None:
    with pytest.raises(FormatError, match="several series are named 'A'"):
        tucson.dumps([RingSeries("A", np.ones(2), 2000)] * 2)


# --- names --------------------------------------------------------------------------------------------------
@given(st.lists(st.text(min_size=1, max_size=14), unique=True, max_size=30), st.integers(7, 8))
def test_short_names_are_distinct_short_and_the_same_each_time(names: list[str], length: int) -> None:
    short = short_names(names, [length] * len(names))
    assert list(short) == names
    assert len(set(short.values())) == len(names)
    assert all(1 <= len(name) <= length and name.isascii() for name in short.values())
    assert short_names(names, [length] * len(names)) == short


@given(st.lists(st.text(min_size=1, max_size=14), unique=True, min_size=1, max_size=12), st.integers(-2000, 1990))
def test_every_name_comes_back_as_the_mapping_says(names: list[str], year: int) -> None:
    series = [RingSeries(name, np.array([0.5, 0.25]), year) for name in names]
    mapping = tucson.written_names(series)
    assert [entry.name for entry in tucson.loads(tucson.dumps(series))] == [mapping[name] for name in names]


def test_long_names_do_not_become_one() -> None:
    short = short_names(["LONGNAME1", "LONGNAME2", "LONGNAME", "Kärnä 1"], [8] * 4)
    assert short == {"LONGNAME1": "LONGNAM2", "LONGNAME2": "LONGNAM3", "LONGNAME": "LONGNAME", "Kärnä 1": "Karna_1"}


# --- dplPy --------------------------------------------------------------------------------------------------
def read_by_dplpy(text: str, folder: Path) -> dict[str, dict[int, float]]:
    dplpy = pytest.importorskip("dplpy", reason="dplPy is not installed", exc_type=ImportError)
    path = folder / "series.rwl"
    path.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = dplpy.readers(str(path))
    return {name: table[name].dropna().to_dict() for name in table.columns}


@pytest.mark.parametrize("unit_mm", [0.01, 0.001])
@pytest.mark.parametrize("first", [None, 1900, 1909, 1990, -5, -384, -1005, 0])
def test_dplpy_reads_what_we_write(first: int | None, unit_mm: float, tmp_path: Path) -> None:
    """Absent rings as 0, unmeasured ones as NaN, the years, and wide rings, exactly."""
    width = np.array([1.0, 2.0, np.nan, np.nan, 3.5, 0.0, 12.34, 0.05, 9.98, 99.99, 0.01, 3.0])
    series = [
        RingSeries(name, width[skip:], first) for name, skip in (("A", 0), ("long name 1", 3), ("long name 2", 4))
    ]
    names = tucson.written_names(series)
    with warnings.catch_warnings():
        # Its dependencies warn while they are imported.
        warnings.simplefilter("ignore")
        found = read_by_dplpy(tucson.dumps(series, unit_mm), tmp_path)
    assert found.keys() == set(names.values())
    for entry in series:
        known = np.isfinite(entry.width_mm)
        assert list(found[names[entry.name]]) == entry.years[known].tolist()
        np.testing.assert_allclose(list(found[names[entry.name]].values()), entry.width_mm[known], rtol=0, atol=1e-9)
