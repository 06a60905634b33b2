"""Heidelberg files: block kinds, units, dates and comments; round trips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from ring_series_samples import assert_same, full_series, ring_series

from woodfit.dendro import heidelberg
from woodfit.dendro.series import FormatError, RingSeries


def file(kind: str, data: str, **header: object) -> str:
    keys = {"KeyCode": "A", **header}
    return "HEADER:\n" + "".join(f"{key}={value}\n" for key, value in keys.items()) + f"DATA:{kind}\n{data}\n"


def one(text: str) -> RingSeries:
    (series,) = heidelberg.loads(text)
    return series


@pytest.mark.parametrize(
    ("unit", "mm"), [("mm", 1), ("1/10 mm", 0.1), ("1/100 mm", 0.01), ("1/1000mm", 0.001), ("", 0.01)]
)
def test_unit_of_the_header_counts(unit: str, mm: float) -> None:
    np.testing.assert_allclose(one(file("Tree", "12 13 0", Length=3, Unit=unit)).width_mm, [12 * mm, 13 * mm, 0])


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        ("Tree", "12 13 14 0 0 0"),
        ("Tree", "12\n13\n14"),
        ("Single", "12;;\n13;;\n14;;"),
        ("Double", "12 1 13 2 14 2 0 0"),
        ("HalfChrono", "12 1\n13 2\n14 2"),
        ("Chrono", "12 1 1 0 13 2 1 1 14 2 0 2"),
        ("quadro", "12 1 1 0 13 2 1 1 14 2 0 2"),
    ],
)
def test_all_kinds_give_their_widths(kind: str, data: str) -> None:
    series = one(file(kind, data, Length=3, DateEnd=2000))
    np.testing.assert_allclose(series.width_mm, [0.12, 0.13, 0.14])
    assert series.first_year == 1998


def test_pairs_of_earlywood_and_latewood_add_up() -> None:
    series = one(file("Double", "10 2 20 3", Length=2, DataType="EarlyLateWood", SeriesStart="Earlywood"))
    np.testing.assert_allclose(series.width_mm, [0.12, 0.23])
    np.testing.assert_allclose(series.earlywood_mm, [0.10, 0.20])
    np.testing.assert_allclose(series.latewood_mm, [0.02, 0.03])


@pytest.mark.parametrize(("dated", "first"), [("Dated", 10), ("Undated", None), ("RelDated", None)])
def test_only_dated_series_have_years(dated: str, first: int | None) -> None:
    assert one(file("Tree", "1 2", DateBegin=10, DateEnd=11, Dated=dated)).first_year == first


def test_comments_belong_to_their_rings_also_in_pairs() -> None:
    series = one(file("Double", "250;Flags;Comment\n2\n313\n2\n207;;Only, comment\n3", Length=3))
    np.testing.assert_allclose(series.width_mm, [2.5, 3.13, 2.07])
    assert series.remarks == {0: "Flags; Comment", 2: "Only, comment"}


def test_pith_bark_and_missing_rings_are_read() -> None:
    text = file("Tree", "1 2", Length=2, Pith="P", Bark="-", MissingRingsBefore=3, MissingRingsAfter=1)
    series = one(text)
    assert (series.pith, series.bark, series.pith_years, series.unmeasured_outer) == (True, False, 3, 1)


def test_kinds_of_measurement_can_be_chosen() -> None:
    text = file("Tree", "1 2", Length=2) + file("Tree", "5 6", Length=2, KeyCode="D", DataType="Max density")
    assert [entry.name for entry in heidelberg.loads(text)] == ["A", "D"]
    assert [entry.name for entry in heidelberg.loads(text, data_types={"ringwidth"})] == ["A"]
    assert [block.data_type for block in heidelberg.read_blocks(text)] == ["ringwidth", "max density"]


BROKEN = {
    "not this format": ("year,A\n1,2\n", 1, "'HEADER:'"),
    "empty": ("\n\n", None, "'HEADER:'"),
    "no data": ("HEADER:\nKeyCode=A\nLength=2\n", 1, "without data"),
    "line of a header": ("HEADER:\nKeyCode\nDATA:Tree\n1\n", 2, "'Key=Value'"),
    "kind": (file("Table", "1 2", Length=2), 4, "the data kind 'table'"),
    "no name": ("HEADER:\nLength=1\nDATA:Tree\n1\n", 1, "no KeyCode"),
    "no length": (file("Tree", "1 2"), 1, "no Length"),
    "length too long": (file("Tree", "1 2", Length=3), 4, "2 numbers in DATA:tree"),
    "length too short": (file("Tree", "1 2", Length=1), 4, "2 numbers in DATA:tree"),
    "length and dates": (file("Tree", "1 2", Length=2, DateBegin=1, DateEnd=3), 1, "are 3 years"),
    "endless length": (file("Tree", "1 2", Length=10**8), 4, "") ,
    "negative length": (file("Tree", "1 2", Length=-1), 1, "Length=-1"),
    "unit": (file("Tree", "1 2", Length=2, Unit="inch"), 1, "Unit=inch"),
    "no number": (file("Tree", "1 x", Length=2), 5, "'1 x'"),
    "negative number": (file("Tree", "1 -2", Length=2), 5, "'1 -2'"),
    "width": (file("Tree", "99999999", Length=1, Unit="mm"), 1, "a width of"),
    "latewood first": (
        file("Double", "1 2", Length=1, DataType="EarlyLateWood", SeriesStart="Latewood"), 1, "start with earlywood",
    ),
    "year": (file("Tree", "1 2", Length=2, DateEnd="about 1900"), 1, "the year 'about 1900'"),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_broken_file_is_refused_with_line_and_reason(case: str) -> None:
    text, number, reason = BROKEN[case]
    with pytest.raises(FormatError) as caught:
        heidelberg.loads(text, "a.fh")
    message = str(caught.value)
    if case == "endless length":
        assert "at most 100000" in message
        return
    assert message.startswith("a.fh: " if number is None else f"a.fh, line {number}: ")
    assert reason in message


# --- writing ------------------------------------------------------------------------------------------------
def test_everything_but_confidence_and_distance_comes_back() -> None:
    series = full_series()
    again = one(heidelberg.dumps([series]))
    assert_same(again, series)
    assert again.remarks == {3: "crack", 5: "frost damage", 11: "pencil & <ink>"}
    for field in ("name", "pith", "bark", "pith_years", "unmeasured_outer"):
        assert getattr(again, field) == getattr(series, field)


@given(ring_series())
def test_what_is_written_is_read_again(series: RingSeries) -> None:
    assert_same(one(heidelberg.dumps([series])), series)


def test_series_without_a_date_stays_so() -> None:
    assert one(heidelberg.dumps([full_series(first_year=None)])).first_year is None


def test_widths_alone_are_written_in_the_block_form_that_all_programs_read() -> None:
    text = heidelberg.dumps([RingSeries("A", np.arange(1, 13) / 100, 2000)], unit_mm=0.01)
    assert text.splitlines()[-2:] == ["".join(f"{cell:6d}" for cell in range(1, 11)), f"{11:6d}{12:6d}" + f"{0:6d}" * 8]


def test_parts_are_joined_only_to_rings_of_the_same_years() -> None:
    text = heidelberg.dumps([full_series("A")]).replace("KeyCode=A_LW\r\n", "KeyCode=B_LW\r\n")
    first, second = heidelberg.loads(text)
    assert (first.name, first.latewood_mm, second.name) == ("A", None, "B_LW")
    assert first.earlywood_mm is not None


@pytest.mark.parametrize(
    "series",
    [
        [full_series("A"), full_series("A")],
        [full_series("A"), RingSeries("A_EW", np.ones(2))],
        [RingSeries("a\nb", np.ones(2))],
        [RingSeries("A", np.ones(0))],
        [RingSeries("A", np.array([1e5]))],
        [replace(full_series("A"), width_mm=np.full(12, -1.0))],
    ],
)
def test_what_would_not_be_read_again_is_not_written(series: list[RingSeries]) -> None:
    with pytest.raises(FormatError):
        heidelberg.dumps(series)
