"""How far pith lines that explain the rings about as well lie from one another.

The likely lines may form a long bent valley (distance against ring width) or several islands, which no curvature at one
point describes. So a crowd of walkers explores them: each steps along the line to another walker, which fits any scale
and any skew (Goodman & Weare [1]_).

References
----------
.. [1] Goodman & Weare, "Ensemble samplers with affine invariance", Comm. App. Math. Comp. Sci. 5 (2010).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from woodfit.pith_energy import feet, frame_of
from woodfit.pith_search import Cost, chart, on_chart

FloatArray = npt.NDArray[np.float64]
Line = tuple[float, FloatArray, FloatArray]

#: How much less likely than the best (log) a line may be to stand for all.
NEARLY_AS_LIKELY = 3.0


def explore(cost: Cost, modes: list[Line], rng: np.random.Generator, walkers: int = 48, steps: int = 80) -> FloatArray:
    """Steps (S, 4) on the chart of the best mode of lines that are distributed as their probability.

    Parameters
    ----------
    cost : Cost
    modes : list of (value, point, direction)
        Likeliest lines, the best first.
    rng : numpy.random.Generator
    walkers, steps : int
        Size of the crowd, and how long it walks; the first third is forgotten.
    """
    _, origin, direction = modes[0]

    def at(place: FloatArray) -> FloatArray:
        return cost(*chart(origin, direction, place, cost.size_px))

    centres = on_chart(
        origin, direction, (np.stack([m[1] for m in modes]), np.stack([m[2] for m in modes])), cost.size_px
    )
    value = np.array([m[0] for m in modes])
    usable = np.isfinite(centres).all(axis=1)
    chance = np.where(usable, np.exp(np.minimum(modes[0][0] - value, 0.0) * 0.5), 0.0)
    owner = rng.choice(len(modes), walkers * 4, p=chance / chance.sum())
    # Steps of many sizes: the crowd takes up the valley's own scale from those that land in it.
    size = np.exp(rng.uniform(np.log(0.03), np.log(3.0), (walkers * 4, 1)))
    crowd = centres[owner] + size * rng.standard_normal((walkers * 4, 4))
    energy = np.concatenate([at(part) for part in np.array_split(crowd, 8)])
    best = np.argsort(energy + rng.exponential(2.0, len(energy)))[:walkers]
    crowd, energy = crowd[best], energy[best]
    half = walkers // 2
    seen = []
    for step in range(steps):
        for mine, other in ((slice(0, half), slice(half, None)), (slice(half, None), slice(0, half))):
            count = len(crowd[mine])
            stretch = (1.0 + rng.random(count)) ** 2 / 2.0
            partner = crowd[other][rng.integers(len(crowd[other]), size=count)]
            tried = partner + stretch[:, None] * (crowd[mine] - partner)
            new = at(tried)
            taken = np.log(rng.random(count)) < 3.0 * np.log(stretch) + energy[mine] - new
            crowd[mine] = np.where(taken[:, None], tried, crowd[mine])
            energy[mine] = np.where(taken, new, energy[mine])
        if step >= steps // 3:
            seen.append(crowd.copy())
    return np.concatenate(seen)


def middle(cost: Cost, mode: Line, steps: FloatArray, mirrors: bool) -> tuple[Line, FloatArray]:
    """Line in the middle of the likely ones, and one standard deviation of them about it.

    Parameters
    ----------
    cost : Cost
    mode : (value, point, direction)
        The best line; the chart of `steps` is its own.
    steps : array of shape (S, 4)
        From `explore`.
    mirrors : bool
        Whether the mirror image in the face z = 0 of each line is as likely.

    Returns
    -------
    line : (value, point, direction)
        The geometric median, or `mode` if that is much likelier.
    spread : array of shape (4,)
        Two angles (rad) across the line, in the face and into the wood, and two offsets (px).
    """
    _, origin, direction = mode
    choices = [steps]
    if mirrors:
        points, lines = chart(origin, direction, steps, cost.size_px)
        flip = np.array([1.0, 1.0, -1.0])
        mirrored = on_chart(origin, direction, (points * flip, lines * flip), cost.size_px)
        scale = np.median(np.abs(steps), axis=0) + 1e-6
        nearer = ((mirrored / scale) ** 2).sum(axis=1) < ((steps / scale) ** 2).sum(axis=1)
        folded = np.where(nearer[:, None], mirrored, steps)
        # On end grain the mirror images of a small tilt lie about no tilt, which then is the middle.
        choices = [steps, folded] if abs(direction[2]) > np.cos(np.pi / 4) else [folded]
    for steps in choices:
        point, line = chart(origin, direction, _median(steps)[None], cost.size_px)
        value = float(cost(point, line)[0])
        if value <= mode[0] + NEARLY_AS_LIKELY:
            break
    else:
        value, point, line = mode[0], origin[None], direction[None]
    found = value, feet(point[0], line[0], cost.centre), line[0]
    points, lines = chart(origin, direction, steps, cost.size_px)
    across, inward = frame_of(found[2])
    sense = np.where(lines @ found[2] < 0.0, -1.0, 1.0)
    turned, offset = lines * sense[:, None], feet(points, lines, cost.centre) - found[1]
    away = np.stack([turned @ across, turned @ inward, offset @ across, offset @ inward], axis=1)
    return found, np.asarray(np.sqrt((away * away).mean(axis=0)))


def _median(steps: FloatArray) -> FloatArray:
    """Geometric median (4,) of steps (S, 4), each axis by its own scatter: islands of few do not move it."""
    scale = steps.std(axis=0) + 1e-9
    centre = np.median(steps, axis=0)
    for _ in range(30):
        weight = 1.0 / np.maximum(np.linalg.norm((steps - centre) / scale, axis=1), 1e-3)
        centre = (weight[:, None] * steps).sum(axis=0) / weight.sum()
    return np.asarray(centre)
