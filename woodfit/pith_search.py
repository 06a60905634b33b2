"""The likeliest pith lines: brute force over directions and depths, then descent from the best few."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from woodfit.fiber import FiberSight
from woodfit.pith_energy import RingPoints, direction_of, feet, frame_of, frames_of
from woodfit.pith_evidence import Evidence

FloatArray = npt.NDArray[np.float64]

#: Boards are sawn along or across the stem: departures from both cost, gently for large ones.
SAWN_WITHIN_RAD, SAWN_COST = 0.06, 1.5

#: Distance of the pith in sizes of the face from which on it gets unlikely, and the scatter of its log.
USUAL_DISTANCE, DISTANCE = 0.4, 0.6

#: Distance of the pith in sizes of the face below which all are as likely.
NEAR = 0.1

#: A board with the pith under its face is seldom sawn next to it, where it would crack, nor from a log many times as
#: thick: usual depth in sizes of the face, and the scatter of its log.
USUAL_DEPTH, DEPTH_SCATTER = 0.3, 0.4

#: How steep (component of the direction) and how far beside the middle (sizes of the face) a pith may run under a face.
UNDER_STEEP, UNDER_BESIDE = 0.17, 0.5

#: Steps of the charts: two angles (rad) and two offsets (sizes of the face).
STEP = 0.03

_TILTS = np.deg2rad([0.0, 3.0, 7.0, 12.0, 18.0, 25.0, 35.0, 50.0, 60.0, 67.0, 73.0, 79.0, 84.0, 88.0, 90.0])


@dataclass(frozen=True)
class Known:
    """What is known of a pith line beforehand; `None` where nothing is.

    Attributes
    ----------
    point : coordinates of the point nearest to the centre, px
    tilt, azimuth : angles in rad
    tilt_scatter : standard deviation of what is known of the tilt, rad
    """

    point: tuple[float | None, float | None, float | None] = (None, None, None)
    tilt: float | None = None
    azimuth: float | None = None
    tilt_scatter: float = 0.004

    @property
    def side(self) -> bool:
        """Whether it tells the two mirror images apart."""
        return self.point[2] is not None or self.azimuth is not None


@dataclass(frozen=True)
class Cost:
    """Evidence and prior together.

    Attributes
    ----------
    evidence : Evidence
    size_px : float
        Longest side of the faces.
    centre : array of shape (3,)
        Of the faces, px.
    along_face : float
        By how much a face along the stem is likelier than one across.
    known : Known
    fibers : FiberSight
        What the fine texture tells of the direction.
    """

    evidence: Evidence
    size_px: float
    centre: FloatArray
    along_face: float
    known: Known
    fibers: FiberSight

    def __call__(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """Negative log-probability (L,) of lines (L, 3), (L, 3)."""
        return self.evidence(origin, direction) + self.prior(origin, direction)

    def prior(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """Share (L,) of the prior."""
        foot = feet(origin, direction, self.centre)
        distance = np.linalg.norm(foot - self.centre, axis=1)
        far = np.log((distance / self.size_px + 0.02) / USUAL_DISTANCE) / DISTANCE
        upright = np.minimum(1.0, np.abs(direction[:, 2]))
        off_saw = np.minimum(np.arccos(upright), np.arcsin(upright))
        # A distance is a scale: without its logarithm the many places far away outweigh the few near ones.
        cost = np.log(distance / self.size_px + NEAR) + 0.5 * np.maximum(far, 0.0) ** 2
        cost += self.fibers.cost(direction) - self.along_face * (0.5 - upright**2)
        if not self.evidence.rings.solid:
            cost = cost + SAWN_COST * np.log1p((off_saw / SAWN_WITHIN_RAD) ** 2) + self._depth(foot, direction)
        for axis, value in enumerate(self.known.point):
            if value is not None:
                cost = cost + 0.5 * ((foot[:, axis] - value) / (0.002 * self.size_px)) ** 2
        if self.known.tilt is not None:
            cost = cost + 0.5 * ((np.arccos(upright) - self.known.tilt) / self.known.tilt_scatter) ** 2
        if self.known.azimuth is not None:
            towards = np.array([math.cos(self.known.azimuth), math.sin(self.known.azimuth)])
            sense = np.where(direction[:, 2] < 0.0, -1.0, 1.0)
            flat = direction[:, :2] * sense[:, None]
            aside = flat[:, 0] * towards[1] - flat[:, 1] * towards[0]
            # In the face a line has no sense; out of it, the sense is that of leaning.
            back = np.minimum(flat @ towards, 0.0) * (direction[:, 2] ** 2 > 1e-4)
            cost = cost + 0.5 * (aside**2 + back**2) / 0.004**2
        return np.asarray(cost)

    def _depth(self, foot: FloatArray, direction: FloatArray) -> FloatArray:
        """Cost (L,) of an unusual depth of piths under the face, through their points `foot` nearest to its centre."""
        beside, depth = np.hypot(foot[:, 0] - self.centre[0], foot[:, 1] - self.centre[1]), foot[:, 2] - self.centre[2]
        under = np.maximum(1.0 - (direction[:, 2] / UNDER_STEEP) ** 2, 0.0)
        under = under / (1.0 + (beside / (UNDER_BESIDE * self.size_px)) ** 6)
        unusual = np.log((np.abs(depth) / self.size_px + 1e-3) / USUAL_DEPTH) / DEPTH_SCATTER
        return np.asarray(0.5 * under * unusual**2)


def laterals(
    rings: RingPoints, centre: FloatArray, direction: FloatArray, depth_px: FloatArray, size_px: float
) -> FloatArray:
    """Offsets across the face at which the tangents are best at right angles to the radii.

    For lines along `direction` (L, 3) at `depth_px` (L,); NaN where the tangents do not tell.
    """
    across, inward = frames_of(direction)
    away = rings.points - centre
    x, y = across @ away.T, inward @ away.T - depth_px[:, None]
    # The radius, seen on the face, must be at right angles to the tangent: t . (away - offset across) = 0.
    left = across @ rings.tangents.T
    right = x * left + y * (inward @ rings.tangents.T)
    size = np.hypot(x, y) + 0.1 * size_px
    offset, power = np.zeros(len(depth_px)), np.zeros(len(depth_px))
    for _ in range(3):
        weight = rings.weight / size
        power = (weight * left * left).sum(axis=1)
        offset = (weight * left * right).sum(axis=1) / np.maximum(power, 1e-12)
        size = np.hypot(x - offset[:, None], y) + 0.1 * size_px
    return np.where(power < 1e-6 * weight.sum(axis=1), np.nan, offset)


def starts(rings: RingPoints, cost: Cost, both_sides: bool) -> tuple[FloatArray, FloatArray]:
    """Lines (L, 3), (L, 3) of many directions and depths, the tangents giving the offset across the face."""
    known = cost.known
    depths = cost.size_px * np.concatenate([[0.0], np.geomspace(0.03, 4.0, 15)])
    depth, direction = [], []
    for tilt in _TILTS if known.tilt is None else [known.tilt]:
        turns = 1 if tilt == 0.0 else 12 if tilt < 0.2 else 24
        for azimuth in np.arange(turns) * 2.0 * np.pi / turns if known.azimuth is None else [known.azimuth]:
            along = tilt > 1.2
            if azimuth >= np.pi and known.azimuth is None and (tilt == np.pi / 2 or not (along or both_sides)):
                continue
            # Under a face along the stem the depth has one sign, but for a mirror image; elsewhere it has two.
            signed = depths if along and not both_sides else np.concatenate([-depths[:0:-1], depths])
            signed = signed[:: 1 if along else 2]
            depth.append(signed)
            direction.append(np.tile(direction_of(float(tilt), float(azimuth)), (len(signed), 1)))
    inwards, lines = np.concatenate(depth), np.concatenate(direction)
    offset = laterals(rings, cost.centre, lines, inwards, cost.size_px)
    usable = np.abs(np.nan_to_num(offset, nan=np.inf)) < 20.0 * cost.size_px
    inwards, lines, offset = inwards[usable], lines[usable], offset[usable]
    across, inward = frames_of(lines)
    origin = feet(cost.centre + offset[:, None] * across + inwards[:, None] * inward, lines, cost.centre)
    for axis, value in enumerate(known.point):
        if value is not None:
            origin[:, axis] = value
    return origin, lines


def chart(
    origin: FloatArray, direction: FloatArray, steps: FloatArray, size_px: float
) -> tuple[FloatArray, FloatArray]:
    """Lines (L, 3), (L, 3) reached from one by `steps` (L, 4), in units of `STEP`: two tilts and two offsets."""
    across, inward = frame_of(direction)
    moved = STEP * steps
    turned = direction + moved[:, :1] * across + moved[:, 1:2] * inward
    turned = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return origin + size_px * (moved[:, 2:3] * across + moved[:, 3:4] * inward), turned


def on_chart(
    origin: FloatArray, direction: FloatArray, lines: tuple[FloatArray, FloatArray], size_px: float
) -> FloatArray:
    """Steps (L, 4) that reach `lines` by `chart`; NaN for lines across the direction."""
    across, inward = frame_of(direction)
    points, turned = lines
    along = turned @ direction
    turned = turned / np.where(np.abs(along) < 0.05, np.nan, along)[:, None]
    points = points - ((points - origin) @ direction)[:, None] * turned - origin
    steps = [turned @ across, turned @ inward, points @ across / size_px, points @ inward / size_px]
    return np.stack(steps, axis=1) / STEP


def distinct(
    cost: Cost, value: FloatArray, origin: FloatArray, direction: FloatArray, count: int, span: float
) -> list[int]:
    """The best lines that do not repeat one another, no worse than the best by more than `span`."""
    kept: list[int] = []
    for i in np.argsort(value):
        if len(kept) == count or (kept and value[i] > value[kept[0]] + span):
            break
        near = [
            abs(float(direction[i] @ direction[j])) > 0.98
            and np.linalg.norm(origin[i] - origin[j])
            < 0.1 * cost.size_px + 0.25 * np.linalg.norm(origin[j] - cost.centre)
            for j in kept
        ]
        if not any(near):
            kept.append(int(i))
    return kept


def descend(
    cost: Cost, origin: FloatArray, direction: FloatArray, rounds: int = 3, steps: int = 20
) -> tuple[float, FloatArray, FloatArray]:
    """Nearest likeliest line: value, the point of it nearest to the centre, direction."""
    h = 0.02
    value = math.inf
    for _ in range(rounds):
        # Every round has its own chart: far from its origin a chart is bent.
        def fall(step: FloatArray, at: FloatArray = origin, along: FloatArray = direction) -> tuple[float, FloatArray]:
            beside = np.concatenate([step[None], step + h * np.eye(4), step - h * np.eye(4)])
            values = cost(*chart(at, along, beside, cost.size_px))
            return float(values[0]), (values[1:5] - values[5:9]) / (2.0 * h)

        found = minimize(fall, np.zeros(4), jac=True, method="BFGS", options={"maxiter": steps, "gtol": 1e-2})
        points, lines = chart(origin, direction, found.x[None], cost.size_px)
        direction, origin = lines[0], feet(points[0], lines[0], cost.centre)
        gain, value = value - float(found.fun), float(found.fun)
        if gain < 0.02:
            break
    return value, origin, direction
