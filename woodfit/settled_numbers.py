"""Numbers for ring boundaries out of votes that contradict each other.

A vote says "b is n more than a", where walks between two boundaries have counted n rings. Votes that are joined from
the clearest down leave contradictions. Some are against nature: whoever walks outwards from one boundary to the next
has passed at least one ring, so that the next cannot have the same number or a smaller one. Either the chain of votes
that led there is wrong in one link, and another link holds instead; or what was traced is no boundary. A piece that is
short beside the boundaries next to it has no say in which link is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from woodfit.tied_numbers import TiedNumbers

#: A vote (a, b, n), a < b, counted from 1: the number of b is n more than that of a.
Vote = tuple[int, int, int]

#: Walks that make an offence against the order of growth: one or two may have slipped past the end of a line.
_LEAST_WALKS = 3.0

#: A boundary this much longer than another one settles where both cannot be right.
_MUCH_LONGER = 4.0

#: A link is given up for an offended vote unless it is stronger than this many times that vote. The order of growth is
#: certain and a count is not; but on rough discs links of half as much again were right, and the vote was a streak's.
_HARDLY_STRONGER = 1.25

#: Share of a short boundary's votes that tell of no room for it; usual is half, those to the side where it itself is.
_MISFIT = 0.25


def clearest(weight: Mapping[Vote, float]) -> list[Vote]:
    """The strongest vote of each pair, the clearest majority first."""
    # A pair's rival votes weaken each other: a clear majority joins first.
    best: dict[tuple[int, int], tuple[float, int]] = {}
    total: dict[tuple[int, int], float] = {}
    for (a, b, apart), strength in weight.items():
        total[a, b] = total.get((a, b), 0.0) + strength
        if strength > best.get((a, b), (0.0, 0))[0]:
            best[a, b] = (strength, apart)
    ranked = sorted(best, key=lambda pair: (-(2.0 * best[pair][0] - total[pair]), pair))
    return [(a, b, best[a, b][1]) for a, b in ranked]


class _Cast:
    """Votes as arrays.

    Parameters
    ----------
    weight : mapping
        Weight of each vote.
    """

    def __init__(self, weight: Mapping[Vote, float]) -> None:
        key = np.array(list(weight), np.int64).reshape(-1, 3)
        self.a, self.b, self.apart = key[:, 0] - 1, key[:, 1] - 1, key[:, 2]
        self.weight = np.array(list(weight.values()), np.float64)

    def offences(self, number: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Whether each vote for a ring or more between two boundaries finds them in the wrong order."""
        return np.asarray(((number[self.b] - number[self.a]) * self.apart <= 0) & (self.apart != 0))

    def cost(self, number: npt.NDArray[np.int64]) -> float:
        """Weight of the votes that are not satisfied; those against the order of growth count twice."""
        missed = number[self.b] - number[self.a] != self.apart
        return float((self.weight * (missed.astype(float) + self.offences(number))).sum())


class _Links(_Cast):
    """Votes, and the trees of those that hold.

    Parameters
    ----------
    weight : mapping
        Weight of each vote.
    count : int
        Of the boundaries.

    Attributes
    ----------
    holds : list of dict
        For each boundary those linked with it, and how much more their numbers are.
    number : int array of shape (count,)
        Each above that of its tree's first.
    """

    def __init__(self, weight: Mapping[Vote, float], count: int) -> None:
        super().__init__(weight)
        self.holds: list[dict[int, int]] = [{} for _ in range(count)]
        tied = TiedNumbers(count)
        for a, b, apart in clearest(weight):
            if tied.difference(a - 1, b - 1) is None:
                tied.tie(a - 1, b - 1, apart)
                self._hold(a - 1, b - 1, apart)
        self._grow()

    def _hold(self, a: int, b: int, apart: int) -> None:
        self.holds[a][b], self.holds[b][a] = apart, -apart

    def _grow(self) -> None:
        """Numbers from the links; and who hangs on whom: `above`, and the place of each and its last descendant's."""
        count = len(self.holds)
        self.above, self.number = np.full(count, -1), np.zeros(count, np.int64)
        self.first, self.last = np.full(count, -1), np.full(count, -1)
        place = 0
        for root in range(count):
            stack = [root] if self.first[root] < 0 else []
            while stack:
                node = stack.pop()
                if node < 0:
                    self.last[~node] = place
                    continue
                self.first[node] = place
                place += 1
                stack.append(~node)
                for other, apart in self.holds[node].items():
                    if other != self.above[node]:
                        self.above[other], self.number[other] = node, self.number[node] + apart
                        stack.append(other)

    def hangs(self, node: npt.NDArray[np.int64] | int, on: int) -> npt.NDArray[np.bool_]:
        """Whether boundaries are `on` or hang on it."""
        return np.asarray((self.first[on] <= self.first[node]) & (self.first[node] < self.last[on]))

    def chain(self, a: int, b: int) -> list[int]:
        """Those of which the link to the one above leads from a to b."""
        links = []
        for begin, end in ((a, b), (b, a)):
            while not self.hangs(end, begin):
                links.append(begin)
                begin = int(self.above[begin])
        return links

    def exchange(self, vote: int) -> bool:
        """Give up one link for an offended vote, if it is hardly stronger and that lowers the cost; whether it did."""
        a, b = int(self.a[vote]), int(self.b[vote])
        more = int(self.apart[vote] - (self.number[b] - self.number[a]))
        pair = (self.a == self.a[vote]) & (self.b == self.b[vote])
        told = float(self.weight[pair & self.offences(self.number)].sum())
        least, weakest = self.cost(self.number), -1
        for node in self.chain(a, b):
            if self.told(node, int(self.above[node])) >= _HARDLY_STRONGER * told:
                continue
            moved = np.where(self.hangs(np.arange(len(self.number)), node), more if self.hangs(b, node) else -more, 0)
            cost = self.cost(self.number + moved)
            if cost < least:
                least, weakest = cost, node
        if weakest < 0:
            return False
        beside = int(self.above[weakest])
        del self.holds[weakest][beside], self.holds[beside][weakest]
        self._hold(a, b, int(self.apart[vote]))
        self._grow()
        return True

    def told(self, one: int, other: int) -> float:
        """Weight of the votes for the link between two boundaries."""
        a, b = min(one, other), max(one, other)
        return float(self.weight[(self.a == a) & (self.b == b) & (self.apart == self.holds[a][b])].sum())

    def mend(self) -> None:
        """Exchange links, for the strongest offended votes first, until none lowers the cost."""
        strong = np.flatnonzero(self.weight >= _LEAST_WALKS)
        strong = strong[np.argsort(-self.weight[strong], kind="stable")]
        mended = True
        while mended:
            mended = False
            for vote in strong.tolist():
                if self.offences(self.number)[vote]:
                    mended |= self.exchange(vote)


def joined(weight: Mapping[Vote, float], count: int) -> TiedNumbers:
    """Numbers of `count` boundaries, votes joined from the clearest down."""
    tied = TiedNumbers(count)
    for a, b, apart in clearest(weight):
        tied.tie(a - 1, b - 1, apart)
    return tied


def settle(weight: Mapping[Vote, float], count: int) -> TiedNumbers:
    """Numbers that satisfy the votes as far as they can be, the order of growth before all.

    Parameters
    ----------
    weight : mapping
        Weight of each vote.
    count : int
        Of the boundaries.

    Returns
    -------
    TiedNumbers
        Of all boundaries between which there are votes.
    """
    links = _Links(weight, count)
    links.mend()
    tied = TiedNumbers(count)
    for a, held in enumerate(links.holds):
        for b, apart in held.items():
            tied.tie(a, b, apart)
    return tied


def much_longer(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Whether of two lengths, the one or the other is so much larger that it settles where both cannot be right."""
    return np.asarray(_MUCH_LONGER * np.minimum(one, other) < np.maximum(one, other))


def misfits(
    weight: Mapping[Vote, float], number: npt.NDArray[np.int64], length: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Which boundaries have a place in the order of growth only where a much longer one already is."""
    cast = _Cast(weight)
    told = cast.offences(number) & much_longer(length[cast.a], length[cast.b])
    shorter = np.where(length[cast.a] < length[cast.b], cast.a, cast.b)
    count = len(length)
    offended = np.bincount(shorter[told], cast.weight[told], count)
    total = np.bincount(cast.a, cast.weight, count) + np.bincount(cast.b, cast.weight, count)
    return np.asarray((offended >= _LEAST_WALKS) & (offended > _MISFIT * total))


def offended(weight: Mapping[Vote, float], number: npt.NDArray[np.int64]) -> float:
    """Weight of the votes against the order of growth."""
    cast = _Cast(weight)
    return float(cast.weight[cast.offences(number)].sum())
