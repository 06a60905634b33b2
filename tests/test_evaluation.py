"""Evaluation: the right figures for each kind of truth, and the right truth for each scan."""

import csv
import json
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console
from typer.testing import CliRunner

import woodfit
from pipeline.cli import app
from pipeline.evaluation import Evaluation, evaluate, judge, read_polylines
from pipeline.evaluation_tables import evaluation_parts, write_csv
from pipeline.labels import TruthError, centroid, find_truth, pith_of, read_label, read_species, species_of
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


# --- the table, species and discs ---------------------------------------------------------------------------
EDGES = [20.0, 60.0, 110.0, 150.0]


def write_core(folder: Path, name: str, shift: float = 0.0, missing: tuple[int, ...] = (), **label: Any) -> Path:
    """A folder with the traced rings and the label of a core; returns the label's path."""
    folder.mkdir(parents=True, exist_ok=True)
    rings = [
        {"id": k, "confidence": 0.8, "closed": False, "points": [[x + shift, 0], [x + shift, 20]]}
        for k, x in enumerate(EDGES)
        if k not in missing
    ]
    write_rings(folder, name, rings)
    path = {"start": [0, 10], "end": [200, 10], "positions": [[x, 10] for x in EDGES], "year": [2004, 2003, 2002, 2001]}
    target = folder / "label.json"
    target.write_text(json.dumps({"image": name, "pixel_size_mm": 0.1, "paths": [path], **label}))
    return target


def evaluation_of_three(tmp_path: Path) -> Evaluation:
    judged = {}
    for name, shift, missing, species in (
        ("a.png", 0.0, (), "Larix"),
        ("b.png", 1.0, (0, 1), "Larix"),
        ("c.png", 9.0, (), "Betula"),
    ):
        label = write_core(tmp_path / name, name, shift, missing, species=species)
        judged[name] = judge(tmp_path / name / "rings.json", label)
    return Evaluation(judged)


def test_pooled_figures_count_boundaries_and_not_images(tmp_path: Path) -> None:
    pooled = evaluation_of_three(tmp_path).pooled()
    assert list(pooled) == ["Betula", "Larix", "all"]
    assert (pooled["Larix"]["images"], pooled["Larix"]["boundaries"]) == (2.0, 8.0)
    assert pooled["Larix"]["sensitivity"] == pytest.approx(6 / 8)
    assert pooled["Larix"]["precision"] == 1.0
    assert pooled["Larix"]["position_median_px"] == pytest.approx(0.0)
    assert pooled["Betula"]["f"] == 0.0
    assert pooled["all"]["sensitivity"] == pytest.approx(6 / 12)
    assert pooled["all"]["mean_f"] == pytest.approx((1 + 2 / 3 + 0) / 3)


def test_missed_rings_are_listed_by_year_and_confidence_is_checked(tmp_path: Path) -> None:
    content = evaluation_of_three(tmp_path).as_json()
    assert content["images"]["b.png"]["missed_years"] == [2003, 2004]
    assert content["images"]["a.png"]["species"] == "Larix"
    assert content["reliability"][2] == pytest.approx(
        {"above": 0.7, "up_to": 0.9, "boundaries": 10, "right": 6, "share": 0.6, "confidence": 0.8}
    )
    assert json.loads(json.dumps(content, allow_nan=False)) == content


def test_table_of_files_has_a_row_for_each_scan_and_species(tmp_path: Path) -> None:
    write_csv(tmp_path / "t.csv", evaluation_of_three(tmp_path))
    with (tmp_path / "t.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["row"], row["name"]) for row in rows] == [
        ("scan", "a.png"),
        ("scan", "b.png"),
        ("scan", "c.png"),
        ("species", "Betula"),
        ("species", "Larix"),
        ("all", "all"),
    ]
    assert rows[1]["missed_years"] == "2003 2004"
    assert float(rows[4]["sensitivity"]) == pytest.approx(0.75)
    assert float(rows[2]["width_r"]) == pytest.approx(1.0)


def test_terminal_shows_species_years_and_no_nan(tmp_path: Path) -> None:
    console = Console(width=200, record=True, file=StringIO())
    console.print(*evaluation_parts(evaluation_of_three(tmp_path)), sep="\n")
    text = console.export_text()
    assert "Larix (2)" in text
    assert "all scans (3)" in text
    assert "b.png: missed years 2003, 2004" in text
    assert "–" in text
    assert "nan" not in text


def test_species_come_from_the_label_then_the_mapping_then_the_folder(tmp_path: Path) -> None:
    (tmp_path / "species.yaml").write_text("core_*: Picea abies\nash*: Fraxinus excelsior\n")
    patterns = read_species(tmp_path)
    scan = tmp_path / "larch" / "core_3.png"
    assert species_of(scan, {"species": "Larix decidua"}, patterns) == "Larix decidua"
    assert species_of(scan, {}, patterns, by_folder=True) == "Picea abies"
    assert species_of(scan.with_name("x.png"), {}, patterns, by_folder=True) == "larch"
    assert species_of(scan.with_name("x.png"), {}, patterns) is None
    assert read_species(tmp_path / "larch") == {}


@pytest.mark.parametrize("content", ["- a\n- b\n", "core: [1, 2]\n", "a: [\n"])
def test_species_file_that_is_no_mapping_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "species.yaml").write_text(content)
    with pytest.raises(TruthError, match=r"species\.yaml"):
        read_species(tmp_path)


def circle(radius: float, center: tuple[float, float] = (80.0, 75.0)) -> list[list[float]]:
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    return (np.array(center) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).tolist()


def test_outlines_of_labelme_are_the_rings_of_a_disc(tmp_path: Path) -> None:
    shapes = [{"label": f"ring_{k}", "points": circle(10.0 * k)} for k in range(1, 6)]
    label = tmp_path / "F02a.json"
    label.write_text(json.dumps({"imagePath": "..\\images\\F02a.png", "shapes": shapes}))
    assert find_truth(tmp_path / "elsewhere" / "F02a.png", tmp_path) == label
    rings = [
        {"id": k, "group": 0, "confidence": 1.0, "closed": True, "points": circle(10.0 * k + 1.0)} for k in range(1, 5)
    ]
    figures = evaluate(write_rings(tmp_path, "F02a.png", rings), label)
    assert figures["influence_recall"] == pytest.approx(4 / 5)
    assert figures["influence_precision"] == 1.0
    assert figures["influence_rmse_px"] == pytest.approx(1.0, abs=1e-2)
    assert figures["influence_missed_rings"] == [4]
    assert figures["label_share"] == pytest.approx(100 / 150, abs=0.01)


def test_pith_is_what_is_called_so_or_the_middle_of_the_smallest_ring(tmp_path: Path) -> None:
    label = tmp_path / "d.json"
    shapes = [{"label": "1", "points": circle(30.0)}, {"label": "2", "points": circle(12.0, (82.0, 70.0))}]
    label.write_text(json.dumps({"shapes": shapes}))
    assert pith_of(read_label(label)) == pytest.approx([82.0, 70.0])
    label.write_text(json.dumps({"shapes": [*shapes, {"label": "Pith", "points": [[79.0, 74.0]]}]}))
    assert pith_of(read_label(label)) == pytest.approx([79.0, 74.0])
    assert pith_of({"rings": [{"points": circle(12.0)}]}) is None


def test_centroid_is_of_the_area_and_not_of_the_points() -> None:
    crowded = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0], [0.0, 1.5], [0.0, 1.0], [0.0, 0.5]]
    assert centroid(crowded) == pytest.approx([2.0, 1.0])
    assert centroid([[1.0, 2.0], [3.0, 2.0]]) == pytest.approx([2.0, 2.0])


@pytest.mark.parametrize("shapes", [[{"label": "1"}], [{"points": "x"}], 3, [7]])
def test_labelme_file_without_points_is_named(tmp_path: Path, shapes: Any) -> None:
    label = tmp_path / "odd.json"
    label.write_text(json.dumps({"shapes": shapes}))
    with pytest.raises(TruthError, match=r"odd\.json.*points"):
        read_label(label)


def test_disc_with_few_rays_is_judged_along_them_and_says_why_not_by_area(tmp_path: Path) -> None:
    label = write_core(tmp_path, "d.png", kind="disc")
    judgement = judge(tmp_path / "rings.json", label)
    assert judgement.figures()["f"] == 1.0
    assert judgement.disc is None
    assert "at least 4" in judgement.note


def test_command_prints_and_writes_the_figures_of_a_labelled_core(tmp_path: Path) -> None:
    write_sample(tmp_path, SIZE, names=("core",))
    (tmp_path / "core.truth.npz").unlink()  # or the scene would be judged by it
    (tmp_path / "pipeline.yaml").write_text("scans: core.png\noutput: out\n")
    (tmp_path / "out" / "core").mkdir(parents=True)
    paths = json.loads((tmp_path / "core.json").read_text())["paths"]
    rings = [
        {"id": k, "confidence": 0.6, "closed": False, "points": [[x, y - 3], [x, y + 3]]}
        for k, (x, y) in enumerate(place for path in paths for place in path["positions"])
    ]
    write_rings(tmp_path / "out" / "core", "core.png", rings)
    runner = CliRunner()
    config, table = str(tmp_path / "pipeline.yaml"), str(tmp_path / "t.csv")
    done = runner.invoke(app, ["evaluate", config, "--json", "--csv", table, "--species"])
    assert done.exit_code == 0, done.output
    content = json.loads(done.stdout)
    assert content["images"]["core.png"]["sensitivity"] == 1.0
    assert list(content["pooled"]) == [tmp_path.name, "all"]
    assert Path(table).read_text().count("\n") == 4
    assert "core.png" in runner.invoke(app, ["evaluate", config]).stdout
    wrong = runner.invoke(app, ["evaluate", config, "--labels", str(tmp_path / "absent")])
    assert wrong.exit_code == 2
