"""Config: two lines are enough, and whatever is wrong is told at once."""

from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import draw_scan
from dummy_stages import STAGES

from pipeline.config import load_config
from pipeline.problems import UsageError

Make = Callable[..., Path]


def errors_of(config: Path) -> str:
    with pytest.raises(UsageError) as caught:
        load_config(config, STAGES)
    return str(caught.value)


def test_two_lines_are_enough(project: Make) -> None:
    config = load_config(project(scans=3), STAGES)
    assert [scan.name for scan in config.scans] == ["board_0.png", "board_1.png", "board_2.png"]
    assert config.output.name == "out"
    assert config.params(config.scans[0], STAGES)["smooth"].model_dump() == {"radius": 2}


def test_every_error_is_told_at_once_with_its_path_and_a_suggestion(project: Make) -> None:
    config = project(
        more="""
outptu: here
stages:
  smoth: {radius: 3}
  smooth: {radus: 3}
  level: {count: many, label: 3}
overrides:
  - scans: board*
    stages: {summary: {power: high}}
  - scans: none_*
    stages: {read: {gain: 2}}
execution: {worker: 2, tile: 100}
"""
    )
    told = errors_of(config)
    for expected in (
        "outptu: unknown key (did you mean 'output'?)",
        "stages.smoth: no such stage (did you mean 'smooth'?)",
        "stages.smooth.radus: unknown key (did you mean 'radius'?)",
        "stages.level.count: input should be a valid integer",
        "stages.level.label: input should be a valid string, found 3",
        "overrides[0].stages.summary.power: input should be a valid number",
        "execution.worker: unknown key (did you mean 'workers'?)",
        "execution.tile: input should be a multiple of 1024, found 100",
        "overrides[1].scans: 'none_*' matches no scan",
    ):
        assert expected in told
    assert told.startswith("pipeline.yaml cannot be used:\n  - ")


def test_an_override_changes_its_scans_only(project: Make) -> None:
    more = "stages: {level: {count: 4}}\noverrides:\n  - {scans: board_1*, stages: {level: {label: other}}}\n"
    config = load_config(project(more=more), STAGES)
    first, second = (config.params(scan, STAGES)["level"].model_dump() for scan in config.scans)
    assert first == {"count": 4, "label": "mean"}
    assert second == {"count": 4, "label": "other"}


def test_an_override_that_matches_no_scan_is_an_error(project: Make) -> None:
    more = "overrides:\n  - {scans: beech*, stages: {level: {count: 3}}}\n"
    assert "overrides[0].scans: 'beech*' matches no scan" in errors_of(project(more=more))


def test_an_error_in_the_base_is_not_repeated_for_each_override(project: Make) -> None:
    more = "stages: {level: {count: x}}\noverrides:\n  - {scans: board*, stages: {level: {label: a}}}\n"
    assert errors_of(project(more=more)).count("valid integer") == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("scans: [a\noutput: out", "not valid YAML"),
        ("", "expected keys `scans` and `output`, found an empty file"),
        ("- a\n- b", "found a list"),
        ("scans: nowhere\noutput: out", "scans: there is no file or folder 'nowhere'"),
        ("scans: [scans, '*.jpg']\noutput: out", "scans[1]: no image matches '*.jpg'"),
        ("output: out", "scans: is missing"),
        ("scans: scans\nscans: scans\noutput: out", "key `scans` is given twice"),
        ("scans: 3\noutput: out", "scans"),
        ("scans: scans\noutput: out\nstages: [a]", "stages: input should be a valid dictionary"),
        ("scans: scans\noutput: out\nstages: {level: 3}", "level"),
    ],
)
def test_a_file_that_is_no_config_is_refused_in_words(project: Make, text: str, expected: str) -> None:
    config = project()
    config.write_text(text)
    assert expected in errors_of(config)


def test_a_missing_config_names_a_similar_file(project: Make) -> None:
    config = project()
    assert "did you mean 'pipeline.yaml'?" in errors_of(config.with_name("pipline.yaml"))


def test_an_empty_folder_is_an_error_that_mentions_subfolders(tmp_path: Path) -> None:
    (tmp_path / "photos" / "inner").mkdir(parents=True)
    config = tmp_path / "c.yaml"
    config.write_text("scans: photos\noutput: out")
    assert "no images in the folder 'photos'; for its subfolders write photos/**/*" in errors_of(config)


def test_a_folder_gives_its_images_whatever_the_case_and_no_hidden_ones(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for name in ("a.png", "b.PNG", ".hidden.png"):
        draw_scan(tmp_path / "x.png").rename(folder / name)
    (folder / "notes.txt").write_text("no scan")
    (folder / "x.tif").mkdir()
    config = tmp_path / "c.yaml"
    config.write_text("scans: photos\noutput: out")
    assert [scan.name for scan in load_config(config, STAGES).scans] == ["a.png", "b.PNG", "x.tif"]


def test_a_glob_goes_into_subfolders_and_leaves_the_output_out(tmp_path: Path) -> None:
    for folder in ("a/b", "out/a", "a/.cache"):
        (tmp_path / folder).mkdir(parents=True)
        draw_scan(tmp_path / folder / "scan.png")
    config = tmp_path / "c.yaml"
    config.write_text("scans: '**/*'\noutput: out")
    assert load_config(config, STAGES).scans == (tmp_path / "a/b/scan.png",)
