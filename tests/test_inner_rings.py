"""Rings between the pith and the innermost boundary that was seen."""

from __future__ import annotations

import json

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernel_scenes import SHARED, needs_shared

from woodfit.inner_rings import false_innermost, widths_inside

WIDTHS = st.lists(st.floats(0.5, 60.0), max_size=60).map(np.array)


@given(WIDTHS, st.floats(1.0, 3000.0), st.floats(3.0, 60.0))
def test_whatever_was_seen_the_inner_rings_fill_the_way_to_the_pith(
    seen: np.ndarray, radius: float, width: float
) -> None:
    inside = widths_inside(seen, radius, width)
    assert len(inside) >= 1
    assert (inside > 0.0).all()
    assert inside.sum() == pytest.approx(radius)


def test_a_tree_that_slowed_down_with_age_is_followed_back_to_its_youth() -> None:
    year = np.arange(40.0)
    grown = 12.0 * (1.0 + np.exp(-year / 10.0))
    inside = widths_inside(grown[10:], float(grown[:10].sum()), 13.0)
    assert abs(len(inside) - 10) <= 1
    npt.assert_allclose(inside[-6:], grown[4:10], rtol=0.08)


def test_an_even_tree_is_not_made_much_wider_inside() -> None:
    inside = widths_inside(np.full(17, 14.0), 280.0, 14.0)
    assert inside[-4:].max() < 1.15 * 14.0
    assert inside.max() < 1.6 * 14.0


def test_the_noisier_a_tree_the_more_the_usual_trend_counts() -> None:
    rng = np.random.default_rng(2)
    noisy = 14.0 * np.exp(rng.normal(0.0, 0.3, 17) - 0.045)
    even = widths_inside(np.full(17, 14.0), 140.0, 14.0)
    assert widths_inside(noisy, 140.0, 14.0)[1:4].mean() > even[1:4].mean()


def test_one_missed_boundary_does_not_widen_all_rings_inside() -> None:
    seen = np.full(12, 14.0)
    doubled = np.concatenate([[28.0], seen[2:]])
    assert widths_inside(doubled, 140.0, 14.0)[-3:].mean() < 1.25 * widths_inside(seen, 140.0, 14.0)[-3:].mean()


@needs_shared
@pytest.mark.shared
@pytest.mark.parametrize(("name", "hidden"), [("F02b", 4), ("F02b", 6), ("A05b", 6), ("A05b", 9)])
def test_on_real_discs_the_hidden_inner_rings_are_met_better_than_by_even_ones(name: str, hidden: int) -> None:
    document = json.loads((SHARED / f"data/labels/{name}.json").read_text())
    ours, even = [], []
    for path in document["paths"]:
        radii = np.array([r for r, i in zip(path["radii"], path["ring_index"], strict=True) if i is not None])
        widths = np.diff(radii)
        inside, seen = widths[:hidden], widths[hidden:]
        guess = widths_inside(seen, float(radii[hidden]), float(seen.mean()))
        count = min(hidden, len(guess))
        ours.append(abs(guess[-count:].sum() - inside[-count:].sum()))
        even.append(abs(count * seen[:8].mean() - inside[-count:].sum()))
    assert np.mean(ours) < np.mean(even)


def test_short_lines_without_room_for_a_ring_are_no_innermost_rings() -> None:
    ages = np.arange(8)
    radii = np.array([180.0, 180.5, 181.0, 190.0, 203.0, 215.0, 230.0, 244.0])
    mass = np.array([100.0, 100.0, 300.0, 740.0, 740.0, 740.0, 740.0, 740.0])
    assert false_innermost(ages, radii, mass, 13.0) == 2
    assert false_innermost(ages, radii, np.full(8, 740.0), 13.0) == 0
    assert false_innermost(ages, 180.0 + 13.0 * ages, mass, 13.0) == 0
    # Around the pith rings are short by nature.
    assert false_innermost(ages, radii - 170.0, mass, 13.0) == 0
