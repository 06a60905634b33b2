"""The page of a block: its faces side by side, each ring on the face it was traced on."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from report_data import Page, fake_context, fake_results

from pipeline.block_geometry import box_face, planes_px
from pipeline.context import ScanRow
from pipeline.probe import Probe
from pipeline.report import write_index, write_scan_report
from pipeline.report.block_place import block_rows, cut_of_face, place_in_block
from pipeline.report.placing import place_of
from pipeline.report.reading import Scan
from pipeline.report.rings import rings_of
from pipeline.report.sheet import block_view
from stages import variables as v
from stages.faces import Faces, join_faces
from woodfit.planes import Planes

NAMES = ("front", "right", "top")
SIZES = ((160, 120), (80, 120), (160, 80))
PER_FACE = (v.RGB, v.VALUE, v.VALID, v.RING_PHASE, v.PHASE_CONFIDENCE, v.FREQUENCY, v.COHERENCE)
RAGGED = (v.RING_X, v.RING_Y, v.VERTEX_COUNT, v.RING_INDEX, v.RING_CONFIDENCE, v.RING_CLOSED, v.RING_GROUP)


def block_of(is_lazy: bool = False) -> xr.Dataset:
    """Results of a box of 16 x 12 x 8 cm with three photographed faces and a pith along x through its middle."""
    parts = []
    for width, height in SIZES:
        whole = fake_results("flat_sawn", (height, width))
        part = whole[[variable.name for variable in (*PER_FACE, *RAGGED, v.PIXEL_SIZE, v.REDUCTION)]]
        part = part.drop_vars([name for name in part.coords if name not in ("y", "x")])
        part[v.RING_GROUP.name] = v.RING_GROUP.array(np.zeros(part.sizes["ring"], int))
        parts.append(part.chunk(y=50, x=50) if is_lazy else part)
    planes, unit = planes_px([box_face(name, (16.0, 12.0, 8.0)) for name in NAMES], [Probe(*size) for size in SIZES])
    joined = join_faces(parts, Faces(planes, SIZES, unit, "cm"))
    matrix = np.eye(4)
    matrix[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    matrix[:3, 3] = [-60, -40, 0]
    plain = {
        v.BOARD_TO_TREE: matrix,
        v.RING_RADIUS: np.arange(12.0) * 9,
        v.POSE_SPREAD: np.array([0.01, 0.01, 2.0, 2.0]),
        v.RING_AGE_SHIFT: np.array([5, 7, -1]),
        v.RING_AGE_SIGN: np.array([1, 1, 1]),
        v.RENDERED: joined[v.RGB.name].values,
    }
    return joined.assign({variable.name: variable.array(value) for variable, value in plain.items()})


@pytest.mark.parametrize("is_lazy", [False, True])
def test_every_pixel_and_ring_of_a_face_keeps_its_place_on_the_face(is_lazy: bool) -> None:
    atlas = block_of(is_lazy)
    sheet, view = block_view(atlas)
    assert view is not None
    tops = atlas[v.FACE_TOP.name].values.astype(int)
    for (left, top), (width, height), start in zip(view.places, view.sizes, tops, strict=True):
        row, column = round(top + 0.5), round(left + 0.5)
        for name in ("rgb", "valid", "ring_phase"):
            shown = sheet[name].values[row : row + height, column : column + width]
            np.testing.assert_array_equal(shown, atlas[name].values[start : start + height, :width])
    face = Planes(atlas[v.FACE_PLANE.name].values, atlas[v.FACE_TOP.name].values).face_of(atlas.ring_y.values)
    places = np.array(view.places)[face] + 0.5
    np.testing.assert_allclose(sheet.ring_x.values - places[:, 0], atlas.ring_x.values)
    np.testing.assert_allclose(sheet.ring_y.values - places[:, 1], atlas.ring_y.values - tops[face])
    frame = Scan(sheet, view).frame
    assert frame is not None
    assert (frame.width, frame.height) == sheet[v.VALID.name].shape[::-1]
    assert 1.0 < frame.width / frame.height < 2.2


def test_nothing_on_the_sheet_between_the_faces_counts_as_wood() -> None:
    sheet, view = block_view(block_of())
    assert view is not None
    covered = np.zeros(sheet[v.VALID.name].shape, bool)
    for (left, top), (width, height) in zip(view.places, view.sizes, strict=True):
        row, column = round(top + 0.5), round(left + 0.5)
        assert not covered[row : row + height, column : column + width].any()
        covered[row : row + height, column : column + width] = True
    assert not sheet[v.VALID.name].values[~covered].any()
    assert sheet[v.RGB.name].values[~covered].min() > 0.9


def test_a_single_scan_stays_as_it_is() -> None:
    ds = fake_results()
    same, view = block_view(ds)
    assert same is ds
    assert view is None


def test_the_block_is_the_box_around_its_faces_and_a_lone_face_has_depth() -> None:
    _, view = block_view(block_of())
    assert view is not None
    np.testing.assert_allclose(view.box, [[0, 0, 0], [160, 120, 80]], atol=1e-9)
    lone = view.__class__(view.corners[:1], view.places[:1], view.sizes[:1])
    np.testing.assert_allclose(lone.box, [[0, 0, 0], [160, 120, 48]], atol=1e-9)


def test_rings_are_numbered_alike_on_all_faces() -> None:
    atlas = block_of()
    rings = rings_of(Scan(*block_view(atlas)))
    assert rings is not None
    expected = atlas.ring_index.values + np.array([5, 7, -1])[atlas.ring_group.values]
    assert [ring.index for ring in rings] == expected.tolist()
    assert all(ring.counted for ring in rings)


def test_the_pith_is_told_in_the_frame_of_the_block_and_for_each_face() -> None:
    scan = Scan(*block_view(block_of()))
    place = place_of(scan)
    assert place is not None
    assert scan.block is not None
    in_block = place_in_block(place, scan.block)
    np.testing.assert_allclose(in_block.centre, [80, 60, 40])
    np.testing.assert_allclose(in_block.foot, [80, 60, 40])
    cuts = [cut_of_face(in_block, corners) for corners in scan.block.corners]
    assert [cut for _, cut in cuts] == ["along the stem", "end grain", "along the stem"]
    np.testing.assert_allclose([tilt for tilt, _ in cuts], [0, 90, 0], atol=1e-5)
    rows = block_rows(in_block, scan.block, NAMES, scan.pixel_size, scan.unit)
    assert rows[0]["value"] == "1.000, 0.000, 0.000"
    assert rows[1] == {
        "name": "Its point nearest to the block's middle (x, y, z), cm",
        "value": "8.0, 6.0, 4.0",
        "spread": "± 0.2 cm",
    }


def test_the_page_of_a_block_names_its_faces_and_their_unit(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_scan_report(block_of(), path, fake_context("oak_cube", faces=NAMES))
    text = path.read_text()
    page = Page(text)
    for expected in ("oak_cube", "front", "right", "top", "16 × 12 × 8 cm", "a block of 3 faces", "Re-rendered faces"):
        assert expected in page.text
    assert not re.search(r"\bmm\b", page.text)
    links = set(page.links())
    assert {"../front/rings.json", "../right/rings.json", "../top/rings.json"} <= links
    assert "rings.json" not in links


def test_faces_stand_with_their_block_on_the_overview(tmp_path: Path) -> None:
    rows = [
        ScanRow(Path("a.png"), "a", "done", rings=7, products={"rings": "rings.json"}, block="cube"),
        ScanRow(Path("b.png"), "b", "failed", "is truncated", block="cube"),
        ScanRow(Path("cube"), "cube", "failed", "its face b.png cannot be used: is truncated"),
        ScanRow(Path("c.png"), "c", "done", rings=3),
    ]
    write_index(rows, tmp_path / "index.html")
    page = Page((tmp_path / "index.html").read_text())
    assert "3 scans, 1 block" in page.text
    assert "its face b.png cannot be used: is truncated" in page.text
    assert "a/rings.json" in set(page.links())
    write_index([rows[0], replace(rows[2], outcome="done", message="")], tmp_path / "index.html")
    page = Page((tmp_path / "index.html").read_text())
    assert [attrs["class"] for _, attrs in page.tags if attrs.get("class") == "thumb"] == ["thumb"]
    assert "1 scan, 1 block" in page.text
    assert "a.png, 7 rings" in page.text
    # A face whose block was not asked for stands by itself.
    write_index(rows[:1], tmp_path / "index.html")
    assert "7 rings" in Page((tmp_path / "index.html").read_text()).text
