"""GLSL run on this machine without a screen: fragment programs over a list of points."""

from functools import cache
from typing import Any

import numpy as np
import pytest


@cache
def context() -> Any:
    """A context of OpenGL 3.3 or newer; skips the test where there is none."""
    moderngl = pytest.importorskip("moderngl")
    try:
        return moderngl.create_standalone_context(require=330, backend="egl")
    except Exception as error:
        pytest.skip(f"no OpenGL without a screen here: {error}")


def run_fragments(fragment: str, points: np.ndarray, tables: np.ndarray | None = None, **values: Any) -> np.ndarray:
    """Four floats for each point (K, 3): `fragment` is GLSL that defines ``vec4 at(vec3 point)``; (K, 4)."""
    gl = context()
    size = int(np.ceil(np.sqrt(len(points))))
    given = np.zeros((size * size, 3), np.float32)
    given[: len(points)] = points
    source = gl.texture((size, size), 3, given.tobytes(), dtype="f4")
    source.filter = (gl.NEAREST, gl.NEAREST)
    source.use(0)
    program = gl.program(
        vertex_shader="#version 400\nin vec2 place;\nvoid main() { gl_Position = vec4(place, 0.0, 1.0); }",
        fragment_shader=f"""#version 400
uniform sampler2D given;
out vec4 result;
{fragment}
void main() {{ result = at(texelFetch(given, ivec2(gl_FragCoord.xy), 0).xyz); }}""",
    )
    program["given"] = 0
    kept = []
    if tables is not None:
        texture = gl.texture(tables.shape[::-1], 1, np.ascontiguousarray(tables, np.float32).tobytes(), dtype="f4")
        texture.use(1)
        program["wp_tables"] = 1
        kept.append(texture)
    for name, value in values.items():
        program[name] = value
    corners = gl.buffer(np.array([-1, -1, 1, -1, -1, 1, 1, 1], np.float32).tobytes())
    target = gl.texture((size, size), 4, dtype="f4")
    frame = gl.framebuffer([target])
    frame.use()
    gl.viewport = (0, 0, size, size)
    gl.simple_vertex_array(program, corners, "place").render(gl.TRIANGLE_STRIP)
    out = np.frombuffer(target.read(), np.float32).reshape(-1, 4)[: len(points)].copy()
    for thing in (source, target, frame, corners, *kept):
        thing.release()
    return out
