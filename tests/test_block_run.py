"""Blocks in a run: faces as their own scans, what sees the block once for all of them, and what runs again."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import dummy_stages
import pytest
from conftest import draw_scan
from dummy_block_stages import PRODUCTS, STAGES

from pipeline.cleaning import all_plans, find_leftovers, reachable_keys
from pipeline.context import ScanRow
from pipeline.layout import Layout
from pipeline.plan import Selection
from pipeline.problems import UsageError
from pipeline.progress import Silent
from pipeline.project import Project
from pipeline.provenance import provenance_of
from pipeline.store import open_data
from pipeline.tables import make_console, plan_table, status_table
from pipeline.wiring import wire
from stages.variables import ENCODED

BLOCK = """\
output: out
block:
  name: cube
  unit: furlong
  size: [8, 6, 4]
  faces:
    - {scan: faces/front.png, face: front}
    - {scan: faces/right.png, face: right}
    - {scan: faces/top.png, face: top, turn: 90}
"""
FACES = ["front", "right", "top"]
FACE_STAGES = ["read", "smooth", "level"]


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A block of three faces: 8 x 6 x 4 units at 10 px per unit."""
    (tmp_path / "faces").mkdir()
    for seed, (name, width, height) in enumerate((("front", 80, 60), ("right", 40, 60), ("top", 40, 80))):
        draw_scan(tmp_path / f"faces/{name}.png", height, width, seed)
    path = tmp_path / "pipeline.yaml"
    path.write_text(BLOCK)
    return path


@pytest.fixture(autouse=True)
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], list[str]]:
    log = tmp_path / "calls.log"
    monkeypatch.setenv("DUMMY_LOG", str(log))

    def called() -> list[str]:
        lines = log.read_text().split() if log.exists() else []
        log.unlink(missing_ok=True)
        return sorted(lines)

    return called


def run(config: Path, stages: Any = STAGES, **options: Any) -> dict[str, ScanRow]:
    project = Project.load(config, stages, PRODUCTS)
    results = project.run(Selection(**options), Silent(), {"scheduler": "threads", "workers": 2})
    return {row.stem: row for _, row in results}


def nodes(config: Path, name: str, stages: Any = STAGES, **options: Any) -> dict[str, str]:
    plans = {plan.stem: plan for plan in Project.load(config, stages, PRODUCTS).plan(Selection(**options))}
    found = {node.stage: f"{node.action}: {node.reason}" for node in plans[name].stages}
    return found | {node.product: f"{node.action}: {node.reason}" for node in plans[name].products}


def result(config: Path, name: str, stage: str) -> Any:
    plans = {plan.stem: plan for plan in Project.load(config, STAGES, PRODUCTS).plan()}
    node = next(node for node in plans[name].stages if node.stage == stage)
    return open_data(Layout(config.parent / "out").result(stage, node.key)).load()


def test_faces_run_as_scans_and_the_block_once_for_all(config: Path, calls: Callable[[], list[str]]) -> None:
    rows = run(config)
    assert {stem: row.outcome for stem, row in rows.items()} == dict.fromkeys([*FACES, "cube"], "done")
    assert calls() == sorted([*FACE_STAGES * 3, "levels", "levels", "levels", "place", "summary", "story"])
    out = config.parent / "out"
    assert {path.relative_to(out).as_posix() for path in out.glob("*/*") if ".woodpipe" not in path.parts} == {
        *(f"{face}/levels.txt" for face in FACES),
        "cube/story.txt",
    }
    # 60 + 4 + 60 + 4 + 80 rows
    assert (out / "cube/story.txt").read_text().splitlines() == [
        *("cube", "furlong", "208", "3"),
        *FACES,
        "Every face: smooth was here",
    ]
    assert {row.outcome for row in run(config).values()} == {"reused"}
    assert calls() == []


def test_a_block_knows_where_its_faces_lie(config: Path) -> None:
    run(config)
    places = result(config, "cube", "place")["places"].values.reshape(3, 3, 3)
    half = 0.5
    # Top left, top right, bottom left of each photograph, in px: pixel centres lie half a px inside of the edges.
    assert places[0].tolist() == [[half, half, 0], [80 - half, half, 0], [half, 60 - half, 0]]
    assert places[1].tolist() == [[80, half, half], [80, half, 40 - half], [80, 60 - half, half]]
    # The photograph of the top has to be turned clockwise: its left edge is the far one of the block.
    assert places[2].tolist() == [[80 - half, 0, 40 - half], [80 - half, 0, half], [half, 0, 40 - half]]
    fitted = result(config, "cube", "place")["fitted"]
    front = result(config, "front", "read")["value"]
    top = result(config, "top", "read")["value"]
    assert fitted.values[:60].tolist() == front.values.tolist()
    assert fitted.values[128:, :40].tolist() == top.values.tolist()
    assert not fitted.values[60:64].any()
    assert not fitted.values[:, 40:][64:].any()


def test_a_changed_plane_reruns_only_what_sees_the_block(config: Path, calls: Callable[[], list[str]]) -> None:
    run(config)
    calls()
    config.write_text(BLOCK.replace("unit: furlong", "unit: ell"))
    assert nodes(config, "cube")["place"] == "run: the faces lie elsewhere"
    assert set(nodes(config, "front").values()) == {"reuse: nothing changed"}
    run(config)
    assert calls() == ["place", "story", "summary"]


def test_a_changed_face_reruns_itself_and_the_block(config: Path, calls: Callable[[], list[str]]) -> None:
    run(config)
    calls()
    draw_scan(config.parent / "faces/right.png", 60, 40, seed=99)
    assert nodes(config, "cube")["place"] == "run: read runs before it"
    assert nodes(config, "right")["read"] == "run: the scan's file changed"
    run(config)
    assert calls() == sorted([*FACE_STAGES, "levels", "place", "summary", "story"])


def test_parameters_of_what_sees_the_block_come_by_the_blocks_name(
    config: Path, calls: Callable[[], list[str]]
) -> None:
    run(config)
    calls()
    more = "overrides:\n  - {scans: cube, stages: {place: {shift: 2}}}\n  - {scans: top, stages: {level: {count: 3}}}\n"
    config.write_text(BLOCK + more)
    assert nodes(config, "cube")["place"] == "run: parameter `shift` of place changed from 0.0 to 2.0"
    run(config)
    assert calls() == ["level", "levels", "place", "story", "summary"]
    # The levels of three faces in a row.
    assert result(config, "cube", "summary").attrs == {}
    levels = [result(config, face, "level").sizes["ring"] for face in FACES]
    assert levels == [5, 5, 3]


def test_forcing_and_choosing_stages_reaches_the_block_and_its_faces(
    config: Path, calls: Callable[[], list[str]]
) -> None:
    assert {row.outcome for row in run(config, until="smooth", scan="front").values()} == {"partly"}
    assert {stem: row.outcome for stem, row in run(config, until="level").items()} == dict.fromkeys(FACES, "done")
    assert calls() == sorted([*FACE_STAGES * 3, "levels", "levels", "levels"])
    run(config)
    calls()
    assert nodes(config, "cube", stage="smooth")["summary"] == "check: reused unless level or smooth gives other values"
    run(config, stage="smooth")
    assert calls() == ["smooth"] * 3
    run(config, from_stage="place")
    assert calls() == ["place", "summary"]
    run(config, force=True)
    assert calls() == sorted([*FACE_STAGES * 3, "place", "summary"])
    assert list(run(config, scan="top")) == ["top"]
    assert list(run(config, scan="cu*")) == [*FACES, "cube"]
    with pytest.raises(UsageError, match=r"'cuba' matches no scan .did you mean 'cube'"):
        run(config, scan="cuba")


def test_a_face_whose_values_change_when_forced_makes_the_block_run(
    config: Path, calls: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    run(config)
    monkeypatch.setattr(dummy_stages.np, "array_split", lambda values, count: [values[:1]] * count)
    calls()
    run(config, stage="level")
    assert calls() == ["level"] * 3 + ["levels"] * 3 + ["story", "summary"]


def test_a_failing_face_gives_the_block_one_line_and_leaves_the_rest(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_scan(config.parent / "faces/other.png", seed=7)
    more = "scans: faces\noverrides:\n  - {scans: right, stages: {level: {label: bad}}}\n"
    config.write_text(more + BLOCK)
    monkeypatch.setenv("DUMMY_FAIL", "bad")
    rows = run(config)
    outcomes = {stem: row.outcome for stem, row in rows.items()}
    assert outcomes == {"front": "done", "other": "done", "right": "failed", "top": "done", "cube": "failed"}
    expected = "its face right.png failed: level: RuntimeError: no rings here and more detail"
    assert rows["cube"].message == expected
    monkeypatch.delenv("DUMMY_FAIL")
    assert {row.outcome for stem, row in run(config).items() if stem in ("right", "cube")} == {"done"}


def test_a_face_that_is_no_image_fails_the_block_before_anything_runs(config: Path) -> None:
    (config.parent / "faces/top.png").write_text("not a picture")
    rows = run(config)
    assert [rows[name].outcome for name in (*FACES, "cube")] == ["done", "done", "failed", "failed"]
    assert rows["cube"].message.startswith("its face top.png cannot be used: ")


def test_a_photograph_of_another_shape_than_its_plane_is_told(config: Path) -> None:
    draw_scan(config.parent / "faces/right.png", 40, 60)
    rows = run(config)
    assert rows["right"].outcome == "done"
    assert rows["cube"].message == (
        "right.png is 60×40 px, width over height 1.500, but its plane has 0.667; is it turned by 90 degrees?"
    )


def test_a_scan_beside_the_block_runs_all_stages_as_a_block_of_one_face(config: Path) -> None:
    draw_scan(config.parent / "alone.png", 30, 50)
    config.write_text("scans: [alone.png, faces/front.png]\n" + BLOCK)
    rows = run(config)
    assert rows["alone"].products == {"levels": "levels.txt", "story": "story.txt"}
    assert rows["front"].products == {"levels": "levels.txt"}
    places = result(config, "alone", "place")["places"].values
    assert places.tolist() == [[0, 0, 0], [49, 0, 0], [0, 29, 0]]
    story = (config.parent / "out/alone/story.txt").read_text().splitlines()
    assert story == ["alone.png", "", "30", "1", "smooth was here"]


def test_a_scan_that_becomes_a_face_no_longer_owns_what_the_block_makes(config: Path) -> None:
    config.write_text("scans: faces/front.png\noutput: out\n")
    assert set(run(config)["front"].products) == {"levels", "story"}
    config.write_text(BLOCK)
    rows = run(config)
    assert set(rows["front"].products) == {"levels"}
    assert set(provenance_of(Layout(config.parent / "out"), "front")["stages"]) == set(FACE_STAGES)


def test_show_status_and_clean_know_the_block(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(config)
    layout = Layout(config.parent / "out")
    shown = provenance_of(layout, "cube")
    assert list(shown["faces"]["planes_px"]) == FACES
    assert shown["faces"]["unit"] == "furlong"
    assert shown["faces"]["pixel_size"] == pytest.approx(0.1)
    assert set(shown["stages"]) == {"place", "summary"}
    json.dumps(shown)
    project = Project.load(config, STAGES, PRODUCTS)
    console = make_console()
    console.print(plan_table(project.plan()), status_table(project.plan()))
    told = capsys.readouterr().out
    rows = [line.split() for line in told.splitlines() if line.startswith("cube")]
    assert ["cube", "done", "done", "done"] in rows
    assert "read" in told
    plans = project.plan()
    assert find_leftovers(layout, reachable_keys(plans)) == []
    other = config.with_name("other.yaml")
    other.write_text(BLOCK.replace("size: [8, 6, 4]", "size: [16, 12, 8]"))
    left = find_leftovers(layout, reachable_keys(all_plans(layout, [other], STAGES)))
    assert {leftover.stage for leftover in left} == {"place", "summary"}


def test_two_blocks_run_side_by_side(config: Path) -> None:
    for seed, name in enumerate(("one", "two")):
        draw_scan(config.parent / f"{name}.png", 20, 30, seed)
    plane = "origin: [0, 0, 0], right: [3, 0, 0], down: [0, 2, 0]"
    blocks = "".join(f"  - {{name: b_{n}, faces: [{{scan: {n}.png, {plane}}}]}}\n" for n in ("one", "two"))
    config.write_text(f"output: out\nblock:\n{blocks}")
    rows = run(config)
    assert list(rows) == ["one", "two", "b_one", "b_two"]
    assert {row.outcome for row in rows.values()} == {"done"}


def test_equal_planes_and_copies_of_the_faces_share_the_results(config: Path, calls: Callable[[], list[str]]) -> None:
    run(config)
    calls()
    shutil.copytree(config.parent / "faces", config.parent / "copies")
    for path in sorted((config.parent / "copies").iterdir()):
        path.rename(path.with_name(f"copy_{path.name}"))
    text = BLOCK.replace("faces/", "copies/copy_").replace("name: cube", "name: again")
    config.write_text(text)
    run(config)
    assert calls() == ["levels", "levels", "levels", "story"]


def test_what_sees_one_face_at_a_time_cannot_ask_for_what_sees_the_block() -> None:
    wrong = replace(STAGES[4], name="wrong", sees_block=False, provides=())
    other = replace(STAGES[3], name="other", requires=(ENCODED,), provides=())
    with pytest.raises(UsageError) as caught:
        wire((*STAGES[:4], wrong, other))
    assert "wrong: sees one face at a time, but requires `places` of place; declare it" in str(caught.value)
    assert "other: sees a block, but requires `encoded` of the scan's file" in str(caught.value)


@pytest.mark.slow
def test_a_killed_run_of_a_block_is_resumed(config: Path, calls: Callable[[], list[str]]) -> None:
    driver = (
        f"import sys; sys.path[:0] = [{str(Path(__file__).parent)!r}, {str(Path(__file__).parents[1])!r}]\n"
        "from pathlib import Path\n"
        "from dummy_block_stages import PRODUCTS, STAGES\n"
        "from pipeline.plan import Selection\nfrom pipeline.progress import Silent\n"
        "from pipeline.project import Project\n"
        f"project = Project.load(Path({str(config)!r}), STAGES, PRODUCTS)\n"
        "project.run(Selection(), Silent(), {'scheduler': 'threads'})\n"
    )
    environment = {**os.environ, "DUMMY_SECONDS": "0.4"}
    process = subprocess.Popen([sys.executable, "-c", driver], env=environment)
    out = config.parent / "out/.woodpipe/results"
    deadline = time.monotonic() + 60
    while not list(out.glob("place/*/meta.json")) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    calls()
    rows = run(config)
    assert {row.outcome for row in rows.values()} <= {"done", "reused"}
    assert "read" not in calls()
    assert {row.outcome for row in run(config).values()} == {"reused"}
