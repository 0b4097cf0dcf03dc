"""Light rigs as Mitsuba's emitters. Functions need a started engine."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.mitsuba.engine import is_compiled
from flowsculpt.render.mitsuba.loading import load_part
from flowsculpt.render.scene.clear_sky import map_directions
from flowsculpt.render.scene.render_camera import unit
from flowsculpt.render.scene.rgb_spaces import LUMA, REC709, converted_pixels
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import BACKGROUND, LightRig, Sky, Softbox, Sun, SunDisc
from flowsculpt.render.scene.sky import Daylight, Environment, exposure_of

_MAP_ROWS, _COARSE = 1024, 8
"""Rows of a map of daylight, and how many times fewer the sky is computed at."""

_MAP_EDGE, _DISC_EDGE = 1.5, 1e-4
"""Width of the sun's edge beyond its disc: in pixels of a map, and in radians."""


def emitters(lights: LightRig, to_scene: NDArray[np.float64]) -> dict[str, Any]:
    """Return the emitters by their names in the scene. to_scene: (4, 4), from stage units"""
    softboxes = {f"softbox{index}": _softbox(each, to_scene) for index, each in enumerate(lights.softboxes)}
    suns = {f"sun{index}": _sun(each, to_scene) for index, each in enumerate(lights.suns)}
    return {**softboxes, **suns, "sky": _distant(lights)}


def emitters_by_group(lights: LightRig) -> dict[str, list[str]]:
    """Return the names in the scene of the emitters of each light group."""
    lights_of = {f"softbox{index}": box.name for index, box in enumerate(lights.softboxes)}
    lights_of |= {f"sun{index}": "sun" for index in range(len(lights.suns))}
    lights_of["sky"] = "sky"
    return {
        group.name: [name for name, light in lights_of.items() if light in group.lights]
        for group in lights.groups
    }


def background_group(lights: LightRig) -> int | None:
    """Return the index of the light group of what the lens sees of the sky itself, or None."""
    return next((index for index, group in enumerate(lights.groups) if BACKGROUND in group.lights), None)


def sun_disc(lights: LightRig) -> SunDisc | None:
    """Return the sun of a rig's daylight, where it is in another light group than the sky."""
    daylight = lights.daylight
    groups = [index for index, group in enumerate(lights.groups) if "sun" in group.lights]
    if daylight is None or not groups or "sky" in lights.groups[groups[0]].lights:
        return None
    is_map = daylight.working_space != REC709.name
    radius = daylight.width / 2.0 + (_MAP_EDGE * math.pi / _MAP_ROWS if is_map else _DISC_EDGE)
    return SunDisc(daylight.direction, math.cos(radius), _sun_fraction(daylight), groups[0])


@lru_cache(maxsize=4)
def _sun_fraction(daylight: Daylight) -> Triple:
    """Return the fraction, by channel, that the sun has of the light from the middle of its disc."""
    direction = np.array([daylight.direction])
    sun, sky = (
        np.maximum(_radiance({**_sunsky(daylight), "sun_scale": sun, "sky_scale": sky}, direction)[0], 0.0)
        for sun, sky in ((daylight.sun, 0.0), (0.0, daylight.sky))
    )
    red, green, blue = (sun / np.maximum(sun + sky, 1e-12)).tolist()
    return red, green, blue


def _distant(lights: LightRig) -> dict[str, Any]:
    """Return the emitter that surrounds the scene."""
    if lights.daylight and lights.daylight.working_space != REC709.name:
        import mitsuba as mi

        return {"type": "envmap", "bitmap": mi.Bitmap(daylight_map(lights.daylight))}
    if lights.daylight:
        daylight, strength = lights.daylight, daylight_exposure(lights.daylight)
        scales = {"sun_scale": strength * daylight.sun, "sky_scale": strength * daylight.sky}
        return {**_sunsky(daylight), **scales}
    if lights.environment:
        return _environment(lights.environment)
    return _sky(lights.sky)


def softboxes_in_view(scene: Scene, size: tuple[int, int]) -> list[str]:
    """Return the names of the softboxes that may be in the picture: not all of one is outside one side of the
    view.

    size  width and height of the picture in pixels

    A lens sees more than a pinhole: the view widens away from the plane in focus. A wide camera may see all.
    """
    boxes = enumerate(scene.lights.softboxes)
    return [f"softbox{index}" for index, box in boxes if _may_be_seen(_corners(box), scene, size)]


def _corners(softbox: Softbox) -> NDArray[np.float64]:
    """Return the corners (4, 3) of a softbox, stage units."""
    facing = unit(np.subtract(softbox.target, softbox.position))
    across = unit(np.cross(_up_for(softbox), facing)) * softbox.width / 2.0
    along = np.cross(facing, unit(across)) * softbox.height / 2.0
    return np.add([x * across + y * along for x in (-1, 1) for y in (-1, 1)], softbox.position)


def _may_be_seen(points: NDArray[np.float64], scene: Scene, size: tuple[int, int]) -> bool:
    """Tell whether the convex hull of points (N, 3), stage units, is not all outside one side of the view."""
    camera, to_scene = scene.camera, scene.placement.matrix()
    if camera.projection.is_wide:
        return True
    seen = (points @ to_scene[:3, :3].T + to_scene[:3, 3] - camera.origin) @ camera.axes().T
    right, up, depth = seen.T
    widening = camera.lens_radius * np.abs(depth / camera.focus_distance - 1.0)
    half_width = math.tan(camera.field_of_view / 2.0) * depth
    aside, upwards = half_width + widening, half_width * size[1] / size[0] + widening
    outside = (right > aside, right < -aside, up > upwards, up < -upwards, depth < 0.0)
    return not any(side.all() for side in outside)


_SLICES = 9
"""Slices of a shadow, each of which is looked for in the picture."""

_SHADOW_REACH = 24.0
"""Distance behind a softbox to which its shadow is looked for, stage units: to the wall of a cyclorama."""


def shadowing_softboxes(scene: Scene, size: tuple[int, int]) -> list[str]:
    """Return the names of the softboxes that the lens does not see and whose shadow, in the light of another
    or of a sun, may be in the picture. size: width and height of the picture in pixels"""
    lights, found = scene.lights, []
    sources = [(index, _corners(box)) for index, box in enumerate(lights.softboxes)]
    towards_sun = [-np.array(sun.direction) for sun in lights.suns]
    if lights.daylight:
        towards_sun.append(np.linalg.inv(scene.placement.matrix()[:3, :3]) @ lights.daylight.direction)
    far = [(-1, _SHADOW_REACH * 10.0 * unit(towards)[None]) for towards in towards_sun]
    for index, box in enumerate(lights.softboxes):
        corners = _corners(box)
        shadows = [_shadow(corners, points) for other, points in (*sources, *far) if other != index]
        parts = [np.concatenate(pair) for slices in shadows for pair in itertools.pairwise(slices)]
        if not box.visible and any(_may_be_seen(part, scene, size) for part in parts):
            found.append(f"softbox{index}")
    return found


def _shadow(corners: NDArray[np.float64], light: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return slices (K, N, 3) of the shadow that a softbox throws, down to the floor or far away.

    The shadow is within the convex hulls of each two slices that follow each other.

    corners  of the softbox (C, 3), stage units
    light    places of the light (L, 3), stage units
    """
    steps = (corners[:, None] - light[None]).reshape(-1, 3)
    steps /= np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
    starts = np.repeat(corners, len(light), axis=0)
    down = np.where(steps[:, 1] < -1e-9, -starts[:, 1] / np.minimum(steps[:, 1], -1e-9), np.inf)
    reach = np.clip(down, 0.0, _SHADOW_REACH)[:, None]
    return np.array([starts + part * reach * steps for part in np.linspace(0.0, 1.0, _SLICES)])


def unseen_softboxes(scene: Scene, size: tuple[int, int]) -> list[str]:
    """Return the names of the softboxes that may be in the picture and that the lens does not see."""
    boxes = scene.lights.softboxes
    return [name for name in softboxes_in_view(scene, size) if not boxes[int(name[7:])].visible]


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
    """Return the vertical or, for a softbox straight above, the direction away from the usual camera."""
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
    return {"type": "envmap", "bitmap": mi.Bitmap(sky.pixels())}


def _environment(environment: Environment) -> dict[str, Any]:
    """Return Mitsuba's environment map. Raises BadInputError where the file has changed."""
    import mitsuba as mi

    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(environment.pixels()),
        "scale": environment.intensity,
        "to_world": mi.ScalarTransform4f().rotate([0.0, 1.0, 0.0], math.degrees(environment.turn) + 180.0),
    }


@lru_cache(maxsize=4)
def daylight_exposure(daylight: Daylight) -> float:
    """Return the factor on Mitsuba's radiance, as of `exposure_of`."""
    sun, sky = daylight_irradiances(daylight)
    return exposure_of(float((sun + sky / 2.0) @ LUMA))


def daylight_irradiances(daylight: Daylight) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return irradiance (3,) by the sun on a surface that faces it, and by the sky on the ground.

    Both are in Mitsuba's units.
    """
    direction = np.array([daylight.direction])
    rows, columns = 24, 48
    tilt = (np.arange(rows) + 0.5) / rows * math.pi / 2.0
    turn = (np.arange(columns) + 0.5) / columns * 2.0 * math.pi
    grid = np.stack(np.broadcast_arrays(tilt[:, None], turn[None, :]), axis=-1).reshape(-1, 2)
    tilt, turn = grid.T
    sine, cosine = np.sin(tilt), np.cos(tilt)
    directions = np.stack([sine * np.sin(turn), cosine, sine * np.cos(turn)], axis=1)
    weight = sine * cosine * (math.pi / 2.0 / rows) * (2.0 * math.pi / columns)
    sky_only, sun_only = {"sun_scale": 0.0, "sky_scale": 1.0}, {"sun_scale": 1.0, "sky_scale": 0.0}
    sky = weight @ _radiance({**_sunsky(daylight), **sky_only}, directions)
    disc = 2.0 * math.pi * (1.0 - math.cos(daylight.width / 2.0))
    sun = _radiance({**_sunsky(daylight), **sun_only}, direction)[0] * disc
    return np.maximum(sun, 0.0), sky


@lru_cache(maxsize=2)
def daylight_map(daylight: Daylight) -> NDArray[np.float32]:
    """Return radiance (_MAP_ROWS, 2 _MAP_ROWS, 3) of sun and sky in the daylight's working space.

    Mitsuba's emitter yields Rec.709 alone. The sky is smooth and computed coarsely; the sun's light is
    spread over the pixels that its disc covers, so that its irradiance is exact.
    """
    strength, (sun, _) = daylight_exposure(daylight), daylight_irradiances(daylight)
    coarse = _MAP_ROWS // _COARSE
    without_sun = {**_sunsky(daylight), "sun_scale": 0.0, "sky_scale": daylight.sky}
    directions = map_directions(coarse)[: coarse // 2].reshape(-1, 3)
    upper = _radiance(without_sun, directions).reshape(coarse // 2, 2 * coarse, 3)
    light = np.zeros((_MAP_ROWS, 2 * _MAP_ROWS, 3))
    light[: _MAP_ROWS // 2] = _refine(upper, _COARSE)
    cosine = map_directions(_MAP_ROWS) @ np.array(daylight.direction)
    pixel = math.pi / _MAP_ROWS
    cover = np.clip((daylight.width / 2.0 - np.arccos(np.clip(cosine, -1.0, 1.0))) / pixel + 0.5, 0.0, 1.0)
    cover[_MAP_ROWS // 2 :] = 0.0
    solid_angle = pixel**2 * np.sin((np.arange(_MAP_ROWS) + 0.5) * pixel)[:, None]
    light += cover[..., None] * (daylight.sun * sun / (cover * solid_angle).sum())
    return converted_pixels((strength * light).astype(np.float32), daylight.working_space)


def _refine(picture: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """Interpolate a picture (H, W, 3) bilinearly to `factor` times its size; its columns are cyclic."""
    height, width = picture.shape[:2]
    rows = np.clip((np.arange(factor * height) + 0.5) / factor - 0.5, 0.0, height - 1.0)
    columns = (np.arange(factor * width) + 0.5) / factor - 0.5
    top, left = rows.astype(int), np.floor(columns).astype(int)
    down, right = (rows - top)[:, None, None], (columns - left)[None, :, None]
    lines = picture[top] * (1.0 - down) + picture[np.minimum(top + 1, height - 1)] * down
    return np.asarray(lines[:, left % width] * (1.0 - right) + lines[:, (left + 1) % width] * right)


def _sunsky(daylight: Daylight) -> dict[str, Any]:
    """Return Mitsuba's sun and sky (Wilkie and Hošek 2012/2013)."""
    import mitsuba as mi

    x, y, z = daylight.direction
    return {
        "type": "sunsky",
        "turbidity": daylight.turbidity,
        "sun_direction": [x, y, z],
        "sun_aperture": math.degrees(daylight.width),
        "to_world": mi.ScalarTransform4f().rotate([1.0, 0.0, 0.0], -90.0),
    }


def _radiance(description: dict[str, Any], directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return radiance (N, 3) of an emitter from directions (N, 3)."""
    import drjit as dr
    import mitsuba as mi

    emitter = load_part(description)
    if not is_compiled():
        return np.array([_radiance_from(emitter, direction) for direction in directions])
    si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    si.wi = -mi.Vector3f(np.ascontiguousarray(directions.T, dtype=np.float32))
    return np.array(emitter.eval(si), dtype=np.float64).T


def _radiance_from(emitter: Any, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    import mitsuba as mi

    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*(-direction).tolist())
    return np.array(emitter.eval(si), dtype=np.float64)
