"""The photographed face in the tree's coordinates: grid, observations, ring age."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.cylinder_grid import CylinderGrid, cylindrical, grid_for, sample
from woodfit.displacement import Observations, age_of_radius

Array = npt.NDArray[Any]


def tree_coordinates(x: Array, y: Array, board_to_tree: Array) -> tuple[Array, Array, Array]:
    """Radius (px), azimuth (rad) and height (px) of face points x, y (px) of equal shape."""
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float64)
    return cylindrical(points, board_to_tree)


def grid_of_face(x: Array, y: Array, board_to_tree: Array, spacing_px: float, most_nodes: int) -> CylinderGrid:
    """Displacement grid that covers a face.

    Parameters
    ----------
    x, y : arrays of shape (N,) and (M,)
        Pixel centres along the image axes, px.
    board_to_tree : array of shape (4, 4)
        Rigid transform, px.
    spacing_px, most_nodes
        As in `woodfit.cylinder_grid.grid_for`.
    """
    # Every eighth pixel bounds the face well enough; its outline is taken whole.
    xs = np.unique(np.concatenate([x[::8], x[[0, -1]]]))
    ys = np.unique(np.concatenate([y[::8], y[[0, -1]]]))
    grid_x, grid_y = np.meshgrid(xs, ys)
    radius, azimuth, height = tree_coordinates(grid_x.ravel(), grid_y.ravel(), board_to_tree)
    return grid_for(radius, azimuth, height, spacing_px, most_nodes)


def observe(x: Array, y: Array, board_to_tree: Array, target: Array, weight: Array) -> Observations:
    """Observations at face points x, y (px), arrays of shape (N,)."""
    radius, azimuth, height = tree_coordinates(np.asarray(x, float), np.asarray(y, float), board_to_tree)
    return Observations(radius, azimuth, height, np.asarray(target), np.asarray(weight))


def face_age(
    x: Array, y: Array, board_to_tree: Array, grid: CylinderGrid, displacement: Array, ring_radius: Array
) -> npt.NDArray[np.float32]:
    """Ring age of a model on the face; x of shape (N,), y of shape (M,), result of shape (M, N)."""
    age = np.empty((len(y), len(x)), np.float32)
    for start in range(0, len(y), 256):
        grid_x, grid_y = np.meshgrid(x, y[start : start + 256])
        r, azimuth, height = tree_coordinates(grid_x.ravel(), grid_y.ravel(), board_to_tree)
        moved, _, _ = sample(grid, displacement, r, azimuth, height)
        age[start : start + 256] = age_of_radius(r + moved, ring_radius)[0].reshape(grid_x.shape)
    return age


def stride_for(pixels: int, most: int) -> int:
    """Every how many pixels along each axis to take so that at most about `most` remain."""
    return max(1, int(np.ceil(np.sqrt(pixels / most))))
