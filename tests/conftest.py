"""What several test files share: small scans, dummy stages, a project folder."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# On a machine that others use, time says nothing about right and wrong.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

sys.path.insert(0, str(Path(__file__).parent))


def draw_scan(path: Path, height: int = 64, width: int = 80, seed: int = 0, dtype: str = "uint8") -> Path:
    """Write a scan of random colors."""
    import OpenImageIO as oiio  # noqa: N813

    top = np.iinfo(dtype).max
    pixels = np.random.default_rng(seed).integers(0, top, (height, width, 3), endpoint=True).astype(dtype)
    return write_image(path, pixels, oiio)


def write_image(path: Path, pixels: np.ndarray, oiio: object = None, **attributes: object) -> Path:
    """Write an array as an image file, with attributes of OpenImageIO."""
    import OpenImageIO as oiio  # noqa: N813

    pixels = pixels if pixels.ndim == 3 else pixels[..., None]
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], pixels.dtype.name)
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    assert out.write_image(pixels), out.geterror()
    out.close()
    return path


@pytest.fixture
def project(tmp_path: Path) -> Callable[..., Path]:
    """Make a folder with scans and a config for the dummy stages; returns the config's path."""

    def make(scans: int = 2, more: str = "", size: tuple[int, int] = (64, 80)) -> Path:
        folder = tmp_path / "scans"
        folder.mkdir(exist_ok=True)
        for index in range(scans):
            draw_scan(folder / f"board_{index}.png", *size, seed=index)
        config = tmp_path / "pipeline.yaml"
        config.write_text(f"scans: scans\noutput: out\n{more}")
        return config

    return make
