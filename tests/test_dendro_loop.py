"""From photographs of cores to files, a correction by hand, the series it gives, and crossdating: all by commands."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from woodfit.dendro import coorecorder, formats
from woodfit.synthetic_scenes import encode_png, scene

FORMATS = "pos,rwl,csv,boundaries,tridas,fh"
OUTERMOST = 2000
STAGES = "stages:\n  ring_series: {outermost_year: 2000}\n  ring_tracing: {corrected: 'corrections/{stem}*.pos'}\n"


def draw(path: Path, shade: int = 0, has_scale: bool = True) -> None:
    """Write the drawn core; scans of the same pixels would share their results."""
    drawn = scene("core", (460, 450), 0)
    pixels = drawn.face.rgb_encoded.copy()
    pixels[0, 0] = shade
    path.write_bytes(encode_png(pixels, drawn.dpi if has_scale else None))


def woodpipe(*words: str | Path) -> tuple[int, str]:
    """Exit status and all that was printed."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert "Traceback" not in result.output
    return result.exit_code, result.output


def series(folder: Path, name: str) -> tuple[int, str]:
    config = folder / "cores.yaml"
    return woodpipe("series", config, "--to", FORMATS, "--out", folder / name, "--scheduler", "threads")


def rings(folder: Path) -> list[dict[str, float]]:
    document = json.loads((folder / "out/core/series.json").read_text())
    found: list[dict[str, float]] = document["paths"][0]["rings"]
    return found


def borders(lines: list[str]) -> list[int]:
    """Lines of a .pos file with ring borders, from the bark inwards."""
    return [at for at, line in enumerate(lines) if line[:1].isdigit()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A core, measured and written once."""
    root = tmp_path_factory.mktemp("loop")
    (root / "scans").mkdir()
    (root / "corrections").mkdir()
    draw(root / "scans/core.png")
    (root / "cores.yaml").write_text("scans: scans\noutput: out\n" + STAGES)
    status, told = series(root, "first")
    assert (status, f"open {root}/out/index.html" in told) == (0, True)
    return root


def corrected(folder: Path, lines: list[str], name: str) -> str:
    """Save lines as the correction of the core, measure again into the folder `name`; what was printed."""
    (folder / "corrections/core.pos").write_text("\n".join(lines))
    status, told = series(folder, name)
    assert status == 0
    return told


def test_every_file_tells_the_same_series(folder: Path) -> None:
    widths = np.array([ring["width_mm"] for ring in rings(folder)])
    assert len(widths) > 45
    files = {path.name for path in (folder / "first").iterdir()}
    assert files == {
        "core.pos", "core.boundaries.csv", "cores.rwl", "corese.rwl", "coresl.rwl", "cores.csv", "cores.xml", "cores.fh"
    }  # fmt: skip
    for name, exact in (("cores.rwl", 0.0017), ("cores.csv", 1e-4), ("cores.xml", 6e-4), ("cores.fh", 6e-4)):
        (one,) = formats.read(folder / "first" / name)
        assert (one.name, one.last_year) == ("core", OUTERMOST)
        npt.assert_allclose(one.width_mm, widths, atol=exact, err_msg=name)


def test_a_boundary_deleted_by_hand_reruns_what_follows_and_crossdating_names_its_year(folder: Path) -> None:
    before = np.array([ring["width_mm"] for ring in rings(folder)])
    lines = (folder / "first/core.pos").read_text().splitlines()
    inwards = 24
    del lines[borders(lines)[inwards]]
    told = corrected(folder, lines, "damaged")
    for name in ("scan", "orientation", "curved_gabor"):
        assert f"core: {name} reused" in told
    assert "core: ring_tracing runs: parameter `corrected` of ring_tracing: core.pos is new" in told
    assert "core: ring_series runs: ring_tracing runs before it" in told
    after = np.array([ring["width_mm"] for ring in rings(folder)])
    # The last ring is that of `OUTERMOST`: the boundary that was deleted ended the ring `inwards` years before.
    gone = len(before) - 1 - inwards
    merged = np.delete(before, gone)
    merged[gone] += before[gone]
    npt.assert_allclose(after, merged, atol=0.01)
    for files in (("damaged/core.pos", "--master", "first/cores.rwl"), ("out/core", "--master", "first/cores.csv")):
        status, told = woodpipe("crossdate", *(word if word[0] == "-" else folder / word for word in files))
        assert status == 0
        found = re.search(r"merged rings (\d{4})", told)
        assert found is not None, told
        # Named is the younger of the two rings that became one.
        assert abs(int(found[1]) - (OUTERMOST - inwards + 1)) <= 2


def test_a_ring_called_absent_has_width_0_in_its_year(folder: Path) -> None:
    (folder / "corrections/core.pos").unlink(missing_ok=True)
    assert series(folder, "again")[0] == 0
    before = rings(folder)
    lines = (folder / "first/core.pos").read_text().splitlines()
    inwards = 20
    lines[borders(lines)[inwards]] += "#ZERO1"
    corrected(folder, lines, "absent")
    after = rings(folder)
    assert [ring["year"] for ring in after if ring["width_mm"] == 0.0] == [OUTERMOST - inwards]
    assert [ring["year"] for ring in after] == list(range(before[0]["year"] - 1, OUTERMOST + 1))
    left = [ring["width_mm"] for ring in after if ring["width_mm"] != 0.0]
    npt.assert_allclose(left, [ring["width_mm"] for ring in before], atol=0.002)
    # The file says so again, and CooRecorder's rules give the same years.
    read = coorecorder.loads((folder / "absent/core.pos").read_text()).series("core")
    assert read.years[read.width_mm == 0.0].tolist() == [OUTERMOST - inwards]
    npt.assert_allclose(read.width_mm, [ring["width_mm"] for ring in after], atol=5e-4)
    assert formats.read(folder / "absent/cores.rwl")[0].width_mm[-1 - inwards] == 0.0


def test_each_bad_input_is_told_in_a_line_and_stops_no_other(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "corrections").mkdir()
    for shade, name in enumerate(("core", "core_2", "noscale", "worn")):
        draw(tmp_path / f"scans/{name}.png", shade, name != "noscale")
    (tmp_path / "corrections/worn.pos").write_text("#DENDRO\n#DPI 1200\nSCALE 1\n1,1\n2,x\n")
    paths = [[[20, y], [880, y]] for y in (45, 55)]
    override = f"overrides: [{{scans: core.png, stages: {{ring_series: {{path: {paths}}}}}}}]\n"
    (tmp_path / "cores.yaml").write_text("scans: scans\noutput: out\n" + STAGES + override)
    status, told = series(tmp_path, "written")
    assert status == 1
    lines = told.splitlines()
    for start, reason in (
        ("worn.png: ", "worn.pos, line 5: '2,x'; expected"),
        ("noscale.png: ", "no scale is known"),
        ("core_2.png: ", "core_2 is named as one of core.png"),
    ):
        said = [line for line in lines if line.startswith(start) and reason in line]
        assert len(said) == 1, told
    assert [one.name for one in formats.read(tmp_path / "written/cores.fh")] == ["core_1", "core_2"]
    positions = {path.name for path in (tmp_path / "written").glob("*.pos")}
    assert positions == {"core_1.pos", "core_2.pos", "noscale.pos"}
