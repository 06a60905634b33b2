"""Seeing a box with a corner cut away: which point of it each pixel of a picture shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Box:
    """A block of wood in the board frame (px), with its corner at (right, top, face) cut away.

    Parameters
    ----------
    low, high
        Opposite corners, shape (3,).
    cut
        Extent of the missing corner along x, y and z, shape (3,).
    """

    low: Array
    high: Array
    cut: Array

    @property
    def notch(self) -> tuple[Array, Array]:
        """Opposite corners of the missing piece."""
        low = np.array([self.high[0] - self.cut[0], self.low[1], self.low[2]])
        high = np.array([self.high[0], self.low[1] + self.cut[1], self.low[2] + self.cut[2]])
        return low, high


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Parameters
    ----------
    eye
        Board frame, px, shape (3,).
    axes
        Right, down and forward as rows, board frame, shape (3, 3).
    focal
        Picture px per unit of the image plane.
    shift
        Picture px of the point straight ahead, (x, y).
    size
        Width and height of the picture, px.
    """

    eye: Array
    axes: Array
    focal: float
    shift: tuple[float, float]
    size: tuple[int, int]

    def scaled(self, factor: float) -> Camera:
        """The same view with `factor` times the pixels."""
        return Camera(
            self.eye,
            self.axes,
            self.focal * factor,
            (self.shift[0] * factor, self.shift[1] * factor),
            (round(self.size[0] * factor), round(self.size[1] * factor)),
        )

    def rays(self) -> Array:
        """Direction of each pixel's ray, shape (H, W, 3), board frame."""
        x = (np.arange(self.size[0]) + 0.5 - self.shift[0]) / self.focal
        y = (np.arange(self.size[1]) + 0.5 - self.shift[1]) / self.focal
        right, down, forward = self.axes
        return np.asarray(forward + x[None, :, None] * right + y[:, None, None] * down)


def camera_for(box: Box, longer: int, yaw_deg: float = 33.0, pitch_deg: float = 24.0, margin: float = 0.07) -> Camera:
    """Camera to the right of, above and in front of the block, with the block filling the picture."""
    yaw, pitch = np.radians(yaw_deg), np.radians(pitch_deg)
    forward = -np.array([np.sin(yaw) * np.cos(pitch), -np.sin(pitch), -np.cos(yaw) * np.cos(pitch)])
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    middle = 0.5 * (box.low + box.high)
    eye = middle - 3.4 * float(np.linalg.norm(box.high - box.low)) * forward
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (box.high - box.low) + box.low
    seen = (corners - eye) @ axes.T
    flat = seen[:, :2] / seen[:, 2:]
    low, span = flat.min(axis=0), np.ptp(flat, axis=0)
    rim = margin * float(span.max())
    focal = longer / float(max(span + 2.0 * rim))
    size = (span + 2.0 * rim) * focal
    return Camera(
        eye,
        axes,
        focal,
        (float((rim - low[0]) * focal), float((rim - low[1]) * focal)),
        (round(float(size[0])), round(float(size[1]))),
    )


@dataclass(frozen=True)
class Seen:
    """What the pixels show.

    Parameters
    ----------
    hit
        True where the block is, shape (H, W).
    points
        Board frame, px, of those pixels, shape (N, 3).
    axis
        0, 1 or 2: the face looked at is a side, a top or a front, shape (N,).
    inside
        True on the faces that the cut opened, shape (N,).
    """

    hit: npt.NDArray[np.bool_]
    points: Array
    axis: npt.NDArray[np.int64]
    inside: npt.NDArray[np.bool_]


def look(box: Box, camera: Camera) -> Seen:
    """Find the visible point of the block for each pixel."""
    rays = camera.rays()
    enter, leave, entry_axis, _ = _slab(rays, camera.eye, box.low, box.high)
    cut_enter, cut_leave, _, exit_axis = _slab(rays, camera.eye, *box.notch)
    eps = 1e-6 * float(np.linalg.norm(box.high - box.low))
    through = (cut_enter < cut_leave) & (cut_enter <= enter + eps)
    distance = np.where(through, cut_leave, enter)
    hit = (enter < leave) & (distance < leave - eps)
    axis = np.where(through, exit_axis, entry_axis)[hit]
    points = camera.eye + distance[hit][:, None] * rays[hit]
    return Seen(hit, points, axis, through[hit])


def _slab(rays: Array, eye: Array, low: Array, high: Array) -> tuple[Array, Array, Array, Array]:
    """Distances at which rays enter and leave a box, and through faces of which axis."""
    safe = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    first, second = (low - eye) / safe, (high - eye) / safe
    near, far = np.minimum(first, second), np.maximum(first, second)
    return near.max(axis=-1), far.min(axis=-1), near.argmax(axis=-1), far.argmin(axis=-1)
