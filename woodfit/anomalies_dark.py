"""Knots and cracks: lumps and lines that are darker than any latewood, and thin dark lines across the rings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from woodfit.anomalies import BoolArray, Face, FloatArray, absorbance, blurred
from woodfit.streamlines import smooth_along

#: Latewood's absorbance is looked up as this quantile of the darkest within about a ring width.
_LATEWOOD = 0.75
#: How often the background is taken anew without what was found on it.
_ROUNDS = 3
#: What a part is darker than latewood by, and its rim than the wood beside it, together: of a knot, and of a hole
#: that runs along the rings as latewood does.
_KNOT, _HOLE = 0.45, 1.2
#: Where vessels are averaged out, what clumps of them leave counts for less.
_VESSELS = 0.8
#: Where rings bend more sharply than this (rad per ring width) their direction is not known well enough.
_BEND = 0.3
#: No knot is sought this near to the pith (ring widths), nor beside what is not wood if it is more than a share.
_PITH, _MOST_OFF_WOOD = 1.5, 0.25
#: From this squared sine of the angle to the rings a line runs across them.
_ACROSS = 0.35
#: Least contrast of a line across the rings, in absorbance averaged along it.
_LINE = 0.08
#: How far beyond it, in absorbance, wood is certainly darker than latewood, and how far what belongs to it.
_SURELY, _PROBABLY = 0.25, 0.12
#: A dark line is a crack if it is this many times as long as thick; a lump is a knot if it is not.
_SLENDER = 4.0


@dataclass(frozen=True)
class Shape:
    """Measures of a connected part, px and rad."""

    length: float
    thickness: float
    angle: float
    area: float
    centre: tuple[float, float]


def shape_of(part: BoolArray, left: int, top: int) -> Shape:
    """Measures of a part given as a cut-out mask whose first pixel lies at column `left` and row `top`."""
    rows, cols = np.nonzero(part)
    padded = cv2.copyMakeBorder(part.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    thickness = 2.0 * float(cv2.distanceTransform(padded, cv2.DIST_L2, 5).max()) - 1.0
    if len(rows) > 1:
        values, vectors = np.linalg.eigh(np.cov(np.stack([cols, rows])) + np.eye(2) / 12.0)
        length, angle = float(np.sqrt(12.0 * values[1])), float(np.arctan2(vectors[1, 1], vectors[0, 1]))
    else:
        length, angle = 1.0, 0.0
    return Shape(length, thickness, angle, float(len(rows)), (left + float(cols.mean()), top + float(rows.mean())))


def connected(seed: BoolArray, support: BoolArray) -> list[tuple[slice, slice, BoolArray]]:
    """Connected parts of `support` that hold a pixel of `seed`: rows, columns and the part's own mask there."""
    count, label, stats, _ = cv2.connectedComponentsWithStats(support.astype(np.uint8), connectivity=8)
    kept = np.zeros(count, bool)
    kept[label[seed & support]] = True
    kept[0] = False
    parts = []
    for number in np.flatnonzero(kept):
        left, top, width, height = stats[number, :4]
        rows, cols = slice(int(top), int(top + height)), slice(int(left), int(left + width))
        parts.append((rows, cols, label[rows, cols] == number))
    return parts


def dark_excess(dark: FloatArray, valid: BoolArray, ring_px: float) -> FloatArray:
    """Absorbance beyond that of latewood, shape (M, N); below 0 on sound wood.

    Parameters
    ----------
    dark : array of shape (M, N)
        Absorbance.
    valid : bool array of shape (M, N)
        True on wood.
    ring_px : float
        Characteristic ring width.
    """
    weight = valid.astype(np.float32)
    size = 2 * round(0.6 * ring_px) + 1
    square = np.ones((size, size), np.uint8)
    for _ in range(_ROUNDS):
        # Again without what was found: a large knot must not be its own background.
        above = dark - blurred(dark, weight, 4.0 * ring_px)
        trusted = weight > 0.5
        darkest = cv2.dilate(np.where(trusted, above, -1.0).astype(np.float32), square)
        level = np.maximum(blurred(darkest, trusted, 2.0 * ring_px), np.quantile(darkest[trusted], _LATEWOOD))
        excess = above - level
        weight = np.where(cv2.dilate(excess, square[::2, ::2]) > _PROBABLY, 0.01 * valid, valid).astype(np.float32)
        if not (weight > 0.5).any():
            break
    return np.asarray(np.where(valid, excess, -1.0), np.float32)


def contrast_along(dark: FloatArray, face: Face, reach_px: float) -> FloatArray:
    """How much darker a pixel is than both its neighbours `reach_px` away along its ring, in absorbance."""
    dx, dy = (reach_px * np.asarray(turn(face.orientation), np.float32) for turn in (np.cos, np.sin))
    rows, cols = np.mgrid[: dark.shape[0], : dark.shape[1]].astype(np.float32)
    sides = [
        cv2.remap(dark, cols + sign * dx, rows + sign * dy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        for sign in (-1, 1)
    ]
    return np.asarray(np.where(face.valid, dark - np.maximum(*sides), 0.0), np.float32)


def find_dark(
    face: Face, stain: FloatArray, smallest_knot_rings: float, shortest_crack_rings: float
) -> tuple[FloatArray, FloatArray]:
    """Knots and cracks, as how many times over the evidence is enough, shape (M, N); 0 where there are none.

    Parameters
    ----------
    face : Face
        What is seen.
    stain : array of shape (M, N)
        Absorbance that stain adds.
    smallest_knot_rings, shortest_crack_rings : float
        As in `woodfit.anomalies.find_anomalies`.
    """
    dark = absorbance(face.rgb).mean(axis=2) - stain
    knots = _knots(dark, face, smallest_knot_rings)
    cracks = np.maximum(_holes(dark, face, shortest_crack_rings), _lines_across(dark, face, shortest_crack_rings))
    beside = widened(knots > 0.0, 0.5 * face.ring_px)
    for rows, cols, part in connected(beside, cracks > 0.0):
        # The wood bends around a knot: what looks like a line across the rings there is its rim.
        cracks[rows, cols][part] = 0.0
    return knots, cracks


def _knots(dark: FloatArray, face: Face, smallest_rings: float) -> FloatArray:
    """Lumps darker than latewood all around."""
    ring = face.ring_px
    found = np.zeros(face.valid.shape, np.float32)
    # Vessels are dark as well: where rings are made of them they are averaged out.
    sigma = float(np.clip(0.06 * ring, 0.7, 2.0)) if not face.vessels else max(0.7, 0.2 * ring)
    smooth = blurred(dark, face.valid, sigma)
    excess = dark_excess(smooth, face.valid, ring)
    support = (excess > _PROBABLY).astype(np.uint8)
    # A ring that a knot touches is not part of it.
    size = max(1, round(0.7 * smallest_rings * ring))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    lumps = cv2.morphologyEx(support, cv2.MORPH_OPEN, disc) > 0
    for rows, cols, part in connected(excess > _SURELY, lumps):
        shape = shape_of(part, cols.start, rows.start)
        if shape.thickness < smallest_rings * ring:
            continue
        around = surroundings(rows, cols, part, face, smooth)
        if around.off_wood > _MOST_OFF_WOOD or (face.pith and math.dist(shape.centre, face.pith) < _PITH * ring):
            continue
        stout = shape.length < _SLENDER * shape.thickness
        evidence = (float(excess[rows, cols][part].mean()) + around.drop) / _KNOT * (_VESSELS if face.vessels else 1.0)
        if evidence > 1.0 and (stout or around.across > _ACROSS):
            found[rows, cols][part] = evidence
    return found


def _holes(dark: FloatArray, face: Face, shortest_rings: float) -> FloatArray:
    """Long thin parts that are too dark for a ring."""
    ring = face.ring_px
    found = np.zeros(face.valid.shape, np.float32)
    fine = blurred(dark, face.valid, 0.7)
    excess = dark_excess(fine, face.valid, ring)
    for rows, cols, part in connected(excess > _SURELY, excess > _PROBABLY):
        shape = shape_of(part, cols.start, rows.start)
        if shape.length < max(shortest_rings * ring, _SLENDER * shape.thickness):
            continue
        around = surroundings(rows, cols, part, face, fine)
        needed = _KNOT if around.across > _ACROSS else _HOLE
        evidence = (float(excess[rows, cols][part].mean()) + around.drop) / needed
        if around.off_wood < _MOST_OFF_WOOD and evidence > 1.0 and not _encloses(part):
            found[rows, cols][part] = evidence
    return found


@dataclass(frozen=True)
class Surroundings:
    """What lies around a part.

    Attributes
    ----------
    drop : float
        How much darker its rim is than what lies beside it, in absorbance, where it is the least: the first quartile.
    across : float
        Mean squared sine between its rim and the rings: 0 along them, 1 across.
    off_wood : float
        Share that is not wood.
    """

    drop: float
    across: float
    off_wood: float


def _encloses(part: BoolArray) -> bool:
    """Whether a part runs around much more than itself: no crack, but a dark ring."""
    outlines, _ = cv2.findContours(part.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return bool(max(cv2.contourArea(outline) for outline in outlines) > 2.0 * part.sum())


def surroundings(rows: slice, cols: slice, part: BoolArray, face: Face, dark: FloatArray) -> Surroundings:
    """Look around a part given as its cut-out mask and where that lies in the face."""
    margin = max(4, round((0.4 if face.vessels else 0.15) * face.ring_px))
    top, left = max(0, rows.start - 2 * margin), max(0, cols.start - 2 * margin)
    window = (slice(top, rows.stop + 2 * margin), slice(left, cols.stop + 2 * margin))
    inside = np.zeros(dark[window].shape, bool)
    inside[rows.start - top : rows.stop - top, cols.start - left : cols.stop - left] = part
    near, wide = widened(inside, margin), widened(inside, 2 * margin)
    soft = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 1.0)
    slope_x, slope_y = (cv2.Scharr(soft, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
    tangent = face.orientation[window]
    along = (slope_x * np.cos(tangent) + slope_y * np.sin(tangent)) ** 2
    valid, local = face.valid[window], dark[window]
    rim = inside & ~(cv2.erode(inside.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
    # Each pixel beside the part is compared with the darkest of the rim near it.
    kernel = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    darkest = cv2.dilate(np.where(rim, local, -9.0).astype(np.float32), kernel)
    beside = near & ~widened(inside, margin - 1) & valid
    drop = (darkest - local)[beside]
    return Surroundings(
        float(np.quantile(drop, 0.25)) if drop.size else 0.0,
        float(along.sum() / max(float((slope_x**2 + slope_y**2).sum()), 1e-9)),
        1.0 - float(valid[wide & ~inside].mean()) if (wide & ~inside).any() else 0.0,
    )


def widened(mask: BoolArray, by_px: float) -> BoolArray:
    """A mask and what is at most `by_px` away from it."""
    size = 2 * round(by_px) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disc) > 0)


def _lines_across(dark: FloatArray, face: Face, shortest_rings: float) -> FloatArray:
    """Thin dark lines that run across the rings."""
    ring = face.ring_px
    found = np.zeros(face.valid.shape, np.float32)
    smooth = blurred(dark, face.valid, float(np.clip(0.06 * ring, 0.7, 2.0)))
    contrast = np.clip(contrast_along(smooth, face, max(4.0, 0.4 * ring)), 0.0, 0.5)
    contrast *= np.exp(-((np.asarray(face.curvature, np.float32) * np.float32(ring / _BEND)) ** 2))
    sigma = max(3.0, 0.5 * ring)
    line, _ = smooth_along(contrast, face.valid, face.orientation + np.float32(np.pi / 2), math.ceil(2 * sigma), sigma)
    # Rays and saw marks are lines across the rings as well, and all over the face.
    surely = max(_LINE, 4.0 * float(np.quantile(line[face.valid], 0.9)))
    thin = widened(contrast > 0.25 * surely, 2.0)
    for rows, cols, part in connected(line > surely, line > 0.5 * surely):
        shape = shape_of(part, cols.start, rows.start)
        if shape.length < max(shortest_rings * ring, _SLENDER * shape.thickness):
            continue
        if surroundings(rows, cols, part, face, smooth).across > _ACROSS:
            # Averaging across the rings smears a line that runs askew.
            found[rows, cols][part & thin[rows, cols]] = float(line[rows, cols][part].max()) / surely
    return found
