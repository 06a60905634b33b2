"""The editable parameters (`woodfit.liu`) of a solid texture, and how well they stand for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from woodfit.cylinder_grid import cylindrical, sample
from woodfit.liu import Floats, LiuModel, Wave, onset, profile
from woodfit.solid_texture import SolidTexture

#: Bands that are kept at most, and the share of the distortion's variance below which another is not worth a line.
_WAVES, _WORTH = 16, 0.002
#: Half waves over the extent of the face along azimuth, height and radius that are tried.
_ORDERS = (4, 4, 3)
#: What a node of the grid counts for beside a point that was seen.
_NODE = 0.05
#: Rings over which the distortion sets in.
_FADE_RINGS = 1.5


def fit_liu(texture: SolidTexture, seen: npt.ArrayLike | None = None) -> LiuModel:
    """Parameters that stand for a texture; its fine grain is not among them.

    Parameters
    ----------
    texture : SolidTexture
        Its rings, colors and distortion.
    seen : array_like of shape (K, 3), optional
        Points spread over the photographed faces, board frame, the texture's unit: there the distortion is met best;
        without them all over its grid.

    Returns
    -------
    LiuModel
        Lengths in the texture's unit.
    """
    scale = 1.0 if texture.pixel_size is None else float(texture.pixel_size)
    widths = np.maximum(np.diff(texture.ring_radius), 1e-9)
    mean = float(widths.mean())
    fade = _FADE_RINGS * mean
    early, exponent, tones, shape = _colors(texture, seen)
    matrix = np.array(texture.board_to_tree, float)
    matrix[:3, 3] *= scale
    bend_x, bend_y, taper = (float(part) / scale for part in texture.stem)
    return LiuModel(
        unit=texture.unit,
        board_to_tree=tuple((float(a), float(b), float(c), float(d)) for a, b, c, d in matrix),
        stem=(bend_x, bend_y, taper),
        first_radius=float(texture.ring_radius[0]) * scale,
        ring_width=mean * scale,
        ring_widths=tuple((widths / mean).round(4).tolist()),
        latewood_ratio=shape[0],
        early_slope=shape[1],
        late_slope=shape[2],
        early_color=early,
        late_exponent=exponent,
        ring_exponents=tones,
        fade_radius=fade * scale,
        waves=tuple(
            Wave(
                wave.amplitude * scale,
                wave.azimuth_rate,
                wave.height_rate / scale,
                wave.radius_rate / scale,
                wave.shift,
            )
            for wave in _waves(texture, fade, seen)
        ),
    )


def agreement(model: LiuModel, texture: SolidTexture, points: npt.ArrayLike) -> dict[str, float]:
    """How far a model is from a texture at points (..., 3): ring age, in rings, and linear rgb, mean and rms."""
    ours, theirs = model.evaluate(points), texture.evaluate(points, detail=False)
    off = np.abs(ours.ring_age - theirs.ring_age)
    color = ours.rgb.reshape(-1, 3) - theirs.rgb.reshape(-1, 3)
    return {
        "ring_age_median": round(float(np.median(off)), 4),
        "ring_age_95": round(float(np.quantile(off, 0.95)), 4),
        "mean_color": round(float(np.abs(color.mean(axis=0)).max()), 4),
        "color_rms": round(float(np.sqrt((color**2).mean())), 4),
    }


def _colors(
    texture: SolidTexture, seen: npt.ArrayLike | None
) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, ...], tuple[float, float, float]]:
    """Early color, exponent of latewood, exponent of each ring, and the ring profile's ratio and slopes."""
    count = texture.samples_per_ring
    rings = max(1, len(texture.color_strip) // count)
    late = np.asarray(texture.lateness_strip[: rings * count], float).reshape(rings, -1)
    light = np.log(np.clip(texture.color_strip[: rings * count], 1e-4, 0.9999).astype(float)).reshape(rings, -1, 3)
    fraction = (np.arange(late.shape[1]) + 0.5) / count
    shown = np.arange(rings)
    if seen is not None and np.size(seen):
        # Rings that the face does not show are filled from the others: they are no evidence.
        shown = np.unique(np.clip(texture.evaluate(seen, detail=False).ring_index, 0, rings - 1))
    shape = _profile(fraction, np.median(late[shown], axis=0))
    curve = profile(fraction, *shape)
    terms = np.stack([np.ones_like(curve), curve], axis=1)
    tone = np.ones(rings)
    for _ in range(8):
        usual = np.mean(light[shown] / tone[shown, None, None], axis=0)
        base = np.linalg.lstsq(terms, usual, rcond=None)[0]
        model = terms @ base
        tone = np.einsum("rsc,sc->r", light, model) / (model**2).sum()
        tone /= np.median(tone[shown])
    early = np.clip(np.exp(base[0]), 1e-3, 0.999)
    exponent = 1.0 + base[1] / np.log(early)
    (r, g, b), (er, eg, eb) = early.tolist(), exponent.tolist()
    return (r, g, b), (er, eg, eb), tuple(tone.round(4).tolist()), shape


def _profile(fraction: Floats, lateness: Floats) -> tuple[float, float, float]:
    """Latewood ratio and the two slopes whose profile is the nearest to a measured one, up to its depth."""

    def misfit(shape: Any) -> float:
        ratio, early, late = np.clip(shape, [0.02, 0.01, 0.005], [0.98, 1.0, 1.0])
        terms = np.stack([np.ones_like(fraction), profile(fraction, ratio, early, late)], axis=1)
        depth = np.linalg.lstsq(terms, lateness, rcond=None)[0]
        outside = float(np.abs(np.asarray(shape) - [ratio, early, late]).sum())
        return float(((terms @ depth - lateness) ** 2).sum()) + outside + 10.0 * max(0.0, -float(depth[1]))

    starts = [
        (r, e, s) for r in np.linspace(0.05, 0.9, 18) for e in (0.05, 0.2, 0.4, 0.7, 0.95) for s in (0.05, 0.3, 0.7)
    ]
    best = min(starts, key=misfit)
    found = minimize(misfit, best, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-10, "maxfev": 800}).x
    ratio, early, late = np.clip(found, [0.02, 0.01, 0.005], [0.98, 1.0, 1.0]).tolist()
    return ratio, early, late


def _waves(texture: SolidTexture, fade: float, seen: npt.ArrayLike | None) -> list[Wave]:
    """The strongest waves of the displacement, px, found one after the other and fitted together each time."""
    places, weight = _places(texture, seen)
    r, azimuth, height = places
    target, _, _ = sample(texture.grid, texture.displacement, r, azimuth, height)
    window = onset(r, fade)
    extents = [max(float(np.ptp(axis)), 1e-6) for axis in (azimuth, height, r)]
    turn = 1.0 if texture.grid.wraps else np.pi / extents[0]
    rates = _rates(turn, np.pi / extents[1], np.pi / extents[2])
    angle = rates @ np.stack([azimuth, height, r])
    root = np.sqrt(weight)
    atoms = np.concatenate([np.cos(angle), np.sin(angle)]) * window * root
    length = np.maximum(np.linalg.norm(atoms, axis=1), 1e-12)
    goal = np.asarray(target, float) * root
    rest, chosen, solution = goal, list[int](), goal
    total = float(goal @ goal)
    if total < 1e-9:
        return []
    for _ in range(_WAVES):
        found = ((atoms @ rest) / length) ** 2
        pairs = found[: len(rates)] + found[len(rates) :]
        pairs[chosen] = -1.0
        best = int(np.argmax(pairs))
        matrix = np.concatenate([atoms[[*chosen, best]], atoms[[n + len(rates) for n in [*chosen, best]]]]).T
        # A little damping: waves that look alike on the face must not grow against each other.
        damped = np.vstack([matrix, 0.01 * np.diag(np.linalg.norm(matrix, axis=0))])
        part = np.linalg.lstsq(damped, np.concatenate([goal, np.zeros(matrix.shape[1])]), rcond=None)[0]
        left = goal - matrix @ part
        if float(rest @ rest) - float(left @ left) < _WORTH * total:
            break
        chosen, rest, solution = [*chosen, best], left, part
    if not chosen:
        return []
    half = len(chosen)
    waves = [
        Wave(
            float(np.hypot(c, s)),
            float(rates[number, 0]),
            float(rates[number, 1]),
            float(rates[number, 2]),
            _turn(c, s),
        )
        for number, c, s in zip(chosen, solution[:half], solution[half:], strict=True)
    ]
    return sorted(waves, key=lambda wave: -wave.amplitude)


def _turn(cosine: float, sine: float) -> float:
    """Shift of the wave that is made of a cosine and a sine of these amplitudes, rad."""
    return float(-np.arctan2(sine, cosine))


def _rates(turn: float, rise: float, out: float) -> Floats:
    """Rates (K, 3) along azimuth, height and radius that are tried; of two opposite ones only one."""
    across, along, outwards = _ORDERS
    orders = [
        (n, k, q)
        for n in range(across + 1)
        for k in range(-along, along + 1)
        for q in range(-outwards, outwards + 1)
        if (n, k, q) >= (0, 0, 0)
    ]
    return np.array(orders, float) * [turn, rise, out]


def _places(texture: SolidTexture, seen: npt.ArrayLike | None) -> tuple[tuple[Floats, Floats, Floats], Floats]:
    """Cylindrical places (px, rad, px) at which the displacement is to be met, and their weights."""
    grid = texture.grid
    nodes = [axis.ravel() for axis in np.meshgrid(grid.radius, grid.azimuth, grid.height, indexing="ij")]
    some = np.linspace(0, len(nodes[0]) - 1, min(3000, len(nodes[0]))).round().astype(int)
    r, azimuth, height = (np.asarray(axis, float)[some] for axis in nodes)
    points = np.zeros((0, 3)) if seen is None else np.asarray(seen, float).reshape(-1, 3)
    if not len(points):
        return (r, azimuth, height), np.ones(len(r))
    scale = 1.0 if texture.pixel_size is None else float(texture.pixel_size)
    on_face = cylindrical(points / scale, texture.board_to_tree, texture.stem)
    weight = np.concatenate([np.ones(len(points)), np.full(len(r), _NODE)])
    both = [np.concatenate(pair) for pair in zip(on_face, (r, azimuth, height), strict=True)]
    return (both[0], both[1], both[2]), weight
