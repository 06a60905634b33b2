"""Where the photographed faces of a block lie, from what a person wrote: planes, or names of a box's faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pipeline.probe import Probe
from pipeline.problems import ScanError

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]
Vectors = tuple[Vector, ...]

SKEW_DEG = 3.0
ASPECT_SHARE = 0.03
#: Share of the block's depth below a face by which points may lie above the face's plane: nobody measures exactly.
_ON_PLANE = 0.1


@dataclass(frozen=True)
class Plane:
    """A rectangle in the board frame, block units: the image's outer top-left corner and its two edges."""

    origin: Vector
    right: Vector
    down: Vector

    @property
    def corners(self) -> Array:
        """Top left, top right, bottom right, bottom left; shape (4, 3)."""
        o, r, d = np.array(self.origin), np.array(self.right), np.array(self.down)
        return np.stack([o, o + r, o + r + d, o + d])

    @property
    def inward(self) -> Array:
        """``right x down``: into the wood for a face seen from outside; its length is the area."""
        return np.cross(self.right, self.down)

    def turned(self, degrees: int) -> Plane:
        """Plane of the photograph that has to be turned clockwise by that much to be upright in this one."""
        plane = self
        for _ in range(degrees // 90):
            corner, right = np.array(plane.origin), np.array(plane.right)
            plane = Plane(_vector(corner + right), plane.down, _vector(-right))
        return plane


BOX_FACES = ("front", "back", "left", "right", "top", "bottom")


def box_face(name: str, size: Vector) -> Plane:
    """Plane of a box's face as seen from outside.

    x runs right, y down and z into the wood, all as seen from the front; the front's upper left corner is the
    origin. ``front``, ``back``, ``left`` and ``right`` keep up as up; the lower edge of ``top`` and the upper edge
    of ``bottom`` meet the front.
    """
    w, h, d = size
    return {
        "front": Plane((0, 0, 0), (w, 0, 0), (0, h, 0)),
        "back": Plane((w, 0, d), (-w, 0, 0), (0, h, 0)),
        "left": Plane((0, 0, d), (0, 0, -d), (0, h, 0)),
        "right": Plane((w, 0, 0), (0, 0, d), (0, h, 0)),
        "top": Plane((0, 0, d), (w, 0, 0), (0, 0, -d)),
        "bottom": Plane((0, h, 0), (w, 0, 0), (0, 0, d)),
    }[name]


def plane_problem(plane: Plane) -> str:
    """What is wrong with a plane in itself; empty if nothing is."""
    right, down = np.array(plane.right), np.array(plane.down)
    if not np.isfinite([plane.origin, plane.right, plane.down]).all():
        return "expected finite numbers in `origin`, `right` and `down`"
    lengths = float(np.linalg.norm(right)), float(np.linalg.norm(down))
    if min(lengths) <= 1e-9 * max(1.0, *lengths):
        return "has no area: `right` or `down` has no length"
    skew = 90.0 - np.degrees(np.arccos(np.clip(right @ down / (lengths[0] * lengths[1]), -1.0, 1.0)))
    if abs(skew) > SKEW_DEG:
        return f"`right` and `down` stand at {90.0 - skew:.1f} degrees, expected 90 (at most {SKEW_DEG:g} off)"
    return ""


def seen_from_inside(planes: Sequence[Plane]) -> list[int]:
    """Numbers of the faces that show their wood from behind: the others lie before their plane, not behind it.

    A plane that cuts through the others is seen from the side that its photograph shows, and never listed.
    """
    wrong = []
    for number, plane in enumerate(planes):
        others = [other.corners for index, other in enumerate(planes) if index != number]
        if not others:
            continue
        points = np.concatenate(others)
        normal = plane.inward / np.linalg.norm(plane.inward)
        depth = (points - np.array(plane.origin)) @ normal
        if depth.min() < 0 and depth.max() <= -_ON_PLANE * depth.min():
            wrong.append(number)
    return wrong


def check_aspect(plane: Plane, probe: Probe, name: str) -> None:
    """Raise `ScanError` where a photograph has another shape than the plane it is said to lie on."""
    photograph = probe.width / probe.height
    wanted = float(np.linalg.norm(plane.right) / np.linalg.norm(plane.down))
    if abs(photograph / wanted - 1.0) <= ASPECT_SHARE:
        return
    hint = ""
    if abs(photograph * wanted - 1.0) <= ASPECT_SHARE:
        hint = "; is it turned by 90 degrees?"
    raise ScanError(
        f"{name} is {probe.width}×{probe.height} px, width over height {photograph:.3f}, but its plane has "
        f"{wanted:.3f}{hint}"
    )


def planes_px(planes: Sequence[Plane], probes: Sequence[Probe]) -> tuple[tuple[Vectors, ...], float]:
    """Planes in px, and block units per px.

    A px of the block is as long as the first photograph's. For each face: the point of the centre of its pixel
    (0, 0), and what one px to the right and one px down add.
    """
    unit_per_px = float(np.linalg.norm(planes[0].right)) / probes[0].width
    found = []
    for plane, probe in zip(planes, probes, strict=True):
        right = np.array(plane.right) / probe.width / unit_per_px
        down = np.array(plane.down) / probe.height / unit_per_px
        origin = np.array(plane.origin) / unit_per_px + 0.5 * (right + down)
        found.append((_vector(origin), _vector(right), _vector(down)))
    return tuple(found), unit_per_px


def _vector(values: Array) -> Vector:
    # Without the sign of a zero, which would make two keys of one plane.
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z
