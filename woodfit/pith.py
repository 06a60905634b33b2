"""Where the board sat in the tree: the pith line that makes the traced rings round (paper, Sec. 3.4).

One model serves every cut. On a plane, the squared distance from a line is a quadratic whose second-order part is
fixed by the line's direction alone, so level sets of the ring age are ellipses, parabolas-like arcs or straight lines
depending on nothing but the tilt. For a given direction the tangents of the traced rings give the line's position by
linear least squares; what tangents cannot see (the depth of a pith parallel to the face) the regularity of the ring
widths decides. Points of several faces of one block are fitted just the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from woodfit.fiber import FiberSight
from woodfit.pith_energy import RingPoints, along_face_evidence, direction_of, spacing_px
from woodfit.pith_evidence import Evidence, Growth
from woodfit.pith_samples import Line, explore, middle
from woodfit.pith_search import Cost, Known, descend, distinct, starts
from woodfit.pith_spread import with_shape, with_short_arc

FloatArray = npt.NDArray[np.float64]

#: Vertices used: in the first search, and in all that follows.
FEW_VERTICES, VERTICES = 200, 400

#: Cosine of the angle between two stems from which on growth is looked at anew along the other.
SAME_STEM = 0.985

#: Sizes of distortion that are tried, in usual ones, and by how much less exact tracing may be against it than usual.
ROUNDNESS, EXACTNESS = (1.0, 0.5, 0.25, 0.125, 0.06, 0.03), (1.0, 2.0, 4.0, 8.0)

#: Size of distortion up to which a tree is so much rounder than usual that its own growth is used.
MUCH_ROUNDER = 0.26

#: Growth as it usually is, and with room for what the first look gets wrong.
USUAL, LOOSE = Growth(), Growth(strength=0.3, tracing=0.2, piece=0.1)

#: Growth as uneven as usual in a tree of any shape: stems are often one tenth wider one way than the other.
ANY_SHAPE = Growth(eccentric=0.1, oval=0.05, shaped_rings=math.inf)

#: Growth in a tree that is clearly not round, the log-odds from which on it is, and how steep (component of the
#: direction) a pith may then run to the face.
SHAPED, CLEARLY_SHAPED, ALONG_WITHIN = Growth(eccentric=0.08, oval=0.03, shaped_rings=50.0), 3.0, 0.17

#: Sawyers cut across the stem within so much of square (one standard deviation, rad). A pith up to so far from square
#: (rad) is taken for square where oval growth explains the rings up to so many times as badly (squared misfit).
SQUARE_WITHIN_RAD, NOT_ALONG_RAD, NEARLY_AS_WELL = 0.05, math.radians(65.0), 1.5

#: How often outliers and growth are found in turn.
ROUNDS = 3

#: Share of the stem's direction in the face from which on it runs along it; depths tried then, in sizes of the face.
ALONG_FACE, DEPTHS = 0.8, (0.07, 0.2, 0.5)


@dataclass(frozen=True)
class Pith:
    """A pith line in the board frame.

    Attributes
    ----------
    point : array of shape (3,)
        The line's point nearest to the faces' centre, px.
    direction : array of shape (3,)
        Unit vector.
    energy : float
        Negative log-probability, up to a constant.
    spread : array of shape (4,)
        One standard deviation of two direction angles (rad) and two offsets (px): across the line in the face, and
        across it into the wood.
    mirrors : bool
        Whether the mirror image in the photographed face explains the rings as well.
    centre : array of shape (3,), optional
        The faces' centre, px.
    """

    point: FloatArray
    direction: FloatArray
    energy: float
    spread: FloatArray
    mirrors: bool = True
    centre: FloatArray | None = None


@dataclass(frozen=True)
class Fixed:
    """What the user knows: coordinates of the nearest point (px), tilt and azimuth (degrees), mean ring width (px)."""

    point: tuple[float | None, float | None, float | None]
    tilt_deg: float | None
    azimuth_deg: float | None
    width_px: float | None = None

    @property
    def known(self) -> Known:
        """The same for the search."""
        tilt, azimuth = (None if angle is None else math.radians(angle) for angle in (self.tilt_deg, self.azimuth_deg))
        return Known(self.point, tilt, azimuth)

    def overrule(self, point: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Put the known values in place of fitted ones."""
        chosen = np.array([p if k is None else k for p, k in zip(point, self.point, strict=True)], np.float64)
        tilt = math.acos(min(1.0, abs(float(direction[2])))) if self.tilt_deg is None else math.radians(self.tilt_deg)
        upright = direction if direction[2] >= 0.0 else -direction
        azimuth = math.atan2(upright[1], upright[0]) if self.azimuth_deg is None else math.radians(self.azimuth_deg)
        if self.tilt_deg is None and self.azimuth_deg is None:
            return chosen, direction
        return chosen, direction_of(tilt, azimuth)


NOTHING_FIXED = Fixed((None, None, None), None, None)


def fit_pith(
    rings: RingPoints,
    size_px: float,
    pith_behind: bool = True,
    grain_ratio: float = 1.08,
    aspect: float = 1.0,
    fixed: Fixed | None = None,
    centre: FloatArray | None = None,
    fibers: FiberSight | None = None,
    seed: int = 0,
) -> Pith:
    """Pith line in the middle of those that explain the rings about equally well.

    Parameters
    ----------
    rings : RingPoints
        Sampled boundaries, of one face or several.
    size_px : float
        Longest side of the faces.
    pith_behind : bool
        Which of the two mirror solutions to take when all points lie on one plane: the pith behind the face
        (z >= 0 at the face's centre) or in front of it. The image does not tell.
    grain_ratio, aspect : float
        Slope of the fine texture across over along the rings; longer over shorter side of the face.
    fixed : Fixed, optional
        What the user knows; the rest is fitted to that.
    centre : array of shape (3,), optional
        Centre of the faces, px; of the points if not given.
    fibers : FiberSight, optional
        What the fine texture of the faces tells of the direction.
    seed : int
        Of the random walk that finds the spread.

    Returns
    -------
    Pith

    Raises
    ------
    ValueError
        If the tangents fit no direction.
    """
    fixed = fixed or NOTHING_FIXED
    known, solid = fixed.known, rings.solid
    mirrors = not solid and not known.side
    centre = rings.centre if centre is None else np.asarray(centre, np.float64)
    along_face = 0.0 if solid else along_face_evidence(grain_ratio, aspect)
    spacing = spacing_px(rings)
    few, many = rings.thinned(FEW_VERTICES), rings.thinned(VERTICES)

    def cost_of(
        part: RingPoints,
        growth: Growth,
        doubt: FloatArray | None = None,
        stem: FloatArray | None = None,
        roughness: FloatArray | None = None,
        known: Known = known,
    ) -> Cost:
        # Doubt is told per polyline; a thinned set may lack the last ones.
        evidence = Evidence(part, spacing, growth, doubt, fixed.width_px, stem, roughness)
        return Cost(evidence, size_px, centre, along_face, known, fibers or FiberSight.nothing())

    found = _found(cost_of, few, USUAL, not mirrors)
    best = min(found, key=lambda line: line[0])
    # From here on growth changes slowly along the stem, which is known well enough by now.
    cost, modes = _along(best, found, cost_of, few, many, USUAL)
    usual = USUAL if solid else _usual_growth(modes[0], cost_of, few)
    if usual != USUAL or abs(float(modes[0][2] @ best[2])) < SAME_STEM:
        cost, modes = _along(modes[0], modes, cost_of, few, many, usual)
    square = not solid and fixed.tilt_deg is None and fixed.azimuth_deg is None and _is_square(modes[0], cost_of, few)
    if square:
        held = partial(cost_of, known=replace(known, tilt=0.0))
        found = _found(held, few, USUAL, False)
        cost, modes = _along(min(found, key=lambda line: line[0]), found, held, few, many, USUAL)
    steps = explore(cost, modes, np.random.default_rng(seed))
    (energy, point, along), spread = middle(cost, modes[0], steps, mirrors)
    if square:
        # A tilt is not seen: how square cuts are is all that is known.
        spread[:2] = np.maximum(spread[:2], SQUARE_WITHIN_RAD)
    # A tree that strays farther from round than usual leaves its pith less sure (reduced chi-square).
    spread = spread * max(1.0, math.sqrt(cost.evidence.unevenness(point, along)))
    if not solid:
        spread = with_short_arc(spread, point, along, centre, rings)
        if not square:
            spread = with_shape(spread, point, along, rings, cost.evidence.growth.strength / USUAL.strength)
    if mirrors and (point[2] < 0.0) == pith_behind and point[2] != 0.0:
        # Mirror in the face: the photograph is the same.
        point, along = point * [1.0, 1.0, -1.0], along * [1.0, 1.0, -1.0]
    main = int(np.argmax(np.abs(along)))
    point, along = fixed.overrule(point, along if along[main] >= 0.0 else -along)
    return Pith(point, along, energy, spread, mirrors, centre)


def _found(cost_of: Callable[..., Cost], rings: RingPoints, growth: Growth, both_sides: bool) -> list[Line]:
    """Likely lines of a first look, from brute force and a short descent."""
    loose, cost = cost_of(rings, LOOSE), cost_of(rings, growth)
    origin, direction = starts(rings, loose, both_sides)
    if not len(origin):
        raise ValueError("the traced rings do not constrain the pith: no direction fits their tangents")
    parts = np.array_split(np.arange(len(origin)), max(1, len(origin) // 400))
    value = np.concatenate([loose.evidence.rough(origin[i], direction[i]) for i in parts])
    value += loose.prior(origin, direction)
    return [descend(cost, origin[i], direction[i], 2, 15) for i in distinct(loose, value, origin, direction, 8, 30.0)]


def _is_square(mode: Line, cost_of: Callable[..., Cost], rings: RingPoints) -> bool:
    """Whether a tree of any usual shape, cut square to its stem, explains the rings as well as the likeliest line.

    An ellipse is a tilted circle or an oval tree. Trees are oval and cuts across the stem are square, so that is the
    rule unless the face lies along the stem or the rings are farther from round than trees are.
    """
    if abs(float(mode[2][2])) < math.cos(NOT_ALONG_RAD):
        return False
    shaped = cost_of(rings, ANY_SHAPE)
    held = partial(cost_of, known=replace(shaped.known, tilt=0.0))
    upright_lines = _found(held, rings, ANY_SHAPE, False)
    lines = [min(upright_lines, key=lambda line: line[0]), descend(shaped, mode[1], mode[2])]
    upright, tilted = (float(shaped.evidence.rounded(line[1][None], line[2][None])[3][0]) for line in lines)
    return upright <= NEARLY_AS_WELL * tilted


def _usual_growth(line: Line, cost_of: Callable[..., Cost], rings: RingPoints) -> Growth:
    """Usual growth of a tree that is nearly round, or of any shape where the rings about a line tell it clearly.

    Nearly round is the rule because a shape can be mistaken for a place of the pith. But above a pith along the face
    many rings show both their sides, and where they are clearly not round the pith must not be moved to make them so.
    """
    if abs(float(line[2][2])) > ALONG_WITHIN:
        return USUAL
    costs = [cost_of(rings, growth, stem=line[2]) for growth in (USUAL, SHAPED)]
    usual, shaped = (descend(cost, line[1], line[2])[0] for cost in costs)
    return SHAPED if shaped < usual - CLEARLY_SHAPED else USUAL


def _along(
    best: Line,
    found: list[Line],
    cost_of: Callable[..., Cost],
    few: RingPoints,
    many: RingPoints,
    usual: Growth,
) -> tuple[Cost, list[Line]]:
    """Cost with growth as it shows about the best line, changing slowly along it, and its likeliest lines.

    Polylines that seem misnumbered are discounted, and on a tree rounder than usual vertices that stick out.
    """
    _, point, stem = best
    growth = _shown_growth(best, cost_of, few, usual)
    cost = cost_of(many, growth, stem=stem)
    doubt = cost.evidence.doubtful(point, stem)
    if doubt.any():
        cost = cost_of(many, growth, doubt, stem)
    if growth != usual:
        for _ in range(ROUNDS):
            cost = cost_of(many, growth, doubt, stem, cost.evidence.rougher(point, stem))
        cost.evidence.calibrate(point, stem)
    return cost, _modes(cost, found)


def _shown_growth(best: Line, cost_of: Callable[..., Cost], rings: RingPoints, usual: Growth) -> Growth:
    """Growth under which the vertices surprise least about the best line, where much rounder than usual; else usual."""
    _, point, stem = best
    doubt = cost_of(rings, usual, stem=stem).evidence.doubtful(point, stem)
    # Tracing is never taken for more exact against the distortion than usual: what the distortion's model does not
    # foresee would then pass for a tilt of the pith.
    tried = [usual.scaled(size, size * exactness) for size in ROUNDNESS for exactness in EXACTNESS]
    roughness = None
    for _ in range(ROUNDS):
        tries = [cost_of(rings, growth, doubt, stem, roughness).evidence for growth in tried]
        least = min(tries, key=lambda evidence: evidence.surprise(point, stem))
        roughness = least.rougher(point, stem)
    return least.growth if least.growth.strength <= MUCH_ROUNDER * usual.strength else usual


def _modes(cost: Cost, found: list[Line]) -> list[Line]:
    """Distinct likeliest lines on the full set of vertices, the best first."""
    value, origin, direction = (np.array([line[i] for line in found]) for i in range(3))
    again = [descend(cost, origin[i], direction[i]) for i in distinct(cost, value, origin, direction, 3, 8.0)]
    _, point, stem = min(again, key=lambda line: line[0])
    again += [descend(cost, *start) for start in _other_depths(cost, point, stem)]
    value, origin, direction = (np.array([line[i] for line in again]) for i in range(3))
    return [again[i] for i in distinct(cost, value, origin, direction, 4, 12.0)]


def _other_depths(cost: Cost, point: FloatArray, stem: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Lines parallel to the face under a line along it, at other depths, which rings on a board hardly tell apart."""
    flat = math.hypot(stem[0], stem[1])
    if flat < ALONG_FACE:
        return []
    side = math.copysign(cost.size_px, point[2] - cost.centre[2])
    parallel = np.array([stem[0], stem[1], 0.0]) / flat
    return [(np.array([point[0], point[1], cost.centre[2] + share * side]), parallel) for share in DEPTHS]


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
