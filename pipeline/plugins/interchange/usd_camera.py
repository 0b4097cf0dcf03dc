"""The camera of a shot as UsdGeomCamera, with a time sample of each frame.

USD measures focal lengths and sensors in tenths of a scene unit. So a lens of 50 mm is 0.5 where a scene unit
is a metre, and reads as 50 mm in programs that heed `metersPerUnit`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pipeline.arrays import Floats
from render.scene.render_camera import Camera

if TYPE_CHECKING:
    from pxr import Usd


class CameraSettings(NamedTuple):
    """Settings of a camera that hold for all frames.

    aspect        width to height of the picture
    sensor_width  of the longer side of the picture, millimetres
    unit          metres in a scene unit
    exposure      stops
    """

    aspect: float
    sensor_width: float
    unit: float
    exposure: float


def add_camera(
    stage: Usd.Stage,
    path: str,
    cameras: Mapping[int, Camera],
    shutters: Mapping[int, tuple[float, float] | None],
    settings: CameraSettings,
) -> None:
    """Add a camera to a stage; what is the same in all frames has no time samples.

    cameras   by frame number
    shutters  opening and closing by frame number, in frames from the frame; None without motion blur
    """
    from pxr import Gf, UsdGeom

    camera = UsdGeom.Camera.Define(stage, path)
    width = settings.sensor_width * min(1.0, settings.aspect)
    tenths = width / 100.0 / settings.unit  # tenths of a scene unit
    camera.CreateHorizontalApertureAttr(tenths)
    camera.CreateVerticalApertureAttr(tenths / settings.aspect)
    if settings.exposure:
        camera.CreateExposureAttr(settings.exposure)
    placed = UsdGeom.Xformable(camera).AddTransformOp()
    sample(placed.GetAttr(), {n: Gf.Matrix4d(_matrix(c).tolist()) for n, c in cameras.items()})
    focal = {n: tenths / 2.0 / math.tan(c.field_of_view / 2.0) for n, c in cameras.items()}
    sample(camera.CreateFocalLengthAttr(), focal)
    sample(camera.CreateFocusDistanceAttr(), {n: _focus(c) for n, c in cameras.items()})
    stops = {n: focal[n] / 10.0 / (2.0 * c.lens_radius) if c.lens_radius else 0.0 for n, c in cameras.items()}
    sample(camera.CreateFStopAttr(), stops)
    sample(camera.CreateClippingRangeAttr(), {n: Gf.Vec2f(c.near, c.far) for n, c in cameras.items()})
    sample(camera.CreateShutterOpenAttr(), {n: (s or (0.0, 0.0))[0] for n, s in shutters.items()})
    sample(camera.CreateShutterCloseAttr(), {n: (s or (0.0, 0.0))[1] for n, s in shutters.items()})


def sample(attribute: Usd.Attribute, values: Mapping[int, Any]) -> None:
    """Set an attribute to values by frame number, or to one value where all are the same."""
    different = iter(values.values())
    first = next(different)
    if all(value == first for value in different):
        attribute.Set(first)
        return
    for number, value in values.items():
        attribute.Set(value, float(number))


def _matrix(camera: Camera) -> Floats:
    """Return the transform (4, 4) of a camera, for row vectors; a camera of USD looks along -z."""
    right, up, forward = camera.axes()
    matrix = np.eye(4)
    matrix[:3, :3] = right, up, -forward
    matrix[3, :3] = camera.origin
    return matrix


def _focus(camera: Camera) -> float:
    """Return the distance in focus, scene units; that of the target where all is sharp."""
    if camera.has_depth_of_field:
        return camera.focus_distance
    return math.dist(camera.origin, camera.target)
