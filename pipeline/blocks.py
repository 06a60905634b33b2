"""The ``block:`` of the YAML: which scans are faces of one block, and where they lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.block_geometry import BOX_FACES, Plane, box_face, plane_problem, seen_from_inside
from pipeline.discover import find_scans
from pipeline.problems import Problem, did_you_mean, join_path, problem_of

Vector = tuple[float, float, float]
Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class FaceEntry(BaseModel):
    """One face as written: a scan, and a plane or the name of a box's face."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scan: str
    origin: Vector | None = None
    right: Vector | None = None
    down: Vector | None = None
    face: str | None = None
    turn: Literal[0, 90, 180, 270] = 0


class BlockEntry(BaseModel):
    """One block as written."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    faces: Annotated[list[FaceEntry], Field(min_length=1)]
    unit: str = "mm"
    size: tuple[Length, Length, Length] | None = None


@dataclass(frozen=True)
class Block:
    """A checked block.

    Parameters
    ----------
    path
        Stands for the block where scans are named; there is no such file. Its last part is the block's name.
    scans
        Files of the faces.
    planes
        Where each lies, in block units.
    unit
        What these are, in words.
    """

    path: Path
    scans: tuple[Path, ...]
    planes: tuple[Plane, ...]
    unit: str

    @property
    def name(self) -> str:
        """Name of its product folder."""
        return self.path.name


def read_blocks(raw: Any, root: Path) -> tuple[tuple[Block, ...], list[Problem]]:
    """Blocks of the YAML's ``block``, a mapping or a list of mappings, and everything wrong with them.

    Parameters
    ----------
    raw
        As parsed; None when there is none.
    root
        Folder of the YAML.
    """
    if raw is None:
        return (), []
    entries = raw if isinstance(raw, list) else [raw]
    problems: list[Problem] = [] if entries else [Problem("block", "is empty")]
    blocks: list[Block] = []
    for index, entry in enumerate(entries):
        where = join_path("block", index) if isinstance(raw, list) else "block"
        block, found = _read_block(entry, where, root)
        problems += found
        if block is not None:
            blocks.append(block)
            if block.name in [other.name for other in blocks[:-1]]:
                problems.append(Problem(f"{where}.name", f"{block.name!r} is the name of two blocks"))
    return tuple(blocks), problems + _shared_scans(blocks)


def clashing_names(blocks: Sequence[Block], scans: Sequence[Path]) -> list[Problem]:
    """Blocks that would share a product folder with a scan."""
    stems = {scan.stem: scan for scan in scans}
    return [
        Problem(
            "block", f"{block.name!r} is also the name of {stems[block.name].name} without suffix; name it otherwise"
        )
        for block in blocks
        if block.name in stems
    ]


def _read_block(raw: Any, where: str, root: Path) -> tuple[Block | None, list[Problem]]:
    if not isinstance(raw, Mapping):
        return None, [Problem(where, f"expected a mapping with `name` and `faces`, found {raw!r}")]
    try:
        entry = BlockEntry.model_validate(raw)
    except ValidationError as error:
        return None, [_translated(item, where) for item in error.errors()]
    problems = []
    if not entry.name.strip() or entry.name != entry.name.strip() or any(c in entry.name for c in './\\:*?"<>|\0'):
        problems.append(Problem(f"{where}.name", f"cannot name a folder: {entry.name!r} (no dots, slashes, wildcards)"))
    scans, planes = [], []
    for index, face in enumerate(entry.faces):
        here = join_path(f"{where}.faces", index)
        scan, problem = _scan_of(face.scan, root)
        problems += [Problem(f"{here}.scan", problem)] if problem else []
        plane, found = _plane_of(face, entry.size, here, where)
        problems += found
        if scan is not None:
            scans.append(scan)
        if plane is not None:
            planes.append(plane)
    if len(planes) == len(entry.faces):
        problems += [
            Problem(
                join_path(f"{where}.faces", number),
                "shows the block from inside: `right` x `down` points away from the other faces "
                "(a mirrored photograph, `right` and `down` exchanged, or a left-handed frame)",
            )
            for number in seen_from_inside(planes)
        ]
        if entry.size is not None and not any(face.face for face in entry.faces):
            problems.append(Problem(f"{where}.size", "is only for faces of a box, given by `face`"))
    if problems:
        return None, list(dict.fromkeys(problems))
    return Block(root / entry.name, tuple(scans), tuple(planes), entry.unit), []


def _plane_of(
    face: FaceEntry, size: tuple[float, float, float] | None, here: str, where: str
) -> tuple[Plane | None, list[Problem]]:
    """Plane of a face, or what is wrong with how it is said."""
    given = [name for name in ("origin", "right", "down") if getattr(face, name) is not None]
    if face.face is not None:
        problems = []
        if given:
            problems.append(Problem(here, f"has both `face` and `{given[0]}`, expected one of them"))
        if face.face not in BOX_FACES:
            told = f"no such face: {face.face}" + did_you_mean(face.face, BOX_FACES)
            problems.append(Problem(f"{here}.face", told))
        if size is None:
            problems.append(Problem(f"{where}.size", "is missing: [width, height, depth] of the box"))
        return (None, problems) if problems or size is None else (box_face(face.face, size).turned(face.turn), [])
    if face.turn:
        return None, [Problem(f"{here}.turn", "is only for a face of a box, given by `face`")]
    if face.origin is None or face.right is None or face.down is None:
        missing = [name for name in ("origin", "right", "down") if name not in given]
        if not given:
            return None, [Problem(here, "has no plane: give `origin`, `right` and `down`, or `face`")]
        return None, [Problem(f"{here}.{name}", "is missing") for name in missing]
    plane = Plane(face.origin, face.right, face.down)
    problem = plane_problem(plane)
    return (None, [Problem(here, problem)]) if problem else (plane, [])


def _scan_of(entry: str, root: Path) -> tuple[Path | None, str]:
    """The one file that a face names."""
    found, problems = find_scans(entry, root)
    if problems:
        return None, problems[0].what
    return (found[0], "") if len(found) == 1 else (None, f"{entry!r} names {len(found)} images, expected one")


def _shared_scans(blocks: Sequence[Block]) -> list[Problem]:
    """Scans that are two faces, of one block or of two."""
    problems: list[Problem] = []
    owner: dict[Path, str] = {}
    for block in blocks:
        for scan in block.scans:
            if scan in owner:
                told = "twice a face of" if owner[scan] == block.name else f"a face of {owner[scan]} and of"
                problems.append(Problem("block", f"{scan.name} is {told} {block.name}"))
            owner.setdefault(scan, block.name)
    return problems


def _translated(item: Any, where: str) -> Problem:
    """One of pydantic's errors, with the keys known at its place."""
    is_face = len(item["loc"]) > 1 and item["loc"][0] == "faces"
    model: type[BaseModel] = FaceEntry if is_face else BlockEntry
    problem = problem_of(item, list(model.model_fields))
    rest = problem.where
    return Problem(f"{where}.{rest}" if rest else where, problem.what)
