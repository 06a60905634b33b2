"""The pages: self-contained, complete, sensible with less than everything, and safe with hostile names."""

from __future__ import annotations

import re
import sys
import types
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import xarray as xr

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
from woodfit.synthetic import Log, srgb_decode
from woodfit.synthetic_scenes import scene

LATE = ("color_strip", "lateness_strip", "strip_support", "rendered")
FITTED = ("polished_displacement", "face_age", "phase_residual", "loss", *LATE)
POSED = ("board_to_tree", "ring_radius", "pose_spread", "displacement", *FITTED)
TRACED = (
    *("ring_x", "ring_y", "vertex_confidence", "vertex_count", "ring_index", "ring_confidence", "ring_closed"),
    *("ring_phase", "phase_confidence", "growth_sureness", *POSED),
)


@dataclass(frozen=True)
class Evaluated:
    """What a texture says of points."""

    rgb: np.ndarray
    ring_age: np.ndarray
    lateness: np.ndarray


@dataclass(frozen=True)
class LogTexture:
    """A texture that knows the log itself."""

    log: Log
    pixel_size: float | None

    def evaluate(self, points: np.ndarray) -> Evaluated:
        """Color, age and lateness."""
        age = self.log.age(points / (self.pixel_size or 1.0))
        return Evaluated(self.log.palette.base(age), age, self.log.palette.lateness(age))


@cache
def drawn(name: str, size: tuple[int, int]) -> Any:
    """A scene."""
    return scene(name, size, 3)


def fake_results(name: str = "flat_sawn", size: tuple[int, int] = (150, 160), known_scale: bool = True) -> xr.Dataset:
    """Merged results of all stages as they would be for a scene."""
    import contourpy

    sample = drawn(name, size)
    rng = np.random.default_rng(0)
    log, encoded, age = sample.log, sample.face.rgb_encoded, sample.face.age.astype(float)
    height, width = age.shape
    coords = {"y": np.arange(height, dtype=float), "x": np.arange(width, dtype=float)}
    wobble = cv2.GaussianBlur(rng.normal(0, 1, age.shape), (0, 0), 25) * 0.6
    phase = np.angle(np.exp(2j * np.pi * (age + wobble)))
    slope = np.hypot(*np.gradient(cv2.GaussianBlur(age, (0, 0), 6)))
    confidence = np.clip(1.0 - cv2.GaussianBlur(rng.random(age.shape), (0, 0), 12) * 0.6, 0, 1)
    contours = contourpy.contour_generator(z=age)
    lines = [(level, line) for level in range(1, int(age.max()) + 1) for line in contours.lines(level) if len(line) > 12]
    points = np.concatenate([line for _, line in lines]) if lines else np.empty((0, 2))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = log.axes, -log.axes @ np.asarray(log.pith)
    strip = np.arange(0.5 / 32, len(log.boundaries) - 1, 1 / 32)
    seen = (strip > age.min()) & (strip < age.max())
    dpi = 25.4 / sample.dpi if sample.dpi and known_scale else np.nan
    images = {
        v.RGB: srgb_decode(encoded / 255.0).astype("f4"),
        v.VALUE: (encoded.max(axis=-1) / 255.0).astype("f4"),
        v.VALID: np.hypot(np.arange(height)[:, None] - 10, np.arange(width) - 10) > 24,
        v.ORIENTATION: np.zeros(age.shape, "f4"),
        v.COHERENCE: confidence.astype("f4"),
        v.PHASE: phase.astype("f4"),
        v.MAGNITUDE: (0.1 * confidence).astype("f4"),
        v.FREQUENCY: slope.astype("f4"),
        v.RING_PHASE: phase.astype("f4"),
        v.PHASE_CONFIDENCE: confidence.astype("f4"),
        v.FACE_AGE: age.astype("f4"),
        v.PHASE_RESIDUAL: (2 * np.pi * wobble).astype("f4"),
        v.RENDERED: log.palette.base(age).astype("f4"),
    }
    plain = {
        v.PIXEL_SIZE: dpi,
        v.REDUCTION: 1,
        v.RING_SCALE: 15.0,
        v.RING_X: points[:, 0],
        v.RING_Y: points[:, 1],
        v.VERTEX_CONFIDENCE: np.ones(len(points)),
        v.VERTEX_COUNT: np.array([len(line) for _, line in lines], dtype=int),
        v.RING_INDEX: np.array([level for level, _ in lines], dtype=int),
        v.RING_CONFIDENCE: np.clip(rng.normal(0.8, 0.2, len(lines)), 0, 1),
        v.RING_CLOSED: np.array([bool((line[0] == line[-1]).all()) for _, line in lines], dtype=bool),
        v.GROWTH_SURENESS: 0.97,
        v.BOARD_TO_TREE: matrix,
        v.RING_RADIUS: log.boundaries,
        v.POSE_SPREAD: np.array([0.004, 0.03, 4.0, 41.0]),
        v.DISPLACEMENT: np.zeros((4, 4, 4)),
        v.POLISHED_DISPLACEMENT: np.zeros((4, 4, 4)),
        v.LOSS: 0.02 + 0.3 * np.exp(-np.arange(60) / 9.0),
        v.COLOR_STRIP: log.palette.base(strip).astype("f4"),
        v.LATENESS_STRIP: log.palette.lateness(strip).astype("f4"),
        v.STRIP_SUPPORT: np.where(seen, 90.0, 0.0),
    }
    ds = xr.Dataset({variable.name: variable.array(values) for variable, values in {**images, **plain}.items()})
    ds = ds.assign_coords(coords | {"strip": strip})
    ds.attrs["log"] = log
    return ds


def fake_context(name: str = "larch board.png", **more: Any) -> ProductContext:
    """The story of a scan."""
    story: dict[str, Any] = {
        "params": {"scan": {"pixel_size_mm": None}, "curved_gabor": {"p": 80, "q": 80, "widths_px": [4.0, 120.0]}},
        "keys": {"scan": "1f0c" * 8, "curved_gabor": "77ab" * 8},
        "seconds": {"scan": 0.41, "curved_gabor": 4.22},
        "warnings": ("The outward direction is a guess.", "Seven rings are unsure."),
        "figures": {"curved_gabor": {"median ring width": 14.8123, "share confident": 0.93}},
        "version": "0.1",
    }
    return ProductContext(Path(name), Path(name).stem, **(story | more))


@pytest.fixture(autouse=True)
def texture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solid textures come from the log that the fake results were drawn from."""
    module = types.ModuleType("stages.products")

    def solid_texture_of(ds: xr.Dataset) -> LogTexture:
        size = float(ds["pixel_size"])
        return LogTexture(ds.attrs["log"], size if np.isfinite(size) else None)

    module.solid_texture_of = solid_texture_of  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "stages.products", module)


class Page(HTMLParser):
    """What a browser would make of a page."""

    VOID = frozenset({"meta", "img", "input", "br", "link", "path", "use"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self._open or self._open[-1] not in ("style", "script"):
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))

    def ids(self) -> list[str]:
        return [str(attrs["id"]) for _, attrs in self.tags if "id" in attrs]

    def links(self) -> Iterator[str]:
        for _, attrs in self.tags:
            yield from (str(attrs[name]) for name in ("src", "href", "xlink:href", "poster", "srcset") if name in attrs)


def written(tmp_path: Path, ds: xr.Dataset, context: ProductContext | None = None) -> tuple[str, Page]:
    """The page of a scan."""
    path = tmp_path / "report.html"
    write_scan_report(ds, path, context or fake_context())
    text = path.read_text(encoding="utf-8")
    return text, Page(text)


def test_page_is_self_contained(tmp_path: Path) -> None:
    text, page = written(tmp_path, fake_results())
    for link in page.links():
        allowed = link.startswith(("data:image/", "#")) or link in ("../index.html", "rings.json", "texture.zarr.zip")
        assert allowed, link[:80]
    assert not re.search(r"https?://|file:|@import|url\((?!#)", text)
    ids = page.ids()
    assert len(ids) == len(set(ids))
    assert {link[1:] for link in page.links() if link.startswith("#")} <= set(ids)
    assert {match for match in re.findall(r"url\(#([^)]+)\)", text)} <= set(ids)
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
    for words in ("dB", "14.81", "widths px", "4, 120", "77ab" * 8, "4.2 s", "± 1.7°", "mm", "flat-sawn"):
        assert words in page.text, words


def test_warnings_come_first(tmp_path: Path) -> None:
    text, page = written(tmp_path, fake_results())
    assert "Seven rings are unsure." in page.text
    assert text.index("Seven rings") < text.index("<main>")
    _, calm = written(tmp_path, fake_results(), fake_context(warnings=()))
    assert "Worth knowing" not in calm.text


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
def test_page_of_a_run_that_stopped_early(tmp_path: Path, late: tuple[str, ...], gone: set[str], kept: set[str]) -> None:
    text, page = written(tmp_path, fake_results().drop_vars([*late, "strip"], errors="ignore"))
    assert not gone & set(page.ids())
    assert kept <= set(page.ids())
    assert {link[1:] for link in page.links() if link.startswith("#")} <= set(page.ids())
    assert "stopped early" in page.text
    assert "texture.zarr.zip" not in text


def test_page_of_a_source_alone(tmp_path: Path) -> None:
    encoded = v.ENCODED.array(np.full((9, 7, 3), 40_000, "u2"))
    _, page = written(tmp_path, xr.Dataset({"encoded": encoded}), fake_context(keys={}, seconds={}, figures={}, params={}))
    assert sum(tag == "img" for tag, _ in page.tags) == 1


def test_page_without_rings_wood_or_numbers(tmp_path: Path) -> None:
    ds = fake_results()
    for name in ("ring_x", "ring_y", "vertex_confidence"):
        ds[name] = ds[name][:0]
    for name in ("vertex_count", "ring_index", "ring_confidence", "ring_closed"):
        ds[name] = ds[name][:0]
    for name in ("frequency", "coherence", "ring_phase", "phase_residual"):
        ds[name] = ds[name] * np.float32("nan")
    ds["valid"] = ds["valid"] & False
    ds["loss"] = ds["loss"] * np.nan
    ds["strip_support"] = ds["strip_support"] * 0
    for name in ("ring_x", "vertex_count"):
        assert ds[name].size == 0
    _, page = written(tmp_path, ds)
    assert "No ring boundaries were found." in page.text
    assert "nan" not in page.text.lower()


@pytest.mark.parametrize("name", ["<script>alert(1)</script>.png", '"><img src=x onerror=alert(1)>.png', "{{ 7*7 }}&amp;.png"])
def test_hostile_names_are_escaped(tmp_path: Path, name: str) -> None:
    context = fake_context(name, warnings=(f"{name} is odd",), figures={name: {name: name}}, stem="x")  # type: ignore[misc]
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
    for words in ("3 scans", "1 done, 1 reused, 1 failed", "24 rings", "2 warnings", "broken.tif", "the file ends early"):
        assert words in page.text, words
    assert [attrs["src"] for tag, attrs in page.tags if tag == "img"] == [read_thumbnail(tmp_path / "board" / "report.html")]
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
    lines = {i: np.column_stack([np.full(200, 3.0 * i), np.linspace(0, 400, 200)]) for i in range(1, 200)}
    labels = place_labels(lines, (0.0, 0.0, 600.0, 400.0), 1.0)
    assert len(labels) > 60
    assert {10, 50, 100, 190} <= {label.index for label in labels}
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
