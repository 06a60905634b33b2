"""Boundaries that a path denies and something else confirms: cut where they are denied, kept elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.grids import nearest
from woodfit.marked_path import MarkedPath
from woodfit.marks_on_lines import Match, match_marks
from woodfit.tracing import Trace

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SHORTEST = 4


def cut_contested(
    lines: Sequence[Trace],
    places: Sequence[tuple[int, int]],
    paths: Sequence[MarkedPath],
    frequency: npt.NDArray[Any],
) -> tuple[list[Trace], list[int], list[str]]:
    """Cut lines that are both denied and confirmed.

    A line that one path marks and another crosses without a mark keeps the vertices that are nearer to the mark. A line
    that a path crosses without a mark, having marked another piece of the same ring, loses a ring width to both sides.

    Parameters
    ----------
    lines : sequence of Trace
        Traced boundaries.
    places : sequence of tuple of two int
        Group and index of each.
    paths : sequence of MarkedPath
        In pixels of the arrays.
    frequency : array of shape (M, N)
        Rings per pixel.

    Returns
    -------
    lines : list of Trace
        The same, with pieces in place of those cut.
    old : list of int
        Which of the given lines each is or is a piece of.
    notes : list of str
        Who disagrees with whom.
    """
    matches = [match_marks(path, lines) for path in paths]
    marked = {number for match in matches for number in match.lines}
    denials: dict[int, list[float]] = {}
    doubles: dict[int, list[float]] = {}
    notes = []
    for path, match in zip(paths, matches, strict=True):
        ours = {places[number] for number in match.lines if number >= 0}
        for number, at in match.unmarked:
            if number in marked:
                denials.setdefault(number, []).append(at)
                notes.append(f"{path.name} denies a boundary that another path marks; it was cut between them.")
            elif places[number] in ours:
                doubles.setdefault(number, []).append(at)
    kept: list[Trace] = []
    old: list[int] = []
    for i, line in enumerate(lines):
        pieces = [line]
        if i in denials:
            pieces = _pieces(line, _nearer_to_marks(line, denials[i], _marks_on(i, paths, matches)), SHORTEST)
        elif i in doubles:
            width = 1.0 / nearest(frequency, line.points)
            pieces = _pieces(line, _beyond(line, doubles[i], width), max(SHORTEST, int(2.0 * float(np.median(width)))))
        kept += pieces
        old += [i] * len(pieces)
    return kept, old, notes


def _marks_on(line: int, paths: Sequence[MarkedPath], matches: Sequence[Match]) -> list[FloatArray]:
    return [
        border[0]
        for path, match in zip(paths, matches, strict=True)
        for border, which in zip(path.borders, match.lines, strict=True)
        if which == line
    ]


def _vertices_apart(line: Trace, at: Sequence[float]) -> FloatArray:
    """Vertices between each vertex (K,) and each place (P,) along a line; shape (K, P)."""
    count = len(line.points)
    apart = np.abs(np.arange(count)[:, None] - np.array(at)[None, :])
    return np.asarray(np.minimum(apart, count - apart) if line.closed else apart)


def _nearer_to_marks(line: Trace, denied: Sequence[float], marks: Sequence[FloatArray]) -> BoolArray:
    places = [float(np.hypot(*(line.points - mark).T).argmin()) for mark in marks]
    return np.asarray(_vertices_apart(line, [*denied, *places]).argmin(axis=1) >= len(denied))


def _beyond(line: Trace, denied: Sequence[float], width: FloatArray) -> BoolArray:
    # Vertices are about a pixel apart.
    return np.asarray(_vertices_apart(line, denied).min(axis=1) > width)


def _pieces(line: Trace, keep: BoolArray, shortest: int) -> list[Trace]:
    """Stretches of a line where `keep` holds, each at least `shortest` vertices long."""
    turn = int(np.argmin(keep)) if line.closed else 0
    points, belief = np.roll(line.points, -turn, axis=0), np.roll(line.confidence, -turn)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.roll(keep, -turn).astype(np.int8), [0]])))
    runs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [Trace(points[start:end], belief[start:end], False) for start, end in runs if end - start >= shortest]
