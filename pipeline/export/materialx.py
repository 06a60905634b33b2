"""MaterialX: position to tree frame, distortion, ring age, color and roughness, as a graph of standard nodes.

The fine grain needs whole-number hashes, which MaterialX has no nodes for: it is a node of its own with source for GLSL
and OSL. Without it (``--no-detail``) the document has standard nodes only.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.export.grain_source import glsl_grain, osl_grain
from pipeline.export.materialx_graph import Graph
from pipeline.export.registry import Options
from pipeline.export.table_images import ROW, Atlas, displacement_atlas, write_tables
from pipeline.extras import need
from woodfit.appearance import SATIN
from woodfit.shader_tables import ShaderTables, tables_of

if TYPE_CHECKING:
    from woodfit import SolidTexture

#: Name and function of the node of the fine grain.
GRAIN_NODE, GRAIN_DEFINITION = "woodpipe_fine_grain", "ND_woodpipe_fine_grain"


def write(texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.mtlx`` with its tables and the source of the fine grain.

    Object positions are taken in the board frame turned upright (x right, y up, z towards the camera), in the texture's
    unit.
    """
    known, name = tables_of(texture), options.name
    atlas = displacement_atlas(known)
    files = write_tables(known, atlas, folder, name)
    grain = options.detail and len(known.grain.kind) > 0
    if grain:
        for suffix, source in ((".glsl", glsl_grain(known.grain)), (".osl", osl_grain(known.grain))):
            path = folder / f"{name}_fine_grain{suffix}"
            path.write_text(source, encoding="utf-8")
            files.append(path)
    document = document_of(known, atlas, name, grain)
    mx = need("MaterialX", "export", "to write MaterialX")
    path = folder / f"{name}.mtlx"
    mx.writeToXmlFile(document, str(path))
    return [path, *files]


def document_of(known: ShaderTables, atlas: Atlas, name: str, grain: bool) -> Any:
    """The document, without the standard library."""
    mx = need("MaterialX", "export", "to write MaterialX")
    document = mx.createDocument()
    document.setColorSpace("lin_rec709")
    if grain:
        _define_grain(document, name)
    inside = document.addNodeGraph(f"NG_{mx.createValidName(name)}")
    graph = Graph(inside)
    color, roughness, age = wood_nodes(graph, known, atlas, name, grain)
    for label, kind, node in (("color", "color3", color), ("roughness", "float", roughness), ("age", "float", age)):
        inside.addOutput(label, kind).setNodeName(node.getName())
    surface = document.addNode("standard_surface", f"SR_{mx.createValidName(name)}", "surfaceshader")
    surface.addInput("base", "float").setValueString("1")
    surface.addInput("metalness", "float").setValueString("0")
    surface.addInput("specular_IOR", "float").setValueString(f"{SATIN.index_of_refraction:g}")
    for field, kind, label in (("base_color", "color3", "color"), ("specular_roughness", "float", "roughness")):
        wired = surface.addInput(field, kind)
        wired.setNodeGraphString(inside.getName())
        wired.setOutputString(label)
    material = document.addNode("surfacematerial", mx.createValidName(name), "material")
    material.addInput("surfaceshader", "surfaceshader").setNodeName(surface.getName())
    return document


def _define_grain(document: Any, name: str) -> None:
    definition = document.addNodeDef(GRAIN_DEFINITION, "vector3", GRAIN_NODE)
    for field in ("radius", "azimuth", "height", "lateness"):
        definition.addInput(field, "float").setValueString("0")
    for target, suffix in (("genglsl", ".glsl"), ("genosl", ".osl")):
        source = document.addImplementation(f"IM_{GRAIN_NODE}_{target}")
        source.setNodeDefString(GRAIN_DEFINITION)
        source.setTarget(target)
        source.setFile(f"{name}_fine_grain{suffix}")
        source.setFunction(GRAIN_NODE)


def wood_nodes(graph: Graph, known: ShaderTables, atlas: Atlas, name: str, grain: bool) -> tuple[Any, Any, Any]:
    """Nodes of color, roughness and ring age."""
    position = graph.node("position", "vector3", space=("object", "string"))
    # Upright positions: y and z run against those of the board.
    axes = known.axes * np.array([1.0, -1.0, -1.0]) / known.pixel_size
    x, y, height = (
        graph.add(graph.node("dotproduct", in1=position, in2=(", ".join(f"{v:.9g}" for v in axis), "vector3")), shift)
        for axis, shift in zip(axes, known.origin, strict=True)
    )
    bend_x, bend_y, taper = known.stem
    if bend_x or bend_y:
        square = graph.multiply(height, height)
        x = graph.subtract(x, graph.multiply(square, bend_x))
        y = graph.subtract(y, graph.multiply(square, bend_y))
    r = graph.node("magnitude", **{"in": graph.node("combine2", "vector2", in1=x, in2=y)})
    if taper:
        r = graph.multiply(r, graph.maximum(graph.add(graph.multiply(height, taper), 1.0), 0.05))
    azimuth = graph.node("atan2", iny=y, inx=x)
    moved = Displacement(graph, known, atlas, f"{name}_displacement.exr", r, azimuth)
    radius = graph.add(r, moved.at(height))
    age = _age(graph, known, f"{name}_age.exr", radius)
    color, late = _strip(graph, known, name, age)
    if grain:
        u = graph.maximum(graph.subtract(radius, moved.at(known.middle)), 0.0)
        factor = graph.node(GRAIN_NODE, "vector3", radius=u, azimuth=azimuth, height=height, lateness=late)
        color = graph.node("multiply", "color3", in1=color, in2=graph.node("convert", "color3", **{"in": factor}))
    roughness = graph.mix(SATIN.roughness_early, SATIN.roughness_late, graph.clamp(late, 0.0, 1.0))
    return color, roughness, graph.add(age, float(known.first_age))


class Displacement:
    """Look-ups of the distortion at one radius and azimuth."""

    def __init__(self, graph: Graph, known: ShaderTables, atlas: Atlas, file: str, r: Any, azimuth: Any) -> None:
        self.graph, self.known, self.atlas, self.file = graph, known, atlas, file
        axis = known.radius
        self.column = graph.clamp(graph.divide(graph.subtract(r, axis.first), axis.step), 0.0, axis.count - 1)
        around = known.azimuth
        turn = float(around.count) if known.wraps else 2.0 * np.pi / around.step
        place = graph.modulo(graph.divide(graph.subtract(azimuth, around.first), around.step), turn)
        last = around.count - 1.0
        if not known.wraps:
            # The arc that no face shows is one wide cell.
            wide = graph.add(graph.divide(graph.subtract(place, last), turn - last), last)
            place = graph.where(place, last, wide, place)
        self.near = graph.clamp(graph.floor(place), 0.0, last)
        self.part = graph.subtract(place, self.near)
        self.far = graph.modulo(graph.add(self.near, 1.0), float(around.count))

    def at(self, height: Any) -> Any:
        """Displacement, px, at a height."""
        graph, axis = self.graph, self.known.height
        row = graph.clamp(graph.divide(graph.subtract(height, axis.first), axis.step), 0.0, axis.count - 1)
        return graph.mix(self._slice(self.near, row), self._slice(self.far, row), self.part)

    def _slice(self, number: Any, row: Any) -> Any:
        graph, columns = self.graph, float(self.atlas.columns)
        down = graph.floor(graph.divide(graph.add(number, 0.5), columns))
        across = graph.subtract(number, graph.multiply(down, columns))
        high, wide = self.atlas.image.shape
        u = graph.add(graph.multiply(across, self.known.radius.count), graph.add(self.column, 0.5))
        v = graph.add(graph.multiply(down, self.known.height.count), graph.add(row, 0.5))
        return graph.image(self.file, "float", graph.divide(u, wide), _from_top(graph, v, high))


def _from_top(graph: Graph, rows: Any, high: int) -> Any:
    return graph.subtract(1.0, graph.divide(rows, high))


def _table(graph: Graph, file: str, kind: str, place: Any, count: int) -> Any:
    """Linear look-up in a table of `count` entries laid out by `table_rows`."""
    if count <= ROW:
        u = graph.divide(graph.add(place, 0.5), count)
        return graph.image(file, kind, u, graph.multiply(u, 0.0))
    rows = -(-(count - 1) // (ROW - 1))
    row = graph.clamp(graph.floor(graph.divide(graph.add(place, 1e-3), ROW - 1.0)), 0.0, rows - 1.0)
    column = graph.subtract(place, graph.multiply(row, ROW - 1.0))
    return graph.image(
        file, kind, graph.divide(graph.add(column, 0.5), ROW), _from_top(graph, graph.add(row, 0.5), rows)
    )


def _age(graph: Graph, known: ShaderTables, file: str, radius: Any) -> Any:
    """Ring age counted from the tables' first."""
    inner, outer, count = known.ring_radius[0], known.ring_radius[-1], len(known.age_table)
    place = graph.clamp(graph.divide(graph.subtract(radius, inner), known.age_step), 0.0, count - 1.0)
    age = _table(graph, file, "float", place, count)
    beyond = graph.divide(graph.maximum(graph.subtract(radius, outer), 0.0), known.mean_width)
    age = graph.add(age, beyond)
    if not known.first_age:
        return age
    before = graph.node("min", in1=graph.subtract(radius, inner), in2=0.0)
    return graph.add(age, graph.divide(before, known.first_width))


def _strip(graph: Graph, known: ShaderTables, name: str, age: Any) -> tuple[Any, Any]:
    """Linear color and lateness at a ring age."""
    if known.first_age:
        again = graph.modulo(age, known.strip_period / known.samples_per_ring)
        age = graph.where(age, 0.0, age, again)
    place = graph.maximum(graph.subtract(graph.multiply(age, known.samples_per_ring), 0.5), 0.0)
    end = known.strip_size - 0.5
    over = graph.add(graph.modulo(graph.subtract(place, end), known.strip_period), end)
    place = graph.where(place, end, over, place)
    count = len(known.strip)
    color = _table(graph, f"{name}_color.exr", "color3", place, count)
    return color, _table(graph, f"{name}_lateness.exr", "float", place, count)
