"""How likely a pith line is, given the traced rings of a tree that did not grow exactly round.

Every vertex of a boundary lies at that boundary's own radius but for a distortion that is smooth in the wood (a
Gaussian process), for eccentric, oval and tapering growth in the tree's own coordinates, and for the error of tracing.
All of them enter linearly, with Gaussian priors, and are integrated out together with the radii of the boundaries: an
oval tree then does not pass for a tilted one, and what spread is left in the pose is honest. The widths of the rings,
which follow from their radii, vary from year to year about a level that changes slowly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from woodfit.inner_rings import age_trend
from woodfit.pith_energy import RingPoints, frames_of

FloatArray = npt.NDArray[np.float64]

#: One standard deviation of taper (share of the radius in one ring width along the stem), and how far along the stem,
#: in ring widths, until the shape has changed by as much again.
TAPER, CHANGE_RINGS = 0.002, 30.0

#: Log width of a ring: scatter from year to year and of the level, and the share of each kept from the year before.
YEAR_SCATTER, YEAR_MEMORY, LEVEL_SCATTER, LEVEL_MEMORY = 0.25, 0.5, 0.2, 0.97

#: Scatters from year to year that are tried, in usual ones, and the scatter of their logarithm.
EVENNESS, EVEN_SCATTER = (0.125, 0.25, 0.5, 1.0, 1.5), 1.0

#: Widths below this share of the mean count as this: lines nearer to one another may be grain.
LEAST_SHARE = 0.25

#: How many degrees of freedom the usual strength of distortion is worth against the one that the rings show.
USUAL_STRENGTH = 40.0

#: How much of the usual age trend of widths to expect.
TREND = 0.7

#: Vertices that all others contradict by more standard deviations than this are traced the less exactly.
OUTLIER = 2.0

#: Part of a ring that traced boundaries are not better than: which part of the step is followed depends on its breadth.
TRACED_WITHIN = 0.03

#: Rings of an old tree, and the scatter of the log of the age beyond.
OLD_RINGS, OLD_SCATTER = 80.0, 0.7


@dataclass(frozen=True)
class Growth:
    """How far from round the tree grew and how exactly it was traced, in ring widths.

    Attributes
    ----------
    strength : float
        Standard deviation of the smooth distortion.
    reach : tuple of float
        Its lengths of correlation across the stem: growth is uneven on several scales, each with a like share.
    along : float
        By how much it reaches farther along the stem, where its direction is known: growth there changes slowly.
    tracing, piece : float
        Standard deviation of a vertex, and of a whole polyline, about the true boundary.
    eccentric, oval : float
        Standard deviation of eccentric and oval growth, shares of the radius.
    shaped_rings : float
        How many rings a tree has until its shape no longer counts as a share of the radius: far from the pith that
        would explain any rings.
    """

    strength: float = 0.2
    reach: tuple[float, ...] = (4.0, 12.0)
    along: float = 2.5
    tracing: float = 0.1
    piece: float = 0.05
    eccentric: float = 0.04
    oval: float = 0.02
    shaped_rings: float = 12.0

    def scaled(self, strength: float, tracing: float) -> Growth:
        """As uneven and as inexactly traced as so many times this, but not traced better than anything is."""
        each, piece = (max(error * tracing, TRACED_WITHIN) for error in (self.tracing, self.piece))
        return replace(self, strength=self.strength * strength, tracing=each, piece=piece)


class Evidence:
    """Negative log-probability of pith lines, up to a constant.

    Parameters
    ----------
    rings : RingPoints
        Sampled boundaries; the cost grows with the square of their number.
    spacing_px : float
        Typical distance between boundaries as they appear, px.
    growth : Growth
        What irregularity to expect.
    doubt : array of shape (P,), optional
        Further standard deviation of each polyline, in ring widths: large where its number seems wrong.
    width_px : float, optional
        Mean ring width, where a person knows it.
    stem : array of shape (3,), optional
        About where the stem runs (unit vector), along which growth changes slowly; without it all ways are alike.
    roughness : array of shape (K,), optional
        Variance of tracing of each vertex, in usual ones (`rougher`).
    """

    def __init__(
        self,
        rings: RingPoints,
        spacing_px: float,
        growth: Growth,
        doubt: FloatArray | None = None,
        width_px: float | None = None,
        stem: FloatArray | None = None,
        roughness: FloatArray | None = None,
    ) -> None:
        self.rings, self.spacing_px, self.growth, self.width_px = rings, spacing_px, growth, width_px
        self.roughness = np.ones(len(rings.points)) if roughness is None else roughness
        self.stem = stem
        present, ring = np.unique(rings.ring, return_inverse=True)
        self.ring, index, group = ring.ravel(), rings.index[present], rings.group[present]
        members = np.eye(len(present))[self.ring]
        total, noise = self._covariance(np.zeros(int(rings.pieces.max()) + 1) if doubt is None else doubt)
        factor = cho_factor(total, lower=True)
        left = cho_solve(factor, members)
        information = members.T @ left
        #: Half the log-determinant of the vertices' covariance, those of the boundaries' radii integrated out.
        self.volume = float(np.log(np.diag(factor[0])).sum() + 0.5 * np.linalg.slogdet(information)[1])
        between = np.linalg.inv(information)
        #: Radii of the boundaries from radii of the vertices, shape (R, K).
        self.mean_of = between @ left.T
        #: Precision of the vertices' radii, those of the boundaries integrated out, shape (K, K), in ring widths.
        self.precision = cho_solve(factor, np.eye(len(total))) - left @ self.mean_of
        #: How much of a degree of freedom of each vertex the distortion decides, not tracing or its boundary's radius.
        self.distorted = np.maximum(1.0 - noise * np.diag(self.precision) - (members * self.mean_of.T).sum(axis=1), 0.0)
        #: Degrees of freedom that the misfit is judged by.
        self.freedom = float(self.distorted.sum())
        order = np.lexsort((index, group))
        inner, outer = order[:-1], order[1:]
        same = group[inner] == group[outer]
        self.inner, self.outer = inner[same], outer[same]
        self.apart = (index[self.outer] - index[self.inner]).astype(float)
        self.width_variance = (
            between[self.inner, self.inner] + between[self.outer, self.outer] - 2.0 * between[self.inner, self.outer]
        ) / self.apart**2
        # Years of different groups have nothing in common.
        years = 0.5 * (index[self.outer] + index[self.inner]) + 1e4 * group[self.inner]
        self.whitened = [self._whitening(years, even * YEAR_SCATTER) for even in EVENNESS]

    def _whitening(self, years: FloatArray, scatter: float) -> tuple[FloatArray, float]:
        """What makes log widths of `years` (W,) independent with variance 1, (W, W), and half its log-determinant."""
        gap = np.abs(years[:, None] - years[None])
        # The mean width is not known.
        total = 1.0 + LEVEL_SCATTER**2 * LEVEL_MEMORY**gap
        total += scatter**2 * YEAR_MEMORY**gap / np.sqrt(np.outer(self.apart, self.apart))
        total[np.diag_indices(len(total))] += self.width_variance
        lower = np.linalg.cholesky(total)
        return np.linalg.inv(lower), float(np.log(np.diag(lower)).sum())

    def _covariance(self, doubt: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Covariance (K, K) of the vertices' radii in ring widths, and the part (K,) that is tracing."""
        growth, pieces = self.growth, self.rings.pieces
        points = self.rings.points
        if self.stem is not None:
            points = points - np.outer(points @ self.stem, (1.0 - 1.0 / growth.along) * self.stem)
        gap = np.linalg.norm(points[:, None] - points[None], axis=-1)
        total = np.zeros_like(gap)
        for reach in growth.reach:
            u = math.sqrt(5.0) * gap / (reach * self.spacing_px)
            total += growth.strength**2 / len(growth.reach) * (1.0 + u + u * u / 3.0) * np.exp(-u)
        whole = growth.piece**2 + doubt**2
        total += np.where(pieces[:, None] == pieces[None], whole[pieces][:, None], 0.0)
        noise = growth.tracing**2 * self.roughness / np.clip(self.rings.beliefs, 0.05, 1.0)
        total[np.diag_indices(len(total))] += noise
        return total, noise

    def _radii(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Vectors (L, K, 3) from lines to the vertices, their lengths (L, K) and the heights (L, K), px."""
        away = self.rings.points[None] - origin[:, None]
        height = np.einsum("lkc,lc->lk", away, direction)
        away = away - height[..., None] * direction[:, None]
        return away, np.sqrt((away * away).sum(axis=-1) + 1e-12), height

    def _shapes(self, away: FloatArray, r: FloatArray, height: FloatArray, direction: FloatArray) -> FloatArray:
        """Eccentric, oval and tapering growth of one standard deviation each, shape (L, K, 9), px."""
        across, inward = frames_of(direction)
        x, y = np.einsum("lkc,lc->lk", away, across), np.einsum("lkc,lc->lk", away, inward)
        up = (height - height.mean(axis=1, keepdims=True)) / (CHANGE_RINGS * self.spacing_px)
        aside, oval = self.growth.eccentric, self.growth.oval
        shapes = np.stack([aside * x, aside * y, oval * (x * x - y * y) / r, 2.0 * oval * x * y / r], axis=-1)
        taper = TAPER * CHANGE_RINGS * r * up
        return np.concatenate([shapes, shapes * up[..., None], taper[..., None]], axis=-1)

    def typical(self, radius: FloatArray) -> FloatArray:
        """Mean ring width (L,), px, from the radii (L, R) of the boundaries."""
        if len(self.inner) == 0:
            return np.full(len(radius), self.spacing_px)
        widths = np.abs(radius[:, self.outer] - radius[:, self.inner])
        return np.asarray(widths.sum(axis=1) / self.apart.sum() + 1e-9)

    def shapes(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """Eccentric, oval and, last, tapering growth of one standard deviation each, shape (L, K, 9), px."""
        away, r, height = self._radii(origin, direction)
        return self._shapes(away, r, height, direction)

    def rounded(
        self, origin: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Vertices about lines through `origin` along `direction` (L, 3), with the likeliest shape taken out.

        Returns
        -------
        left : array of shape (L, K)
            Radii of the vertices less the shape, px.
        away : array of shape (L, K, 3)
            From the line to the vertices, px.
        width : array of shape (L,)
            Mean ring width, px.
        misfit, volume : arrays of shape (L,)
            Squared misfit in standard deviations, and the log-determinant of the shape's information.
        """
        away, r, height = self._radii(origin, direction)
        width = self.typical(r @ self.mean_of.T)
        basis = self._shapes(away, r, height, direction)
        basis /= (width * (1.0 + r.mean(axis=1) / (self.growth.shaped_rings * width)))[:, None, None]
        lines, count, shapes = basis.shape
        weighed = (self.precision @ np.moveaxis(basis, 0, 1).reshape(count, -1)).reshape(count, lines, shapes)
        weighed = np.moveaxis(weighed, 1, 0)
        information = np.swapaxes(basis, 1, 2) @ weighed + np.eye(shapes)
        rings = r / width[:, None]
        share = np.linalg.solve(information, np.einsum("lks,lk->ls", weighed, rings)[..., None])
        rings = rings - (basis @ share)[..., 0]
        left = rings * width[:, None]
        # Judged by the widths that are left: a shape that takes away the rings themselves must not pay.
        width = self.typical(left @ self.mean_of.T)
        misfit = (left * (r @ self.precision)).sum(axis=1) / width**2
        return left, away, width, misfit, np.linalg.slogdet(information)[1]

    def __call__(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """Negative log-probability (L,) of lines through `origin` along unit vectors `direction`, shape (L, 3)."""
        left, away, _, misfit, volume = self.rounded(origin, direction)
        return self._misfit_cost(misfit) + 0.5 * volume + self._cost(left, away)

    def rough(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """As calling it, for trees without eccentric, oval or tapering growth: many times faster."""
        away, r, _ = self._radii(origin, direction)
        misfit = (r * (r @ self.precision)).sum(axis=1) / self.typical(r @ self.mean_of.T) ** 2
        return self._misfit_cost(misfit) + self._cost(r, away)

    def unevenness(self, origin: FloatArray, direction: FloatArray) -> float:
        """Squared misfit about one line, shape (3,) both, over its degrees of freedom: 1 for growth as expected."""
        misfit = self.rounded(origin[None], direction[None])[3]
        return float(misfit[0] / max(self.freedom, 1.0))

    def surprise(self, origin: FloatArray, direction: FloatArray) -> float:
        """Negative log-probability of the vertices about one line, shape (3,) both: least for growth as it was."""
        left, away, _, misfit, volume = self.rounded(origin[None], direction[None])
        stretch = self._stretch(away, self.typical(left @ self.mean_of.T))
        return float(0.5 * (misfit + volume)[0] + stretch[0]) + self.volume

    def rougher(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """Variance of tracing (K,), in usual ones, by which no vertex is an outlier about one line, shape (3,) both."""
        left, _, width, _, _ = self.rounded(origin[None], direction[None])
        # How far each vertex lies from where all others put it, over the standard deviation of that.
        off = (self.precision @ (left[0] / width[0])) ** 2 / np.maximum(np.diag(self.precision), 1e-12)
        return np.asarray(self.roughness * np.maximum(1.0, off / OUTLIER**2))

    def calibrate(self, origin: FloatArray, direction: FloatArray) -> None:
        """Judge misfits by what is left about one line, shape (3,) both.

        Where vertices are traced as exactly as assumed, errors of tracing count too. Their number of degrees of freedom
        is not taken at its word, since neighbours share errors: the geometric mean with that of the distortion is.
        """
        misfit = float(self.rounded(origin[None], direction[None])[3][0])
        most = max(self.freedom, float(len(self.ring) - len(self.mean_of)))
        self.freedom = math.sqrt(self.freedom * min(max(misfit, self.freedom), most))

    def _misfit_cost(self, misfit: FloatArray) -> FloatArray:
        """Cost (L,) of squared misfits (L,): how strongly this tree strays from round is not known beforehand."""
        return np.asarray(0.5 * (self.freedom + USUAL_STRENGTH) * np.log1p(np.maximum(misfit, 0.0) / USUAL_STRENGTH))

    def _cost(self, r: FloatArray, away: FloatArray) -> FloatArray:
        """What widths, age and the slope of the radius on the face cost (L,)."""
        radius = r @ self.mean_of.T
        width = self.typical(radius)
        age = np.maximum(np.abs(radius).min(axis=1) / width, 1.0)
        old = 0.5 * (np.maximum(np.log(age / OLD_RINGS), 0.0) / OLD_SCATTER) ** 2
        known = 0.0 if self.width_px is None else 0.5 * (np.log(width / self.width_px) / 0.02) ** 2
        return np.asarray(old + known + self._stretch(away, width) + self._widths(radius, width))

    def _stretch(self, away: FloatArray, width: FloatArray) -> FloatArray:
        """Density on the face (L,): a distortion of one size moves boundaries far where the radius hardly changes."""
        square = (away * away).sum(axis=-1)
        slope = 1.0 - np.einsum("lkc,kc->lk", away, self.rings.facings) ** 2 / np.maximum(square, 1e-9)
        slope = np.sqrt(np.maximum(slope, 0.0)) * (self.spacing_px / width[:, None])
        return np.asarray(-np.log(slope + 0.03) @ self.distorted)

    def _widths(self, radius: FloatArray, width: FloatArray) -> FloatArray:
        """Cost (L,) of uneven widths between boundaries of radii (L, R)."""
        if len(self.inner) == 0:
            return np.zeros(len(radius))
        share = (radius[:, self.outer] - radius[:, self.inner]) / self.apart / width[:, None]
        logs = np.log(np.maximum(share, LEAST_SHARE))
        year = 0.5 * np.abs(radius[:, self.outer] + radius[:, self.inner]) / width[:, None]
        logs = logs - TREND * age_trend(year)
        # How even this tree's widths are is not known beforehand.
        costs = []
        for even, (whiten, volume) in zip(EVENNESS, self.whitened, strict=True):
            # Student's t with four degrees of freedom: a boundary that was missed doubles a width.
            uneven = 2.5 * np.log1p((logs @ whiten.T) ** 2 / 4.0).sum(axis=1)
            costs.append(uneven + volume + 0.5 * (math.log(even) / EVEN_SCATTER) ** 2)
        backwards = (np.minimum(share - 0.05, 0.0) ** 2).sum(axis=1)
        return np.asarray(10.0 * backwards - logsumexp(-np.array(costs), axis=0))

    def doubtful(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """How far each polyline (P,) lies off its boundary, in ring widths; 0 where that may be chance."""
        left, _, width, _, _ = self.rounded(origin[None], direction[None])
        pieces = self.rings.pieces
        of_piece = np.zeros((len(pieces), int(pieces.max()) + 1))
        of_piece[np.arange(len(pieces)), pieces] = 1.0
        score = of_piece.T @ (self.precision @ (left[0] / width[0]))
        power = np.maximum(((self.precision @ of_piece) * of_piece).sum(axis=0), 1e-9)
        off = np.abs(score) / power
        return np.asarray(np.where((off > 0.4) & (np.abs(score) > 3.0 * np.sqrt(power)), off, 0.0))
