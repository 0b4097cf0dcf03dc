"""Blender as a module opens exported files, and tells what it reads of every frame.

    python -P tests/plugins/interchange/blender_reader.py FILE FRAMES RESULT.npz

It needs bpy, and no module of this project.
"""

from __future__ import annotations

import json
import sys

import bpy
import numpy as np


def main(path: str, frames: list[int], result: str) -> None:
    """Import a file, and save the arrays of the sculpture and the camera in each frame."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.endswith(".ply"):
        bpy.ops.wm.ply_import(filepath=path, forward_axis="NEGATIVE_Z", up_axis="Y", import_attributes=True)
    elif path.endswith(".abc"):
        bpy.ops.wm.alembic_import(filepath=path, as_background_job=False)
    elif path.endswith(".glb"):
        bpy.ops.import_scene.gltf(filepath=path)
    else:
        bpy.ops.wm.usd_import(filepath=path)
    scene, found = bpy.context.scene, {}
    meshes = [each for each in bpy.data.objects if each.type == "MESH" and each.name != "floor"]
    for frame in frames:
        scene.frame_set(frame)
        evaluated = meshes[0].evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = evaluated.to_mesh()
        found[f"{frame}.shapes"] = _points_of_shapes()
        found[f"{frame}.points"] = _values(mesh.vertices, "co", 3)
        found[f"{frame}.faces"] = _values(mesh.loops, "vertex_index", 1)
        found[f"{frame}.normals"] = _values(mesh.corner_normals, "vector", 3)
        for name, attribute in mesh.attributes.items():
            if attribute.data_type in ("FLOAT_VECTOR", "FLOAT"):
                size, field = (3, "vector") if attribute.data_type == "FLOAT_VECTOR" else (1, "value")
                found[f"{frame}.{name}"] = _values(attribute.data, field, size)
        found[f"{frame}.placed"] = np.array(evaluated.matrix_world)
        for camera in (each for each in bpy.data.objects if each.type == "CAMERA"):
            lens = camera.data
            found[f"{frame}.camera"] = np.array(camera.matrix_world)
            found[f"{frame}.lens"] = np.array([lens.lens, lens.sensor_width, lens.dof.focus_distance])
            found[f"{frame}.stop"] = np.array(lens.dof.aperture_fstop)
    found["range"] = np.array([scene.frame_start, scene.frame_end])
    found["lights"] = np.array(sorted(each.name for each in bpy.data.objects if each.type == "LIGHT"))
    np.savez(result, **found)


def _points_of_shapes() -> np.ndarray:
    """Return the points (N, V, 3) of all meshes and instances that are shown, none of the floor."""
    shown = []
    for each in bpy.context.evaluated_depsgraph_get().object_instances:
        if each.object.type == "MESH" and each.object.name != "floor":
            points, place = _values(each.object.data.vertices, "co", 3), np.array(each.matrix_world)
            shown.append(points @ place[:3, :3].T + place[:3, 3])
    return np.array(shown)


def _values(items: object, field: str, size: int) -> np.ndarray:
    values = np.empty(len(items) * size, np.int32 if field == "vertex_index" else np.float32)
    items.foreach_get(field, values)
    return values.reshape(-1, size)


if __name__ == "__main__":
    main(sys.argv[1], json.loads(sys.argv[2]), sys.argv[3])
