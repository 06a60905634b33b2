"""Plots of measured series: what is drawn lies where it was measured, and the page holds it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from report_data import Page, fake_context, fake_results

from pipeline.crossdating import Crossdating, Segment
from pipeline.report import write_scan_report
from pipeline.report.dendro import boundary_marks, paths_overlay
from pipeline.report.reading import Scan
from pipeline.report.segment_raster import write_segment_raster
from pipeline.report.series_plots import (
    DrawnSeries,
    spaghetti_plot,
    transition_image,
    transition_plot,
    widths_plot,
)
from pipeline.report.series_reading import drawn_series
from stages.stage import Variable
from stages.variables import (
    ABSENT_YEARS,
    BRIGHT_OUTWARDS,
    GROWTH_SURENESS,
    OUTERMOST_COMPLETE,
    OUTERMOST_YEAR,
    REDUCTION,
    SERIES_VARIABLES,
)
from woodfit.dendro.crossdating import compare_each, on_one_calendar
from woodfit.dendro.series import RingSeries


def measured(rings: int = 12, name: str = "core", last_year: int = 2000, angle_rad: float = 0.0) -> DrawnSeries:
    """A straight path along x over rings 10 px wide."""
    x = 5.0 + 10.0 * np.arange(rings + 1)
    width = np.full(rings, 0.5)
    late = np.linspace(0.1, 0.2, rings)
    return DrawnSeries(
        name=name,
        path=np.array([[0.0, 40.0], [10.0 * rings + 10, 40.0]]),
        boundaries=np.column_stack([x, np.full(rings + 1, 40.0)]),
        normal_rad=np.full(rings + 1, angle_rad),
        labels=(None, *range(last_year - rings + 1, last_year + 1)),
        confidence=np.where(np.arange(rings + 1) == 3, 0.2, 0.9),
        years=np.arange(last_year - rings + 1, last_year + 1),
        dated=True,
        width=width,
        earlywood=width - late,
        latewood=late,
        unit="mm",
        table=np.tile(np.linspace(0, 1, 32) ** 2, (rings, 1)),
        onset=np.full(rings, 0.7),
    )


def parsed(svg: str) -> ElementTree.Element:
    """The drawing, if it is well-formed."""
    return ElementTree.fromstring(svg)


def test_every_plot_is_well_formed_and_says_what_it_shows() -> None:
    one, other = measured(), measured(9, "other")
    drawings = [widths_plot(one, "w"), transition_plot(one, "t"), spaghetti_plot([one, other], "s")]
    for drawing, word in zip(drawings, ("0.5", "12 rings", "2 series"), strict=True):
        assert drawing is not None
        root = parsed(drawing)
        assert word in root.attrib["aria-label"]
        assert "year" in "".join(root.itertext())
    assert transition_plot(replace(one, table=None), "t") is None
    assert transition_plot(replace(one, table=np.full((12, 8), np.nan)), "t") is None


def test_absent_unknown_and_undated_rings_can_be_drawn() -> None:
    one = measured()
    width = one.width.copy()
    width[[2, 5]] = 0.0, np.nan
    bare = np.full(12, np.nan)
    holed = replace(one, width=width, earlywood=bare, latewood=bare, onset=bare, dated=False, unit="px")
    text = "".join(parsed(widths_plot(holed, "w")).itertext())
    assert "px" in text
    assert "latewood" not in text
    parsed(spaghetti_plot([holed, replace(holed, width=bare)], "s"))
    single = measured(1)
    parsed(widths_plot(single, "w"))


def test_marks_lie_along_the_boundary_and_across_the_path() -> None:
    for angle in (0.0, 0.4, np.nan):
        marks = boundary_marks(measured(angle_rad=angle), 6.0)
        assert len(marks) == 13
        for k, mark in enumerate(marks):
            x0, y0, x1, y1 = (float(value) for value in re.findall(r"-?[\d.]+", mark["path"]))
            assert ((x0 + x1) / 2, (y0 + y1) / 2) == pytest.approx((5.0 + 10.0 * k, 40.0), abs=0.06)
            assert np.hypot(x1 - x0, y1 - y0) == pytest.approx(12.0, abs=0.15)
            normal = 0.0 if np.isnan(angle) else angle
            assert abs((x1 - x0) * np.cos(normal) + (y1 - y0) * np.sin(normal)) < 0.2
        assert [mark["unsure"] for mark in marks] == [k == 3 for k in range(13)]
        assert "1989" in marks[1]["title"]


def test_years_stand_near_their_boundary_and_inside_the_picture() -> None:
    one = measured()
    overlay = paths_overlay(Scan(fake_results()), [one])
    assert overlay is not None
    frame = overlay["frame"]
    assert overlay["wide"]
    for label in overlay["wide"]:
        left, top = float(label["left"]) / 100 * frame.width + frame.left, float(label["top"]) / 100 * frame.height
        k = one.labels.index(int(label["text"]))
        assert abs(left - one.boundaries[k, 0]) < 1.0
        assert abs(top + frame.top - 40.0) < 60.0
        assert 0 <= float(label["left"]) <= 100
        assert 0 <= float(label["top"]) <= 100


def test_transition_image_keeps_rings_apart_and_unknown_ones_unknown() -> None:
    table = np.zeros((5, 64))
    table[:, 45:] = 1.0
    table[2] = np.nan
    picture = transition_image(table)
    assert picture.shape == (64, 5)
    assert np.isnan(picture[:, 2]).all()
    assert (picture[:40, 0] < 0.02).all()
    assert (picture[50:, 0] > 0.98).all()
    assert (np.diff(picture[:, 0]) >= 0).all()
    np.testing.assert_allclose(transition_image(3.0 * table + 2.0), picture, atol=1e-9)


def test_segment_raster_names_every_series_and_flag(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    climate = rng.normal(0, 0.3, 120)
    series = [RingSeries(f"c{k}", np.exp(climate + rng.normal(0, 0.1, 120)), 1880) for k in range(3)]
    calendar = on_one_calendar(series)
    spans = [(1880, 1929), (1900, 1949), (1925, 1974), (1950, 1999)]
    segments = [Segment(a, b, 0.2 * k, 0.33, "AB"[k] if k < 2 else "", 0, 0.5) for k, (a, b) in enumerate(spans)]
    everyone = {one.name: segments for one in series}
    result = Crossdating(calendar, "the others", compare_each(calendar), dict.fromkeys(everyone, 0.5), everyone, [])
    write_segment_raster(result, tmp_path / "r.svg")
    text = (tmp_path / "r.svg").read_text()
    parsed(text)
    assert text.count("<!-- A -->") >= 3
    assert all(f"<!-- {one.name} -->" in text for one in series)
    write_segment_raster(result, tmp_path / "r.png")
    assert (tmp_path / "r.png").stat().st_size > 5000
    with pytest.raises(ValueError, match="no segment"):
        write_segment_raster(replace(result, segments={}), tmp_path / "none.png")


def document() -> dict[str, object]:
    """One path with three rings, the middle one absent."""
    ring = {"absent": False, "latewood_onset": {"fraction": 0.6, "xy": None, "sureness": 1.0}}
    widths = {"width": 20.0, "earlywood": 12.0, "latewood": 8.0}
    known = {f"{key}_{unit}": value for key, value in widths.items() for unit in ("px", "mm")}
    gone = {f"{key}_{unit}": 0.0 if key == "width" else None for key in widths for unit in ("px", "mm")}
    rings = [
        {**ring, **known, "year": 1998, "outer": 1},
        {**ring, **gone, "year": 1999, "outer": None, "absent": True, "latewood_onset": None},
        {**ring, **known, "year": 2000, "outer": 2},
    ]
    boundaries = [{"x": 20.0 * k, "y": 5.0, "angle_rad": None, "confidence": 1.0} for k in range(3)]
    table = {"fractions": 4, "rings": [[0.0, 0.1, 0.5, 1.0], None]}
    path = {"name": "s", "points": [[0, 5], [40, 5]], "rings": rings, "boundaries": boundaries, "lateness_table": table}
    return {"pixel_size_mm": 0.05, "paths": [path, {**path, "rings": []}]}


def test_absent_rings_have_a_year_but_no_row_of_lateness() -> None:
    (one,) = drawn_series(document())
    assert one.labels == (None, 1998, 2000)
    assert one.years.tolist() == [1998, 1999, 2000]
    assert one.width.tolist() == [20.0, 0.0, 20.0]
    assert one.table is not None
    assert one.table[0].tolist() == [0.0, 0.1, 0.5, 1.0]
    assert np.isnan(one.table[1:]).all()
    assert one.onset[0] == 0.6
    assert np.isnan(one.onset[1])


def series_arrays() -> dict[Variable, np.ndarray]:
    """Results of `ring_series` for one core with three rings across the picture."""
    x = np.array([10.0, 40.0, 60.0, 95.0])
    given = {
        "path_x": np.array([5.0, 100.0]),
        "path_y": np.array([60.0, 60.0]),
        "path_count": np.array([2]),
        "crossing_x": x,
        "crossing_y": np.full(4, 60.0),
        "crossing_index": np.arange(1, 5),
        "crossing_confidence": np.full(4, 0.9),
        "crossing_count": np.array([4]),
        "series_ring_index": np.arange(2, 5),
        "series_ring_inner": np.arange(3),
        "series_ring_outer": np.arange(1, 4),
        "series_ring_width": np.diff(x),
        "earlywood_width": 0.6 * np.diff(x),
        "latewood_width": 0.4 * np.diff(x),
        "latewood_onset": np.full(3, 0.6),
        "onset_sureness": np.ones(3),
        "measure_x": np.column_stack([x[:-1], x[1:]]),
        "measure_y": np.full((3, 2), 60.0),
        "lateness_table": np.tile(np.linspace(0, 1, 64), (3, 1)),
        "series_ring_count": np.array([3]),
        "series_bearing": np.array([np.nan]),
        "pith_distance": np.full((1, 3), np.nan),
    }
    sizes = {"path_vertex": 2, "crossing": 4, "series_ring": 3, "series": 1, "gap": 0}
    blank = {v.name: np.zeros([sizes.get(dim, 2) for dim in v.dims]) for v in SERIES_VARIABLES}
    return {variable: {**blank, **given}[variable.name] for variable in SERIES_VARIABLES}


def test_the_page_shows_measured_series(tmp_path: Path) -> None:
    arrays = {
        **series_arrays(),
        BRIGHT_OUTWARDS: np.True_,
        GROWTH_SURENESS: np.float64(0.9),
        REDUCTION: np.int64(1),
        OUTERMOST_YEAR: np.float64(2001),
        OUTERMOST_COMPLETE: np.True_,
        ABSENT_YEARS: np.zeros(0, np.int64),
    }
    ds = fake_results()[["rgb", "valid", "pixel_size"]]
    ds = ds.assign({v.name: (v.dims, np.asarray(values)) for v, values in arrays.items()})
    write_scan_report(ds, tmp_path / "report.html", fake_context())
    page = Page((tmp_path / "report.html").read_text())
    assert "series" in page.ids()
    assert "1999\u20132001, 3 rings" in page.text
    plots = [attrs for tag, attrs in page.tags if tag == "svg" and attrs.get("class") == "plot"]
    assert len(plots) == 2
    assert "series.json" in page.links()
    assert len(page.ids()) == len(set(page.ids()))
    write_scan_report(ds.drop_vars("crossing_x"), tmp_path / "without.html", fake_context())
    assert "series" not in Page((tmp_path / "without.html").read_text()).ids()
