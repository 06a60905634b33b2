"""Meshes from files: what is sound comes back whole, what is not ends in one clear line and takes no memory."""

import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest

from pipeline.carve.mesh_checks import MOST_TRIANGLES
from pipeline.carve.mesh_files import read_mesh
from pipeline.carve.sample_meshes import SAMPLES, sample_mesh
from pipeline.problems import UsageError
from pipeline.render.solids import volume

trimesh = pytest.importorskip("trimesh")


def tetrahedron() -> Any:
    vertices = [[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 1.5]]
    return trimesh.Trimesh(vertices, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], process=False)


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb"])
def test_a_tetrahedron_comes_back_from_every_format(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"thing.{suffix}"
    tetrahedron().export(path)
    mesh = read_mesh(path)
    assert (len(mesh.faces), mesh.name, mesh.notes) == (4, "thing", ())
    assert volume(mesh.vertices, mesh.faces) == pytest.approx(1.5)


def test_texture_coordinates_of_an_obj_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "quad.obj"
    path.write_text("mtllib no.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt .5 0\nvt .5 .25\nf 1/1 2/2 3/3\n")
    mesh = read_mesh(path)
    assert mesh.uv is not None
    npt.assert_allclose(mesh.uv[mesh.faces[0]], [[0, 0], [0.5, 0], [0.5, 0.25]])


def test_an_obj_may_begin_with_long_comments_in_any_writing(tmp_path: Path) -> None:
    path = tmp_path / "long.obj"
    path.write_bytes("# f\xfcr Holz\n".encode("latin-1") * 20_000 + b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(read_mesh(path).faces) == 1


def test_an_obj_of_too_many_faces_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "huge.obj"
    with path.open("wb") as file:
        file.write(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n")
        for _ in range(52):
            file.write(b"f 1 2 3\n" * 100_000)
    with pytest.raises(UsageError, match="has 5,200,000 triangles"):
        read_mesh(path)


def test_pieces_placed_by_a_glb_are_where_it_says(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for shift in (0.0, 10.0):
        scene.add_geometry(tetrahedron(), transform=trimesh.transformations.translation_matrix([shift, 0, 0]))
    path = tmp_path / "two.glb"
    scene.export(path)
    mesh = read_mesh(path)
    assert len(mesh.faces) == 8
    assert float(np.ptp(mesh.vertices[:, 0])) == pytest.approx(12.0)


@pytest.mark.parametrize("name", SAMPLES)
def test_sample_meshes_are_closed_and_turned_outwards(name: str) -> None:
    mesh = read_mesh(f"sample:{name}")
    assert mesh.notes == ()
    assert volume(mesh.vertices, mesh.faces) > 0.0
    assert len(sample_mesh(name, 32)[1]) < len(mesh.faces)


def test_a_mesh_that_is_open_or_no_manifold_is_carved_with_a_note(tmp_path: Path) -> None:
    body = tetrahedron()
    for faces, said in ((body.faces[:3], "open"), ([*body.faces, [1, 2, 3]], "not a manifold")):
        path = tmp_path / "odd.ply"
        trimesh.Trimesh(body.vertices, faces, process=False).export(path)
        assert any(said in note for note in read_mesh(path).notes)


@pytest.mark.parametrize("stray", [[np.nan] * 3, [1e6, 0, 0]])
def test_vertices_of_no_face_are_left_out(tmp_path: Path, stray: list[float]) -> None:
    body, path = tetrahedron(), tmp_path / "stray.ply"
    trimesh.Trimesh([stray, *body.vertices], body.faces + 1, process=False).export(path)
    mesh = read_mesh(path)
    npt.assert_allclose(np.ptp(mesh.vertices, axis=0), [2, 3, 1.5])
    assert volume(mesh.vertices, mesh.faces) == pytest.approx(1.5)


Spoil = Callable[[Path], None]


def glb(path: Path, change: Callable[[dict[str, Any]], None], length: int | None = None) -> None:
    """A sound GLB with a changed description."""
    data = tetrahedron().export(file_type="glb")
    (size,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + size])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    whole = length or 20 + len(text) + len(rest)
    path.write_bytes(struct.pack("<4sIIII", b"glTF", 2, whole, len(text), 0x4E4F534A) + text + rest)


def stl(path: Path) -> None:
    path.write_bytes(bytes(80) + struct.pack("<I", 100_000_000) + bytes(50))


def ply(path: Path) -> None:
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nelement face 100000000\n"
    path.write_bytes(head.encode() + b"property list uchar int vertex_indices\nend_header\n" + bytes(60))


def ply_of_points(path: Path) -> None:
    path.write_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n")


def zip_bomb(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.usdc", bytes(50_000_000))


def nan_vertices(path: Path) -> None:
    path.write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")


def flat(path: Path) -> None:
    path.write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")


def beyond(path: Path) -> None:
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99\n")


def no_faces(path: Path) -> None:
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")


BAD: dict[str, tuple[str, Spoil, str]] = {
    "missing": ("a.obj", lambda path: None, "there is no such file"),
    "empty": ("a.stl", lambda path: path.write_bytes(b"") and None, "is empty"),
    "no mesh": ("a.png", lambda path: path.write_bytes(b"x") and None, "expected .obj, .ply, .stl, .glb"),
    "no suffix": ("a", lambda path: path.write_bytes(b"x") and None, "ends in nothing"),
    "usdz": ("a.usdz", zip_bomb, "Export it as .glb"),
    "zip as glb": ("a.glb", zip_bomb, "is a zip archive"),
    "text as glb": ("a.glb", lambda path: path.write_text("v 0 0 0\n" * 9) and None, "header of a .glb"),
    "stl header": ("a.stl", stl, "promises 100,000,000 triangles, but holds 1"),
    "ply header": ("a.ply", ply, "has 100,000,000 triangles"),
    "ply points": ("a.ply", ply_of_points, "has no faces"),
    "binary obj": ("a.obj", lambda path: path.write_bytes(bytes(500)) and None, "does not look like an .obj"),
    "nan": ("a.obj", nan_vertices, "1 vertices that are not numbers"),
    "flat": ("a.obj", flat, "has no surface"),
    "beyond": ("a.obj", beyond, "cannot be read as .obj"),
    "no faces": ("a.obj", no_faces, "has no faces"),
    "cut off": ("a.glb", lambda path: glb(path, lambda tree: None, 10**9), "cut off or broken"),
    "draco": (
        "a.glb",
        lambda path: glb(path, lambda tree: tree.update(extensionsRequired=["KHR_draco_mesh_compression"])),
        "export it without compression",
    ),
    "other file": ("a.glb", lambda path: glb(path, lambda t: t["buffers"][0].update(uri="/etc/x")), "in another file"),
    "huge accessor": (
        "a.glb",
        lambda path: glb(path, lambda tree: tree["accessors"][0].update(count=10**9)),
        "promises 1,000,000,000 values",
    ),
    "many copies": (
        "a.glb",
        lambda path: glb(path, lambda tree: tree["nodes"].extend([{"mesh": 0}] * (MOST_TRIANGLES // 3))),
        "Simplify the mesh",
    ),
    "no meshes": ("a.glb", lambda path: glb(path, lambda tree: tree.update(meshes=[])), "has no faces"),
    "nonsense": ("a.glb", lambda path: glb(path, lambda tree: tree.update(accessors=3)), "broken description"),
}


@pytest.mark.parametrize("name", list(BAD))
def test_a_bad_mesh_is_one_clear_line(tmp_path: Path, name: str) -> None:
    file, spoil, said = BAD[name]
    path = tmp_path / file
    spoil(path)
    with pytest.raises(UsageError) as caught:
        read_mesh(path)
    assert len(caught.value.problems) == 1
    assert said in str(caught.value)


def test_an_unknown_sample_names_what_there_is() -> None:
    with pytest.raises(UsageError, match="did you mean 'bowl'"):
        read_mesh("sample:bowll")
