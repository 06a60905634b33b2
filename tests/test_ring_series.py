"""The stage `ring_series`, its document, dates, and what people correct, on boundaries known by construction."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from series_scenes import WIDTHS, Array, circles, slanted

from stages.products import write_series
from stages.ring_series import RingSeriesParams, ring_series
from stages.stage import InputFile
from woodfit.dating import Dating, dating_for, year_from_name
from woodfit.dendro import boundary_table, coorecorder
from woodfit.dendro.series import FormatError
from woodfit.path_file import read_paths
from woodfit.series_document import ring_series as series_of
from woodfit.series_marks import NOT_TRACED, boundary_marks, measured_path

SIZE = (100, 420)
SCALE = 0.02


def dataset(
    lines: list[Array],
    growth: Array,
    index: list[int] | None = None,
    step: int = 1,
    scale: float = SCALE,
    width_px: float = 26.0,
) -> xr.Dataset:
    """What the stages before give for such boundaries, and an image with a dark end of each ring."""
    from stages import variables as v

    shape = growth.shape
    counts = np.array([len(line) for line in lines], np.int64)
    points = np.concatenate(lines)
    y, x = (np.arange(n) * step + 0.5 * (step - 1) for n in shape)
    edges = np.array([line[np.abs(line[:, 1] - 0.5 * shape[0] * step).argmin(), 0] for line in lines])
    age = np.interp(x, edges, np.arange(len(edges)), left=-0.5, right=len(edges) - 0.5)
    tone = np.where(age % 1.0 > 0.6, 0.15, 0.6)
    values: dict[Any, Any] = {
        v.RGB: np.broadcast_to(tone[None, :, None], (*shape, 3)).astype(np.float32).copy(),
        v.VALID: np.ones(shape, np.bool_),
        v.REDUCTION: np.int64(step),
        v.PIXEL_SIZE: np.float64(scale),
        v.FREQUENCY: np.full(shape, 1.0 / width_px),
        v.RING_X: points[:, 0],
        v.RING_Y: points[:, 1],
        v.VERTEX_CONFIDENCE: np.ones(len(points)),
        v.VERTEX_COUNT: counts,
        v.RING_INDEX: np.array(index or range(1, len(lines) + 1), np.int64),
        v.RING_GROUP: np.zeros(len(lines), np.int64),
        v.RING_CONFIDENCE: np.full(len(lines), 0.9),
        v.RING_CLOSED: np.zeros(len(lines), np.bool_),
        v.GROWTH_ANGLE: growth,
        v.BRIGHT_OUTWARDS: np.bool_(True),
        v.GROWTH_SURENESS: np.float64(0.97),
        v.GRAIN_RATIO: np.float64(0.5),
        v.CORRECTED_LATEWOOD_X: np.zeros(0),
        v.CORRECTED_LATEWOOD_Y: np.zeros(0),
        v.CORRECTED_ABSENT_X: np.zeros(0),
        v.CORRECTED_ABSENT_Y: np.zeros(0),
        v.FACE_PITH_X: np.float64(np.nan),
        v.FACE_PITH_Y: np.float64(np.nan),
    }
    return xr.Dataset({one.name: one.array(value) for one, value in values.items()}, coords={"y": y, "x": x})


def strip(index: list[int] | None = None, slant_deg: float = 0.0, **more: Any) -> xr.Dataset:
    lines = slanted(WIDTHS, slant_deg)
    kept = [lines[i - 1] for i in index] if index else lines
    return dataset(kept, np.full(SIZE, np.radians(slant_deg)), index, **more)


def document_of(ds: xr.Dataset, tmp_path: Path, scan: str = "core.png", **params: Any) -> dict[str, Any]:
    """``series.json`` of a dataset."""
    result = ring_series(ds, RingSeriesParams(**params))
    context = SimpleNamespace(scan=Path("folder") / scan)
    write_series(ds.assign(result.data_vars), tmp_path / "series.json", context)
    loaded: dict[str, Any] = json.loads((tmp_path / "series.json").read_text())
    return loaded


# --- the stage -------------------------------------------------------------------------------------------------------


def test_a_core_is_measured_through_its_middle_and_its_input_left_alone() -> None:
    ds = strip(slant_deg=20.0)
    before = ds.copy(deep=True)
    result = ring_series(ds, RingSeriesParams())
    xr.testing.assert_identical(ds, before)
    assert set(result.data_vars) == {variable.name for variable in ring_series.provides}
    assert int(result["series_kind"][0]) == 0
    npt.assert_allclose(result["path_y"], 0.5 * (SIZE[0] - 1), atol=1.0)
    npt.assert_allclose(result["series_ring_width"], WIDTHS, rtol=1e-3)
    assert result.attrs["figures"]["rings measured"] == len(WIDTHS)
    assert result.attrs["warnings"] == []


def test_at_reduced_resolution_widths_stay_those_of_the_scan() -> None:
    lines = [2.0 * line for line in slanted(WIDTHS, 0.0)]
    ds = dataset(lines, np.zeros(SIZE), step=2)
    result = ring_series(ds, RingSeriesParams())
    npt.assert_allclose(result["series_ring_width"], 2.0 * WIDTHS, rtol=1e-6)
    npt.assert_allclose(result["path_y"], SIZE[0] - 0.5, atol=2.0)
    npt.assert_allclose(result["latewood_onset"], 0.6, atol=0.06)


def test_a_latewood_onset_that_a_person_marked_counts(tmp_path: Path) -> None:
    from stages import variables as v

    ds = strip()
    found = ring_series(ds, RingSeriesParams())["latewood_onset"].values
    x = float(ds["ring_x"].values[0]) + WIDTHS[0] + 0.25 * WIDTHS[1]
    marked = {v.CORRECTED_LATEWOOD_X: np.array([x, x]), v.CORRECTED_LATEWOOD_Y: np.array([50.0, 3.0])}
    ds = ds.drop_dims("corrected_latewood").assign({one.name: one.array(value) for one, value in marked.items()})
    result = ring_series(ds, RingSeriesParams())
    assert float(result["latewood_onset"][1]) == pytest.approx(0.25, abs=1e-6)
    assert float(result["onset_sureness"][1]) == 1.0
    npt.assert_array_equal(np.delete(result["latewood_onset"].values, 1), np.delete(found, 1))


def test_no_boundaries_are_no_series_and_said_so(tmp_path: Path) -> None:
    ds = strip().isel(ring=slice(0, 0), vertex=slice(0, 0))
    result = ring_series(ds, RingSeriesParams())
    assert result.sizes["series"] == 0
    assert "No ring was measured" in result.attrs["warnings"][0]
    assert document_of(ds, tmp_path)["paths"] == []
    with_path = ring_series(ds, RingSeriesParams(path=[[[1, 50], [400, 50]]]))
    assert with_path.sizes["series_ring"] == 0


def test_given_paths_are_measured_each_by_itself_wherever_they_start() -> None:
    one, other = [[400, 30], [2, 30]], [[2, 90], [150, 95], [400, 90]]
    result = ring_series(strip(), RingSeriesParams(path=(one, other)))
    npt.assert_array_equal(result["path_count"], [2, 3])
    widths = np.split(result["series_ring_width"].values, [len(WIDTHS)])
    for found in widths:
        npt.assert_allclose(found, WIDTHS, rtol=1e-6)
    assert float(result["path_x"][0]) == 2.0
    alone = ring_series(strip(), RingSeriesParams(path=one))
    npt.assert_array_equal(alone["path_count"], [2])


def test_paths_can_come_from_a_file() -> None:
    drawn = json.dumps({"paths": [{"points": [[2, 30], [400, 30]]}]})
    file = InputFile(name="paths.json", text=drawn)
    given_directly = ring_series(strip(), RingSeriesParams(path=[[2, 30], [400, 30]]))
    xr.testing.assert_identical(ring_series(strip(), RingSeriesParams(path_file=file)), given_directly)


POS = """#DENDRO (Cybis Dendro program compatible format) Coordinate file written as a.pos
#Imagefile a.png
#DPI 1270
#All coordinates in millimeters (mm)
SCALE 1
7.0000,1.2000\x20
D5.0,1.2 #W#
4.0000,1.2000  4.0000,1.3000\x20
0.2000,1.3000\x20
"""


def test_a_path_through_corecorders_points_is_read_in_px() -> None:
    (path,) = read_paths(POS, "a.pos")
    npt.assert_allclose(path, np.array([[7.0, 1.2], [4.0, 1.2], [0.2, 1.3]]) * 50.0)


def test_a_path_drawn_on_another_scan_is_refused() -> None:
    with pytest.raises(FormatError, match=r"x 5000 to 6000 .* scan of 420 x 100 px"):
        ring_series(strip(), RingSeriesParams(path=[[5000, 50], [6000, 50]]))


@pytest.mark.parametrize(
    ("params", "told"),
    [
        ({"path": [[1, 2]]}, "1 different points"),
        ({"path": [[1, 2], [1, 2]]}, "1 different points"),
        ({"path": [[1, 2], [math.nan, 2]]}, "not a finite number"),
        ({"path": [[1, 2], ["a", 2]]}, "valid number"),
        ({"radii": ["N", "up"]}, "found 'up'"),
        ({"radii": []}, "at least one radius"),
        ({"year_pattern": "([0-9]"}, "not a regular expression"),
        ({"year_pattern": "[0-9]+"}, "expected one group"),
        ({"path": [[1, 2], [3, 4]], "path_file": InputFile(name="p", text='{"paths": [{"points": [[1,2],[3,4]]}]}')},
         "found both"),
        ({"path_file": InputFile(name="p.json", text="{")}, "p.json: neither .pos nor JSON"),
        ({"path_file": InputFile(name="p.json", text='{"paths": [{"points": [[1, 2, 3]]}]}')}, "path 1"),
        ({"path_file": InputFile(name="p.json", text='{"paths": []}')}, "no list of `paths`"),
    ],
)  # fmt: skip
def test_parameters_that_cannot_be_followed_are_refused_with_reason(params: dict[str, Any], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        RingSeriesParams(**params)


def told(text: str) -> str:
    """Why a path file is refused; empty when its paths are fine."""
    try:
        paths = read_paths(text, "f")
    except FormatError as error:
        return str(error)
    return "" if all(path.ndim == 2 and np.isfinite(path).all() and len(path) > 1 for path in paths) else "not paths"


@given(st.text(max_size=200) | st.binary(max_size=200).map(lambda raw: raw.decode("latin1")))
def test_any_text_as_path_file_is_read_or_refused(text: str) -> None:
    for given_text in (text, '{"paths": ' + text + "}", "#DENDRO\n" + text):
        assert told(given_text)[:1] in ("", "f")


# --- the document ----------------------------------------------------------------------------------------------------


def test_the_document_holds_what_was_measured(tmp_path: Path) -> None:
    document = document_of(strip(slant_deg=20.0), tmp_path)
    assert (document["image"], document["size"], document["pixel_size_mm"]) == ("core.png", [420, 100], SCALE)
    (path,) = document["paths"]
    assert (path["name"], path["kind"], path["first_year"]) == ("core", "core", None)
    assert [boundary["id"] for boundary in path["boundaries"]] == list(range(1, 12))
    for ring, width in zip(path["rings"], WIDTHS, strict=True):
        assert ring["width_mm"] == pytest.approx(SCALE * width, rel=1e-3)
        assert math.dist(ring["from"], ring["to"]) == pytest.approx(ring["width_px"], abs=2e-3)
        if ring["earlywood_mm"] is not None:
            assert ring["earlywood_mm"] + ring["latewood_mm"] == pytest.approx(ring["width_mm"], abs=1e-9)
    assert len(path["lateness_table"]["rings"]) == len(WIDTHS)
    assert path["inner_rest_px"] > 0.0
    (series,) = series_of(document)
    npt.assert_allclose(series.width_mm, SCALE * WIDTHS, rtol=1e-3)
    assert (series.first_year, series.unmeasured_outer) == (None, 0)


def test_without_a_scale_lengths_stay_in_px(tmp_path: Path) -> None:
    document = document_of(strip(scale=math.nan), tmp_path)
    assert document["pixel_size_mm"] is None
    assert {ring["width_mm"] for ring in document["paths"][0]["rings"]} == {None}
    assert document["paths"][0]["rings"][0]["width_px"] == pytest.approx(WIDTHS[0], abs=1e-3)


def test_years_count_inwards_from_the_outermost(tmp_path: Path) -> None:
    def years(**params: Any) -> list[int]:
        return [ring["year"] for ring in document_of(strip(), tmp_path, **params)["paths"][0]["rings"]]

    count = len(WIDTHS)
    assert years(outermost_year=2000) == list(range(2001 - count, 2001))
    assert years(outermost_year=2000, outermost_complete=False) == list(range(2000 - count, 2000))
    assert years(outermost_year=3) == list(range(4 - count, 4))
    with_absent = years(outermost_year=2000, absent_years=[1996, 1998])
    assert with_absent == list(range(2001 - count - 2, 2001))


def test_an_absent_year_is_a_ring_of_width_0_and_moves_the_older_ones(tmp_path: Path) -> None:
    document = document_of(strip(), tmp_path, outermost_year=2000, absent_years=[1997])
    rings = {ring["year"]: ring for ring in document["paths"][0]["rings"]}
    assert (rings[1997]["width_mm"], rings[1997]["absent"], rings[1997]["outer"]) == (0.0, True, None)
    assert rings[1998]["width_px"] == pytest.approx(WIDTHS[-3], abs=1e-3)
    assert rings[1996]["width_px"] == pytest.approx(WIDTHS[-4], abs=1e-3)


def test_a_ring_that_is_known_but_not_traced_keeps_its_year(tmp_path: Path) -> None:
    index = [1, 2, 3, 5, 6, 7, 8, 9, 10, 11]
    path = document_of(strip(index), tmp_path, outermost_year=2000)["paths"][0]
    assert [ring["year"] for ring in path["rings"]] == list(range(1991, 2001))
    unknown = [ring["year"] for ring in path["rings"] if ring["width_px"] is None]
    assert unknown == [1993, 1994]
    assert all(ring["remarks"] == ["boundary not traced"] for ring in path["rings"] if ring["width_px"] is None)


def test_the_year_can_stand_in_the_scans_name(tmp_path: Path) -> None:
    pattern = "_([0-9]{4})$"
    dated = document_of(strip(), tmp_path, scan="pine_1987.png", year_pattern=pattern)
    assert dated["paths"][0]["last_year"] == 1987
    both = document_of(strip(), tmp_path, scan="pine_1987.png", year_pattern=pattern, outermost_year=1990)
    assert both["paths"][0]["last_year"] == 1990
    none = document_of(strip(), tmp_path, scan="pine.png", year_pattern=pattern)
    assert none["paths"][0]["last_year"] is None
    assert "finds no year in 'pine'" in none["remarks"][0]


def test_radii_of_a_disc_are_dated_alike_even_where_one_ends_early(tmp_path: Path) -> None:
    pith = (150.0, 150.0)
    radii = 14.0 * np.arange(1, 9)
    lines = circles(pith, radii)
    lines[-1] = circles(pith, radii[-1:], -0.5, 0.5 * np.pi + 0.5)[0]
    y, x = np.mgrid[:300, :300]
    ds = dataset(lines, np.arctan2(y - pith[1], x - pith[0]), width_px=14.0)
    document = document_of(ds, tmp_path, scan="disc.png", outermost_year=2000)
    last = {path["name"]: (path["last_year"], path["unmeasured_outer"]) for path in document["paths"]}
    assert last == {"disc_N": (1999, 1), "disc_E": (2000, 0), "disc_S": (2000, 0), "disc_W": (1999, 1)}
    assert {path["first_year"] for path in document["paths"]} == {1993}
    assert {path["pith"]["years"] for path in document["paths"]} == {0}


def test_a_ring_much_wider_than_its_neighbours_is_remarked(tmp_path: Path) -> None:
    widths = np.full(9, 20.0)
    widths[4] = 60.0
    ds = dataset(slanted(widths, 0.0), np.zeros(SIZE))
    remarks = [ring["remarks"] for ring in document_of(ds, tmp_path)["paths"][0]["rings"]]
    assert [bool(remark) for remark in remarks] == [False] * 4 + [True] + [False] * 4


@given(
    year=st.integers(-2000, 2100),
    complete=st.booleans(),
    absent=st.sets(st.integers(-2010, 2100), max_size=5),
    rings=st.integers(0, 30),
)
def test_no_ring_gets_an_absent_year_and_none_is_left_out(
    year: int, complete: bool, absent: set[int], rings: int
) -> None:
    dating = Dating(year, complete, tuple(absent))
    years = dating.years_inwards([False] * rings)
    assert len(years) == rings
    assert not set(years) & absent
    if years:
        newest = year - (not complete)
        assert sorted(set(years) | set(dating.absent_between(years[-1], newest))) == list(range(years[-1], newest + 1))


def test_a_ring_known_to_be_absent_takes_its_absent_year() -> None:
    flags = [False, False, True, False]
    assert Dating(2000).years_inwards(flags) == [2000, 1999, 1998, 1997]
    # Said twice, by an index that skips and by the year: still one ring.
    assert Dating(2000, absent_years=(1998,)).years_inwards(flags) == [2000, 1999, 1998, 1997]
    assert Dating(2000, absent_years=(1995,)).years_inwards([*flags, False, False]) == [
        2000, 1999, 1998, 1997, 1996, 1994,
    ]  # fmt: skip


def test_a_name_without_a_year_dates_nothing() -> None:
    assert year_from_name("a_1999", "_([0-9]+)") == 1999
    assert year_from_name("a_x", "_([a-z])") is None
    dating, said = dating_for("a", None, None, True, [1999])
    assert dating.years_inwards([False] * 3) == []
    assert "not dated" in said[0]


# --- marks that people correct ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("slant_deg", [0.0, 30.0])
@pytest.mark.parametrize("scale", [SCALE, math.nan])
def test_a_coorecorder_file_gives_the_measured_widths_back(tmp_path: Path, slant_deg: float, scale: float) -> None:
    document = document_of(strip(slant_deg=slant_deg, scale=scale), tmp_path, outermost_year=2000, absent_years=[1995])
    (path,) = document["paths"]
    text = coorecorder.dumps(measured_path(document, path, "core.png", "core.pos"))
    read = coorecorder.loads(text)
    series = read.series("core")
    mm_per_px = coorecorder.MM_PER_INCH / (read.dpi or 0.0)
    npt.assert_allclose(series.width_mm, [mm_per_px * ring["width_px"] for ring in path["rings"]], atol=3e-4)
    assert (series.first_year, series.last_year) == (path["first_year"], 2000)
    assert series.latewood_mm is not None
    late = [ring["latewood_px"] for ring in path["rings"]]
    known = np.array([value is not None for value in late])
    npt.assert_allclose(series.latewood_mm[known], [mm_per_px * v for v in late if v is not None], atol=5e-4)
    if math.isnan(scale):
        assert read.dpi == 1200.0
        assert any("no scale was known" in comment for comment in read.comments)
    else:
        assert read.dpi == pytest.approx(25.4 / SCALE)
        assert not any("scale" in comment for comment in read.comments)


def test_straight_borders_are_one_point_and_slanted_ones_two(tmp_path: Path) -> None:
    def second_points(slant_deg: float) -> int:
        document = document_of(strip(slant_deg=slant_deg), tmp_path)
        points = measured_path(document, document["paths"][0], "", "").points
        return sum(point.second_xy_mm is not None for point in points)

    assert second_points(0.0) == 0
    assert second_points(30.0) == len(WIDTHS) - 1


def test_what_was_not_traced_is_marked_for_a_person_and_keeps_the_count(tmp_path: Path) -> None:
    document = document_of(strip([1, 2, 3, 5, 6, 7, 8, 9, 10, 11]), tmp_path, outermost_year=2000)
    written = measured_path(document, document["paths"][0], "", "")
    assert [point.label for point in written.points].count(NOT_TRACED) == 1
    assert len(written.series("x")) == len(WIDTHS)
    assert written.series("x").first_year == 1991
    marks = boundary_marks(document)
    kinds = [mark.kind for mark in marks]
    assert (kinds.count("boundary"), kinds.count("untraced")) == (len(WIDTHS), 1)
    (read,) = boundary_table.loads(boundary_table.dumps(marks))
    assert (sum(read.rings), sum(read.absent)) == (len(WIDTHS), 0)


def test_the_table_of_boundaries_can_be_read_back(tmp_path: Path) -> None:
    document = document_of(strip(slant_deg=10.0), tmp_path, outermost_year=2000, absent_years=[1995])
    (path,) = boundary_table.loads(boundary_table.dumps(boundary_marks(document)))
    drawn = [(boundary["x"], boundary["y"]) for boundary in document["paths"][0]["boundaries"]]
    npt.assert_allclose([border[0] for border in path.borders], drawn, atol=1e-3)
    assert sum(path.rings) == len(WIDTHS) + 1


def test_series_leave_out_what_was_not_measured_at_their_ends(tmp_path: Path) -> None:
    pith = (150.0, 150.0)
    lines = circles(pith, 14.0 * np.arange(1, 9))
    lines[0] = circles(pith, np.array([14.0]), -0.4, 0.4)[0]
    y, x = np.mgrid[:300, :300]
    ds = dataset(lines, np.arctan2(y - pith[1], x - pith[0]), width_px=3.0)
    document = document_of(ds, tmp_path, scan="disc.png", radii=["N", "E"], outermost_year=2000)
    unknown = [[ring["width_px"] is None for ring in path["rings"]] for path in document["paths"]]
    assert unknown == [[True, True] + [False] * 6, [False] * 8]
    north, east = series_of(document)
    assert (len(north), north.first_year, north.last_year, north.pith_years) == (6, 1995, 2000, 2)
    assert (len(east), east.first_year, east.last_year, east.pith_years) == (8, 1993, 2000, 0)
    assert north.pith_distance_mm == pytest.approx(28.0 * SCALE, abs=0.3 * SCALE)
    assert east.pith_distance_mm == pytest.approx(0.0)


def test_without_years_the_report_numbers_rings_as_the_boundaries_that_end_them(tmp_path: Path) -> None:
    from pipeline.report.series_reading import drawn_series

    document = document_of(strip([3, 4, 5, 7, 8, 9]), tmp_path)
    (drawn,) = drawn_series(document)
    assert [boundary["id"] for boundary in document["paths"][0]["boundaries"]] == [3, 4, 5, 7, 8, 9]
    assert drawn.labels == (None, 4, 5, 7, 8, 9)
    assert drawn.years.tolist() == [4, 5, 6, 7, 8, 9]
