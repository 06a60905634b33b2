"""The pages: self-contained, complete, sensible with less than everything, and safe with hostile names."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from report_data import LogTexture, Page, fake_context, fake_results

from pipeline.context import ProductContext, ScanRow
from pipeline.report import write_index, write_scan_report
from pipeline.report.axes import log_bar, ticks_between
from pipeline.report.box import Box, camera_for, look
from pipeline.report.index_page import read_thumbnail
from pipeline.report.labels import place_labels
from pipeline.report.pictures import block_mean, fit
from pipeline.report.placing import cut_of, place_of
from pipeline.report.reading import Scan
from pipeline.report.tables import number_text
from stages import variables as v

LATE = ("color_strip", "lateness_strip", "strip_support", "rendered")
FITTED = ("polished_displacement", "face_age", "phase_residual", "loss", *LATE)
POSED = ("board_to_tree", "ring_radius", "pose_spread", "displacement", *FITTED)
TRACED = (
    *("ring_x", "ring_y", "vertex_confidence", "vertex_count", "ring_index", "ring_confidence", "ring_closed"),
    *("ring_phase", "phase_confidence", "growth_sureness", *POSED),
)


@pytest.fixture(autouse=True)
def texture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solid textures come from the log that the fake results were drawn from."""

    def solid_texture_of(ds: xr.Dataset) -> LogTexture:
        size = float(ds["pixel_size"])
        return LogTexture(ds.attrs["log"], size if np.isfinite(size) else None)

    monkeypatch.setattr("stages.products.solid_texture_of", solid_texture_of)
    monkeypatch.setattr("pipeline.report.solid._LONGER_PX", 200)


def written(tmp_path: Path, ds: xr.Dataset, context: ProductContext | None = None) -> tuple[str, Page]:
    """The page of a scan."""
    path = tmp_path / "report.html"
    write_scan_report(ds, path, context or fake_context())
    text = path.read_text(encoding="utf-8")
    return text, Page(text)


def test_page_is_self_contained(tmp_path: Path) -> None:
    text, page = written(tmp_path, fake_results())
    beside = ("../index.html", "rings.json", "texture.zarr.zip", "viewer.html")
    for link in page.links():
        allowed = link.startswith(("data:image/", "#")) or link in beside
        assert allowed, link[:80]
    assert not re.search(r"https?://|file:|@import|url\((?!#)", text)
    ids = page.ids()
    assert len(ids) == len(set(ids))
    assert {link[1:] for link in page.links() if link.startswith("#")} <= set(ids)
    assert set(re.findall(r"url\(#([^)]+)\)", text)) <= set(ids)
    assert len(text) < 4_000_000


def test_page_shows_every_section(tmp_path: Path) -> None:
    _, page = written(tmp_path, fake_results())
    assert {"rings", "maps", "face", "solid", "colors", "fit", "pose", "stages"} <= set(page.ids())
    pictures = [attrs for tag, attrs in page.tags if tag == "img"]
    assert len(pictures) == 11
    assert all(attrs["alt"] and attrs["width"] and attrs["height"] for attrs in pictures)
    plots = [attrs for tag, attrs in page.tags if tag == "svg" and attrs.get("class") == "plot"]
    assert len(plots) == 6
    assert all(attrs["role"] == "img" and attrs["aria-label"] for attrs in plots)
    headings = [tag for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert headings[0] == "h1"
    assert headings.count("h1") == 1
    for words in ("dB", "14.81", "widths_px", "4, 120", "77ab" * 8, "4.2 s", "± 1.7°", "mm", "flat-sawn", "is a guess"):
        assert words in page.text, words


def test_warnings_come_first(tmp_path: Path) -> None:
    text, page = written(tmp_path, fake_results())
    assert "Seven rings are unsure." in page.text
    assert text.index("Seven rings") < text.index("<main>")
    _, calm = written(tmp_path, fake_results(), fake_context(warnings=()))
    assert "Warnings" not in calm.text


@pytest.mark.parametrize(
    ("late", "gone", "kept"),
    [
        (LATE, {"face", "solid", "colors"}, {"fit", "pose", "rings"}),
        (FITTED, {"fit", "solid"}, {"pose", "rings"}),
        (POSED, {"pose", "fit"}, {"rings", "maps"}),
        (TRACED, {"pose", "fit", "colors"}, {"rings", "maps"}),
        ((*TRACED, "phase", "magnitude", "frequency", "coherence"), {"maps", "pose"}, {"rings", "stages"}),
    ],
)
def test_page_of_a_run_that_stopped_early(
    tmp_path: Path, late: tuple[str, ...], gone: set[str], kept: set[str]
) -> None:
    text, page = written(tmp_path, fake_results().drop_vars([*late, "strip"], errors="ignore"))
    assert not gone & set(page.ids())
    assert kept <= set(page.ids())
    assert {link[1:] for link in page.links() if link.startswith("#")} <= set(page.ids())
    assert "stopped early" in page.text
    assert "texture.zarr.zip" not in text


def test_page_of_a_source_alone(tmp_path: Path) -> None:
    encoded = v.ENCODED.array(np.full((9, 7, 3), 40_000, "u2"))
    _, page = written(
        tmp_path, xr.Dataset({"encoded": encoded}), fake_context(keys={}, seconds={}, figures={}, params={})
    )
    assert sum(tag == "img" for tag, _ in page.tags) == 1


def test_page_without_rings_wood_or_numbers(tmp_path: Path) -> None:
    ds = fake_results()
    ds = ds.isel(vertex=slice(0, 0), ring=slice(0, 0))
    for name in ("frequency", "coherence", "ring_phase", "phase_residual"):
        ds[name] = ds[name] * np.float32("nan")
    ds["valid"] = ds["valid"] & False
    ds["loss"] = ds["loss"] * np.nan
    ds["strip_support"] = ds["strip_support"] * 0
    _, page = written(tmp_path, ds)
    assert "No ring boundaries were found." in page.text
    assert "nan" not in page.text.lower()


@pytest.mark.parametrize(
    "name", ["<script>alert(1)</script>.png", '"><img src=x onerror=alert(1)>.png', "{{ 7*7 }}&amp;.png"]
)
def test_hostile_names_are_escaped(tmp_path: Path, name: str) -> None:
    context = fake_context(name, warnings=(f"{name} is odd",), figures={name: {name: name}}, stem="x")
    _, page = written(tmp_path, fake_results(), context)
    assert Path(name).name in page.text
    assert not any(tag == "script" for tag, _ in page.tags)
    assert not any("onerror" in attrs for _, attrs in page.tags)
    row = ScanRow(Path(name), "x", "failed", f"broken: {name}")
    write_index([row, ScanRow(Path(name), "y", "done", warnings=(name,))], tmp_path / "index.html")
    index = Page((tmp_path / "index.html").read_text())
    assert f"broken: {name}" in index.text
    assert not any(tag == "script" or "onerror" in attrs for tag, attrs in index.tags)


def test_hostile_stem_cannot_leave_the_folder(tmp_path: Path) -> None:
    row = ScanRow(Path("a.png"), 'a" onclick="x', "done", products={"report": "report.html"})
    write_index([row], tmp_path / "index.html")
    page = Page((tmp_path / "index.html").read_text())
    assert "a%22%20onclick%3D%22x/report.html" in set(page.links())


def test_index_lists_all_scans(tmp_path: Path) -> None:
    (tmp_path / "board").mkdir()
    write_scan_report(fake_results(), tmp_path / "board" / "report.html", fake_context())
    products = {"report": "report.html", "rings": "rings.json"}
    rows = [
        ScanRow(Path("board.png"), "board", "done", rings=24, seconds=12.34, products=products, warnings=("w", "u")),
        ScanRow(Path("disc.jpg"), "disc", "reused", rings=None, products={"rings": "rings.json"}),
        ScanRow(Path("broken.tif"), "broken", "failed", "the file ends early"),
    ]
    inner = tmp_path / ".woodpipe"
    inner.mkdir()
    write_index(rows, inner / "index.html", folder=tmp_path)
    text = (inner / "index.html").read_text()
    page = Page(text)
    for words in (
        "3 scans",
        "1 done, 1 reused, 1 failed",
        "24 rings",
        "2 warnings",
        "broken.tif",
        "the file ends early",
    ):
        assert words in page.text, words
    assert [attrs["src"] for tag, attrs in page.tags if tag == "img"] == [
        read_thumbnail(tmp_path / "board" / "report.html")
    ]
    assert {"board/report.html", "board/rings.json", "disc/rings.json"} == {
        link for link in page.links() if not link.startswith(("data:", "#"))
    }
    assert not re.search(r"https?://", text)


def test_thumbnail_takes_pictures_only(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    page.write_text('<meta name="woodpipe-thumbnail" content="javascript:alert(1)">')
    assert read_thumbnail(page) is None
    assert read_thumbnail(tmp_path / "none.html") is None


def test_labels_do_not_overlap_and_stay_inside() -> None:
    lines = {(i, ""): [np.column_stack([np.full(200, 3.0 * i), np.linspace(0, 400, 200)])] for i in range(1, 200)}
    labels = place_labels(lines, (0.0, 0.0, 600.0, 400.0), 1.0)
    assert len(labels) > 60
    assert {10, 50, 100, 190} <= {label.name[0] for label in labels}
    for i, a in enumerate(labels):
        assert 0 < a.x < 600
        assert 0 < a.y < 400
        for b in labels[i + 1 :]:
            assert abs(a.y - b.y) >= 14 or abs(a.x - b.x) >= 12


def test_block_shows_three_faces_and_its_inside() -> None:
    box = Box(np.array([-0.5, -0.5, 0.0]), np.array([99.5, 79.5, 32.0]), np.array([40.0, 30.0, 16.0]))
    seen = look(box, camera_for(box, 300))
    assert set(np.unique(seen.axis)) == {0, 1, 2}
    on_surface = np.minimum(np.abs(seen.points - box.low), np.abs(seen.points - box.high)).min(axis=1) < 1e-6
    assert (on_surface | seen.inside).all()
    low, high = box.notch
    within = ((seen.points > low + 1e-6) & (seen.points < high - 1e-6)).all(axis=1)
    assert not within.any()
    assert set(np.unique(seen.axis[seen.inside])) == {0, 1, 2}
    assert not seen.hit[0].any()
    assert not seen.hit[:, -1].any()


@pytest.mark.parametrize(
    ("name", "cut"), [("end_grain_pith", "end grain"), ("quarter_sawn", "quarter-sawn"), ("flat_sawn", "flat-sawn")]
)
def test_cuts_are_named(name: str, cut: str) -> None:
    place = place_of(Scan(fake_results(name)))
    assert place is not None
    assert cut in cut_of(place)
    assert np.allclose(np.hypot(*place.tree(place.foot)[:2]), 0.0, atol=1e-6)


def test_block_mean_keeps_the_mean_of_uneven_blocks() -> None:
    image = np.arange(7 * 5, dtype=float).reshape(7, 5)
    small = block_mean(image, 3, rows=1)
    assert small.shape == (3, 2)
    assert small[0, 0] == pytest.approx(image[:3, :3].mean())
    assert small[2, 1] == pytest.approx(image[6:, 3:].mean())
    assert fit(np.ones((40, 10), complex), 20).shape == (20, 5)


def test_lazy_results_make_the_same_page(tmp_path: Path) -> None:
    ds = fake_results("core")
    text, _ = written(tmp_path, ds)
    lazy, _ = written(tmp_path, ds.chunk({"y": 40, "x": 70}))
    assert lazy == text


def test_strips_get_longer_pictures() -> None:
    board, strip = fake_results(), fake_results("core")
    assert Scan(board).longer == 1100
    assert 1100 < Scan(strip).longer <= 4000


def test_reduced_images_keep_their_place() -> None:
    ds = fake_results().isel(y=slice(1, None, 3), x=slice(1, None, 3))
    frame = Scan(ds).frame
    assert frame is not None
    assert (frame.left, frame.top, frame.step) == (-0.5, -0.5, 3.0)
    assert (frame.width, frame.height) == (159.0, 150.0)


def test_numbers_are_written_for_people() -> None:
    assert number_text(0.00001234) == "1.234e\u22125"
    assert number_text(12345.678) == "12,346"
    assert number_text(float("nan")) == "unknown"
    assert number_text(None) == "not set"
    assert number_text((1, -2.5)) == "1, \u22122.5"
    assert ticks_between(0.0, 1.0) == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    assert ticks_between(3.0, 3.0) == [3.0]
    assert [tick.text for tick in log_bar("viridis", 4.0, 60.0, "px").ticks] == ["5", "10", "20", "50"]
