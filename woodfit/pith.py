"""Where the board sat in the tree: the pith line that makes the traced rings round (paper, Sec. 3.4).

One model serves every cut. On a plane, the squared distance from a line is a quadratic whose second-order part is
fixed by the line's direction alone, so level sets of the ring age are ellipses, parabolas-like arcs or straight lines
depending on nothing but the tilt. For a given direction the tangents of the traced rings give the line's position by
linear least squares; what tangents cannot see (the depth of a pith parallel to the face) the regularity of the ring
widths decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

FloatArray = npt.NDArray[np.float64]

#: Expected scatter: a boundary about its circle (in rings), a ring width from one year to the next and from the
#: face's mean (in log width), the distance of the pith from the face's centre (in log of the face's size, about
#: USUAL_DISTANCE of it).
SCATTER_RINGS, YEAR_TO_YEAR, FROM_MEAN, DISTANCE, USUAL_DISTANCE = 0.35, 0.30, 0.45, 1.0, 0.5

#: Independent looks at a boundary. Few: neighbouring vertices, and neighbouring rings too, share their distortion,
#: so that an oval tree must not pass for a tilted one.
LOOKS_PER_RING = 1.5

#: Boards are sawn along or across the stem: departures from both cost, gently for large ones.
SAWN_WITHIN_RAD, SAWN_COST = 0.08, 3.0


@dataclass(frozen=True)
class RingPoints:
    """Sampled vertices of traced boundaries.

    Attributes
    ----------
    points : array of shape (K, 3)
        Board frame, px.
    tangents : array of shape (K, 3)
        Unit tangents of the boundaries, board frame.
    ring : int array of shape (K,)
        Position in the table of boundaries below.
    weight : array of shape (K,)
        Confidence.
    index, group : int arrays of shape (R,)
        Ring index (growing outwards) and group of each boundary; pieces of one boundary share an entry.
    """

    points: FloatArray
    tangents: FloatArray
    ring: npt.NDArray[np.int64]
    weight: FloatArray
    index: npt.NDArray[np.int64]
    group: npt.NDArray[np.int64]


@dataclass(frozen=True)
class Pith:
    """A pith line in the board frame.

    Attributes
    ----------
    point : array of shape (3,)
        The line's point nearest to the face's centre, px.
    direction : array of shape (3,)
        Unit vector.
    energy : float
        What the fit minimised.
    spread : array of shape (4,)
        One standard deviation of two direction angles (rad) and two offsets (px).
    """

    point: FloatArray
    direction: FloatArray
    energy: float
    spread: FloatArray


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
class Fixed:
    """What the user knows of the pith: coordinates of its nearest point (px), tilt and azimuth (degrees)."""

    point: tuple[float | None, float | None, float | None]
    tilt_deg: float | None
    azimuth_deg: float | None

    def overrule(self, point: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Put the known values in place of fitted ones."""
        chosen = np.array([p if k is None else k for p, k in zip(point, self.point, strict=True)], np.float64)
        tilt = math.acos(min(1.0, abs(float(direction[2])))) if self.tilt_deg is None else math.radians(self.tilt_deg)
        upright = direction if direction[2] >= 0.0 else -direction
        azimuth = math.atan2(upright[1], upright[0]) if self.azimuth_deg is None else math.radians(self.azimuth_deg)
        if self.tilt_deg is None and self.azimuth_deg is None:
            return chosen, direction
        return chosen, _direction(tilt, azimuth)


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


def sample_rings(
    polylines: list[FloatArray],
    confidence: list[FloatArray],
    index: npt.NDArray[Any],
    group: npt.NDArray[Any],
    per_ring: int = 24,
) -> RingPoints:
    """Evenly spaced vertices of each boundary with tangents; pieces of one boundary are merged.

    Parameters
    ----------
    polylines, confidence : lists of arrays of shape (K, 2) and (K,)
        Boundaries (x, y in px) and the confidence of their vertices.
    index, group : int arrays of shape (R,)
        From `woodfit.ring_order`.
    per_ring : int
        Most vertices taken from one polyline.

    Returns
    -------
    RingPoints
    """
    keys = np.stack([np.asarray(group), np.asarray(index)], axis=1)
    table, inverse = np.unique(keys, axis=0, return_inverse=True)
    points, tangents, ring, weight = [], [], [], []
    for number, (line, belief) in enumerate(zip(polylines, confidence, strict=True)):
        if len(line) < 8:
            continue
        pick = np.unique(np.linspace(3, len(line) - 4, min(per_ring, len(line))).round().astype(int))
        chord = line[np.minimum(pick + 3, len(line) - 1)] - line[np.maximum(pick - 3, 0)]
        length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)
        points.append(np.column_stack([line[pick], np.zeros(len(pick))]))
        tangents.append(np.column_stack([chord / length[:, None], np.zeros(len(pick))]))
        ring.append(np.full(len(pick), inverse.ravel()[number]))
        weight.append(np.maximum(belief[pick], 0.02) * len(line) / len(pick))
    if not points:
        raise ValueError("no traced ring boundary is long enough to place the pith (at least 8 vertices are needed)")
    mass = np.concatenate(weight)
    return RingPoints(
        np.concatenate(points),
        np.concatenate(tangents),
        np.concatenate(ring),
        mass / mass.mean(),
        table[:, 1].astype(np.int64),
        table[:, 0].astype(np.int64),
    )


def frame_of(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors across `direction`: the first lies in the face, the second points into the wood."""
    across = np.array([-direction[1], direction[0], 0.0])
    if np.hypot(across[0], across[1]) < 1e-9:
        across = np.array([1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    inward = np.cross(direction, across)
    if inward[2] < 0.0:
        inward = -inward
    return across, inward


def radii(points: npt.NDArray[Any], origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Distance of points (..., 3) from a line."""
    away = np.asarray(points) - origin
    along = away @ direction
    return np.asarray(np.sqrt(np.maximum((away * away).sum(axis=-1) - along * along, 0.0)))


class _Energy:
    """Misfit of a pith line: how far the rings are from round, and their widths from regular."""

    def __init__(self, rings: RingPoints, size_px: float, along_face: float = 0.0) -> None:
        self.rings = rings
        self.along_face = along_face
        self.size_px = size_px
        self.centre = np.array([*np.average(rings.points[:, :2], axis=0, weights=rings.weight), 0.0])
        count = len(rings.index)
        self.count = count
        self.mass = np.bincount(rings.ring, rings.weight, minlength=count)
        self.looks = LOOKS_PER_RING * np.minimum(1.0, self.mass / np.maximum(np.median(self.mass), 1e-9))
        order = np.lexsort((rings.index, rings.group))
        inner, outer = order[:-1], order[1:]
        same = rings.group[inner] == rings.group[outer]
        self.inner, self.outer = inner[same], outer[same]
        self.apart = (rings.index[self.outer] - rings.index[self.inner]).astype(float)

    def __call__(self, origin: FloatArray, direction: FloatArray) -> float:
        rings = self.rings
        r = radii(rings.points, origin, direction)
        mean = np.bincount(rings.ring, rings.weight * r, minlength=self.count) / np.maximum(self.mass, 1e-9)
        distance = float(np.linalg.norm(origin - self.centre))
        far = math.log((distance / self.size_px + 0.02) / USUAL_DISTANCE) / DISTANCE
        off_saw = min(math.acos(min(1.0, abs(float(direction[2])))), math.asin(min(1.0, abs(float(direction[2])))))
        prior = 0.5 * max(far, 0.0) ** 2 + SAWN_COST * math.log1p((off_saw / SAWN_WITHIN_RAD) ** 2)
        prior -= self.along_face * (0.5 - float(direction[2]) ** 2)
        if len(self.inner) == 0:
            width = max(float(np.ptp(r)), 1.0)
            scatter = self._scatter(r - mean[rings.ring], width)
            return scatter + prior
        widths = (mean[self.outer] - mean[self.inner]) / self.apart
        typical = float(np.average(np.abs(widths), weights=self.apart)) + 1e-9
        # Widths must grow outwards: a width that vanishes or turns negative costs, but without a cliff.
        logs = np.log(np.maximum(widths / typical, 0.02))
        backwards = float((np.minimum(widths / typical - 0.02, 0.0) ** 2).sum())
        share = 1.0 / self.apart
        level = float((share * np.minimum((logs / FROM_MEAN) ** 2, 9.0)).sum()) / 2.0
        step = np.diff(logs)
        year = float(np.minimum((step / (YEAR_TO_YEAR * 1.5)) ** 2, 9.0).sum()) / 2.0
        return self._scatter(r - mean[rings.ring], typical) + level + year + 20.0 * backwards + prior

    def _scatter(self, residual: FloatArray, width: float) -> float:
        square = (residual / (SCATTER_RINGS * width)) ** 2
        robust = 2.0 * (np.sqrt(1.0 + square) - 1.0)
        per_ring = np.bincount(self.rings.ring, self.rings.weight * robust, minlength=self.count)
        return float((self.looks * per_ring / np.maximum(self.mass, 1e-9)).sum()) / 2.0

    def lateral(self, direction: FloatArray, depth_px: float) -> float | None:
        """Offset across the face at which the tangents are best at right angles to the radii."""
        rings = self.rings
        across, inward = frame_of(direction)
        away = rings.points - self.centre
        across_all = away - np.outer(away @ direction, direction) - depth_px * inward
        # The radius, seen on the face, must be at right angles to the tangent: t . (away - offset across) = 0.
        left = rings.tangents @ across
        right = (rings.tangents * across_all).sum(axis=1)
        size = np.linalg.norm(across_all, axis=1) + 0.1 * self.size_px
        for _ in range(3):
            weight = rings.weight / size
            power = float((weight * left * left).sum())
            if power < 1e-6 * float(weight.sum()):
                return None
            offset = float((weight * left * right).sum() / power)
            size = np.linalg.norm(across_all - offset * across, axis=1) + 0.1 * self.size_px
        return offset


def _direction(tilt: float, azimuth: float) -> FloatArray:
    """Unit vector `tilt` rad away from the face's normal, towards `azimuth` in the face."""
    return np.array(
        [math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt)], np.float64
    )


def along_face_evidence(grain_ratio: float, aspect: float) -> float:
    """Energy by which a face along the stem is likelier than one across it.

    Fibres make the fine texture run along the rings of a longitudinal face, rays and tracheid rows make it run across
    them on end grain. A long narrow strip is a core, sanded across the stem.
    """
    grain = 6.0 * math.log(max(grain_ratio, 1e-3) / 1.08)
    return float(np.clip(grain, -4.0, 6.0)) - (3.0 if aspect > 5.0 else 0.0)


def fit_pith(
    rings: RingPoints,
    size_px: float,
    pith_behind: bool = True,
    grain_ratio: float = 1.08,
    aspect: float = 1.0,
    fixed: Fixed | None = None,
) -> Pith:
    """Pith line by brute force over directions and depths, then simplex refinement of the best few.

    Parameters
    ----------
    rings : RingPoints
        Sampled boundaries.
    size_px : float
        Longer side of the face.
    pith_behind : bool
        Which of the two mirror solutions to take: the pith behind the face (z >= 0 at the face's centre) or in
        front of it. The image does not tell.
    grain_ratio, aspect : float
        Slope of the fine texture across over along the rings; longer over shorter side of the face.
    fixed : Fixed, optional
        What the user knows; it overrules the fit.

    Returns
    -------
    Pith
    """
    energy = _Energy(rings, size_px, along_face_evidence(grain_ratio, aspect))
    depths = size_px * np.concatenate([[0.0], np.geomspace(0.03, 4.0, 15)])
    starts: list[tuple[float, FloatArray]] = []
    for tilt in np.deg2rad([0.0, 5.0, 12.0, 22.0, 35.0, 50.0, 62.0, 72.0, 80.0, 85.0, 88.0, 90.0]):
        turns = 1 if tilt == 0.0 else 24
        for azimuth in np.arange(turns) * 2.0 * np.pi / turns:
            if tilt == np.pi / 2 and azimuth >= np.pi:
                continue
            direction = _direction(float(tilt), float(azimuth))
            across, inward = frame_of(direction)
            # On end grain the second offset lies in the face too and takes either sign.
            signed = depths if tilt > 1.2 else np.concatenate([-depths[:0:-1], depths])
            for depth in signed[:: 1 if tilt > 1.2 else 2]:
                lateral = energy.lateral(direction, float(depth))
                if lateral is None or abs(lateral) > 20.0 * size_px:
                    continue
                origin = energy.centre + lateral * across + depth * inward
                starts.append((energy(origin, direction), np.array([tilt, azimuth, lateral, depth])))
    if not starts:
        raise ValueError("the traced rings do not constrain the pith: no direction fits their tangents")
    starts.sort(key=lambda item: item[0])
    best: tuple[float, FloatArray, FloatArray] | None = None
    for _, start in _distinct(starts, 4, size_px):
        candidate = _refine(energy, start, size_px)
        if best is None or candidate[0] < best[0]:
            best = candidate
    assert best is not None
    value, origin, direction = best
    spread = _spread(energy, origin, direction, size_px)
    origin = origin - ((origin - energy.centre) @ direction) * direction
    if (origin[2] < 0.0) == pith_behind and origin[2] != 0.0:
        # Mirror in the face: the photograph is the same.
        origin, direction = origin * [1.0, 1.0, -1.0], direction * [1.0, 1.0, -1.0]
    main = int(np.argmax(np.abs(direction)))
    if direction[main] < 0.0:
        direction = -direction
    if fixed is not None:
        origin, direction = fixed.overrule(origin, direction)
    return Pith(origin, direction, value, spread)


def _distinct(starts: list[tuple[float, FloatArray]], count: int, size_px: float) -> list[tuple[float, FloatArray]]:
    """The best starts that do not repeat one another."""
    kept: list[tuple[float, FloatArray]] = []
    for value, start in starts:
        away = [
            abs(start[0] - other[0]) > 0.25
            or abs(np.sin(start[1] - other[1])) * np.sin(start[0]) > 0.3
            or abs(start[3] - other[3]) > 0.25 * size_px
            for _, other in kept
        ]
        if all(away):
            kept.append((value, start))
        if len(kept) == count:
            break
    return kept


def _chart(
    origin: FloatArray, direction: FloatArray, step: npt.NDArray[Any], size_px: float
) -> tuple[FloatArray, FloatArray]:
    """Line reached from another by small steps: two tilts (rad) and two offsets (in face sizes)."""
    across, inward = frame_of(direction)
    turned = direction + step[0] * across + step[1] * inward
    return origin + size_px * (step[2] * across + step[3] * inward), turned / np.linalg.norm(turned)


def _refine(energy: _Energy, start: FloatArray, size_px: float) -> tuple[float, FloatArray, FloatArray]:
    direction = _direction(start[0], start[1])
    across, inward = frame_of(direction)
    origin = energy.centre + start[2] * across + start[3] * inward
    reach = 0.1
    for _ in range(3):
        # Restarts of the simplex on a fresh chart: it stalls in the long valley between distance and scale.
        found = minimize(
            lambda step, o=origin, d=direction: energy(*_chart(o, d, step, size_px)),
            np.zeros(4),
            method="Nelder-Mead",
            options={
                "initial_simplex": np.vstack([np.zeros(4), np.diag([reach, reach, reach, reach])]),
                "maxfev": 500,
                "xatol": 1e-5,
                "fatol": 1e-4,
            },
        )
        origin, direction = _chart(origin, direction, found.x, size_px)
        origin = origin - ((origin - energy.centre) @ direction) * direction
        reach *= 0.4
    return float(found.fun), origin, direction


def _spread(energy: _Energy, origin: FloatArray, direction: FloatArray, size_px: float) -> FloatArray:
    """Standard deviations from the curvature of the energy (a negative log-likelihood); large where it is flat."""
    h = np.array([0.02, 0.02, 0.02, 0.02])
    hessian = np.empty((4, 4))
    for i in range(4):
        for j in range(i, 4):
            total = 0.0
            for si in (-1, 1):
                for sj in (-1, 1):
                    step = np.zeros(4)
                    step[i] += si * h[i]
                    step[j] += sj * h[j]
                    total += si * sj * energy(*_chart(origin, direction, step, size_px))
            hessian[i, j] = hessian[j, i] = total / (4.0 * h[i] * h[j])
    values, vectors = np.linalg.eigh(hessian)
    variance = (vectors**2 / np.maximum(values, 0.05)[None, :]).sum(axis=1)
    return np.asarray(np.sqrt(variance) * [1.0, 1.0, size_px, size_px])


def board_to_tree(pith: Pith, centre: FloatArray) -> FloatArray:
    """Rigid 4x4 transform from the board frame to the tree frame, px to px.

    z runs along the pith, with height 0 at the foot of `centre` (board frame, px); azimuth 0 points towards `centre`,
    so that the branch cut of the azimuth lies on the far side of the tree.
    """
    z = pith.direction
    foot = pith.point + ((centre - pith.point) @ z) * z
    return _rigid(foot, centre - foot, z)


def _rigid(origin: FloatArray, x: FloatArray, z: FloatArray) -> FloatArray:
    if np.linalg.norm(x) < 1e-6:
        x = np.cross([0.0, 1.0, 0.0], z) if abs(z[1]) < 0.9 else np.cross([1.0, 0.0, 0.0], z)
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ origin
    return matrix


def ring_radii(
    rings: RingPoints, pith: Pith, smallest_share: float = 0.25
) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray]:
    """Ideal radius of every boundary from the pith out.

    Groups that no vote ties to the largest are shifted by the whole number of rings that fits their radii best.
    Boundaries that were not traced lie evenly between their neighbours; those inside the innermost continue with the
    mean width down to the pith, whose age is 0.

    Parameters
    ----------
    rings, pith
        The sampled boundaries and the fitted line.
    smallest_share : float
        Least width of a ring, as a share of the mean width.

    Returns
    -------
    radius : array of shape (N,)
        Increasing; entry n is the radius at ring age n, entry 0 is 0.
    shift : int array of shape (G,)
        For each group, what to add to a ring index to get the age of that boundary.
    width : float
        Mean ring width, px (shape ()).
    """
    r = radii(rings.points, pith.point, pith.direction)
    of_ring = [rings.ring == i for i in range(len(rings.index))]
    mean = np.array([_weighted_median(r[mine], rings.weight[mine]) for mine in of_ring])
    index, group = rings.index, rings.group
    main = group == 0
    span = int(np.ptp(index[main]))
    if span > 0:
        width = float((mean[main].max() - mean[main].min()) / span)
        slope = np.polyfit(index[main], mean[main], 1)[0]
        width = float(max(abs(slope), 0.3 * width, 1e-3))
    else:
        width = float(max(np.ptp(r), 1.0))
    innermost = int(index[main].min())
    first = max(1, round(float(mean[main][index[main] == innermost][0]) / width))
    shift = np.zeros(int(group.max()) + 1, np.int64)
    shift[0] = first - innermost
    known: dict[int, list[tuple[float, float]]] = {}
    mass = np.bincount(rings.ring, rings.weight, minlength=len(index))
    for number in range(len(shift)):
        members = np.flatnonzero(group == number)
        if number > 0:
            ages = np.array(sorted(known))
            table = _mean_radii(known, ages)
            guess = _age_at(mean[members], ages, table, width)
            shift[number] = round(float(np.average(guess - index[members], weights=mass[members])))
        for i in members:
            known.setdefault(int(index[i] + shift[number]), []).append((float(mean[i]), float(mass[i])))
    least = min(known)
    if least < 1:
        shift += 1 - least
        known = {age + 1 - least: value for age, value in known.items()}
    ages = np.array(sorted(known))
    table = _mean_radii(known, ages)
    weights = np.array([sum(m for _, m in known[a]) for a in ages])
    return _monotone(ages, table, weights, width, smallest_share), shift, np.asarray(width)


def _mean_radii(known: dict[int, list[tuple[float, float]]], ages: npt.NDArray[Any]) -> FloatArray:
    """Mass-weighted mean radius at each age."""
    return np.array([sum(r * m for r, m in known[a]) / sum(m for _, m in known[a]) for a in ages])


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    if len(values) == 0:
        return 0.0
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _age_at(radius: FloatArray, ages: npt.NDArray[Any], table: FloatArray, width: float) -> FloatArray:
    """Ring age at a radius, continued with the mean width beyond the table."""
    inside = np.interp(radius, np.maximum.accumulate(table), ages)
    below, above = np.minimum(radius - table[0], 0.0), np.maximum(radius - table[-1], 0.0)
    return np.asarray(inside + (below + above) / width)


def _monotone(
    ages: npt.NDArray[Any], table: FloatArray, weights: FloatArray, width: float, smallest_share: float
) -> FloatArray:
    """Increasing radii at ages 0, 1, ... through a noisy table of some of them (pool adjacent violators)."""
    least = smallest_share * width
    values = table - least * ages
    blocks: list[list[float]] = []
    for value, weight in zip(values, weights, strict=True):
        blocks.append([value, weight, 1.0])
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            v, w, n = blocks.pop()
            blocks[-1] = [
                (blocks[-1][0] * blocks[-1][1] + v * w) / (blocks[-1][1] + w),
                blocks[-1][1] + w,
                blocks[-1][2] + n,
            ]
    level = np.concatenate([np.full(int(n), v) for v, _, n in blocks])
    fitted = level + least * ages
    fitted = fitted + max(0.0, 0.2 * least * ages[0] - fitted[0])
    every = np.arange(int(ages[-1]) + 1)
    return np.asarray(np.interp(every, np.concatenate([[0], ages]), np.concatenate([[0.0], fitted])))
