"""The page of a texture: template, program, and the texture's tables, in one file."""

from __future__ import annotations

import base64
import gzip
import html
import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.shaders.packing import ROW, pack
from woodfit.appearance import SATIN
from woodfit.block_extent import block_extent

if TYPE_CHECKING:
    from woodfit import SolidTexture


def viewer_page(texture: SolidTexture, name: str, years: Mapping[int, int] | None = None) -> str:
    """The HTML of a texture's page.

    Parameters
    ----------
    texture : SolidTexture
        The wood.
    name : str
        What it is called.
    years : mapping of int to int, optional
        Calendar year of rings, by ring index.
    """
    from pipeline.context import woodpipe_version

    packed, extent = pack(texture), block_extent(texture)
    finish = (
        f"#define WP_ROUGH_EARLY {SATIN.roughness_early}\n#define WP_ROUGH_LATE {SATIN.roughness_late}\n"
    )
    data = {
        "row": ROW,
        "tables": base64.b64encode(gzip.compress(packed.tables.tobytes(), 9, mtime=0)).decode("ascii"),
        "source": finish + packed.source,
        "low": extent.low.tolist(),
        "high": extent.high.tolist(),
        "years": {str(ring): year for ring, year in (years or {}).items()},
    }
    sides = " \u00d7 ".join(f"{side:.3g}" for side in extent.size)
    fields = {
        "name": html.escape(name),
        "size": f"{sides} {html.escape(texture.unit)}; {len(texture.ring_radius) - 1} rings",
        "version": html.escape(woodpipe_version()),
        # A closing tag inside of a script would end it.
        "data": json.dumps(data).replace("<", "\\u003c"),
        "program": _file("viewer.bundle.js").replace("</script", "<\\/script"),
    }
    page = _file("template.html")
    for key, value in fields.items():
        page = page.replace("{{ " + key + " }}", value)
    return page


def write_viewer(texture: SolidTexture, path: Path, name: str, years: Mapping[int, int] | None = None) -> Path:
    """Write the page of a texture."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(viewer_page(texture, name, years), encoding="utf-8")
    return path


def _file(name: str) -> str:
    return (resources.files("pipeline.viewer") / name).read_text(encoding="utf-8")
