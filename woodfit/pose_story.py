"""A fitted pose in words: the cut, and what one photograph leaves open."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from woodfit.pith import Pith

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Face:
    """Outline of the photographed face: first and last pixel centres in px."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def size_px(self) -> float:
        """Longer side."""
        return max(self.right - self.left, self.bottom - self.top)

    @property
    def aspect(self) -> float:
        """Longer over shorter side."""
        return self.size_px / max(1.0, min(self.right - self.left, self.bottom - self.top))

    @property
    def centre(self) -> FloatArray:
        """Centre, board frame, shape (3,)."""
        return np.array([0.5 * (self.left + self.right), 0.5 * (self.top + self.bottom), 0.0])


@dataclass(frozen=True)
class Story:
    """A pose in words and figures, for the report."""

    warnings: list[str]
    figures: dict[str, float | str]


def describe(pith: Pith, face: Face, ring_width_px: float) -> Story:
    """Cut, tilt and distance of a fitted pith, and what the photograph leaves open."""
    tilt = math.degrees(math.acos(min(1.0, abs(float(pith.direction[2])))))
    foot = pith.point + ((face.centre - pith.point) @ pith.direction) * pith.direction
    distance = float(np.linalg.norm(face.centre - foot))
    depth, lateral = abs(float(foot[2])), float(np.hypot(*(foot - face.centre)[:2]))
    if tilt < 30.0:
        inside = face.left <= foot[0] <= face.right and face.top <= foot[1] <= face.bottom
        cut = "end grain with the pith in the picture" if inside else "end grain beside the pith"
    elif tilt < 75.0:
        cut = "oblique, cathedral pattern"
    elif lateral < 0.35 * face.size_px:
        cut = "flat-sawn"
    else:
        cut = "quarter-sawn" if lateral > 1.5 * depth else "rift-sawn"
    warnings = []
    if tilt > 10.0:
        warnings.append(
            "One photograph cannot tell on which side of the face the pith lies; it was put "
            + ("behind" if foot[2] >= 0.0 else "in front of")
            + " the face (`pose.pith_side`)."
        )
    angle = math.degrees(float(np.max(pith.spread[:2])))
    if angle > 10.0:
        warnings.append(f"The pith's direction is hardly determined by this face (one sigma {angle:.0f} degrees).")
    offset = float(np.max(pith.spread[2:]))
    if offset > max(0.25 * distance, 2.0 * ring_width_px):
        warnings.append(
            f"The pith's distance is hardly determined by this face ({distance:.0f} px, one sigma {offset:.0f} px); "
            "distance and ring width trade off."
        )
    figures: dict[str, float | str] = {
        "cut": cut,
        "pith tilt from the face's normal (deg)": round(tilt, 1),
        "pith distance from the face's centre (px)": round(distance, 1),
        "pith depth below the face's centre (px)": round(float(foot[2]), 1),
        "mean ring width across the layers (px)": round(ring_width_px, 2),
    }
    return Story(warnings, figures)
