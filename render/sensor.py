"""A camera as Mitsuba's sensor. An engine must have been started before anything here is called."""

from __future__ import annotations

import math
from typing import Any

from render.camera import Camera


def sensor(camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """The lens and the film behind it. size: width and height in pixels"""
    import mitsuba as mi

    return {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=list(camera.origin), target=list(camera.target), up=list(camera.up)
        ),
        "fov": math.degrees(camera.field_of_view),
        "fov_axis": "x",
        "near_clip": camera.near,
        "far_clip": camera.far,
        "film": {
            "type": "hdrfilm",
            "width": size[0],
            "height": size[1],
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "multijitter"},
    }
