"""Textures: pictures from files that cover the sculpture, as colours, roughness or height."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from render.base.render_errors import BadInputError
from render.base.serialise import NOT_PLAIN, OMIT_DEFAULT
from render.scene.picture_check import require_decodable
from render.scene.picture_file import DEFAULT_CONFIG, OpenedPicture, Pixels, StatedSpace, opened_picture
from render.scene.rgb_encoding import linear_of_srgb
from render.scene.working_space import REC709, converted_pixels

WIDEST = 4096
"""Pixels along a side that are kept of a texture; finer ones are averaged."""

SPACES = ("srgb", "linear", "data")
"""Short names of colour spaces: display values, linear Rec.709, and numbers that are not colours."""

_LINEAR = "lin_rec709_scene"
"""The name of linear Rec.709 in OpenColorIO's own config."""


@dataclass(frozen=True)
class Texture:
    """A picture that covers a surface.

    digest   SHA-256 of the file's content
    space    one of SPACES, or a colour space of OpenColorIO's config. None means the one that the file
             states, else "linear" for floats (EXR, HDR, TIFF) and "srgb" for integers
    path     the file
    reading  what `reading_of` returns

    working_space  the space that colours are converted to
    """

    digest: str
    space: str | None = None
    path: str = field(default="", metadata=NOT_PLAIN)
    working_space: str = field(default=REC709.name, metadata=NOT_PLAIN)
    reading: str = field(default="", metadata=OMIT_DEFAULT)

    def pixels(self) -> Pixels:
        """Return pixels (H, W, 3) of the working space from 0 to 1, or data as stored. Raises as
        `read_picture`."""
        pixels = read_picture(self.path, self.digest, self.space)
        return pixels if self.space == "data" else converted_pixels(pixels, self.working_space)

    def numbers(self) -> Pixels:
        """Return the mean of the channels as stored, (H, W, 1). Raises as `read_picture`."""
        return np.ascontiguousarray(read_picture(self.path, self.digest, "data").mean(axis=2, keepdims=True))


@lru_cache(maxsize=6)
def read_picture(path: str, digest: str, space: str | None) -> Pixels:
    """Read a file's colours, (H, W, 3), averaged down to at most WIDEST pixels a side.

    A single channel becomes grey; alpha is left out. Colours are clipped to reflectances, 0 to 1; data are
    kept as stored.

    digest  of the content, so that a changed file is read again

    Raises BadInputError for a file that is no picture, is truncated or has pixels that are not finite, and
    for an unknown colour space.
    """
    require_space(space)
    require_decodable(path, digest)
    with _opened(path) as picture:
        stated = picture.stated_space() if space is None else StatedSpace(space, space)
        usual = "linear" if picture.is_float else "srgb"
        pixels = picture.pixels()
    pixels = np.ascontiguousarray(np.broadcast_to(pixels, (*pixels.shape[:2], 3)))
    require_finite(pixels, path)
    texture = _linear(pixels, stated or StatedSpace(usual, usual), path)
    while max(texture.shape[:2]) > WIDEST:
        height, width = texture.shape[0] // 2, texture.shape[1] // 2
        texture = texture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    texture = np.ascontiguousarray(texture, dtype=np.float32)
    texture.setflags(write=False)
    return texture


def texture_of(path: str, digest: str, space: str | None) -> Texture:
    """Return the texture of a file, checked: everything of it that keys hold. Raises as `read_picture`."""
    read_picture(path, digest, space)
    return Texture(digest, space, path, reading=reading_of(path, digest, space))


@lru_cache(maxsize=64)
def reading_of(path: str, digest: str, space: str | None) -> str:
    """Return what `OpenedPicture.reading` says of a texture. Raises as `read_picture`."""
    require_decodable(path, digest)
    with _opened(path) as picture:
        return picture.reading(space)


def _opened(path: str) -> AbstractContextManager[OpenedPicture]:
    """Open a texture; its colours are not multiplied by alpha."""
    import OpenImageIO as oiio

    unassociated = oiio.ImageSpec()
    unassociated["oiio:UnassociatedAlpha"] = 1
    return opened_picture(path, "EXR, PNG, JPEG or TIFF", unassociated)


def require_finite(pixels: NDArray[np.floating], path: str) -> None:
    """Raise BadInputError where pixels (H, W, C) are not finite; the message names the first."""
    bad = np.argwhere(~np.isfinite(pixels).all(axis=2))
    if len(bad):
        row, column = bad[0]
        raise BadInputError(
            f"{path}: pixel {column}, {row} and {len(bad) - 1} others are not finite; repair the file, for "
            "example "
            "with oiiotool --fixnan box3"
        )


def require_space(space: str | None) -> None:
    """Raise BadInputError for an unknown colour space."""
    if space is None or space in SPACES or space in _names():
        return
    by_lower_case = {name.lower(): name for name in (*_names(), *SPACES)}
    close = get_close_matches(space.lower(), by_lower_case, 1)
    hint = f"Did you mean {by_lower_case[close[0]]!r}?" if close else f"Write one of {', '.join(SPACES)}."
    raise BadInputError(f"space {space!r} is unknown to OpenColorIO's {DEFAULT_CONFIG}. {hint}")


@cache
def _names() -> frozenset[str]:
    """Return the names and aliases of the colour spaces in OpenColorIO's own config."""
    import OpenImageIO as oiio

    config = oiio.ColorConfig(DEFAULT_CONFIG)
    return frozenset(n for name in config.getColorSpaceNames() for n in (name, *config.getAliases(name)))


def _linear(pixels: Pixels, stated: StatedSpace, path: str) -> NDArray[np.floating]:
    """Return reflectances of linear Rec.709, 0 to 1; data as they are."""
    if stated.space == "data":
        return pixels
    if stated.space == "srgb":
        return linear_of_srgb(np.clip(pixels, 0.0, 1.0))
    return np.clip(linear_pixels(pixels, stated, path), 0.0, 1.0)


def is_linear(stated: StatedSpace | None) -> bool:
    """Tell whether values are proportional to light; None is linear Rec.709."""
    if stated is None or stated.space in ("linear", "data"):
        return True
    if stated.encoding is not None:
        return stated.encoding.is_linear
    import OpenImageIO as oiio

    return bool(oiio.ColorConfig(DEFAULT_CONFIG).isColorSpaceLinear(stated.space))


def linear_pixels(pixels: Pixels, stated: StatedSpace, path: str) -> Pixels:
    """Return linear Rec.709 pixels (H, W, 3) of any space; colours outside its gamut go below 0.

    Raises BadInputError where OpenColorIO cannot convert them.
    """
    if stated.encoding is not None:
        return stated.encoding.linear(pixels)
    if stated.space in ("linear", "data"):
        return pixels
    import OpenImageIO as oiio

    source = "srgb_tx" if stated.space == "srgb" else stated.space
    converted = oiio.ImageBufAlgo.colorconvert(
        oiio.ImageBuf(pixels), source, _LINEAR, colorconfig=DEFAULT_CONFIG
    )
    if converted.has_error:
        raise BadInputError(f"{path}: OpenColorIO cannot convert it from {source!r}: {converted.geterror()}")
    return np.asarray(converted.get_pixels(oiio.FLOAT), dtype=np.float32)
