"""Damaged files of every format: read, or refused by `FormatError`; nothing else may come out, also when writing."""

from __future__ import annotations

import contextlib
import random
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from kernel_scenes import SHARED
from ring_series_samples import full_series

from woodfit.dendro import coorecorder, formats, heidelberg, series_json, series_tables, tridas, tucson
from woodfit.dendro.path_widths import PathPoint
from woodfit.dendro.series import FormatError, RingSeries
from woodfit.dendro.text import decode
from woodfit.dendro.tucson_header import TucsonHeader

SERIES = [
    full_series("A"),
    full_series("B", -1005),
    full_series("C", 1999),
    RingSeries("D", np.linspace(0.01, 4, 120), 1850, unmeasured_outer=2),
]
POINTS = [
    PathPoint(
        (50.0 - index, 7.5), (50.0 - index, 9.25) if index % 7 == 3 else None, label="x" if index % 5 == 1 else ""
    )
    for index in range(40)
]
POINTS[9] = replace(POINTS[9], zeros=2)
POINTS[20:20] = [PathPoint((30.9, 7.5), kind="gap"), PathPoint((30.5, 7.5), kind="gap", label="crack")]
POINTS.append(PathPoint((45.7, 7.5), kind="latewood"))
PATH = coorecorder.MeasuredPath(
    tuple(POINTS), "a.png", 1200.0, 2021, ("1980 LA",), {"PithCoordinates": "1.5,2.5", "DistanceToPith": "0.4"}, "a.pos"
)
PAIRS = (
    "HEADER:\nKeyCode=P\nLength=3\nDateEnd=1000\nDataType=EarlyLateWood\nUnit=1/10 mm\nDATA:Double\n"
    "10 2 20 3 30 4 0 0\n"
    "HEADER:\nKeyCode=Q\nDateBegin=-8\nDateEnd=-7\nDATA:Chrono\n   46    1    0    0  149    2    1    0\n"
)
HEADER = TucsonHeader("F02", "Forest", "PISY", "Finland", "Scots pine", "320M", "6700-2707")

Read = Callable[[bytes], list[RingSeries]]
WRITERS = [dumps for _, dumps in formats.FORMATS.values()]
FORMATS: dict[str, tuple[Read, list[str]]] = {
    "rwl": (
        lambda data: tucson.loads(decode(data, "f")),
        [tucson.dumps(SERIES), tucson.dumps(SERIES, 0.001, HEADER), tucson.dumps(SERIES[:1]).replace("  ", "\t")],
    ),
    "pos": (lambda data: [coorecorder.loads(decode(data, "f")).series("f")], [coorecorder.dumps(PATH)]),
    "fh": (
        lambda data: heidelberg.loads(decode(data, "f")),
        [heidelberg.dumps(SERIES), heidelberg.dumps(SERIES[3:], 0.01), PAIRS],
    ),
    "xml": (lambda data: tridas.loads(data, "f"), [tridas.dumps(SERIES[:2]), tridas.dumps(SERIES[3:])]),
    "csv": (
        lambda data: series_tables.loads_csv(decode(data, "f")),
        [series_tables.dumps_wide(SERIES, woods=True), series_tables.dumps_long(SERIES)],
    ),
    "json": (lambda data: series_json.loads(decode(data, "f")), [series_json.dumps(SERIES)]),
}
FOLDERS = {"rwl": "tucson", "pos": "pos", "fh": "heidelberg", "xml": "tridas"}
LARGEST_SAMPLE = 40_000

HUGE = [
    b"9" * 12, b"9" * 5000, b"-99999", b"1e308", b"1e-400", b"nan", b"inf", b"0x10", b"1_0", b"-0", b"+5", b"999",
    b"-9999", b"-999",
]  # fmt: skip
ODD = [
    b"\0", b"\xff\xfe", b"\r", b"\r\r\n", b"\t", b"\x1a", b"#", b"#ZERO999999999 ", b"Length=1000000000\n", b";;;",
    b"=", b'"', b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"&b;", b"<![CDATA[", b"]]>", b"<object>", b"\xc2\xb2",
    b"\xd9\xa3", b"HEADER:\n", b"DATA:Tree\n", b"D1,2 #W#\r\n", b"D1,2 #%gap\r\n",
    b"ABCDEFG-1234     1   999\n", b"[", b"{}", b"null",
]  # fmt: skip


def damaged(data: bytes, other: bytes, chance: random.Random) -> bytes:
    """One damage, often, or up to four: bytes, numbers, lines, cuts, pieces of another file, repetition, nesting."""
    for _ in range(chance.choice([1, 1, 1, 2, 3, 4])):
        at = chance.randrange(len(data) + 1)
        to = min(len(data), at + chance.choice([1, 6, 40, 400]))
        lines = data.split(b"\n")
        one, two = chance.randrange(len(lines)), chance.randrange(len(lines))
        match chance.randrange(11):
            case 0:
                data = data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :]
            case 1:
                data = data[:at]
            case 2:
                data = data[:at] + data[to:]
            case 3:
                data = data[:at] + other[chance.randrange(len(other)) :]
            case 4:
                lines[one], lines[two] = lines[two], lines[one]
                data = b"\n".join(lines)
            case 5:
                lines[one : one + 1] = [lines[two]] * chance.choice([0, 2, 300])
                data = b"\n".join(lines)
            case 6:
                numbers = list(re.finditer(rb"-?[0-9.]+", data)) or [re.match(b"", data)]
                number = chance.choice(numbers)
                if number is not None:
                    data = data[: number.start()] + chance.choice(HUGE) + data[number.end() :]
            case 7:
                data = data[:at] + chance.choice(ODD) * chance.choice([1, 1, 2, 3000]) + data[at:]
            case 8:
                data = data[:at] + data[at:to] * chance.choice([2, 30]) + data[to:]
            case 9:
                data = data[:at] + bytes(chance.randrange(256) for _ in range(8)) + data[at:]
            case _:
                data = data[:at] + chance.choice([b" ", b"\n", b"-"]) + data[at:]
        data = data[:400_000]
    return data


def fuzz(name: str, samples: list[bytes], count: int, seed: int) -> tuple[int, int]:
    """Read damaged samples; how many were read, how many refused."""
    read, _ = FORMATS[name]
    chance = random.Random(seed)
    accepted = refused = 0
    for _ in range(count):
        data = damaged(chance.choice(samples), chance.choice(samples), chance)
        try:
            series = read(data)
        except FormatError as refusal:
            refused += 1
            assert "expected" in str(refusal), data[:200]  # noqa: PT017
            continue
        accepted += 1
        with contextlib.suppress(FormatError):
            chance.choice(WRITERS)(series)
    return accepted, refused


def written(name: str) -> list[bytes]:
    return [text.encode() for text in FORMATS[name][1]]


@pytest.mark.parametrize("name", FORMATS)
def test_the_undamaged_files_are_read(name: str) -> None:
    for data in written(name):
        assert FORMATS[name][0](data)


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files_are_read_or_refused(name: str) -> None:
    accepted, refused = fuzz(name, written(name), 500, seed=1)
    # Both ways are taken, or the damage is too weak or too strong to tell anything.
    assert min(accepted, refused) > 10


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_ten_thousand_damaged_files_are_read_or_refused(name: str) -> None:
    folder = SHARED / "data" / "formats" / FOLDERS.get(name, "none")
    real = [path.read_bytes() for path in sorted(folder.glob(f"*.{name}"), key=str) + sorted(folder.glob("*.FH"))]
    samples = written(name) + [data for data in real if len(data) < LARGEST_SAMPLE]
    assert min(fuzz(name, samples, 10_000, seed=2)) > 200


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    "unit", [b"\r", b"\n", b" ", b"-", b"9", b"#", b"<", b"<a>", b'"', b",", b";", b"[", b"=", b"\xe9", b"a 1 "]
)
def test_a_megabyte_of_one_sign_is_refused(name: str, unit: bytes) -> None:
    """Quadratic parsing would not end."""
    with pytest.raises(FormatError):
        FORMATS[name][0](unit * (1_000_000 // len(unit)))
