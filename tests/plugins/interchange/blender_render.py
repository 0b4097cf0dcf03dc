"""Blender's Cycles renders one frame of an exported stage, with motion blur by its velocities.

    python -P tests/plugins/interchange/blender_render.py STAGE FRAME WIDTH HEIGHT SAMPLES SHUTTER RESULT.exr

SHUTTER is in frames. It needs bpy, and no module of this project.
"""

from __future__ import annotations

import sys

import bpy


def main(path: str, frame: int, size: tuple[int, int], samples: int, shutter: float, result: str) -> None:
    """Open a stage as it comes into a new file of Blender, and render a frame as linear EXR."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("world")  # as a new file has it; the sky becomes its background
    bpy.ops.wm.usd_import(filepath=path)
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.use_denoising = samples, True
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.camera = next(each for each in bpy.data.objects if each.type == "CAMERA")
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = shutter > 0.0, shutter
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = result
    scene.frame_set(frame)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    stage, frame, width, height, samples, shutter, result = sys.argv[1:]
    main(stage, int(frame), (int(width), int(height)), int(samples), float(shutter), result)
