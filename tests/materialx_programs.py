"""A MaterialX document's generated GLSL, run at points without a screen."""

from pathlib import Path
from typing import Any

import numpy as np
from gl_programs import context


def loaded(path: Path) -> Any:
    """The document with the standard library in it."""
    import MaterialX as mx  # noqa: N813

    document, library = mx.createDocument(), mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    mx.readFromXmlFile(document, str(path))
    document.importLibrary(library)
    return document


def generated(document: Any, folder: Path, target: str, output: str = "color") -> str:
    """Pixel source of an output of the document's own graph: ``glsl``, ``essl`` or ``osl``."""
    import MaterialX as mx  # noqa: N813
    from MaterialX import PyMaterialXGenGlsl, PyMaterialXGenOsl, PyMaterialXGenShader

    makers = {
        "glsl": PyMaterialXGenGlsl.GlslShaderGenerator,
        "essl": PyMaterialXGenGlsl.EsslShaderGenerator,
        "osl": PyMaterialXGenOsl.OslShaderGenerator,
    }
    generator = makers[target].create()
    settings = PyMaterialXGenShader.GenContext(generator)
    settings.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
    settings.registerSourceCodeSearchPath(str(folder))
    settings.getOptions().fileTextureVerticalFlip = target != "osl"
    graph = next(graph for graph in document.getNodeGraphs() if graph.getName().startswith("NG_wood"))
    return str(generator.generate("wood", graph.getOutput(output), settings).getSourceCode("pixel"))


def run_document(document: Any, folder: Path, positions: np.ndarray, output: str = "color") -> np.ndarray:
    """The output at object positions (K, 3); (K, 4)."""
    import OpenImageIO as oiio  # noqa: N813

    gl = context()
    size = int(np.ceil(np.sqrt(len(positions))))
    program = gl.program(
        vertex_shader=f"""#version 400
in vec3 place;
out VertexData {{ vec3 positionObject; }} vd;
void main() {{
    vd.positionObject = place;
    vec2 spot = vec2(gl_VertexID % {size}, gl_VertexID / {size}) + 0.5;
    gl_Position = vec4(2.0 * spot / float({size}) - 1.0, 0.0, 1.0);
}}""",
        fragment_shader=generated(document, folder, "glsl", output),
    )
    graph = next(graph for graph in document.getNodeGraphs() if graph.getName().startswith("NG_wood"))
    kept = []
    for node in graph.getNodes("image"):
        name = f"{node.getName()}_file"
        if name not in program:
            continue
        image = oiio.ImageInput.open(str(folder / node.getInputValue("file")))
        spec, pixels = image.spec(), image.read_image("float")
        image.close()
        size_px, data = (spec.width, spec.height), np.ascontiguousarray(pixels).tobytes()
        texture = gl.texture(size_px, spec.nchannels, data, dtype="f4")
        texture.filter = (gl.LINEAR, gl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        texture.use(len(kept))
        program[name] = len(kept)
        kept.append(texture)
    points = gl.buffer(np.ascontiguousarray(positions, np.float32).tobytes())
    target = gl.texture((size, size), 4, dtype="f4")
    frame = gl.framebuffer([target])
    frame.use()
    gl.viewport = (0, 0, size, size)
    gl.simple_vertex_array(program, points, "place").render(gl.POINTS)
    out = np.frombuffer(target.read(), np.float32).reshape(-1, 4)[: len(positions)].copy()
    for thing in (points, target, frame, *kept):
        thing.release()
    return out
