"""Every real sample file: read with the sums that other programs find, or refused with its reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from kernel_scenes import SHARED

from woodfit.dendro import coorecorder, formats
from woodfit.dendro.series import FormatError, RingSeries

FOLDER = SHARED / "data" / "formats"

# Series, first and last year of all (None: no date), sum of widths in mm.
READ = {
    "tucson/Tucson7.rwl": (21, 1670, 1978, 3771.29),
    "tucson/bcdates.rwl": (1, -384, -305, 147.23),
    "tucson/ca533.rwl": (34, 626, 1983, 9377.8),
    "tucson/co021.rwl": (35, 1176, 1963, 7374.75),
    "tucson/microns.rwl": (3, 1739, 1978, 482.05),
    "tucson/nm580.rwl": (119, -136, 2004, 19107.552),
    "tucson/nm580e.rwl": (119, -136, 2004, 15202.082),
    "tucson/nm580l.rwl": (109, -136, 2004, 3574.371),
    "tucson/wa082.rwl": (23, 1698, 1983, 4284.42),
    "pos/complex_test.pos": (1, 1849, 2021, 50.2702),
    "pos/erroneous_order.pos": (1, 1960, 2022, 54.7333),
    "pos/false_erroneous_order.pos": (1, 1903, 2022, 64.317),
    "pos/muchos_multis.pos": (1, 1999, 2022, 36.1044),
    "pos/old_file.pos": (1, None, None, 46.5897),
    "pos/simple_test.pos": (1, 1968, 2022, 27.3033),
    "pos/very_simple_seaswood_test.pos": (1, 1964, 2022, 27.2559),
    "heidelberg/SET01.FH": (16, -177, -20, 2201.81),
    "heidelberg/SET01b.FH": (16, -177, -20, 2201.81),
    "heidelberg/SET01CHR.FH": (1, -177, -20, 179.87),
    "heidelberg/SET02.FH": (24, -156, 143, 2958.09),
    "heidelberg/SET02CHR.FH": (1, -156, 143, 304.28),
    "heidelberg/SET03.FH": (29, 20, 485, 4783.8),
    "heidelberg/SET03CHR.FH": (1, 20, 485, 681.06),
    "heidelberg/SET123CH.FH": (1, -177, 485, 873.91),
    "heidelberg/SYNTH.FH": (21, 911, 1200, 2140.0),
    "heidelberg/SYNTH2.FH": (1, 911, 1010, 10.0),
    "heidelberg/UAKK0530.fh": (1, 987, 1091, 91.15),
    "heidelberg/UAKK0540.fh": (1, 999, 1076, 129.05),
    "heidelberg/UAKK0550.fh": (1, 999, 1078, 116.79),
    "heidelberg/UAKK0560.fh": (1, 1005, 1089, 120.97),
    "heidelberg/UAKK0570.fh": (1, 1003, 1086, 150.05),
    "heidelberg/Unicode-UAKK0560.fh": (1, 1005, 1089, 120.97),
    "heidelberg/bababa.fh": (1, 1001, 1022, 10.55),
    "heidelberg/commented.fh": (7, 1854, 2098, 669.38),
    "heidelberg/commenteddouble.fh": (1, 2095, 2098, 9.82),
    "heidelberg/commentedquadro.fh": (1, 2095, 2098, 9.82),
    "heidelberg/coordinates.fh": (1, 987, 1091, 91.15),
    "heidelberg/earlylatewood.fh": (1, 999, 1078, 118.78),
    "heidelberg/minimal-dated.fh": (1, 10, 19, 29.96),
    "heidelberg/minimal-reldated.fh": (1, None, None, 29.96),
    "heidelberg/minimal-undated.fh": (1, None, None, 29.96),
    "heidelberg/minimal.fh": (1, 10, 19, 29.96),
    "heidelberg/quadchron.fh": (1, -577, 34, 706.34),
    "heidelberg/singlecol.fh": (1, -81, -66, 23.56),
    "heidelberg/test.fh": (1, 987, 1091, 91.15),
    "heidelberg/treeno.FH": (1, -168, -66, 131.03),
    "tridas/Tridas1.xml": (3, -1499, 1504, 134.029),
    "tridas/Tridas2.xml": (3, 1342, 1487, 0.754),
    "tridas/TridasMultiVars.xml": (1, 1500, 1504, 3.32),
    "tridas/Utrecht.xml": (14, 830, 1066, 2068.68),
    "tridas/minimal_valid_1.2.2.xml": (1, 2000, 2002, 3.5),
}
# A part of the message, with the line where there is one.
REFUSED = {
    "tucson/cana326_error.rwl": "line 733: data of series 'NRX14A' after its end mark",
    "tucson/min.rwl": "line 1: ' 10 30' in columns 13-18; expected one integer or blanks; the columns are misaligned",
    "tucson/viet001.rwl": "line 131: 'BDF02A' for 1350-1855 after its end mark, though lines 1-22 give it 1640-1852",
    "pos/broken.pos": "0 ring borders; expected at least two",
}
NOT_SERIES = {"pos/LICENSE.md", "tridas/gmlsf.xsd", "tridas/tridas.xsd", "tridas/xlinks.xsd"}

pytestmark = [pytest.mark.shared, pytest.mark.skipif(not FOLDER.is_dir(), reason="sample files are not here")]


def sample(name: str) -> list[RingSeries]:
    return formats.read(FOLDER / name)


@pytest.mark.parametrize("name", READ)
def test_sample_is_read_with_known_counts_years_and_sum(name: str) -> None:
    count, first, last, total_mm = READ[name]
    series = sample(name)
    assert len(series) == count
    assert min((one.first_year for one in series if one.first_year is not None), default=None) == first
    assert max((one.last_year for one in series if one.last_year is not None), default=None) == last
    # Half a unit of the printed sums: a hundredth of a micrometre where the file holds whole micrometres.
    digits = 0.5e-4 if name.startswith("pos/") else 1e-5
    assert sum(np.nansum(one.width_mm) for one in series) == pytest.approx(total_mm, abs=digits + 1e-9)


@pytest.mark.parametrize("name", REFUSED)
def test_sample_is_refused_with_its_reason(name: str) -> None:
    with pytest.raises(FormatError) as caught:
        sample(name)
    assert REFUSED[name] in str(caught.value)


def test_no_sample_is_left_out() -> None:
    files = {path.relative_to(FOLDER).as_posix() for path in FOLDER.rglob("*") if path.is_file()}
    assert files == READ.keys() | REFUSED.keys() | NOT_SERIES


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("form", ["rwl", "fh", "tridas", "csv_long", "json"])
def test_sample_survives_every_format_up_to_its_unit(name: str, form: str, tmp_path: Path) -> None:
    """Widths of other programs written by us and read again: the same rings in the same years."""
    series = sample(name)
    if len({one.name for one in series}) < len(series):
        pytest.skip("equal names, which no writer takes")
    suffix, dumps = formats.FORMATS[form]
    path = tmp_path / f"again{suffix}"
    path.write_text(dumps(series), encoding="utf-8", newline="")
    again = formats.read(path)
    assert len(again) == len(series)
    for before, after in zip(series, again, strict=True):
        assert after.first_year == (1 if form == "rwl" and before.first_year is None else before.first_year)
        np.testing.assert_allclose(after.width_mm, before.width_mm, rtol=0, atol=0.0010001, equal_nan=True)
        np.testing.assert_array_equal(after.width_mm == 0, before.width_mm == 0)


@pytest.mark.parametrize(
    ("name", "rings", "gaps", "absent", "woods"),
    [
        ("complex_test", 173, 3, 1, 171),
        ("erroneous_order", 63, 0, 0, 63),
        ("false_erroneous_order", 120, 0, 0, 120),
        ("muchos_multis", 24, 0, 0, 0),
        ("old_file", 172, 1, 0, 0),
        ("simple_test", 55, 1, 0, 0),
        ("very_simple_seaswood_test", 59, 0, 0, 58),
    ],
)
def test_path_has_known_rings_cracks_and_woods(name: str, rings: int, gaps: int, absent: int, woods: int) -> None:
    (series,) = sample(f"pos/{name}.pos")
    assert len(series) == rings
    assert sum("crack" in remark for remark in series.remarks.values()) == gaps
    assert int((series.width_mm == 0).sum()) == absent
    if woods == 0:
        assert series.earlywood_mm is None
        return
    assert series.earlywood_mm is not None
    assert series.latewood_mm is not None
    both = series.earlywood_mm + series.latewood_mm
    assert int(np.isfinite(both).sum()) == woods
    np.testing.assert_allclose(both[np.isfinite(both)], series.width_mm[np.isfinite(both)], rtol=0, atol=1e-12)


@pytest.mark.parametrize("path", sorted((FOLDER / "pos").glob("*.pos")), ids=lambda path: path.stem)
def test_path_written_by_us_is_equal(path: Path) -> None:
    if f"pos/{path.name}" in REFUSED:
        pytest.skip("refused")
    measured = coorecorder.loads(formats.read_text(path), path.name)
    assert coorecorder.loads(coorecorder.dumps(measured)) == measured


def test_path_coordinates_are_whole_pixels() -> None:
    """The documented 0-based pixel frame: people click on pixels."""
    measured = coorecorder.loads(formats.read_text(FOLDER / "pos" / "complex_test.pos"))
    assert measured.dpi == 2400
    xy = coorecorder.px_from_mm(np.array([point.xy_mm for point in measured.points]), measured.dpi)
    np.testing.assert_allclose(xy, np.round(xy), rtol=0, atol=0.006)
    np.testing.assert_allclose(coorecorder.mm_from_px(xy, 2400), [point.xy_mm for point in measured.points])


def test_straight_radius_is_the_one_that_coorecorder_wrote() -> None:
    """An independent number in the file: Radius, from the first point to the pith."""
    for name in ("complex_test", "simple_test", "false_erroneous_order", "very_simple_seaswood_test"):
        measured = coorecorder.loads(formats.read_text(FOLDER / "pos" / f"{name}.pos"))
        assert measured.pith_xy_mm is not None
        radius = np.hypot(*np.subtract(measured.pith_xy_mm, measured.points[0].xy_mm))
        assert radius == pytest.approx(float(measured.key("Radius") or 0), abs=0.006)


def test_earlywood_and_latewood_files_join_to_the_ring_file() -> None:
    from woodfit.dendro import tucson

    rings, early, late = (sample(f"tucson/nm580{part}.rwl") for part in ("", "e", "l"))
    joined = tucson.join_woods(rings, early, late)
    both = [one for one in joined if one.earlywood_mm is not None and one.latewood_mm is not None]
    off = np.concatenate([one.earlywood_mm + one.latewood_mm - one.width_mm for one in both])
    off = off[np.isfinite(off)]
    assert len(off) > 30_000
    assert np.mean(np.abs(off) < 0.0015) > 0.9995
    for split, file in ((tucson.earlywood(joined), early), (tucson.latewood(joined), late)):
        names = {one.name: one for one in file}
        assert all(len(one) <= len(names[one.name]) for one in split)


def test_absent_ring_of_the_data_bank_is_no_negative_width() -> None:
    """-999 of series 712011 in 1900: a reader that takes it for a width is 9.99 mm off."""
    series = {one.name: one for one in sample("tucson/wa082.rwl")}["712011"]
    assert np.isnan(series.width_mm[1900 - series.years[0]])
    assert np.isnan(series.width_mm).sum() == 1
