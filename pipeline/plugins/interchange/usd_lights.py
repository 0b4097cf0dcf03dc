"""The lights of a shot as UsdLux: softboxes, suns and what surrounds the scene.

UsdLux says radiance as intensity times colour or, where `normalize` is set, as that over the area of a light
in the scene. Softboxes are written so, with the area at each frame, because Blender 5.0 takes intensity for
power.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.plugins.interchange.usd_camera import sample
from render.base.serialise import Colour, Triple
from render.mitsuba.emitters import gradient_map
from render.post.image import write_exr
from render.scene.aovs import RenderedFrame
from render.scene.scene_lights import LightRig, Softbox, Sun
from render.scene.sky import SUN_WIDTH

if TYPE_CHECKING:
    from pxr import Usd


def sky_map(lights: LightRig) -> AnyArray | None:
    """Return the radiance (H, W, 3) around the scene, linear Rec.709, or None where it needs no map.

    A sun and sky of daylight becomes a gradient. Raises BadInputError where an environment map cannot be
    read.
    """
    if lights.environment is not None:
        return lights.environment.pixels()
    sky = lights.without_maps().sky
    return None if sky.is_uniform else gradient_map(sky)


def write_picture(path: Path, pixels: AnyArray) -> None:
    """Write linear pixels (H, W, 3) to an EXR of floats. Raises MachineError where the disk refuses."""
    write_exr(path, RenderedFrame({"beauty": pixels}), {}, {"beauty": "float"})


def add_lights(
    stage: Usd.Stage, home: str, turned: str, lights: LightRig, sizes: Mapping[int, float], map_name: str
) -> None:
    """Add the lights of a rig to a stage.

    home      path of the prim below which lights keep their place in the scene
    turned    path of the prim that carries the set, in stage units
    sizes     scene units in a stage unit, by frame number
    map_name  the file of `sky_map`, relative to the stage
    """
    names: set[str] = set()
    for index, box in enumerate(lights.softboxes, 1):
        _add_softbox(stage, f"{turned}/{_free(box.name or f'softbox{index}', names)}", box, sizes)
    for sun in lights.suns:
        _add_sun(stage, f"{turned}/{_free('sun', names)}", sun)
    if lights.daylight is not None:
        for sun in lights.without_maps().suns[len(lights.suns) :]:
            _add_sun(stage, f"{home}/{_free('sun', names)}", sun, lights.daylight.width)
    _add_dome(stage, f"{home}/sky", lights, map_name)


def _add_softbox(stage: Usd.Stage, path: str, box: Softbox, sizes: Mapping[int, float]) -> None:
    from pxr import Gf, UsdGeom, UsdLux

    light = UsdLux.RectLight.Define(stage, path)
    light.CreateWidthAttr(box.width)
    light.CreateHeightAttr(box.height)
    light.CreateNormalizeAttr(True)
    brightest = _set_colour(light, box.radiance)
    area = box.width * box.height
    sample(light.GetIntensityAttr(), {n: brightest * area * size**2 for n, size in sizes.items()})
    matrix = facing(box.position, np.subtract(box.target, box.position))
    UsdGeom.Xformable(light).AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))


def _add_sun(stage: Usd.Stage, path: str, sun: Sun, width: float = SUN_WIDTH) -> None:
    """Add a distant light. `width` is its angular diameter, radians."""
    from pxr import Gf, UsdGeom, UsdLux

    light = UsdLux.DistantLight.Define(stage, path)
    light.CreateAngleAttr(math.degrees(width))
    light.CreateNormalizeAttr(True)  # its colour is then irradiance, whatever its width
    _set_colour(light, sun.irradiance)
    matrix = facing((0.0, 0.0, 0.0), np.array(sun.direction))
    UsdGeom.Xformable(light).AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))


def _add_dome(stage: Usd.Stage, path: str, lights: LightRig, map_name: str) -> None:
    """Add what surrounds the scene, unless it is black."""
    from pxr import Sdf, UsdGeom, UsdLux

    sky = lights.without_maps().sky
    if lights.environment is None and sky.is_black:
        return
    light = UsdLux.DomeLight.Define(stage, path)
    if lights.environment is None and sky.is_uniform:
        _set_colour(light, sky.zenith)
        return
    light.CreateTextureFileAttr(Sdf.AssetPath(f"./{map_name}"))
    light.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
    if lights.environment is not None:
        light.CreateIntensityAttr(lights.environment.intensity)
        # The middle of a map is at +z in UsdLux, and at -z in shot files.
        UsdGeom.Xformable(light).AddRotateYOp().Set(180.0 + math.degrees(lights.environment.turn))


def _set_colour(light: Any, radiance: Colour) -> float:
    """Set intensity and colour of a light; the colour's largest component is 1. Return the intensity."""
    from pxr import Gf

    brightest = max(*radiance, 1e-9)
    light.CreateIntensityAttr(brightest)
    light.CreateColorAttr(Gf.Vec3f(*(part / brightest for part in radiance)))
    return brightest


def facing(position: Triple, direction: Sequence[float] | Floats) -> Floats:
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
    from pxr import Tf

    valid = Tf.MakeValidIdentifier(name)
    while valid in taken:
        valid += "_"
    taken.add(valid)
    return str(valid)
