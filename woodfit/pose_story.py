"""A fitted pose in words: the cut, and what the photographs leave open."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from woodfit.pith import Pith
from woodfit.pith_energy import feet, frame_of
from woodfit.planes import Planes

FloatArray = npt.NDArray[np.float64]

#: Tilt up to which an end grain counts as square to the stem, degrees.
SQUARE_DEG = 0.5

#: Spread from which on a parameter counts as open: of the direction (degrees; up to it four of five likely directions
#: lie within 2 degrees), and of a distance to a pith that is not on the face (share of it); on the face it is one ring.
OPEN_DEG, OPEN_SHARE = 1.6, 0.05


@dataclass(frozen=True)
class Face:
    """Outline of the photographed faces.

    Attributes
    ----------
    left, top, right, bottom : float
        First and last pixel centres of a single face; of a block, its bounds along board x and y. px.
    near, far : float
        Bounds of a block along board z, px; 0 of a single face.
    """

    left: float
    top: float
    right: float
    bottom: float
    near: float = 0.0
    far: float = 0.0

    @classmethod
    def around(cls, planes: Planes, points: FloatArray, x: FloatArray, y: FloatArray) -> Face:
        """Outline of the pixel centres `x` (N,) and `y` (M,) of one face, or about the points (K, 3) of several."""
        if len(planes.top) == 1:
            corners = planes.lift(x[[0, -1]], y[[0, -1]])
        else:
            corners = np.stack([points.min(axis=0), points.max(axis=0)])
        low, high = corners.min(axis=0), corners.max(axis=0)
        return cls(*(float(v) for v in (low[0], low[1], high[0], high[1], low[2], high[2])))

    @property
    def size_px(self) -> float:
        """Longest side."""
        return max(self.right - self.left, self.bottom - self.top, self.far - self.near)

    @property
    def aspect(self) -> float:
        """Longer over shorter side of a single face."""
        return self.size_px / max(1.0, min(self.right - self.left, self.bottom - self.top))

    @property
    def centre(self) -> FloatArray:
        """Centre, board frame, shape (3,)."""
        return 0.5 * np.array([self.left + self.right, self.top + self.bottom, self.near + self.far])

    def shows(self, point: FloatArray) -> bool:
        """Whether the x and y of a point (3,) lie within."""
        return bool(self.left <= point[0] <= self.right and self.top <= point[1] <= self.bottom)


@dataclass(frozen=True)
class Story:
    """A pose in words and figures, for the report.

    Attributes
    ----------
    warnings : list of str
    figures : dict
    undetermined : bool array of shape (4,)
        Which pose parameters, in the order of `Pith.spread`, the faces leave open.
    """

    warnings: list[str]
    figures: dict[str, float | str]
    undetermined: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class _Place:
    """Where a pith line lies with respect to the faces."""

    tilt_deg: float
    foot: FloatArray
    on_face: FloatArray
    """Where it is seen: where it pierces an end grain face, else its foot pushed onto the face."""
    inside: bool
    away: float
    """How far that is from the centre of the faces, px."""


def _place(pith: Pith, face: Face) -> _Place:
    tilt = math.degrees(math.acos(min(1.0, abs(float(pith.direction[2])))))
    foot = feet(pith.point, pith.direction, face.centre)
    if tilt < 45.0:
        on_face = foot - (foot[2] - face.centre[2]) / pith.direction[2] * pith.direction
    else:
        across, _ = frame_of(pith.direction)
        on_face = face.centre + ((foot - face.centre) @ across) * across
    return _Place(tilt, foot, on_face, face.shows(on_face), float(np.linalg.norm(on_face - face.centre)))


def undetermined(pith: Pith, face: Face, ring_width_px: float) -> npt.NDArray[np.bool_]:
    """Which of two angles and two offsets (4,) are open: spread beyond 1.6 degrees, one ring, or 5 % of a distance."""
    place = _place(pith, face)
    angle = math.degrees(float(np.hypot(*pith.spread[:2]))) > OPEN_DEG
    allowed = ring_width_px if place.inside else OPEN_SHARE * place.away
    if place.tilt_deg < 45.0:
        apart = bool(np.hypot(*pith.spread[2:]) > allowed)
        return np.array([angle, angle, apart, apart])
    depth = max(ring_width_px, OPEN_SHARE * float(np.linalg.norm(place.foot - face.centre)))
    return np.array([angle, angle, bool(pith.spread[2] > allowed), bool(pith.spread[3] > depth)])


def _cut(place: _Place, face: Face) -> str:
    depth = abs(float(place.foot[2] - face.centre[2]))
    lateral = float(np.hypot(*(place.foot - face.centre)[:2]))
    if place.tilt_deg < 30.0:
        return "end grain with the pith in the picture" if place.inside else "end grain beside the pith"
    if place.tilt_deg < 75.0:
        return "oblique, cathedral pattern"
    if lateral < 0.35 * face.size_px:
        return "flat-sawn"
    return "quarter-sawn" if lateral > 1.5 * depth else "rift-sawn"


def describe(pith: Pith, face: Face, ring_width_px: float) -> Story:
    """Cut, tilt and distance of a fitted pith, and what the photographs leave open."""
    place, left_open = _place(pith, face), undetermined(pith, face, ring_width_px)
    distance = float(np.linalg.norm(face.centre - place.foot))
    depth = float(place.foot[2] - face.centre[2])
    warnings = []
    if place.tilt_deg > 10.0 and pith.mirrors:
        warnings.append(
            "One photograph cannot tell on which side of the face the pith lies; it was put "
            + ("behind" if depth >= 0.0 else "in front of")
            + " the face (`pose.pith_side`)."
        )
    if left_open[0]:
        angle = math.degrees(float(np.hypot(*pith.spread[:2])))
        square = place.tilt_deg < SQUARE_DEG
        taken = (
            "The face was taken as square to the stem" if square else "The middle of the likely directions was taken"
        )
        warnings.append(
            f"The pith's direction is undetermined (one sigma {angle:.1f} degrees): growth that is not round looks the "
            f"same as a tilt. {taken} (`pose.pith_tilt_deg`, `pose.pith_azimuth_deg`)."
        )
    if left_open[2]:
        offset = float(np.hypot(*pith.spread[2:]) if place.tilt_deg < 45.0 else pith.spread[2])
        warnings.append(
            f"The pith's place is undetermined ({place.away:.0f} px from the centre, one sigma {offset:.0f} px); "
            "distance and ring width trade off. The middle of the likely places was taken (`pose.pith_x_px`, "
            "`pose.pith_y_px`, or `pose.ring_width_px`)."
        )
    if left_open[3] and place.tilt_deg >= 45.0:
        warnings.append(
            f"The pith's depth is undetermined ({abs(depth):.0f} px, one sigma {pith.spread[3]:.0f} px); depth and "
            "ring width trade off. The middle of the likely depths was taken (`pose.pith_z_px`)."
        )
    names = ("direction",) * bool(left_open[0]) + ("place",) * bool(left_open[2])
    names += ("depth",) * bool(left_open[3] and place.tilt_deg >= 45.0)
    figures: dict[str, float | str] = {
        "cut": _cut(place, face) if face.near == face.far else "block of several faces",
        "pith tilt from the face's normal (deg)": round(place.tilt_deg, 1),
        "pith distance from the face's centre (px)": round(distance, 1),
        "pith depth below the face's centre (px)": round(depth, 1),
        "mean ring width across the layers (px)": round(ring_width_px, 2),
        "undetermined": ", ".join(names) or ("nothing but the side of the face" if pith.mirrors else "nothing"),
    }
    return Story(warnings, figures, left_open)
