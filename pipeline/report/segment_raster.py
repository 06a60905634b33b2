"""Segment correlations of many series as a picture: one line per series, one box per segment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from woodfit.dendro.crossdating import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.crossdating import Crossdating, Segment

_COLORS = "RdYlBu"
_INK, _MUTED, _FINDING = "#26221d", "#675f55", "#111111"
_LINE_PT, _FEWEST_LINES = 20.0, 4


def write_segment_raster(result: Crossdating, path: Path) -> None:
    """Draw the segments of all series, colored by correlation, with the flags A and B and the rings in doubt.

    Parameters
    ----------
    result
        With segments.
    path
        Written as PNG, SVG or PDF, by its suffix.

    Raises
    ------
    ValueError
        When there are no segments to draw.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not any(result.segments.values()):
        raise ValueError("there are no segment correlations to draw")
    rows = sorted(result.comparisons, key=lambda one: (one.first_year, one.name))
    height = _LINE_PT * max(len(rows), _FEWEST_LINES) + 84.0
    figure = Figure(figsize=(900.0 / 72.0, height / 72.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for line, one in enumerate(rows):
        _draw_series(axes, line, one, result.segments[one.name])
    dated = result.calendar.dated
    axes.set_yticks(range(len(rows)), [one.name for one in rows], fontsize=8)
    axes.set(ylim=(len(rows) - 0.3, -0.7), xlabel="year" if dated else "ring from the bark")
    if not dated:
        axes.xaxis.set_major_formatter(lambda value, _: f"{-value:.0f}")
    axes.grid(axis="x", color="#ddd6ca", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.set_title(_title(result), fontsize=9, color=_MUTED, loc="left")
    bar = figure.colorbar(_scale(), ax=axes, fraction=0.025, pad=0.01, aspect=30)
    bar.set_label("segment correlation")
    figure.savefig(path, dpi=110)


def _draw_series(axes: Axes, line: int, one: Comparison, segments: list[Segment]) -> None:
    axes.plot([one.first_year, one.last_year], [line, line], color=_MUTED, linewidth=0.6, zorder=1)
    scale, lanes = _scale(), _lanes(segments)
    height = 0.8 / max(2, max(lanes, default=0) + 1)
    for lane, segment in zip(lanes, segments, strict=True):
        y = line - 0.4 + lane * height
        span = [(segment.first_year, segment.last_year - segment.first_year + 1)]
        edge, width = (_INK, 1.1) if segment.flag else ("white", 0.5)
        color = scale.to_rgba(segment.r)
        axes.broken_barh(span, (y, 0.94 * height), facecolor=color, edgecolor=edge, linewidth=width, zorder=2)
        if segment.flag:
            middle = 0.5 * (segment.first_year + segment.last_year)
            size = 7.0 if height > 0.3 else 5.5
            axes.text(middle, y + 0.5 * height, segment.flag, fontsize=size, ha="center", va="center", color=_INK)
    for finding in one.findings:
        marker = "v" if finding.kind == "missing" else "^"
        axes.plot(finding.year, line, marker, color=_FINDING, markersize=6, markeredgecolor="white", zorder=4)


def _lanes(segments: list[Segment]) -> list[int]:
    """Lane of each segment, so that none covers another: two for segments that overlap by half."""
    ends: list[int] = []
    lanes = []
    for segment in segments:
        lane = next((lane for lane, end in enumerate(ends) if end < segment.first_year), len(ends))
        if lane == len(ends):
            ends.append(segment.last_year)
        ends[lane] = segment.last_year
        lanes.append(lane)
    return lanes


def _title(result: Crossdating) -> str:
    words = f"50-year segments against {result.against}; A below the critical correlation, B higher at another lag"
    if any(one.findings for one in result.comparisons):
        words += "; \u25bc ring likely missing, \u25b2 false"
    return words


def _scale() -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(-0.2, 1.0), _COLORS)
