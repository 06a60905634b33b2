"""CSV tables and JSON of ring series, and the door to all formats."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ring_series_samples import assert_same, full_series, ring_series

from woodfit.dendro import formats, series_json, series_tables, text
from woodfit.dendro.series import FormatError, RingSeries


# --- wide ---------------------------------------------------------------------------------------------------
def test_wide_table_has_a_column_for_each_series() -> None:
    series = [RingSeries("A", np.array([0.5, 0.0]), 1999), RingSeries("B, b", np.array([0.1234, np.nan, 1]), 2000)]
    table = series_tables.dumps_wide(series)
    assert table == '"Year","A","B, b"\n1999,0.5,NA\n2000,0,0.1234\n2001,NA,NA\n2002,NA,1\n'
    for before, after in zip(series, series_tables.loads_csv(table), strict=True):
        assert_same(after, before)


def test_wide_table_of_undated_series_counts_rings() -> None:
    series = [RingSeries("A", np.array([0.5, 0.25]))]
    assert series_tables.dumps_wide(series).startswith('"Ring","A"\n1,0.5\n')
    assert_same(series_tables.loads_csv(series_tables.dumps_wide(series))[0], series[0])


def test_wide_table_takes_woods_on_request() -> None:
    (again,) = series_tables.loads_csv(series_tables.dumps_wide([full_series()], woods=True))
    assert_same(again, full_series())


def test_wide_table_refuses_dated_beside_undated() -> None:
    with pytest.raises(FormatError, match="long table"):
        series_tables.dumps_wide([full_series("A"), full_series("B", None)])


def test_years_left_out_of_a_wide_table_are_unmeasured() -> None:
    (series,) = series_tables.loads_csv("Year,A\n1990,1\n1993,2\n")
    np.testing.assert_array_equal(series.width_mm, [1, np.nan, np.nan, 2])


@pytest.mark.parametrize("table", ["Year;A\n1990;1,5\n", "Year\tA\r\n1990\t1.5\r\n", '"Year","A"\n1990,"1.5"\n'])
def test_spreadsheets_of_all_countries_are_read(table: str) -> None:
    (series,) = series_tables.loads_csv(table)
    assert_same(series, RingSeries("A", np.array([1.5]), 1990))


# --- long and JSON ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("first", [1897, None])
def test_long_table_keeps_what_belongs_to_rings(first: int | None) -> None:
    series = [full_series("A", first), RingSeries("B", np.array([0.5, np.nan]), first)]
    table = series_tables.dumps_long(series)
    assert table.splitlines()[0] == "series,year,rw_mm,ew_mm,lw_mm,confidence,remark"
    again = series_tables.loads_csv(table)
    for before, after in zip(series, again, strict=True):
        assert_same(after, before)
        assert after.remarks == before.remarks
    assert again[0].confidence is not None
    np.testing.assert_allclose(again[0].confidence, series[0].confidence, atol=1e-4)


@pytest.mark.parametrize("first", [1897, None])
def test_json_keeps_everything_exactly(first: int | None) -> None:
    series = full_series(first_year=first)
    (again,) = series_json.loads(series_json.dumps([series]))
    assert_same(again, series, atol=0)
    np.testing.assert_array_equal(again.confidence, series.confidence)
    for field in ("name", "remarks", "pith", "bark", "pith_years", "unmeasured_outer", "pith_distance_mm"):
        assert getattr(again, field) == getattr(series, field)


@given(ring_series(), st.sampled_from(["csv", "csv_long", "json"]))
def test_what_is_written_is_read_again(series: RingSeries, form: str) -> None:
    _, dumps = formats.FORMATS[form]
    loads = series_json.loads if form == "json" else series_tables.loads_csv
    if form == "csv":
        known = np.flatnonzero(np.isfinite(series.width_mm))
        if len(known) == 0:
            return
        first, end = int(known[0]), int(known[-1]) + 1
        series = RingSeries(series.name, series.width_mm[first:end], int(series.years[first]))
    assert_same(loads(dumps([series]))[0], series)


BROKEN_CSV = {
    "": (1, "'Year' (or 'Ring')"),
    "a,b\n1,2\n": (1, "'Year' (or 'Ring')"),
    "Year,A,A\n1990,1,2\n": (1, "distinct names"),
    "Year,A\n1990,1,2\n": (2, "3 cells; expected 2"),
    "Year,A\n1990,x\n": (2, "the value 'x'"),
    "Year,A\n1990,-1\n": (2, "the value '-1'"),
    "Year,A\n1990,1e9\n": (2, "the value '1e9'"),
    "Year,A\n99999999,1\n": (2, "the year '99999999'"),
    "Year,A\n1990,1\n1990,1\n": (3, "the year 1990 after 1990"),
    "Year,A\n1990,NA\n": (None, "no values"),
    'Year,A\n1990,"1\n': (2, "broken CSV"),
    "series,year\nA,1\n": (1, "series,year,rw_mm"),
    "series,year,rw_mm,ew_mm,lw_mm,confidence,remark\n": (None, "no rings"),
    "series,year,rw_mm,ew_mm,lw_mm,confidence,remark\nA,1990,1\n": (2, "3 cells; expected 7"),
    "series,year,rw_mm,ew_mm,lw_mm,confidence,remark\nA,1990,1,,,2,\n": (2, "between 0 and 1"),
    "series,year,rw_mm,ew_mm,lw_mm,confidence,remark\nA,1990,1,,,,\nA,1992,1,,,,\n": (3, "the year 1992 after 1990"),
    "series,year,rw_mm,ew_mm,lw_mm,confidence,remark\nA,1990,1,,,,\nA,,1,,,,\n": (3, "the year None after 1990"),
}


@pytest.mark.parametrize("table", BROKEN_CSV)
def test_broken_table_is_refused_with_line_and_reason(table: str) -> None:
    number, reason = BROKEN_CSV[table]
    with pytest.raises(FormatError) as caught:
        series_tables.loads_csv(table, "a.csv")
    assert str(caught.value).startswith("a.csv: " if number is None else f"a.csv, line {number}: ")
    assert reason in str(caught.value)


def changed(**changes: object) -> str:
    document = json.loads(series_json.dumps([full_series("A")]))
    document["series"][0].update(changes)
    return json.dumps(document)


@pytest.mark.parametrize(
    ("document", "reason"),
    [
        ("", "broken JSON"),
        ("[" * 100_000, "broken JSON"),
        ("1" * 10_000, "broken JSON"),
        ('{"rings": []}', "another JSON document"),
        ('{"format": "woodpipe ring series", "version": 2}', "another JSON document"),
        ('{"format": "woodpipe ring series", "version": 1, "series": []}', "no list 'series'"),
        ('{"format": "woodpipe ring series", "version": 1, "series": [7]}', "series 0 without a printable name"),
        (changed(name="\ud800"), "printable name"),
        (changed(width_mm=[1, 2]), "unequal lists"),
        (changed(width_mm=None), "missing or unequal lists"),
        (changed(width_mm="1"), "width_mm of series 'A' is"),
        (changed(width_mm=[True] * 12), "width_mm of series 'A' is"),
        (changed(width_mm=[float("nan")] * 12), "width_mm of series 'A' is"),
        (changed(width_mm=[1e308] * 12), "width_mm of series 'A' is"),
        (changed(first_year="1990"), "first_year of series 'A' is"),
        (changed(first_year=1990.5), "first_year of series 'A' is"),
        (changed(first_year=10**30), "first_year of series 'A' is"),
        (changed(pith=1), "pith of series 'A' is 1"),
        (changed(remarks={"12": "x"}), "remarks of series 'A' is"),
        (changed(remarks=["x"]), "remarks of series 'A' is"),
    ],
)
def test_broken_json_is_refused_with_its_reason(document: str, reason: str) -> None:
    with pytest.raises(FormatError) as caught:
        series_json.loads(document, "a.json")
    assert str(caught.value).startswith("a.json")
    assert reason in str(caught.value)


# --- the door -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("form", formats.FORMATS)
def test_every_format_is_written_and_read_by_its_ending(form: str, tmp_path: Path) -> None:
    suffix, dumps = formats.FORMATS[form]
    series = full_series("Kärnä" if form not in ("rwl", "rwl_hundredths") else "F02b_N", unit_mm=0.01)
    for name in (f"core{suffix}", f"CORE{suffix.upper()}"):
        (tmp_path / name).write_text(dumps([series]), encoding="utf-8", newline="")
        (again,) = formats.read(tmp_path / name)
        assert again.name == series.name
        assert_same(again, series, parts=False)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.txt", b"x", "the ending '.txt'"),
        ("a", b"x", "the ending ''"),
        ("a.rwl", b"", "an empty file"),
        ("a.rwl", b" \r\n", "an empty file"),
        ("a.rwl", b"\x89PNG\0\0", "a NUL character"),
        ("a.pos", b"\xff\xfea", "broken UTF-16"),
        ("a.fh", b"HEADER:\0", "a NUL character"),
        ("a.csv", "Year,A\n".encode("utf-16-le"), "without byte order mark"),
        ("a.rwl", b"#" * (text.MAX_BYTES + 1), "at most"),
        ("a.json", None, "No such file"),
    ],
)
def test_unreadable_file_is_refused_with_its_name_and_reason(
    name: str, content: bytes | None, reason: str, tmp_path: Path
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError) as caught:
        formats.read(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)
    assert reason in str(caught.value)


def test_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.rwl").mkdir()
    with pytest.raises(FormatError, match="directory"):
        formats.read(tmp_path / "a.rwl")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1", "cp1252"])
def test_text_is_decoded_from_the_encodings_of_the_field(encoding: str) -> None:
    assert text.decode("Kärnä;1".encode(encoding), "a") == "Kärnä;1"


def test_quotes_of_windows_are_kept() -> None:
    assert text.decode(b"\x93old\x94 \x81", "a") == "\x93old\x94 \x81"
    assert text.decode(b"\x93old\x94", "a") == "“old”"


@given(st.binary(max_size=200))
def test_any_bytes_are_text_or_refused(data: bytes) -> None:
    try:
        assert isinstance(text.decode(data, "a"), str)
    except FormatError as refusal:
        assert str(refusal).startswith("a: ")  # noqa: PT017


FAR_TABLE = "\n".join(",".join(row) for row in (["Year", *"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWX"],
                                               ["-49999", *"1" * 50], ["50000", *"1" * 50]))  # fmt: skip


@pytest.mark.parametrize(
    ("loads", "document"),
    [
        (series_tables.loads_csv, FAR_TABLE),
        (formats.tucson.loads, "\n".join(f"A{n:07d}-999     1\nA{n:07d}9990   999" for n in range(500))),
    ],
)  # fmt: skip
def test_a_few_far_years_do_not_fill_the_memory(loads: object, document: str) -> None:
    assert callable(loads)
    with pytest.raises(FormatError, match="rings"):
        loads(document)
