"""Runs on worker processes: killed runs, killed workers, Ctrl-C."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Make = Callable[..., Path]
DRIVER = Path(__file__).with_name("dummy_driver.py")


def start(config: Path, scheduler: str = "local", **environment: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(DRIVER), str(config), scheduler]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command, env=os.environ | environment, start_new_session=True, **pipes)


def values(output: Path) -> dict[str, str]:
    """Digest of the values of every result, and the text of every product."""
    metas = output.glob(".woodpipe/results/*/*/meta.json")
    found = {"/".join(meta.parts[-3:-1]): json.loads(meta.read_text())["digest"] for meta in metas}
    return found | {path.parent.name: path.read_text() for path in output.glob("*/text.txt")}


def undisturbed(config: Path) -> dict[str, str]:
    """Values of a run that nobody kills."""
    other = config.with_name("undisturbed.yaml")
    other.write_text(config.read_text().replace("output: out", "output: undisturbed"))
    driver = start(other, "threads")
    told, _ = driver.communicate()
    assert driver.returncode == 0, told
    return values(config.parent / "undisturbed")


@pytest.mark.parametrize(("scheduler", "kills"), [("threads", 5), ("local", 2)])
def test_a_run_killed_at_random_moments_ends_in_the_values_of_an_undisturbed_run(
    project: Make, scheduler: str, kills: int
) -> None:
    config = project(scans=1, size=(1100, 1100))
    expected = undisturbed(config)
    rng = random.Random(scheduler)
    output = config.parent / "out"
    for _ in range(kills):
        driver = start(config, scheduler, DUMMY_SECONDS="0.1")
        wait_for(output / ".woodpipe/configs.json")
        time.sleep(rng.uniform(0.2, 2.0 if scheduler == "threads" else 5.0))
        os.killpg(driver.pid, signal.SIGKILL) if rng.random() < 0.5 else driver.kill()
        driver.communicate(timeout=20)  # ends only when no worker holds the pipe any more
    driver = start(config, scheduler)
    told, _ = driver.communicate()
    assert driver.returncode == 0, told
    assert values(output) == expected
    assert not list(output.glob(".woodpipe/results/*/*.partial"))


def wait_for(path: Path, seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.02)


def test_a_scan_whose_worker_dies_is_named_and_the_others_are_done(project: Make) -> None:
    config = project(scans=3, more="overrides:\n  - {scans: board_1*, stages: {level: {label: bad}}}\n")
    driver = start(config, DUMMY_DIE="bad")
    told, _ = driver.communicate()
    assert driver.returncode == 1
    assert "board_0.png done" in told
    assert "board_2.png done" in told
    assert "board_1.png failed level: its worker process died 3 times" in told
    assert "Traceback" not in told


def test_ctrl_c_ends_the_run_quietly_and_keeps_what_is_done(project: Make, tmp_path: Path) -> None:
    config = project(scans=2)
    script = tmp_path / "interrupted.py"
    script.write_text(
        f"import signal, sys; sys.path[:0] = [{str(DRIVER.parent)!r}, {str(DRIVER.parents[1])!r}]\n"
        # Where the tests themselves run in the background, children are started deaf to it.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import dummy_driver\nfrom pipeline.cli import told_to_people\n"
        "if __name__ == '__main__':\n    from typer import Exit\n"
        "    try:\n        with told_to_people(): dummy_driver.main()\n"
        "    except Exit as stop: sys.exit(stop.exit_code)\n"
    )
    command = [sys.executable, str(script), str(config)]
    environment = os.environ | {"DUMMY_SECONDS": "1.5"}
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    driver = subprocess.Popen(command, env=environment, start_new_session=True, **pipes)
    results = config.parent / "out/.woodpipe/results/read"
    deadline = time.monotonic() + 120
    while not list(results.glob("*/meta.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert list(results.glob("*/meta.json"))
    os.killpg(driver.pid, signal.SIGINT)
    told, _ = driver.communicate(timeout=30)
    assert driver.returncode == 130, told
    assert "interrupted; what is done is kept" in told
    assert "Traceback" not in told
    assert list(results.glob("*/meta.json"))


def test_an_existing_cluster_is_used_and_a_wrong_address_is_an_error(project: Make) -> None:
    driver = start(project(scans=1), "tcp://127.0.0.1:1")
    told, _ = driver.communicate()
    assert driver.returncode != 0
    assert "scheduler: tcp://127.0.0.1:1" in told
    assert "worker" not in told.splitlines()[-1]
