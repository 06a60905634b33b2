"""Commands: what they print and how they exit."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import draw_scan
from dummy_stages import PRODUCTS, STAGES
from typer.testing import CliRunner

from pipeline.cli import app

Make = Callable[..., Path]
ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def dummies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.project.all_stages", lambda: STAGES)
    monkeypatch.setattr("pipeline.project.all_products", lambda stages: PRODUCTS)
    monkeypatch.setattr("pipeline.commands.write_index", lambda output, rows: None)


def call(*words: object, status: int = 0, keys: str | None = None) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words], input=keys)
    assert result.exit_code == status, result.output
    assert "Traceback" not in result.output
    return result.output


def run(config: Path, *words: object, status: int = 0) -> str:
    return call("run", config, "--scheduler", "threads", *words, status=status)


def test_help_comes_at_once_and_imports_nothing_heavy() -> None:
    script = (
        "import sys; sys.argv = ['woodpipe', '--help']\n"
        "from pipeline.cli import app\n"
        "try: app()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'xarray', 'dask', 'zarr', 'torch', 'cv2', 'stages', 'pydantic', 'OpenImageIO'}\n"
        "print('HEAVY', sorted(heavy & set(sys.modules)))\n"
    )
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    assert "HEAVY []" in done.stdout
    assert "evaluate" in done.stdout
    assert time.perf_counter() - start < 2


def test_a_run_tells_what_ran_and_a_second_one_says_reused_for_each(project: Make) -> None:
    config = project(scans=2)
    first = run(config)
    assert "board_0: level runs: never computed" in first
    assert "board_1.png  done" in first
    second = run(config)
    for stem in ("board_0", "board_1"):
        for name in ("read", "smooth", "level", "summary", "product text"):
            assert f"{stem}: {name} reused" in second
        assert f"{stem}.png  reused" in second


def test_a_bad_scan_is_one_line_of_the_summary_and_exit_status_1(project: Make) -> None:
    config = project(scans=1)
    (config.parent / "scans/text.png").write_text("x")
    told = run(config, status=1)
    lines = [line.split(maxsplit=3) for line in told.splitlines() if line.startswith("text.png ")]
    assert [line[1] for line in lines] == ["failed"]
    assert lines[0][3].strip() == "cannot be opened as a PNG image: it is a text file"


def test_debug_shows_the_traceback_of_a_failed_stage(project: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    config = project(scans=1)
    monkeypatch.setenv("DUMMY_FAIL", "mean")
    assert "level: RuntimeError: no rings here and more detail" in run(config, status=1)
    result = CliRunner().invoke(app, ["run", str(config), "--scheduler", "threads", "--debug"])
    assert "Traceback" in result.output


def test_wrong_usage_is_exit_status_2_with_every_problem(project: Make) -> None:
    config = project(scans=1, more="stages: {levl: {count: 2}}\nfoo: 1\n")
    told = run(config, status=2)
    assert "foo: unknown key" in told
    assert "did you mean 'level'?" in told
    assert "there is no file" in call("plan", config.with_name("no.yaml"), status=2)
    assert "did you mean 'smooth'?" in run(project(scans=1), "--stage", "smoot", status=2)
    assert "expected WxH" in call("sample", config.parent / "s", "--size", "big", status=2)
    assert "multiple of 1024" in run(project(scans=1), "--tile", "1000", status=2)


def test_plan_and_status_tell_what_is_there(project: Make) -> None:
    config = project(scans=1)
    assert "never computed" in call("plan", config)
    run(config, "--until", "smooth")
    assert call("plan", config).count("reused") == 2
    line = next(line for line in call("status", config).splitlines() if line.startswith("board_0.png"))
    assert line.count("done") == 2
    assert line.count("to run") == 3


def test_stages_lists_parameters_with_defaults_and_help() -> None:
    told = call("stages")
    assert "radius: 2" in told
    assert "Half width of the box, px." in told
    assert "radius" in json.loads(call("stages", "--json"))["smooth"]["properties"]


def test_show_names_products_and_results(project: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    config = project(scans=1)
    run(config)
    monkeypatch.chdir(config.parent)
    known = json.loads(call("show", "board_0", "--json"))
    assert Path(known["products"]["text"]).read_text().startswith("board_0.png")
    assert Path(known["stages"]["level"]["result"]).is_dir()
    assert known["stages"]["level"]["params"] == {"count": 5, "label": "mean"}
    assert known["stages"]["smooth"]["warnings"] == ["smooth was here"]
    assert json.loads(call("show", "scans/board_0.png", "--output", "out", "--json")) == known
    assert "count=5" in call("show", "board_0.png")
    assert "did you mean 'board_0'?" in call("show", "bord_0", status=2)


def test_clean_removes_only_what_no_config_reaches_and_says_so_first(project: Make) -> None:
    config = project(scans=1)
    run(config)
    assert "nothing to remove" in call("clean", config)
    config.write_text(config.read_text() + "stages: {level: {count: 3}}\n")
    run(config)
    other = config.with_name("other.yaml")
    other.write_text("scans: scans\noutput: out\nstages: {level: {count: 4}}\n")
    run(other)
    told = call("clean", config, status=1, keys="n\n")
    assert told.count("  level  ") == 1
    assert told.count("  summary  ") == 1
    assert "removed 2 of 2 results" in call("clean", config, "--yes")
    assert {"reused"} == {word for word in run(other).split() if word in ("reused", "done")}
    other.unlink()
    assert "removed 2 of 2 results" in call("clean", config, "--yes")
    assert "level reused" in run(config)


def test_a_second_run_of_a_changed_folder_computes_only_the_new_scan(project: Make) -> None:
    config = project(scans=1)
    run(config)
    draw_scan(config.parent / "scans/new.png", seed=7)
    told = run(config)
    assert "board_0.png  reused" in told
    assert "new.png      done" in told


def test_in_a_terminal_the_progress_is_a_line_per_scan(project: Make) -> None:
    import io

    from rich.console import Console

    from pipeline.plan import Selection
    from pipeline.progress import LiveTable, reporter_for
    from pipeline.project import Project

    config = project(scans=2)
    (config.parent / "scans/text.png").write_text("x")
    for expected in ("5/5", "board_1: read, smooth, level, summary, product text reused"):
        told = io.StringIO()
        console = Console(file=told, force_terminal=True, width=100, color_system=None)
        reporter = reporter_for(console)
        assert isinstance(reporter, LiveTable)
        Project.load(config).run(Selection(), reporter, {"scheduler": "threads"})
        assert expected in told.getvalue()
