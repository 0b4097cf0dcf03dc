"""Mitsuba's sensor: lens, film and sampler. Needs a started engine."""

from __future__ import annotations

import math
from typing import Any

from flowsculpt.render.base.render_errors import BadInputError, MachineError
from flowsculpt.render.mitsuba.engine import is_compiled
from flowsculpt.render.scene.render_camera import Camera, WideCamera
from flowsculpt.render.scene.render_quality import Crop


def sensor(camera: Camera, size: tuple[int, int], crop: Crop | None = None) -> dict[str, Any]:
    """Return the sensor: lens, film and Mitsuba's sampler.

    size  width and height of the picture in pixels
    crop  rendered part of it, or None for all

    Raises BadInputError where the focus is not in front of the lens, MachineError for a wide camera in the
    scalar variant.
    """
    import mitsuba as mi

    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    film |= {"pixel_format": "rgb", "component_format": "float32"}
    if crop is not None:
        x0, y0, x1, y1 = crop
        film |= {"crop_offset_x": x0, "crop_offset_y": y0, "crop_width": x1 - x0, "crop_height": y1 - y0}
    origin, target, up = (list(vector) for vector in (camera.origin, camera.target, camera.up))
    return {
        **(_wide(camera) if isinstance(camera, WideCamera) else _perspective(camera)),
        "to_world": mi.ScalarTransform4f().look_at(origin=origin, target=target, up=up),
        "film": film,
        "sampler": {"type": "multijitter"},
    }


def _perspective(camera: Camera) -> dict[str, Any]:
    """Return a pinhole, or a thin lens with one plane in focus."""
    view = {
        "fov": math.degrees(camera.field_of_view),
        "fov_axis": "x",
        "near_clip": camera.near,
        "far_clip": camera.far,
    }
    if not camera.has_depth_of_field:
        return {"type": "perspective", **view}
    if camera.focus_distance <= camera.near:
        where = f"{-camera.focus_distance:.4g} units behind" if camera.focus_distance < 0.0 else "within"
        raise BadInputError(
            f"the camera's focus lies {where} the lens; it must lie before it. Move it, or leave focus out"
        )
    lens = {"aperture_radius": camera.lens_radius, "focus_distance": camera.focus_distance}
    return {"type": "thinlens", **view, **lens}


def _wide(camera: WideCamera) -> dict[str, Any]:
    """Return our sensor. Raises MachineError in the scalar variant, which would call Python for every ray."""
    if not is_compiled():
        raise MachineError(
            f"projection {camera.wide.kind} needs a compiled variant, llvm_ad_rgb or cuda_ad_rgb, and this "
            "process renders with scalar_rgb; run `flowsculpt doctor`, or render in perspective"
        )
    from flowsculpt.render.mitsuba.custom_plugins import WIDE  # needs a compiled variant

    wide = camera.wide
    half = camera.eye_distance / 2.0
    return {"type": WIDE, "kind": wide.kind, "angle": wide.angle, "half_eye_distance": half}
