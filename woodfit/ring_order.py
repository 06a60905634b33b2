"""Consecutive indices for traced boundaries out of the votes of walks between them (`woodfit.ring_walks`).

Votes are joined from the strongest down: a gap in one place is bridged by another, and where a boundary was missed, the
index says so too. Whoever walks outwards has passed a ring at each boundary: where the votes say otherwise, the chain
that leads there is mended in its weakest link, or the shorter line is none (`woodfit.settled_numbers`). Across the pith
of a board the count is least sure, but there both sides show the same rings: see `woodfit.ring_sides`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.ring_sides import Widths, matched_shift, sides_of
from woodfit.ring_walks import Surroundings, Votes, draw_labels, votes_of
from woodfit.settled_numbers import clearest, joined, misfits, much_longer, offended, settle
from woodfit.tied_numbers import TiedNumbers


@dataclass(frozen=True)
class Order:
    """Indices of traced boundaries.

    Attributes
    ----------
    index : int array of shape (R,)
        Growing outwards, smallest 1; boundaries that are pieces of one ring share it.
    group : int array of shape (R,)
        Boundaries of one group are tied by votes; between groups the index is a guess. 0 is the largest.
    agreement : float array of shape (R,)
        Share of a boundary's votes that the result satisfies, 0..1 (0.5 without votes).
    """

    index: npt.NDArray[np.int64]
    group: npt.NDArray[np.int64]
    agreement: npt.NDArray[np.float64]


def _matched_sides(counted: TiedNumbers, votes: Votes, side: npt.NDArray[np.int64]) -> TiedNumbers:
    """`counted`, or where widths contradict its count across the pith, indices whose two sides these have tied."""
    one_side = {key: weight for key, weight in votes.weight.items() if side[key[0] - 1] * side[key[1] - 1] > 0}
    indices = settle(one_side, len(side))
    widths: dict[int, dict[int, list[float]]] = {}
    for (a, b), ways in votes.way.items():
        (root_a, above_a), (root_b, above_b) = indices.find(a - 1), indices.find(b - 1)
        if root_a == root_b and above_b - above_a == 1 and side[a - 1] != 0:
            widths.setdefault(root_a, {}).setdefault(above_a, []).extend(ways)
    middle: dict[int, Widths] = {
        root: {index: float(np.median(ways)) for index, ways in of.items()} for root, of in widths.items()
    }
    roots = sorted(middle, key=lambda root: -len(middle[root]))
    contradicted = False
    for one, other in ((a, b) for a in roots for b in roots if side[a] > 0 > side[b]):
        shift = counted.difference(one, other)
        more = 0 if shift is None else matched_shift(middle[one], middle[other], shift)
        if shift is not None and more != 0:
            contradicted = True
            indices.tie(one, other, shift + more)
    if not contradicted:
        return counted
    for a, b, apart in clearest(votes.weight):
        known = counted.difference(a - 1, b - 1)
        indices.tie(a - 1, b - 1, apart if known is None else known)
    # A ring that is traced over both sides says more than their widths.
    worse = offended(votes.weight, indices.numbers()) > offended(votes.weight, counted.numbers())
    return counted if worse else indices


def order_rings(
    polylines: Sequence[npt.NDArray[np.float64]],
    closed: Sequence[bool],
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    phase: npt.NDArray[Any] | None = None,
    strength: npt.NDArray[Any] | None = None,
    around_pith: bool = False,
) -> tuple[npt.NDArray[np.int64], Order]:
    """Give every boundary its index, but for those for which the order of growth has no room.

    Parameters
    ----------
    polylines : sequence of arrays of shape (K, 2)
        x, y of the boundaries in pixels.
    closed : sequence of bool
        Whether each returns to its start.
    growth, frequency : arrays of shape (M, N)
        Outward direction in rad, rings per pixel.
    valid : bool array of shape (M, N)
        The wood.
    phase : array of shape (M, N), optional
        Ring phase in rad; counts the rings between boundaries better than the frequency alone.
    strength : array of shape (M, N), optional
        From `woodfit.boundary.edge_strength`: shows whether a ring is missing between two boundaries.
    around_pith : bool
        Whether the rings go round a pith on the face: it is they that tie the sides, not their widths.

    Returns
    -------
    kept : int array of shape (K,)
        Boundaries that have a place. Where another would have to be is a much longer one: it is none.
    order : Order
        Of those.
    """
    length = np.array([len(points) for points in polylines], np.float64)
    empty = np.zeros(growth.shape, np.int32)
    around = Surroundings.of(empty, growth, frequency, valid, phase)

    def cast(which: npt.NDArray[np.bool_]) -> Votes:
        labels = draw_labels(polylines, closed, growth.shape, which)
        return votes_of(polylines, which, replace(around, labels=labels), strength)

    sure, votes, indices = _without_misfits(cast, length)
    side = sides_of(polylines, growth)
    if side.any() and not around_pith:
        indices = _matched_sides(indices, votes, side)
    fits = sure
    if not sure.all():
        # Now that the others are numbered, there may be room for one of those left out.
        votes = cast(np.ones(len(polylines), bool))
        ranked = clearest(votes.weight)
        for a, b, apart in [v for v in ranked if much_longer(length[v[0] - 1], length[v[1] - 1])] + ranked:
            indices.tie(a - 1, b - 1, apart)
        fits = ~misfits(votes.weight, indices.numbers(), length)
    kept = np.flatnonzero(fits)
    index, group = _grouped(indices, kept, length)
    return kept, Order(index[kept], group[kept], _agreement(votes.weight, index, group)[kept])


def _without_misfits(
    cast: Callable[[npt.NDArray[np.bool_]], Votes], length: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.bool_], Votes, TiedNumbers]:
    """Boundaries that agree on an order of growth, their votes and their numbers."""
    sure = np.ones(len(length), bool)
    while True:
        votes = cast(sure)
        # Pieces that have no room by the clearest votes have no say in which of these are wrong.
        indices = joined(votes.weight, len(length))
        none = misfits(votes.weight, indices.numbers(), length)
        if not none.any():
            indices = settle(votes.weight, len(length))
            none = misfits(votes.weight, indices.numbers(), length)
            if not none.any():
                return sure, votes, indices
        sure &= ~none


def _grouped(
    indices: TiedNumbers, kept: npt.NDArray[np.int64], length: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Index and group of every boundary; only those `kept` count for where an index begins and which group is large."""
    index, group = indices.numbers(), np.zeros(len(length), np.int64)
    roots = np.array([indices.find(node)[0] for node in range(len(length))], np.int64)
    mass = np.bincount(roots[kept], weights=length[kept], minlength=len(length))
    for number, root in enumerate(np.argsort(-mass, kind="stable").tolist()):
        members = roots == root
        group[members] = number
        if mass[root] > 0.0:
            index[members] += 1 - index[kept][roots[kept] == root].min()
    return index, group


def _agreement(
    votes: dict[tuple[int, int, int], float], index: npt.NDArray[np.int64], group: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """Share of each boundary's votes that the indices satisfy."""
    kept, cast = np.full(len(index), 0.5), np.ones(len(index))
    for (a, b, apart), weight in votes.items():
        right = group[a - 1] == group[b - 1] and index[b - 1] - index[a - 1] == apart
        for node in (a - 1, b - 1):
            cast[node] += weight
            kept[node] += weight * right
    return np.asarray(kept / cast)
