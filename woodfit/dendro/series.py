"""A series of ring widths and what a measurer knows about it, apart from any file format."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RingSeries:
    """Ring widths along one measurement path, from the oldest ring to the youngest.

    Parameters
    ----------
    name : str
        Identity of the series, for example ``F02b_N``.
    width_mm : float64 array of shape (n,)
        Ring widths in mm: 0 for a locally absent ring, NaN where a ring is known to exist but could not be measured.
    first_year : int or None
        Year of the oldest ring; astronomical years (0 is 1 BC). None when the series is not dated.
    earlywood_mm, latewood_mm : float64 arrays of shape (n,) or None
        Parts of each ring, NaN where the border between them was not seen.
    confidence : float64 array of shape (n,) or None
        Probability, 0..1, that the ring's outer boundary is a ring boundary.
    remarks : mapping of int to str
        Words about single rings by position in the series, for example ``"crack"``.
    pith_distance_mm : float or None
        Distance from the series' inner end to the pith.
    pith_years : int or None
        Rings missing between the series' inner end and the pith, estimated.
    pith, bark : bool or None
        Whether the pith, the bark is on the sample; None when nobody looked.
    unmeasured_outer : int or None
        Rings known to follow the last measured one.
    """

    name: str
    width_mm: FloatArray
    first_year: int | None = None
    earlywood_mm: FloatArray | None = None
    latewood_mm: FloatArray | None = None
    confidence: FloatArray | None = None
    remarks: dict[int, str] = field(default_factory=dict)
    pith_distance_mm: float | None = None
    pith_years: int | None = None
    pith: bool | None = None
    bark: bool | None = None
    unmeasured_outer: int | None = None

    def __post_init__(self) -> None:
        for name in ("width_mm", "earlywood_mm", "latewood_mm", "confidence"):
            value = getattr(self, name)
            if value is None:
                continue
            array = np.asarray(value, np.float64)
            if array.ndim != 1 or len(array) != len(self.width_mm):
                raise ValueError(f"series {self.name!r}: {name} has shape {array.shape}, expected ({len(self)},)")
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.width_mm)

    @property
    def last_year(self) -> int | None:
        """Year of the youngest ring, None when not dated."""
        return None if self.first_year is None else self.first_year + len(self) - 1

    @property
    def years(self) -> npt.NDArray[np.int64]:
        """Year of each ring; 1, 2, ... when not dated."""
        return np.arange(len(self), dtype=np.int64) + (1 if self.first_year is None else self.first_year)


class FormatError(ValueError):
    """A file that cannot be read: says where (file, line), what was found, what was expected and what to do."""
