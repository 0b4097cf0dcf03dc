"""Skies: daylight, the sun's position, and environment maps (equirectangular, linear Rec.709)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import NOT_PLAIN, OMIT_DEFAULT, Triple
from flowsculpt.render.scene.picture_file import Pixels, StatedSpace, opened_picture
from flowsculpt.render.scene.rgb_spaces import REC709, converted_pixels
from flowsculpt.render.scene.textures import is_linear, linear_pixels, require_decodable, require_finite

OBLIQUITY = math.radians(23.44)
"""Tilt of the earth's axis."""

SUN_WIDTH = math.radians(0.5358)
"""The sun's angular diameter, Mitsuba's default."""

WIDEST = 4096
"""Columns that are kept of a map; finer ones are averaged. A lens of 26° sees 300 of them."""

BRIGHTEST = 1e10
"""Largest radiance of a map, above the sun's in cd/m²: sums of squared light are of single precision."""

_FORMATS = ("openexr", "hdr", "tiff")
"""File formats that hold linear light; others hold display values."""

_WRITABLE = "EXR or HDR"


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
        if not (1e-3 <= self.width <= 0.5 and self.sun >= 0.0 and self.sky >= 0.0):
            raise BadInputError("the sun needs a width from 0.001 to 0.5 rad, sun and sky at least 0")

    @property
    def direction(self) -> Triple:
        """Unit vector to the sun, scene axes."""
        across = math.cos(self.elevation)
        return across * math.sin(self.azimuth), math.sin(self.elevation), across * math.cos(self.azimuth)


_SUN_AT_60 = 1.45
"""Luminous irradiance of a surface that faces a sun at 60° elevation, in Mitsuba's units."""

_WANTED_AT_60 = 8.0
"""The same irradiance in our units, as bright as the other rigs."""

_DUSK_EXPONENT = 0.8
"""Power of the light's fall towards dusk that exposure makes up for."""


def exposure_of(facing: float) -> float:
    """Return the factor on Mitsuba's radiance of daylight.

    facing  luminous irradiance of a surface that faces the sun, with half of the sky's, in Mitsuba's units

    Light falls by a factor of a hundred from noon to dusk. Exposure keeps of this what the eye notices.
    """
    return _WANTED_AT_60 / _SUN_AT_60 * math.pow(facing / _SUN_AT_60, -_DUSK_EXPONENT)


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
    reading    what `environment_of` finds out about it

    working_space  the space that its radiance is converted to
    """

    digest: str
    turn: float = 0.0
    intensity: float = 1.0
    visible: bool = True
    path: str = field(default="", metadata=NOT_PLAIN)
    working_space: str = field(default=REC709.name, metadata=NOT_PLAIN)
    reading: str = field(default="", metadata=OMIT_DEFAULT)

    def pixels(self) -> Pixels:
        """Return radiance (H, 2H, 3) in the working space, at least 0. Raises as `read_map`."""
        light = converted_pixels(read_map(self.path, self.digest), self.working_space)
        return np.maximum(light, 0.0) if light.min() < 0.0 else light


@lru_cache(maxsize=8)
def environment_of(path: str, digest: str) -> Environment:
    """Return the environment of a file, checked: everything of it that keys hold. Raises as `read_map`."""
    read_map(path, digest)
    with opened_picture(path, _WRITABLE) as picture:
        return Environment(digest, path=path, reading=picture.reading(None))


@lru_cache(maxsize=2)
def read_map(path: str, digest: str) -> Pixels:
    """Read a map: radiance (H, 2H, 3), linear Rec.709, averaged down to at most WIDEST columns.

    Colours of a wider space that Rec.709 lacks have a channel below 0.

    digest  of the content, so that a changed file is read again

    Raises BadInputError for a file that holds no linear light, is truncated, is not twice as wide as high,
    or has pixels that are not finite, below 0 or above BRIGHTEST.
    """
    require_decodable(path, digest)
    pixels, stated = _pixels(path)
    height, width = pixels.shape[:2]
    if width != 2 * height:
        raise BadInputError(
            f"{path}: it is {width} × {height} pixels; a map of all directions must be twice as wide as high"
        )
    require_finite(pixels, path)
    if pixels.min() < 0.0:
        row, column = np.argwhere(pixels.min(axis=2) < 0.0)[0]
        raise BadInputError(f"{path}: pixel {column}, {row} is below 0; light must not be. Clamp it at 0")
    if pixels.max() > BRIGHTEST:
        row, column = np.argwhere(pixels.max(axis=2) > BRIGHTEST)[0]
        raise BadInputError(
            f"{path}: pixel {column}, {row} is {pixels[row, column].max():.3g}; light goes up to "
            f"{BRIGHTEST:g}. Clamp it, for example with oiiotool --clamp:max={BRIGHTEST:g}"
        )
    return _averaged(pixels if stated is None else linear_pixels(pixels, stated, path))


def _pixels(path: str) -> tuple[Pixels, StatedSpace | None]:
    """Return pixels (H, W, 3) as stored, and their colour space where it is not linear Rec.709."""
    with opened_picture(path, _WRITABLE) as picture:
        if picture.kind not in _FORMATS or picture.count < 3:
            raise BadInputError(
                f"{path}: it is a picture of {picture.spec.nchannels} channels in {picture.kind}; a map of "
                f"light has 3, in an {_WRITABLE}"
            )
        if picture.is_cube:
            raise BadInputError(f"{path}: it is a cube map; write it as latitude and longitude")
        stated = picture.stated_space()
        if not (picture.is_float and is_linear(stated)):
            space = stated.name if stated else "integers, display values"
            raise BadInputError(f"{path}: it is in {space}; a map of light is linear, in an {_WRITABLE}")
        return picture.pixels(), stated


def _averaged(pixels: Pixels) -> Pixels:
    """Return the map averaged over squares of pixels until it is at most WIDEST wide."""
    while pixels.shape[1] > WIDEST and not pixels.shape[0] % 2:
        height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
        pixels = pixels.reshape(height, 2, width, 2, 3).mean(axis=(1, 3), dtype=np.float32)
    return np.ascontiguousarray(pixels)
