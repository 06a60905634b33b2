"""Numbers of which only differences are known, as the indices of ring boundaries are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


class TiedNumbers:
    """Numbers tied by differences: the first word counts.

    Parameters
    ----------
    count : int
        Of the numbers, none of them tied.
    """

    def __init__(self, count: int) -> None:
        self._parent, self._above = list(range(count)), [0] * count

    def find(self, node: int) -> tuple[int, int]:
        """Root of a number, the same for all that are tied to it, and what the number is above it."""
        above = 0
        while self._parent[node] != node:
            above += self._above[node]
            node = self._parent[node]
        return node, above

    def numbers(self) -> npt.NDArray[np.int64]:
        """Each number above that of its root."""
        return np.array([self.find(node)[1] for node in range(len(self._parent))], np.int64)

    def difference(self, a: int, b: int) -> int | None:
        """What b is more than a, None if they are not tied."""
        (root_a, above_a), (root_b, above_b) = self.find(a), self.find(b)
        return above_b - above_a if root_a == root_b else None

    def tie(self, a: int, b: int, difference: int) -> bool:
        """Say that b is `difference` more than a; False if something else was said before."""
        known = self.difference(a, b)
        if known is not None:
            return known == difference
        (root_a, above_a), (root_b, above_b) = self.find(a), self.find(b)
        self._parent[root_b], self._above[root_b] = root_a, above_a + difference - above_b
        return True
