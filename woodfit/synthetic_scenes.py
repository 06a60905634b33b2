"""Sample scans with known truth: random logs of every cut, and the files that `woodpipe sample` writes."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from woodfit.matching import level_crossings
from woodfit.synthetic import Distortion, Floats, Log, Palette, Photograph, photograph, plane_points, srgb_decode

SCENE_NAMES = (
    "flat_sawn",
    "cathedral",
    "quarter_sawn",
    "end_grain_pith",
    "end_grain_off",
    "core",
    "ring_porous",
    "ring_porous_end",
)
DEPTH_PX = 100
_DPI = {"flat_sawn": 300, "quarter_sawn": 300, "end_grain_pith": 600, "core": 1200}

# Earlywood and latewood, sRGB-encoded 0..255: pine, spruce, larch, Douglas fir, yew-like; oak, ash, chestnut.
_CONIFERS = (
    ((226, 190, 140), (172, 112, 66)),
    ((232, 209, 170), (186, 148, 104)),
    ((205, 150, 104), (122, 72, 46)),
    ((214, 164, 118), (138, 78, 52)),
    ((196, 132, 88), (150, 88, 56)),
)
_RING_POROUS = (
    ((186, 146, 102), (168, 122, 80)),
    ((216, 192, 158), (200, 170, 132)),
    ((178, 136, 92), (154, 112, 74)),
)


@dataclass(frozen=True)
class Plane:
    """A plane of the block: ``origin + column * u + row * v`` in the board frame, px.

    Parameters
    ----------
    name
        ``"along_x"`` or ``"along_y"``.
    origin, u, v
        Board frame, px.
    points
        Shape (H, W, 3), board frame, px.
    age
        Ring age, float32, shape (H, W).
    """

    name: str
    origin: tuple[float, float, float]
    u: tuple[float, float, float]
    v: tuple[float, float, float]
    points: Floats
    age: Floats


@dataclass(frozen=True)
class Scene:
    """A named log, its photographed face (z = 0) and two planes at right angles to it, z from 0 to 100 px.

    `dpi` is the resolution that the scan's file will carry, or None.
    """

    name: str
    log: Log
    face: Photograph
    planes: tuple[Plane, ...]
    dpi: int | None


def ring_boundaries(rng: np.random.Generator, base: float, reach: float, spread: float | None = None) -> Floats:
    """Radii of the ring boundaries in px from 0 to beyond `reach`: a slow trend times year-to-year variation.

    The widths are wide near the pith, settle at about `base` px, swing slowly, and vary from year to year with a
    standard deviation of `spread` in log width (random if None) and a memory of some years.
    """
    count = int(reach / 8.0) + 2
    year = np.arange(count)
    juvenile = 1.0 + rng.uniform(0.0, 0.7) * np.exp(-year / rng.uniform(6.0, 20.0))
    swing = np.exp(rng.uniform(0.0, 0.25) * np.sin(2 * np.pi * (year / rng.uniform(25, 60) + rng.random())))
    memory = rng.uniform(0.2, 0.6)
    sigma = rng.uniform(0.12, 0.30) if spread is None else spread
    shocks = rng.normal(0.0, sigma * np.sqrt(1 - memory**2), count)
    chance = np.empty(count)
    chance[0] = rng.normal(0.0, sigma)
    for i in range(1, count):
        chance[i] = memory * chance[i - 1] + shocks[i]
    widths = np.clip(base * juvenile * swing * np.exp(chance), 8.0, 48.0)
    radii = np.concatenate([[0.0], np.cumsum(widths)])
    return radii[: int(np.searchsorted(radii, reach)) + 2]


def random_distortion(rng: np.random.Generator, steepest: float = 0.5) -> Distortion:
    """A smooth radial displacement: eccentric and oval growth plus waves of 150-900 px, never folding."""
    large, small = 3, 7
    order = np.concatenate([[1, 2, 3], rng.integers(0, 7, small)]).astype(float)
    length = np.concatenate([rng.uniform(1500, 6000, large), rng.uniform(250, 1800, small)])
    radial = rng.uniform(150, 900, small)
    distortion = Distortion(
        amplitude=np.concatenate([np.zeros(large), rng.uniform(0.5, 1.0, small) * radial / 60.0]),
        share=np.concatenate([rng.uniform(0.0, [0.10, 0.06, 0.03]), np.zeros(small)]),
        order=order,
        height_rate=rng.choice([-1.0, 1.0], large + small) * 2 * np.pi / length,
        radius_rate=np.concatenate([np.zeros(large), rng.choice([-1.0, 1.0], small) * 2 * np.pi / radial]),
        shift=rng.uniform(0, 2 * np.pi, large + small),
        fade=rng.uniform(60.0, 140.0),
    )
    scale = rng.uniform(0.35, 1.0) * steepest / distortion.bound()
    return Distortion(
        distortion.amplitude * scale,
        distortion.share * scale,
        order,
        distortion.height_rate,
        distortion.radius_rate,
        distortion.shift,
        distortion.fade,
    )


def random_palette(rng: np.random.Generator, rings: int, ring_porous: bool) -> Palette:
    """Colors of `rings` rings of a random conifer or ring-porous wood, each ring a little different."""
    kinds = _RING_POROUS if ring_porous else _CONIFERS
    pair = np.array(kinds[rng.integers(len(kinds))], dtype=float) / 255.0
    early, late = srgb_decode(pair) * np.exp(rng.normal(0.0, 0.035, size=(1, 3)) + rng.normal(0.0, 0.08, size=(2, 1)))
    heart = 1.0 / (1.0 + np.exp((np.arange(rings) - rng.uniform(0.0, 1.2) * rings) / 1.5))
    tint = np.exp(-rng.uniform(0.0, 0.3) * heart[:, None] * rng.uniform(0.85, 1.15, 3))
    yearly = np.exp(rng.normal(0.0, 0.04, size=(rings, 1)))
    depth = np.clip(rng.normal(1.0, 0.18, size=(rings, 1)), 0.5, 1.5) * rng.uniform(0.75, 1.15)
    onset = rng.uniform(0.05, 0.5) + rng.normal(0.0, 0.07, rings)
    power = rng.uniform(1.1, 2.4) + rng.normal(0.0, 0.2, rings)
    if ring_porous:  # no slow darkening: the pore band fades into plain latewood, darker or brighter by a little
        late = early * rng.uniform(0.90, 1.30)
        onset, power = 0.3 * onset, 0.45 * power
    spacing = rng.uniform(3.6, 5.6)
    return Palette(
        early=early * tint * yearly,
        late=early * (late / early) ** depth * tint * yearly,
        onset=np.clip(onset, 0.0, 0.7),
        power=np.clip(power, 0.3, 3.0),
        streak=float(rng.uniform(0.025, 0.09)),
        streak_length=float(rng.uniform(40.0, 140.0)),
        pore_share=float(rng.uniform(0.32, 0.5)) if ring_porous else 0.0,
        pore_spacing=float(spacing),
        pore_radius=float(spacing * rng.uniform(0.38, 0.48)),
        pore_darkness=float(rng.uniform(0.5, 0.75)),
        ray=float(rng.uniform(0.05, 0.2)) if ring_porous else 0.0,
    )


def _pose(name: str, size_yx: tuple[int, int], rng: np.random.Generator) -> tuple[Floats, Floats]:
    """A random pith point (3,) in px and unit direction (3,) of the board frame for the named cut."""
    height, width = size_yx
    middle = 0.5 * (height - 1)
    sign = rng.choice([-1.0, 1.0])
    outside = -rng.uniform(100, 700) if rng.random() < 0.5 else width + rng.uniform(100, 700)
    lean = np.radians(rng.normal(0.0, 2.0))
    if name == "flat_sawn" or (name == "ring_porous" and rng.random() < 0.5):
        point = [rng.uniform(0.2, 0.8) * width, middle, rng.uniform(90, 330)]
        tilt = np.radians(rng.uniform(-2.5, 2.5))
    elif name == "ring_porous":
        depth = rng.uniform(250, 600)
        edge = rng.uniform(0.0, 0.5) * depth
        point = [-edge if sign < 0 else width + edge, middle, depth]
        tilt = np.radians(rng.uniform(-3, 3))
    elif name == "cathedral":
        tilt = sign * np.radians(rng.uniform(10, 32))
        nearest = rng.uniform(30, 150)
        point = [rng.uniform(0.3, 0.7) * width, middle, nearest + middle * abs(np.tan(tilt))]
        lean = np.radians(rng.normal(0.0, 5.0))
    elif name == "quarter_sawn":
        point = [outside, middle, rng.uniform(20, 0.35 * (abs(outside - width / 2) - width / 2 + 60))]
        tilt = np.radians(rng.uniform(-2, 2))
        lean = np.radians(rng.normal(0.0, 3.0))
    else:
        turn, away = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0, 10))
        point = [rng.uniform(0.25, 0.75) * width, rng.uniform(0.25, 0.75) * height, 0.0]
        if name == "core":
            side = -rng.uniform(20, 350)
            point = [side if sign < 0 else width - side, middle + rng.uniform(-0.7, 0.7) * height, 0.0]
        elif name == "end_grain_off" or (name == "ring_porous_end" and rng.random() < 0.7):
            far = 0.5 * np.hypot(width, height) + rng.uniform(60, 700)
            point = [0.5 * width + far * np.cos(turn), 0.5 * height + far * np.sin(turn), 0.0]
        spin = rng.uniform(0, 2 * np.pi)
        return np.array(point), np.array([np.sin(away) * np.cos(spin), np.sin(away) * np.sin(spin), np.cos(away)])
    direction = np.array([np.tan(lean), 1.0, np.tan(tilt)])
    return np.array(point), direction / np.linalg.norm(direction)


def random_log(name: str, size_yx: tuple[int, int], rng: np.random.Generator) -> Log:
    """A random log, placed so that the face z = 0 of `size_yx` px shows the named cut."""
    ring_porous = name.startswith("ring_porous")
    pith, direction = _pose(name, size_yx, rng)
    corners = np.array([[x, y, z] for x in (0, size_yx[1]) for y in (0, size_yx[0]) for z in (0, DEPTH_PX)], float)
    reach = 1.35 * float(np.linalg.norm(np.cross(corners - pith, direction), axis=1).max())
    boundaries = ring_boundaries(rng, rng.uniform(15, 27) if ring_porous else rng.uniform(12, 27), reach)
    return Log(
        pith=(float(pith[0]), float(pith[1]), float(pith[2])),
        direction=(float(direction[0]), float(direction[1]), float(direction[2])),
        taper=float(rng.uniform(-1, 1) * 8e-5),
        boundaries=boundaries,
        distortion=random_distortion(rng),
        palette=random_palette(rng, len(boundaries), ring_porous),
        seed=int(rng.integers(2**31)),
    )


def scene(name: str, size_yx: tuple[int, int] = (735, 750), seed: int = 0) -> Scene:
    """Draw the named scene; the core's strip is 160 x 1500 px where the others are 735 x 750 (in proportion)."""
    if name not in SCENE_NAMES:
        raise ValueError(f"Unknown scene {name!r}; known: {', '.join(SCENE_NAMES)}.")
    rng = np.random.default_rng([seed, SCENE_NAMES.index(name)])
    size = (round(size_yx[0] * 160 / 735), 2 * size_yx[1]) if name == "core" else size_yx
    log = random_log(name, size, rng)
    row, column = (float(rng.integers(side // 4, 3 * side // 4 + 1)) for side in size)
    planes = []
    for label, origin, u, length in (
        ("along_x", (0.0, row, 0.0), (1.0, 0.0, 0.0), size[1]),
        ("along_y", (column, 0.0, 0.0), (0.0, 1.0, 0.0), size[0]),
    ):
        points = plane_points((DEPTH_PX + 1, length), origin, u, (0.0, 0.0, 1.0))
        planes.append(Plane(label, origin, u, (0.0, 0.0, 1.0), points, log.age(points).astype(np.float32)))
    return Scene(name, log, photograph(log, size, rng=rng), tuple(planes), _DPI.get(name))


def scenes(
    size_yx: tuple[int, int] = (735, 750), seed: int = 0, names: Sequence[str] = SCENE_NAMES
) -> tuple[Scene, ...]:
    """Draw the named scenes; each depends on its name, the size and the seed only."""
    return tuple(scene(name, size_yx, seed) for name in names)


def write_sample(
    directory: Path,
    size_yx: tuple[int, int] = (735, 750),
    seed: int = 0,
    names: Sequence[str] = SCENE_NAMES,
) -> tuple[Path, ...]:
    """Write ``<name>.png`` and ``<name>.truth.npz`` of each named scene; return the scans' paths.

    The truth holds ``age`` (H, W), ``pith_point`` and ``pith_direction`` (3,) of the board frame in px, and for
    each plane ``along_x`` and ``along_y`` the arrays ``<plane>_origin``, ``_u``, ``_v`` (3,), ``_points``
    (H, W, 3) and ``_age`` (H, W). Some scans carry a resolution. The core also gets labels, ``core.json``. Same
    arguments, same bytes.
    """
    directory.mkdir(parents=True, exist_ok=True)
    scans = []
    for name in names:
        drawn = scene(name, size_yx, seed)
        scan = directory / f"{name}.png"
        scan.write_bytes(encode_png(drawn.face.rgb_encoded, drawn.dpi))
        truth = {
            "age": drawn.face.age,
            "pith_point": np.asarray(drawn.log.pith),
            "pith_direction": np.asarray(drawn.log.direction),
        }
        for plane in drawn.planes:
            for field in ("origin", "u", "v", "points", "age"):
                truth[f"{plane.name}_{field}"] = np.asarray(getattr(plane, field), dtype=np.float32)
        with (directory / f"{name}.truth.npz").open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **truth)
        if name == "core":
            (directory / f"{name}.json").write_text(json.dumps(core_labels(drawn), indent=1) + "\n")
        scans.append(scan)
    return tuple(scans)


def encode_png(rgb: NDArray[np.uint8], dpi: int | None) -> bytes:
    """PNG file of sRGB-encoded pixels (H, W, 3), with a resolution tag unless `dpi` is None."""
    done, buffer = cv2.imencode(".png", rgb[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not done:
        raise ValueError(f"Cannot encode an image of shape {rgb.shape} as PNG.")
    data = buffer.tobytes()
    if dpi is None:
        return data
    # OpenCV writes no resolution; pHYs (px per meter) may stand right after the 33 bytes of signature and IHDR.
    per_meter = round(dpi / 0.0254)
    body = b"pHYs" + struct.pack(">IIB", per_meter, per_meter, 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    return data[:33] + chunk + data[33:]


def core_labels(core: Scene, rows: int = 3) -> dict[str, Any]:
    """Labels of a core strip: where its ring boundaries cross `rows` lines along the axis, in px, to 0.01 px."""
    height, width = core.face.age.shape
    paths = []
    for row in np.linspace(0, height - 1, rows + 2)[1:-1].round():
        x = np.arange(0.0, width - 1 + 0.125, 0.125)
        age = core.log.age(np.stack([x, np.full_like(x, row), np.zeros_like(x)], axis=-1))
        crossed = level_crossings(age)
        positions = [[round(float(i) * 0.125, 2), float(row)] for i in crossed]
        paths.append(
            {
                "start": [0, float(row)],
                "end": [width - 1, float(row)],
                "positions": positions,
                "uncertain": [0] * len(positions),
            }
        )
    labels: dict[str, Any] = {"image": f"{core.name}.png", "kind": "core", "paths": paths}
    if core.dpi is not None:
        labels["pixel_size_mm"] = 25.4 / core.dpi
    return labels
