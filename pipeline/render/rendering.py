"""From a preset's name to a picture: variant, scenes, denoising, composition."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.problems import Problem, UsageError, did_you_mean
from pipeline.render import presets, translucent
from pipeline.render.presets import Job, Maker
from pipeline.render.variant import Variant, choose_variant, start
from pipeline.report.pictures import Bytes, srgb_bytes

if TYPE_CHECKING:
    from woodfit import SolidTexture

Array = npt.NDArray[Any]

#: A texture without a scale is rendered as if its rings had this mean width, mm, where a size matters.
ASSUMED_RING_MM = 2.0


@dataclass(frozen=True)
class Preset:
    """A kind of picture.

    Attributes
    ----------
    make
        Its scenes, from left to right.
    help
        What it shows.
    spp, preview_spp
        Samples per px by default, and in a preview.
    translucent
        Whether light goes through wood of a given thickness: then the size of the wood matters, and the picture is
        drawn at half its resolution, for so few paths get through that samples count more than pixels.
    """

    make: Maker
    help: str
    spp: int
    preview_spp: int
    translucent: bool = False


PRESETS = {
    "front": Preset(presets.front, "the photographed face, evenly lit", 16, 4),
    "block": Preset(presets.block, "the board as a solid, a corner cut away", 64, 4),
    "carved": Preset(presets.carved, "a mesh cut from the wood, relief and gloss following latewood", 64, 4),
    "veneer": Preset(translucent.veneer, "backlit veneer: extruded from the face, and fitted", 16, 8, True),
    "lampshade": Preset(translucent.lampshade, "a turned shade with a bulb inside", 48, 8, True),
    "false-color": Preset(presets.false_color, "a translucent block in which latewood alone is dense", 16, 4),
}


@cache
def _variant(wish: str) -> Variant:
    return choose_variant(wish)


def render_preset(
    name: str,
    texture: SolidTexture,
    size: tuple[int, int] = (512, 512),
    spp: int | None = None,
    mesh: str = "sample:bowl",
    detail: bool = True,
    pixel_size_mm: float | None = None,
    variant: str = "auto",
    denoise: bool = True,
    preview: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> Bytes:
    """Render a preset.

    Parameters
    ----------
    name : str
        One of `PRESETS`.
    texture : SolidTexture
        The wood.
    size : tuple of int
        Width and height of each picture, px.
    spp : int, optional
        Samples per px; else the preset's own.
    mesh : str
        What is carved.
    detail : bool
        With fine grain, on surfaces.
    pixel_size_mm : float, optional
        mm per px for a texture without a scale, or instead of its own.
    variant : str
        ``auto``, ``llvm`` or ``scalar``.
    denoise : bool
        Whether to denoise where the library is there.
    preview : bool
        Fewer samples.
    tell : callable
        Is given lines for people.

    Returns
    -------
    uint8 array of shape (H, W, 3)
        sRGB, with a fixed exposure.

    Raises
    ------
    UsageError
        When there is no such preset, or Mitsuba is not installed.
    """
    if name not in PRESETS:
        problem = Problem("PRESET", f"there is no preset {name!r}{did_you_mean(name, PRESETS)}")
        raise UsageError("The command cannot be followed", [problem])
    preset = PRESETS[name]
    if name == "front" and not len(texture.seen.plane):
        raise UsageError("The command cannot be followed", [Problem("front", "the texture does not say what was seen")])
    chosen = _variant(variant)
    tell(f"Mitsuba: {chosen.said}")
    mi = start(chosen)
    samples = spp or (preset.preview_spp if preview else preset.spp)
    # A preview has half the resolution too; it is shown at the size that was asked for.
    coarser = (2 if preview else 1) * (2 if preset.translucent else 1)
    drawn = (max(16, size[0] // coarser), max(16, size[1] // coarser))
    job = Job(texture, drawn, samples, mesh, detail, _mm_per_unit(texture, pixel_size_mm, preset.translucent, tell))
    with tempfile.TemporaryDirectory(prefix="woodpipe-") as folder:
        scenes = preset.make(mi, chosen, job, Path(folder))
        pictures = [_rendered(mi, scene, denoise, tell) for scene in scenes]
    encoded = [_fitted(srgb_bytes(picture), size) for picture in pictures]
    if name == "veneer":
        return _with_edges(encoded, texture, job.mm_per_unit)
    return np.concatenate(encoded, axis=1)


def _rendered(mi: Any, scene: dict[str, Any], denoise: bool, tell: Callable[[str], None]) -> npt.NDArray[np.float32]:
    """Linear picture (H, W, 3)."""
    loaded = mi.load_dict(scene)
    picture = np.array(mi.render(loaded), np.float32)[..., :3]
    if not denoise:
        return picture
    try:
        import mitsuba_oidn
    except ImportError as error:
        tell(f"not denoised: {error}; pip install 'woodpipe[render]'")
        return picture
    return np.asarray(mitsuba_oidn.denoise(np.ascontiguousarray(picture), hdr=True), np.float32)


def _mm_per_unit(
    texture: SolidTexture, pixel_size_mm: float | None, matters: bool, tell: Callable[[str], None]
) -> float:
    if pixel_size_mm is not None:
        return pixel_size_mm / (texture.pixel_size or 1.0)
    if texture.unit == "mm":
        return 1.0
    assumed = ASSUMED_RING_MM / texture.ring_width
    if matters:
        tell(
            f"the texture is in {texture.unit}, not mm: taken as {assumed:.3g} mm per {texture.unit}, "
            f"so that rings are {ASSUMED_RING_MM:g} mm wide; --pixel-size says otherwise"
        )
    return assumed


def _fitted(picture: Bytes, size: tuple[int, int]) -> Bytes:
    import cv2

    same = picture.shape[1::-1] == size
    return picture if same else np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC))


def _with_edges(pictures: list[Bytes], texture: SolidTexture, mm_per_unit: float) -> Bytes:
    """Two sheets side by side, each over its lower edge seen from below, four times as thick as it is."""
    import cv2

    height, width = pictures[0].shape[:2]
    columns = []
    for picture, edge, name in zip(
        pictures, translucent.side_views(texture, mm_per_unit, width), ("extruded", "fitted"), strict=True
    ):
        sheet = np.full((height + 28 + len(edge) + 34, width + 16, 3), 18, np.uint8)
        sheet[:height, 8 : 8 + width] = picture
        sheet[height + 28 : height + 28 + len(edge), 8 : 8 + width] = srgb_bytes(edge)
        text = f"{name}: its lower edge, 4 x as thick"
        cv2.putText(sheet, text, (10, height + 20), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (200, 200, 200), 1, cv2.LINE_AA)
        columns.append(sheet)
    return np.concatenate(columns, axis=1)
