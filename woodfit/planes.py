"""The photographed faces in the board frame: from places on photographs to points in the wood."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Planes:
    """The planes of one or several faces, photographed and laid below one another (an atlas).

    Attributes
    ----------
    plane : array of shape (F, 3, 3)
        For each face the point of its own pixel (0, 0), and what one px to the right and one px down add; board
        frame, px.
    top : array of shape (F,)
        y in the atlas of each face's own row 0, px, increasing; 0 for a single scan.
    """

    plane: FloatArray
    top: FloatArray

    @classmethod
    def single(cls) -> Planes:
        """Return the one face of a plain scan: z = 0, x right, y down."""
        return cls(np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]), np.zeros(1))

    def face_of(self, y: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
        """Number of the face that places with atlas y (px) lie on; between two faces the upper one."""
        # Pixel centres of a face start at its top; half a pixel above still belongs to it.
        return np.clip(np.searchsorted(self.top - 0.5, y, side="right") - 1, 0, len(self.top) - 1).astype(np.int64)

    def lift(self, x: npt.NDArray[Any], y: npt.NDArray[Any]) -> FloatArray:
        """Board-frame points (..., 3) in px of places x, y (...) on the photographs, atlas px."""
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        face = self.face_of(y)
        plane = self.plane[face]
        down = y - self.top[face]
        return np.asarray(plane[..., 0, :] + x[..., None] * plane[..., 1, :] + down[..., None] * plane[..., 2, :])

    def turn(self, dx: npt.NDArray[Any], dy: npt.NDArray[Any], y: npt.NDArray[Any]) -> FloatArray:
        """Board-frame vectors (..., 3) of directions dx, dy (...) on the photographs at atlas y (...)."""
        plane = self.plane[self.face_of(np.asarray(y))]
        return np.asarray(np.asarray(dx)[..., None] * plane[..., 1, :] + np.asarray(dy)[..., None] * plane[..., 2, :])

    def facing(self) -> tuple[Planes, FloatArray]:
        """Return the planes in a frame in which they face the camera, and the way there.

        Returns
        -------
        planes : Planes
            If all faces lie on one plane, turned and moved to z = 0, the first one's rows along x; else as they are.
        to_facing : array of shape (4, 4)
            Rigid transform from the board frame to that frame, px to px.
        """
        normal = np.cross(self.plane[:, 1], self.plane[:, 2])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        level = (self.plane[:, 0] - self.plane[0, 0]) @ normal[0]
        if np.any(np.abs(level) > 0.5) or np.any(normal @ normal[0] < 1.0 - 1e-6):
            return self, np.eye(4)
        right = self.plane[0, 1] / np.linalg.norm(self.plane[0, 1])
        turn = np.stack([right, np.cross(normal[0], right), normal[0]])
        to_facing = np.eye(4)
        to_facing[:3, :3], to_facing[:3, 3] = turn, -turn @ self.plane[0, 0]
        plane = self.plane @ turn.T
        plane[:, 0] += to_facing[:3, 3]
        return Planes(plane, self.top), to_facing
