"""Pictures of the gallery that need no renderer: a scan's photograph, its rings, its front, its colors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.evaluation import TracedRings
from pipeline.report.palettes import ring_color
from pipeline.report.pictures import Bytes, fit, srgb_bytes

if TYPE_CHECKING:
    from woodfit import SolidTexture

Array = npt.NDArray[Any]

#: Lines are drawn in sixteenths of a px.
_SHIFT = 4

#: The front is evaluated at about so many points, then shrunk: fine grain would alias otherwise.
_MOST_POINTS = 2_000_000


@dataclass(frozen=True)
class Subject:
    """What is shown of one scan, or of a block by its first face.

    Attributes
    ----------
    name : str
        Of the product folder.
    photograph : uint8 array of shape (H, W, 3)
        sRGB, shrunk.
    scale : float
        px of `photograph` per px of the scan.
    rings : TracedRings
        Boundaries, px of the scan.
    texture : SolidTexture
        Its wood.
    """

    name: str
    photograph: Bytes
    scale: float
    rings: TracedRings
    texture: SolidTexture


Render = Callable[["SolidTexture", int], Bytes]


def read_photograph(path: Path, longer: int) -> tuple[Bytes, float]:
    """A scan, upright, its longer side at most `longer` px, as sRGB bytes; and px of it per px of the scan."""
    import tempfile

    from pipeline.reading import read_scan
    from pipeline.report.pictures import block_mean
    from stages.variables import ENCODED

    with tempfile.TemporaryDirectory() as scratch:
        encoded = read_scan(path, Path(scratch) / "scan")[ENCODED.name]
        step = max(1, max(encoded.sizes["y"], encoded.sizes["x"]) // longer)
        top = np.iinfo(encoded.dtype).max
        small = fit(block_mean(encoded, step), longer)
    picture = np.clip(small * (255.0 / top) + 0.5, 0, 255).astype(np.uint8)
    return picture, picture.shape[1] / encoded.sizes["x"]


def rings_panel(subject: Subject) -> Bytes:
    """The photograph, paler, with its ring boundaries; a color for each ring."""
    picture = np.ascontiguousarray((subject.photograph * 0.55 + 255 * 0.45).astype(np.uint8))
    width = max(1, round(max(picture.shape) / 350))
    for line, (_, index) in zip(subject.rings.polylines, subject.rings.identity, strict=True):
        hue = ring_color(index).removeprefix("#")
        # Darker than in the report, whose lines lie on the photograph itself.
        color = [int(0.62 * int(hue[i : i + 2], 16)) for i in (0, 2, 4)]
        places = ((line + 0.5) * subject.scale - 0.5) * (1 << _SHIFT)
        cv2.polylines(picture, [places.round().astype(np.int32)], False, color, width, cv2.LINE_AA, _SHIFT)
    return picture


def front_panel(subject: Subject) -> Bytes:
    """The photographed face (a block's first one) as the texture gives it back."""
    texture, (height, width) = subject.texture, subject.photograph.shape[:2]
    corner, right, down = texture.seen.plane[0]
    across, along = texture.seen.size[0]
    finer = max(1, round(min(across / width, np.sqrt(_MOST_POINTS / (height * width)))))
    u = (np.arange(finer * width) + 0.5) / (finer * width) * across
    v = (np.arange(finer * height) + 0.5) / (finer * height) * along
    points = corner + u[None, :, None] * right + v[:, None, None] * down
    rgb = texture.evaluate(points * (texture.pixel_size or 1.0)).rgb
    return srgb_bytes(cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA))


def colors_panel(subject: Subject, size: tuple[int, int]) -> Bytes:
    """Colors of the rings that the face shows: a row each from the youngest down, earlywood left; (H, W, 3)."""
    texture, (width, height) = subject.texture, size
    first, last = (int(np.floor(age)) for age in texture.seen.ages)
    ages = np.arange(last, first - 1, -1)[:, None] + (np.arange(width) + 0.5) / width
    table = np.clip(texture.color_at(ages.ravel())[0], 0.0, None).reshape(len(ages), width, 3)
    return np.asarray(cv2.resize(srgb_bytes(table), (width, height), interpolation=cv2.INTER_NEAREST))
