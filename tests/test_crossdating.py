"""Crossdating: the published figures, calendars, files of all kinds in, and dplPy where it is installed."""

from __future__ import annotations

import importlib.util
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from kernel_scenes import SHARED, needs_shared
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.crossdating import EXTRA, as_json, crossdate, crossdate_files, draw_segments
from pipeline.problems import UsageError
from pipeline.series_files import read_series
from woodfit.dendro import tucson
from woodfit.dendro.agreement import baillie_pilcher, gleichlaeufigkeit, hollstein
from woodfit.dendro.crossdating import Calendar, compare_each, on_one_calendar
from woodfit.dendro.series import FormatError, RingSeries

HAS_DPLPY = importlib.util.find_spec("dplpy") is not None
needs_dplpy = pytest.mark.skipif(not HAS_DPLPY, reason="dplPy is not installed")


def stand(count: int = 5, rings: int = 150, last_year: int | None = 2000, seed: int = 0) -> list[RingSeries]:
    """Cores of one stand with a common climate, the second a little younger."""
    rng = np.random.default_rng(seed)
    climate = rng.normal(0, 0.35, rings)
    series = []
    for number in range(count):
        width = np.exp(climate + 0.15 * rng.normal(0, 1, rings) + np.linspace(0.8, -0.2, rings))[20 * (number == 1) :]
        first = None if last_year is None else last_year - len(width) + 1
        series.append(RingSeries(f"core{number}", np.round(width, 3), first))
    return series


def short_of(series: RingSeries, year: int) -> RingSeries:
    """The series with this year's ring measured as one with the ring before."""
    assert series.first_year is not None
    k = year - series.first_year
    width = np.delete(series.width_mm, k - 1)
    width[k - 1] = series.width_mm[k] + series.width_mm[k - 1]
    return RingSeries(series.name, width, series.first_year + 1)


def write_rwl(path: Path, series: list[RingSeries]) -> Path:
    path.write_text(tucson.dumps(series, unit_mm=0.001))
    return path


def test_gleichlaeufigkeit_counts_by_hand() -> None:
    one, other = np.array([1.0, 2, 3, 2, 2, 5]), np.array([1.0, 3, 2, 1, 4, 5])
    # Signs + + - 0 + and + - - + +: agreeing, opposed, agreeing, half, agreeing.
    assert gleichlaeufigkeit(one, other) == pytest.approx(3.5 / 5)
    assert math.isnan(gleichlaeufigkeit(one[:1], other[:1]))


def test_t_follows_from_r_and_equal_series_agree_fully() -> None:
    one, other = (series.width_mm[-80:] for series in stand(2, seed=4))
    found = baillie_pilcher(one, other)
    assert found.n == 76
    assert found.t == pytest.approx(found.r * math.sqrt(74) / math.sqrt(1 - found.r**2))
    assert hollstein(one, other).n == 79
    same = baillie_pilcher(one, 7.0 * one)
    assert same.r == pytest.approx(1)
    assert same.t > 1e6
    assert math.isnan(baillie_pilcher(np.ones(40), one[:40]).t)
    short = baillie_pilcher(one[:4], other[:4])
    assert short.n == 0
    assert math.isnan(short.r)


def test_absent_rings_are_left_out_of_both_series() -> None:
    one, other = (series.width_mm[-80:].copy() for series in stand(2, seed=5))
    holes = one.copy()
    holes[[10, 40]] = 0.0, np.nan
    kept = np.delete(np.arange(80), [10, 40])
    for function in (baillie_pilcher, hollstein, gleichlaeufigkeit):
        assert function(holes, other) == function(one[kept], other[kept])
    with pytest.raises(ValueError, match="same years"):
        baillie_pilcher(one, other[1:])


def test_calendar_keeps_every_width_in_its_year() -> None:
    series = stand(3)
    calendar = on_one_calendar(series)
    assert calendar.dated
    for row, one in zip(calendar.width_mm, series, strict=True):
        held = np.isfinite(row)
        np.testing.assert_array_equal(row[held], one.width_mm)
        np.testing.assert_array_equal(calendar.years[held], one.years)


def test_undated_series_end_at_the_bark() -> None:
    dated, undated = stand(3), stand(3, last_year=None)
    mixed = on_one_calendar([dated[0], undated[1], dated[2]])
    np.testing.assert_array_equal(mixed.width_mm, on_one_calendar(dated).width_mm)
    assert mixed.assumed == ("core1",)
    counted = on_one_calendar(undated)
    assert not counted.dated
    assert counted.years[-1] == -1
    np.testing.assert_array_equal(counted.width_mm, mixed.width_mm)
    pulled = RingSeries("core1", undated[1].width_mm[:-4], unmeasured_outer=4)
    np.testing.assert_array_equal(on_one_calendar([dated[0], pulled]).width_mm[1, :-4], mixed.width_mm[1, :-4])


def test_names_stay_unique_and_nonsense_is_refused() -> None:
    one = stand(1)[0]
    assert len(set(on_one_calendar([one, one, one]).names)) == 3
    with pytest.raises(ValueError, match="no ring with a width"):
        on_one_calendar([RingSeries("empty", np.full(5, np.nan))])
    with pytest.raises(ValueError, match="mistyped"):
        on_one_calendar([one, RingSeries("far", one.width_mm, 100_000)])
    with pytest.raises(ValueError, match="alone"):
        compare_each(on_one_calendar([one]))


@pytest.mark.parametrize("dated", [True, False])
def test_the_year_of_a_lost_ring_is_named(dated: bool) -> None:
    series = stand()
    series[2] = short_of(series[2], 1940)
    if not dated:
        series = [RingSeries(one.name, one.width_mm) for one in series]
    result = crossdate(series)
    (finding,) = result.comparisons[2].findings
    year = 1940 if dated else 1940 - 2001
    assert finding.kind == "missing"
    assert finding.merged
    assert abs(finding.year - year) <= 2
    assert finding.first_year <= finding.year <= finding.last_year
    assert all(not one.findings for one in result.comparisons if one.name != "core2")


def test_a_partner_without_years_serves_as_well() -> None:
    one, other = stand(2)
    (first, _) = crossdate([short_of(one, 1955), RingSeries("bark", other.width_mm)]).comparisons
    assert [(finding.kind, abs(finding.year - 1955) <= 2) for finding in first.findings] == [("missing", True)]


def test_a_master_takes_the_place_of_the_others() -> None:
    series = stand()
    lost = short_of(series[0], 1930)
    result = crossdate([lost], series[1:], "stand.rwl")
    assert result.against == "stand.rwl"
    assert len(result.comparisons) == 1
    assert abs(result.comparisons[0].findings[0].year - 1930) <= 2
    alone = crossdate([series[0]], [series[1]], "core1")
    same = baillie_pilcher(series[0].width_mm[20:], series[1].width_mm)
    assert alone.comparisons[0].baillie_pilcher == same


def test_command_prints_a_table_and_json(tmp_path: Path) -> None:
    series = stand()
    series[3] = short_of(series[3], 1950)
    path = write_rwl(tmp_path / "stand.rwl", series)
    run = CliRunner().invoke(app, ["crossdate", str(path)])
    assert run.exit_code == 0, run.output
    assert "core4" in run.output
    assert "merged rings 19" in run.output
    run = CliRunner().invoke(app, ["crossdate", str(path), "--json"])
    assert run.exit_code == 0
    found = json.loads(run.stdout)
    assert [one["name"] for one in found["series"]] == [f"core{k}" for k in range(5)]
    assert abs(found["series"][3]["findings"][0]["year"] - 1950) <= 2
    assert found["series"][0]["baillie_pilcher"]["n"] == 146


def test_every_file_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    (tmp_path / "bad.rwl").write_text("nonsense")
    (tmp_path / "folder").mkdir()
    names = ["bad.rwl", "none.rwl", "folder"]
    run = CliRunner().invoke(app, ["crossdate", *(str(tmp_path / name) for name in names)])
    assert run.exit_code == 2
    assert all(name in run.output for name in names)
    path = write_rwl(tmp_path / "one.rwl", stand(1))
    with pytest.raises(UsageError, match="alone"):
        crossdate_files([path])


def test_without_the_extra_our_own_figures_remain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "dplpy", None)
    path = write_rwl(tmp_path / "stand.rwl", stand())
    result = crossdate_files([path])
    assert EXTRA in result.notes
    assert "pip install 'woodpipe[dendro]'" in EXTRA
    assert all(one.baillie_pilcher.t > 10 for one in result.comparisons)
    assert not result.segments
    run = CliRunner().invoke(app, ["crossdate", str(path), "--plot", str(tmp_path / "x.png")])
    assert run.exit_code == 2
    assert "woodpipe[dendro]" in run.output


@needs_dplpy
def test_a_lost_ring_flags_the_older_segments(tmp_path: Path) -> None:
    series = stand()
    series[2] = short_of(series[2], 1950)
    result = crossdate(series)
    older = [one for one in result.segments["core2"] if one.last_year < 1950]
    younger = [one for one in result.segments["core2"] if one.first_year >= 1950]
    assert older
    assert all((one.flag, one.best_lag) == ("B", -1) for one in older)
    assert younger
    assert all(one.flag == "" for one in younger)
    assert all(segment.flag == "" for segment in result.segments["core0"])
    assert result.interseries["core2"] < result.interseries["core0"]
    picture = tmp_path / "segments.png"
    draw_segments(result, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    drawing = tmp_path / "segments.svg"
    draw_segments(result, drawing)
    assert drawing.stat().st_size > 5000
    with pytest.raises(UsageError, match=r"\.png"):
        draw_segments(result, tmp_path / "segments.jpg")
    json.dumps(as_json(result), allow_nan=False)


@needs_dplpy
def test_gleichlaeufigkeit_is_that_of_dplpy() -> None:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import dplpy
        import pandas

        calendar = on_one_calendar(stand(3))
        frame = pandas.DataFrame(
            calendar.width_mm.T, index=pandas.Index(calendar.years, name="Year"), columns=list("abc")
        )
        theirs = dplpy.glk(frame, prob=False)["glk_mat"].to_numpy()
    for i, j in ((0, 1), (0, 2), (1, 2)):
        ours = gleichlaeufigkeit(calendar.width_mm[i], calendar.width_mm[j])
        assert ours == pytest.approx(theirs[i, j], abs=1e-12)


def series_document(pixel_size_mm: float | None) -> dict[str, object]:
    """A scan's series.json with one path of three rings."""
    blank = {"absent": False, "earlywood_px": None, "latewood_px": None, "earlywood_mm": None, "latewood_mm": None}
    rings = [
        {
            **blank,
            "year": 1990 + k,
            "inner": k,
            "outer": k + 1,
            "width_px": width,
            "width_mm": None if pixel_size_mm is None else width * pixel_size_mm,
            "confidence": 0.9,
            "remarks": [],
        }
        for k, width in enumerate((20.0, 30.0, 10.0))
    ]
    path = {"name": "scan", "rings": rings, "pith": None, "unmeasured_outer": 0, "boundaries": []}
    return {"format": "woodpipe series", "version": 1, "pixel_size_mm": pixel_size_mm, "paths": [path]}


@pytest.mark.parametrize("size", [0.05, None])
def test_a_product_folder_is_read_with_or_without_a_scale(tmp_path: Path, size: float | None) -> None:
    (tmp_path / "series.json").write_text(json.dumps(series_document(size)))
    (one,) = read_series(tmp_path)
    np.testing.assert_allclose(one.width_mm, np.array([20.0, 30.0, 10.0]) * (size or 1.0))
    assert one.first_year == 1990


@pytest.mark.parametrize("spoil", ["paths", "version", "pixel_size_mm"])
def test_a_broken_document_is_refused(tmp_path: Path, spoil: str) -> None:
    document = series_document(0.05)
    document[spoil] = "x"
    (tmp_path / "series.json").write_text(json.dumps(document))
    with pytest.raises(FormatError, match=r"series\.json"):
        read_series(tmp_path)


def washington() -> Calendar:
    path = SHARED / "data" / "formats" / "tucson" / "wa082.rwl"
    return on_one_calendar(read_series(path))


@pytest.mark.shared
@needs_shared
def test_published_figures_of_two_cores_of_one_tree() -> None:
    calendar = washington()
    one, other = (calendar.width_mm[calendar.names.index(name)] for name in ("712011", "712012"))
    bp, ho = baillie_pilcher(one, other), hollstein(one, other)
    assert (round(bp.r, 4), round(bp.t, 2), bp.n) == (0.8449, 20.35, 168)
    assert (round(ho.r, 4), round(ho.t, 2), ho.n) == (0.8394, 20.08, 171)
    assert gleichlaeufigkeit(one, other) == pytest.approx(0.859649, abs=1e-6)


@pytest.mark.shared
@needs_shared
def test_dated_collections_are_hardly_accused() -> None:
    found = compare_each(washington())
    assert sum(bool(one.findings) for one in found) <= 2
