"""The wood as a page to hold in the hand: one HTML file, its texture evaluated in the shader."""

from __future__ import annotations

from pipeline.viewer.page import viewer_page, write_viewer

__all__ = ["viewer_page", "write_viewer"]
