"""Numbers of woodpipe: arrays in, arrays out. Knows nothing of files formats, labels, workers or configuration."""

from woodfit.solid_texture import SolidTexture, WoodSample

__all__ = ["SolidTexture", "WoodSample"]
