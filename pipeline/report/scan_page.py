"""The page of one scan, put together."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

import numpy as np
import xarray as xr

from pipeline.context import ProductContext
from pipeline.report.anomalies import anomaly_section
from pipeline.report.compare import compare_section
from pipeline.report.dendro import dendro_section
from pipeline.report.fitting import fit_section
from pipeline.report.maps import map_figures
from pipeline.report.reading import Scan
from pipeline.report.rings import ring_section, thumbnail
from pipeline.report.series_plots import DrawnSeries
from pipeline.report.series_reading import drawn_series
from pipeline.report.sheet import block_view
from pipeline.report.solid import solid_section
from pipeline.report.strip import strip_section
from pipeline.report.tables import number_text, seconds_text, stage_rows
from pipeline.report.templating import render
from pipeline.report.trunk import pose_section
from stages.products import SERIES, series_document_of
from stages.variables import COLOR_STRIP, FREQUENCY, RING_SCALE, RING_X


def render_scan(ds: xr.Dataset, context: ProductContext) -> str:
    """HTML of a scan's page.

    Parameters
    ----------
    ds
        Merged results of the stages, lazily opened.
    context
        The scan's story.

    Returns
    -------
    str
        A page that needs nothing beside it.
    """
    scan = Scan(*block_view(ds))
    name = context.scan.name
    sections: dict[str, Any] = {
        "rings": ring_section(scan, name, context.faces),
        "series": dendro_section(scan, _series(scan, context)),
        "anomalies": anomaly_section(scan),
        "maps": map_figures(scan),
        "compare": compare_section(scan),
        "solid": solid_section(scan),
        "strip": strip_section(scan),
        "fit": fit_section(scan),
        "pose": pose_section(scan, context.faces),
        "stages": stage_rows(context),
    }
    return render(
        "scan.html.j2",
        name=name,
        context=context,
        thumbnail=thumbnail(scan, name),
        facts=_facts(scan, context, sections),
        total=seconds_text(sum(context.seconds.values())),
        has_rings=scan.has(RING_X) and scan.block is None,
        faces=[{"name": face, "link": quote(face)} for face in context.faces],
        has_series=sections["series"] is not None,
        has_texture=sections["solid"] is not None,
        last_stage=list(context.keys)[-1] if context.keys else "",
        complete=scan.has(COLOR_STRIP),
        **sections,
    )


def _series(scan: Scan, context: ProductContext) -> list[DrawnSeries]:
    """Measured series, none before they were measured, and none of a block: they are those of its faces."""
    if scan.block is not None or not scan.has(*SERIES.requires):
        return []
    return drawn_series(series_document_of(scan.ds, context))


def _facts(scan: Scan, context: ProductContext, sections: dict[str, Any]) -> list[dict[str, str]]:
    """The few numbers to know first."""
    facts = []
    rings, compare, fit = sections["rings"], sections["compare"], sections["fit"]
    if rings is not None and rings["traced"]:
        note = f"{rings['unsure']} unsure" if rings["unsure"] else "none unsure"
        facts.append(_fact("Ring boundaries", number_text(rings["count"]), note if rings["count"] else "none found"))
    width = _ring_width(scan)
    if width is not None:
        size = scan.pixel_size
        px = f"{width:.1f} px"
        facts.append(
            _fact(
                "Ring width",
                px if size is None else f"{width * size:.3g} {scan.unit}",
                "scale unknown" if size is None else px,
            )
        )
    if sections["pose"] is not None:
        facts.append(_fact("Cut", sections["pose"]["cut"], ""))
    if compare is not None and compare["psnr"] is not None:
        facts.append(_fact("Re-rendering", compare["psnr"], f"PSNR, {compare['sigma']} px blur"))
    if fit is not None and fit["residual"] is not None:
        facts.append(_fact("Residual", f"{fit['residual']['median']} ring", f"95 % below {fit['residual']['most']}"))
    frame = scan.frame
    if scan.block is not None:
        low, high = scan.block.box
        size = scan.pixel_size or 1.0
        extent = " \u00d7 ".join(f"{side * size:.3g}" for side in high - low)
        facts.append(_fact("Faces", str(len(scan.block.sizes)), f"{extent} {scan.unit if scan.pixel_size else 'px'}"))
    elif frame is not None:
        note = "scale unknown" if scan.pixel_size is None else f"{25.4 / scan.pixel_size:.0f} dpi"
        facts.append(
            _fact(
                "Scan",
                f"{frame.width:.0f} × {frame.height:.0f}",
                f"px, {note}" if scan.pixel_size is None else f"px at {note}",
            )
        )
    if context.seconds:
        facts.append(_fact("Time", seconds_text(sum(context.seconds.values())), f"{len(context.seconds)} stages"))
    return facts


def _fact(name: str, value: str, note: str) -> dict[str, str]:
    return {"name": name, "value": value, "note": note}


def _ring_width(scan: Scan) -> float | None:
    """Median ring width in px, from the frequency, else from the scale found at first."""
    if scan.has(FREQUENCY):
        frequency = scan.image(FREQUENCY)
        known = frequency[np.isfinite(frequency) & (frequency > 0) & scan.wood(frequency.shape)]
        if known.size:
            return float(1.0 / np.median(known))
    if scan.has(RING_SCALE):
        scale = float(scan.values(RING_SCALE))
        return scale if np.isfinite(scale) else None
    return None
