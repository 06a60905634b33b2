"""Results of all stages as they would be for drawn scenes, and a reader of pages, for the tests of the pages."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import xarray as xr

from pipeline.context import ProductContext
from stages import variables as v
from stages.faces import single_face
from woodfit.fine_grain import FineGrain
from woodfit.synthetic import Log, srgb_decode
from woodfit.synthetic_scenes import scene


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
    from contourpy import contour_generator

    sample = drawn(name, size)
    rng = np.random.default_rng(0)
    log, encoded, age = sample.log, sample.face.rgb_encoded, sample.face.age.astype(float)
    height, width = age.shape
    coords = {"y": np.arange(height, dtype=float), "x": np.arange(width, dtype=float)}
    wobble = cv2.GaussianBlur(rng.normal(0, 1, age.shape), (0, 0), 25) * 0.6
    phase = np.angle(np.exp(2j * np.pi * (age + wobble)))
    slope = np.hypot(*np.gradient(cv2.GaussianBlur(age, (0, 0), 6)))
    confidence = np.clip(1.0 - cv2.GaussianBlur(rng.random(age.shape), (0, 0), 12) * 0.6, 0, 1)
    contours: Any = contour_generator(z=age)
    lines = [
        (level, line) for level in range(1, int(age.max()) + 1) for line in contours.lines(level) if len(line) > 12
    ]
    points = np.concatenate([line for _, line in lines]) if lines else np.empty((0, 2))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = log.axes, -log.axes @ np.asarray(log.pith)
    strip = np.arange(0.5 / 32, len(log.boundaries) - 1, 1 / 32)
    seen = (strip > age.min()) & (strip < age.max())
    dpi = 25.4 / sample.dpi if sample.dpi and known_scale else np.nan
    none = FineGrain.none()
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
        v.RING_CLOSED: np.array([bool(np.array_equal(line[0], line[-1])) for _, line in lines], dtype=bool),
        v.RING_GROUP: (np.arange(len(lines)) % 9 == 4).astype(int),
        v.GROWTH_SURENESS: 0.97,
        v.AZIMUTH_WRAPS: True,
        v.SAMPLES_PER_RING: 32,
        v.BOARD_TO_TREE: matrix,
        v.RING_RADIUS: log.boundaries,
        v.STEM: np.zeros(3),
        v.FINE_GRAIN_KIND: none.kind,
        v.FINE_GRAIN_CELLS: none.cells,
        v.FINE_GRAIN_DENSITY: none.density,
        v.FINE_GRAIN_AMPLITUDE: none.amplitude,
        v.FINE_GRAIN_COLOR: none.color,
        v.FINE_GRAIN_LOG_MEAN: none.log_mean,
        v.FINE_GRAIN_SEED: 0,
        v.POSE_SPREAD: np.array([0.004, 0.03, 4.0, 41.0]),
        v.DISPLACEMENT: np.zeros((4, 4, 4)),
        v.POLISHED_DISPLACEMENT: np.zeros((4, 4, 4)),
        v.LOSS: 0.02 + 0.3 * np.exp(-np.arange(60) / 9.0),
        v.COLOR_STRIP: log.palette.base(strip).astype("f4"),
        v.LATENESS_STRIP: log.palette.lateness(strip).astype("f4"),
        v.STRIP_SUPPORT: np.where(seen, 90.0, 0.0),
    }
    ds = xr.Dataset({variable.name: variable.array(values) for variable, values in {**images, **plain}.items()})
    ds = ds.assign(single_face().data_vars).assign_coords(coords | {"strip": strip})
    ds.attrs["log"] = log
    return ds


def fake_context(name: str = "larch board.png", **more: Any) -> ProductContext:
    """The story of a scan."""
    story: dict[str, Any] = {
        "stem": Path(name).stem,
        "params": {"scan": {"pixel_size_mm": None}, "curved_gabor": {"p": 80, "q": 80, "widths_px": [4.0, 120.0]}},
        "keys": {"scan": "1f0c" * 8, "curved_gabor": "77ab" * 8},
        "seconds": {"scan": 0.41, "curved_gabor": 4.22},
        "warnings": ("The outward direction is a guess.", "Seven rings are unsure."),
        "figures": {"curved_gabor": {"median ring width": 14.8123, "share confident": 0.93}},
        "version": "0.1",
    }
    return ProductContext(Path(name), **(story | more))


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
