"""Reading: what is in the file comes out upright and in three channels, and a bad file gets one clear line."""

from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from conftest import draw_scan, write_image

from pipeline.ingest import upright
from pipeline.probe import probe_scan
from pipeline.problems import ScanError
from pipeline.reading import read_scan
from stages.stage import check_variables
from stages.variables import DPI_PIXEL_SIZE, ENCODED, OPAQUE

PIXELS = np.random.default_rng(1).integers(0, 255, (40, 60, 3), endpoint=True).astype("u1")


def test_what_is_read_keeps_the_contract_and_carries_pixel_centres(tmp_path: Path) -> None:
    ds = read_scan(write_image(tmp_path / "a.png", PIXELS), tmp_path / "s")
    check_variables(ds, (ENCODED, OPAQUE, DPI_PIXEL_SIZE), "reading")
    npt.assert_array_equal(ds.encoded, PIXELS)
    npt.assert_array_equal(ds.x, np.arange(60.0))
    assert ds.opaque.all()
    assert np.isnan(ds.dpi_pixel_size)


def test_a_16_bit_grey_tiff_keeps_its_depth_in_three_equal_channels(tmp_path: Path) -> None:
    grey = np.random.default_rng(2).integers(0, 65535, (40, 60)).astype("u2")
    ds = read_scan(write_image(tmp_path / "a.tif", grey), tmp_path / "s")
    assert ds.encoded.dtype == "u2"
    npt.assert_array_equal(ds.encoded, np.stack([grey] * 3, axis=-1))


def test_alpha_is_split_off_and_the_colors_are_as_stored(tmp_path: Path) -> None:
    alpha = np.random.default_rng(3).integers(0, 2, (40, 60, 1)).astype("u1") * 100
    both = np.concatenate([PIXELS, alpha], axis=-1)
    ds = read_scan(write_image(tmp_path / "a.png", both, oiio__UnassociatedAlpha=1), tmp_path / "s")
    npt.assert_array_equal(ds.encoded, PIXELS)
    npt.assert_array_equal(ds.opaque, alpha[..., 0] > 0)


def test_a_gif_is_read_whatever_its_name_ends_in(tmp_path: Path) -> None:
    flat = np.where(PIXELS[..., :1] > 127, np.array([200, 150, 90]), np.array([90, 50, 20])).astype("u1")
    path = write_image(tmp_path / "a.gif", flat).rename(tmp_path / "a.png")
    ds = read_scan(path, tmp_path / "s")
    npt.assert_array_equal(ds.encoded, flat)
    assert ds.opaque.all()


def test_a_palette_png_comes_out_in_its_colors(tmp_path: Path) -> None:
    path = tmp_path / "palette.png"
    path.write_bytes(palette_png())
    ds = read_scan(path, tmp_path / "s")
    npt.assert_array_equal(ds.encoded[0, 0], [250, 10, 20])
    npt.assert_array_equal(ds.encoded[0, 1], [30, 240, 40])


def palette_png(side: int = 32) -> bytes:
    """A PNG whose columns take the two colors of its palette in turn."""
    import struct
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = (b"\0" + bytes([0, 1] * (side // 2))) * side
    header = struct.pack(">IIBBBBB", side, side, 8, 3, 0, 0, 0)
    parts = (
        (b"IHDR", header),
        (b"PLTE", bytes([250, 10, 20, 30, 240, 40])),
        (b"IDAT", zlib.compress(rows)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(kind, data) for kind, data in parts)


@pytest.mark.parametrize("lazy_pixels", [10**9, 100])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_exif_orientation_is_applied(tmp_path: Path, orientation: int, lazy_pixels: int) -> None:
    path = write_image(tmp_path / "a.tif", PIXELS, Orientation=orientation)
    ds = read_scan(path, tmp_path / "s", lazy_pixels)
    turned = {
        1: PIXELS,
        2: PIXELS[:, ::-1],
        3: PIXELS[::-1, ::-1],
        4: PIXELS[::-1],
        5: PIXELS.swapaxes(0, 1),
        6: np.rot90(PIXELS, -1),
        7: np.rot90(PIXELS, 2).swapaxes(0, 1),
        8: np.rot90(PIXELS),
    }
    npt.assert_array_equal(ds.encoded, turned[orientation])
    npt.assert_array_equal(upright(PIXELS, orientation), turned[orientation])
    assert (ds.sizes["y"], ds.sizes["x"]) == (probe_scan(path).height, probe_scan(path).width)


def test_an_exif_rotated_jpeg_is_upright(tmp_path: Path) -> None:
    ramp = np.broadcast_to(np.arange(60, dtype="u1")[None, :, None] * 4, (40, 60, 3)).copy()
    ds = read_scan(write_image(tmp_path / "a.jpg", ramp, Orientation=6), tmp_path / "s")
    assert ds.encoded.shape == (60, 40, 3)
    npt.assert_allclose(ds.encoded[..., 0].astype(int).mean("x"), np.arange(60) * 4, atol=4)


def test_a_float_image_is_encoded_to_16_bit_srgb(tmp_path: Path) -> None:
    linear = np.linspace(0, 1, 40 * 60 * 3, dtype="f4").reshape(40, 60, 3)
    ds = read_scan(write_image(tmp_path / "a.exr", linear), tmp_path / "s")
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    npt.assert_allclose(ds.encoded / 65535, encoded, atol=1e-3)


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
@pytest.mark.parametrize(("dpi", "expected"), [(1200, 25.4 / 1200), (72, np.nan), (96, np.nan)])
def test_the_resolution_gives_a_pixel_size_unless_it_is_a_screen_s(
    tmp_path: Path, name: str, dpi: float, expected: float
) -> None:
    path = write_image(tmp_path / name, PIXELS, XResolution=float(dpi), YResolution=float(dpi), ResolutionUnit="in")
    npt.assert_allclose(read_scan(path, tmp_path / "s").dpi_pixel_size, expected, rtol=1e-3)


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.jpg"])
def test_a_large_scan_is_read_in_bands_to_the_same_values(tmp_path: Path, name: str) -> None:
    path = draw_scan(tmp_path / name, 1100, 1300)
    whole, lazy = read_scan(path, tmp_path / "s"), read_scan(path, tmp_path / "t", lazy_pixels=1000)
    assert lazy.encoded.chunks is not None
    assert whole.encoded.chunks is None
    npt.assert_array_equal(lazy.encoded.values, whole.encoded.values)
    npt.assert_array_equal(lazy.opaque.values, whole.opaque.values)


def test_a_core_strip_of_20_rows_is_large_enough(tmp_path: Path) -> None:
    assert read_scan(draw_scan(tmp_path / "a.tif", 20, 300), tmp_path / "s").sizes["y"] == 20


def truncated(path: Path, share: float) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


@pytest.mark.parametrize("share", [0.3, 0.6, 0.98])
@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.jpg", "a.bmp", "a.jp2", "a.webp"])
def test_a_truncated_image_is_refused(tmp_path: Path, name: str, share: float) -> None:
    path = truncated(draw_scan(tmp_path / name, 200, 300), share)
    with pytest.raises(ScanError) as caught:
        read_scan(path, tmp_path / "s")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("lazy_pixels", [10**9, 100])
def test_a_png_that_lost_only_its_end_is_refused(tmp_path: Path, lazy_pixels: int) -> None:
    path = draw_scan(tmp_path / "a.png")
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(ScanError, match="is truncated: the PNG ends early"):
        read_scan(path, tmp_path / "s", lazy_pixels)


def bad_files(folder: Path) -> dict[str, str]:
    """Bad files and what is to be said of each."""
    (folder / "text.png").write_text("no picture\n")
    (folder / "empty.png").touch()
    write_image(folder / "one.png", np.zeros((1, 1, 3), "u1"))
    write_image(folder / "white.png", np.full((40, 40, 3), 255, "u1"))
    write_image(folder / "clear.png", np.concatenate([PIXELS, np.zeros((40, 60, 1), "u1")], axis=-1))
    (folder / "x.tif").mkdir()
    (folder / "broken.tif").symlink_to(folder / "nothing")
    return {
        "text.png": "cannot be opened as a PNG image: it is a text file",
        "empty.png": "is empty (0 bytes)",
        "one.png": "is too small: 1×1 px, at least 16 px per side are needed",
        "white.png": "is of one color everywhere: nothing to see",
        "clear.png": "is transparent everywhere: nothing to see",
        "x.tif": "is a folder, not an image",
        "broken.tif": "is a link to nothing",
    }


def test_each_bad_file_has_its_own_clear_line(tmp_path: Path) -> None:
    for name, expected in bad_files(tmp_path).items():
        with pytest.raises(ScanError) as caught:
            read_scan(tmp_path / name, tmp_path / "s")
        assert str(caught.value) == expected
