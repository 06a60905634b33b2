"""Ring boundaries that a person marked along a straight path.

Image frame: x right, y down, px, pixel centres at integers. In a label file a path is a mapping with ``start`` and
``end`` (x, y), ``positions`` of the boundaries (m, 2), and optionally ``uncertain`` (m), ``year`` or ``ring_index``
(m), ``labelled_from_radius`` and ``labelled_to_radius`` (px from ``start``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class LabelledPath:
    """The boundaries labelled along one straight path, in order along it; distances from the start, px.

    Parameters
    ----------
    start, end
        x, y, shape (2,).
    position
        Shape (m,), ascending.
    uncertain
        Boundaries that are not judged, shape (m,).
    number
        Year of the ring that each boundary closes on its outer side, or its ring number, shape (m,); NaN for a
        boundary without one.
    outwards
        +1 when age grows along the path, -1 against it, 0 when the label does not tell.
    low, high
        Only between these is anything judged.
    """

    start: Floats
    end: Floats
    position: Floats
    uncertain: Bools
    number: Floats
    outwards: int
    low: float
    high: float

    @classmethod
    def read(cls, path: Mapping[str, Any]) -> LabelledPath:
        """From a label.

        Raises
        ------
        KeyError
            A needed key is missing.
        ValueError
            The label contradicts itself; says how.
        """
        start, end = (np.asarray(path[key], dtype=float) for key in ("start", "end"))
        if start.shape != (2,) or end.shape != (2,) or np.array_equal(start, end):
            raise ValueError(f"a path leads from {path['start']} to {path['end']}, expected two places [x, y]")
        length = float(np.hypot(*(end - start)))
        low, high = float(path.get("labelled_from_radius", 0.0)), float(path.get("labelled_to_radius", length))
        position = (np.asarray(path["positions"], dtype=float).reshape(-1, 2) - start) @ ((end - start) / length)
        count = len(position)
        uncertain = _per_boundary(path, "uncertain", count, 0.0).astype(bool)
        named = next((key for key in ("year", "ring_index") if path.get(key) is not None), None)
        order = np.argsort(position, kind="stable")
        position, uncertain = position[order], uncertain[order]
        number = np.arange(1.0, count + 1) if named is None else _per_boundary(path, named, count)[order]
        known = number[np.isfinite(number)]
        outwards = 0 if named is None or len(known) < 2 else int(np.sign(known[-1] - known[0]))
        inside = (position >= low) & (position <= high)
        return cls(start, end, position[inside], uncertain[inside], number[inside], outwards, low, high)

    def ring_at(self, position: float) -> int | None:
        """Number of the ring that a place along the path lies in: that of the next boundary outwards."""
        sign = self.outwards or 1
        known = np.isfinite(self.number)
        beyond = known & (sign * (self.position - position) >= 0)
        if beyond.any():
            nearest = np.flatnonzero(beyond)[0 if sign > 0 else -1]
            return int(self.number[nearest])
        return int(self.number[known].max()) + 1 if known.any() else None


def _per_boundary(path: Mapping[str, Any], key: str, count: int, default: float = np.nan) -> Floats:
    """Values of one key, None as NaN, shape (count,)."""
    values = path.get(key)
    if values is None:
        return np.full(count, default)
    if len(values) != count:
        raise ValueError(f"`{key}` has {len(values)} values for {count} positions, expected as many")
    return np.array([default if value is None else value for value in values], dtype=float)
