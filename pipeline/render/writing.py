"""``woodpipe render``: a preset into a PNG."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.problems import Problem, UsageError

if TYPE_CHECKING:
    from woodfit import SolidTexture


def render_file(
    preset: str, texture: SolidTexture, out: Path, options: Mapping[str, Any], tell: Callable[[str], None]
) -> Path:
    """Render a preset into a file; `options` as of `pipeline.render.render_preset`."""
    import cv2

    from pipeline.render import render_preset

    if out.suffix.lower() != ".png":
        problem = Problem("--out", f"found {out.name!r}, expected a name that ends in .png")
        raise UsageError("The command cannot be followed", [problem])
    picture = render_preset(preset, texture, tell=tell, **options)
    done, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    if not done:
        raise OSError(f"{out} cannot be encoded")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(data.tobytes())
    return out
