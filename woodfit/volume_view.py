"""A block of wood seen as a translucent volume: emission from single scattering, absorption, one distant light.

What hides on the outside shows: rings as sheets running through the block, or a blur. The picture is composed slice by
slice, from front to back, each slice of voxels sheared to where a distant (orthographic) camera sees it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Image = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Medium:
    """The false-color medium of the paper's Fig. "overfit".

    Attributes
    ----------
    late, early : float
        Extinction where lateness is above `threshold`, and elsewhere; per tenth of the longer side of the block's face.
        The paper names no unit of length; so the early wood is translucent and a sheet of latewood is not.
    threshold : float
        Lateness that separates them.
    albedo : tuple of float
        Single-scattering albedo, RGB.
    """

    late: float = 15.0
    early: float = 0.5
    threshold: float = 0.9
    albedo: tuple[float, float, float] = (0.805, 0.578, 0.359)


@dataclass(frozen=True)
class View:
    """Where the block is seen and lit from.

    Attributes
    ----------
    yaw_deg, pitch_deg : float
        How far the camera stands to the right of and above the face's normal; below 80.
    light : tuple of float
        Direction in which the light travels: x right, y down, z into the wood; z positive.
    strength, ambient : float
        Of the distant light, and of light from everywhere.
    background : tuple of float
        Linear RGB behind the block.
    """

    yaw_deg: float = 33.0
    pitch_deg: float = 24.0
    light: tuple[float, float, float] = (0.35, 0.75, 0.55)
    strength: float = 1.4
    ambient: float = 0.4
    background: tuple[float, float, float] = (0.04, 0.04, 0.045)


def extinction(lateness: Array, medium: Medium) -> Image:
    """Extinction per voxel of a block's lateness (D, H, W), with slices in depth order and cubic voxels."""
    per_voxel = 10.0 / max(lateness.shape[1:])
    values = np.where(lateness > medium.threshold, medium.late * per_voxel, medium.early * per_voxel)
    return np.asarray(values, dtype=np.float32)


def cut_corner(volume: Array, share: float = 0.45) -> Array:
    """The volume (D, H, W) with nothing (0) in the corner at the front, above and to the right; a copy."""
    depth, height, width = volume.shape
    cut = volume.copy()
    cut[: round(share * depth), : round(share * height), width - round(share * width) :] = 0.0
    return cut


def light_reaching(sigma: Image, direction: tuple[float, float, float]) -> Image:
    """Share of a distant light that reaches the middle of each voxel.

    Parameters
    ----------
    sigma : array of shape (D, H, W)
        Extinction per voxel side.
    direction : x, y, z
        In which the light travels; z positive.

    Returns
    -------
    array of shape (D, H, W)
    """
    depth, height, width = sigma.shape
    x, y = direction[0] / direction[2], direction[1] / direction[2]
    step = np.float32(np.sqrt(x * x + y * y + 1.0))
    # A canvas that goes along with the light: layers are put on it where the light meets them, once each, so that
    # shadows stay sharp on their way.
    size = (width + int(np.ceil(abs(x) * depth)), height + int(np.ceil(abs(y) * depth)))
    corner = max(x, 0.0) * (depth - 1), max(y, 0.0) * (depth - 1)
    reaching = np.empty_like(sigma)
    passed = np.zeros(size[::-1], np.float32)
    for k, layer in enumerate(sigma):
        shift = np.array([[1.0, 0.0, corner[0] - k * x], [0.0, 1.0, corner[1] - k * y]])
        half = 0.5 * step * cv2.warpAffine(layer, shift, size, borderValue=0.0)
        back = cv2.WARP_INVERSE_MAP | cv2.INTER_LINEAR
        reaching[k] = np.exp(-cv2.warpAffine(passed + half, shift, (width, height), flags=back))
        passed += 2.0 * half
    return reaching


def draw_volume(sigma: Image, longer: int, medium: Medium, view: View) -> Image:
    """Picture of a block of scattering medium.

    Parameters
    ----------
    sigma : float32 array of shape (D, H, W)
        Extinction per voxel side; slices go into the wood, rows down, columns to the right.
    longer : int
        Longer side of the picture, px.
    medium : Medium
        Its albedo is used.
    view : View
        Camera and light.

    Returns
    -------
    float32 array of shape (P, Q, 3)
        Linear RGB.
    """
    depth, height, width = sigma.shape
    yaw, pitch = np.radians(view.yaw_deg), np.radians(view.pitch_deg)
    # Right and down of the picture in the block's axes; the third is where the camera looks.
    right = np.array([np.cos(yaw), 0.0, np.sin(yaw)])
    down = np.array([np.sin(pitch) * np.sin(yaw), np.cos(pitch), -np.sin(pitch) * np.cos(yaw)])
    ahead = np.cross(right, down)
    corners = np.array([[x, y, z] for x in (0, width) for y in (0, height) for z in (0, depth)], float) - 0.5
    flat = corners @ np.stack([right, down]).T
    low, span = flat.min(axis=0), np.ptp(flat, axis=0)
    scale = longer / float(span.max() * 1.08)
    rim = 0.04 * float(span.max())
    size = (round(float(span[0] + 2 * rim) * scale), round(float(span[1] + 2 * rim) * scale))
    axes = scale * np.stack([right, down])
    origin = scale * (rim - low) - 0.5
    step = np.float32(1.0 / ahead[2])

    lit = np.float32(view.strength) * light_reaching(sigma, view.light) + np.float32(view.ambient)
    through = np.ones((size[1], size[0]), np.float32)
    glow = np.zeros_like(through)
    for k in range(depth):
        place = np.column_stack([axes[:, :2], axes[:, 2] * k + origin])
        # Both are blended with nothing at the block's edges, so that these are smooth.
        layers = np.dstack([sigma[k], sigma[k] * lit[k]])
        seen = cv2.warpAffine(layers, place, size, flags=cv2.INTER_LINEAR, borderValue=(0.0, 0.0))
        thick = step * seen[..., 0]
        # (1 - exp(-t)) / t times the emission: exact within a slice.
        gain = np.where(thick > 1e-6, -np.expm1(-thick) / np.maximum(thick, 1e-6), 1.0)
        glow += through * gain * step * seen[..., 1]
        through *= np.exp(-thick)
    albedo, background = (np.asarray(color, np.float32) for color in (medium.albedo, view.background))
    return np.asarray(glow[..., None] * albedo + through[..., None] * background)
