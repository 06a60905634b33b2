"""Plan and engine: what runs, what is reused, why, and that one scan never stops another."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import dummy_stages
import numpy as np
import pytest
import xarray as xr
from conftest import draw_scan
from dummy_stages import PRODUCTS, STAGES
from test_pipeline_reading import bad_files, truncated

from pipeline.context import ScanRow
from pipeline.layout import Layout
from pipeline.plan import Selection
from pipeline.problems import UsageError
from pipeline.progress import Silent
from pipeline.project import Project
from pipeline.store import open_data, read_meta
from pipeline.wiring import wire
from stages.stage import Variable
from stages.variables import DPI_PIXEL_SIZE

Make = Callable[..., Path]
NAMES = ["read", "smooth", "level", "summary"]


@pytest.fixture(autouse=True)
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], list[str]]:
    """What the dummy stages were called for since the last question."""
    log = tmp_path / "calls.log"
    monkeypatch.setenv("DUMMY_LOG", str(log))

    def called() -> list[str]:
        lines = log.read_text().split() if log.exists() else []
        log.unlink(missing_ok=True)
        return sorted(lines, key=[*NAMES, "product"].index)

    return called


def run(config: Path, stages: Any = STAGES, **options: Any) -> dict[str, ScanRow]:
    tile, workers = options.pop("tile", 2048), options.pop("workers", 2)
    project = Project.load(config, stages, PRODUCTS)
    execution = {"scheduler": "threads", "workers": workers, "tile": tile}
    return {row.scan.name: row for _, row in project.run(Selection(**options), Silent(), execution)}


def reasons(config: Path, stages: Any = STAGES, **options: Any) -> dict[str, str]:
    plan = Project.load(config, stages, PRODUCTS).plan(Selection(**options))[0]
    nodes = {node.stage: f"{node.action}: {node.reason}" for node in plan.stages}
    return nodes | {node.product: f"{node.action}: {node.reason}" for node in plan.products}


def digests(config: Path) -> dict[str, str]:
    """Digest of every result, by stage and key."""
    metas = sorted((config.parent / "out/.woodpipe/results").glob("*/*/meta.json"))
    return {f"{meta.parts[-3]}/{meta.parts[-2]}": json.loads(meta.read_text())["digest"] for meta in metas}


def test_a_second_run_recomputes_nothing(project: Make, calls: Callable[[], list[str]]) -> None:
    config = project(scans=2)
    assert {row.outcome for row in run(config).values()} == {"done"}
    assert calls() == sorted([*NAMES, "product"] * 2, key=[*NAMES, "product"].index)
    assert {row.outcome for row in run(config).values()} == {"reused"}
    assert calls() == []
    assert (config.parent / "out/board_0/text.txt").exists()


def test_nothing_to_do_starts_no_workers(project: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    config = project(scans=1)
    run(config)
    monkeypatch.setattr("pipeline.engine.start_executor", lambda *args: pytest.fail("workers were started"))
    assert run(config)["board_0.png"].outcome == "reused"


def test_a_changed_parameter_reruns_its_stage_and_what_follows_and_nothing_before(
    project: Make, calls: Callable[[], list[str]]
) -> None:
    config = project(scans=1)
    run(config)
    calls()
    config.write_text(config.read_text() + "stages: {level: {count: 3}}\n")
    assert reasons(config) == {
        "read": "reuse: nothing changed",
        "smooth": "reuse: nothing changed",
        "level": "run: parameter `count` of level changed from 5 to 3",
        "summary": "run: level runs before it",
        "text": "run: summary runs before it",
    }
    run(config)
    assert calls() == ["level", "summary", "product"]
    config.write_text("scans: scans\noutput: out\n")
    assert reasons(config)["level"] == "reuse: nothing changed"
    run(config)
    assert calls() == ["product"]


def test_a_changed_version_or_scan_is_named_as_the_reason(project: Make) -> None:
    config = project(scans=1)
    assert reasons(config)["summary"] == "run: never computed"
    run(config)
    newer = (*STAGES[:2], replace(STAGES[2], version=2), STAGES[3])
    assert reasons(config, newer)["level"] == "run: version of level changed from 1 to 2"
    draw_scan(config.parent / "scans/board_0.png", seed=99)
    assert reasons(config)["read"] == "run: the scan's file changed"
    assert reasons(config)["level"] == "run: smooth runs before it"


def test_a_touched_or_renamed_scan_keeps_its_results(project: Make, calls: Callable[[], list[str]]) -> None:
    config = project(scans=1)
    run(config)
    calls()
    scan = config.parent / "scans/board_0.png"
    scan.touch()
    run(config)
    assert calls() == []
    scan.rename(scan.with_name("other.png"))
    assert run(config)["other.png"].outcome == "done"
    assert calls() == ["product"]


def test_forcing_a_stage_reruns_it_and_not_what_follows_if_its_values_stay(
    project: Make, calls: Callable[[], list[str]]
) -> None:
    config = project(scans=1)
    run(config)
    calls()
    assert reasons(config, stage="smooth")["level"] == "check: reused unless smooth gives other values"
    run(config, stage="smooth")
    assert calls() == ["smooth"]


def test_forcing_a_stage_updates_what_follows_if_its_values_change(
    project: Make, calls: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    config = project(scans=1)
    run(config)
    calls()
    monkeypatch.setattr(dummy_stages.np, "exp", lambda wave: np.cos(wave))
    run(config, stage="smooth")
    monkeypatch.undo()
    calls()
    assert {row.outcome for row in run(config).values()} == {"reused"}
    meta = read_meta(Layout(config.parent / "out"), "level", Project.load(config, STAGES, ()).plan()[0].stages[2].key)
    assert meta is not None
    assert meta.input_digests["smooth"] in digests(config).values()


def test_from_until_and_force_choose_stages(project: Make, calls: Callable[[], list[str]]) -> None:
    config = project(scans=1)
    assert run(config, until="smooth")["board_0.png"].outcome == "partly"
    assert calls() == ["read", "smooth"]
    run(config)
    calls()
    run(config, from_stage="level")
    assert calls() == ["level", "summary"]
    run(config, force=True)
    assert calls() == NAMES
    run(config, from_stage="smooth", until="level")
    assert calls() == ["smooth", "level"]


def test_an_unknown_stage_or_scan_is_an_error_with_a_suggestion(project: Make) -> None:
    config = project(scans=2)
    with pytest.raises(UsageError, match=r"no such stage: smoth .did you mean 'smooth'"):
        run(config, stage="smoth", scan="bord_0")
    with pytest.raises(UsageError, match=r"'x.' matches no scan"):
        run(config, scan="x*")
    with pytest.raises(UsageError, match="summary comes after --until level"):
        run(config, stage="summary", until="level")
    assert list(run(config, scan="*_1")) == ["board_1.png"]


def test_a_missing_product_is_made_again_without_its_stages(project: Make, calls: Callable[[], list[str]]) -> None:
    config = project(scans=1)
    run(config)
    calls()
    text = config.parent / "out/board_0/text.txt"
    before = text.read_text()
    text.unlink()
    assert reasons(config)["text"] == "run: text.txt is gone"
    run(config)
    assert calls() == ["product"]
    assert text.read_text() == before
    assert before.splitlines()[:2] == ["board_0.png", "smooth was here"]


def test_a_missing_result_is_computed_again_and_what_follows_is_kept(
    project: Make, calls: Callable[[], list[str]]
) -> None:
    import shutil

    config = project(scans=1)
    run(config)
    calls()
    shutil.rmtree(config.parent / "out/.woodpipe/results/smooth")
    assert reasons(config)["smooth"] == "run: result is gone"
    run(config)
    assert calls() == ["smooth"]


def test_a_failing_scan_leaves_the_others(project: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    config = project(scans=3, more="overrides:\n  - {scans: board_1*, stages: {level: {label: bad}}}\n")
    monkeypatch.setenv("DUMMY_FAIL", "bad")
    rows = run(config)
    assert [row.outcome for row in rows.values()] == ["done", "failed", "done"]
    assert rows["board_1.png"].message == "level: RuntimeError: no rings here and more detail"
    monkeypatch.delenv("DUMMY_FAIL")
    assert [row.outcome for row in run(config).values()] == ["reused", "done", "reused"]


def test_a_failing_product_is_told_and_leaves_the_others(project: Make, tmp_path: Path) -> None:
    config = project(scans=1)
    bad = replace(PRODUCTS[0], name="bad", filename="bad.txt", write=dummy_stages.write_nothing)
    loaded = Project.load(config, STAGES, (bad, *PRODUCTS))
    ((_, row),) = loaded.run(Selection(), Silent(), {"scheduler": "threads"})
    assert row.outcome == "failed"
    assert row.message.startswith("product bad: FileNotFoundError")
    assert row.products == {"text": "text.txt"}
    assert [path.name for path in (tmp_path / "out/board_0").iterdir()] == ["text.txt"]


def test_a_folder_with_bad_files_finishes_the_good_ones_and_says_what_is_wrong(project: Make) -> None:
    config = project(scans=2)
    folder = config.parent / "scans"
    expected = bad_files(folder)
    truncated(draw_scan(folder / "cut.png", 100, 100), 0.6)
    truncated(draw_scan(folder / "cut.tif", 100, 100), 0.6)
    rows = run(config)
    assert {name for name, row in rows.items() if row.outcome == "done"} == {"board_0.png", "board_1.png"}
    for name, message in expected.items():
        assert rows[name].message == message
    for name in ("cut.png", "cut.tif"):
        assert "truncated" in rows[name].message
        assert "\n" not in rows[name].message


def test_two_scans_that_would_share_a_folder_are_both_named(project: Make) -> None:
    config = project(scans=1)
    draw_scan(config.parent / "scans/board_0.tif")
    rows = run(config)
    assert "board_0.tif" in rows["board_0.png"].message
    assert "board_0.png" in rows["board_0.tif"].message


def test_copies_of_one_scan_share_their_results(project: Make, calls: Callable[[], list[str]]) -> None:
    config = project(scans=1)
    scan = config.parent / "scans/board_0.png"
    scan.with_name("copy.png").write_bytes(scan.read_bytes())
    assert {row.outcome for row in run(config).values()} == {"done"}
    assert calls().count("smooth") == 1
    assert (config.parent / "out/copy/text.txt").exists()


def test_the_wiring_is_checked_at_once_before_any_pixel_is_read(project: Make) -> None:
    other = Variable("value", ("y", "x"), "f", "mm", "Not the same.")
    unknown = Variable("sumary", (), "f", "1", "Misspelt.")
    first = replace(STAGES[3], name="first", provides=())
    second = replace(STAGES[2], name="second", requires=(other, unknown), halo=lambda ds, params: 1)
    with pytest.raises(UsageError) as caught:
        wire((first, STAGES[0], second, STAGES[1], STAGES[2], STAGES[3]))
    told = str(caught.value)
    assert "first: requires `value`, which read provides only later" in told
    assert "second: requires another `value` than is provided" in told
    assert "second: requires `sumary`, which nothing provides" in told
    assert "second: is tile-local, but its `level` has no dims y and x" in told
    assert "level: provides `level`, which second provides" in told


def test_a_tiled_stage_equals_the_whole_image(project: Make, tmp_path: Path) -> None:
    config = project(scans=1, size=(1500, 2300), more="stages: {smooth: {radius: 3}}\n")
    other = config.with_name("tiled.yaml")
    other.write_text(config.read_text().replace("output: out", "output: tiled"))
    run(config, tile=4096)
    assert run(other, tile=1024)["board_0.png"].warnings == ("smooth was here",)
    for node in Project.load(config, STAGES, ()).plan()[0].stages:
        whole, tiled = (open_data(Layout(tmp_path / name).result(node.stage, node.key)) for name in ("out", "tiled"))
        xr.testing.assert_equal(whole.load(), tiled.load())
        for name in whole.variables:
            assert whole[name].attrs == tiled[name].attrs
    meta = read_meta(Layout(tmp_path / "tiled"), "smooth", Project.load(other, STAGES, ()).plan()[0].stages[1].key)
    assert meta is not None
    assert meta.figures == {"radius": 3}


def test_an_interrupted_tiled_stage_goes_on_where_it_stopped(
    project: Make, calls: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    config = project(scans=1, size=(1500, 2300))
    run(config, until="read")
    calls()
    from pipeline import tile_tasks

    original, written = tile_tasks._write_core, []

    def fail_at_third(*args: Any) -> None:
        if len(written) == 3:
            raise RuntimeError("disk full")
        written.append(1)
        original(*args)

    monkeypatch.setattr(tile_tasks, "_write_core", fail_at_third)
    assert run(config, tile=1024, workers=1)["board_0.png"].message == "smooth: RuntimeError: disk full"
    assert calls().count("smooth") == 4
    monkeypatch.undo()
    assert reasons(config)["smooth"] == "run: result is incomplete"
    run(config, tile=1024)
    assert len(digests(config)) == 4


def test_a_large_scan_goes_lazily_through_the_first_stage(project: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    config = project(scans=1, size=(1100, 1300))
    run(config)
    eager = digests(config)
    monkeypatch.setattr("pipeline.reading.read_scan.__defaults__", (1000,))
    run(config, force=True)
    assert digests(config) == eager


def test_a_tiled_stage_that_another_run_finished_meanwhile_is_reused(
    project: Make, calls: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    config = project(scans=1, size=(1100, 1100))
    monkeypatch.setenv("DUMMY_SECONDS", "0.1")
    runs = [Thread(target=run, args=(config,), kwargs={"tile": 1024}) for _ in range(2)]
    for thread in runs:
        thread.start()
    for thread in runs:
        thread.join(timeout=30)
        assert not thread.is_alive()
    called = calls()
    assert [called.count(name) for name in NAMES] == [1, 4, 1, 1]


def test_two_runs_at_once_on_one_output_both_finish_and_compute_once(
    project: Make, calls: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    config = project(scans=2)
    monkeypatch.setenv("DUMMY_SECONDS", "0.1")
    results: list[dict[str, ScanRow]] = []
    threads = [Thread(target=lambda: results.append(run(config))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [row.outcome for rows in results for row in rows.values()].count("failed") == 0
    called = calls()
    assert [called.count(name) for name in NAMES] == [2, 2, 2, 2]
    assert len(digests(config)) == 8


def test_a_file_that_changes_during_the_run_is_not_taken_for_what_was_planned(project: Make) -> None:
    config = project(scans=1)
    loaded = Project.load(config, STAGES, PRODUCTS)
    plans = loaded.plan()
    draw_scan(config.parent / "scans/board_0.png", 70, 70)
    from pipeline.engine import Engine

    execution = loaded.config.execution.model_copy(update={"scheduler": "threads"})
    runs = Engine(loaded.config.output, STAGES, PRODUCTS, loaded.wiring, execution, Silent()).run(plans)
    assert runs[0].message == "the file changed during the run; run again"


def test_the_pixel_size_is_an_input_like_any_other() -> None:
    assert DPI_PIXEL_SIZE.name in wire(STAGES).stages["read"]["source"]
