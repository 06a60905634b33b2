"""Knots, cracks and stains on a face: where wood is not what the growth rings say.

Each kind is told from sound wood by what sound wood cannot be: a knot is a lump, and a crack a thin line, that is
darker than any latewood or runs across the rings; stain darkens without the deepening of color that comes with
more of the wood's own substance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.grids import block_mean, enlarged, nearest

FloatArray = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

SOUND, KNOT, CRACK, STAIN = 0, 1, 2, 3
KIND_NAMES = {KNOT: "knot", CRACK: "crack", STAIN: "stain"}

#: How many times over the evidence for a knot or crack must be enough to be beyond doubt.
_CERTAIN = 2.1


@dataclass(frozen=True)
class Face:
    """What the search looks at; images of shape (M, N), lengths in pixels of them.

    Attributes
    ----------
    rgb : float array of shape (M, N, 3)
        Linear, 0..1.
    valid : bool array
        True on wood.
    orientation : array
        Tangent of the rings, rad.
    curvature : array
        Of the ring boundaries, 1/px.
    ring_px : float
        Characteristic ring width.
    pith : x, y, optional
        Where the face shows the pith: no knot, dark as it may be.
    vessels : bool
        Whether the rings are made of vessels.
    """

    rgb: npt.NDArray[Any]
    valid: BoolArray
    orientation: npt.NDArray[Any]
    curvature: npt.NDArray[Any]
    ring_px: float
    pith: tuple[float, float] | None = None
    vessels: bool = False


@dataclass(frozen=True)
class Anomalies:
    """What was found.

    Attributes
    ----------
    mask : uint8 array of shape (M, N)
        `SOUND`, `KNOT`, `CRACK` or `STAIN`.
    kind : int array of shape (K,)
        Of each connected anomaly, knots first, each kind from the largest to the smallest.
    box : float array of shape (K, 4)
        Left, top, right and bottom pixel centre, px.
    area : float array of shape (K,)
        px².
    """

    mask: npt.NDArray[np.uint8]
    kind: npt.NDArray[np.int64]
    box: npt.NDArray[np.float64]
    area: npt.NDArray[np.float64]


def blurred(image: npt.NDArray[Any], weight: npt.NDArray[Any], sigma_px: float) -> FloatArray:
    """Weighted Gaussian mean of an image (M, N) or (M, N, C) around each pixel."""
    if image.ndim == 3:
        return np.stack([blurred(image[..., k], weight, sigma_px) for k in range(image.shape[2])], axis=-1)
    mass = np.asarray(weight, np.float32)
    # A wide window does not see single pixels.
    step = max(1, int(sigma_px / 4.0))
    size = 2 * math.ceil(3.0 * sigma_px / step) + 1
    above, below = (
        cv2.GaussianBlur(block_mean(part, step), (size, size), sigma_px / step, borderType=cv2.BORDER_REFLECT_101)
        for part in (np.asarray(image * mass, np.float32), mass)
    )
    return enlarged(np.asarray(above / np.maximum(below, 1e-4), np.float32), step, mass.shape)


def absorbance(rgb: npt.NDArray[Any]) -> FloatArray:
    """Negative natural logarithm of linear rgb, shape (M, N, 3); what is nearly black counts as 1 % light."""
    return np.asarray(-np.log(np.maximum(rgb, 0.0) + 0.01), np.float32)


def find_anomalies(
    face: Face, smallest_knot_rings: float = 0.35, shortest_crack_rings: float = 2.0, smallest_stain_rings: float = 2.0
) -> Anomalies:
    """Find the knots, cracks and stains of a face.

    Parameters
    ----------
    face : Face
        What is seen.
    smallest_knot_rings, shortest_crack_rings, smallest_stain_rings : float
        Least thickness of a knot, length of a crack and width of a stain, in characteristic ring widths.

    Returns
    -------
    Anomalies
    """
    from woodfit.anomalies_dark import find_dark, widened
    from woodfit.anomalies_stain import find_stain, stain_absorbance

    mask = np.zeros(face.valid.shape, np.uint8)
    if not face.valid.any():
        return listed(mask)
    sizes = smallest_knot_rings, shortest_crack_rings
    knots, cracks = find_dark(face, np.zeros(mask.shape, np.float32), *sizes)
    # What is dark beyond doubt is not stain; then again, since patches of stain pass for knots.
    certain = (knots > _CERTAIN) | (cracks > _CERTAIN)
    gray = stain_absorbance(face, face.valid & ~certain)
    stained = find_stain(face, gray, smallest_stain_rings) & ~widened(knots > _CERTAIN, face.ring_px)
    if stained.any():
        added = np.where(widened(stained, face.ring_px), np.maximum(gray, 0.0), 0.0)
        again, cracks = find_dark(face, added, *sizes)
        knots = np.where(knots > _CERTAIN, knots, again)
    mask[stained] = STAIN
    mask[cracks > 0.0] = CRACK
    mask[knots > 0.0] = KNOT
    return listed(mask)


def listed(mask: npt.NDArray[np.uint8]) -> Anomalies:
    """Table of the connected parts (8 neighbours) of each kind in a mask of shape (M, N)."""
    kind: list[int] = []
    box: list[list[float]] = []
    area: list[float] = []
    for code in KIND_NAMES:
        _, _, stats, _ = cv2.connectedComponentsWithStats((mask == code).astype(np.uint8), connectivity=8)
        for left, top, width, height, pixels in sorted(stats[1:].tolist(), key=lambda row: -row[4]):
            kind.append(code)
            box.append([left, top, left + width - 1, top + height - 1])
            area.append(pixels)
    return Anomalies(mask, np.array(kind, np.int64), np.array(box, np.float64).reshape(-1, 4), np.array(area, float))


def describe(found: Anomalies, px_area: float, unit: str) -> tuple[list[str], dict[str, Any]]:
    """Warnings and figures in words; `px_area` is the area of a pixel in `unit`²."""
    figures: dict[str, Any] = {}
    warnings = []
    for code, name in KIND_NAMES.items():
        area = found.area[found.kind == code]
        if not len(area):
            figures[f"{name}s"] = "none"
            continue
        share = float((found.mask == code).mean())
        figures[f"{name}s"] = f"{len(area)}, {area.sum() * px_area:.3g} {unit}², {100 * share:.1f} % of the scan"
        if share > 0.25:
            warnings.append(
                f"{100 * share:.0f} % of the scan look like a {name}: if they are sound, set `knots: ignore`."
            )
    return warnings, figures


def disturbed(anomaly: npt.NDArray[Any], margin_px: float) -> BoolArray:
    """Where the rings are not to be trusted: knots, cracks, and what is at most `margin_px` from a knot; (M, N).

    Filters look about half a ring width across a knot's edge. Stained wood has its rings and is left in.
    """
    from woodfit.anomalies_dark import widened

    code = np.asarray(anomaly)
    return np.asarray(widened(code == KNOT, margin_px) | (code == CRACK))


def sound_at(
    anomaly: npt.NDArray[Any],
    x_coords: npt.NDArray[Any],
    y_coords: npt.NDArray[Any],
    px: npt.NDArray[Any],
    py: npt.NDArray[Any],
    stain_is_sound: bool = False,
) -> npt.NDArray[np.float64]:
    """Weight of places on a face: 1 on sound wood, 0 on an anomaly.

    Parameters
    ----------
    anomaly : int array of shape (M, N)
        Codes.
    x_coords, y_coords : arrays of shape (N,) and (M,)
        Its evenly spaced pixel centres, scan px.
    px, py : arrays of one shape
        Places, scan px; beyond the edge the pixel at it counts.
    stain_is_sound : bool
        Whether stained wood counts as sound: its color is not, its rings are.

    Returns
    -------
    float64 array of the places' shape
    """
    columns = (np.asarray(px, float) - x_coords[0]) / _spacing(x_coords)
    rows = (np.asarray(py, float) - y_coords[0]) / _spacing(y_coords)
    code = nearest(anomaly, np.column_stack([columns.ravel(), rows.ravel()]))
    sound = (code == SOUND) | ((code == STAIN) & stain_is_sound)
    return np.asarray(sound, np.float64).reshape(np.shape(px))


def _spacing(coords: npt.NDArray[Any]) -> float:
    return float(coords[1] - coords[0]) if len(coords) > 1 else 1.0
