"""What the sections take from the dataset: images at the size of a screen, in the frame of the photograph."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from pipeline.report.pictures import LONGER_SIDE, Bytes, block_mean, fit, srgb_bytes
from pipeline.report.sheet import BlockView
from stages.faces import UNIT
from stages.stage import Variable
from stages.variables import ENCODED, FACE_PLANE, PIXEL_SIZE, RGB, VALID

Array = npt.NDArray[Any]

_LONGEST_SIDE = 4000


@dataclass(frozen=True)
class Frame:
    """Extent of the image arrays, px of the scan.

    Parameters
    ----------
    left, top
        Outer edges of the first pixel; -0.5 for a whole scan.
    width, height
        Extent.
    step
        Scan px per array element.
    """

    left: float
    top: float
    width: float
    height: float
    step: float


@dataclass
class Scan:
    """A dataset with what every section asks of it.

    Parameters
    ----------
    ds
        Merged results of the stages.
    block
        Where the faces lie, when they are a block's; its images then are those of the sheet.
    """

    ds: xr.Dataset
    block: BlockView | None = None
    _kept: dict[str, Array] = field(default_factory=dict)

    def has(self, *variables: Variable) -> bool:
        """Whether all these were computed."""
        return all(variable.name in self.ds for variable in variables)

    def values(self, variable: Variable) -> Array:
        """Whole array of a small variable."""
        return np.asarray(self.ds[variable.name].values)

    @property
    def pixel_size(self) -> float | None:
        """Millimetres, or units of the block, per scan px, if known."""
        if not self.has(PIXEL_SIZE):
            return None
        size = float(self.values(PIXEL_SIZE))
        return size if np.isfinite(size) and size > 0 else None

    @property
    def unit(self) -> str:
        """What lengths are in when the size of a px is known."""
        return str(self.ds[FACE_PLANE.name].attrs.get(UNIT, "") if self.has(FACE_PLANE) else "") or "mm"

    @property
    def frame(self) -> Frame | None:
        """Where the images lie; ``None`` without any image."""
        name = next((v.name for v in (RGB, ENCODED) if v.name in self.ds), None)
        if name is None:
            name = next((str(n) for n, a in self.ds.data_vars.items() if {"y", "x"} <= set(a.dims)), None)
        if name is None:
            return None
        array = self.ds[name]
        rows, columns = array.sizes["y"], array.sizes["x"]
        y = np.asarray(array["y"].values, float) if "y" in array.coords else np.arange(rows, dtype=float)
        x = np.asarray(array["x"].values, float) if "x" in array.coords else np.arange(columns, dtype=float)
        steps = [float(axis[1] - axis[0]) for axis in (x, y) if len(axis) > 1]
        step = steps[0] if steps else 1.0
        return Frame(float(x[0]) - step / 2, float(y[0]) - step / 2, columns * step, rows * step, step)

    @property
    def longer(self) -> int:
        """Longer side of the pictures, px: strips get more, for the same number of pixels in all."""
        frame = self.frame
        if frame is None:
            return LONGER_SIDE
        slender = max(frame.width, frame.height) / min(frame.width, frame.height)
        return min(_LONGEST_SIDE, round(LONGER_SIDE * math.sqrt(max(1.0, slender / 1.5))))

    def image(self, variable: Variable, longer: int | None = None) -> Array:
        """An image shrunk by averaging, (H, W) or (H, W, 3), float32 or complex64."""
        if variable.name not in self._kept:
            array = self.ds[variable.name]
            self._kept[variable.name] = fit(block_mean(array, self._stride(array)), self.longer)
        return fit(self._kept[variable.name], self.longer if longer is None else longer)

    def combined(self, names: Iterable[Variable], combine: Any) -> Array:
        """Combine several images at their full resolution, band by band, then shrink the result by averaging."""
        arrays = [self.ds[variable.name] for variable in names]
        step = self._stride(arrays[0])
        rows = 256 * step
        bands = []
        for top in range(0, arrays[0].sizes["y"], rows):
            parts = [np.asarray(array[top : top + rows].values) for array in arrays]
            bands.append(block_mean(combine(*parts), step))
        return fit(np.concatenate(bands), self.longer)

    def photograph(self, longer: int | None = None) -> Bytes | None:
        """The photograph as sRGB bytes (H, W, 3)."""
        if self.has(RGB):
            return srgb_bytes(self.image(RGB, longer))
        if self.has(ENCODED):
            top = np.iinfo(self.ds[ENCODED.name].dtype).max
            return np.asarray(np.clip(self.image(ENCODED, longer) * (255.0 / top) + 0.5, 0, 255)).astype(np.uint8)
        return None

    def wood(self, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
        """Where there is wood, as a mask of an image of that shape."""
        if not self.has(VALID):
            return np.ones(shape[:2], dtype=bool)
        mask = self.image(VALID) > 0.5
        return mask if mask.shape == shape[:2] else np.ones(shape[:2], dtype=bool)

    def _stride(self, array: xr.DataArray) -> int:
        return max(1, max(array.sizes["y"], array.sizes["x"]) // self.longer)
