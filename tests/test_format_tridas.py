"""TRiDaS documents: the schema as judge of what we write, and nothing dangerous read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from kernel_scenes import SHARED
from ring_series_samples import assert_same, full_series, ring_series

from woodfit.dendro import tridas
from woodfit.dendro.series import FormatError, RingSeries
from woodfit.dendro.tridas import Project

SCHEMA = SHARED / "data" / "formats" / "tridas" / "tridas.xsd"
NAMESPACE = "http://www.tridas.org/1.2.2"


def document(values: str, more: str = "", radius: str = "", namespace: str = NAMESPACE) -> str:
    return (
        f'<project xmlns="{namespace}"><object><element><sample><radius>{radius}<measurementSeries>'
        f"<title>A</title>{more}{values}</measurementSeries></radius></sample></element></object></project>"
    )


def values(name: str, *numbers: object, unit: str = '<unit normalTridas="micrometres"/>') -> str:
    inner = "".join(f'<value value="{number}"/>' for number in numbers)
    return f'<values><variable normalTridas="{name}"/>{unit}{inner}</values>'


def one(text: str | bytes) -> RingSeries:
    (series,) = tridas.loads(text)
    return series


# --- reading ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("unit", "mm"),
    [("micrometres", 1e-3), ("1/100th millimetres", 1e-2), ("1/50th millimetres", 0.02), ("1/20th millimetres", 0.05),
     ("1/10th millimetres", 0.1), ("millimetres", 1), ("centimetres", 10), ("metres", 1000)],
)  # fmt: skip
def test_units_of_the_vocabulary(unit: str, mm: float) -> None:
    text = document(values("ring width", 5, "2.5", unit=f'<unit normalTridas="{unit}"/>'))
    np.testing.assert_allclose(one(text).width_mm, [5 * mm, 2.5 * mm])


@pytest.mark.parametrize(
    ("years", "first"),
    [
        ('<firstYear suffix="AD">2000</firstYear>', 2000),
        ('<lastYear suffix="AD">2001</lastYear>', 2000),
        ('<firstYear suffix="BC">1</firstYear><lastYear suffix="AD">1</lastYear>', 0),
        ('<firstYear suffix="BC">5</firstYear>', -4),
        ('<firstYear suffix="BP">100</firstYear>', 1850),
        ('<firstYear suffix="relative">7</firstYear>', None),
        ("", None),
    ],
)
def test_years_of_all_eras(years: str, first: int | None) -> None:
    text = document(values("ring width", 1, 2), f"<interpretation>{years}</interpretation>")
    assert one(text).first_year == first


def test_years_that_contradict_the_rings_are_no_date_and_it_is_said() -> None:
    years = '<firstYear suffix="AD">840</firstYear><lastYear suffix="AD">978</lastYear>'
    series = one(document(values("ring width", 1, 2), f"<interpretation>{years}</interpretation>"))
    assert series.first_year is None
    assert "840 to 978" in series.remarks[0]


def test_unit_of_an_empty_block_of_the_same_variable_counts() -> None:
    text = document(values("ring width") + values("ring width", 1000, unit="<unitless/>"))
    np.testing.assert_allclose(one(text).width_mm, [1.0])


def test_earlywood_and_latewood_without_rings_add_up() -> None:
    text = document(values("earlywood width", 700, 0) + values("latewood width", 300, 0))
    np.testing.assert_allclose(one(text).width_mm, [1.0, 0.0])


def test_wood_of_the_series_counts_before_that_of_the_radius() -> None:
    wood = '<woodCompleteness><pith presence="{}"/><bark presence="{}"/></woodCompleteness>'
    radius = wood.format("absent", "absent")
    assert one(document(values("ring width", 1), radius=radius)).bark is False
    series = one(document(values("ring width", 1), wood.format("incomplete", "present"), radius))
    assert (series.pith, series.bark) == (True, True)


def test_encoding_of_the_declaration_counts() -> None:
    text = '<?xml version="1.0" encoding="ISO-8859-1"?>' + document(values("ring width", 1)).replace(">A<", ">Kärnä<")
    assert one(text.encode("latin-1")).name == "Kärnä"
    assert one(text).name == "Kärnä"


LAUGHS = "<!ENTITY a0 'ha'>" + "".join(f"<!ENTITY a{n} '{f'&a{n - 1};' * 10}'>" for n in range(1, 12))
REFUSED = {
    "billion laughs": (f"<!DOCTYPE tridas [{LAUGHS}]>{document(values('ring width', '&a11;'))}", "document type"),
    "external entity": (f"<!DOCTYPE t [<!ENTITY x SYSTEM 'file:///etc/passwd'>]>{document('&x;')}", "document type"),
    "external subset": (f"<!DOCTYPE t SYSTEM 'http://example.org/t.dtd'>{document('')}", "document type"),
    "parameter entity": (f"<!DOCTYPE t [<!ENTITY % x SYSTEM 'x.dtd'> %x;]>{document('')}", "document type"),
    "unknown entity": (document("&x;"), "undefined entity"),
    "depth": ("<a>" * 100_000, "nested deeper than 64"),
    "depth of objects": (f'<project xmlns="{NAMESPACE}">' + "<object>" * 100, "nested deeper than 64"),
    "not closed": (f'<tridas xmlns="{NAMESPACE}">', "broken XML"),
    "empty": ("", "broken XML"),
    "encoding": (b'<?xml version="1.0" encoding="no-such"?><a/>', "an unreadable encoding"),
    "another document": ("<svg xmlns='http://www.w3.org/2000/svg'/>", "'tridas' or 'project'"),
    "another version": (document(values("ring width", 1), namespace="http://www.tridas.org/2.0"), "other versions"),
    "no series": (f'<tridas xmlns="{NAMESPACE}"/>', "no ring widths"),
    "only densities": (document(values("ring density", 1)), "['ring density']"),
    "no unit": (document(values("ring width", 1, unit="<unitless/>")), "widths without a unit"),
    "unit": (document(values("ring width", 1, unit="<unit>inch</unit>")), "the unit 'inch'"),
    "no number": (document(values("ring width", "x")), "the value 'x'"),
    "infinite": (document(values("ring width", "1e99")), "the value '1e99'"),
    "negative": (document(values("ring width", -1)), "the value '-1'"),
    "two blocks": (document(values("ring width", 1) + values("ring width", 1)), "a second block"),
    "unequal": (document(values("ring width", 1) + values("latewood width", 1, 2)), "2 values beside 1"),
    "year": (
        document(values("ring width", 1), "<interpretation><firstYear suffix='AD'>x</firstYear></interpretation>"),
        "the year 'x'",
    ),
    "era": (
        document(values("ring width", 1), "<interpretation><firstYear suffix='CE'>1</firstYear></interpretation>"),
        "the year suffix 'CE'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_dangerous_or_broken_document_is_refused_with_its_reason(case: str) -> None:
    text, reason = REFUSED[case]
    with pytest.raises(FormatError) as caught:
        tridas.loads(text, "a.xml")
    assert reason in str(caught.value)
    assert str(caught.value).startswith("a.xml")


def test_elements_are_limited() -> None:
    with pytest.raises(FormatError, match="more than 500000 elements"):
        tridas.loads("<a>" + "<b/>" * 500_001 + "</a>")


# --- writing ------------------------------------------------------------------------------------------------
def test_everything_comes_back() -> None:
    series = full_series()
    again = one(tridas.dumps([series]))
    assert_same(again, series)
    assert again.confidence is not None
    np.testing.assert_allclose(again.confidence, series.confidence, atol=1e-4)
    for field in ("name", "remarks", "pith", "bark", "pith_years", "unmeasured_outer", "pith_distance_mm"):
        assert getattr(again, field) == getattr(series, field)


@pytest.mark.parametrize("pith", [True, False, None])
@pytest.mark.parametrize("bark", [True, False, None])
def test_pith_and_bark_come_back(pith: bool | None, bark: bool | None) -> None:
    series = replace(full_series(), pith=pith, bark=bark)
    again = one(tridas.dumps([series]))
    assert (again.pith, again.bark, again.pith_years) == (pith, bark, 2)


@given(ring_series())
def test_what_is_written_is_read_again(series: RingSeries) -> None:
    assert_same(one(tridas.dumps([series])), series)


def test_series_without_rings_are_not_written() -> None:
    with pytest.raises(FormatError, match="without rings"):
        tridas.dumps([RingSeries("A", np.ones(0))])


def schema_errors(text: str) -> list[str]:
    etree = pytest.importorskip("lxml.etree", reason="lxml is not installed")
    schema = etree.XMLSchema(etree.parse(str(SCHEMA), etree.XMLParser(no_network=True)))
    schema.validate(etree.fromstring(text.encode()))
    return [entry.message for entry in schema.error_log]


@pytest.mark.shared
@pytest.mark.skipif(not SCHEMA.is_file(), reason="the schema is not here")
def test_document_is_valid_by_the_schema() -> None:
    series = [
        full_series(),
        full_series("no date", first_year=None),
        full_series("before Christ", first_year=-5),
        replace(full_series("with pith"), pith=True, bark=False),
        RingSeries('<odd> & "name" \x00\x1f', np.array([1.0])),
    ]
    project = Project("T & <Co>", "Dating", "Lab", "forestry", "A. B.", "2026", "Site", "forest", "Pinus sylvestris")
    assert schema_errors(tridas.dumps(series, project)) == []
    assert schema_errors(tridas.dumps(series)) == []
    broken = tridas.dumps(series).replace("<address/>", "")
    assert schema_errors(broken) != []
