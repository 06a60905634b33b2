"""Reading a scan as labelled arrays: upright, three channels, alpha apart, with its scale if it tells one.

Small scans are read whole. Large ones are ingested once, band by band in file order, into an uncompressed
scratch store and come back as dask arrays on it: every format can be read in order, few can be read at random.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.ingest import MemoryTarget, ScratchTarget, Target
from pipeline.probe import check_file, check_spec, one_line, open_image
from pipeline.problems import ScanError

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from numpy.typing import NDArray

READER_VERSION = 1
LAZY_PIXELS = 32_000_000
BAND = 1024
SCREEN_DPI = (72.0, 96.0)
MM_PER_UNIT = {"in": 25.4, "inch": 25.4, "inches": 25.4, "cm": 10.0, "m": 1000.0, "mm": 1.0}
UNIFORM_SHARE = 2.5 / 255


def read_scan(path: Path, scratch: Path, lazy_pixels: int = LAZY_PIXELS) -> xr.Dataset:
    """Read a scan as `encoded` (y, x, channel), `opaque` (y, x) and `dpi_pixel_size`.

    Parameters
    ----------
    path
        The image file.
    scratch
        An empty or absent folder that outlives the returned dataset; used only for large scans.
    lazy_pixels
        Scans of more pixels come back as dask arrays.

    Raises
    ------
    ScanError
        With one line that says what is wrong with the file.
    """
    import numpy as np
    import xarray as xr

    from stages.variables import DPI_PIXEL_SIZE, ENCODED, OPAQUE

    check_file(path)
    source = _Source.open(path)
    stored = (source.spec.height, source.spec.width)
    large = stored[0] * stored[1] > lazy_pixels
    target: Target = (
        ScratchTarget(scratch, stored, source.dtype, source.orientation)
        if large
        else MemoryTarget(stored, source.dtype, source.orientation)
    )
    spread = _Spread()
    for row, encoded, opaque in source.bands():
        spread.add(encoded, opaque)
        target.write(row, encoded, opaque)
    spread.check(source.dtype)
    encoded, opaque = target.arrays()
    coords = {"y": np.arange(encoded.shape[0], dtype=float), "x": np.arange(encoded.shape[1], dtype=float)}
    arrays = {
        ENCODED.name: ENCODED.array(encoded),
        OPAQUE.name: OPAQUE.array(opaque),
        DPI_PIXEL_SIZE.name: DPI_PIXEL_SIZE.array(np.float64(pixel_size_mm(source.spec))),
    }
    return xr.Dataset(arrays, coords=coords)


def pixel_size_mm(spec: Any) -> float:
    """Pixel size from the resolution tags, mm; NaN without, and for the 72 and 96 dpi that mean nothing."""
    x = spec.get_float_attribute("XResolution", 0.0)
    y = spec.get_float_attribute("YResolution", 0.0) or x
    mm = MM_PER_UNIT.get(spec.get_string_attribute("ResolutionUnit", "none"), 0.0)
    if x <= 0 or not mm or abs(x - y) > 0.01 * x:
        return float("nan")
    dpi = x * 25.4 / mm
    if dpi < 10 or any(abs(dpi - screen) < 0.5 for screen in SCREEN_DPI):
        return float("nan")
    return float(mm / x)


@dataclass(frozen=True)
class _Source:
    """An open image and how its channels become RGB and alpha."""

    image: Any
    spec: Any
    dtype: str
    linear: bool
    colors: tuple[int, ...]
    alpha: int
    orientation: int

    @classmethod
    def open(cls, path: Path) -> _Source:
        image = open_image(path)
        spec = image.spec()
        check_spec(spec)
        kind = str(spec.format)
        space = spec.get_string_attribute("oiio:ColorSpace", "")
        # Of a GIF, OpenImageIO says that alpha comes after the last channel (3.2), but names it rightly.
        named = [index for index, name in enumerate(spec.channelnames) if name == "A"]
        alpha = spec.alpha_channel if spec.alpha_channel < spec.nchannels else (named or [-1])[0]
        colors = [index for index in range(spec.nchannels) if index != alpha] or [0]
        return cls(
            image=image,
            spec=spec,
            dtype="uint8" if kind == "uint8" else "uint16",
            linear=kind in ("half", "float", "double") and "srgb" not in space.lower(),
            colors=tuple(colors[:3]) if len(colors) >= 3 else (colors[0],) * 3,
            alpha=alpha,
            orientation=min(max(int(spec.get_int_attribute("Orientation", 1)), 1), 8),
        )

    def bands(self) -> Iterator[tuple[int, NDArray[Any], NDArray[np.bool_]]]:
        """Yield bands in file order: first row, RGB as stored, and where there is something."""
        import numpy as np

        step = BAND
        if self.spec.tile_width:
            step = max(BAND // self.spec.tile_height, 1) * self.spec.tile_height
        for y in range(0, self.spec.height, step):
            pixels = self._read(y, min(y + step, self.spec.height))
            rgb = pixels[..., self.colors]
            encoded = rgb if not self.linear else encode_srgb16(rgb)
            opaque = pixels[..., self.alpha] > 0 if self.alpha >= 0 else np.ones(rgb.shape[:2], bool)
            yield y, np.ascontiguousarray(encoded), opaque

    def _read(self, y0: int, y1: int) -> NDArray[Any]:
        spec, image = self.spec, self.image
        kind = "float" if self.linear else self.dtype
        if spec.tile_width:
            pixels = image.read_tiles(
                spec.x, spec.x + spec.width, spec.y + y0, spec.y + y1, spec.z, spec.z + 1, 0, spec.nchannels, kind
            )
        else:
            pixels = image.read_scanlines(spec.y + y0, spec.y + y1, spec.z, 0, spec.nchannels, kind)
        if pixels is None or image.has_error:
            reason = one_line(image.geterror()) or f"no data for rows {y0} to {y1 - 1}"
            raise ScanError(f"is truncated or damaged: {reason}")
        shaped: NDArray[Any] = pixels.reshape(y1 - y0, spec.width, spec.nchannels)
        return shaped


def encode_srgb16(linear: NDArray[Any]) -> NDArray[np.uint16]:
    """Encode linear RGB by the sRGB curve to 16 bit; out of 0..1 and NaN are clipped."""
    import numpy as np

    clipped = np.clip(np.nan_to_num(linear, nan=0.0), 0.0, 1.0)
    curve = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return np.asarray(np.round(curve * 65535), dtype=np.uint16)


class _Spread:
    """Least and greatest value seen of each channel where the scan is opaque."""

    def __init__(self) -> None:
        self.low: list[int] = []
        self.high: list[int] = []

    def add(self, encoded: NDArray[Any], opaque: NDArray[np.bool_]) -> None:
        seen = encoded if opaque.all() else encoded[opaque]
        if seen.size:
            axes = tuple(range(seen.ndim - 1))
            low, high = seen.min(axes).tolist(), seen.max(axes).tolist()
            self.low = [min(pair) for pair in zip(self.low or low, low, strict=True)]
            self.high = [max(pair) for pair in zip(self.high or high, high, strict=True)]

    def check(self, dtype: str) -> None:
        if not self.low:
            raise ScanError("is transparent everywhere: nothing to see")
        span = max(high - low for low, high in zip(self.low, self.high, strict=True))
        if span <= UNIFORM_SHARE * (255 if dtype == "uint8" else 65535):
            raise ScanError("is of one color everywhere: nothing to see")
