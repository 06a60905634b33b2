"""Reading what the fine grain is fitted to: windows of the photograph, on lines along and across the grain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.fine_grain_measure import LineSamples
from woodfit.grain_spectrum import LENGTHS, Lines, grain_angle, place_lines
from woodfit.planes import Planes
from woodfit.solid_texture import SolidTexture

Array = npt.NDArray[Any]

#: Spacing of the places at which the direction of the grain is asked for, px.
_ANGLE_STEP = 8

#: Fewest lines of a direction that its spectrum can be told from.
_FEWEST = 20

#: The second two only where the grain runs off the axes.
_DIRECTIONS = ("along", "across", "x", "y")

#: Where the grain runs within this angle of the image's axes (rad), lines along them would tell nothing new.
_UPRIGHT = 0.04


def read_lines(
    texture: SolidTexture,
    windows: npt.NDArray[np.float32],
    valid: npt.NDArray[np.bool_],
    corner_x: Array,
    corner_y: Array,
    planes: Planes,
    most: int = 350,
) -> list[LineSamples]:
    """Lines along and across the grain, and along the image's axes, on end grain and on faces along the stem.

    Parameters
    ----------
    texture : SolidTexture
        The texture whose colors are compared with the photograph's.
    windows : float32 array of shape (P, M, N, 3)
        Linear RGB of windows of the photograph, at its own resolution.
    valid : bool array of shape (P, M, N)
        The wood in them.
    corner_x, corner_y : arrays of shape (P,)
        Scan px of the windows' first pixels.
    planes : Planes
        Where the faces lie.
    most : int
        About how many lines of each direction.

    Returns
    -------
    list of LineSamples
        Up to eight directions; only those with enough lines. The color map's brightness is brought to each face's.
    """
    views = [
        _View(texture, planes, window, inside, float(x), float(y))
        for window, inside, x, y in zip(windows, valid, corner_x, corner_y, strict=True)
    ]
    found = []
    for end_grain in (False, True):
        chosen = [view for view in views if view.end_grain == end_grain]
        if not chosen:
            continue
        angles = [[view.angle, view.angle + 0.5 * np.pi] for view in chosen]
        off_axis = np.concatenate([np.abs(np.sin(2.0 * view.angle[view.valid])) for view in chosen])
        if off_axis.size and off_axis.mean() > np.sin(2.0 * _UPRIGHT):
            # Where the grain bends, or is not where the model has it, the axes hold the whole picture to account.
            for two, view in zip(angles, chosen, strict=True):
                two += [np.zeros_like(view.angle), np.full_like(view.angle, 0.5 * np.pi)]
        share = max(1, most // len(chosen))
        for name, direction in zip(_DIRECTIONS, zip(*angles, strict=True), strict=False):
            for length in LENGTHS:
                placed = [place_lines(v.valid, a, share, length) for v, a in zip(chosen, direction, strict=True)]
                if sum(len(lines.x) for lines in placed) >= _FEWEST:
                    found.append(_joined(chosen, placed, name, end_grain))
                    break
    return found


def known_in_windows(
    opaque: npt.NDArray[np.bool_], corner_x: Array, corner_y: Array, sound: npt.NDArray[np.bool_], step: int
) -> npt.NDArray[np.bool_]:
    """The sound wood in windows (P, M, N): opaque there, and within a mask (H, W) of the analysed grid.

    `corner_x` and `corner_y` (P,) are scan px of the windows' first pixels, `step` the scan px per mask element.
    """
    known = opaque.copy()
    for one, left, top in zip(known, corner_x, corner_y, strict=True):
        rows = (int(top) + np.arange(one.shape[0])) // step
        columns = (int(left) + np.arange(one.shape[1])) // step
        inside = np.ix_(np.minimum(rows, len(sound) - 1), np.minimum(columns, sound.shape[1] - 1))
        one &= sound[inside]
        # What a reduction leaves over at the lower and right edges was not analysed.
        one[rows >= len(sound)] = False
        one[:, columns >= sound.shape[1]] = False
    return known


class _View:
    """One window of a photograph, and where it lies in the tree."""

    def __init__(
        self,
        texture: SolidTexture,
        planes: Planes,
        window: npt.NDArray[np.float32],
        valid: npt.NDArray[np.bool_],
        left: float,
        top: float,
    ) -> None:
        self._texture, self._planes, self._window = texture, planes, window
        self._left, self._top, self.valid = left, top, valid
        rows, columns = valid.shape
        self.face = int(planes.face_of(np.array([top + 0.5 * rows]))[0])
        half = 0.5 * (_ANGLE_STEP - 1)
        y, x = np.mgrid[half : rows + half : _ANGLE_STEP, half : columns + half : _ANGLE_STEP]
        place = texture.place(planes.lift(x.ravel() + left, y.ravel() + top))
        plane = planes.plane[self.face]
        angle, end = grain_angle(place.fiber, place.outward, plane[1], plane[2])
        self.end_grain = bool(end.mean() > 0.5)
        fine = angle.reshape(x.shape).repeat(_ANGLE_STEP, axis=0).repeat(_ANGLE_STEP, axis=1)
        self.angle = fine[:rows, :columns]

    def samples(self, lines: Lines, direction: str) -> LineSamples:
        """What lines of this window show."""
        shape = lines.x.shape
        points = self._planes.lift(
            lines.x.ravel().astype(np.float64) + self._left, lines.y.ravel().astype(np.float64) + self._top
        )
        place = self._texture.place(points)
        wood = self._texture.evaluate(points * (self._texture.pixel_size or 1.0), detail=False)
        photo = np.maximum(lines.read(self._window), 0.0)
        base, late = wood.rgb.reshape(*shape, 3), wood.lateness.reshape(shape)
        radius, azimuth, height = self._texture.fiber_radius(place), place.azimuth, place.height
        return LineSamples(
            photo,
            base,
            late,
            radius.reshape(shape),
            azimuth.reshape(shape),
            height.reshape(shape),
            direction,
            self.end_grain,
        )


def _joined(views: list[_View], placed: list[Lines], direction: str, end_grain: bool) -> LineSamples:
    """Lines of all windows, with the brightness of each face's color map brought to its photograph's."""
    parts = []
    for face in sorted({view.face for view in views}):
        own = [
            view.samples(lines, direction)
            for view, lines in zip(views, placed, strict=True)
            if view.face == face and len(lines.x) > 0
        ]
        if own:
            lines = _row(own, direction, end_grain)
            gain = lines.photo.mean(axis=(0, 1)) / np.maximum(lines.base.mean(axis=(0, 1)), 1e-6)
            parts.append(replace(lines, base=lines.base * gain))
    return _row(parts, direction, end_grain)


def _row(parts: list[LineSamples], direction: str, end_grain: bool) -> LineSamples:
    return LineSamples(
        np.concatenate([part.photo for part in parts]),
        np.concatenate([part.base for part in parts]),
        np.concatenate([part.lateness for part in parts]),
        np.concatenate([part.radius for part in parts]),
        np.concatenate([part.azimuth for part in parts]),
        np.concatenate([part.height for part in parts]),
        direction,
        end_grain,
    )
