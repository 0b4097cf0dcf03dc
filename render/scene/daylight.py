"""The sun and the sky of a clear day: where the sun stands, and what both are as Mitsuba's emitter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import Triple

OBLIQUITY = math.radians(23.44)
"""How far the earth's axis leans."""

SUN_WIDTH = math.radians(0.5358)
"""The sun's angular diameter, as Mitsuba has it."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])

_NOON, _WANTED, _DUSK = 1.45, 8.0, 0.8
"""Luminous irradiance of what faces a sun at 60°, in Mitsuba's units, and in ours; and which power of the
light's own fall towards dusk a photographer makes up for."""


@dataclass(frozen=True)
class Daylight:
    """A clear day. It stands still in the scene, while lamps go with the camera.

    elevation   of the sun above the horizon, radians
    azimuth     where the sun stands, radians: 0 at +z, a quarter turn at +x, as cameras do
    turbidity   haze, from 1 (none) to 10
    width       the sun's angular diameter, radians; a larger one of the same strength has softer shadows
    sun, sky    how strong each is, 1 as in nature
    visible     whether the lens sees them
    """

    elevation: float = math.radians(32.0)
    azimuth: float = math.radians(-78.0)
    turbidity: float = 3.0
    width: float = SUN_WIDTH
    sun: float = 1.0
    sky: float = 1.0
    visible: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.elevation <= math.pi / 2.0:
            raise BadInputError(
                f"the sun stands {math.degrees(self.elevation):.4g}° above the horizon; it must be above 0° "
                "and up to 90°"
            )
        if not 1.0 <= self.turbidity <= 10.0:
            raise BadInputError(f"turbidity is {self.turbidity}; it must lie between 1 and 10")
        if not (0.0 < self.width <= 0.5 and self.sun >= 0.0 and self.sky >= 0.0):
            raise BadInputError("the sun needs a width above 0 and up to 0.5 rad, sun and sky at least 0")

    @property
    def direction(self) -> Triple:
        """To the sun, a unit vector in scene axes."""
        across = math.cos(self.elevation)
        return across * math.sin(self.azimuth), math.sin(self.elevation), across * math.cos(self.azimuth)


def sun_position(time: float, latitude: float, day: float) -> tuple[float, float]:
    """Elevation, and azimuth clockwise from north, of the sun; radians.

    time      hours since midnight by the sun: at 12 it stands highest
    latitude  radians, north positive
    day       of the year, 1 to 366

    The declination is Cooper's ("The absorption of radiation in solar stills", Solar Energy 12, 1969),
    which is right to within a degree.
    """
    declination = OBLIQUITY * math.sin(2.0 * math.pi * (284.0 + day) / 365.0)
    hour = math.radians(15.0) * (time - 12.0)
    up = math.sin(latitude) * math.sin(declination)
    up += math.cos(latitude) * math.cos(declination) * math.cos(hour)
    east = -math.cos(declination) * math.sin(hour)
    north = math.cos(latitude) * math.sin(declination)
    north -= math.sin(latitude) * math.cos(declination) * math.cos(hour)
    return math.asin(max(-1.0, min(1.0, up))), math.atan2(east, north) % (2.0 * math.pi)


def emitter(daylight: Daylight) -> dict[str, Any]:
    """Mitsuba's sun and sky (Wilkie and Hošek 2012/2013), as bright as a picture wants it.

    Light falls by a factor of hundred from noon to dusk. What faces the sun gets 8 at 60° of elevation, as
    from the other rigs, and at dusk by as much less as the eye notices.
    """
    strength = exposure(daylight)
    return {
        **_plain(daylight),
        "sun_scale": strength * daylight.sun,
        "sky_scale": strength * daylight.sky,
    }


def exposure(daylight: Daylight) -> float:
    """What Mitsuba's units are multiplied by. An engine must have been started."""
    sun, sky = irradiances(daylight)
    facing = float((sun + sky / 2.0) @ _LUMA)
    return _WANTED / _NOON * math.pow(facing / _NOON, -_DUSK)


def irradiances(daylight: Daylight) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(3,) of the sun on what faces it, and of the sky on the ground; in Mitsuba's units."""
    direction = np.array([daylight.direction])
    rows, columns = 24, 48
    tilt = (np.arange(rows) + 0.5) / rows * math.pi / 2.0
    turn = (np.arange(columns) + 0.5) / columns * 2.0 * math.pi
    grid = np.stack(np.broadcast_arrays(tilt[:, None], turn[None, :]), axis=-1).reshape(-1, 2)
    around = np.stack(
        [
            np.sin(grid[:, 0]) * np.sin(grid[:, 1]),
            np.cos(grid[:, 0]),
            np.sin(grid[:, 0]) * np.cos(grid[:, 1]),
        ],
        axis=1,
    )
    weight = np.sin(grid[:, 0]) * np.cos(grid[:, 0]) * (math.pi / 2.0 / rows) * (2.0 * math.pi / columns)
    without, only = {"sun_scale": 0.0, "sky_scale": 1.0}, {"sun_scale": 1.0, "sky_scale": 0.0}
    sky = weight @ _seen({**_plain(daylight), **without}, around)
    disc = 2.0 * math.pi * (1.0 - math.cos(daylight.width / 2.0))
    sun = _seen({**_plain(daylight), **only}, direction)[0] * disc
    return np.maximum(sun, 0.0), sky


def _plain(daylight: Daylight) -> dict[str, Any]:
    import mitsuba as mi

    x, y, z = daylight.direction
    return {
        "type": "sunsky",
        "turbidity": daylight.turbidity,
        "sun_direction": [x, y, z],
        "sun_aperture": math.degrees(daylight.width),
        "to_world": mi.ScalarTransform4f().rotate([1.0, 0.0, 0.0], -90.0),
    }


def _seen(description: dict[str, Any], directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) radiance that comes from directions (N, 3)."""
    import drjit as dr
    import mitsuba as mi

    shining = mi.load_dict(description, parallel=False, optimize=False)
    if mi.variant() == "scalar_rgb":
        return np.array([_from(shining, direction) for direction in directions])
    there = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    there.wi = -mi.Vector3f(np.ascontiguousarray(directions.T, dtype=np.float32))
    return np.array(shining.eval(there), dtype=np.float64).T


def _from(shining: Any, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    import mitsuba as mi

    there = mi.SurfaceInteraction3f()
    there.wi = mi.Vector3f(*(-direction).tolist())
    return np.array(shining.eval(there), dtype=np.float64)
