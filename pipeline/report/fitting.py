"""How well the model fits: the loss of each iteration, and what is left of the phase."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.report.axes import linear_bar
from pipeline.report.palettes import NOTHING, mapped
from pipeline.report.pictures import jpeg
from pipeline.report.plots import ACCENT, MUTED, svg
from pipeline.report.reading import Scan
from stages.variables import LOSS, PHASE_CONFIDENCE, PHASE_RESIDUAL, VALID

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[Any]


def _reach(figures: dict[str, float]) -> float:
    """How many rings the map and the histogram show: what most of the face needs, a round number."""
    return next((reach for reach in (0.02, 0.05, 0.1, 0.25) if reach >= 1.3 * figures["most"]), 0.5)


def fit_section(scan: Scan) -> dict[str, Any] | None:
    """Loss curve and residuals; ``None`` before phase polishing."""
    if not scan.has(LOSS) and not scan.has(PHASE_RESIDUAL):
        return None
    section: dict[str, Any] = {"loss": None, "residual": None}
    if scan.has(LOSS):
        section["loss"] = _loss(scan.values(LOSS))
    if scan.has(PHASE_RESIDUAL):
        section["residual"] = _residual(scan)
    return section


def _loss(loss: Array) -> dict[str, Any] | None:
    known = np.isfinite(loss) & (loss > 0)
    if not known.any():
        return None
    from matplotlib.ticker import LogLocator

    steps, values = np.flatnonzero(known), loss[known]

    def draw(axes: Axes) -> None:
        axes.plot(steps, values, color=ACCENT, linewidth=1.8, marker="o" if len(values) < 40 else "", markersize=3)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:.3g}")
        if values.max() < 50.0 * values.min():
            axes.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
            axes.yaxis.set_minor_formatter("{x:.3g}")
            axes.grid(which="minor")
        axes.set(xlabel="iteration", ylabel="loss")
        axes.annotate(f"{values[-1]:.3g}", (steps[-1], values[-1]), (-4, 8), textcoords="offset points", ha="right")

    alt = f"Loss over {len(loss)} iterations, from {values[0]:.3g} to {values[-1]:.3g}, on a logarithmic scale."
    return {
        "svg": svg("loss", alt, (400, 250), draw),
        "first": f"{values[0]:.3g}",
        "last": f"{values[-1]:.3g}",
        "count": len(loss),
    }


def residual_figures(scan: Scan) -> dict[str, float] | None:
    """Median and 95 % quantile of the absolute phase residual in rings, and the share within a quarter ring."""
    if not scan.has(PHASE_RESIDUAL):
        return None
    residual, trust = _samples(scan)
    if residual.size == 0:
        return None
    order = np.argsort(residual)
    share = np.cumsum(trust[order])
    middle, most = np.interp(np.array([0.5, 0.95]) * share[-1], share, residual[order])
    within = float((trust * (residual <= 0.25)).sum() / trust.sum())
    return {"median": float(middle), "most": float(most), "within": within}


def _samples(scan: Scan) -> tuple[Array, Array]:
    """Absolute residuals in rings of some hundred thousand pixels of wood, with their confidence."""
    array = scan.ds[PHASE_RESIDUAL.name]
    stride = max(1, int(np.sqrt(array.size / 400_000)))
    pick = {"y": slice(None, None, stride), "x": slice(None, None, stride)}
    residual = np.abs(np.asarray(array.isel(pick).values)) / (2 * np.pi)
    trust = np.ones_like(residual)
    if scan.has(PHASE_CONFIDENCE) and scan.ds[PHASE_CONFIDENCE.name].shape == array.shape:
        trust = np.nan_to_num(np.asarray(scan.ds[PHASE_CONFIDENCE.name].isel(pick).values))
    if scan.has(VALID) and scan.ds[VALID.name].shape == array.shape:
        trust = trust * np.asarray(scan.ds[VALID.name].isel(pick).values)
    known = np.isfinite(residual) & (trust > 0)
    return residual[known], trust[known]


def _residual(scan: Scan) -> dict[str, Any] | None:
    figures = residual_figures(scan)
    if figures is None:
        return None
    wave = scan.combined((PHASE_RESIDUAL,), lambda phase: np.exp(1j * np.nan_to_num(phase)).astype(np.complex64))
    rings, reach = np.angle(wave) / (2 * np.pi), _reach(figures)
    colors = mapped(0.5 + 0.5 * rings / reach, "RdBu_r").astype(np.float32)
    trust = np.ones(rings.shape, np.float32)
    if scan.has(PHASE_CONFIDENCE):
        trust = np.clip(np.nan_to_num(scan.image(PHASE_CONFIDENCE)), 0.0, 1.0)
    trust = np.where(scan.wood(rings.shape), trust, 0.0)[..., None]
    shown = (trust * colors + (1.0 - trust) * NOTHING).astype(np.uint8)
    return {
        "picture": jpeg(shown, "Residual phase over the face, in rings.", 82),
        "bar": linear_bar("RdBu_r", -reach, reach, "rings"),
        "histogram": _histogram(scan, figures),
        "median": f"{figures['median']:.3f}",
        "most": f"{figures['most']:.3f}",
        "within": f"{100 * figures['within']:.1f} %",
    }


def _histogram(scan: Scan, figures: dict[str, float]) -> str:
    residual, trust = _samples(scan)
    from matplotlib.ticker import MaxNLocator

    reach = _reach(figures)
    counts, edges = np.histogram(residual, bins=50, range=(0.0, reach), weights=trust)
    counts = 100.0 * counts / trust.sum()

    def draw(axes: Axes) -> None:
        axes.stairs(counts, edges, fill=True, color=ACCENT, alpha=0.75)
        top = float(counts.max())
        for key, text, drop in (("median", "median", -2), ("most", "95 %", -18)):
            axes.axvline(figures[key], color=MUTED, linewidth=1.0, linestyle=(0, (3, 2)))
            axes.annotate(text, (figures[key], top), (4, drop), textcoords="offset points", va="top")
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.xaxis.set_major_formatter("{x:.3g}")
        axes.set(xlim=(0, reach), xlabel="residual, rings", ylabel="face, %")

    return svg("residual", "Histogram of the residual of the phase, in rings.", (400, 250), draw)
