"""How good a result is: metrics over plain arrays, against known truth or hand labels.

Image frame everywhere: x right, y down, px, pixel centres at integers. A polyline is an array (n, 2) of x, y;
a closed one repeats its first point at the end. Ring age is an array (H, W), NaN where there is no truth.
Shares and F are 0..1; a share of nothing is NaN, so that it never passes for a good figure.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from woodfit.dendro_scoring import compare_path
from woodfit.matching import (
    Counts,
    count_matches,
    level_crossings,
    line_crossings,
    neighbour_tolerance,
    share,
)

Floats = NDArray[np.float64]
Array = NDArray[Any]  # any float type: results are stored as float32, computed as float64
Bools = NDArray[np.bool_]
Polylines = Sequence[Array]

_SAMPLE_PX = 0.25


# --- along lines across the grain -------------------------------------------------------------------------
def across_grain_lines(age: Array, lines: int = 20) -> list[tuple[Floats, Floats]]:
    """Straight lines across the grain, as start and end (x, y) in px at the image's borders.

    Where the growth directions agree: parallel lines along their mean, evenly spaced. Where they do not (the pith
    or an arch is in the image): rays at equal angles from the youngest wood.
    """
    height, width = age.shape
    growth = _growth_direction(age)
    mean = np.nanmean((growth[..., 0] + 1j * growth[..., 1]) ** 2)
    if abs(mean) < 0.35:
        row, column = np.unravel_index(np.nanargmin(age), age.shape)
        center = np.array([float(column), float(row)])
        angles = 2 * np.pi * (np.arange(lines) + 0.5) / lines
        rays = [_clip(center, np.array([np.cos(a), np.sin(a)]), width, height) for a in angles]
        return [(center, end) for _, end in rays]
    along = np.array([np.cos(np.angle(mean) / 2), np.sin(np.angle(mean) / 2)])
    normal = np.array([-along[1], along[0]])
    middle = 0.5 * np.array([width - 1.0, height - 1.0])
    reach = abs(normal[0]) * middle[0] + abs(normal[1]) * middle[1]
    offsets = reach * (2 * (np.arange(lines) + 0.5) / lines - 1)
    return [_clip(middle + offset * normal, along, width, height) for offset in offsets]


def _clip(point: Floats, along: Floats, width: int, height: int) -> tuple[Floats, Floats]:
    """Ends of the line through an inner `point` (x, y) on the border of the pixel centres."""
    with np.errstate(divide="ignore", invalid="ignore"):
        limits = np.stack([-point, np.array([width - 1.0, height - 1.0]) - point]) / along
    limits = limits[:, along != 0.0]
    return point + limits.min(axis=0).max() * along, point + limits.max(axis=0).min() * along


def _growth_direction(age: Array) -> Floats:
    """Unit gradient (x, y) of ring age, shape (H, W, 2)."""
    down, right = np.gradient(age.astype(float))
    unit = np.stack([right, down], axis=-1) / np.maximum(np.hypot(right, down), 1e-12)[..., None]
    return np.asarray(unit, dtype=float)


def line_f(
    polylines: Polylines,
    age: Array,
    lines: int = 20,
    tolerance_px: float = 3.0,
    grazing_deg: float = 60.0,
    edge_px: float = 2.0,
) -> dict[str, float]:
    """Scores of the traced crossings against the true ones along lines across the grain.

    Matched one-to-one in order, within the smaller of `tolerance_px` and a quarter of the smaller neighbouring
    ring. A crossing where the line meets the growth direction at more than `grazing_deg` (its place along the
    line is then ill-defined), or within `edge_px` of the line's ends, is neither missed nor false; 90 and 0
    count all.
    """
    growth = _growth_direction(age)
    total = Counts()
    for start, end in across_grain_lines(age, lines):
        length = float(np.hypot(*(end - start)))
        if length < 2 * edge_px + 1:
            continue
        along = (end - start) / length
        places = np.arange(0.0, length, _SAMPLE_PX)
        x, y = start[:, None] + along[:, None] * places
        values = ndimage.map_coordinates(age.astype(float), [y, x], order=1, mode="nearest")
        truth = level_crossings(values) * _SAMPLE_PX
        found = line_crossings(polylines, start, end)

        def ill_defined(at: Floats, along: Floats = along, start: Floats = start, length: float = length) -> Bools:
            pixel = np.rint(start + at[:, None] * along).astype(int)
            cosine = np.abs(growth[pixel[:, 1], pixel[:, 0]] @ along)
            margin = (at < edge_px) | (at > length - edge_px)
            grazing = cosine < np.cos(np.radians(grazing_deg)) - 1e-9
            return np.asarray(margin | grazing | np.isnan(age[pixel[:, 1], pixel[:, 0]]))

        tolerance = neighbour_tolerance(truth, tolerance_px)
        total += count_matches(truth, found, tolerance, ill_defined(truth), ill_defined(found))
    return total.scores()


# --- boundaries as pixels -----------------------------------------------------------------------------------
def boundary_pixels(age: Array) -> Bools:
    """True where the whole part of ring age differs from the right or the lower neighbour's, shape (H, W)."""
    ring = np.floor(age)
    mask = np.zeros(age.shape, dtype=bool)
    known = np.isfinite(age)
    mask[:, :-1] |= (ring[:, :-1] != ring[:, 1:]) & known[:, :-1] & known[:, 1:]
    mask[:-1] |= (ring[:-1] != ring[1:]) & known[:-1] & known[1:]
    return mask


def rasterize(polylines: Iterable[ArrayLike], shape: tuple[int, int]) -> Bools:
    """Pixels, shape (H, W), that polylines (n, 2) of x, y pass through, drawn one pixel wide."""
    canvas = np.zeros(shape, dtype=np.uint8)
    for polyline in polylines:
        points = np.asarray(polyline, dtype=float).reshape(-1, 2)
        if len(points):
            cv2.polylines(canvas, [np.rint(points * 16).astype(np.int32)], False, 1, 1, cv2.LINE_8, shift=4)
    return canvas.astype(bool)


def boundary_recall_precision(traced: Polylines | Bools, age: Array, tolerance_px: float = 3.0) -> dict[str, float]:
    """``recall``: share of the true boundary pixels within `tolerance_px` of a traced line; ``precision``: share
    of the traced pixels within `tolerance_px` of a true boundary.

    `traced` is a mask (H, W) or polylines. Pixels where the truth is NaN are left out.
    """
    mask = traced.copy() if isinstance(traced, np.ndarray) else rasterize(traced, (age.shape[0], age.shape[1]))
    truth = boundary_pixels(age)
    mask &= np.isfinite(age)
    return {
        "recall": _near_share(truth, mask, tolerance_px),
        "precision": _near_share(mask, truth, tolerance_px),
    }


def _near_share(mask: Bools, target: Bools, tolerance_px: float) -> float:
    """Share of the pixels of `mask` within `tolerance_px` of `target`."""
    if not target.any():
        return 0.0 if mask.any() else float("nan")
    distance = cv2.distanceTransform((~target).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return share(float((distance[mask] <= tolerance_px).sum()), float(mask.sum()))


# --- fields -------------------------------------------------------------------------------------------------
def phase_share(phase: Array, age: Array, bins: int = 720) -> float:
    """Share of the pixels where `phase` (rad) is within pi/2 of ``2 pi age`` after the best sign and constant.

    The constant is searched in steps of ``2 pi / bins``; pixels that are NaN in either are left out.
    """
    known = np.isfinite(phase) & np.isfinite(age)
    best = 0
    for sign in (1.0, -1.0):
        turns = (sign * phase[known] / (2 * np.pi) - age[known]) % 1.0
        histogram = np.bincount((turns * bins).astype(int) % bins, minlength=bins)
        around = np.concatenate([[0], np.cumsum(np.tile(histogram, 2))])
        best = max(best, int((around[bins // 2 : bins // 2 + bins] - around[:bins]).max()))
    return share(best, int(known.sum()))


def age_share(age_hat: Array, age: Array, tolerance: float = 0.15) -> dict[str, float]:
    """How well `age_hat` gives the ring age after the one constant (any real number) that suits most pixels.

    ``age_share``: share of the pixels within `tolerance` rings; ``age_median_error``: median absolute error in
    rings; ``age_offset``: the constant, ``age_hat - age``. Where `age_hat` is NaN and `age` is not counts as wrong.
    """
    known = np.isfinite(age)
    difference = np.sort((age_hat - age)[known & np.isfinite(age_hat)].astype(float))
    if not len(difference):
        return {"age_share": 0.0, "age_median_error": float("nan"), "age_offset": float("nan")}
    last = np.searchsorted(difference, difference + 2 * tolerance, side="right")
    first = int(np.argmax(last - np.arange(len(difference))))
    offset = 0.5 * (difference[first] + difference[last[first] - 1])
    return {
        "age_share": share(float(last[first] - first), float(known.sum())),
        "age_median_error": float(np.median(np.abs(difference - offset))),
        "age_offset": float(offset),
    }


def age_correlation(age_hat: Array, age: Array) -> float:
    """Pearson correlation of two ring ages of one shape, over places where both are finite."""
    known = np.isfinite(age_hat) & np.isfinite(age)
    a, b = age_hat[known].astype(float), age[known].astype(float)
    if len(a) < 2 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


def psnr_blurred(a: Array, b: Array, sigma_px: float = 1.5, valid: Bools | None = None) -> float:
    """Peak signal-to-noise ratio in dB, peak 1, of two linear rgb images (H, W, 3) blurred by `sigma_px`.

    `valid` (H, W) restricts the mean to those pixels, after the blur.
    """
    difference = cv2.GaussianBlur((a - b).astype(np.float32), (0, 0), sigma_px, borderType=cv2.BORDER_REFLECT_101)
    squares = difference.astype(float) ** 2
    error = float(squares.mean() if valid is None else squares[valid].mean())
    return float("inf") if error == 0.0 else -10.0 * float(np.log10(error))


# --- hand labels --------------------------------------------------------------------------------------------
def path_score(
    polylines: Polylines, paths: Mapping[str, Any] | Iterable[Mapping[str, Any]], tolerance_px: float = 3.0
) -> dict[str, float]:
    """``sensitivity``, ``precision``, ``f`` and counts over one labelled path or several.

    More figures are in :func:`woodfit.dendro_scoring.compare_path`.
    """
    several = [paths] if isinstance(paths, Mapping) else paths
    return sum((compare_path(polylines, path, tolerance_px).counts for path in several), Counts()).scores()


@dataclass(frozen=True)
class FaceComparison:
    """Lengths that agree on labelled faces, in steps of a fixed length; adds up over faces.

    Parameters
    ----------
    to_traced
        Distance of places along the labels to what is traced, px.
    to_label
        Distance of places along what is traced, where it is judged, to the labels, px.
    tolerance_px
        How near is a hit.
    """

    to_traced: Floats
    to_label: Floats
    tolerance_px: float

    def __add__(self, other: FaceComparison) -> FaceComparison:
        return FaceComparison(
            np.concatenate([self.to_traced, other.to_traced]),
            np.concatenate([self.to_label, other.to_label]),
            self.tolerance_px,
        )

    def figures(self) -> dict[str, float]:
        """``label_share``, ``traced_share`` and ``label_median_px``, see :func:`face_score`."""
        near = [float((distance <= self.tolerance_px).sum()) for distance in (self.to_traced, self.to_label)]
        return {
            "label_share": share(near[0], len(self.to_traced)),
            "traced_share": share(near[1], len(self.to_label)),
            "label_median_px": float(np.median(self.to_traced)) if len(self.to_traced) else float("nan"),
        }


def compare_face(polylines: Polylines, label: Mapping[str, Any], tolerance_px: float = 3.0) -> FaceComparison:
    """Traced polylines against a labelled face, see :func:`face_score`."""
    rings = label["rings"]
    certain = _dense([_outline(ring) for ring in rings if not ring.get("uncertain")])
    doubtful = _dense([_outline(ring) for ring in rings if ring.get("uncertain")])
    traced = _dense(polylines)
    judged = _distance(traced, doubtful) > tolerance_px
    judged |= _distance(traced, certain) <= tolerance_px
    for polygon in label.get("ignore", []):
        certain, outside = certain[~_inside(certain, polygon)], ~_inside(traced, polygon)
        traced, judged = traced[outside], judged[outside]
    return FaceComparison(_distance(certain, traced), _distance(traced[judged], certain), tolerance_px)


def face_score(polylines: Polylines, label: Mapping[str, Any], tolerance_px: float = 3.0) -> dict[str, float]:
    """Lengths that agree on a labelled face (``rings`` with ``points`` and perhaps ``closed``, ``ignore`` polygons).

    ``label_share``: share of the labels' length within `tolerance_px` of a traced line; ``traced_share``: share of
    the traced length within `tolerance_px` of a label; ``label_median_px``: median distance, label to traced.
    Uncertain labels are not asked for, and what is traced along them or in an ``ignore`` polygon is not judged.
    """
    return compare_face(polylines, label, tolerance_px).figures()


def _outline(ring: Mapping[str, Any]) -> Floats:
    """Points (n, 2) of a labelled ring, a closed one back to its first."""
    points = np.asarray(ring["points"], dtype=float).reshape(-1, 2)
    return np.concatenate([points, points[:1]]) if ring.get("closed") else points


def _dense(polylines: Iterable[ArrayLike]) -> Floats:
    """Points (n, 2) at equal steps of about `_SAMPLE_PX` along polylines."""
    pieces = [np.empty((0, 2))]
    for polyline in polylines:
        points = np.asarray(polyline, dtype=float).reshape(-1, 2)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        at = (np.arange(max(1, round(arc[-1] / _SAMPLE_PX))) + 0.5) * arc[-1] / max(1, round(arc[-1] / _SAMPLE_PX))
        pieces.append(np.stack([np.interp(at, arc, points[:, k]) for k in (0, 1)], axis=-1))
    return np.concatenate(pieces)


def _distance(points: Floats, targets: Floats) -> Floats:
    """Distance of each point (n, 2) to the nearest target; infinite without targets."""
    if not len(targets):
        return np.full(len(points), np.inf)
    return np.asarray(cKDTree(targets).query(points)[0])


def _inside(points: Floats, polygon: ArrayLike) -> Bools:
    """True for points (n, 2) inside the polygon (m, 2), by the even-odd rule."""
    inside = np.zeros(len(points), dtype=bool)
    corners = np.asarray(polygon, dtype=float)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (y0 > points[:, 1]) != (y1 > points[:, 1])
            inside ^= crosses & (points[:, 0] < x0 + (points[:, 1] - y0) * (x1 - x0) / (y1 - y0))
    return inside
