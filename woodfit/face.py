"""Photographed faces in the tree's coordinates: grid, observations, ring age."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.cylinder_grid import CylinderGrid, cylindrical, grid_for, sample
from woodfit.displacement import Observations, age_of_radius
from woodfit.planes import Planes

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class FaceFrame:
    """How places on the photographs become tree coordinates.

    Attributes
    ----------
    planes : Planes
        Where the faces lie in the board frame.
    board_to_tree : array of shape (4, 4)
        Rigid transform, px.
    stem : array of shape (3,)
        Bend and taper of the stem, see `woodfit.cylinder_grid.cylindrical`.
    """

    planes: Planes
    board_to_tree: Array
    stem: Array

    def tree(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Radius (px), azimuth (rad) and height (px) of places x, y (px) of equal shape."""
        return cylindrical(self.planes.lift(x, y), self.board_to_tree, self.stem)

    def observe(self, x: Array, y: Array, target: Array, weight: Array) -> Observations:
        """Observations at places x, y (px), arrays of shape (N,)."""
        radius, azimuth, height = self.tree(x, y)
        return Observations(radius, azimuth, height, np.asarray(target), np.asarray(weight))

    def grid(
        self, x: Array, y: Array, shown: npt.NDArray[np.bool_], spacing_px: float, most_nodes: int, wider: float
    ) -> CylinderGrid:
        """Displacement grid that covers the faces.

        Parameters
        ----------
        x, y : arrays of shape (N,) and (M,)
            Pixel centres along the image axes, px.
        shown : bool array of shape (M, N)
            Where there is a face; between the faces of an atlas there is none.
        spacing_px, most_nodes, wider
            As in `woodfit.cylinder_grid.grid_for`.
        """
        # Every eighth pixel bounds the faces well enough; their outlines are taken whole.
        rows, cols = (np.unique(np.concatenate([np.arange(0, n, 8), [n - 1]])) for n in shown.shape)
        inside = shown[np.ix_(rows, cols)]
        grid_x, grid_y = np.meshgrid(x[cols], y[rows])
        radius, azimuth, height = self.tree(grid_x[inside], grid_y[inside])
        return grid_for(radius, azimuth, height, spacing_px, most_nodes, wider)

    def age(
        self, x: Array, y: Array, grid: CylinderGrid, displacement: Array, ring_radius: Array
    ) -> npt.NDArray[np.float32]:
        """Ring age of a model on the faces; x of shape (N,), y of shape (M,), result of shape (M, N)."""
        age = np.empty((len(y), len(x)), np.float32)
        for start in range(0, len(y), 256):
            grid_x, grid_y = np.meshgrid(x, y[start : start + 256])
            r, azimuth, height = self.tree(grid_x.ravel(), grid_y.ravel())
            moved, _, _ = sample(grid, displacement, r, azimuth, height)
            age[start : start + 256] = age_of_radius(r + moved, ring_radius)[0].reshape(grid_x.shape)
        return age


def stride_for(pixels: int, most: int) -> int:
    """Every how many pixels along each axis to take so that at most about `most` remain."""
    return max(1, int(np.ceil(np.sqrt(pixels / most))))
