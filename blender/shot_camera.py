# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera of a shot, from its frames to Blender, and from Blender to the shot file.

Blender's camera has z up in the scene; the shot's has y. Both have the field of view across the longer side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import bpy
from mathutils import Matrix, Vector

from .flow_empties import tidy
from .key_curves import Key, curves_of, remove_curves, write_keys

CLOSE = 1e-4
"""Keys that lines between others reproduce so closely, relative to the values, are left out."""

IN_PLACE_OF_POSITION = ("azimuth", "elevation", "orbit", "distance", "dolly")


def show_camera(
    camera: bpy.types.Object, listing: dict[str, Any], numbers: Sequence[int], scene: bpy.types.Scene
) -> None:
    """Give a camera object, whose parent has y up, the shot's view: constant, or a key at each frame."""
    framed = [listing["cameras"][str(number)] for number in numbers]
    camera.rotation_mode = "QUATERNION"
    turns = [_turned(view) for view in framed]
    for before, after in pairwise(turns):
        after.make_compatible(before)
    _animate(camera, "location", numbers, [tuple(view["position"]) for view in framed])
    _animate(camera, "rotation_quaternion", numbers, [tuple(turn) for turn in turns])
    data, aspect = camera.data, listing["aspect"]
    data.sensor_fit = "AUTO"
    views = [view["field_of_view"] for view in framed]
    data.type = "PERSP" if None not in views else "PANO"
    if None not in views:
        lenses = [_lens(_across_longer_side(view, aspect), data.sensor_width) for view in views]
        _animate(data, "lens", numbers, [(lens,) for lens in lenses])
    longer = max(scene.render.resolution_x, scene.render.resolution_y)
    size = (longer, longer / aspect) if aspect >= 1.0 else (longer * aspect, longer)
    scene.render.resolution_x, scene.render.resolution_y = (2 * round(side / 2) for side in size)


def _turned(view: dict[str, Any]) -> Any:
    """Return the rotation of a view: a camera looks along its own −z, with y up."""
    forward = (Vector(view["target"]) - Vector(view["position"])).normalized()
    right = forward.cross(Vector(view["up"])).normalized()
    return Matrix((right, right.cross(forward), -forward)).transposed().to_quaternion()


def _across_longer_side(horizontal: float, aspect: float) -> float:
    """Return the field of view across the longer side, radians, of a horizontal one in degrees."""
    half = math.tan(math.radians(horizontal) / 2.0)
    return 2.0 * math.atan(half if aspect >= 1.0 else half / aspect)


def _lens(angle: float, sensor: float) -> float:
    return sensor / 2.0 / math.tan(angle / 2.0)


def _animate(
    owner: bpy.types.ID, path: str, numbers: Sequence[int], values: Sequence[tuple[float, ...]]
) -> None:
    """Set a property, or key it at the frames that lines between the keys need."""
    remove_curves(owner, path)
    kept = _needed(numbers, values)
    if len(kept) == 1:
        setattr(owner, path, values[0] if len(values[0]) > 1 else values[0][0])
    else:
        write_keys(owner, path, [Key(numbers[i], values[i], "linear") for i in kept], "hold", "hold")


def _needed(numbers: Sequence[int], values: Sequence[tuple[float, ...]]) -> list[int]:
    """Return the indices of the values that are needed so that lines between them come close to all."""
    size = CLOSE * max(1.0, *(abs(number) for value in values for number in value))

    def worst(first: int, last: int) -> tuple[float, int]:
        found = (0.0, first)
        for index in range(first + 1, last):
            share = (numbers[index] - numbers[first]) / (numbers[last] - numbers[first])
            off = max(
                abs(a + share * (b - a) - c)
                for a, b, c in zip(values[first], values[last], values[index], strict=True)
            )
            found = max(found, (off, index))
        return found

    last = len(values) - 1
    if all(abs(a - b) <= size for value in values for a, b in zip(value, values[0], strict=True)):
        return [0]
    kept, waiting = {0, last}, [(0, last)]
    while waiting:
        first, end = waiting.pop()
        off, index = worst(first, end)
        if off > size:
            kept.add(index)
            waiting += [(first, index), (index, end)]
    return sorted(kept)


def camera_edits(
    camera: bpy.types.Object,
    root: bpy.types.Object,
    middle: Vector,
    values: Sequence[dict[str, Any]],
    numbers: Sequence[int],
    at_frame: Callable[[int], None],
) -> list[dict[str, Any]]:
    """Return the edits that give the shot a camera of Blender: position, target, roll and lens.

    middle    of the sculpture, in the root's space; the target is as far away
    values    of the shot file
    at_frame  has Blender show a frame
    """
    is_still = camera.animation_data is None and camera.parent in (None, root) and not camera.constraints
    is_still = is_still and not curves_of(camera.data, "lens")
    frames = list(numbers[:1] if is_still else numbers)
    given = {
        value["where"][1]: value for value in values if value["where"][0] == "camera" and value["is_given"]
    }
    sensor = given["sensor_width"]["value"] if "sensor_width" in given else 36.0
    uses_length = "focal_length" in given
    views = []
    for number in frames:
        at_frame(number)
        place = root.matrix_world.inverted() @ camera.matrix_world
        position, turn = place.to_translation(), place.to_quaternion().to_matrix()
        forward, up = -turn.col[2], turn.col[1]
        distance = max((middle - position).dot(forward), 0.1)
        level = forward.cross(Vector((0.0, 1.0, 0.0))).normalized()
        roll = math.degrees(math.atan2(up.dot(level), up.dot(level.cross(forward))))
        lens = _lens(camera.data.angle, sensor) if uses_length else math.degrees(camera.data.angle)
        views.append((tuple(position), tuple(position + distance * forward), (roll,), (lens,)))
    names = ("position", "target", "roll", "focal_length" if uses_length else "field_of_view")
    edits = []
    for name, column in zip(names, zip(*views, strict=True), strict=True):
        value = _keyed(frames, column)
        if name != "roll" or value != 0 or "roll" in given:
            edits.append({"kind": "set", "where": ["camera", name], "value": value})
    stale = [name for name in IN_PLACE_OF_POSITION if name in given]
    return [*edits, *({"kind": "remove", "where": ["camera", name]} for name in stale)]


def _keyed(frames: Sequence[int], values: Sequence[tuple[float, ...]]) -> Any:
    def written(value: tuple[float, ...]) -> Any:
        return [tidy(round(number, 5)) for number in value] if len(value) > 1 else tidy(round(value[0], 5))

    kept = _needed(frames, values)
    if len(kept) == 1:
        return written(values[0])
    return {"ease": "linear", "keys": {str(frames[i]): written(values[i]) for i in kept}}
