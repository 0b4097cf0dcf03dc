"""Mitsuba's sensor: lens, film and sampler. Needs a started engine."""

from __future__ import annotations

import math
from typing import Any

from render.base.render_errors import BadInputError
from render.mitsuba.wide_sensor import wide_sensor
from render.scene.render_camera import Camera
from render.scene.render_quality import Crop
from render.scene.wide_camera import WideCamera


def sensor(camera: Camera, size: tuple[int, int], crop: Crop | None = None) -> dict[str, Any]:
    """Return the sensor: lens, film and Mitsuba's sampler.

    size  width and height of the picture in pixels
    crop  rendered part of it, or None for all

    Raises BadInputError where the focus is not in front of the lens.
    """
    import mitsuba as mi

    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    film |= {"pixel_format": "rgb", "component_format": "float32"}
    if crop is not None:
        x0, y0, x1, y1 = crop
        film |= {"crop_offset_x": x0, "crop_offset_y": y0, "crop_width": x1 - x0, "crop_height": y1 - y0}
    if isinstance(camera, WideCamera):
        return {**wide_sensor(camera), "film": film, "sampler": {"type": "multijitter"}}
    return {
        **_lens(camera),
        "to_world": mi.ScalarTransform4f().look_at(
            origin=list(camera.origin), target=list(camera.target), up=list(camera.up)
        ),
        "fov": math.degrees(camera.field_of_view),
        "fov_axis": "x",
        "near_clip": camera.near,
        "far_clip": camera.far,
        "film": film,
        "sampler": {"type": "multijitter"},
    }


def _lens(camera: Camera) -> dict[str, Any]:
    """Return a pinhole, or a thin lens with one plane in focus."""
    if not camera.has_depth_of_field:
        return {"type": "perspective"}
    if camera.focus_distance <= camera.near:
        where = f"{-camera.focus_distance:.4g} units behind" if camera.focus_distance < 0.0 else "within"
        raise BadInputError(
            f"the camera's focus lies {where} the lens; it must lie before it. Move it, or leave focus out"
        )
    return {
        "type": "thinlens",
        "aperture_radius": camera.lens_radius,
        "focus_distance": camera.focus_distance,
    }
