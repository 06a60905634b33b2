"""Ring indices tied across the edges that faces of a block share.

A ring that reaches an edge goes on on the face beyond it. Where boundaries of two faces nearly touch, the difference
of their indices is a vote for how the numbers of one face become those of the other. Votes join the faces one after
another, the best agreed pair first. A face whose rings were numbered the wrong way round is told by votes that agree
on the sum of the indices instead of their difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Array = npt.NDArray[Any]

#: Boundaries that meet at an edge come at least this near, in ring widths; photographs are ragged at their edges.
_NEAR_RINGS = 0.3
#: Share of the votes between two groups that must agree, and how many edges' crossings must have voted.
_AGREED, _LEAST_VOTES = 0.6, 2.0


@dataclass(frozen=True)
class Ties:
    """How groups of ring indices become one numbering.

    Attributes
    ----------
    sign, shift, root : int arrays of shape (G,)
        Of each group: ``sign * index + shift`` is its index in the numbering of group `root`.
    conflicts : int
        Pairs of groups whose own votes contradict the way they were joined.
    """

    sign: npt.NDArray[np.int64]
    shift: npt.NDArray[np.int64]
    root: npt.NDArray[np.int64]
    conflicts: int


def tie_groups(points: Array, face: Array, index: Array, group: Array, ring_px: float) -> Ties:
    """Tie groups of boundaries on several faces by the boundaries that meet at shared edges.

    Parameters
    ----------
    points : array of shape (N, 3)
        Boundary vertices, board frame, px.
    face, index, group : int arrays of shape (N,)
        Face, ring index and group of each vertex; a group lies on one face.
    ring_px : float
        Typical ring width across the layers, px.

    Returns
    -------
    Ties
        Groups that nothing ties to others are their own root.
    """
    count = int(group.max()) + 1 if len(group) else 0
    votes = _votes(points, face, index, group, _NEAR_RINGS * ring_px)
    sign, shift, root = np.ones(count, np.int64), np.zeros(count, np.int64), np.arange(count)
    size = np.bincount(group, minlength=count)
    for _, (a, b), flip, offset in votes:
        if root[a] == root[b]:
            continue
        # The smaller cluster takes the numbers of the larger one.
        if size[root == root[a]].sum() < size[root == root[b]].sum():
            a, b, offset = b, a, offset if flip < 0 else -offset
        # index_a = flip * index_b + offset; into the numbers of a's root, and on from b to all of its cluster.
        factor = sign[a] * flip * sign[b]
        change = sign[a] * offset + shift[a] - factor * shift[b]
        moved = root == root[b]
        shift[moved] = factor * shift[moved] + change
        sign[moved] *= factor
        root[moved] = root[a]
    against = sum(
        root[a] == root[b] and (sign[a] * flip != sign[b] or sign[a] * offset + shift[a] != shift[b])
        for _, (a, b), flip, offset in votes
    )
    return Ties(sign, shift, root, int(against))


def numbered_together(
    ties: Ties, index: Array, group: Array, weight: Array
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Ring indices and groups after tying.

    Parameters
    ----------
    ties : Ties
        Of the groups.
    index, group : int arrays of shape (R,)
        Of each polyline, as numbered on its face.
    weight : array of shape (R,)
        How much each counts.

    Returns
    -------
    index, group : int arrays of shape (R,)
        Common numbers; group 0 is the heaviest.
    cluster : int array of shape (G,)
        New group of each old one.
    """
    roots, cluster = np.unique(ties.root, return_inverse=True)
    mass = np.bincount(cluster.ravel()[group], weight, minlength=len(roots))
    rank = np.argsort(np.argsort(-mass, kind="stable"), kind="stable")
    cluster = rank[cluster.ravel()]
    together = ties.sign[group] * index + ties.shift[group]
    return together.astype(np.int64), cluster[group].astype(np.int64), cluster.astype(np.int64)


Vote = tuple[float, tuple[int, int], int, int]


def _votes(points: Array, face: Array, index: Array, group: Array, near_px: float) -> list[Vote]:
    """Agreed relations ``index_a = flip * index_b + offset`` of pairs of groups on different faces, surest first."""
    tree = cKDTree(points)
    pairs = tree.query_pairs(near_px, output_type="ndarray")
    pairs = pairs[face[pairs[:, 0]] != face[pairs[:, 1]]]
    if not len(pairs):
        return []
    swap = group[pairs[:, 0]] > group[pairs[:, 1]]
    pairs[swap] = pairs[swap][:, ::-1]
    # One vote for each pair of boundaries that meet, however many vertices do: the nearer, the weightier.
    table = np.column_stack([group[pairs], index[pairs]])
    distance = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    meeting, where = np.unique(table, axis=0, return_inverse=True)
    nearest = np.full(len(meeting), np.inf)
    np.minimum.at(nearest, where.ravel(), distance)
    weight = 1.0 - nearest / near_px
    found: list[Vote] = []
    for a, b in np.unique(meeting[:, :2], axis=0):
        mine = (meeting[:, 0] == a) & (meeting[:, 1] == b)
        i, j, w = meeting[mine, 2], meeting[mine, 3], weight[mine]
        straight, reverse = _mode(i - j, w), _mode(i + j, w)
        # Two crossings fit either way; only more of them can say that a face was numbered backwards.
        is_reverse = reverse[1] > 1.5 * straight[1] and len(i) >= 4
        offset, agreed = reverse if is_reverse else straight
        if agreed >= max(_AGREED * w.sum(), _LEAST_VOTES * 0.5):
            found.append((agreed * agreed / w.sum(), (int(a), int(b)), -1 if is_reverse else 1, offset))
    return sorted(found, key=lambda vote: -vote[0])


def _mode(values: Array, weight: Array) -> tuple[int, float]:
    """Value with the most weight, and that weight."""
    kinds, where = np.unique(values, return_inverse=True)
    total = np.bincount(where.ravel(), weight)
    best = int(np.argmax(total))
    return int(kinds[best]), float(total[best])
