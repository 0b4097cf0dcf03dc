"""The picture of docs/blender.md: a shot opened in Blender, and rendered by Cycles.

`make blender` installs Blender as a module. Cycles shows no empties, so each is drawn as Blender's viewport
does, by curves: an arrow along its axis and a ring of its radius. `--root` is the show, by default this
project.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

PICTURE = Path(__file__).with_suffix(".webp")
SHOT, FRAMES, SIZE = "A010_cube", (12, 26, 40), (480, 400)
ORANGE, DARK = (1.0, 0.32, 0.02, 1.0), (0.022, 0.022, 0.022, 1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path())
    root = parser.parse_args().root.resolve()
    home = os.environ.get("BLENDER_MODULE", Path(sys.prefix) / "cycles")
    with tempfile.TemporaryDirectory() as folder:
        builder = Path(__file__).parents[2] / "blender" / "build_extension.py"
        package = subprocess.run(
            [sys.executable, builder, folder], check=True, capture_output=True, text=True
        )
        environment = {**os.environ, "PYTHONPATH": str(home), "BLENDER_USER_RESOURCES": folder}
        words = [package.stdout.strip(), Path(sys.executable).with_name("flowsculpt"), root, folder]
        subprocess.run([sys.executable, "-P", __file__, "--in-blender", *words], check=True, env=environment)
        join([Path(folder) / f"{number}.png" for number in FRAMES])


def join(files: list[Path]) -> None:
    """Put pictures next to each other."""
    from PIL import Image

    together = Image.new("RGB", (SIZE[0] * len(files), SIZE[1]))
    for column, file in enumerate(files):
        with Image.open(file) as picture:
            together.paste(picture.convert("RGB"), (column * SIZE[0], 0))
    together.save(PICTURE, quality=86, method=6)


def draw(package: str, program: str, root: str, folder: str) -> None:
    """Open the shot in Blender and render frames of it."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(filepath=package, repo="user_default", enable_on_install=True)
    bpy.context.preferences.addons["bl_ext.user_default.flowsculpt"].preferences.program = program
    scene = bpy.context.scene
    scene.flowsculpt.folder, scene.flowsculpt.shot = root, SHOT
    bpy.ops.flowsculpt.open()
    bpy.ops.flowsculpt.make()
    clay = shaded("clay", (0.62, 0.56, 0.5, 1.0), 0.0)
    sculpture = bpy.data.objects[f"{SHOT} sculpture"]
    sculpture.material_slots[0].material = clay
    for item in list(bpy.data.objects):
        if item.type == "EMPTY" and item.empty_display_type == "SINGLE_ARROW":
            draw_empty(bpy, item)
    light(bpy, scene)
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 24, True
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    for number in FRAMES:
        scene.frame_set(number)
        scene.render.filepath = f"{folder}/{number}.png"
        bpy.ops.render.render(write_still=True)


def shaded(name: str, colour: tuple[float, float, float, float], glow: float) -> object:
    """Return a material that is matt, or shines."""
    import bpy

    material = bpy.data.materials.new(name)
    material.use_nodes = True
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = colour
    surface.inputs["Roughness"].default_value = 0.6
    surface.inputs["Emission Color"].default_value = colour
    surface.inputs["Emission Strength"].default_value = glow
    return material


def draw_empty(bpy: object, empty: object) -> None:
    """Draw an empty's axis, twice its radius long, and rings around it as thin glowing curves."""
    material = bpy.data.materials.get("empty") or shaded("empty", ORANGE, 1.4)
    turns = [2.0 * math.pi * step / 64 for step in range(65)]
    has_radius = not all(empty.lock_scale)
    ring = [(math.cos(turn), math.sin(turn), 0.0) for turn in turns]
    lines = [[(0, 0, -2), (0, 0, 2)], [(0.08, 0, 1.84), (0, 0, 2), (-0.08, 0, 1.84)]]
    lines += [ring] if has_radius else []
    curve = bpy.data.curves.new(empty.name, "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.012
    for line in lines:
        spline = curve.splines.new("POLY")
        spline.points.add(len(line) - 1)
        for point, place in zip(spline.points, line, strict=True):
            point.co = (*place, 1.0)
    curve.materials.append(material)
    drawn = bpy.data.objects.new(f"{empty.name} drawn", curve)
    bpy.context.scene.collection.objects.link(drawn)
    drawn.parent = empty


def light(bpy: object, scene: object) -> None:
    """Light the scene as a viewport does: softly, before a dark grey."""
    world = bpy.data.worlds.new("grey")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = DARK
    scene.world = world
    for energy, turn in ((3.0, (0.7, 0.1, 0.6)), (0.8, (1.0, 0.0, -1.6))):
        sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        sun.data.energy, sun.data.angle, sun.rotation_euler = energy, 0.4, turn
        scene.collection.objects.link(sun)
    scene.view_settings.view_transform = "Standard"
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    scene.collection.objects.link(eye)
    eye.location, eye.rotation_euler, eye.data.lens = (5.2, -8.6, 3.4), (1.26, 0.0, 0.54), 72.0
    scene.camera = eye


if __name__ == "__main__":
    if "--in-blender" in sys.argv:
        draw(*sys.argv[2:])
    else:
        main()
