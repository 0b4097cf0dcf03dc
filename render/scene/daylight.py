"""Daylight: the sun and the sky of a clear day, and the position of the sun."""

from __future__ import annotations

import math
from dataclasses import dataclass

from render.base.errors import BadInputError
from render.base.serialise import Triple

OBLIQUITY = math.radians(23.44)
"""Tilt of the earth's axis."""

SUN_WIDTH = math.radians(0.5358)
"""The sun's angular diameter, Mitsuba's default."""


@dataclass(frozen=True)
class Daylight:
    """The sun and sky of a clear day. They keep their place in the scene; softboxes follow the camera.

    elevation   of the sun above the horizon, radians
    azimuth     of the sun, radians: 0 at +z, a quarter turn at +x, as for cameras
    turbidity   haze, from 1 (none) to 10
    width       angular diameter of the sun, radians; a wider sun of the same strength casts softer shadows
    sun, sky    strength of each, 1 as in nature
    visible     True if the lens sees them
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
        """Unit vector to the sun, scene axes."""
        across = math.cos(self.elevation)
        return across * math.sin(self.azimuth), math.sin(self.elevation), across * math.cos(self.azimuth)


def sun_position(time: float, latitude: float, day: float) -> tuple[float, float]:
    """Return the sun's elevation, and its azimuth clockwise from north, in radians.

    time      solar time in hours: at 12 the sun is highest
    latitude  radians, north positive
    day       day of the year, 1 to 366

    The declination is Cooper's ("The absorption of radiation in solar stills", Solar Energy 12, 1969),
    correct to within a degree.
    """
    declination = OBLIQUITY * math.sin(2.0 * math.pi * (284.0 + day) / 365.0)
    hour = math.radians(15.0) * (time - 12.0)
    up = math.sin(latitude) * math.sin(declination)
    up += math.cos(latitude) * math.cos(declination) * math.cos(hour)
    east = -math.cos(declination) * math.sin(hour)
    north = math.cos(latitude) * math.sin(declination)
    north -= math.sin(latitude) * math.cos(declination) * math.cos(hour)
    return math.asin(max(-1.0, min(1.0, up))), math.atan2(east, north) % (2.0 * math.pi)
