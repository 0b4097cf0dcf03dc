"""Run in Blender: composite an EXR over a colour, and pick mattes with Cryptomatte nodes.

`python blender_compositor.py TASK`: JSON with picture, size, folder, background (RGBA) and mattes (pairs of
set and name). Writes composited.exr into the folder: the parts `over`, `vector` where there is one, and
`matte0`, `matte1`, …
"""

import json
import sys

import bpy

task = json.loads(sys.argv[1])
scene = bpy.context.scene
scene.render.engine, scene.cycles.samples = "CYCLES", 1
scene.render.resolution_x, scene.render.resolution_y = task["size"]
scene.render.resolution_percentage = 100
scene.render.compositor_device, scene.render.compositor_precision = "CPU", "FULL"
tree = bpy.data.node_groups.new("compositor", "CompositorNodeTree")
scene.compositing_node_group = tree

output = tree.nodes.new("CompositorNodeOutputFile")
output.directory, output.file_name = task["folder"], "composited"
output.format.media_type, output.format.file_format = "MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER"
output.format.color_depth, output.format.exr_codec = "32", "ZIP"


def keep(kind: str, name: str, socket: bpy.types.NodeSocket) -> None:
    output.file_output_items.new(kind, name)
    tree.links.new(socket, output.inputs[name])


source = tree.nodes.new("CompositorNodeImage")
source.image = bpy.data.images.load(task["picture"])
over = tree.nodes.new("CompositorNodeAlphaOver")
over.inputs["Background"].default_value = task["background"]
tree.links.new(source.outputs["Combined"], over.inputs["Foreground"])
keep("RGBA", "over", over.outputs["Image"])
if "Vector" in source.outputs:
    keep("VECTOR", "vector", source.outputs["Vector"])
for number, (mattes, name) in enumerate(task["mattes"]):
    picker = tree.nodes.new("CompositorNodeCryptomatteV2")
    picker.source, picker.image = "IMAGE", source.image
    picker.layer_name, picker.matte_id = mattes, name
    keep("FLOAT", f"matte{number}", picker.outputs["Matte"])
bpy.ops.render.render()
