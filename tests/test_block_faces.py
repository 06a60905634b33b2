"""Joining faces: one face is left as it is, and nothing of several is lost or mixed up."""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from stages import variables as v
from stages.faces import GAP_ROWS, Faces, FacesError, companions, join_faces, single_face
from stages.stage import Variable
from woodfit.planes import Planes

SQUARE = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def face(rows: int, columns: int, seed: int, step: int = 1, rings: int = 3, **scalars: Any) -> xr.Dataset:
    """Results of a face, every value its own."""
    rng = np.random.default_rng(seed)
    count = rng.integers(2, 6, rings)
    plain = {
        v.PIXEL_SIZE: np.nan,
        v.REDUCTION: step,
        v.RING_SCALE: 10.0 + seed,
        v.GRAIN_RATIO: 1.0 + seed,
        v.GROWTH_SURENESS: 0.6,
        v.BRIGHT_OUTWARDS: bool(seed % 2),
        v.FACE_PITH_X: 3.0,
        v.RING_X: rng.uniform(0, columns * step, count.sum()),
        v.RING_Y: rng.uniform(0, rows * step, count.sum()),
        v.VERTEX_COUNT: count,
        v.RING_INDEX: np.arange(rings),
        v.RING_GROUP: np.arange(rings) % 2,
        v.CROSSING_GROUP: np.arange(rings) % 2,
        v.MEASURE_Y: rng.uniform(0, rows, (4, 2)),
        v.SERIES_KIND: np.arange(2),
        v.GAP_SERIES: np.array([0, 1, 1]),
        v.ANOMALY_BOX: np.array([[1.0, 2.0, 3.0, 4.0]]),
    }
    images = {
        v.VALUE: rng.random((rows, columns)).astype("f4"),
        v.VALID: rng.random((rows, columns)) > 0.2,
        v.RGB: rng.random((rows, columns, 3)).astype("f4"),
        v.RESPONSE: rng.random((rows, columns)).astype("c8"),
    }
    values = {**images, **plain, **{getattr(v, name): value for name, value in scalars.items()}}
    coords = {"y": np.arange(rows) * step + (step - 1) / 2, "x": np.arange(columns) * step + (step - 1) / 2}
    ds = xr.Dataset({variable.name: variable.array(value) for variable, value in values.items()}, coords=coords)
    ds[v.RING_X.name].attrs["sample_dimension"] = "vertex"
    return ds


def faces_of(*sizes: tuple[int, int], scale: float = 1.0) -> Faces:
    """Faces lying side by side; every one after the first with `scale` px of the block per px."""
    others = (((0.0, 0.0, 9.0 * n), (scale, 0.0, 0.0), (0.0, scale, 0.0)) for n in range(1, len(sizes)))
    return Faces((SQUARE, *others), sizes, 0.25, "inch")


def test_one_face_is_left_as_it_is_but_for_its_unit() -> None:
    part = face(20, 30, 0)
    joined = join_faces([part], faces_of((30, 20)))
    rest = joined.drop_vars([v.FACE_PLANE.name, v.FACE_TOP.name, v.PIXEL_SIZE.name])
    xr.testing.assert_identical(rest, part.drop_vars(v.PIXEL_SIZE.name))
    assert float(joined[v.PIXEL_SIZE.name]) == 0.25
    bare = joined[[v.FACE_PLANE.name, v.FACE_TOP.name]]
    xr.testing.assert_equal(bare, single_face())
    assert bare[v.FACE_PLANE.name].attrs["block_unit"] == "inch"
    assert single_face()[v.FACE_PLANE.name].attrs["block_unit"] == ""


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(st.integers(8, 30), st.integers(8, 30)), min_size=2, max_size=4),
    st.integers(1, 3),
    st.booleans(),
)
def test_every_face_is_found_again_where_its_top_says(sizes: list[tuple[int, int]], step: int, is_lazy: bool) -> None:
    parts = [face(h // step, w // step, seed, step, rings=seed) for seed, (w, h) in enumerate(sizes)]
    given_parts = [part.chunk(y=5, x=5) for part in parts] if is_lazy else parts
    joined = join_faces(given_parts, faces_of(*sizes))
    assert bool(joined[v.RGB.name].chunks) == is_lazy
    y, tops = joined.coords["y"].values, joined[v.FACE_TOP.name].values
    np.testing.assert_allclose(np.diff(y), step)
    covered = np.zeros(joined[v.VALID.name].shape, bool)
    first_vertex = 0
    for part, top in zip(parts, tops, strict=True):
        row = int(np.flatnonzero(y == part.coords["y"].values[0] + top)[0])
        window = {"y": slice(row, row + part.sizes["y"]), "x": slice(0, part.sizes["x"])}
        for name in ("value", "valid", "rgb", "response"):
            np.testing.assert_array_equal(joined[name].isel(window).values, part[name].values)
            assert joined[name].dtype == part[name].dtype
            assert joined[name].attrs == part[name].attrs
        assert not covered[window["y"]].any()
        covered[window["y"], window["x"]] = True
        vertices = slice(first_vertex, first_vertex + part.sizes["vertex"])
        first_vertex += part.sizes["vertex"]
        np.testing.assert_array_equal(joined[v.RING_X.name].values[vertices], part[v.RING_X.name].values)
        np.testing.assert_allclose(joined[v.RING_Y.name].values[vertices] - top, part[v.RING_Y.name].values)
    for name in ("value", "valid", "rgb", "response"):
        assert not joined[name].values[~covered].any()
    assert joined[v.RING_X.name].attrs["sample_dimension"] == "vertex"
    rows_between = np.diff(np.flatnonzero(covered.any(axis=1)))
    assert (rows_between > GAP_ROWS).sum() == len(sizes) - 1


def test_places_on_the_atlas_are_lifted_to_the_face_they_came_from() -> None:
    sizes = ((30, 20), (12, 16), (30, 9))
    parts = [face(h, w, seed) for seed, (w, h) in enumerate(sizes)]
    joined = join_faces(parts, faces_of(*sizes))
    planes = Planes(joined[v.FACE_PLANE.name].values, joined[v.FACE_TOP.name].values)
    x, y = joined[v.RING_X.name].values, joined[v.RING_Y.name].values
    lifted = planes.lift(x, y)
    expected = np.concatenate(
        [
            np.column_stack([part.ring_x, part.ring_y, np.full(part.sizes["vertex"], 9.0 * number)])
            for number, part in enumerate(parts)
        ]
    )
    np.testing.assert_allclose(lifted, expected)


def test_groups_and_series_of_different_faces_stay_apart() -> None:
    sizes = ((10, 10), (10, 10), (10, 10))
    parts = [face(10, 10, 0), face(10, 10, 1, rings=0), face(10, 10, 2)]
    joined = join_faces(parts, faces_of(*sizes))
    assert joined[v.RING_GROUP.name].values.tolist() == [0, 1, 0, 2, 3, 2]
    assert joined[v.CROSSING_GROUP.name].values.tolist() == [0, 1, 0, 2, 3, 2]
    assert joined[v.GAP_SERIES.name].values.tolist() == [0, 1, 1, 2, 3, 3, 4, 5, 5]
    assert joined[v.RING_INDEX.name].values.tolist() == [0, 1, 2, 0, 1, 2]
    assert joined[v.ANOMALY_BOX.name].values.tolist() == [[1, 2, 3, 4], [1, 16, 3, 18], [1, 30, 3, 32]]
    np.testing.assert_allclose(joined[v.MEASURE_Y.name].values[4:8], parts[1].measure_y + 14)


def test_numbers_that_a_face_has_one_of_are_joined_by_their_rule() -> None:
    parts = [
        face(10, 10, 0, RING_SCALE=30.0, GROWTH_SURENESS=0.55, BRIGHT_OUTWARDS=True),
        face(10, 10, 1, RING_SCALE=9.0, GROWTH_SURENESS=0.52, BRIGHT_OUTWARDS=True),
        face(10, 10, 6, RING_SCALE=np.nan, GROWTH_SURENESS=0.95, BRIGHT_OUTWARDS=False),
    ]
    joined = join_faces(parts, faces_of((10, 10), (10, 10), (10, 10), scale=2.0))
    assert float(joined[v.RING_SCALE.name]) == 18.0
    assert float(joined[v.GRAIN_RATIO.name]) == 2.0
    assert float(joined[v.GROWTH_SURENESS.name]) == 0.95
    assert not bool(joined[v.BRIGHT_OUTWARDS.name])
    assert np.isnan(float(joined[v.FACE_PITH_X.name]))
    assert float(joined[v.PIXEL_SIZE.name]) == 0.25


def test_rings_alone_are_placed_as_with_the_images() -> None:
    sizes = ((21, 21), (21, 21))
    parts = [face(10, 10, seed, step=2) for seed in range(2)]
    whole = join_faces(parts, faces_of(*sizes))
    alone = join_faces([part[["ring_y", "reduction"]] for part in parts], faces_of(*sizes))
    np.testing.assert_array_equal(alone.ring_y, whole.ring_y)
    np.testing.assert_array_equal(alone.face_top, whole.face_top)
    assert "y" not in alone.coords


def test_the_parts_are_not_changed() -> None:
    parts = [face(10, 10, seed) for seed in range(2)]
    before = [part.copy(deep=True) for part in parts]
    join_faces(parts, faces_of((10, 10), (10, 10)))
    for part, copy in zip(parts, before, strict=True):
        xr.testing.assert_identical(part, copy)


def test_faces_at_different_reductions_are_refused() -> None:
    parts = [face(10, 10, 0, step=1), face(10, 10, 1, step=2)]
    with pytest.raises(FacesError, match=r"different reductions \(1:1, 1:2\); set `scan.reduction`"):
        join_faces(parts, faces_of((10, 10), (20, 20)))


def test_an_image_of_another_size_than_its_photograph_is_refused() -> None:
    with pytest.raises(FacesError, match=r"`value` of face 1 has \(10, 10\) rows and columns, expected \(11, 10\)"):
        join_faces([face(10, 10, 0), face(10, 10, 1)], faces_of((10, 10), (10, 11)))


def test_photographs_of_8_and_16_bit_are_not_mixed() -> None:
    windows = [v.CLOSE_UP.array(np.ones((2, 4, 4, 3), dtype)) for dtype in ("u1", "u2")]
    parts = [xr.Dataset({v.CLOSE_UP.name: window}) for window in windows]
    with pytest.raises(FacesError, match=r"different ranges \(uint8, uint16\)"):
        join_faces(parts, faces_of((10, 10), (10, 10)))


def test_what_joining_needs_is_asked_for_with_what_is_joined() -> None:
    assert companions(["value"]) == ("reduction",)
    assert companions(["bright_outwards", "reduction"]) == ("growth_sureness",)
    assert companions(["gap_series", "crossing_group"]) == ("reduction", "ring_group", "series_kind")


def test_no_variable_has_the_name_of_a_dimension_which_would_make_it_a_coordinate() -> None:
    variables = [variable for variable in vars(v).values() if isinstance(variable, Variable)]
    dims = {dim for variable in variables for dim in variable.dims}
    assert [variable.name for variable in variables if variable.name in dims] == []
