"""Evaluation: the right figures for each kind of truth, and the right truth for each scan."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import woodfit
from pipeline.evaluation import TruthError, evaluate, find_truth, read_polylines
from woodfit.synthetic_scenes import Scene, scene, write_sample

SIZE = (150, 160)


def contours(age: NDArray[np.float32]) -> list[dict[str, Any]]:
    """Ring boundaries traced from the truth itself: between the rows of pixels, at sub-pixel x."""
    rings = []
    for level in range(int(np.floor(age.min())) + 1, int(np.floor(age.max())) + 1):
        # Outlines on a finer grid, image px; the outer frame is not a ring boundary.
        fine = cv2.resize(age, None, fx=8, fy=8, interpolation=cv2.INTER_LINEAR)
        outlines, _ = cv2.findContours((fine < level).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            points = (np.asarray(outline, dtype=float).reshape(-1, 2) + 0.5) / 8 - 0.5
            low, high = points.min(axis=1), (points - np.array(age.shape[::-1])).max(axis=1)
            inside = np.asarray((low > 0.1) & (high < -1.1), dtype=bool)
            rings += [
                {"id": level, "confidence": 1.0, "closed": False, "points": points[run].tolist()}
                for run in np.split(np.arange(len(points)), np.flatnonzero(np.diff(inside)) + 1)
                if inside[run[0]] and len(run) > 1
            ]
    return rings


def write_rings(folder: Path, image: str, rings: list[dict[str, Any]]) -> Path:
    path = folder / "rings.json"
    path.write_text(json.dumps({"image": image, "size": [SIZE[1], SIZE[0]], "rings": rings}))
    return path


@dataclass
class Answer:
    ring_age: NDArray[np.float64]
    rgb: NDArray[np.float64]


class TrueTexture:
    """A solid texture that knows the log, in mm, with a ring age off by a constant and a wrong depth."""

    pixel_size = 0.1
    shot: Scene
    depth = 1.0

    @classmethod
    def open(cls, path: Path) -> "TrueTexture":
        return cls()

    def evaluate(self, points: NDArray[np.float64]) -> Answer:
        px = points / self.pixel_size * [1.0, 1.0, self.depth]
        return Answer(self.shot.log.age(px) + 3.4, self.shot.log.color(px))


@pytest.fixture
def sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (path,) = write_sample(tmp_path, SIZE, names=("end_grain_off",))
    TrueTexture.shot = scene("end_grain_off", SIZE)
    TrueTexture.depth = 1.0
    monkeypatch.setattr(woodfit, "SolidTexture", TrueTexture, raising=False)
    return path


def test_true_rings_and_true_texture_score_full(sample: Path) -> None:
    rings = write_rings(sample.parent, sample.name, contours(TrueTexture.shot.face.age))
    truth = find_truth(sample)
    assert truth is not None
    figures = evaluate(rings, truth, sample.parent / "texture.zarr.zip")
    assert figures["recall"] == pytest.approx(1.0, abs=1e-3)
    assert figures["precision"] == pytest.approx(1.0, abs=1e-3)
    assert figures["line_f"] == pytest.approx(1.0, abs=0.01)
    assert figures["age_share"] == 1.0
    assert figures["age_offset"] == pytest.approx(3.4, abs=1e-3)
    assert figures["along_x_correlation"] == pytest.approx(1.0)
    assert figures["along_y_median_error"] < 1e-3
    assert figures["psnr"] > 20.0


def test_shifted_rings_and_wrong_depth_score_less(sample: Path) -> None:
    rings = contours(TrueTexture.shot.face.age)
    for ring in rings:
        ring["points"] = [[x + 5.0, y + 5.0] for x, y in ring["points"]]
    TrueTexture.depth = 25.0
    truth = sample.with_suffix(".truth.npz")
    figures = evaluate(write_rings(sample.parent, sample.name, rings), truth, Path("texture.zarr.zip"))
    assert figures["recall"] < 0.7
    assert figures["line_f"] < 0.5
    assert figures["along_x_median_error"] > 0.15


def test_without_a_texture_only_the_rings_are_judged(sample: Path) -> None:
    rings = write_rings(sample.parent, sample.name, [])
    figures = evaluate(rings, sample.with_suffix(".truth.npz"))
    assert figures["recall"] == 0.0
    assert "age_share" not in figures


def test_labelled_core_is_judged_along_its_paths(tmp_path: Path) -> None:
    write_sample(tmp_path, (367, 200), names=("core",))
    shot = scene("core", (367, 200))
    rings = write_rings(tmp_path, "core.png", contours(shot.face.age))
    figures = evaluate(rings, tmp_path / "core.json")
    assert figures["f"] == 1.0
    assert figures["matched"] > 20


def test_labelled_face_is_judged_by_length(tmp_path: Path) -> None:
    line = [[20.0, 0.0], [20.0, 100.0]]
    label = tmp_path / "face.json"
    label.write_text(
        json.dumps({"image": "face.png", "rings": [{"id": 1, "uncertain": 0, "points": line}], "ignore": []})
    )
    ring = {"id": 0, "confidence": 1.0, "closed": False, "points": [[22.0, 0.0], [22.0, 50.0]]}
    figures = evaluate(write_rings(tmp_path, "face.png", [ring]), label)
    assert figures["label_share"] == pytest.approx(0.52, abs=0.01)
    assert figures["traced_share"] == 1.0


def test_closed_ring_returns_to_its_start(tmp_path: Path) -> None:
    ring = {"id": 0, "confidence": 1.0, "closed": True, "points": [[0, 0], [9, 0], [9, 9]]}
    (polyline,) = read_polylines(write_rings(tmp_path, "x.png", [ring]))
    assert polyline.tolist() == [[0, 0], [9, 0], [9, 9], [0, 0]]


@pytest.mark.parametrize("content", ["not json", "[1, 2]", '{"image": "a.png"}'])
def test_file_that_holds_no_labels_is_named(tmp_path: Path, content: str) -> None:
    wrong = tmp_path / "wrong.json"
    wrong.write_text(content)
    with pytest.raises(TruthError, match=r"wrong\.json.*paths"):
        evaluate(write_rings(tmp_path, "a.png", []), wrong)


def test_label_without_a_needed_key_says_which(tmp_path: Path) -> None:
    label = tmp_path / "core.json"
    label.write_text(json.dumps({"paths": [{"start": [0, 0], "positions": []}]}))
    with pytest.raises(TruthError, match=r"core\.json.*'end'"):
        evaluate(write_rings(tmp_path, "a.png", []), label)


# --- find_truth ---------------------------------------------------------------------------------------------
def _label(path: Path, image: str | None = None) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    content: dict[str, Any] = {"paths": []}
    path.write_text(json.dumps(content if image is None else content | {"image": image}))
    return path


def test_truth_beside_the_scan_comes_before_labels(sample: Path, tmp_path: Path) -> None:
    _label(tmp_path / "labels" / "end_grain_off.json", sample.name)
    assert find_truth(sample, tmp_path / "labels") == sample.with_suffix(".truth.npz")


def test_labels_are_found_by_the_image_they_name(tmp_path: Path) -> None:
    a = _label(tmp_path / "labels" / "B1_A.json", "scans/B1/A.png")
    b = _label(tmp_path / "labels" / "B2_A.json", "scans/B2/A.png")
    assert find_truth(tmp_path / "scans" / "B1" / "A.png", tmp_path / "labels") == a
    assert find_truth(tmp_path / "scans" / "B2" / "A.png", tmp_path / "labels") == b
    assert find_truth(tmp_path / "scans" / "B3" / "A.png", tmp_path / "labels") is None


def test_labels_follow_a_scan_that_was_copied_elsewhere(tmp_path: Path) -> None:
    label = _label(tmp_path / "labels" / "core_1.json", "scans/cores/core_1.png")
    assert find_truth(tmp_path / "elsewhere" / "core_1.png", tmp_path / "labels") == label


def test_labels_beside_the_scan_are_found_and_other_json_is_not(tmp_path: Path) -> None:
    scan = tmp_path / "x.png"
    (tmp_path / "x.json").write_text('{"camera": 1}')
    assert find_truth(scan) is None
    assert find_truth(scan, tmp_path / "absent") is None
    assert find_truth(scan) is None
    label = _label(tmp_path / "x.json")
    assert find_truth(scan) == label
