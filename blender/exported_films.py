# SPDX-License-Identifier: GPL-3.0-or-later
"""Films that flowsculpt has exported: opened by Blender's importers, without the program."""

from __future__ import annotations

import json
import mmap
import re
import struct
from pathlib import Path

import bpy

from .program import ProgramError

FILM = "flowsculpt_film"
"""Custom property of the collection of a film: the file that was opened."""

SUFFIXES = (".abc", ".usda", ".usdc", ".usd", ".usdz", ".glb")


Timing = tuple[float | None, tuple[int, int] | None]
"""Frames a second, and first and last frame; None where a file does not say."""


def open_film(path: Path, scene: bpy.types.Scene) -> str:
    """Import a film in place of the one before, and take its frames and rate; return what it is.

    Raises ProgramError where the file cannot be shown; the scene stays as it was.
    """
    if not path.is_file():
        raise ProgramError(f"{path}: not found. Choose the file where it is now")
    if path.suffix.lower() not in SUFFIXES:
        forms = "usd, abc or gltf --plain"
        raise ProgramError(f"{path.name}: not a film that Blender opens. Use flowsculpt export {forms}")
    render, earlier = scene.render, [each for each in bpy.data.collections if FILM in each]
    was = render.fps, render.fps_base, scene.frame_start, scene.frame_end
    collection = bpy.data.collections.new(f"Flowsculpt {path.stem}")
    collection[FILM] = str(path)
    scene.collection.children.link(collection)
    layer = bpy.context.view_layer
    active, ours = layer.active_layer_collection, layer.layer_collection.children[collection.name]
    layer.active_layer_collection = ours
    try:
        rate, frames = _timing(path)
        if rate:
            render.fps, render.fps_base = round(rate), round(rate) / rate
        import_file(path, sets_range=True)
        scene.frame_start, scene.frame_end = frames or (scene.frame_start, scene.frame_end)
        scene.frame_set(scene.frame_start)
        _require(_has_faces(collection))
    except Exception as error:  # of damaged files, importers raise anything
        layer.active_layer_collection = active
        _remove(collection)
        render.fps, render.fps_base, scene.frame_start, scene.frame_end = was
        if isinstance(error, ProgramError):
            raise
        raise ProgramError(f"{path.name}: damaged, or not a film of flowsculpt. Export it again") from None
    layer.active_layer_collection = active
    for each in earlier:
        _remove(each)
    scene.camera = scene.camera or next((o for o in collection.all_objects if o.type == "CAMERA"), None)
    held = "" if rate else ", the scene's rate: the file has none"
    shown = f"frames {scene.frame_start} to {scene.frame_end}, {render.fps / render.fps_base:g} a second"
    return f"{path.name}: {shown}{held}"


def import_file(path: Path, sets_range: bool = False) -> None:
    """Import a file by the importer of its suffix. Raises ProgramError where Blender refuses it."""
    file, kind = {"filepath": str(path)}, path.suffix.lower()
    try:
        if kind == ".abc":
            done = bpy.ops.wm.alembic_import(**file, as_background_job=False, set_frame_range=sets_range)
        elif kind == ".glb":
            done = bpy.ops.import_scene.gltf(**file)
        else:
            done = bpy.ops.wm.usd_import(**file, set_frame_range=sets_range)
    except RuntimeError as error:
        reason = str(error).removeprefix("Error: ").split("\n")[0].strip()
        remedy = "Export it with --plain" if "meshopt" in reason else "Export it again"
        raise ProgramError(f"{path.name}: Blender cannot import it: {reason}. {remedy}") from None
    _require(done == {"FINISHED"})


def _timing(path: Path) -> Timing:
    """Read the frames and rate of a film. Raises ProgramError where files beside it are missing."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        kind, names = path.suffix.lower(), list[str]()
        if content[:5] == b"#usda":
            names = [name.decode() for name in re.findall(rb"@\./([^@\n]+)@", content)]
        missing = [name for name in dict.fromkeys(names) if not (path.parent / name).is_file()]
        if missing:
            others = f" and {len(missing) - 1} more are" if missing[1:] else " is"
            raise ProgramError(f"{path.name}: {missing[0]}{others} missing beside it. Copy its whole folder")
        if kind == ".glb":
            clips = json.loads(content[20 : 20 + struct.unpack_from("<I", content, 12)[0]])["animations"]
            rate, first, last = (clips[0].get("extras", {}).get(name) for name in ("rate", "first", "last"))
            return rate, None if rate is None else (0, last - first)
        if kind == ".abc":  # Blender ends where a file that is cut short leads it beyond its end
            _require(content[:6] == b"Ogawa\xff" and struct.unpack_from("<Q", content, 8)[0] < len(content))
        rate = re.search(rb"(?:_ai_DCC_FPS=|timeCodesPerSecond = )([\d.]+)", content)
        return float(rate[1]) if rate else None, None


def _require(is_whole: bool) -> None:
    if not is_whole:
        raise ValueError("a damaged file")


def _has_faces(collection: bpy.types.Collection) -> bool:
    graph, ours = bpy.context.evaluated_depsgraph_get(), {each.name for each in collection.all_objects}
    shapes = (each.object for each in graph.object_instances if each.object.name in ours)
    return any(shape.type == "MESH" and len(shape.data.polygons) > 0 for shape in shapes)


def _remove(collection: bpy.types.Collection) -> None:
    for item in list(collection.all_objects):
        bpy.data.objects.remove(item)
    for each in (*collection.children_recursive, collection):
        bpy.data.collections.remove(each)
