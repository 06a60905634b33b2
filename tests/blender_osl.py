"""Run by Blender's own Python: renders vertex colors of a shader or material over given points into a file.

    python blender_osl.py points.npy out.npy osl wood.osl
    python blender_osl.py points.npy out.npy script woodpipe_blender.py
"""

import runpy
import sys
from pathlib import Path

import bpy
import numpy as np

points, out, kind, source = np.load(sys.argv[1]), sys.argv[2], sys.argv[3], Path(sys.argv[4])
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
size = int(np.ceil(np.sqrt(len(points))))
every = np.zeros((size * size, 3))
every[: len(points)] = points

# A grid of quads seen straight on, one to a pixel; an attribute tells each where in the wood it is.
corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
spots = np.stack([np.arange(size * size) % size, np.arange(size * size) // size], -1)
flat = (spots[:, None] + corner).reshape(-1, 2) / size
mesh = bpy.data.meshes.new("points")
mesh.from_pydata(
    np.column_stack([flat, np.zeros(len(flat))]).tolist(), [], np.arange(len(flat)).reshape(-1, 4).tolist()
)
place = mesh.attributes.new("wood_place", "FLOAT_VECTOR", "POINT")
place.data.foreach_set("vector", np.repeat(every, 4, axis=0).astype(np.float32).ravel())
body = bpy.data.objects.new("points", mesh)
scene.collection.objects.link(body)

material = bpy.data.materials.new("check")
material.use_nodes = True
tree = material.node_tree
tree.nodes.clear()
where = tree.nodes.new("ShaderNodeAttribute")
where.attribute_name = "wood_place"
scene.render.engine = "CYCLES"
if kind == "osl":
    import hashlib

    import _cycles

    scene.cycles.shading_system = True
    # Blender's own way to a script node's sockets needs the package oslquery, which the bpy wheel lacks; so the shader
    # is compiled here, with absolute paths, and its sockets are made by hand.
    text = source.read_text().replace('"wood_', f'"{source.resolve().parent}/wood_')
    given, compiled = Path(out).with_suffix(".osl"), Path(out).with_suffix(".oso")
    given.write_text(text)
    if not _cycles.osl_compile(str(given), str(compiled)):
        raise SystemExit("the shader does not compile")
    wood = tree.nodes.new("ShaderNodeScript")
    wood.inputs.new("NodeSocketVector", "position", identifier="position")
    wood.outputs.new("NodeSocketColor", "base_color", identifier="base_color")
    wood.bytecode = compiled.read_text()
    wood.bytecode_hash = hashlib.md5(wood.bytecode.encode(), usedforsecurity=False).hexdigest()
    tree.links.new(where.outputs["Vector"], wood.inputs["position"])
    color = wood.outputs["base_color"]
else:
    made = runpy.run_path(str(source), run_name="woodpipe")
    wood = tree.nodes.new("ShaderNodeGroup")
    wood.node_tree = made["build_group"](Path(source).parent)
    tree.links.new(where.outputs["Vector"], wood.inputs["Position"])
    color = wood.outputs["Color"]
glow = tree.nodes.new("ShaderNodeEmission")
end = tree.nodes.new("ShaderNodeOutputMaterial")
tree.links.new(color, glow.inputs["Color"])
tree.links.new(glow.outputs["Emission"], end.inputs["Surface"])
mesh.materials.append(material)

camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.type, camera.data.ortho_scale = "ORTHO", 1.0
camera.location = (0.5, 0.5, 2.0)
scene.collection.objects.link(camera)
scene.camera = camera
scene.cycles.samples = 1
scene.cycles.use_denoising = False
scene.cycles.pixel_filter_type = "BOX"
scene.cycles.filter_width = 0.01
scene.render.resolution_x = scene.render.resolution_y = size
scene.render.resolution_percentage = 100
scene.view_settings.view_transform = "Raw"
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.image_settings.exr_codec = "ZIP"
exr = Path(out).with_suffix(".exr")
scene.render.filepath = str(exr)
bpy.ops.render.render(write_still=True)
image = bpy.data.images.load(str(exr))
image.colorspace_settings.name = "Non-Color"
pixels = np.array(image.pixels[:], np.float32).reshape(size * size, -1)[: len(points), :3]
np.save(out, pixels)
