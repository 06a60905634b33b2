"""Parameters that are files: named in the YAML, read for each scan, and an edit reruns what it concerns."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from dummy_stages import LEVEL, SMOOTH, STAGES, stage
from test_pipeline_config import Make

from pipeline.config import load_config
from pipeline.context import ScanRow
from pipeline.input_files import MOST_BYTES
from pipeline.plan import Selection
from pipeline.problems import ScanError, UsageError
from pipeline.progress import Silent
from pipeline.project import Project
from stages.stage import InputFile, Params


class NotedParams(Params):
    """Parameters of `level` with files."""

    notes: tuple[InputFile, ...] = ()
    """Several files."""
    key: InputFile | None = None
    """One file."""
    count: int = 2
    """A number."""


@stage(requires=(SMOOTH,), provides=(LEVEL,), version=1, params=NotedParams)
def level(ds: xr.Dataset, params: NotedParams) -> xr.Dataset:
    """Lengths of the texts."""
    files = [*params.notes, *([params.key] if params.key else [])]
    for file in files:
        if "bad" in file.text:
            raise ValueError(f"{file.name}, line 1: found 'bad'")
    return xr.Dataset({LEVEL.name: LEVEL.array(np.array([float(len(file.text)) for file in files] or [0.0]))})


NOTED = (*STAGES[:2], level, STAGES[3])


def write(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def params_of(config: Path) -> list[Any]:
    loaded = load_config(config, NOTED)
    return [loaded.params(scan, NOTED)["level"] for scan in loaded.scans]


def names(config: Path) -> list[list[str]]:
    return [[file.name for file in params.notes] for params in params_of(config)]


def errors_of(config: Path) -> str:
    with pytest.raises(UsageError) as caught:
        load_config(config, NOTED)
    return str(caught.value)


def run(config: Path) -> dict[str, ScanRow]:
    options = {"scheduler": "threads", "workers": 1}
    return {row.scan.name: row for _, row in Project.load(config, NOTED, ()).run(Selection(), Silent(), options)}


def plan(config: Path) -> dict[str, dict[str, str]]:
    plans = Project.load(config, NOTED, ()).plan(Selection())
    return {plan.stem: {node.stage: f"{node.action}: {node.reason}" for node in plan.stages} for plan in plans}


def test_a_path_gives_what_is_in_the_file_and_stem_stands_for_the_scan(project: Make) -> None:
    config = project(more="stages: {level: {key: shared.txt, notes: 'notes/{stem}.txt'}}\n")
    write(config.parent / "shared.txt", "for all\r\n")
    write(config.parent / "notes/board_1.txt", "for one")
    first, second = params_of(config)
    assert first == NotedParams(key=InputFile(name="shared.txt", text="for all\r\n"))
    assert second.notes == (InputFile(name="board_1.txt", text="for one"),)


def test_absolute_paths_and_lists_and_globs_are_allowed_and_sorted(project: Make, tmp_path: Path) -> None:
    other = write(tmp_path / "elsewhere/x.txt", "x")
    config = project(scans=1, more=f"stages: {{level: {{notes: ['notes/*.txt', '{other}', 'notes/b.txt']}}}}\n")
    for name in ("b", "a"):
        write(config.parent / f"notes/{name}.txt", name)
    assert names(config) == [["a.txt", "b.txt", "x.txt"]]


def test_a_glob_does_not_give_a_scan_the_files_of_one_with_a_longer_name(project: Make) -> None:
    config = project(scans=11, more="stages: {level: {notes: 'notes/{stem}*.txt'}}\n")
    for name in ("board_1", "board_1_north", "board_10", "board_10_north"):
        write(config.parent / f"notes/{name}.txt", name)
    found = dict(zip(sorted(f"board_{i}" for i in range(11)), names(config), strict=True))
    assert found["board_1"] == ["board_1.txt", "board_1_north.txt"]
    assert found["board_10"] == ["board_10.txt", "board_10_north.txt"]
    assert sum(map(len, found.values())) == 4


def test_a_stem_with_glob_characters_stands_for_itself(project: Make) -> None:
    config = project(scans=1, more="stages: {level: {notes: 'notes/{stem}*.txt', key: 'notes/{stem}.txt'}}\n")
    (config.parent / "scans/board_0.png").rename(config.parent / "scans/core[12].png")
    write(config.parent / "notes/core1.txt", "another")
    assert names(config) == [[]]
    write(config.parent / "notes/core[12].txt", "its own")
    assert names(config) == [["core[12].txt"]]
    assert params_of(config)[0].key.text == "its own"


def test_a_missing_file_is_an_error_only_where_it_was_named_in_full(project: Make) -> None:
    assert names(project(more="stages: {level: {notes: 'none/{stem}.txt', key: 'none/{stem}.txt'}}\n")) == [[], []]
    assert names(project(more="stages: {level: {notes: 'none/*.txt'}}\n")) == [[], []]
    more = """
stages: {level: {notes: [a.txt, 'b/*.txt', c.txt], key: scans, count: many}}
overrides:
  - {scans: board_1*, stages: {level: {key: 'k{scan}.txt'}}}
  - {scans: board_0*, stages: {level: {notes: 3}}}
"""
    told = errors_of(project(more=more)).splitlines()
    assert len(told) == 7
    for line, expected in zip(
        told[1:],
        (
            "overrides[0].stages.level.key: '{scan}' is unknown in 'k{scan}.txt', only '{stem}' is replaced",
            "overrides[1].stages.level.notes: expected a path relative to the YAML, found 3",
            "stages.level.count: input should be a valid integer",
            "stages.level.key: 'scans' is not a file",
            "stages.level.notes[0]: there is no file 'a.txt' (looked for ",
            "stages.level.notes[2]: there is no file 'c.txt' (looked for ",
        ),
        strict=True,
    ):
        assert expected in line


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "a NUL character; expected text"),
        (b"\xff\xfewor\xd8", "broken UTF-16"),
        (b"a" * (MOST_BYTES + 1), "is larger than 16 MB, expected a text file"),
        (None, "is not a file, expected a text file"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_line(
    project: Make, content: bytes | None, expected: str
) -> None:
    config = project(scans=1, more="stages: {level: {key: '{stem}.txt'}}\n")
    bad = config.parent / "board_0.txt"
    bad.mkdir() if content is None else write(bad, content)
    with pytest.raises(ScanError) as caught:
        params_of(config)
    assert str(caught.value).startswith(str(bad))
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_does_not_hang_the_plan(project: Make) -> None:
    config = project(scans=1, more="stages: {level: {key: '{stem}.txt'}}\n")
    os.mkfifo(config.parent / "board_0.txt")
    with pytest.raises(ScanError, match="is not a file"):
        params_of(config)


def test_a_text_of_a_windows_program_is_read(project: Make) -> None:
    config = project(scans=1, more="stages: {level: {key: '{stem}.txt'}}\n")
    for content in ("\ufeffBäume".encode(), "Bäume".encode("cp1252")):
        write(config.parent / "board_0.txt", content)
        assert params_of(config)[0].key.text == "Bäume"


def test_an_edited_file_reruns_its_stage_and_what_follows_for_its_scan_only(project: Make) -> None:
    config = project(more="stages: {level: {notes: 'notes/{stem}*.txt'}}\n")
    run(config)
    note = write(config.parent / "notes/board_1.txt", "one")
    rest = dict.fromkeys((stage.name for stage in NOTED), "reuse: nothing changed")
    for change, expected in (
        (lambda: None, "board_1.txt is new"),
        (lambda: write(note, "other"), "board_1.txt was edited"),
        (lambda: write(note.with_name("board_1_b.txt"), "more"), "board_1_b.txt is new"),
        (lambda: note.unlink(), "board_1.txt is gone"),
    ):
        change()
        again = {"level": f"run: parameter `notes` of level: {expected}", "summary": "run: level runs before it"}
        assert plan(config) == {"board_0": rest, "board_1": rest | again}
        rows = run(config)
        assert [rows[f"board_{i}.png"].outcome for i in (0, 1)] == ["reused", "done"]
        assert plan(config) == {"board_0": rest, "board_1": rest}


def test_the_name_of_a_file_changes_nothing(project: Make) -> None:
    config = project(scans=1, more="stages: {level: {key: a.txt}}\n")
    first = write(config.parent / "a.txt", "same")
    run(config)
    first.rename(config.parent / "b.txt")
    config.write_text(config.read_text().replace("a.txt", "b.txt"))
    assert set(plan(config)["board_0"].values()) == {"reuse: nothing changed"}


def test_a_stage_without_files_has_the_key_values_that_it_dumps() -> None:
    assert all(item.params_type().key_values() == item.params_type().model_dump(mode="json") for item in STAGES)


def test_the_schema_asks_for_what_the_yaml_says() -> None:
    schema = NotedParams.model_json_schema()
    assert schema["$defs"]["InputFile"]["type"] == "string"
    assert set(schema["properties"]) == {"notes", "key", "count"}


def test_a_bad_file_fails_its_scan_and_no_other(project: Make) -> None:
    config = project(scans=3, more="stages: {level: {notes: '{stem}.txt'}}\n")
    binary = write(config.parent / "board_0.txt", b"\0")
    write(config.parent / "board_1.txt", "bad")
    rows = run(config)
    assert {name: row.outcome for name, row in rows.items()} == {
        "board_0.png": "failed",
        "board_1.png": "failed",
        "board_2.png": "done",
    }
    assert rows["board_0.png"].message .startswith(f"{binary}: a NUL character; expected text")
    assert rows["board_1.png"].message == "level: ValueError: board_1.txt, line 1: found 'bad'"


def test_texts_are_kept_out_of_what_is_printed(project: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    from pipeline.layout import Layout
    from pipeline.provenance import provenance_of
    from pipeline.tables import make_console, provenance_tables

    config = project(scans=1, more="stages: {level: {key: a.txt}}\n")
    write(config.parent / "a.txt", "a long text")
    run(config)
    console = make_console()
    with console.capture() as capture:
        console.print(*provenance_tables(provenance_of(Layout(config.parent / "out"), "board_0")))
    assert "key=a.txt" in capture.get()
    assert "a long text" not in capture.get()
