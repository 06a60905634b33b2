"""A smooth field of ring frequency from a bank of responses.

The strongest frequency of each pixel jumps, and each jump tears the phase. Here the evidence of the whole bank is
pooled over the neighbourhood, and the choice is regularised over log-frequency by passing messages between
neighbours a fixed number of times, so that a pixel's frequency depends on a bounded neighbourhood only and tiles
agree with the whole.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float32]

#: Rounds of message passing; each reaches one grid cell further.
ROUNDS = 6


def log_bank(shortest_px: float, longest_px: float, per_octave: int) -> FloatArray:
    """Frequencies in cycles per pixel from `longest_px` to `shortest_px`, evenly spaced in the logarithm."""
    count = max(3, math.ceil(per_octave * math.log2(longest_px / shortest_px)) + 1)
    return (1.0 / np.geomspace(longest_px, shortest_px, count)).astype(np.float32)


def _truncated_linear_max(belief: FloatArray, cost: float) -> None:
    """Best belief over all frequencies less `cost` per step of the bank, in place: the message to a neighbour."""
    last = belief.shape[0] - 1
    for k in range(1, last + 1):
        np.maximum(belief[k], belief[k - 1] - np.float32(cost), out=belief[k])
    for k in range(last - 1, -1, -1):
        np.maximum(belief[k], belief[k + 1] - np.float32(cost), out=belief[k])


def smooth_frequency(
    evidence: npt.NDArray[Any], bank: npt.NDArray[Any], pool_cells: float, step_cost: float
) -> tuple[FloatArray, FloatArray]:
    """Frequency per grid cell, varying smoothly.

    Parameters
    ----------
    evidence : array of shape (F, M, N)
        Non-negative evidence for each frequency of the bank at each cell of a grid over the image.
    bank : array of shape (F,)
        Frequencies, evenly spaced in the logarithm.
    pool_cells : float
        Standard deviation in cells of the Gaussian over which evidence is pooled.
    step_cost : float
        Cost of a step of the bank between neighbouring cells, in units of a cell's whole evidence.

    Returns
    -------
    frequency, sureness : float32 arrays of shape (M, N)
        Chosen frequency (between the bank's by a parabola) and its share of the pooled evidence, 0..1.
    """
    size = 2 * math.ceil(2.5 * pool_cells) + 1
    pooled: FloatArray = np.stack(
        [
            cv2.GaussianBlur(np.asarray(e, np.float32), (size, size), pool_cells, borderType=cv2.BORDER_REFLECT_101)
            for e in evidence
        ]
    ).astype(np.float32)
    pooled /= pooled.max(axis=0, keepdims=True) + np.float32(1e-12)
    belief = pooled.copy()
    # Half of a cell's belief is its own evidence, an eighth what each of its four neighbours says.
    cross = np.array([[0.0, 0.125, 0.0], [0.125, 0.0, 0.125], [0.0, 0.125, 0.0]], np.float32)
    for _ in range(ROUNDS):
        _truncated_linear_max(belief, step_cost)
        for said, own in zip(belief, pooled, strict=True):
            cv2.scaleAdd(own, 0.5, cv2.filter2D(said, cv2.CV_32F, cross, borderType=cv2.BORDER_REPLICATE), dst=said)
    top = belief.argmax(axis=0)
    inner = np.clip(top, 1, len(bank) - 2)
    left, mid, right = (np.take_along_axis(belief, (inner + d)[None], axis=0)[0] for d in (-1, 0, 1))
    curve = left - 2.0 * mid + right
    shift = np.where(curve < -1e-9, 0.5 * (left - right) / np.minimum(curve, -1e-9), 0.0)
    position = np.where(inner == top, inner + np.clip(shift, -0.5, 0.5), top)
    log_bank_step = math.log(float(bank[1]) / float(bank[0]))
    log_frequency = math.log(float(bank[0])) + position * log_bank_step
    sureness = np.take_along_axis(pooled, top[None], axis=0)[0]
    return np.exp(log_frequency).astype(np.float32), sureness.astype(np.float32)
