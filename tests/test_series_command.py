"""`woodpipe series`, from photographs of drawn cores to the files that dendrochronology exchanges."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from conftest import write_image
from kernel_scenes import SHARED, needs_shared
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.problems import UsageError
from pipeline.series import Exported, parse_formats, parse_unit, write_exports
from woodfit.dendro import boundary_table, coorecorder, formats

SCALE = 0.02
WIDTHS = np.array([52, 47, 55, 41, 38, 44, 50, 36, 42, 47, 39, 45, 40, 37, 43, 41], float)


def draw_core(path: Path, slant_deg: float = 12.0, seed: int = 0) -> Path:
    """Write a photograph of a conifer core, pith to the left, with rings of `WIDTHS` px."""
    rng = np.random.default_rng(seed)
    slant = np.radians(slant_deg)
    y, x = np.mgrid[:110, :800].astype(float)
    edges = 15.0 + np.concatenate([[0.0], np.cumsum(WIDTHS)])
    age = np.interp(x * np.cos(slant) + (y - 55.0) * np.sin(slant), edges, np.arange(len(edges)))
    late = np.clip((age % 1.0 - 0.6) / 0.05, 0.0, 1.0)
    tone = gaussian_filter(0.78 - 0.45 * late, 0.8) + rng.normal(0.0, 0.015, x.shape)
    rgb = np.clip(tone[..., None] * np.array([1.0, 0.85, 0.65]) * 255.0, 0, 255).astype(np.uint8)
    return write_image(path, rgb)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two cores with a scale, one without, one file that is no scan; run once by the first test that asks."""
    root = tmp_path_factory.mktemp("cores")
    (root / "scans").mkdir()
    for seed, name in enumerate(("pine_2001", "pine_1999", "nolength_1990")):
        draw_core(root / "scans" / f"{name}.png", 12.0 - 12.0 * seed, seed)
    (root / "scans" / "text.png").write_text("no photograph")
    (root / "cores.yaml").write_text(
        "scans: scans\noutput: out\n"
        "stages: {ring_series: {year_pattern: '_([0-9]{4})$'}}\n"
        "overrides: [{scans: 'pine*', stages: {scan: {pixel_size_mm: 0.02}}}]\n"
    )
    return root


def run(folder: Path, *words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["series", str(folder / "cores.yaml"), "--scheduler", "threads", *words])
    assert "Traceback" not in result.output
    return result.exit_code, result.output


EVERYTHING = "rwl,pos,boundaries,fh,tridas,csv,csv-long,json"


@pytest.fixture(scope="module")
def exported(folder: Path) -> tuple[int, str, Path]:
    status, told = run(folder, "--to", EVERYTHING, "--out", str(folder / "exported"))
    return status, told, folder / "exported"


def test_every_format_holds_the_widths_and_years_of_every_good_scan(exported: tuple[int, str, Path]) -> None:
    _, _, out = exported
    # Tucson files hold no 0.999, which ends a series.
    for file, exact in (
        ("cores.rwl", 0.0017), ("cores.fh", 0.0006), ("cores.xml", 0.0006), ("cores.csv", 1e-4),
        ("cores-long.csv", 1e-4), ("cores.json", 1e-4),
    ):  # fmt: skip
        series = formats.read(out / file)
        assert len(series) == 2, file
        for one in series:
            stem = f"pine_{one.last_year}"
            document = json.loads((out.parent / "out" / stem / "series.json").read_text())
            measured = [ring["width_mm"] for ring in document["paths"][0]["rings"]]
            npt.assert_allclose(one.width_mm, measured, atol=exact, err_msg=file)


def test_the_drawn_widths_are_measured_at_right_angles(exported: tuple[int, str, Path]) -> None:
    _, _, out = exported
    for one in formats.read(out / "cores.json"):
        assert one.last_year is not None
        error = one.width_mm / SCALE - WIDTHS[-len(one) :]
        assert np.sqrt((error**2).mean()) < 1.0
        assert one.width_mm.sum() / SCALE == pytest.approx(WIDTHS[-len(one) :].sum(), rel=0.01)
        assert one.latewood_mm is not None
        npt.assert_allclose(np.nanmedian(one.latewood_mm / one.width_mm), 0.375, atol=0.05)


def test_earlywood_and_latewood_have_files_of_their_own(exported: tuple[int, str, Path]) -> None:
    _, _, out = exported
    whole, early, late = (formats.read(out / f"cores{end}.rwl") for end in ("", "e", "l"))
    for ring, first, second in zip(whole, early, late, strict=True):
        part = ring.width_mm[np.isin(ring.years, first.years)]
        both = first.width_mm + second.width_mm
        known = np.isfinite(both)
        assert known.sum() > 10
        npt.assert_allclose(both[known], part[known], atol=0.0016)


def test_coorecorder_files_lie_beside_with_dates(exported: tuple[int, str, Path]) -> None:
    _, _, out = exported
    measured = {one.last_year: one for one in formats.read(out / "cores.json")}
    for year in (2001, 1999):
        read = coorecorder.loads((out / f"pine_{year}.pos").read_text())
        assert read.dated == year
        assert Path(read.image).name == f"pine_{year}.png"
        npt.assert_allclose(read.series("x").width_mm, measured[year].width_mm, atol=3e-4)
        (marked,) = boundary_table.loads((out / f"pine_{year}.boundaries.csv").read_text())
        assert len(marked.borders) == len(measured[year]) + 1


def test_one_scan_without_scale_and_one_bad_file_are_told_and_stop_nothing(exported: tuple[int, str, Path]) -> None:
    status, told, out = exported
    assert status == 1
    assert "text.png: cannot be opened" in told
    refused = [line for line in told.splitlines() if line.startswith("nolength_1990.png: ")]
    assert len(refused) == 1
    assert "set `scan.pixel_size_mm`" in refused[0]
    text = (out / "nolength_1990.pos").read_text()
    assert "#DPI 1200" in text
    assert "#C no scale was known" in text
    assert not list(out.glob("*.tmp*"))


def test_a_second_run_reuses_what_is_there_and_writes_the_same(folder: Path, exported: tuple[int, str, Path]) -> None:
    _, _, out = exported
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    status, told = run(folder, "--to", EVERYTHING, "--out", str(out))
    assert status == 1
    assert "ring_series done" not in told
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before


def test_only_the_scans_asked_for_are_written_and_nothing_after_the_series_runs(folder: Path, tmp_path: Path) -> None:
    status, told = run(folder, "--to", "rwl", "--out", str(tmp_path), "--scan", "pine_2001*", "--unit", "0.01")
    assert status == 0
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cores.rwl", "corese.rwl", "coresl.rwl"]
    assert (tmp_path / "cores.rwl").read_text().rstrip().endswith("999")
    assert "pose" not in told


def test_without_a_name_for_the_folder_it_is_in_the_output(folder: Path) -> None:
    status, _ = run(folder, "--to", "csv", "--scan", "pine_2001*")
    assert status == 0
    assert (folder / "out" / "series" / "cores.csv").is_file()


def test_wrong_usage_says_what_there_is(folder: Path) -> None:
    status, told = run(folder, "--to", "rwl,poss")
    assert (status, "did you mean 'pos'?" in told) == (2, True)
    status, told = run(folder, "--unit", "1")
    assert (status, "0.01 or 0.001" in told) == (2, True)
    with pytest.raises(UsageError, match="expected formats"):
        parse_formats(" , ")
    assert parse_formats("RWL, pos,rwl") == ["rwl", "pos"]
    assert parse_unit("0.01") == 0.01


def test_dated_and_floating_series_do_not_share_a_table(exported: tuple[int, str, Path], tmp_path: Path) -> None:
    folder = exported[2].parent
    path = folder / "out" / "pine_2001" / "series.json"
    dated = json.loads(path.read_text())
    floating = json.loads(path.read_text())
    floating["paths"][0] |= {"name": "floating", "first_year": None, "last_year": None}
    for ring in floating["paths"][0]["rings"]:
        ring["year"] = None
    written = Exported()
    documents = {Path("a.png"): dated, Path("b.png"): floating}
    write_exports(documents, ["csv", "rwl"], tmp_path, "all", 0.001, written)
    assert written.problems == []
    assert {file.name for file in written.files} >= {"all.csv", "all-undated.csv", "all.rwl"}
    assert any("start in year 1" in note for note in written.notes)
    assert formats.read(tmp_path / "all-undated.csv")[0].first_year is None


def test_series_of_which_none_is_dated_end_together_in_a_format_that_has_to_say_years(
    exported: tuple[int, str, Path], tmp_path: Path
) -> None:
    documents = {}
    for name, outside in (("a", 0), ("b", 3)):
        document = json.loads((exported[2].parent / "out" / "pine_2001" / "series.json").read_text())
        (path,) = document["paths"]
        path |= {"name": name, "first_year": None, "last_year": None, "unmeasured_outer": outside}
        path["rings"] = [ring | {"year": None} for ring in path["rings"][: -outside or None]]
        documents[Path(f"{name}.png")] = document
    written = Exported()
    write_exports(documents, ["rwl"], tmp_path, "all", 0.001, written)
    assert any("end in one year" in note for note in written.notes)
    whole, short = formats.read(tmp_path / "all.rwl")
    assert (whole.first_year, short.first_year) == (1, 1)
    assert (whole.last_year, short.last_year) == (len(whole), len(whole) - 3)


def test_a_series_that_a_format_cannot_hold_leaves_the_others(exported: tuple[int, str, Path], tmp_path: Path) -> None:
    folder = exported[2].parent
    path = folder / "out" / "pine_2001" / "series.json"
    good, huge = json.loads(path.read_text()), json.loads(path.read_text())
    huge["paths"][0]["name"] = "huge"
    for ring in huge["paths"][0]["rings"]:
        ring["width_mm"] = 5000.0
    written = Exported()
    write_exports({Path("a.png"): good, Path("b.png"): huge}, ["rwl"], tmp_path, "all", 0.001, written)
    assert any("huge" in problem for problem in written.problems)
    assert len(formats.read(tmp_path / "all.rwl")) == 1


@needs_shared
@pytest.mark.shared
def test_the_widths_of_a_real_core_are_those_of_its_labels(tmp_path: Path) -> None:
    label = json.loads((SHARED / "data" / "labels" / "mtreering_001.json").read_text())
    positions = np.array(label["paths"][0]["positions"], float)
    (tmp_path / "core.yaml").write_text(
        f"scans: [{SHARED / 'data' / 'scans' / 'cores' / 'mtreering_001.png'}]\n"
        "output: out\nstages: {scan: {pixel_size_mm: 0.0211667}, ring_series: {outermost_year: 2012}}\n"
    )
    words = ["series", str(tmp_path / "core.yaml"), "--to", "json", "--out", str(tmp_path), "--scheduler", "threads"]
    assert CliRunner().invoke(app, words).exit_code == 0
    (series,) = formats.read(tmp_path / "core.json")
    # The bark is left: labels run from the youngest ring to the oldest.
    labelled = 0.0211667 * np.hypot(*np.diff(positions, axis=0).T)[::-1]
    assert series.last_year == 2012
    assert len(series) == len(labelled)
    assert np.corrcoef(series.width_mm, labelled)[0, 1] > 0.995
    # One px is 0.021 mm, and labels are a px or so off.
    assert np.sqrt(((series.width_mm - labelled) ** 2).mean()) < 0.035
    assert series.latewood_mm is not None
    assert np.isfinite(series.latewood_mm).sum() >= len(series) - 2
    assert 0.2 < float(np.nanmedian(series.latewood_mm / series.width_mm)) < 0.45
