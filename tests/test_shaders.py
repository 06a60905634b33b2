"""The solid texture in GLSL gives the wood that Python gives."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest
from color_checks import assert_same_colors
from gl_programs import run_fragments
from test_shader_tables import GRAIN, points
from test_solid_texture import STEM, texture

from pipeline.shaders.packing import pack
from woodfit import SolidTexture
from woodfit.fine_grain import FineGrain
from woodfit.seen import Seen

FACE = Seen(np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]]), np.array([[300.0, 200.0]]), np.array([1.5, 9.0]))

WOODS = {
    "round": replace(texture(), fine_grain=GRAIN, seen=FACE),
    "a sector, bent, in mm": replace(texture(False, 0.2), stem=STEM, fine_grain=GRAIN, seen=FACE),
    "plain": replace(texture(), fine_grain=FineGrain.none()),
}


def shaded(wood: SolidTexture, where: np.ndarray, detail: bool = True) -> tuple[np.ndarray, ...]:
    packed = pack(wood)
    color = f"vec4 at(vec3 p) {{ WpWood wood = wp_wood(p, {str(detail).lower()}); return vec4(wood.rgb, wood.age); }}"
    rest = "vec4 at(vec3 p) { WpWood wood = wp_wood(p, false); return vec4(wood.lateness, wood.confidence, 0.0, 1.0); }"
    first = run_fragments(packed.source + color, where, packed.tables)
    second = run_fragments(packed.source + rest, where, packed.tables)
    return first[:, :3], first[:, 3], second[:, 0], second[:, 1]


@pytest.mark.parametrize("name", list(WOODS))
def test_ten_thousand_points_have_the_color_that_the_texture_has(name: str) -> None:
    wood = WOODS[name]
    where = points(10_000) * (wood.pixel_size or 1.0)
    rgb, age, lateness, confidence = shaded(wood, where)
    known = wood.evaluate(where)
    assert_same_colors(rgb, known.rgb, 0.3, 1.5)
    npt.assert_allclose(age, known.ring_age, atol=2e-3)
    assert np.percentile(np.abs(lateness - known.lateness), 99) < 0.01
    npt.assert_allclose(confidence, known.confidence, atol=1e-3)


def test_the_fine_grain_can_be_left_out_in_the_shader() -> None:
    wood = WOODS["round"]
    where = points(2_000, 5)
    assert_same_colors(shaded(wood, where, detail=False)[0], wood.evaluate(where, detail=False).rgb, 0.3, 1.5)
