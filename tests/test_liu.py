"""The editable parameters: a wood made from them gives them back, and they stand for real fits."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given as anything
from hypothesis import settings
from hypothesis import strategies as st

from woodfit.cylinder_grid import CylinderGrid
from woodfit.liu import LiuError, LiuModel, Wave
from woodfit.liu_fit import agreement, fit_liu
from woodfit.solid_texture import SolidTexture

SIZE = (300, 320)


def model(**changed: object) -> LiuModel:
    """A flat-sawn board of a conifer, px."""
    plain = LiuModel(
        unit="px",
        board_to_tree=((1.0, 0.0, 0.0, -160.0), (0.0, 0.0, 1.0, -150.0), (0.0, -1.0, 0.0, 150.0), (0.0, 0.0, 0.0, 1.0)),
        stem=(0.0, 0.0, 0.0),
        first_radius=0.0,
        ring_width=20.0,
        ring_widths=(1.2, 0.8, 1.1, 0.9, 1.0, 1.0, 1.3, 0.7, 1.1, 0.9, 1.0, 1.0, 1.0),
        latewood_ratio=0.3,
        early_slope=0.4,
        late_slope=0.2,
        early_color=(0.62, 0.42, 0.24),
        late_exponent=(1.9, 1.8, 1.6),
        ring_exponents=(1.0, 1.1, 0.9, 1.0, 1.05, 0.95, 1.0, 1.0, 1.1, 0.9, 1.0, 1.0, 1.0),
        fade_radius=30.0,
        waves=(),
    )
    return replace(plain, **changed)


def waving() -> LiuModel:
    """The same board with a distortion."""
    return model(waves=(Wave(6.0, 2.0, 0.02, 0.0, 0.4), Wave(3.0, 1.0, -0.03, 0.0, 1.0)))


def texture_of(wood: LiuModel, pixel_size: float | None = None, samples: int = 64) -> SolidTexture:
    """The solid texture that holds what a model says, in tables; the model's lengths are px."""
    radius, azimuth, height = (
        np.arange(0.0, 262.0, 10.0),
        np.linspace(-np.pi, np.pi, 49),
        np.arange(-160.0, 161.0, 10.0),
    )
    places = np.meshgrid(radius, azimuth, height, indexing="ij")
    age = (np.arange(len(wood.ring_widths) * samples) + 0.5) / samples
    return SolidTexture(
        board_to_tree=np.array(wood.board_to_tree),
        grid=CylinderGrid(radius, azimuth, height, wraps=True),
        displacement=wood.distortion(*places).astype(np.float32),
        ring_radius=wood.ring_radius(),
        color_strip=wood.color(age),
        lateness_strip=wood.lateness(age % 1.0).astype(np.float32),
        samples_per_ring=samples,
        pixel_size=pixel_size,
    )


@pytest.mark.parametrize(
    ("ratio", "early", "late"), [(0.3, 0.4, 0.2), (0.1, 0.8, 0.5), (0.6, 0.2, 0.1), (0.45, 1.0, 0.3)]
)
def test_the_ring_profile_is_given_back(ratio: float, early: float, late: float) -> None:
    found = fit_liu(texture_of(model(latewood_ratio=ratio, early_slope=early, late_slope=late)))
    assert found.latewood_ratio == pytest.approx(ratio, abs=0.02)
    assert found.early_slope == pytest.approx(early, abs=0.05)
    fraction = np.linspace(0.0, 1.0, 500)
    truth = model(latewood_ratio=ratio, early_slope=early, late_slope=late).lateness(fraction)
    assert np.abs(found.lateness(fraction) - truth).mean() < 0.01


def test_widths_and_colors_are_given_back() -> None:
    truth = model()
    found = fit_liu(texture_of(truth))
    npt.assert_allclose(found.ring_radius(), truth.ring_radius(), atol=0.02)
    npt.assert_allclose(found.early_color, truth.early_color, atol=0.01)
    npt.assert_allclose(found.late_exponent, truth.late_exponent, atol=0.03)
    npt.assert_allclose(found.ring_exponents, truth.ring_exponents, atol=0.01)
    assert found.waves == ()


def test_the_strongest_waves_carry_the_distortion() -> None:
    truth = waving()
    texture = texture_of(truth)
    x, y = np.meshgrid(np.linspace(0, SIZE[1] - 1, 40), np.linspace(0, SIZE[0] - 1, 40))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)
    found = fit_liu(texture, points)
    far = agreement(replace(found, waves=()), texture, points)
    near = agreement(found, texture, points)
    assert near["ring_age_median"] < 0.25 * far["ring_age_median"]
    assert near["ring_age_median"] < 0.03
    assert near["mean_color"] < 0.01


def test_a_model_agrees_with_the_texture_made_from_it() -> None:
    truth = waving()
    points = np.random.default_rng(0).uniform([0, 0, 0], [320, 300, 100], (4000, 3))
    found = agreement(truth, texture_of(truth), points)
    assert found["ring_age_median"] < 0.01
    assert found["color_rms"] < 0.02


def test_millimetres_change_nothing_but_the_unit() -> None:
    truth = waving()
    in_px, in_mm = fit_liu(texture_of(truth)), fit_liu(texture_of(truth, pixel_size=0.1))
    assert (in_px.unit, in_mm.unit) == ("px", "mm")
    points = np.random.default_rng(1).uniform([0, 0, 0], [320, 300, 80], (500, 3))
    one, other = in_px.evaluate(points), in_mm.evaluate(0.1 * points)
    npt.assert_allclose(other.ring_age, one.ring_age, atol=1e-6)
    npt.assert_allclose(other.fiber_direction, one.fiber_direction, atol=1e-4)


def test_the_fibre_stays_within_its_growth_layer() -> None:
    wood = waving()
    points = np.random.default_rng(2).uniform([0, 0, 0], [320, 300, 80], (400, 3))
    fiber = wood.evaluate(points).fiber_direction.astype(float)
    npt.assert_allclose(np.linalg.norm(fiber, axis=1), 1.0, atol=1e-5)
    up, down = (wood.evaluate(points + sign * 0.05 * fiber).ring_age for sign in (1, -1))
    npt.assert_allclose(up, down, atol=2e-4)


def test_an_edited_number_shows_in_the_wood() -> None:
    document = json.loads(model().to_json())
    document["ring_width"] *= 2.0
    wide = LiuModel.from_json(json.dumps(document))
    points = np.random.default_rng(3).uniform([0, 0, 0], [320, 300, 60], (200, 3))
    assert wide.evaluate(points).ring_age.max() < model().evaluate(points).ring_age.max()
    document["late_exponent"] = [3.0, 3.0, 3.0]
    darker = LiuModel.from_json(json.dumps(document))
    assert (darker.color(np.array([0.85])) < wide.color(np.array([0.85]))).all()


shares = st.floats(0.01, 1.0)
lengths = st.floats(0.01, 1e4)
anything_real = st.floats(-1e4, 1e4)
models = st.builds(
    model,
    unit=st.sampled_from(["mm", "px", "in"]),
    stem=st.tuples(anything_real, anything_real, anything_real),
    first_radius=lengths,
    ring_width=lengths,
    ring_widths=st.lists(lengths, max_size=5).map(tuple),
    latewood_ratio=shares,
    early_slope=shares,
    late_slope=shares,
    early_color=st.tuples(*[st.floats(0.01, 0.99)] * 3),
    late_exponent=st.tuples(*[anything_real] * 3),
    ring_exponents=st.lists(anything_real, max_size=5).map(tuple),
    fade_radius=lengths,
    waves=st.lists(st.builds(Wave, *[anything_real] * 5), max_size=4).map(tuple),
)


@settings(max_examples=60)
@anything(models, st.booleans())
def test_json_gives_the_same_model_back(wood: LiuModel, noted: bool) -> None:
    text = wood.to_json(made_of="board") if noted else wood.to_json()
    assert LiuModel.from_json(text) == wood


@anything(st.floats(0.02, 0.98), st.floats(0.01, 1.0), st.floats(0.01, 1.0), st.floats(0.0, 1.0))
def test_lateness_is_a_share(ratio: float, early: float, late: float, fraction: float) -> None:
    wood = model(latewood_ratio=ratio, early_slope=early, late_slope=late)
    assert 0.0 <= float(wood.lateness(fraction)) <= 1.0
    assert float(wood.lateness(0.0)) == float(wood.lateness(1.0)) == 0.0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"latewood_ratio": 1.5}, "latewood_ratio"),
        ({"ring_width": 0.0}, "ring_width"),
        ({"early_color": [0.5, 0.5]}, "early_color"),
        ({"board_to_tree": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "board_to_tree"),
        ({"ring_widths": [1.0, -1.0]}, "ring_widths"),
        ({"waves": [{"amplitude": 1.0}]}, "no number"),
        ({"hue": 3}, "`hue` is not known"),
        ({"format": "something"}, "format"),
        ({"format_version": 99}, "version 99"),
    ],
)
def test_what_is_no_wood_is_told(change: dict[str, object], told: str) -> None:
    document = {**json.loads(model().to_json()), **change}
    with pytest.raises(LiuError, match=told):
        LiuModel.from_json(json.dumps(document))


def test_a_missing_parameter_is_told_and_so_is_no_json() -> None:
    document = {key: value for key, value in json.loads(model().to_json()).items() if key != "ring_width"}
    with pytest.raises(LiuError, match="`ring_width` is missing"):
        LiuModel.from_json(json.dumps(document))
    with pytest.raises(LiuError, match="no JSON"):
        LiuModel.from_json("{")


def test_points_need_three_coordinates() -> None:
    with pytest.raises(ValueError, match="expected"):
        model().evaluate(np.zeros((4, 2)))


def test_every_parameter_has_its_line_in_the_docs() -> None:
    text = (Path(__file__).parents[1] / "docs" / "liu.md").read_text()
    assert [name for name in asdict(model()) if f"`{name}`" not in text] == []
