"""A phase without its jumps, torn where that costs least.

About a dislocation the phase turns once, so that no count of rings is right all round it: somewhere a jump of a whole
ring is left. A path that counts through the face leaves it wherever it happens to end; here the tears of the whole face
run through the wood whose phase is believed least (Costantini, IEEE Transactions on Geoscience and Remote Sensing 36,
1998: a network flow that carries each dislocation to one of the other sense, or off the face).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from ortools.graph.python.min_cost_flow import SimpleMinCostFlow

from woodfit.grids import block_mean

Array = npt.NDArray[Any]

#: Tears are sought on a grid that keeps this many cells to a ring, of cells of at most so many pixels.
_CELLS_PER_RING, _WIDEST_CELL = 4.0, 3
#: The flow counts in whole numbers: so many to a belief of 1. Each pixel of a tear costs one more, so that tears are
#: short where nothing is believed. Tears that may run along the same pixels.
_COST, _MOST_TEARS = 1000, 16


def unwrap(phase: Array, belief: Array) -> npt.NDArray[np.float64]:
    """Phase in rings without its jumps, up to one whole number.

    Parameters
    ----------
    phase : array of shape (H, W)
        Ring phase, rad.
    belief : array of shape (H, W)
        What a tear costs there for each px of its length, 0..1: confidence of the phase.

    Returns
    -------
    array of shape (H, W)
        Whole rings from `phase` at every pixel; neighbours differ by less than half a ring, but for the tears.
    """
    turn = np.asarray(phase, np.float64) / (2.0 * np.pi)
    if not np.any(belief):
        # Tears cost nothing anywhere.
        return turn
    cell = _cell(turn, belief)
    if cell == 1:
        return _least_torn(turn, belief)
    real, imaginary = (block_mean(belief * part, cell) for part in (np.cos(phase), np.sin(phase)))
    coarse = _least_torn(np.arctan2(imaginary, real) / (2.0 * np.pi), np.hypot(real, imaginary))
    near = np.kron(coarse, np.ones((cell, cell)))[: turn.shape[0], : turn.shape[1]]
    return np.asarray(turn + np.round(near - turn), np.float64)


def _cell(turn: Array, belief: Array) -> int:
    """Pixels to a cell that the narrowest rings, but for a twentieth, still have enough of."""
    steps = np.concatenate([np.abs(_wrap(np.diff(turn, axis=axis)))[_both(belief, axis) > 0.0] for axis in (0, 1)])
    if not steps.size:
        return 1
    rings_per_px = max(float(np.percentile(steps, 95)), 1e-6)
    return int(np.clip(1.0 / (_CELLS_PER_RING * rings_per_px), 1, min(_WIDEST_CELL, *turn.shape)))


def _least_torn(turn: Array, belief: Array) -> npt.NDArray[np.float64]:
    """`unwrap` at every pixel, of a phase in rings."""
    right, down = _wrap(np.diff(turn, axis=1)), _wrap(np.diff(turn, axis=0))
    # How often the phase turns about each corner between four pixels.
    turns = np.round(right[:-1] + down[:, 1:] - right[1:] - down[:, :-1]).astype(np.int64)
    # Corners are the flow's nodes; all that lies off the face is one more.
    off = turns.size
    corner = np.full((turn.shape[0] + 1, turn.shape[1] + 1), off, np.int32)
    corner[1:-1, 1:-1] = np.arange(off).reshape(turns.shape)
    # A flow between the corners on both sides of two neighbouring pixels is a jump between them.
    above, below = corner[:-1, 1:-1].ravel(), corner[1:, 1:-1].ravel()
    before, behind = corner[1:-1, :-1].ravel(), corner[1:-1, 1:].ravel()
    tails, heads = np.concatenate([above, behind]), np.concatenate([below, before])
    cost = np.concatenate([_both(belief, axis).ravel() for axis in (1, 0)])
    cost = 1 + np.round(_COST * cost).astype(np.int64)
    flow = SimpleMinCostFlow()
    many = np.full(len(cost), _MOST_TEARS, np.int64)
    one_way = flow.add_arcs_with_capacity_and_unit_cost(tails, heads, many, cost)
    back = flow.add_arcs_with_capacity_and_unit_cost(heads, tails, many, cost)
    flow.set_nodes_supplies(np.arange(off + 1, dtype=np.int32), np.append(turns.ravel(), -turns.sum()))
    if flow.solve() != flow.OPTIMAL:
        raise RuntimeError(f"No tears take all dislocations of a phase of {turn.shape[0]} x {turn.shape[1]} px away.")
    jumps = (flow.flows(one_way) - flow.flows(back)).astype(np.float64)
    right += jumps[: right.size].reshape(right.shape)
    down += jumps[right.size :].reshape(down.shape)
    first = turn[:1, :1] + np.concatenate([np.zeros((1, 1)), np.cumsum(down[:, :1], axis=0)])
    return np.concatenate([first, first + np.cumsum(right, axis=1)], axis=1)


def _both(belief: Array, axis: int) -> Array:
    """The lower one of the beliefs of neighbours along an axis."""
    ahead, here = (np.delete(belief, end, axis) for end in (0, -1))
    return np.minimum(ahead, here)


def _wrap(turn: Array) -> Array:
    return np.asarray(turn - np.round(turn))
