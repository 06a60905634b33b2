"""A wood that a person can edit: the parameters of a model after Liu et al., evaluated at any point.

Ring width, a ring profile of four numbers, a color with an exponent, and the strongest waves of the distortion say in
a page of JSON what the solid texture holds in tables; docs/liu.md tells each of them. `woodfit.liu_fit` finds them.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.cylinder_grid import cylindrical
from woodfit.solid_texture import WoodSample

FORMAT, FORMAT_VERSION = "woodpipe liu", 1

Floats = npt.NDArray[np.float64]
Three = tuple[float, float, float]
Matrix = tuple[tuple[float, float, float, float], ...]


class LiuError(ValueError):
    """Parameters that are no wood; the message lists every problem."""


@dataclass(frozen=True)
class Wave:
    """One band of the radial distortion: ``amplitude * cos(n azimuth + k height + q radius + shift)``.

    `amplitude` in the model's unit, `azimuth_rate` n plain, `height_rate` k and `radius_rate` q in rad per unit,
    `shift` in rad.
    """

    amplitude: float
    azimuth_rate: float
    height_rate: float
    radius_rate: float
    shift: float


@dataclass(frozen=True)
class LiuModel:
    """Parameters of a wood; lengths in `unit`.

    Attributes
    ----------
    unit : str
        mm, px, or that of a block.
    board_to_tree : 4 x 4 numbers
        Rigid transform from the board frame to the tree frame.
    stem : three numbers
        bend_x, bend_y and taper per unit, as in `woodfit.cylinder_grid.cylindrical`.
    first_radius : float
        Radius at ring age 0.
    ring_width : float
        Mean width of a ring.
    ring_widths : numbers
        Width of each ring as a multiple of `ring_width`; rings beyond have 1.
    latewood_ratio : float
        Share of the ring that is latewood, 0..1.
    early_slope : float
        Share of the earlywood over which it turns slowly into latewood, 0..1.
    late_slope : float
        Share of the latewood over which it falls back to earlywood, 0..1.
    early_color : three numbers
        Linear rgb, 0..1.
    late_exponent : three numbers
        Latewood is the early color to this power, for each of red, green and blue; above 1 is darker.
    ring_exponents : numbers
        Power by which each ring's colors differ from the others'; rings beyond have 1.
    fade_radius : float
        Radius over which the distortion sets in.
    waves : Wave
        The strongest bands of the distortion, strongest first.
    """

    unit: str
    board_to_tree: Matrix
    stem: Three
    first_radius: float
    ring_width: float
    ring_widths: tuple[float, ...]
    latewood_ratio: float
    early_slope: float
    late_slope: float
    early_color: Three
    late_exponent: Three
    ring_exponents: tuple[float, ...]
    fade_radius: float
    waves: tuple[Wave, ...]

    def __post_init__(self) -> None:
        problems = _problems(self)
        if problems:
            raise LiuError("these parameters are no wood:\n" + "\n".join(f"  - {problem}" for problem in problems))

    def lateness(self, fraction: npt.ArrayLike) -> Floats:
        """Lateness 0..1 over the fraction of a ring 0..1, any shape."""
        return profile(np.asarray(fraction, float), self.latewood_ratio, self.early_slope, self.late_slope)

    def ring_radius(self) -> Floats:
        """Radius at ring age 0, 1, ... as far as single rings are told, shape (rings + 1,)."""
        return np.cumsum([self.first_radius, *(self.ring_width * width for width in self.ring_widths)])

    def distortion(self, radius: npt.ArrayLike, azimuth: npt.ArrayLike, height: npt.ArrayLike) -> Floats:
        """Radial displacement at cylindrical places of one shape (unit, rad, unit)."""
        r, turn, h = (np.asarray(part, float) for part in (radius, azimuth, height))
        total = np.zeros(np.broadcast_shapes(r.shape, turn.shape, h.shape))
        for wave in self.waves:
            angle = wave.azimuth_rate * turn + wave.height_rate * h + wave.radius_rate * r + wave.shift
            total += wave.amplitude * np.cos(angle)
        return np.asarray(total * onset(r, self.fade_radius), dtype=float)

    def color(self, age: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Linear rgb, shape (..., 3), at ring ages of any shape."""
        ages = np.asarray(age, float)
        index = np.maximum(np.floor(ages), 0).astype(np.int64)
        known = np.array([*self.ring_exponents, 1.0])
        tone = known[np.minimum(index, len(known) - 1)]
        late = self.lateness(ages - np.floor(ages))[..., None]
        power = tone[..., None] * (1.0 + late * (np.array(self.late_exponent) - 1.0))
        return np.asarray(np.array(self.early_color) ** power, np.float32)

    def evaluate(self, points: npt.ArrayLike) -> WoodSample:
        """Wood at board-frame points (..., 3) in `unit`, as `woodfit.SolidTexture.evaluate` gives it."""
        array = np.asarray(points, np.float64)
        if array.ndim == 0 or array.shape[-1] != 3:
            raise ValueError(f"points have shape {array.shape}, expected (..., 3)")
        matrix = np.array(self.board_to_tree)
        r, azimuth, height = (np.asarray(part, float) for part in cylindrical(array, matrix, self.stem))
        grown = np.maximum(r + self.distortion(r, azimuth, height), 0.0)
        table = self.ring_radius()
        beyond = np.maximum(grown - table[-1], 0.0) / self.ring_width
        age = np.interp(grown, table, np.arange(len(table), dtype=float)) + beyond
        index = np.floor(age).astype(np.int64)
        fiber = self._fiber(matrix, r, azimuth, height)
        late = self.lateness(age - index).astype(np.float32)
        # A model has no photograph behind it.
        confidence = np.zeros(age.shape, np.float32)
        return WoodSample(age, index, age - index, late, self.color(age), fiber, confidence)

    def _fiber(self, matrix: Floats, r: Floats, azimuth: Floats, height: Floats) -> npt.NDArray[np.float32]:
        """Unit vectors (..., 3) along the fibre, which stays within its growth layer."""
        step = 1e-3 * self.ring_width
        up, down, out, within = (
            self.distortion(r + dr, azimuth, height + dh) for dr, dh in ((0, step), (0, -step), (step, 0), (-step, 0))
        )
        lean = -(up - down) / np.maximum(2.0 * step + out - within, 0.1 * step)
        bend = 2.0 * height[..., None] * (self.stem[0] * matrix[0, :3] + self.stem[1] * matrix[1, :3])
        outward = np.cos(azimuth)[..., None] * matrix[0, :3] + np.sin(azimuth)[..., None] * matrix[1, :3]
        fiber = matrix[2, :3] + lean[..., None] * outward + bend
        return np.asarray(fiber / np.linalg.norm(fiber, axis=-1, keepdims=True), np.float32)

    def to_json(self, **beside: Any) -> str:
        """The parameters as indented JSON; `beside` is kept in it under ``notes``, which no reader minds."""
        document = {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(self)}
        if beside:
            document["notes"] = beside
        return json.dumps(document, indent=2)

    @classmethod
    def from_json(cls, text: str) -> LiuModel:
        """Parameters from JSON, edited or not.

        Raises
        ------
        LiuError
            When it is no JSON of this kind, or says what cannot be wood; every problem is listed.
        """
        try:
            document = json.loads(text)
        except json.JSONDecodeError as wrong:
            raise LiuError(f"no JSON: {wrong}") from None
        if not isinstance(document, dict) or document.pop("format", None) != FORMAT:
            raise LiuError(f"not the parameters of a wood: `format` is to be {FORMAT!r}")
        version = document.pop("format_version", None)
        if version != FORMAT_VERSION:
            raise LiuError(f"format version {version!r}, this woodpipe reads version {FORMAT_VERSION}")
        document.pop("notes", None)
        known = {field.name for field in fields(cls)}
        problems = [f"`{name}` is missing" for name in sorted(known - set(document))]
        problems += [f"`{name}` is not known" for name in sorted(set(document) - known)]
        if problems:
            raise LiuError("these parameters are not complete:\n" + "\n".join(f"  - {line}" for line in problems))
        try:
            waves = tuple(Wave(**{key: float(value) for key, value in wave.items()}) for wave in document.pop("waves"))
            rows = ([float(value) for value in row] for row in document.pop("board_to_tree"))
            matrix = tuple((a, b, c, d) for a, b, c, d in rows)
            rest = {name: _numbers(value) for name, value in document.items()}
        except (TypeError, ValueError, AttributeError) as wrong:
            raise LiuError(f"a number is no number: {wrong}") from None
        return cls(waves=waves, board_to_tree=matrix, **rest)


def _numbers(value: Any) -> Any:
    """A JSON value as the model holds it: lists become tuples of numbers."""
    if isinstance(value, str):
        return value
    return tuple(float(one) for one in value) if isinstance(value, list) else float(value)


def profile(fraction: Floats, latewood_ratio: float, early_slope: float, late_slope: float) -> Floats:
    """Lateness over the ring: 0, a slow rise that ends where latewood begins, 1, and a fast fall to the boundary."""
    begin = 1.0 - latewood_ratio
    rise = np.clip((fraction - begin * (1.0 - early_slope)) / max(begin * early_slope, 1e-9), 0.0, 1.0)
    fall = np.clip((1.0 - fraction) / max(latewood_ratio * late_slope, 1e-9), 0.0, 1.0)
    return np.asarray(np.minimum(rise, fall), dtype=float)


def onset(radius: Floats, fade_radius: float) -> Floats:
    """How far the distortion has set in at a radius, 0..1: around the pith azimuth means nothing."""
    return np.asarray(-np.expm1(-((radius / max(fade_radius, 1e-9)) ** 2)), dtype=float)


def _problems(model: LiuModel) -> list[str]:
    """What of the parameters cannot be wood, sorted."""
    found = []
    for name in ("latewood_ratio", "early_slope", "late_slope"):
        value = getattr(model, name)
        if not (isinstance(value, float) and 0.0 < value <= 1.0):
            found.append(f"`{name}` is {value}, expected a number above 0 and at most 1")
    if not (isinstance(model.ring_width, float) and 0.0 < model.ring_width < math.inf):
        found.append(f"`ring_width` is {model.ring_width}, expected a length above 0")
    if not all(0.0 < width < math.inf for width in model.ring_widths):
        found.append("`ring_widths` are to be above 0")
    if len(model.early_color) != 3 or not all(0.0 < part < 1.0 for part in model.early_color):
        found.append(f"`early_color` is {model.early_color}, expected three numbers above 0 and below 1")
    for name, length in (("late_exponent", 3), ("stem", 3)):
        value = getattr(model, name)
        if len(value) != length or not np.isfinite(value).all():
            found.append(f"`{name}` is {value}, expected {length} numbers")
    matrix = np.array(model.board_to_tree) if {len(row) for row in model.board_to_tree} == {4} else np.zeros(0)
    if matrix.shape != (4, 4) or not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-4):
        found.append("`board_to_tree` is to be a rigid transform, 4 x 4")
    numbers = [
        model.first_radius,
        model.fade_radius,
        *model.ring_exponents,
        *(v for w in model.waves for v in asdict(w).values()),
    ]
    if not np.isfinite(numbers).all() or model.first_radius < 0.0 or model.fade_radius < 0.0:
        found.append("radii, exponents and waves are to be finite, radii not below 0")
    return sorted(found)
