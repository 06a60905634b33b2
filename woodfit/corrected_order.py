"""Indices of boundaries when a person's count along some paths overrules that of the tracing."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from woodfit.ring_order import Order
from woodfit.tied_numbers import TiedNumbers

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Tie:
    """What a person says: from line `inner` to line `outer` there are `rings` rings.

    Parameters
    ----------
    inner, outer : int
        Lines.
    rings : int
        At least 1.
    is_guess : bool
        True across a gap: the count of the tracing goes before.
    source : str
        Who says it, for messages.
    """

    inner: int
    outer: int
    rings: int
    is_guess: bool
    source: str


def corrected_order(
    traced: Order,
    old: Sequence[int],
    removed: Collection[int],
    length: Sequence[int],
    ties: Sequence[Tie],
    certain: Collection[int],
) -> tuple[Order, list[str]]:
    """Indices that agree with a person's count first and with the tracing's second.

    Parameters
    ----------
    traced : Order
        Of the traced boundaries.
    old : sequence of int
        For each line the traced boundary that it is (a piece of), -1 for a new one.
    removed : collection of int
        Traced boundaries that are gone.
    length : sequence of int
        Vertices of each line.
    ties : sequence of Tie
        The person's counts.
    certain : collection of int
        Lines that the person marked.

    Returns
    -------
    order : Order
        Of the lines; `agreement` is 1 for those that the person marked.
    clashes : list of str
        Counts that contradict others, in words.
    """
    union = TiedNumbers(len(old))
    clashes = [
        f"{tie.source} counts {_rings(tie.rings)} where other corrections count otherwise."
        for tie in ties
        if not tie.is_guess and not union.tie(tie.inner, tie.outer, tie.rings)
    ]
    by_place: dict[tuple[int, int], list[int]] = {}
    for line, was in enumerate(old):
        if was >= 0:
            by_place.setdefault((int(traced.group[was]), int(traced.index[was])), []).append(line)
    lost = {(int(traced.group[was]), int(traced.index[was])) for was in removed} - set(by_place)
    for tie in ties:
        if tie.is_guess:
            counted = _traced_difference(tie, traced, old, lost)
            union.tie(tie.inner, tie.outer, tie.rings if counted is None else counted)
    loose = _tie_traced(union, by_place, lost, set(certain))
    if loose:
        clashes.append(f"{len(loose)} traced boundaries have no place among the corrected ones; their index is loose.")
    return _order(union, traced, old, length, set(certain)), clashes


def _rings(count: int) -> str:
    return f"{count} ring{'s' * (count > 1)}"


def _traced_difference(tie: Tie, traced: Order, old: Sequence[int], lost: Collection[tuple[int, int]]) -> int | None:
    """Rings between two lines by the tracing, without the removed ones; None if it does not know."""
    a, b = old[tie.inner], old[tie.outer]
    if a < 0 or b < 0 or traced.group[a] != traced.group[b] or traced.index[b] <= traced.index[a]:
        return None
    between = sum(g == traced.group[a] and traced.index[a] < i < traced.index[b] for g, i in lost)
    return max(1, int(traced.index[b] - traced.index[a] - between))


def _tie_traced(
    union: TiedNumbers, by_place: dict[tuple[int, int], list[int]], lost: Collection[tuple[int, int]], certain: set[int]
) -> list[int]:
    """Tie what the person left open as the tracing had it; returns lines that fit nowhere and are left alone."""
    lead = {place: min(lines, key=lambda line: line not in certain) for place, lines in by_place.items()}
    for place, lines in by_place.items():
        for line in lines:
            union.tie(lead[place], line, 0)
    loose = []
    for group in sorted({group for group, _ in by_place}):

        def steps(low: int, high: int, group: int = group) -> int:
            return high - low - sum(g == group and low < index < high for g, index in lost)

        places = sorted(index for g, index in by_place if g == group)
        fixed = [index for index in places if lead[group, index] in certain]
        for low, high in pairwise(fixed):
            room = union.difference(lead[group, low], lead[group, high])
            crowded = [i for i in places if low < i < high and room is not None and not 0 < steps(low, i) < room]
            loose += [line for index in crowded for line in by_place[group, index]]
            places = [index for index in places if index not in crowded]
        for low, high in pairwise(places):
            union.tie(lead[group, low], lead[group, high], steps(low, high))
    return loose


def _order(union: TiedNumbers, traced: Order, old: Sequence[int], length: Sequence[int], certain: set[int]) -> Order:
    """Read the indices off the ties: 1 for the smallest of each group, the groups by their length."""
    count = len(old)
    found = [union.find(line) for line in range(count)]
    names, inverse = np.unique([root for root, _ in found] or np.zeros(0, np.int64), return_inverse=True)
    mass = np.bincount(inverse, weights=np.asarray(length, np.float64), minlength=len(names)) if count else np.zeros(0)
    rank = np.empty(len(names), np.int64)
    rank[np.argsort(-mass, kind="stable")] = np.arange(len(names))
    group = rank[inverse] if count else np.zeros(0, np.int64)
    index = np.array([above for _, above in found], np.int64)
    for number in range(len(names)):
        index[group == number] += 1 - index[group == number].min()
    agreement = np.array([1.0 if i in certain else traced.agreement[was] for i, was in enumerate(old)], np.float64)
    return Order(index, group, agreement)
