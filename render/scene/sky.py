"""Skies: daylight, the sun's position, and environment maps (equirectangular, linear Rec.709)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import NOT_PLAIN, Triple
from render.scene.picture_check import require_decodable
from render.scene.textures import opened_picture, read_channels, require_finite
from render.scene.working_space import REC709, converted_pixels

OBLIQUITY = math.radians(23.44)
"""Tilt of the earth's axis."""

SUN_WIDTH = math.radians(0.5358)
"""The sun's angular diameter, Mitsuba's default."""


WIDEST = 4096
"""Columns that are kept of a map; finer ones are averaged. A lens of 26° sees 300 of them."""

_FORMATS = ("openexr", "hdr", "tiff")
"""File formats that hold linear light; others hold display values."""


@dataclass(frozen=True)
class Daylight:
    """The sun and sky of a clear day. They keep their place in the scene; softboxes follow the camera.

    elevation   of the sun above the horizon, radians
    azimuth     of the sun, radians: 0 at +z, a quarter turn at +x, as for cameras
    turbidity   haze, from 1 (none) to 10
    width       angular diameter of the sun, radians; a wider sun of the same strength casts softer shadows
    sun, sky    strength of each, 1 as in nature
    visible     True if the lens sees them

    working_space  the space that their radiance is converted to
    """

    elevation: float = math.radians(32.0)
    azimuth: float = math.radians(-78.0)
    turbidity: float = 3.0
    width: float = SUN_WIDTH
    sun: float = 1.0
    sky: float = 1.0
    visible: bool = True
    working_space: str = field(default=REC709.name, metadata=NOT_PLAIN)

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


@dataclass(frozen=True)
class Environment:
    """An environment map that lights the scene. It keeps its place; softboxes follow the camera.

    digest     SHA-256 of the file's content
    turn       radians about the vertical, from +z towards +x; at 0 the middle of the map is at −z, behind
               the subject for a camera at azimuth 0, and its right edge on the camera's right
    intensity  factor on the light
    visible    True if the lens sees it
    path       the file

    working_space  the space that its radiance is converted to
    """

    digest: str
    turn: float = 0.0
    intensity: float = 1.0
    visible: bool = True
    path: str = field(default="", metadata=NOT_PLAIN)
    working_space: str = field(default=REC709.name, metadata=NOT_PLAIN)

    def pixels(self) -> NDArray[np.float32]:
        """Return radiance (H, 2H, 3) in the working space. Raises as `read_map`."""
        return converted_pixels(read_map(self.path, self.digest), self.working_space)


@lru_cache(maxsize=2)
def read_map(path: str, digest: str) -> NDArray[np.float32]:
    """Read a map: radiance (H, 2H, 3), linear Rec.709, averaged down to at most WIDEST columns.

    digest  of the content, so that a changed file is read again

    Raises BadInputError for a file that holds no linear light, is truncated, is not twice as wide as high,
    or has pixels that are not finite or below 0.
    """
    require_decodable(path, digest)
    pixels = _pixels(path)
    height, width = pixels.shape[:2]
    if width != 2 * height:
        raise BadInputError(
            f"{path}: it is {width} × {height} pixels; a map of all directions is twice as wide as high"
        )
    require_finite(pixels, path)
    if pixels.min() < 0.0:
        row, column = np.argwhere(pixels.min(axis=2) < 0.0)[0]
        raise BadInputError(f"{path}: pixel {column}, {row} is below 0; light is not. Clamp it at 0")
    return _averaged(pixels)


def _pixels(path: str) -> NDArray[np.float32]:
    with opened_picture(path, "EXR or HDR") as file:
        kind, channels = file.format_name(), file.spec().nchannels
        if kind not in _FORMATS or channels < 3:
            raise BadInputError(
                f"{path}: it is a picture of {channels} channels in {kind}; a map of light has 3, in an EXR "
                "or HDR"
            )
        return read_channels(file, 3, path)


def _averaged(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the map averaged over squares of pixels until it is at most WIDEST wide."""
    while pixels.shape[1] > WIDEST and not pixels.shape[0] % 2:
        height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
        pixels = pixels.reshape(height, 2, width, 2, 3).mean(axis=(1, 3), dtype=np.float32)
    return np.ascontiguousarray(pixels)
