"""How well rings are found in photographs as people take them: on colored card, in uneven light, blurred, with labels.

Draws faces of logs whose truth is known, spoils each photograph in one way, and runs the stages up to `ring_tracing`.
Prints the share of traced vertices that lie on a true boundary (within 0.15 ring and three quarters of a px), the share
of the true boundaries that were traced, and the share of vertices whose ring index is right but for one whole constant:
an index that counts inwards is wrong everywhere.

    python benchmarks/spoilt_photographs.py [--cuts CUT ...] [--ways WAY ...] [--seeds SEED ...]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from unseen_planes import SIZE, fitted

from woodfit.synthetic_scenes import SCENE_NAMES, scene

#: A photograph in sRGB-encoded floats (H, W, 3), and the ring age of its pixels (H, W), NaN off the wood.
Face = tuple[np.ndarray, np.ndarray]


def places(face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x and y of each pixel, -0.5 to 0.5 over the picture."""
    height, width = face.shape[:2]
    x, y = np.meshgrid(np.arange(width) / width - 0.5, np.arange(height) / height - 0.5)
    return x, y


def lamp(face: np.ndarray, age: np.ndarray) -> Face:
    """More than twice as bright at one corner as at the opposite one."""
    x, y = places(face)
    return face * (0.725 + 0.36 * x + 0.19 * y)[..., None], age


def vignette(face: np.ndarray, age: np.ndarray) -> Face:
    """Darker towards all rims, as a round core is."""
    x, y = places(face)
    return face * (1.0 - 1.2 * (x * x + y * y))[..., None], age


def heartwood(face: np.ndarray, age: np.ndarray) -> Face:
    """The inner four tenths of the rings darker by half."""
    inner = 1.0 / (1.0 + np.exp((age - np.percentile(age, 40)) / 0.05))
    return face * np.array([0.74, 0.47, 0.38]) ** inner[..., None], age


def resized(factor: float, face: np.ndarray, age: np.ndarray) -> Face:
    """Photographed from farther away or from nearer."""
    how = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_CUBIC
    return cv2.resize(face, None, fx=factor, fy=factor, interpolation=how), cv2.resize(age, None, fx=factor, fy=factor)


def on_card(color: tuple[int, int, int], face: np.ndarray, age: np.ndarray) -> Face:
    """Smaller, turned by 23 degrees, on a card of one color."""
    height, width = age.shape
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), 23.0, 0.72)
    inside = cv2.warpAffine(np.ones((height, width), np.float32), turn, (width, height)) > 0.999
    card = np.random.default_rng(0).normal(color, 1.5, face.shape)
    moved = cv2.warpAffine(face, turn, (width, height), flags=cv2.INTER_AREA)
    known = np.where(inside, cv2.warpAffine(age, turn, (width, height)), np.nan)
    return np.where(inside[..., None], moved, card), known


def label(face: np.ndarray, age: np.ndarray) -> Face:
    """A paper with writing on it."""
    drawn = np.ascontiguousarray(face, np.float32)
    cv2.rectangle(drawn, (480, 60), (700, 180), (250, 250, 250), -1)
    drawn = drawn.clip(0, 255).astype(np.uint8)
    cv2.putText(drawn, "No 17", (500, 140), cv2.FONT_HERSHEY_SIMPLEX, 2, (20, 20, 20), 6)
    return drawn.astype(float), age


def saw_marks(face: np.ndarray, age: np.ndarray) -> Face:
    """Marks 7 px apart across the wood, 6 % of the light."""
    row, column = np.mgrid[: age.shape[0], : age.shape[1]]
    wave = np.sin(2.0 * np.pi * (column * np.cos(0.9) + row * np.sin(0.9)) / 7.0)
    return face * (1.0 + 0.06 * wave)[..., None], age


def noisy(face: np.ndarray, age: np.ndarray) -> Face:
    """Noise of 18 levels."""
    return face + np.random.default_rng(0).normal(0.0, 18.0, face.shape), age


def faint(face: np.ndarray, age: np.ndarray) -> Face:
    """A fifth of the contrast."""
    mean = face.mean(axis=(0, 1))
    return mean + 0.2 * (face - mean) + np.random.default_rng(0).normal(0.0, 1.0, face.shape), age


WAYS: dict[str, Callable[[np.ndarray, np.ndarray], Face]] = {
    "as drawn": lambda face, age: (face, age),
    "lamp": lamp,
    "vignette": vignette,
    "heartwood": heartwood,
    "blurred": lambda face, age: (gaussian_filter(face, (2.5, 2.5, 0.0)), age),
    "noisy": noisy,
    "faint": faint,
    "half size": partial(resized, 0.5),
    "three times": partial(resized, 3.0),
    "on white": partial(on_card, (250, 250, 250)),
    "on grey": partial(on_card, (128, 128, 128)),
    "on blue": partial(on_card, (60, 80, 150)),
    "label": label,
    "saw marks": saw_marks,
}


def judge(cut: str, seed: int, way: str) -> tuple[float, float, float]:
    """Shares of vertices on boundaries, of boundaries found, and of indices that are right."""
    drawn = scene(cut, SIZE, seed).face
    face, age = WAYS[way](drawn.rgb_encoded.astype(float), drawn.age.astype(float))
    encoded = np.ascontiguousarray(np.round(face).clip(0, 255).astype(np.uint8))
    ds = fitted(encoded, np.ones(age.shape, bool), "ring_tracing")
    points = np.stack([ds["ring_x"].values, ds["ring_y"].values], axis=1)
    if len(points) == 0:
        return 0.0, 0.0, 0.0
    column, row = np.clip(np.round(points).astype(int), 0, [age.shape[1] - 1, age.shape[0] - 1]).T
    slope, here = np.hypot(*np.gradient(age)), age[row, column]
    right = np.abs(here - np.round(here)) < 0.15 + 0.75 * slope[row, column]
    true = np.argwhere(np.abs(age - np.round(age)) < 0.03)[::7, ::-1]
    away, _ = cKDTree(points).query(true)
    ring_px = 1.0 / np.maximum(slope[true[:, 1], true[:, 0]], 1e-3)
    _, counts = np.unique(
        np.round(here - np.repeat(ds["ring_index"].values, ds["vertex_count"].values)), return_counts=True
    )
    return float(right.mean()), float((away < 0.15 * ring_px + 1.0).mean()), float(counts.max() / len(points))


def main() -> None:
    """Print the three shares of each face and way."""
    parser = argparse.ArgumentParser(description="Rings in photographs as people take them.")
    parser.add_argument("--cuts", nargs="+", choices=SCENE_NAMES, default=SCENE_NAMES)
    parser.add_argument("--ways", nargs="+", choices=tuple(WAYS), default=tuple(WAYS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    given = parser.parse_args()
    print("vertices on boundaries, boundaries found, indices right")
    for cut in given.cuts:
        for way in given.ways:
            shares = [judge(cut, seed, way) for seed in given.seeds]
            print(f"{cut:16s}{way:12s}" + "    ".join(f"{a:.2f} {b:.2f} {c:.2f}" for a, b, c in shares), flush=True)


if __name__ == "__main__":
    main()
