# SPDX-License-Identifier: GPL-3.0-or-later
"""F-curves of an object or camera, and the keys of a shot file that they stand for.

Easings, handles and extrapolation have Blender's meaning in both. A key's easing leads from it to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
from bpy_extras import anim_utils

Numbers = tuple[float, ...]

NAMED_EASINGS = ("SINE", "QUAD", "CUBIC", "QUART", "QUINT", "EXPO", "CIRC", "BACK", "BOUNCE", "ELASTIC")

OUT_BY_DEFAULT = ("BACK", "BOUNCE", "ELASTIC")
"""Easings that Blender's automatic direction takes as `out`; the others are `in`."""

STAND_INS = {"settle": "elastic_out", "drop": "bounce_out", "drag": "expo_in_out"}
"""What Blender draws in place of easings that it does not have."""

CYCLES = {"loop": "REPEAT", "offset": "REPEAT_OFFSET", "ping_pong": "MIRROR"}


@dataclass(frozen=True)
class Key:
    """A key: its frame, its values in Blender's units, its easing, and its free Bézier handles from it."""

    frame: float
    values: Numbers
    ease: str
    left: tuple[float, Numbers] | None = None
    right: tuple[float, Numbers] | None = None


def curves_of(owner: bpy.types.ID, path: str) -> dict[int, bpy.types.FCurve]:
    """Return the F-curves of a property by the indices of its components."""
    animation = owner.animation_data
    if animation is None or animation.action is None or animation.action_slot is None:
        return {}
    bag = anim_utils.action_get_channelbag_for_slot(animation.action, animation.action_slot)
    return (
        {} if bag is None else {curve.array_index: curve for curve in bag.fcurves if curve.data_path == path}
    )


def remove_curves(owner: bpy.types.ID, path: str) -> None:
    """Remove the F-curves of a property."""
    for curve in curves_of(owner, path).values():
        bag = anim_utils.action_get_channelbag_for_slot(
            owner.animation_data.action, owner.animation_data.action_slot
        )
        bag.fcurves.remove(curve)


def read_keys(owner: bpy.types.ID, path: str, constant: Sequence[float]) -> list[Key]:
    """Return the keys of a property; none where it is not animated.

    constant  the values of components without an F-curve
    """
    curves = curves_of(owner, path)
    points = {index: {round(p.co[0], 3): p for p in curve.keyframe_points} for index, curve in curves.items()}
    frames = sorted({frame for found in points.values() for frame in found})
    keys = []
    for frame in frames:
        values = tuple(
            curves[index].evaluate(frame) if index in curves else float(value)
            for index, value in enumerate(constant)
        )
        main = next(found[frame] for found in points.values() if frame in found)
        here = [points.get(index, {}).get(frame) for index in range(len(constant))]
        keys.append(
            Key(
                frame,
                values,
                _ease_of(main),
                _handle(main, here, "handle_left"),
                _handle(main, here, "handle_right"),
            )
        )
    return keys


def _ease_of(point: bpy.types.Keyframe) -> str:
    name = point.interpolation
    if name not in NAMED_EASINGS:
        return name.lower()
    automatic = "EASE_OUT" if name in OUT_BY_DEFAULT else "EASE_IN"
    direction = automatic if point.easing == "AUTO" else point.easing
    return f"{name}_{direction.removeprefix('EASE_')}".lower()


def _handle(
    main: bpy.types.Keyframe, points: Sequence[bpy.types.Keyframe | None], side: str
) -> tuple[float, Numbers] | None:
    """Return a free handle as frames and values from its key; None for one that Blender places."""
    if getattr(main, f"{side}_type") not in ("FREE", "ALIGNED"):
        return None
    offsets = (0.0 if point is None else getattr(point, side)[1] - point.co[1] for point in points)
    return getattr(main, side)[0] - main.co[0], tuple(offsets)


def write_keys(owner: bpy.types.ID, path: str, keys: Sequence[Key], before: str, after: str) -> None:
    """Replace the F-curves of a property by keys; `before` and `after` are their extrapolation."""
    remove_curves(owner, path)
    animation = owner.animation_data or owner.animation_data_create()
    if animation.action is None:
        animation.action = bpy.data.actions.new(owner.name)
    many = len(keys[0].values) > 1
    for index in range(len(keys[0].values)):
        found = animation.action.fcurve_ensure_for_datablock(owner, path, index=index if many else 0)
        found.keyframe_points.add(len(keys))
        for point, key in zip(found.keyframe_points, keys, strict=True):
            point.co = key.frame, key.values[index]
            _set_ease(point, key)
        for point, key in zip(found.keyframe_points, keys, strict=True):
            for side, handle in (("handle_left", key.left), ("handle_right", key.right)):
                setattr(point, f"{side}_type", "AUTO_CLAMPED" if handle is None else "FREE")
                if handle is not None:
                    setattr(point, side, (key.frame + handle[0], key.values[index] + handle[1][index]))
        _extrapolate(found, before, after)
        found.update()


def _set_ease(point: bpy.types.Keyframe, key: Key) -> None:
    name, _, direction = key.ease.upper().partition("_")
    point.interpolation = name
    if direction:
        point.easing = f"EASE_{direction}"


def _extrapolate(curve: bpy.types.FCurve, before: str, after: str) -> None:
    if "continue" in (before, after):
        curve.extrapolation = "LINEAR"
    if before in CYCLES or after in CYCLES:
        cycles = curve.modifiers.new("CYCLES")
        cycles.mode_before, cycles.mode_after = CYCLES.get(before, "NONE"), CYCLES.get(after, "NONE")


def lock_curves(owner: bpy.types.ID, path: str) -> None:
    """Protect F-curves that show a formula, which cannot be edited by keys."""
    for curve in curves_of(owner, path).values():
        curve.lock = True


def sampled_keys(
    frames: Sequence[float], values: Sequence[Sequence[float]], convert: Callable[[Any], Numbers]
) -> list[Key]:
    """Return linear keys through samples of a formula."""
    return [Key(frame, convert(value), "linear") for frame, value in zip(frames, values, strict=True)]
