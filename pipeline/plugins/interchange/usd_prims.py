"""Camera and lights of a shot as prims of a USD stage.

UsdGeomCamera measures focal lengths and sensors in tenths of a scene unit. So a lens of 50 mm is 0.5 where a
scene unit is a metre, and reads as 50 mm in programs that heed `metersPerUnit`.

UsdLux says radiance as intensity times colour or, where `normalize` is set, as that over the area of a light
in the scene. Softboxes are written so, with the area at each frame, because Blender 5.0 takes intensity for
power.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux

from flowsculpt.api.materials import LightRig
from flowsculpt.api.meshes import Floats
from flowsculpt.api.pictures import Camera, RenderedFrame, write_exr
from flowsculpt.pipeline.plugins.interchange.painted_materials import Colour


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
    return camera.focus_distance if camera.has_depth_of_field else math.dist(camera.origin, camera.target)


def write_picture(path: Path, pixels: np.ndarray) -> None:
    """Write linear pixels (H, W, 3) to an EXR of floats. Raises MachineError where the disk refuses."""
    write_exr(path, RenderedFrame({"beauty": pixels}), {}, {"beauty": "float"})


def add_lights(
    stage: Usd.Stage, home: str, turned: str, lights: LightRig, sizes: Mapping[int, float], map_name: str
) -> None:
    """Add the lights of a rig to a stage.

    home      path of the prim below which lights keep their place in the scene
    turned    path of the prim that carries the set, in stage units
    sizes     scene units in a stage unit, by frame number
    map_name  the file of `LightRig.sky_pixels`, relative to the stage
    """
    names: set[str] = set()
    for index, box in enumerate(lights.softboxes, 1):
        path = f"{turned}/{_free(box.name or f'softbox{index}', names)}"
        light = UsdLux.RectLight.Define(stage, path)
        light.CreateWidthAttr(box.width)
        light.CreateHeightAttr(box.height)
        light.CreateNormalizeAttr(True)
        brightest = _set_colour(light, box.radiance)
        area = box.width * box.height
        sample(light.GetIntensityAttr(), {n: brightest * area * size**2 for n, size in sizes.items()})
        matrix = facing(box.position, np.subtract(box.target, box.position))
        UsdGeom.Xformable(light).AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))
    for sun in lights.suns:
        path = f"{turned}/{_free('sun', names)}"
        _add_sun(stage, path, sun.direction, sun.irradiance, sun.WIDTH)
    if lights.daylight is not None:
        for sun in lights.without_maps().suns[len(lights.suns) :]:
            path = f"{home}/{_free('sun', names)}"
            _add_sun(stage, path, sun.direction, sun.irradiance, lights.daylight.width)
    _add_dome(stage, f"{home}/sky", lights, map_name)


Axis = tuple[float, float, float]


def _add_sun(stage: Usd.Stage, path: str, direction: Axis, irradiance: Colour, width: float) -> None:
    """Add a distant light.

    direction  of its rays, (x, y, z)
    width      angular diameter, radians
    """
    light = UsdLux.DistantLight.Define(stage, path)
    light.CreateAngleAttr(math.degrees(width))
    light.CreateNormalizeAttr(True)  # its colour is then irradiance, whatever its width
    _set_colour(light, irradiance)
    matrix = facing((0.0, 0.0, 0.0), np.array(direction))
    UsdGeom.Xformable(light).AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))


def _add_dome(stage: Usd.Stage, path: str, lights: LightRig, map_name: str) -> None:
    """Add what surrounds the scene, unless it is black."""
    is_mapped = lights.environment is not None or lights.daylight is not None
    if not is_mapped and lights.sky.is_black:
        return
    light = UsdLux.DomeLight.Define(stage, path)
    if not is_mapped and lights.sky.is_uniform:
        _set_colour(light, lights.sky.zenith)
        return
    light.CreateTextureFileAttr(Sdf.AssetPath(f"./{map_name}"))
    light.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
    if lights.environment is not None:
        light.CreateIntensityAttr(lights.environment.intensity)
        # The middle of a map is at +z in UsdLux, and at -z in shot files.
        UsdGeom.Xformable(light).AddRotateYOp().Set(180.0 + math.degrees(lights.environment.turn))


def _set_colour(light: Any, radiance: Colour) -> float:
    """Set intensity and colour of a light; the colour's largest component is 1. Return the intensity."""
    brightest = max(*radiance, 1e-9)
    light.CreateIntensityAttr(brightest)
    light.CreateColorAttr(Gf.Vec3f(*(part / brightest for part in radiance)))
    return brightest


def facing(position: Sequence[float], direction: Sequence[float] | Floats) -> Floats:
    """Return the matrix (4, 4), for row vectors, of what stands at a position and faces along -z."""
    back = -np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    up = (0.0, 1.0, 0.0) if math.hypot(back[0], back[2]) > 1e-3 else (0.0, 0.0, -1.0)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(back, right), back
    matrix[3, :3] = position
    return matrix


def _free(name: str, taken: set[str]) -> str:
    """Return a name that a prim can have and none has yet, and take it."""
    valid = Tf.MakeValidIdentifier(name)
    while valid in taken:
        valid += "_"
    taken.add(valid)
    return str(valid)
