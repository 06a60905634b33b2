"""Where to look at a photograph closely: windows spread over it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt


def window_corners(shape: tuple[int, int], size: int, most: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First rows and columns of windows of `size` px that cover an image evenly, as far as `most` of them do.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns of the image.
    size : int
        Side of a window, px.
    most : int
        How many windows at most.

    Returns
    -------
    rows, columns : int64 arrays of shape (P,)
        An image smaller than a window has one, which goes beyond it.
    """
    down, right = (max(1, math.ceil(length / size)) for length in shape)
    while down * right > most:
        # Fewer along the axis on which they stand closer.
        if right == 1 or (down > 1 and shape[0] / down <= shape[1] / right):
            down -= 1
        else:
            right -= 1
    rows = np.rint(np.linspace(0, max(shape[0] - size, 0), down)).astype(np.int64)
    columns = np.rint(np.linspace(0, max(shape[1] - size, 0), right)).astype(np.int64)
    if down == 1:
        rows[:] = max(shape[0] - size, 0) // 2
    if right == 1:
        columns[:] = max(shape[1] - size, 0) // 2
    return np.repeat(rows, right), np.tile(columns, down)
