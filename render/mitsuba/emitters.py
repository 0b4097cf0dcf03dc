"""Lights as Mitsuba's emitters. An engine must have been started before anything here is called."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.scene import daylight, environment
from render.scene.camera import Camera
from render.scene.lights import LightRig, Sky, Softbox, Sun


def emitters(lights: LightRig, to_scene: NDArray[np.float64]) -> dict[str, Any]:
    """Everything that shines, by the name it has in the scene. to_scene: (4, 4), from stage units"""
    softboxes = {f"softbox{index}": _softbox(each, to_scene) for index, each in enumerate(lights.softboxes)}
    suns = {f"sun{index}": _sun(each, to_scene) for index, each in enumerate(lights.suns)}
    return {**softboxes, **suns, "sky": _around(lights)}


def _around(lights: LightRig) -> dict[str, Any]:
    """What shines from all sides; daylight and pictures of places stand still in the scene."""
    if lights.daylight:
        return daylight.emitter(lights.daylight)
    if lights.environment:
        return environment.emitter(lights.environment)
    return _sky(lights.sky)


def any_in_view(
    lights: LightRig, to_scene: NDArray[np.float64], camera: Camera, size: tuple[int, int]
) -> bool:
    """Whether a lamp may stand in the picture, of width and height `size` in pixels."""
    return any(_in_view(lamp, to_scene, camera, size) for lamp in lights.softboxes)


def _in_view(lamp: Softbox, to_scene: NDArray[np.float64], camera: Camera, size: tuple[int, int]) -> bool:
    """Whether a lamp may stand in the picture: no side of the view has all of a cube around it outside.

    The view from all of the lens is wider than that from its middle, but where it is focused.
    """
    reach = math.hypot(lamp.width, lamp.height) / 2.0
    corners = np.array(list(itertools.product((-reach, reach), repeat=3))) + lamp.position
    seen = (corners @ to_scene[:3, :3].T + to_scene[:3, 3] - camera.origin) @ camera.axes().T
    right, up, depth = seen.T
    widening = camera.lens_radius * np.abs(depth / camera.focus_distance - 1.0)
    half_width = math.tan(camera.field_of_view / 2.0) * depth
    across, upwards = half_width + widening, half_width * size[1] / size[0] + widening
    outside = (right > across, right < -across, up > upwards, up < -upwards, depth < 0.0)
    return not any(side.all() for side in outside)


def _softbox(softbox: Softbox, to_scene: NDArray[np.float64]) -> dict[str, Any]:
    import mitsuba as mi

    half = mi.ScalarTransform4f().scale([softbox.width / 2.0, softbox.height / 2.0, 1.0])
    facing = mi.ScalarTransform4f().look_at(
        origin=list(softbox.position), target=list(softbox.target), up=_up_for(softbox)
    )
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(to_scene.tolist()) @ facing @ half,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.0, 0.0, 0.0]}},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(softbox.radiance)}},
    }


def _up_for(softbox: Softbox) -> list[float]:
    """The vertical, or for a lamp straight above the direction away from the camera's usual side."""
    x, _, z = np.subtract(softbox.target, softbox.position)
    return [0.0, 1.0, 0.0] if math.hypot(x, z) > 1e-3 else [0.0, 0.0, -1.0]


def _sun(sun: Sun, to_scene: NDArray[np.float64]) -> dict[str, Any]:
    direction = to_scene[:3, :3] @ sun.direction
    return {
        "type": "directional",
        "direction": list(direction / np.linalg.norm(direction)),
        "irradiance": {"type": "rgb", "value": list(sun.irradiance)},
    }


def _sky(sky: Sky) -> dict[str, Any]:
    import mitsuba as mi

    if sky.is_uniform:
        return {"type": "constant", "radiance": {"type": "rgb", "value": list(sky.zenith)}}
    height = np.cos((np.arange(64) + 0.5) / 64 * math.pi)[:, None]
    end = np.where(height > 0.0, np.array(sky.zenith), np.array(sky.nadir))
    rows = np.array(sky.horizon) + np.abs(height) ** 0.6 * (end - np.array(sky.horizon))
    picture = np.broadcast_to(rows[:, None, :], (64, 8, 3)).astype(np.float32)
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture))}
