"""The block seen as a solid: the texture on three faces and on those that a missing corner opens."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.special import erf

from pipeline.report.box import Box, Camera, Seen, camera_for, look
from pipeline.report.pictures import Bytes, jpeg, srgb_bytes
from pipeline.report.reading import Frame, Scan

Array = npt.NDArray[Any]

_LONGER_PX = 1000
_MOST_POINTS = 700_000
_DEPTH_SHARE = 0.4

#: Light on side, top and front.
_LIGHT = np.array([0.54, 1.0, 0.86])
_BACKDROP_TOP, _BACKDROP_BOTTOM = np.array([0.47, 0.45, 0.42]), np.array([0.66, 0.64, 0.60])


def solid_section(scan: Scan) -> dict[str, Any] | None:
    """Picture of the block; ``None`` before the color map."""
    frame = scan.frame
    from stages.products import TEXTURE, solid_texture_of

    if frame is None or not scan.has(*TEXTURE.requires):
        return None

    box = box_of(scan, frame)
    picture = draw_block(solid_texture_of(scan.ds), box, _LONGER_PX)
    size = box.high - box.low
    unit, factor = ("px", 1.0) if scan.pixel_size is None else (scan.unit, scan.pixel_size)
    text = " \u00d7 ".join(f"{side * factor:.3g}" for side in size)
    return {
        "picture": jpeg(
            picture,
            "A block of wood cut from the solid texture, seen from the front, right and above; its corner is cut away "
            "and shows the inside.",
            88,
            fine_color=True,
        ),
        "size": f"{text} {unit}",
        "seen": "The front is the photographed face; all else was never seen."
        if scan.block is None
        else "What the cut corner opens was never seen.",
    }


def box_of(scan: Scan, frame: Frame) -> Box:
    """What is drawn: the block that the faces enclose, or a photographed face with some depth."""
    if scan.block is None:
        return block_of(frame)
    low, high = scan.block.box
    return Box(low, high, 0.45 * (high - low))


def block_of(frame: Frame) -> Box:
    """The photographed face with some depth, a corner cut away."""
    shorter = min(frame.width, frame.height)
    low = np.array([frame.left, frame.top, 0.0])
    high = low + np.array([frame.width, frame.height, _DEPTH_SHARE * shorter])
    cut = np.array([0.46, 0.42, 0.55 * _DEPTH_SHARE]) * shorter
    cut[:2] = np.maximum(cut[:2], 0.2 * (high - low)[:2])
    return Box(low, high, cut)


def draw_block(texture: Any, box: Box, longer: int) -> Bytes:
    """Draw the block.

    Parameters
    ----------
    texture
        With ``evaluate(points)`` and ``pixel_size`` (mm or None), as ``woodfit.SolidTexture``.
    box
        The block, board frame, px.
    longer
        Longer side of the picture, px.

    Returns
    -------
    uint8 array of shape (H, W, 3)
        sRGB.
    """
    long_strip = float((box.high - box.low)[0]) > 2.5 * float((box.high - box.low)[1])
    camera = camera_for(box, longer, 20.0 if long_strip else 33.0)
    covered = float(look(box, camera.scaled(0.2)).hit.sum()) * 25.0
    finer = float(np.clip(np.sqrt(_MOST_POINTS / max(covered, 1.0)), 1.0, 2.0))
    fine = camera.scaled(finer)
    seen = look(box, fine)
    picture = _backdrop(box, fine)
    scale = 1.0 if texture.pixel_size is None else texture.pixel_size
    color = np.asarray(texture.evaluate(seen.points * scale).rgb, dtype=np.float32)
    picture[seen.hit] = np.nan_to_num(color) * _light(box, seen)[:, None]
    return srgb_bytes(cv2.resize(picture, camera.size, interpolation=cv2.INTER_AREA))


def _light(box: Box, seen: Seen) -> Array:
    """Light on each visible point: by face, less in the corners that the cut makes, more along sharp edges."""
    light = _LIGHT[seen.axis].astype(np.float32)
    notch_low, notch_high = box.notch
    # The cut's three faces meet at this corner; each point lies on one of them.
    corner = np.array([notch_low[0], notch_high[1], notch_high[2]])
    away = np.abs(seen.points - corner)
    away[np.arange(len(away)), seen.axis] = np.inf
    reach = 0.35 * float(box.cut.min())
    shade = np.prod(1.0 - 0.22 * np.exp(-away / reach), axis=1)
    light *= np.where(seen.inside, 0.94 * shade, 1.0)
    # The bottom of the block sees less of the sky.
    low = (seen.points[:, 1] - box.low[1]) / (box.high[1] - box.low[1])
    light *= np.where(seen.axis == 1, 1.0, 1.04 - 0.12 * low)
    return np.asarray(light)


def _backdrop(box: Box, camera: Camera) -> Array:
    """A plain studio: a soft gradient and the block's shadow on the ground; linear rgb (H, W, 3)."""
    width, height = camera.size
    share = np.linspace(0.0, 1.0, height, dtype=np.float32)[:, None, None]
    picture = np.repeat((_BACKDROP_TOP + share * (_BACKDROP_BOTTOM - _BACKDROP_TOP)).astype(np.float32), width, axis=1)
    rays = camera.rays()
    down = rays[..., 1]
    ground = down > 1e-6
    distance = (box.high[1] - camera.eye[1]) / np.where(ground, down, 1.0)
    x = camera.eye[0] + distance * rays[..., 0]
    z = camera.eye[2] + distance * rays[..., 2]
    shorter = float(np.min(box.high - box.low))
    shadow = np.zeros_like(x)
    for blur, drift, depth in ((0.10, 0.10, 0.45), (0.45, 0.35, 0.30)):
        soft = blur * shorter
        part = _step((x - box.low[0] - drift * shorter) / soft) * _step((box.high[0] + drift * shorter - x) / soft)
        part *= _step((z - box.low[2]) / soft) * _step((box.high[2] + drift * shorter - z) / soft)
        shadow += depth * part
    return np.asarray(picture * (1.0 - np.where(ground, shadow, 0.0))[..., None], dtype=np.float32)


def _step(distance: Array) -> Array:
    return np.asarray(0.5 * (1.0 + erf(distance)))
