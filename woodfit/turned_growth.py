"""Where growth was found the wrong way round: boundaries beside it are numbered the other way.

`woodfit.growth` goes by the edges and the bends of a place and its surroundings. Where rings are faint that can turn a
corner of a face round. Boundaries that lead from it into clearer wood are numbered there, and know better.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from woodfit.ring_order import Order, Surroundings, distance_outwards, draw_labels
from woodfit.tracing import Trace

#: Every how many vertices are asked; how far they speak, in rings; the smallest patch turned, in squares of a ring.
_EVERY, _REACH, _SMALLEST = 4, 1.0, 2.0

#: What is left of a vote beyond its reach does not speak.
_FAINTEST = 0.02


def against_indices(
    traces: Sequence[Trace],
    order: Order,
    growth: npt.NDArray[Any],
    frequency: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    ring_scale_px: float,
) -> npt.NDArray[np.bool_]:
    """Where walks outwards from the boundaries mostly meet one of a smaller index.

    Parameters
    ----------
    traces : sequence of Trace
        Boundaries.
    order : Order
        Their indices.
    growth, frequency : arrays of shape (M, N)
        Outward direction in rad, rings per pixel.
    valid : bool array of shape (M, N)
        The wood.
    ring_scale_px : float
        Characteristic ring width in pixels of these arrays.

    Returns
    -------
    bool array of shape (M, N)
    """
    labels = draw_labels([t.points for t in traces], [t.closed for t in traces], growth.shape)
    around = Surroundings.of(labels, growth, frequency, valid)
    step = max(1, round(0.5 * ring_scale_px))
    rows, columns = (max(2, n // step) for n in growth.shape)
    votes = np.zeros((rows, columns), np.float32)
    for own, trace in enumerate(traces):
        points = trace.points[::_EVERY]
        met, _ = distance_outwards(points, own + 1, around)
        told = (met > 0) & (order.group[met - 1] == order.group[own])
        sign = np.sign(order.index[met[told] - 1] - order.index[own])
        x, y = points[told].T
        column = np.clip((x + 0.5) * columns / growth.shape[1], 0, columns - 1).astype(int)
        row = np.clip((y + 0.5) * rows / growth.shape[0], 0, rows - 1).astype(int)
        np.add.at(votes, (row, column), sign)
    # In cells of half a ring.
    spread = cv2.GaussianBlur(votes, (0, 0), 2.0 * _REACH)
    against = cv2.resize(spread, growth.shape[::-1], interpolation=cv2.INTER_LINEAR) < -_FAINTEST
    _, patch, measures, _ = cv2.connectedComponentsWithStats(against.astype(np.uint8))
    large = measures[:, cv2.CC_STAT_AREA] >= _SMALLEST * ring_scale_px**2
    return np.asarray(against & large[patch])
