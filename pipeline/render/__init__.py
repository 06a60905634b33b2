"""Pictures of a solid texture by Mitsuba 3: the presets of ``woodpipe render``."""

from __future__ import annotations

from pipeline.render.rendering import PRESETS, render_preset

__all__ = ["PRESETS", "render_preset"]
