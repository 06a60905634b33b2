"""The influence-area metric of CS-TRD for rings around a pith.

Every true ring owns the area of influence along rays from the pith: from half way to the ring inside of it to half way
to the ring outside of it; that of the innermost begins at the pith, that of the outermost ends as far outside of it as
it begins inside. A traced ring belongs to the true ring in whose area most of its nodes (its crossings with the rays)
lie. It is a true positive when the nodes there are at least 60 % of the rays on which the true ring is known. Of
several that belong to one true ring the one with the smallest error is the true positive, the others are false. Then

    P = TP / (TP + FP),   R = TP / (TP + FN),   F = 2 P R / (P + R),
    RMSE of a ring = sqrt(mean over rays of (traced radius - true radius)^2), averaged over the true positives.

Differences from the published program: it first takes the true ring with the smallest RMSE and then asks for 60 % in
that ring's area, which is defined for closed curves only; here pieces are judged too, so the area decides. It counts
pixels of rounded, rasterized areas; here radii are compared. Pieces that the tracing holds for one ring are one ring;
pieces that it holds for different rings are judged apart, as nobody could count with them.

Image frame: x right, y down, px. Rays are numbered by angle from +x towards +y, the first at 0.

References
----------
Marichal, Passarella, Randall, "CS-TRD: a Cross Sections Tree Ring Detection method", arXiv 2305.10809, 2023, and the
evaluation program published with the UruDendro data set (Marichal et al., arXiv 2404.10856, 2024).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from woodfit.labelled_path import LabelledPath
from woodfit.matching import Counts

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

RAYS = 360
NODE_SHARE = 0.6
MAX_GAP_DEG = 15.0
LEAST_RAYS = 4


def ray_radii(pieces: Iterable[ArrayLike], center: ArrayLike, rays: int = RAYS) -> Floats:
    """Distance from `center` at which polylines, the pieces of one ring, cross each of `rays` rays, shape (rays,), px.

    NaN where nothing crosses; the mean where a ray is crossed more than once.
    """
    total, count = np.zeros(rays), np.zeros(rays)
    step = 2 * np.pi / rays
    for piece in pieces:
        offset = np.asarray(piece, dtype=float).reshape(-1, 2) - np.asarray(center, dtype=float)
        a, b = offset[:-1], offset[1:]
        first = np.arctan2(a[:, 1], a[:, 0])
        turn = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))
        low, high = np.minimum(first, first + turn) / step, np.maximum(first, first + turn) / step
        # A little longer than it is: a vertex on a ray then counts for both its segments, never for none.
        begin = np.ceil(low - 1e-9).astype(np.int64)
        number = np.floor(high + 1e-9).astype(np.int64) + 1 - begin
        segment = np.repeat(np.arange(len(a)), number)
        ray = begin[segment] + np.arange(len(segment)) - np.repeat(np.cumsum(number) - number, number)
        along = np.stack([np.cos(ray * step), np.sin(ray * step)], axis=-1)
        edge = (b - a)[segment]
        across = along[:, 0] * edge[:, 1] - along[:, 1] * edge[:, 0]
        radius = (a[segment, 0] * edge[:, 1] - a[segment, 1] * edge[:, 0]) / np.where(across == 0, np.nan, across)
        good = np.isfinite(radius) & (radius > 0)
        np.add.at(total, ray[good] % rays, radius[good])
        np.add.at(count, ray[good] % rays, 1.0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


# --- the truth ----------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class DiscTruth:
    """True rings of a disc on rays from the pith.

    Parameters
    ----------
    center
        The pith, x, y.
    radius
        Of each ring on each ray, px, shape (n, rays); NaN where it is not known.
    names
        Of the rings: their ids, numbers or labels.
    uncertain
        Rings that are not judged, shape (n,).
    marks
        Ray (a whole number), radius in px of single marks that belong to no ring and are not judged, shape (k, 2).
    labelled
        Rays that a person looked at, for `marks`.
    """

    center: Floats
    radius: Floats
    names: tuple[int | str, ...]
    uncertain: Bools
    marks: Floats = field(default_factory=lambda: np.empty((0, 2)))
    labelled: tuple[int, ...] = ()

    def areas(self) -> tuple[Floats, Floats]:
        """Inner and outer limit of every ring's area of influence on every ray, px, shape (n, rays) each."""
        order = np.argsort(np.where(np.isnan(self.radius), np.inf, self.radius), axis=0, kind="stable")
        ranked = np.take_along_axis(self.radius, order, axis=0)
        low, high = np.zeros_like(ranked), np.full_like(ranked, np.nan)
        low[1:] = 0.5 * (ranked[:-1] + ranked[1:])
        high[:-1] = low[1:]
        last = np.isnan(high) & np.isfinite(ranked)
        high[last] = (2 * ranked - low)[last]
        inner, outer = np.empty_like(low), np.empty_like(high)
        np.put_along_axis(inner, order, low, axis=0)
        np.put_along_axis(outer, order, high, axis=0)
        return inner, outer


def truth_from_rings(rings: Sequence[Mapping[str, Any]], center: ArrayLike, rays: int = RAYS) -> DiscTruth:
    """True rings from outlines (``points``, and optionally ``id``, ``closed`` and ``uncertain``); those with one id are
    pieces of one ring.
    """
    pieces: dict[int | str, list[Floats]] = {}
    doubt: dict[int | str, bool] = {}
    for number, ring in enumerate(rings):
        name = ring.get("id", number)
        points = np.asarray(ring["points"], dtype=float).reshape(-1, 2)
        outline = np.concatenate([points, points[:1]]) if ring.get("closed") and len(points) else points
        pieces.setdefault(name, []).append(outline)
        doubt[name] = doubt.get(name, False) or bool(ring.get("uncertain"))
    radius = np.array([ray_radii(piece, center, rays) for piece in pieces.values()]).reshape(-1, rays)
    return DiscTruth(
        np.asarray(center, dtype=float), radius, tuple(pieces), np.array([doubt[name] for name in pieces], dtype=bool)
    )


def truth_from_rays(
    paths: Iterable[Mapping[str, Any]], center: ArrayLike, rays: int = RAYS, max_gap_deg: float = MAX_GAP_DEG
) -> DiscTruth:
    """True rings from labelled rays with ``ring_index`` (one number is one ring on every ray).

    On a labelled ray the radius is the labelled one. Between two neighbouring rays no further apart than `max_gap_deg`
    that of a ring both carry is interpolated linearly in the angle; elsewhere it is not known and nothing is judged.
    The error of that interpolation is about ``e gap^2 / 8`` for a pith off the middle by `e`: with 100 px and rays 45
    degrees apart 8 px, more than half a narrow ring, with 15 degrees 1 px. Paths that do not begin at the `center` are
    left out. A ring is uncertain when at least half of its labels are; labels without a number become marks.

    Raises
    ------
    ValueError
        Fewer than `LEAST_RAYS` rays: no ring can be told from so few.
    """
    pith = np.asarray(center, dtype=float)
    found: dict[float, tuple[LabelledPath, dict[int, float]]] = {}
    votes: dict[int, list[bool]] = {}
    marks: list[tuple[int, float]] = []
    step = 360.0 / rays
    for path in paths:
        if path.get("ring_index") is None:
            continue
        label = LabelledPath.read({key: value for key, value in path.items() if key != "year"})
        if np.hypot(*(label.start - pith)) > 1.5:
            continue
        angle = float(np.degrees(np.arctan2(*(label.end - label.start)[::-1])) % 360.0)
        known = np.isfinite(label.number)
        places = zip(label.number[known], label.position[known], label.uncertain[known], strict=True)
        of_ray: dict[int, float] = {}
        for number, position, doubtful in places:
            of_ray[int(number)] = float(position)
            votes.setdefault(int(number), []).append(bool(doubtful))
        found[angle] = (label, of_ray)
        marks += [(round(angle / step) % rays, float(position)) for position in label.position[~known]]
    if len(found) < LEAST_RAYS:
        raise ValueError(f"{len(found)} rays with `ring_index` from the pith, expected at least {LEAST_RAYS}")
    names = tuple(sorted(votes))
    radius = np.full((len(names), rays), np.nan)
    angles = sorted(found)
    row_of = {name: row for row, name in enumerate(names)}
    for angle, (_, of_ray) in found.items():
        for name, value in of_ray.items():
            radius[row_of[name], round(angle / step) % rays] = value
    for low, high in zip(angles, [*angles[1:], *(angle + 360.0 for angle in angles[:1])], strict=True):
        if not 0.0 < high - low <= max_gap_deg:
            continue
        between = np.arange(np.floor(low / step) + 1, np.ceil(high / step))
        part = (between * step - low) / (high - low)
        inner, outer = found[low][1], found[high % 360.0 if high >= 360.0 else high][1]
        for row, name in enumerate(names):
            if name in inner and name in outer:
                radius[row, between.astype(int) % rays] = (1 - part) * inner[name] + part * outer[name]
    uncertain = np.array([2 * sum(votes[name]) >= len(votes[name]) for name in names], dtype=bool)
    labelled = tuple(round(angle / step) % rays for angle in angles)
    return DiscTruth(pith, radius, names, uncertain, np.array(marks, dtype=float).reshape(-1, 2), labelled)


# --- the score ----------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class InfluenceComparison:
    """Traced against true rings of discs; adds up over images.

    Parameters
    ----------
    counts
        True positives, false negatives and false positives, as matched, missed and false.
    rmse_px, rmse_mm
        Radial error of each true positive; mm only where the scale is known.
    missed
        Names of the rings that were not found.
    """

    counts: Counts = field(default_factory=Counts)
    rmse_px: Floats = field(default_factory=lambda: np.empty(0))
    rmse_mm: Floats = field(default_factory=lambda: np.empty(0))
    missed: tuple[int | str, ...] = ()

    def __add__(self, other: InfluenceComparison) -> InfluenceComparison:
        return InfluenceComparison(
            self.counts + other.counts,
            np.concatenate([self.rmse_px, other.rmse_px]),
            np.concatenate([self.rmse_mm, other.rmse_mm]),
            self.missed + other.missed,
        )

    def figures(self) -> dict[str, float]:
        """``influence_precision``, ``influence_recall``, ``influence_f``, the counts and the mean RMSE."""
        scores = self.counts.scores()
        return {
            "influence_rings": float(self.counts.matched + self.counts.missed),
            "influence_recall": scores["sensitivity"],
            "influence_precision": scores["precision"],
            **{f"influence_{name}": scores[name] for name in ("f", "matched", "missed", "false")},
            "influence_rmse_px": float(self.rmse_px.mean()) if len(self.rmse_px) else float("nan"),
            "influence_rmse_mm": float(self.rmse_mm.mean()) if len(self.rmse_mm) else float("nan"),
        }


def influence_score(
    traced: Iterable[Sequence[ArrayLike]],
    truth: DiscTruth,
    node_share: float = NODE_SHARE,
    pixel_size_mm: float | None = None,
) -> InfluenceComparison:
    """The influence-area metric, see the head of this module.

    Parameters
    ----------
    traced
        Rings, each a sequence of polylines (n, 2), its pieces.
    truth
        The true rings. Nothing is judged on rays where none is known.
    node_share
        Share of a true ring's rays on which the traced ring must lie in its area.
    pixel_size_mm
        mm per px, None when unknown.
    """
    inner, outer = truth.areas()
    known = np.isfinite(truth.radius)
    best: dict[int, float] = {}
    false = 0
    for pieces in traced:
        radius = ray_radii(pieces, truth.center, truth.radius.shape[1])
        if not (np.isfinite(radius) & known.any(axis=0)).any():
            continue
        inside = ((radius >= inner) & (radius < outer) & known).sum(axis=1)
        ring = int(np.argmax(inside))
        if (inside[ring] and truth.uncertain[ring]) or _follows_marks(radius, truth, node_share):
            continue
        if inside[ring] == 0 or inside[ring] < node_share * known[ring].sum():
            false += 1
            continue
        error = float(np.sqrt(np.nanmean((radius - truth.radius[ring]) ** 2)))
        false += ring in best
        best[ring] = min(error, best.get(ring, np.inf))
    asked = [ring for ring in range(len(truth.names)) if known[ring].any() and not truth.uncertain[ring]]
    rmse = np.array([best[ring] for ring in asked if ring in best], dtype=float)
    return InfluenceComparison(
        Counts(len(rmse), len(asked) - len(rmse), int(false)),
        rmse,
        rmse * pixel_size_mm if pixel_size_mm is not None else np.empty(0),
        tuple(truth.names[ring] for ring in asked if ring not in best),
    )


def _follows_marks(radius: Floats, truth: DiscTruth, node_share: float) -> bool:
    """Whether a traced ring lies nearer to unjudged marks than to rings, on most of the labelled rays that it meets."""
    met = followed = 0
    for ray in truth.labelled:
        if np.isnan(radius[ray]):
            continue
        met += 1
        marks = truth.marks[truth.marks[:, 0] == ray, 1]
        rings = truth.radius[:, ray]
        to_mark = np.abs(marks - radius[ray]).min(initial=np.inf)
        to_ring = np.abs(rings[np.isfinite(rings)] - radius[ray]).min(initial=np.inf)
        followed += bool(to_mark < to_ring)
    return met > 0 and followed >= node_share * met
