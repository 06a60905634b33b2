"""Store: keys depend on what they should, values come back as they were, one writer at a time."""

from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
import xarray as xr

from pipeline.keys import source_key, stage_key
from pipeline.layout import Layout
from pipeline.locks import Lock
from pipeline.store import Meta, open_data, publish, read_meta, write_data

RNG = np.random.default_rng(0)
META = Meta("pose", 1, {}, {}, {})


def test_a_key_depends_on_stage_version_parameters_and_inputs_and_on_nothing_else() -> None:
    base = stage_key("pose", 1, {"a": 1.0, "b": "x"}, {"scan": "k"})
    assert base == stage_key("pose", 1, {"b": "x", "a": 1.0}, {"scan": "k"})
    others = {
        stage_key("poses", 1, {"a": 1.0, "b": "x"}, {"scan": "k"}),
        stage_key("pose", 2, {"a": 1.0, "b": "x"}, {"scan": "k"}),
        stage_key("pose", 1, {"a": 1.5, "b": "x"}, {"scan": "k"}),
        stage_key("pose", 1, {"a": 1.0, "b": "x", "c": None}, {"scan": "k"}),
        stage_key("pose", 1, {"a": 1.0, "b": "x"}, {"scan": "l"}),
        stage_key("pose", 1, {"a": 1.0, "b": "x"}, {"scan": "k", "rings": "m"}),
    }
    assert len(others) == 6
    assert base not in others
    assert source_key("a") != source_key("b")


def dataset() -> xr.Dataset:
    return xr.Dataset(
        {
            "image": (("y", "x"), RNG.random((30, 40)).astype("f4"), {"units": "mm", "long_name": "image"}),
            "wave": (("y", "x"), (RNG.random((30, 40)) + 1j).astype("c8")),
            "mask": (("y", "x"), RNG.random((30, 40)) > 0.5),
            "index": (("ring",), np.arange(-2, 3, dtype="i4")),
            "nothing": (("vertex",), np.zeros(0)),
            "unknown": ((), np.float64("nan")),
            "color": (("y", "x", "channel"), RNG.random((30, 40, 3))),
        },
        coords={"y": np.arange(30.0), "x": np.arange(40.0) * 2, "channel": ["r", "g", "b"]},
        attrs={"figures": {"rings": np.int64(5)}, "warnings": ["a"]},
    )


@pytest.mark.parametrize("chunks", [None, {"y": 7, "x": 13}])
def test_every_kind_of_value_comes_back_exactly(tmp_path: Path, chunks: dict[str, int] | None) -> None:
    ds = dataset() if chunks is None else dataset().chunk(chunks)
    write_data(ds, tmp_path)
    back = open_data(tmp_path).load()
    for name, array in ds.data_vars.items():
        assert back[name].dtype == array.dtype
        assert back[name].dims == array.dims
        npt.assert_array_equal(back[name], array)
    assert back["image"].attrs == {"units": "mm", "long_name": "image"}
    assert back.attrs == {"figures": {"rings": 5}, "warnings": ["a"]}
    assert list(back["channel"].values) == ["r", "g", "b"]


def test_what_was_read_can_be_written_again(tmp_path: Path) -> None:
    write_data(dataset(), tmp_path / "a")
    write_data(open_data(tmp_path / "a"), tmp_path / "b")
    xr.testing.assert_identical(open_data(tmp_path / "a").load(), open_data(tmp_path / "b").load())


def test_a_result_is_there_only_once_published_and_equal_values_have_equal_digests(tmp_path: Path) -> None:
    layout, ds, digests = Layout(tmp_path), dataset(), []
    for key, values in (("a", ds), ("b", ds.chunk({"y": 8})), ("c", ds + 1 * ds["image"])):
        write_data(values, layout.partial("pose", key))
        assert read_meta(layout, "pose", key) is None
        digests.append(publish(layout, "pose", key, META, {"seconds": 1}).digest)
        assert not layout.partial("pose", key).exists()
    meta = read_meta(layout, "pose", "a")
    assert meta is not None
    assert digests[0] == digests[1] != digests[2]


def test_a_published_result_can_be_replaced(tmp_path: Path) -> None:
    layout = Layout(tmp_path)
    for value in (1.0, 2.0):
        write_data(xr.Dataset({"a": ((), value)}), layout.partial("pose", "k"))
        publish(layout, "pose", "k", META, {})
    assert float(open_data(layout.result("pose", "k"))["a"]) == 2.0
    assert [path.name for path in (layout.results / "pose").iterdir()] == ["k"]


def test_no_result_names_a_path_a_host_or_a_module(tmp_path: Path) -> None:
    import socket

    layout = Layout(tmp_path)
    write_data(dataset(), layout.partial("pose", "k"))
    publish(layout, "pose", "k", META, {})
    for path in layout.result("pose", "k").rglob("*.json"):
        text = path.read_text()
        assert str(tmp_path) not in text
        assert socket.gethostname() not in text
        assert "stages." not in text


def test_a_lock_has_one_holder_and_survives_the_removal_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    first = Lock.try_acquire(path)
    assert first is not None
    assert Lock.try_acquire(path) is None
    first.release(remove=True)
    second = Lock.try_acquire(path)
    assert second is not None
    assert Lock.try_acquire(path) is None
    second.release()
    assert Lock.try_acquire(path) is not None
