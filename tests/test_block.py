"""The geometry of blocks: boxes, planes, what is refused, and how the YAML says it."""

import json
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import draw_scan
from dummy_stages import STAGES
from hypothesis import given
from hypothesis import strategies as st
from kernel_scenes import SHARED, needs_shared

from pipeline.block_geometry import BOX_FACES, Plane, box_face, plane_problem, planes_px, seen_from_inside
from pipeline.config import load_config
from pipeline.probe import Probe
from pipeline.problems import UsageError

SIZES = st.tuples(*(st.floats(0.5, 500.0) for _ in range(3)))
TURNS = st.sampled_from([0, 90, 180, 270])


def corner_set(plane: Plane) -> set[tuple[float, ...]]:
    return {tuple(np.round(corner, 9)) for corner in plane.corners}


@given(SIZES)
def test_adjacent_faces_of_a_box_share_an_edge_and_opposite_ones_no_point(size: tuple[float, float, float]) -> None:
    opposite = {frozenset(pair) for pair in (("front", "back"), ("left", "right"), ("top", "bottom"))}
    for one, other in combinations(BOX_FACES, 2):
        shared = corner_set(box_face(one, size)) & corner_set(box_face(other, size))
        assert len(shared) == (0 if {one, other} in opposite else 2)


@given(SIZES)
def test_every_face_of_a_box_is_seen_from_outside_in_a_right_handed_frame(size: tuple[float, float, float]) -> None:
    middle = np.array(size) / 2
    for name in BOX_FACES:
        plane = box_face(name, size)
        inward = plane.inward / np.linalg.norm(plane.inward)
        depth = (middle - plane.corners) @ inward
        extent = np.abs(inward) @ np.array(size)
        np.testing.assert_allclose(depth, extent / 2)
        assert plane_problem(plane) == ""


def test_up_stays_up_around_the_box_and_top_and_bottom_meet_the_front() -> None:
    size = (40.0, 30.0, 20.0)
    for name in ("front", "back", "left", "right"):
        assert box_face(name, size).down == (0, 30, 0)
    front = box_face("front", size).corners
    top, bottom = box_face("top", size).corners, box_face("bottom", size).corners
    np.testing.assert_array_equal(top[[3, 2]], front[[0, 1]])
    np.testing.assert_array_equal(bottom[[0, 1]], front[[3, 2]])
    # Walking round to the right: the right edge of each face is the left edge of the next.
    ring = ["front", "right", "back", "left", "front"]
    for one, following in pairwise(ring):
        np.testing.assert_array_equal(box_face(one, size).corners[[1, 2]], box_face(following, size).corners[[0, 3]])


@given(SIZES, st.sampled_from(BOX_FACES), TURNS)
def test_a_turned_photograph_lies_on_the_same_rectangle_pixel_by_pixel(
    size: tuple[float, float, float], name: str, turn: int
) -> None:
    upright = box_face(name, size)
    turned = upright.turned(turn)
    assert corner_set(turned) == corner_set(upright)
    np.testing.assert_allclose(turned.inward, upright.inward)
    # A photograph whose pixels hold their places in the wood: turning its array clockwise has to give the upright one.
    rows, columns = 3, 4

    def places(plane: Plane, shape: tuple[int, int]) -> np.ndarray:
        (vectors,), unit = planes_px([plane], [Probe(shape[1], shape[0])])
        origin, right, down = (np.array(vector) * unit for vector in vectors)
        y, x = np.mgrid[: shape[0], : shape[1]]
        return origin + x[..., None] * right + y[..., None] * down

    seen = places(upright, (rows, columns))
    photograph = places(turned, (columns, rows) if turn in (90, 270) else (rows, columns))
    scale = max(size)
    np.testing.assert_allclose(np.rot90(photograph, -turn // 90), seen, atol=1e-9 * scale)


@given(SIZES, st.lists(st.sampled_from(BOX_FACES), min_size=2, max_size=6, unique=True), st.data())
def test_a_mirrored_face_is_noticed_and_the_right_ones_are_not(
    size: tuple[float, float, float], names: list[str], data: st.DataObject
) -> None:
    planes = [box_face(name, size) for name in names]
    assert seen_from_inside(planes) == []
    number = data.draw(st.integers(0, len(names) - 1))
    plane = planes[number]
    corner = plane.corners[1]
    planes[number] = Plane(tuple(corner), tuple(-np.array(plane.right)), plane.down)
    assert seen_from_inside(planes) == [number]


def test_a_cut_through_the_block_may_be_photographed_from_either_side() -> None:
    planes = [box_face(name, (10.0, 10.0, 10.0)) for name in BOX_FACES]
    cut = Plane((2, 0, 0), (6, 0, 10), (0, 10, 0))
    mirrored = Plane((8, 0, 10), (-6, 0, -10), (0, 10, 0))
    assert seen_from_inside([*planes, cut]) == seen_from_inside([*planes, mirrored]) == []


def test_one_px_of_the_block_is_one_of_the_first_photograph_and_pixel_centres_lie_half_a_px_inside() -> None:
    front, right = box_face("front", (40.0, 30.0, 20.0)), box_face("right", (40.0, 30.0, 20.0))
    (first, second), unit = planes_px([front, right], [Probe(400, 300), Probe(50, 75)])
    assert unit == pytest.approx(0.1)
    np.testing.assert_allclose(first, [[0.5, 0.5, 0], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(second, [[400, 2, 2], [0, 0, 4], [0, 4, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("right", "down", "told"),
    [
        ((1, 0, 0), (0, 0, 0), "has no area"),
        ((1, 0, 0), (0.2, 1, 0), "stand at 78.7 degrees, expected 90"),
        ((1, 0, float("nan")), (0, 1, 0), "expected finite numbers"),
        ((1, 0, 0), (0.04, 1, 0), ""),
    ],
)
def test_planes_that_are_no_rectangles_are_refused(
    right: tuple[float, float, float], down: tuple[float, float, float], told: str
) -> None:
    assert told in plane_problem(Plane((0, 0, 0), right, down))
    assert bool(told) == bool(plane_problem(Plane((0, 0, 0), right, down)))


@pytest.fixture
def faces(tmp_path: Path) -> Path:
    for name in ("a", "b", "c"):
        draw_scan(tmp_path / f"{name}.png", 30, 40)
    return tmp_path


def problems_of(folder: Path, text: str) -> list[str]:
    config = folder / "pipeline.yaml"
    config.write_text(f"output: out\n{text}")
    with pytest.raises(UsageError) as caught:
        load_config(config, STAGES)
    return [str(problem) for problem in caught.value.problems]


PLANE = "origin: [0, 0, 0], right: [4, 0, 0], down: [0, 3, 0]"


def test_a_block_is_a_mapping_or_a_list_of_them_and_brings_its_scans(faces: Path) -> None:
    config = faces / "pipeline.yaml"
    one = "{name: cube, size: [4, 3, 2], faces: [{scan: a.png, face: front}, {scan: b.png, face: back, turn: 180}]}"
    config.write_text(f"output: out\nblock: {one}\n")
    (block,) = load_config(config, STAGES).blocks
    assert (block.name, block.unit) == ("cube", "mm")
    assert [scan.name for scan in block.scans] == ["a.png", "b.png"]
    assert block.planes[1] == box_face("back", (4, 3, 2)).turned(180)
    config.write_text(f"scans: c.png\noutput: out\nblock: [{one}, {{name: slab, faces: [{{scan: c.png, {PLANE}}}]}}]\n")
    loaded = load_config(config, STAGES)
    assert [name.name for name in loaded.names] == ["a.png", "b.png", "c.png", "cube", "slab"]
    scans, blocks = loaded.selected("slab")
    assert [scan.name for scan in scans] == ["c.png"]
    assert [block.name for block in blocks] == ["slab"]


def test_everything_wrong_with_a_block_is_told_at_once(faces: Path) -> None:
    text = """\
block:
  - name: a.b
    faces:
      - {scan: gone.png, face: front}
      - {scan: a.png, face: fornt}
      - {scan: b.png}
      - {scan: c.png, origin: [0, 0, 0], right: [1, 0, 0]}
      - {scan: "*.png", origin: [0, 0, 0], right: [1, 0, 0], down: [1, 1, 0]}
      - {scan: c.png, face: top, origin: [0, 0, 0]}
  - {name: two, faces: [{scan: a.png, plain: 3, right: [1, 2]}]}
  - {name: three, faces: []}
  - 17
"""
    told = "\n".join(problems_of(faces, text))
    for expected in (
        "block[0].name: cannot name a folder: 'a.b'",
        "block[0].faces[0].scan: there is no file or folder 'gone.png'",
        "block[0].faces[1].face: no such face: fornt (did you mean 'front'?)",
        "block[0].faces[2]: has no plane: give `origin`, `right` and `down`, or `face`",
        "block[0].faces[3].down: is missing",
        "block[0].faces[4].scan: '*.png' names 3 images, expected one",
        "block[0].faces[4]: `right` and `down` stand at 45.0 degrees, expected 90",
        "block[0].faces[5]: has both `face` and `origin`, expected one of them",
        "block[0].size: is missing: [width, height, depth] of the box",
        "block[1].faces[0].plain: unknown key",
        "block[1].faces[0].right[2]: is missing",
        "block[2].faces: list should have at least 1 item",
        "block[3]: expected a mapping with `name` and `faces`, found 17",
    ):
        assert expected in told


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f"block: {{name: x, faces: [{{scan: a.png, {PLANE}}}, {{scan: a.png, {PLANE}}}]}}", "block: a.png is twice a"),
        (
            f"block: [{{name: x, faces: [{{scan: a.png, {PLANE}}}]}}, {{name: y, faces: [{{scan: a.png, {PLANE}}}]}}]",
            "block: a.png is a face of x and of y",
        ),
        (
            f"block: [{{name: x, faces: [{{scan: a.png, {PLANE}}}]}}, {{name: x, faces: [{{scan: b.png, {PLANE}}}]}}]",
            "block[1].name: 'x' is the name of two blocks",
        ),
        (
            f"block: {{name: b, faces: [{{scan: a.png, {PLANE}}}]}}\nscans: b.png",
            "block: 'b' is also the name of b.png",
        ),
        (f"block: {{name: a, faces: [{{scan: a.png, {PLANE}}}]}}", "block: 'a' is also the name of a.png"),
        (f"block: {{name: x, faces: [{{scan: a.png, {PLANE}, turn: 90}}]}}", "block.faces[0].turn: is only for a face"),
        (
            f"block: {{name: x, size: [1, 2, 3], faces: [{{scan: a.png, {PLANE}}}]}}",
            "block.size: is only for faces of a box",
        ),
        (
            f"block: {{name: x, faces: [{{scan: a.png, {PLANE}}}, {{scan: b.png, origin: [0, 0, 2], "
            "right: [4, 0, 0], down: [0, 3, 0]}]}",
            "block.faces[1]: shows the block from inside",
        ),
        ("block: []", "scans: is missing"),
        ("", "scans: is missing"),
        (
            f"block: {{name: x, faces: [{{scan: a.png, {PLANE}}}]}}\noverrides: [{{scans: y, stages: {{}}}}]",
            "overrides[0].scans: 'y' matches no scan",
        ),
    ],
)
def test_a_block_that_cannot_be_is_told_with_its_place(faces: Path, text: str, told: str) -> None:
    found = problems_of(faces, text)
    assert any(problem.startswith(told) for problem in found), found


CN03 = {
    "A": "origin: [-.5, .5, .5], right: [1, 0, 0], down: [0, -1, 0]",
    "B": "origin: [-.5, .5, -.5], right: [1, 0, 0], down: [0, 0, 1]",
    "C": "origin: [-.5, .5, -.5], right: [0, 0, 1], down: [0, -1, 0]",
    "D": "origin: [-.5, -.5, .5], right: [1, 0, 0], down: [0, 0, -1]",
    "E": "origin: [.5, .5, .5], right: [0, 0, -1], down: [0, -1, 0]",
    "F": "origin: [.5, .5, -.5], right: [-1, 0, 0], down: [0, -1, 0]",
}


@pytest.mark.shared
@needs_shared
def test_rings_labelled_on_a_real_block_meet_on_its_edges(tmp_path: Path) -> None:
    scans = SHARED / "data/scans/blocks/CN03"
    faces = "".join(f"    - {{scan: {scans}/{name}_col.png, {plane}}}\n" for name, plane in CN03.items())
    (tmp_path / "block.yaml").write_text(f"output: out\nblock:\n  name: CN03\n  unit: side\n  faces:\n{faces}")
    (block,) = load_config(tmp_path / "block.yaml", STAGES).blocks
    planes, _ = planes_px(block.planes, [Probe(256, 256)] * 6)
    lifted: dict[str, dict[int, np.ndarray]] = {}
    for name, (origin, right, down) in zip(CN03, planes, strict=True):
        labels = json.loads((SHARED / f"data/labels/CN03_{name}.json").read_text())["rings"]
        for ring in labels:
            points = np.array(ring["points"])
            places = np.array(origin) + points[:, :1] * right + points[:, 1:] * down
            known = lifted.setdefault(name, {})
            known[ring["id"]] = np.concatenate([known.get(ring["id"], places[:0]), places])
    met = {}
    for one, other in combinations(CN03, 2):
        shared = set(lifted[one]) & set(lifted[other])
        nearest = [np.linalg.norm(lifted[one][ring][:, None] - lifted[other][ring], axis=-1).min() for ring in shared]
        met[one + other] = sum(distance < 5.0 for distance in nearest)
    # Each ring crosses an edge at one point; labels are good to about 2 px and stop a few px before it.
    assert [met[pair] for pair in ("BC", "BE", "CD", "DE")] == [8, 9, 8, 9]
    assert met["BD"] == met["CE"] == met["AF"] == 0
