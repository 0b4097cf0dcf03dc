"""Mitsuba's sensor: lens, film and sampler. Needs a started engine.

The sensor of wide cameras is a plugin of ours, since Mitsuba has no fisheye and no stereo camera.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from render.base.render_errors import BadInputError, MachineError
from render.mitsuba.engine import is_compiled
from render.scene.render_camera import Camera, Projection, WideCamera
from render.scene.render_quality import Crop


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


_NAME = "flowsculpt_wide"


def wide_sensor(camera: WideCamera) -> dict[str, Any]:
    """Return the description of the sensor, without its film. Needs a started engine.

    Raises MachineError for the scalar variant, which would call Python for every ray.
    """
    import mitsuba as mi

    if not is_compiled():
        raise MachineError(
            f"projection {camera.wide.kind} needs a compiled variant, llvm_ad_rgb or cuda_ad_rgb, and this "
            "process renders with scalar_rgb; run `flowsculpt doctor`, or render in perspective"
        )
    _register()
    # Mitsuba's axes are left, up and forward.
    to_world = mi.ScalarTransform4f().look_at(
        origin=list(camera.origin), target=list(camera.target), up=list(camera.up)
    )
    return {
        "type": _NAME,
        "to_world": to_world,
        "kind": camera.wide.kind,
        "angle": camera.wide.angle,
        "half_eye_distance": camera.eye_distance / 2.0,
    }


@cache
def _register() -> None:
    """Register the sensor with Mitsuba, whose classes exist once a variant is chosen."""
    import drjit as dr
    import mitsuba as mi

    class WideSensor(mi.Sensor):
        """Sample rays by the formulas of `Projection.directions`."""

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.projection = Projection(properties["kind"], properties["angle"])
            self.half_eye_distance = properties["half_eye_distance"]

        def sample_ray(
            self, time: Any, wavelength: Any, position: Any, aperture: Any, active: Any = True
        ) -> tuple[Any, Any]:
            """Return a ray through a place (0 … 1) of the rendered part, and its weight."""
            film = self.film()
            size = mi.ScalarVector2f(film.size())
            crop, corner = mi.ScalarVector2f(film.crop_size()), mi.ScalarVector2f(film.crop_offset())
            x = (position.x * crop.x + corner.x) / size.x * 2.0 - 1.0
            y = 1.0 - (position.y * crop.y + corner.y) / size.y * 2.0
            direction, eye, shown = self._direction(x, y)
            to_world = self.world_transform()
            origin = to_world @ mi.Point3f(-self.half_eye_distance * eye, 0.0, 0.0)
            ray = mi.Ray3f(origin, to_world @ direction, time)
            ray.maxt[~shown] = 0.0
            return ray, dr.select(shown, mi.Color3f(1.0), 0.0)

        def _direction(self, x: Any, y: Any) -> tuple[Any, Any, Any]:
            """Return the direction left, up and forward, the eye, and whether the picture shows something."""
            if self.projection.kind == "dome":
                radius = dr.sqrt(x * x + y * y)
                sine, away = dr.sincos(0.5 * self.projection.angle * radius)
                scale = sine / dr.maximum(radius, 1e-12)
                return mi.Vector3f(-scale * x, scale * y, away), mi.Float(0.0), radius <= 1.0
            eye = dr.select(x < 0.0, mi.Float(-1.0), 1.0) if self.projection.is_stereo else mi.Float(0.0)
            sine, cosine = dr.sincos(math.pi * x - 0.5 * math.pi * eye)
            up, level = dr.sincos(0.5 * math.pi * y)
            return mi.Vector3f(-level * sine, up, level * cosine), eye, mi.Bool(True)

        def sample_ray_differential(
            self, time: Any, wavelength: Any, position: Any, aperture: Any, active: Any = True
        ) -> tuple[Any, Any]:
            """Return the ray without differentials: no texture of ours is filtered by them."""
            ray, weight = self.sample_ray(time, wavelength, position, aperture, active)
            return mi.RayDifferential3f(ray), weight

        def bbox(self) -> Any:
            """Return the place of the camera."""
            return mi.ScalarBoundingBox3f(self.world_transform() @ mi.ScalarPoint3f(0.0))

        def to_string(self) -> str:
            """Return its name."""
            return f"{_NAME}[{self.projection.kind}]"

    mi.register_sensor(_NAME, WideSensor)
