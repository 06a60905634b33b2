"""From the board frame to the scene: y up, z towards the camera, the block about two units large around the origin."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.block_extent import Extent

Array = npt.NDArray[Any]

#: Turns the board frame (y down, z away) to that of the scene (y up, z towards the viewer).
UPRIGHT = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Frame:
    """Scene coordinates: ``scene = scale turn (board - centre)``.

    Attributes
    ----------
    centre : array of shape (3,)
        Point of the board frame at the scene's origin.
    scale : float
        Scene units per unit of the texture.
    turn : array of shape (3, 3)
        A proper rotation.
    """

    centre: npt.NDArray[np.float64]
    scale: float
    turn: npt.NDArray[np.float64] = field(default_factory=UPRIGHT.copy)

    @classmethod
    def around(cls, extent: Extent, longest: float = 2.0) -> Frame:
        """The frame in which a block's longest side has a given length."""
        return cls(extent.centre, longest / float(extent.size.max()))

    def scene(self, points: Array) -> npt.NDArray[np.float64]:
        """Scene coordinates of points (..., 3) of the board frame."""
        return np.asarray(self.scale * (points - self.centre) @ self.turn.T)

    def board(self, points: Array) -> npt.NDArray[np.float64]:
        """Board-frame points of scene coordinates (..., 3)."""
        return np.asarray(points @ self.turn / self.scale + self.centre)

    def board_of(self, mi: Any, point: Any) -> Any:
        """As `board`, of a point of the renderer."""
        rows = (self.turn.T / self.scale).tolist()
        return mi.Point3f(
            *(
                point.x * row[0] + point.y * row[1] + point.z * row[2] + shift
                for row, shift in zip(rows, self.centre.tolist(), strict=True)
            )
        )
