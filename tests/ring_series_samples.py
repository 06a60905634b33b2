"""Ring series for the tests of file formats: random ones with every trait, and comparison up to a tolerance."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from woodfit.dendro.series import RingSeries


def full_series(name: str = "F02b_N", first_year: int | None = 1897, unit_mm: float = 0.001) -> RingSeries:
    """A series with everything that a series can hold, on a grid of `unit_mm`, without the value of an end mark."""
    width = np.array([1.25, 0.0, np.nan, 2.5, 0.08, 12.34, 0.31, 0.99, 1.01, 3.0, 2.2, 4.87])
    late = np.array([0.25, 0.0, np.nan, np.nan, 0.02, 2.34, 0.11, 0.19, 0.21, 0.5, 0.2, 0.87])
    return RingSeries(
        name,
        np.round(width / unit_mm) * unit_mm,
        first_year,
        np.round((width - late) / unit_mm) * unit_mm,
        late,
        confidence=np.linspace(0.5, 1, len(width)),
        remarks={3: "crack", 5: "frost damage", 11: "pencil & <ink>"},
        pith_distance_mm=2.3,
        pith_years=2,
        pith=False,
        bark=True,
        unmeasured_outer=1,
    )


@st.composite
def ring_series(draw: st.DrawFn, unit_um: int = 1, name: str = "S") -> RingSeries:
    """Widths in whole units, absent rings and gaps; an end mark's value is not among them."""
    units = st.integers(0, 99_999 if unit_um == 10 else 90_000).filter(lambda unit: unit != 999)
    cells = draw(st.lists(units | st.none() | st.just(0), min_size=1, max_size=45))
    width = np.array([np.nan if cell is None else cell * unit_um / 1000 for cell in cells])
    year = draw(st.integers(-9999, 9900) | st.integers(-1030, -970) | st.integers(-30, 5))
    return RingSeries(name, width, year)


def assert_same(found: RingSeries, expected: RingSeries, atol: float = 1e-9, parts: bool = True) -> None:
    assert found.first_year == expected.first_year
    names = ("width_mm", "earlywood_mm", "latewood_mm") if parts else ("width_mm",)
    for name in names:
        one, other = getattr(found, name), getattr(expected, name)
        assert (one is None) == (other is None), name
        if one is not None:
            np.testing.assert_allclose(one, other, rtol=0, atol=atol, equal_nan=True)
