"""The fine grain of one texture as a function in GLSL and in OSL, its noises written out."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.shaders.packing import shader_text
from woodfit.shader_tables import Grain


def glsl_grain(grain: Grain) -> str:
    """``void woodpipe_fine_grain(radius, azimuth, height, lateness, out factor)`` and what it calls, in GLSL."""
    lines = _body(grain, lambda seed: f"{seed}u", "vec3")
    return "\n".join(
        [
            shader_text("fine_grain.glsl"),
            "void woodpipe_fine_grain(float radius, float azimuth, float height, float lateness, out vec3 factor)",
            "{",
            "    float turn = fract(azimuth / 6.283185307179586);",
            "    vec2 xy = radius * vec2(cos(azimuth), sin(azimuth));",
            "    vec3 total = vec3(0.0);",
            *lines,
            "    factor = exp(total);",
            "}",
            "",
        ]
    )


def osl_grain(grain: Grain) -> str:
    """The same in OSL."""
    lines = _body(grain, lambda seed: str(seed - (1 << 32) if seed >= 1 << 31 else seed), "vector", osl=True)
    return "\n".join(
        [
            shader_text("fine_grain.osl.txt"),
            "void woodpipe_fine_grain(float radius, float azimuth, float height, float lateness, output vector factor)",
            "{",
            "    float turn = azimuth / 6.283185307179586;",
            "    turn = turn - floor(turn);",
            "    float x = radius * cos(azimuth);",
            "    float y = radius * sin(azimuth);",
            "    vector total = vector(0.0);",
            *lines,
            "    factor = vector(exp(total[0]), exp(total[1]), exp(total[2]));",
            "}",
            "",
        ]
    )


def _body(grain: Grain, seed_text: Callable[[int], str], vector: str, osl: bool = False) -> list[str]:
    """Statements that add up `total`: a line a noise, then the mean taken off."""
    lines = []
    place = "x, y" if osl else "xy"
    for k, kind in enumerate(grain.kind):
        early, late = (_number(value) for value in grain.amplitude[k])
        cells = ", ".join(_number(value) for value in grain.cells[k])
        color = ", ".join(_number(value) for value in grain.color[k])
        seed = seed_text(int(grain.seed[k]))
        lattice = f"{int(kind)}, {vector}({cells}), {_number(grain.density[k])}, {seed}"
        value = f"wp_noise({lattice}, radius, turn, {place}, height)"
        lines.append(f"    total += mix({early}, {late}, lateness) * {value} * {vector}({color});")
    lines.append("    float level = clamp(lateness, 0.0, 1.0) * 4.0;")
    lines.append(f"    total -= {vector}({', '.join(_number(value) for value in grain.log_mean[0])});")
    for low in range(4):
        rise = ", ".join(_number(value) for value in grain.log_mean[low + 1] - grain.log_mean[low])
        lines.append(f"    total -= clamp(level - {low}.0, 0.0, 1.0) * {vector}({rise});")
    return lines


def _number(value: float) -> str:
    text = f"{float(value):.9g}"
    return text if any(mark in text for mark in ".en") else f"{text}.0"
