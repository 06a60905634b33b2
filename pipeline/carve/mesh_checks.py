"""What a mesh file promises, looked at before anything is parsed: broken and hostile files end here, in one line."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from pipeline.problems import Problem, UsageError

#: More triangles than this are refused: their atlas would be all seams, and their parsing all memory.
MOST_TRIANGLES = 5_000_000

#: Larger files are refused unread.
MOST_BYTES = 2_000_000_000

_SUFFIXES = (".obj", ".ply", ".stl", ".glb")
_HEADER = 65_536
_CHUNK = 1 << 24


def mesh_error(path: Path, what: str) -> UsageError:
    """An error about a mesh file."""
    return UsageError("The mesh cannot be used", [Problem(str(path), what)])


def check_mesh_file(path: Path) -> str:
    """Return the kind of a mesh file (``"obj"``, ``"ply"``, ``"stl"``, ``"glb"``) after a look at its header.

    Raises
    ------
    UsageError
        When the file is missing, empty, of another kind, or promises more than it holds or than can be carved.
    """
    if not path.is_file():
        raise mesh_error(path, "there is no such file; give an .obj, .ply, .stl or .glb file")
    kind = path.suffix.lower()
    if kind not in _SUFFIXES:
        raise mesh_error(path, f"ends in {kind or 'nothing'}; expected {', '.join(_SUFFIXES)}. Export it as .glb")
    size = path.stat().st_size
    if size == 0:
        raise mesh_error(path, "is empty")
    if size > MOST_BYTES:
        raise mesh_error(path, f"has {size:,} bytes; at most {MOST_BYTES:,} are read. Simplify the mesh")
    with path.open("rb") as file:
        head = file.read(_HEADER)
    if head.startswith(b"PK"):
        raise mesh_error(path, f"is a zip archive, not {kind}; unpack it, and give the mesh inside")
    {".obj": _check_obj, ".ply": _check_ply, ".stl": _check_stl, ".glb": _check_glb}[kind](path, head, size)
    return kind[1:]


def _limit(path: Path, triangles: int) -> None:
    if triangles > MOST_TRIANGLES:
        raise mesh_error(path, f"has {triangles:,} triangles; at most {MOST_TRIANGLES:,} are read. Simplify the mesh")


def _check_obj(path: Path, head: bytes, size: int) -> None:
    counts = {b"v": 0, b"f": 0}
    with path.open("rb") as file:
        # A line may be cut by the end of a chunk, so its last bytes are looked at again with the next.
        rest = b"\n"
        while chunk := file.read(_CHUNK):
            text = rest + chunk
            for kind in counts:
                counts[kind] += sum(text.count(b"\n" + kind + gap) for gap in (b" ", b"\t"))
            rest = text[-2:]
    if b"\0" in head or not counts[b"v"]:
        raise mesh_error(path, "does not look like an .obj: it has no line with a vertex (`v x y z`)")
    if not counts[b"f"]:
        raise mesh_error(path, "has no faces; expected lines such as `f 1 2 3`")
    _limit(path, max(counts[b"f"], counts[b"v"] // 3))


def _check_ply(path: Path, head: bytes, size: int) -> None:
    if not head.startswith(b"ply") or b"end_header" not in head:
        raise mesh_error(path, "does not begin with the header of a .ply")
    counts = {}
    for line in head[: head.index(b"end_header")].splitlines():
        words = line.split()
        if words[:1] == [b"element"]:
            if len(words) != 3 or not words[2].isdigit():
                raise mesh_error(path, f"has a broken header: {line[:60]!r}")
            counts[words[1]] = int(words[2])
    if not counts.get(b"face"):
        raise mesh_error(path, "has no faces (a point cloud?); expected triangles")
    for name, count in counts.items():
        _limit(path, count if name == b"face" else count // 3)
        # Nothing takes less than a byte for each element.
        if count > size:
            raise mesh_error(path, f"promises {count:,} of `{name.decode(errors='replace')}` in {size:,} bytes")


def _check_stl(path: Path, head: bytes, size: int) -> None:
    if head.lstrip()[:5].lower() == b"solid" and b"facet" in head:
        _limit(path, size // 80)
        return
    if size < 84:
        raise mesh_error(path, "is too short for an .stl")
    (count,) = struct.unpack_from("<I", head, 80)
    if size != 84 + 50 * count:
        held = (size - 84) // 50
        raise mesh_error(path, f"promises {count:,} triangles, but holds {held:,}: cut off, or not an .stl")
    _limit(path, count)


def _check_glb(path: Path, head: bytes, size: int) -> None:
    if head[:4] != b"glTF" or len(head) < 20:
        raise mesh_error(path, "does not begin with the header of a .glb")
    version, length, chunk, kind = struct.unpack_from("<IIII", head, 4)
    if version != 2:
        raise mesh_error(path, f"is glTF {version}; expected 2")
    if length != size or kind != 0x4E4F534A or chunk > size - 20:
        raise mesh_error(path, f"promises {length:,} bytes, but holds {size:,}: cut off or broken")


def plain_glb(path: Path) -> bytes:
    """A .glb without pictures and materials, checked: nothing outside of it is read, nothing is unpacked.

    Raises
    ------
    UsageError
        When it refers to other files, needs an unpacker, or promises more than it holds.
    """
    data = path.read_bytes()
    (chunk,) = struct.unpack_from("<I", data, 12)
    try:
        tree = json.loads(data[20 : 20 + chunk])
        _check_tree(path, tree, len(data))
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError) as error:
        if isinstance(error, UsageError):
            raise
        raise mesh_error(path, f"has a broken description ({type(error).__name__}: {error})") from None
    for name in ("images", "textures", "materials", "samplers", "animations", "skins", "cameras", "extensions"):
        tree.pop(name, None)
    for mesh in tree["meshes"]:
        for primitive in mesh["primitives"]:
            for name in ("material", "targets", "extensions"):
                primitive.pop(name, None)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + chunk :]
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


def _check_tree(path: Path, tree: dict[str, Any], size: int) -> None:
    packed = set(tree.get("extensionsRequired", [])) & {
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
        "KHR_meshopt_compression",
    }
    if packed:
        raise mesh_error(path, f"is packed with {sorted(packed)[0]}; export it without compression")
    if any("uri" in buffer for buffer in tree.get("buffers", [])):
        raise mesh_error(path, "keeps its data in another file or in text; export it as one binary .glb")
    if sum(int(buffer["byteLength"]) for buffer in tree.get("buffers", [])) > size:
        raise mesh_error(path, "promises more data than it holds: cut off or broken")
    meshes = tree.get("meshes", [])
    if not meshes:
        raise mesh_error(path, "has no faces; expected triangles")
    accessors = tree.get("accessors", [])
    for accessor in accessors:
        if int(accessor["count"]) > 3 * MOST_TRIANGLES:
            raise mesh_error(path, f"promises {accessor['count']:,} values in {size:,} bytes")
    triangles = []
    for mesh in meshes:
        counts = [
            int(accessors[part["indices"] if "indices" in part else part["attributes"]["POSITION"]]["count"]) // 3
            for part in mesh["primitives"]
        ]
        triangles.append(sum(counts))
    # The same mesh may stand in many places.
    uses = [node["mesh"] for node in tree.get("nodes", []) if "mesh" in node]
    _limit(path, sum(triangles[use] for use in uses))
