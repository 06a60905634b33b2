"""Phase, coherence and ring width as maps over the photograph, each with its color bar."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pipeline.report.axes import Bar, linear_bar, log_bar, phase_bar
from pipeline.report.palettes import NOTHING, mapped, phase_colors
from pipeline.report.pictures import jpeg
from pipeline.report.reading import Scan
from stages.variables import COHERENCE, FREQUENCY, MAGNITUDE, PHASE, PHASE_CONFIDENCE, RING_PHASE

Array = npt.NDArray[Any]


def map_figures(scan: Scan) -> list[dict[str, Any]]:
    """Figures of the maps that were computed."""
    made = (_phase(scan), _ring_width(scan), _coherence(scan))
    return [figure for figure in made if figure is not None]


def _figure(title: str, picture: Any, bar: Bar, caption: str) -> dict[str, Any]:
    return {"title": title, "picture": picture, "bar": bar, "caption": caption}


def _phase(scan: Scan) -> dict[str, Any] | None:
    if scan.has(RING_PHASE):
        traced, variables = True, (RING_PHASE, *((PHASE_CONFIDENCE,) if scan.has(PHASE_CONFIDENCE) else ()))
    elif scan.has(PHASE):
        traced, variables = False, (PHASE, *((MAGNITUDE,) if scan.has(MAGNITUDE) else ()))
    else:
        return None
    wave = scan.combined(variables, _wave)
    trust = np.abs(wave)
    if not traced:
        trust = trust / max(float(np.percentile(trust, 95)), 1e-9)
    trust = np.where(scan.wood(wave.shape), trust, 0.0)
    where = "0 at each ring boundary, growing outwards" if traced else "growing along the rings' bright side"
    picture = jpeg(
        phase_colors(np.angle(wave), trust), "Phase of the rings as hue, dark where it is unsure.", 84, fine_color=True
    )
    return _figure(
        "Phase", picture, phase_bar(), f"Hue is the phase within the ring, {where}; dark where it is unsure."
    )


def _wave(phase_rad: Array, size: Array | None = None) -> Array:
    weight = np.ones_like(phase_rad) if size is None else np.nan_to_num(size)
    return np.asarray(weight * np.exp(1j * np.nan_to_num(phase_rad)), dtype=np.complex64)


def _ring_width(scan: Scan) -> dict[str, Any] | None:
    if not scan.has(FREQUENCY):
        return None
    frequency = scan.image(FREQUENCY)
    wood = scan.wood(frequency.shape) & np.isfinite(frequency) & (frequency > 0)
    unit, factor = ("px", 1.0) if scan.pixel_size is None else (scan.unit, scan.pixel_size)
    width = np.where(wood, factor / np.where(wood, frequency, 1.0), np.nan)
    known = width[wood]
    low, high = np.percentile(known, [1.0, 99.0]) if known.size else (1.0, 2.0)
    low, high = float(low), float(max(high, 1.25 * low))
    share = np.log(width / low) / np.log(high / low)
    middle = f" Median {np.median(known):.3g} {unit}." if known.size else ""
    picture = jpeg(mapped(share, "viridis"), f"Local ring width, {low:.3g} to {high:.3g} {unit}.", 84)
    return _figure(
        "Ring width",
        picture,
        log_bar("viridis", low, high, unit),
        f"One over the local frequency: how far it is from one boundary to the next.{middle}",
    )


def _coherence(scan: Scan) -> dict[str, Any] | None:
    if not scan.has(COHERENCE):
        return None
    coherence = scan.image(COHERENCE)
    wood = scan.wood(coherence.shape)
    colors = np.where(wood[..., None], mapped(coherence, "cividis"), NOTHING)
    known = coherence[wood & np.isfinite(coherence)]
    middle = f" Median {np.median(known):.2f}." if known.size else ""
    picture = jpeg(colors, "Coherence of the local direction, 0 to 1.", 82)
    return _figure(
        "Coherence",
        picture,
        linear_bar("cividis", 0.0, 1.0, ""),
        f"1 where the wood has one clear direction, 0 where it has none.{middle}",
    )
