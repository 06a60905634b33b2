"""A person's boundaries along paths made the truth of the traced ones.

Where a path was marked the person is right: a traced boundary that it crosses without a mark was no boundary, a mark
without a traced boundary is one, and consecutive marks are consecutive rings. Elsewhere the tracing stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.added_boundary import follow_boundary, reach_of, shift_through
from woodfit.contested import cut_contested
from woodfit.corrected_order import Tie, corrected_order
from woodfit.dendro.series import FormatError
from woodfit.grids import nearest
from woodfit.marked_path import MarkedPath
from woodfit.marks_on_lines import NEAR_PX, boxes_of, match_marks, nearest_line, positions_of, tolerance_of
from woodfit.ring_walks import draw_labels
from woodfit.rings import Rings
from woodfit.tracing import Trace

FloatArray = npt.NDArray[np.float64]

MOST_MARKS = 5000

#: A boundary this near to a mark, in px, stays as it is: files round, and where a path meets the rings slantwise and
#: has marks of two points, these are the ends of the widths measured, which lie nearly on the boundary.
SAME_PX, SAME_PX_SLANTWISE = 0.06, 1.0


@dataclass(frozen=True)
class Corrected:
    """Rings as corrected.

    Parameters
    ----------
    rings : Rings
        With the person's boundaries; the phase is not believed where they contradict it.
    certain : bool array of shape (R,)
        Which of them the person marked.
    latewood : float64 array of shape (L, 2)
        x, y of the latewood points given, in pixels of the arrays.
    absent : float64 array of shape (K, 2)
        A place on the boundary outside of each ring that the person called absent, in pixels of the arrays.
    confirmed, added, removed : int
        Marks that lie on traced boundaries, marks that became new ones, and traced boundaries taken away.
    notes : list of str
        What a person should check, in words.
    """

    rings: Rings
    certain: npt.NDArray[np.bool_]
    latewood: FloatArray
    absent: FloatArray
    confirmed: int
    added: int
    removed: int
    notes: list[str]

    @property
    def figures(self) -> dict[str, int]:
        """Counts by name; empty when there was nothing to correct."""
        counts = {
            "boundaries confirmed by hand": self.confirmed,
            "boundaries added by hand": self.added,
            "boundaries removed by hand": self.removed,
        }
        return counts if any(counts.values()) else {}


@dataclass
class _Draft:
    """The boundaries while they are corrected; `old` is the number that each had among the traced ones, -1 if none."""

    lines: list[Trace]
    old: list[int]
    notes: list[str] = field(default_factory=list)


def apply_corrections(
    found: Rings,
    paths: Sequence[MarkedPath],
    valid: npt.NDArray[np.bool_],
    frequency: npt.NDArray[Any],
) -> Corrected:
    """Make a person's boundaries the truth of the traced ones.

    A traced boundary that a path crosses between its first and last mark, with no mark near, is removed as a whole:
    what is no boundary in one place is none in another; only where something confirms it, it is merely cut (see
    `woodfit.contested`). A mark
    near a traced boundary moves it there so that it passes through the mark. Any other mark becomes a new boundary.
    Consecutive marks get consecutive indices, more with absent rings; across a gap the count of the tracing stands.

    Parameters
    ----------
    found : Rings
        As traced.
    paths : sequence of MarkedPath
        In pixels of the arrays.
    valid, frequency : arrays of shape (M, N)
        As for `woodfit.rings.find_rings`.

    Returns
    -------
    Corrected
    """
    if not paths:
        return Corrected(found, np.zeros(len(found.traces), np.bool_), np.zeros((0, 2)), np.zeros((0, 2)), 0, 0, 0, [])
    draft = _Draft(list(found.traces), list(range(len(found.traces))))
    for path in paths:
        _check(path, valid.shape)
    paths = [_outwards(path, found, draft) for path in paths]
    places = list(zip(found.order.group.tolist(), found.order.index.tolist(), strict=True))
    draft.lines, draft.old, denials = cut_contested(draft.lines, places, paths, frequency)
    draft.notes += denials
    matches = [match_marks(path, draft.lines) for path in paths]
    removed = {line for match in matches for line, _ in match.unmarked}
    for path, match in zip(paths, matches, strict=True):
        same_px = SAME_PX if all(len(border) == 1 for border in path.borders) else SAME_PX_SLANTWISE
        for border, line in zip(path.borders, match.lines, strict=True):
            if line >= 0:
                draft.lines[line] = _through(draft.lines[line], border, frequency, same_px)
    removed_old = [draft.old[line] for line in removed]
    gone = [draft.lines[line] for line in removed]
    kept = [i for i in range(len(draft.lines)) if i not in removed]
    number = {line: at for at, line in enumerate(kept)}
    draft = _Draft([draft.lines[i] for i in kept], [draft.old[i] for i in kept], draft.notes)
    chains = [[number.get(line, -1) for line in match.lines] for match in matches]
    confirmed = sum(line >= 0 for chain in chains for line in chain)
    for path, chain in zip(paths, chains, strict=True):
        hits = sum(line >= 0 for line in chain)
        if 2 * hits < len(chain):
            draft.notes.append(f"Only {hits} of {len(chain)} boundaries of {path.name} were traced; is it this scan's?")
    new: list[int] = []
    for path, chain in zip(paths, chains, strict=True):
        held = {line for other in chains if other is not chain for line in other if line >= 0}
        new += _add_missing(path, chain, held, draft, found, frequency, valid)
    ties = [tie for path, chain in zip(paths, chains, strict=True) for tie in _ties(path, chain, frequency)]
    certain = {line for chain in chains for line in chain}
    order, clashes = corrected_order(found.order, draft.old, removed_old, [len(t.points) for t in draft.lines],
                                     ties, certain)  # fmt: skip
    rank = np.lexsort((np.arange(len(draft.lines)), order.index, order.group))
    rings = replace(
        found,
        traces=[draft.lines[i] for i in rank],
        order=replace(order, index=order.index[rank], group=order.group[rank], agreement=order.agreement[rank]),
        confidence=_without_contradicted(found.confidence, [*gone, *(draft.lines[i] for i in new)], frequency),
    )
    latewood = np.concatenate([np.zeros((0, 2)), *(path.latewood for path in paths)])
    absent = np.concatenate([np.zeros((0, 2)), *(path.absent_places() for path in paths)])
    marked = np.isin(rank, list(certain))
    return Corrected(rings, marked, latewood, absent, confirmed, len(new), len(gone), [*draft.notes, *clashes])


def _check(path: MarkedPath, shape: tuple[int, ...]) -> None:
    """Refuse marks outside of the scan: the file belongs to another one, or to another resolution of it."""
    if len(path.borders) > MOST_MARKS:
        raise FormatError(f"{path.name}: {len(path.borders)} boundaries on a path; expected at most {MOST_MARKS}")
    points = np.concatenate(path.borders)
    outside = ((points < -0.5 - NEAR_PX) | (points > np.array(shape[::-1]) - 0.5 + NEAR_PX)).any(axis=1)
    if outside.any():
        raise FormatError(
            f"{path.name}: {int(outside.sum())} of {len(points)} points lie outside of the scan; "
            "expected a file of this scan; look at its resolution and whether the scan was turned or cropped"
        )


def _outwards(path: MarkedPath, found: Rings, draft: _Draft) -> MarkedPath:
    """The path turned so that it runs with the growth."""
    ends = np.array([[a[-1], b[0]] for a, b in zip(path.borders[:-1], path.borders[1:], strict=True)]).reshape(-1, 2, 2)
    if len(ends) == 0:
        return path
    angle = nearest(found.growth.direction, ends.mean(axis=1))
    way = ends[:, 1] - ends[:, 0]
    with_growth = np.cos(angle) * way[:, 0] + np.sin(angle) * way[:, 1]
    if float(with_growth.sum()) >= 0.0:
        return path
    other = str(not found.growth.bright_outwards).lower()
    draft.notes.append(
        f"{path.name} runs against the growth that was found and is taken the other way round; if it is right, set "
        f"`ring_tracing.bright_outwards: {other}`."
    )
    return path.reversed()


def _through(line: Trace, border: FloatArray, frequency: npt.NDArray[Any], same_px: float = SAME_PX) -> Trace:
    """Line through the point or points of a mark; as it is where it nearly does."""
    for point in border:
        reach = reach_of(1.0 / float(nearest(frequency, point[None, :])[0]))
        moved = shift_through(line, point, reach)
        stays = float(np.hypot(*(moved.points - line.points).T).max()) <= same_px
        line = replace(moved, points=line.points) if stays else moved
    return line


def _add_missing(
    path: MarkedPath,
    chain: list[int],
    held: set[int],
    draft: _Draft,
    found: Rings,
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
) -> list[int]:
    """Follow every mark without a line, from the inside out, and enter the new lines in `chain`; returns them.

    `held` are the lines of other paths.
    """
    new: list[int] = []
    tolerance = tolerance_of(positions_of(path))
    # Lines that other paths have added, or moved, may pass where this one has a mark.
    added = sorted({i for i, old in enumerate(draft.old) if old < 0} | held)
    boxes = boxes_of([draft.lines[i] for i in added])
    for mark, border in enumerate(path.borders):
        if chain[mark] >= 0:
            continue
        taken = [at for at, i in enumerate(added) if i in chain]
        passing = nearest_line(border[0], [draft.lines[i] for i in added], boxes, tolerance[mark], taken)
        if passing is not None:
            chain[mark] = added[passing]
            draft.lines[chain[mark]] = _through(draft.lines[chain[mark]], border, frequency)
            continue
        moved_here = _line_moved_here(mark, path, chain, draft)
        if moved_here is not None:
            # It is this mark's; the later one gets a line of its own.
            chain[mark], chain[moved_here] = chain[moved_here], -1
            continue
        inner = next((line for line in chain[:mark][::-1] if line >= 0), None)
        outer = next((line for line in chain[mark + 1 :] if line >= 0), None)
        line = follow_boundary(
            border[0],
            draft.lines,
            inner,
            outer,
            _pieces_of_ring(inner, draft, found),
            _pieces_of_ring(outer, draft, found),
            found.strength,
            found.growth.direction,
            frequency,
            valid,
        )
        chain[mark] = len(draft.lines)
        new.append(chain[mark])
        draft.lines.append(_through(line, border[1:], frequency))
        draft.old.append(-1)
    return new


def _line_moved_here(mark: int, path: MarkedPath, chain: Sequence[int], draft: _Draft) -> int | None:
    """Later mark whose line another path, which contradicts this one, has moved away from it and onto this mark."""
    for later in range(mark + 1, len(chain)):
        if chain[later] >= 0:
            points = draft.lines[chain[later]].points
            here, there = (float(np.hypot(*(points - path.borders[at][0]).T).min()) for at in (mark, later))
            if here < min(1.0, there):
                return later
    return None


def _pieces_of_ring(line: int | None, draft: _Draft, found: Rings) -> set[int]:
    """Lines that were traced as pieces of the same ring, the line itself among them."""
    if line is None:
        return set()
    own = draft.old[line]
    if own < 0:
        return {line}
    group, index = found.order.group, found.order.index
    return {i for i, old in enumerate(draft.old) if old >= 0 and group[old] == group[own] and index[old] == index[own]}


def _ties(path: MarkedPath, chain: Sequence[int], frequency: npt.NDArray[Any]) -> list[Tie]:
    """What a path says about the rings from each of its boundaries to the next."""
    ties = []
    for inner, outer, rings, a, b in zip(chain, chain[1:], path.rings, path.borders, path.borders[1:], strict=False):
        if rings > 0:
            ties.append(Tie(inner, outer, rings, False, path.name))
        else:
            length = float(np.hypot(*(b[0] - a[-1])))
            way = a[-1] + np.linspace(0.0, 1.0, max(2, int(length)))[:, None] * (b[0] - a[-1])
            # As in ordering: it takes most of a second cycle to say that one ring lies between.
            counted = max(1, int(length * float(nearest(frequency, way).mean()) + 0.35))
            ties.append(Tie(inner, outer, counted, True, path.name))
    return ties


def _without_contradicted(
    confidence: npt.NDArray[np.float32], lines: Sequence[Trace], frequency: npt.NDArray[Any]
) -> npt.NDArray[np.float32]:
    """Confidence of the phase, 0 within a ring of the lines that the phase has and the person has not, or reversely."""
    if not lines:
        return confidence
    drawn = draw_labels([t.points for t in lines], [t.closed for t in lines], confidence.shape) == 0
    apart = cv2.distanceTransform(drawn.astype(np.uint8), cv2.DIST_L2, 5)
    return np.where(apart * frequency < 1.0, np.float32(0.0), confidence)
