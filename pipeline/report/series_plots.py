"""Plots of measured series: widths with earlywood and latewood, all series in one, and the latewood transition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.report.palettes import mapped
from pipeline.report.plots import ACCENT, COOL, INK, MUTED, WOOD, svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[Any]

#: Map of the latewood transition, from earlywood to latewood.
TRANSITION_MAP = "magma_r"

# Where the axes lie: the same for all, so that the years of plots below each other agree.
_PLACE = (0.06, 0.235, 0.935, 0.73)
# Standard deviation of the smoothing along the fraction of the ring, as the share of a ring.
_SMOOTH = 0.02


@dataclass(frozen=True)
class DrawnSeries:
    """What the plots show of one series, from the oldest ring to the youngest.

    Parameters
    ----------
    name
        Of the series.
    path
        Vertices x, y of its measurement path, scan px, shape (k, 2).
    boundaries
        Where it crosses ring boundaries: x, y in scan px, shape (c, 2).
    normal_rad
        Outward normal of each boundary there, shape (c,); NaN to draw it across the path.
    labels
        Year or number of the ring that each boundary ends, length c; ``None`` where the boundary ends no ring of
        the series.
    confidence
        Of each boundary, 0..1, shape (c,).
    years
        Year or number of each ring, shape (n,).
    dated
        Whether these are years.
    width
        Ring widths, shape (n,); NaN where not measured, 0 for absent rings.
    earlywood, latewood
        Parts of each ring, shape (n,); NaN where not seen.
    unit
        Of the widths: ``"mm"`` or ``"px"``.
    table
        Lateness over ring and fraction of the ring from its inner side, shape (n, fractions); NaN where unknown.
        ``None`` when there is none.
    onset
        Fraction at which latewood begins, shape (n,); NaN where not seen.
    """

    name: str
    path: Array
    boundaries: Array
    normal_rad: Array
    labels: tuple[int | None, ...]
    confidence: Array
    years: Array
    dated: bool
    width: Array
    earlywood: Array
    latewood: Array
    unit: str
    table: Array | None
    onset: Array


def widths_plot(series: DrawnSeries, name: str) -> str:
    """Ring widths as steps over the year, earlywood below latewood where both were seen."""
    edges = _edges(series.years)
    parts = np.isfinite(series.earlywood) & np.isfinite(series.latewood)
    early = np.where(parts, series.earlywood, 0.0)
    late = np.where(parts, series.earlywood + series.latewood, 0.0)
    absent = series.width == 0

    def draw(axes: Axes) -> None:
        if parts.any():
            axes.stairs(early, edges, fill=True, color=WOOD, linewidth=0, label="earlywood")
            axes.stairs(late, edges, baseline=early, fill=True, color=ACCENT, linewidth=0, label="latewood")
            axes.legend(loc="upper right", frameon=False, ncols=2, fontsize=9, borderaxespad=0.1)
        axes.stairs(series.width, edges, baseline=None, color=INK, linewidth=_thin(0.9, len(edges)))
        if absent.any():
            axes.plot(series.years[absent], np.zeros(int(absent.sum())), "x", color=COOL, markersize=5, clip_on=False)
        _over_years(axes, edges, series, "ring width")

    known = series.width[np.isfinite(series.width)]
    span = f", {known.min():.3g} to {known.max():.3g} {series.unit}" if len(known) else ""
    what = "years" if series.dated else "rings"
    alt = f"Ring widths of {series.name}, {what} {series.years[0]} to {series.years[-1]}{span}."
    return svg(name, alt, (820, 170), draw, _PLACE)


def spaghetti_plot(all_series: Sequence[DrawnSeries], name: str) -> str:
    """Widths of all series over the year, and their mean where at least two have a ring."""
    first = min(int(one.years[0]) for one in all_series)
    last = max(int(one.years[-1]) for one in all_series)
    table = np.full((len(all_series), last - first + 1), np.nan)
    for row, one in zip(table, all_series, strict=True):
        row[one.years - first] = one.width
    years, many = np.arange(first, last + 1), np.isfinite(table).sum(axis=0)
    mean = np.where(many > 1, np.nansum(table, axis=0) / np.maximum(many, 1), np.nan)

    def draw(axes: Axes) -> None:
        for row in table:
            axes.plot(years, row, color=MUTED, linewidth=_thin(0.7, len(years)), alpha=0.6)
        axes.plot(years, mean, color=ACCENT, linewidth=_thin(1.8, len(years)))
        _over_years(axes, _edges(years), all_series[0], "ring width")

    alt = f"Ring widths of {len(all_series)} series, {first} to {last}, with their mean."
    return svg(name, alt, (820, 190), draw, _PLACE)


def transition_plot(series: DrawnSeries, name: str) -> str | None:
    """Lateness over the ring, left to right, and the fraction of the ring, bottom to top; ``None`` without a table."""
    if series.table is None or not np.isfinite(series.table).any():
        return None
    picture = mapped(transition_image(series.table), TRANSITION_MAP)
    edges, seen = _edges(series.years), np.isfinite(series.onset)

    def draw(axes: Axes) -> None:
        axes.imshow(
            picture, extent=(edges[0], edges[-1], 0.0, 1.0), origin="lower", aspect="auto", interpolation="nearest"
        )
        size = 4.0 if len(series.years) < 150 else 2.0
        axes.plot(
            series.years[seen], series.onset[seen], "o", color="white", markersize=size, mec=INK, mew=0.5, zorder=3
        )
        _over_years(axes, edges, series, "fraction of the ring")
        axes.set(ylim=(0, 1))
        axes.grid(False)

    return svg(
        name, f"Lateness of {series.name} over {len(series.years)} rings and their fraction.", (820, 190), draw, _PLACE
    )


def transition_image(table: Array) -> Array:
    """Picture of a lateness table: smoothed along the fraction and spread to 0..1.

    Parameters
    ----------
    table
        Inverted lightness, shape (rings, fractions), NaN where unknown.

    Returns
    -------
    float array of shape (fractions, rings)
        0 at the 2 % and 1 at the 98 % quantile; NaN where unknown.
    """
    from scipy.ndimage import gaussian_filter1d

    values = np.asarray(table, float)
    known = np.isfinite(values)
    # The ends of a ring stay its own: nothing is mixed in from the next one.
    sigma = max(_SMOOTH * values.shape[1], 1e-3)
    total = gaussian_filter1d(np.where(known, values, 0.0), sigma, axis=1, mode="nearest")
    share = gaussian_filter1d(known.astype(float), sigma, axis=1, mode="nearest")
    smooth = np.divide(total, share, out=np.full_like(values, np.nan), where=known & (share > 1e-9))
    if not known.any():
        return np.asarray(smooth.T)
    low, high = np.nanquantile(smooth, [0.02, 0.98])
    return np.asarray(np.clip((smooth.T - low) / max(high - low, 1e-9), 0.0, 1.0))


def _thin(width_pt: float, years: int) -> float:
    """Line width that leaves long series readable."""
    return width_pt * float(np.clip(150.0 / years, 0.55, 1.0))


def _edges(years: Array) -> Array:
    return np.append(np.asarray(years, float) - 0.5, float(years[-1]) + 0.5)


def _over_years(axes: Axes, edges: Array, series: DrawnSeries, what: str) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(10, integer=True, steps=[1, 2, 5, 10]))
    axes.set(xlim=(edges[0], edges[-1]), xlabel="year" if series.dated else "ring")
    if what == "ring width":
        axes.set_ylim(bottom=0)
        what = f"{what}, {series.unit}"
    axes.set_ylabel(what)
