"""Light, ground and camera: one quiet studio for all presets, with a fixed exposure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Shot:
    """Where the camera stands.

    Attributes
    ----------
    yaw_deg, pitch_deg : float
        To the right of and above the line from the face.
    field_deg : float
        Field of view across the shorter side.
    room : float
        Share of the picture's sides that the subject fills.
    """

    yaw_deg: float = 33.0
    pitch_deg: float = 24.0
    field_deg: float = 26.0
    room: float = 0.86


def sensor(mi: Any, points: Array, shot: Shot, size: tuple[int, int], spp: int) -> dict[str, Any]:
    """A camera that sees points (K, 3) of the scene whole, in a picture of width x height px."""
    yaw, pitch = np.radians(shot.yaw_deg), np.radians(shot.pitch_deg)
    away = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
    up = np.cross(away, right)
    target = 0.5 * (points.min(axis=0) + points.max(axis=0))
    width, height = size
    tangent = np.tan(0.5 * np.radians(shot.field_deg)) * shot.room
    limits = tangent * np.array([width, height]) / min(width, height)
    for _ in range(4):
        # The distance at which the point that sticks out furthest just fits; then centred, and again.
        offset = points - target
        sides, ahead = np.stack([offset @ right, offset @ up], -1), offset @ away
        distance = float((np.abs(sides) / limits + ahead[:, None]).max())
        seen = sides / (distance - ahead)[:, None]
        middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * distance
        target = target + middle[0] * right + middle[1] * up
    look = mi.ScalarTransform4f().look_at(
        origin=(target + distance * away).tolist(), target=target.tolist(), up=[0.0, 1.0, 0.0]
    )
    return {
        "type": "perspective",
        "to_world": look,
        "fov": shot.field_deg,
        "fov_axis": "smaller",
        "film": film(width, height),
        "sampler": {"type": "independent", "sample_count": spp},
    }


def film(width: int, height: int) -> dict[str, Any]:
    """A film whose pixels do not share samples, as the denoiser needs them."""
    return {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
        "component_format": "float32",
    }


def lights(mi: Any, reach: float = 2.0) -> dict[str, Any]:
    """A large soft key light at the left, a fill at the right, a paler sky; about a subject of `reach` units."""

    def softbox(place: tuple[float, float, float], side: float, strength: tuple[float, float, float]) -> dict[str, Any]:
        look = mi.ScalarTransform4f().look_at(
            origin=[reach * part for part in place], target=[0.0, 0.0, 0.0], up=[0.1, 1.0, 0.0]
        )
        return {
            "type": "rectangle",
            "to_world": look.scale([0.5 * side * reach, 0.5 * side * reach, 1.0]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(strength)}},
        }

    return {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.62, 0.63, 0.66]}},
        "key": softbox((-1.3, 2.1, 1.9), 1.5, (6.6, 6.3, 5.9)),
        "rim": softbox((2.4, 1.2, -0.6), 0.9, (3.6, 3.8, 4.1)),
    }


def ground(mi: Any, level: float, tone: float = 0.42) -> dict[str, Any]:
    """A wide grey floor."""
    turn = mi.ScalarTransform4f().translate([0.0, level, 0.0]).rotate([1.0, 0.0, 0.0], -90.0).scale([400.0, 400.0, 1.0])
    return {
        "type": "rectangle",
        "to_world": turn,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [tone, 0.985 * tone, 0.96 * tone]}},
    }
