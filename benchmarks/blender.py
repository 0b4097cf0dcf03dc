"""Blender's Cycles in a process of its own, driven by lines of JSON: show a frame, render a picture.

    python -P benchmarks/blender.py SCENE.json

It gets the same input as Mitsuba: the triangles and normals, emitters of the same size and radiance, the
same sky, lens, box filter and number of bounces. Caustics are traced, and nothing is clamped or blurred. Data
persist from picture to picture. The y axis points up in both. It needs bpy, and no module of this project.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

ROOM = Path(sys.argv[1]).parent


def main() -> None:
    """Answer requests until the input ends."""
    told = json.loads(Path(sys.argv[1]).read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _settings(told)
    _sky(np.load(ROOM / told["sky"]), told["sky_visible"])
    for lamp in told["lamps"]:
        _lamp(lamp)
    if told["sun"]:
        _sun(told["sun"])
    stage = np.load(ROOM / told["stage"])
    _show("stage", stage, _paint("stage", {"model": "diffuse", "colour": told["stage_colour"]}))
    look = _paint("subject", told["look"])
    print(json.dumps({"blender": bpy.app.version_string}), flush=True)
    for line in sys.stdin:
        wanted = json.loads(line)
        if "mesh" in wanted:
            _show("subject", np.load(ROOM / wanted["mesh"]), look)
            print(json.dumps({}), flush=True)
        else:
            print(json.dumps({"seconds": _render(**wanted)}), flush=True)


def _settings(told: dict[str, Any]) -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = told["size"]
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.color_mode = "RGB"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = False
    cycles.pixel_filter_type = "BOX"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.max_bounces = told["depth"] - 2  # bounces after the first surface, emitters not counted
    cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = cycles.max_bounces
    cycles.blur_glossy = 0.0
    scene.render.use_persistent_data = True
    cycles.denoiser = "OPENIMAGEDENOISE"
    lens = bpy.data.cameras.new("lens")
    lens.sensor_fit = "HORIZONTAL"
    lens.angle = told["field_of_view"]
    lens.clip_start, lens.clip_end = 0.01, 1e4
    camera = bpy.data.objects.new("camera", lens)
    camera.matrix_world = Matrix(told["camera"])
    scene.collection.objects.link(camera)
    scene.camera = camera


def _sky(radiance: Any, is_visible: bool) -> None:
    """Surround the scene with an environment map (H, W, 3), whose upper left is Mitsuba's."""
    world = bpy.context.scene.world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    height, width = radiance.shape[:2]
    image = bpy.data.images.new("sky", width, height, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    turned = np.roll(radiance, width // 4, axis=1)[::-1]
    image.pixels.foreach_set(np.dstack([turned, np.ones((height, width))]).astype(np.float32).ravel())
    texture, turn = nodes.new("ShaderNodeTexEnvironment"), nodes.new("ShaderNodeMapping")
    place = nodes.new("ShaderNodeTexCoord")
    texture.image = image
    turn.inputs["Rotation"].default_value = (math.pi / 2.0, 0.0, 0.0)
    links.new(place.outputs["Generated"], turn.inputs["Vector"])
    links.new(turn.outputs["Vector"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])
    world.cycles_visibility.camera = is_visible


def _sun(told: dict[str, Any]) -> None:
    """Add a distant disc."""
    light = bpy.data.lights.new("sun", "SUN")
    light.energy = max(told["irradiance"])
    light.color = [each / light.energy for each in told["irradiance"]]
    light.angle = told["width"]
    sun = bpy.data.objects.new("sun", light)
    sun.matrix_world = Matrix(told["matrix"])
    bpy.context.scene.collection.objects.link(sun)


def _lamp(told: dict[str, Any]) -> None:
    """Add a rectangular emitter, one-sided and visible in reflections only."""
    light = bpy.data.lights.new("lamp", "AREA")
    light.shape = "RECTANGLE"
    light.size, light.size_y = told["width"], told["height"]
    brightest = max(told["radiance"])
    light.color = [each / brightest for each in told["radiance"]]
    light.energy = _power(brightest, told["width"] * told["height"])
    lamp = bpy.data.objects.new("lamp", light)
    lamp.matrix_world = Matrix(told["matrix"])
    lamp.visible_camera = False
    bpy.context.scene.collection.objects.link(lamp)


def _power(radiance: float, area: float) -> float:
    """Return the power, watts, of a Lambertian emitter of this size and radiance."""
    return math.pi * area * radiance


def _paint(name: str, look: dict[str, Any]) -> Any:
    """Return the material of a look. Blender's roughness is the square root of Mitsuba's."""
    paint = bpy.data.materials.new(name)
    paint.use_nodes = True
    nodes = paint.node_tree.nodes
    nodes.clear()
    kind, colour, roughness = {
        "diffuse": ("ShaderNodeBsdfDiffuse", "Color", None),
        "plastic": ("ShaderNodeBsdfPrincipled", "Base Color", look.get("roughness")),
        "metal": ("ShaderNodeBsdfAnisotropic", "Color", look.get("roughness")),
        "glass": ("ShaderNodeBsdfGlass", "Color", 0.0),
    }[look["model"]]
    bsdf, out = nodes.new(kind), nodes.new("ShaderNodeOutputMaterial")
    bsdf.inputs[colour].default_value = (*look["colour"], 1.0)
    if roughness is not None:
        bsdf.inputs["Roughness"].default_value = math.sqrt(roughness)
    if "IOR" in bsdf.inputs:
        bsdf.inputs["IOR"].default_value = look["refraction"]
    if kind == "ShaderNodeBsdfAnisotropic":
        bsdf.distribution = "GGX"
    paint.node_tree.links.new(bsdf.outputs["BSDF"], out.inputs["Surface"])
    return paint


def _show(name: str, arrays: Any, paint: Any) -> None:
    """Put a mesh on the stage, and remove the mesh that had its name."""
    old = bpy.data.objects.get(name)
    if old is not None:
        bpy.data.meshes.remove(old.data)
    vertices, faces = arrays["vertices"], arrays["faces"]
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.shade_smooth()
    mesh.normals_split_custom_set_from_vertices(arrays["normals"].astype(np.float32))
    mesh.materials.append(paint)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def _render(samples: int, prefilter: str | None, seed: int, to: str) -> list[float]:
    """Render and write the picture; return its seconds by the clock, and of all threads.

    prefilter  of the denoiser: NONE, FAST or ACCURATE; None is a raw picture
    """
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = samples, seed
    scene.cycles.use_denoising = prefilter is not None
    scene.cycles.denoising_prefilter = prefilter or "NONE"
    begun = time.perf_counter(), time.process_time()
    bpy.ops.render.render()
    ended = time.perf_counter(), time.process_time()
    bpy.data.images["Render Result"].save_render(str(ROOM / to))
    return [b - a for a, b in zip(begun, ended, strict=True)]


if __name__ == "__main__":
    main()
