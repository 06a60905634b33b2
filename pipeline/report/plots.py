"""matplotlib drawings as SVG inside a page, in the page's own colors and letters."""

from __future__ import annotations

import io
import re
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colors to draw with; the page's style replaces each, light or dark.
INK, MUTED, RULE, ACCENT, WOOD, COOL = "#010203", "#020304", "#030405", "#040506", "#050607", "#060708"

_STYLE = {
    INK: "currentColor",
    MUTED: "var(--muted)",
    RULE: "var(--rule)",
    ACCENT: "var(--accent)",
    WOOD: "var(--wood)",
    COOL: "var(--cool)",
}
_SETTINGS: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "woodpipe",
    "font.size": 10.0,
    "axes.edgecolor": RULE,
    "axes.labelcolor": MUTED,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.linewidth": 0.8,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "text.color": INK,
    "path.simplify": True,
    "mathtext.default": "regular",
}
# matplotlib's settings belong to the whole process.
_LOCK = threading.Lock()


def svg(
    name: str,
    alt: str,
    size_pt: tuple[float, float],
    draw: Callable[[Axes], None],
    place: tuple[float, float, float, float] | None = None,
) -> str:
    """Draw on one pair of axes.

    Parameters
    ----------
    name
        Unique on the page; keeps the drawings' internal references apart.
    alt
        What a person who cannot see it is told.
    size_pt
        Width and height, in points.
    draw
        Draws on the axes.
    place
        Left, bottom, width and height of the axes as shares of the drawing, so that several agree; what fits when
        ``None``.

    Returns
    -------
    str
        An ``<svg>`` element without ties to anything outside it.
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with _LOCK, matplotlib.rc_context(_SETTINGS):
        figure = Figure(figsize=(size_pt[0] / 72.0, size_pt[1] / 72.0), layout=None if place else "constrained")
        FigureCanvasSVG(figure)
        draw(figure.add_axes(place) if place else figure.add_subplot())
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    return _inline(buffer.getvalue(), name, alt)


def _inline(text: str, name: str, alt: str) -> str:
    """The ``<svg>`` element alone, with page colors, own ids, and no names of the outside world."""
    from html import escape

    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"\s*xmlns(:\w+)?=\"[^\"]*\"", "", text).replace("xlink:href", "href")
    used = set(re.findall(r"url\(#([^)]+)\)", text)) | set(re.findall(r'href="#([^"]+)"', text))
    text = re.sub(r' id="([^"]+)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", text)
    text = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', text)
    for mark, color in _STYLE.items():
        text = text.replace(mark, color)
    width = re.search(r'viewBox="0 0 ([\d.]+)', text)
    limit = f"max-width:{float(width[1]) * 4 / 3:.0f}px" if width else ""
    head = f'<svg class="plot" role="img" aria-label="{escape(alt)}" style="{limit}"'
    text = re.sub(r'^<svg width="[^"]*" height="[^"]*"', "<svg", text)
    text = re.sub(r'^<svg height="[^"]*" version="[^"]*"', "<svg", text)
    text = re.sub(r'^(<svg[^>]*?) width="[^"]*"', r"\1", text)
    text = re.sub(r'^(<svg[^>]*?) version="[^"]*"', r"\1", text)
    text = re.sub(r"\n\s*", "\n", text)
    return head + text[len("<svg") :]
