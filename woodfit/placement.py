"""Where in the wood a piece is cut: from its own frame (y up) to the board frame (y down), turned, never mirrored."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from woodfit.block_extent import Extent, block_extent

if TYPE_CHECKING:
    from woodfit.solid_texture import SolidTexture

Floats = npt.NDArray[np.float64]

#: Share of the block that the largest piece takes: planing and the saw take the rest.
_SHARE = 0.98


@dataclass(frozen=True)
class Placement:
    """A turn, a scale and a move: ``board = scale rotation mesh + offset``.

    Attributes
    ----------
    rotation : array of shape (3, 3)
        A proper rotation.
    scale : float
        `SolidTexture.unit` per unit of the mesh.
    offset : array of shape (3,)
        In `SolidTexture.unit`.
    """

    rotation: Floats
    scale: float
    offset: Floats

    def apply(self, points: npt.NDArray[Any]) -> Floats:
        """Points (..., 3) of the mesh in the board frame."""
        return np.asarray(self.scale * (points @ self.rotation.T) + self.offset)

    def back(self, points: npt.NDArray[Any]) -> Floats:
        """Points (..., 3) of the board frame in the frame of the mesh."""
        return np.asarray((points - self.offset) @ self.rotation / self.scale)


def place(
    texture: SolidTexture,
    vertices: npt.NDArray[Any],
    position: npt.ArrayLike | None = None,
    rotation_deg: npt.ArrayLike | None = None,
    scale: float | None = None,
) -> Placement:
    """Place a mesh in the block that the photographs support; what is not given is chosen.

    Parameters
    ----------
    texture : SolidTexture
        The wood.
    vertices : array of shape (V, 3)
        Of the mesh, y up.
    position : array_like of shape (3,), optional
        Where the middle of the mesh's bounding box goes, board frame, `texture.unit`; else the middle of the block.
    rotation_deg : array_like of shape (3,), optional
        Turns about the board's x, y and z, in this order, of the mesh standing upright (its y towards the board's -y,
        its z out of the face); else its longest side along the grain.
    scale : float, optional
        `texture.unit` per unit of the mesh; else the largest that fits into the block.

    Returns
    -------
    Placement
    """
    block = block_extent(texture)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if rotation_deg is None:
        rotation = _along_the_grain(high - low, block, texture.board_to_tree[2, :3])
    else:
        upright = np.diag([1.0, -1.0, -1.0])
        rotation = Rotation.from_euler("xyz", np.asarray(rotation_deg, float), degrees=True).as_matrix() @ upright
    turned = vertices @ rotation.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    if scale is None:
        scale = _fitting(high - low, block)
    middle = block.centre if position is None else np.asarray(position, float)
    return Placement(rotation, float(scale), np.asarray(middle - scale * 0.5 * (low + high), np.float64))


def _fitting(sides: npt.NDArray[Any], block: Extent) -> float:
    return float(_SHARE * (block.size / np.maximum(sides, 1e-9 * sides.max())).min())


def _along_the_grain(sides: Floats, block: Extent, stem: npt.NDArray[Any]) -> Floats:
    """Of the 24 turns by right angles the one that lays the longest side along the grain and leaves the most room."""
    grain = int(np.argmax(np.abs(stem)))
    best, most = np.eye(3), -np.inf
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) < 0.0:
                continue
            turned = np.abs(turn) @ sides
            along = turned[grain] >= sides.max() * (1.0 - 1e-6)
            # Of equal ones the upright: the mesh's y towards the board's -y, its z out of the face.
            upright = -0.02 * turn[1, 1] - 0.01 * turn[2, 2]
            worth = np.log(_fitting(turned, block)) + 100.0 * along + 1e-3 * upright
            if worth > most:
                best, most = turn, worth
    return best
