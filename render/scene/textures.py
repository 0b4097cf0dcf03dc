"""Textures: pictures from files that cover the sculpture, as colours, roughness or height.

OpenImageIO decodes each picture once in a process of its own before it is read here: a decoder that crashes,
hangs or fills the memory does so there. What is wrong with a picture otherwise, the reader says itself. The
answer is stored by the content of the file.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.limited_process import Parser, ParserError
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import NOT_PLAIN, OMIT_DEFAULT, Triple
from flowsculpt.render.scene.picture_file import (
    DEFAULT_CONFIG,
    OpenedPicture,
    Pixels,
    StatedSpace,
    opened_picture,
)
from flowsculpt.render.scene.rgb_spaces import REC709, converted_pixels, linear_of_srgb

SPACES = ("srgb", "linear", "data")
"""Short names of colour spaces: display values, linear Rec.709, and numbers that are not colours."""

_LINEAR = "lin_rec709_scene"
"""The name of linear Rec.709 in OpenColorIO's own config."""


WHOLE = (1.0, 1.0, 1.0)
"""The factor of textures that are shown as they are."""


REPEAT, CLAMP, MIRROR, BLACK = "repeat", "clamp", "mirror", "black"
"""What is shown beyond the sides of a picture: it again, its border, it mirrored in turn, or black."""

REPEATED = (REPEAT, REPEAT)
"""A picture that is shown again beyond its sides, across and up."""


@dataclass(frozen=True)
class Texture:
    """A picture that covers a surface.

    ALPHA    the channel of a picture's alpha
    WIDEST   pixels along a side that are kept; finer ones are averaged

    digest   SHA-256 of the file's content
    space    one of SPACES, or a colour space of OpenColorIO's config. None means the one that the file
             states, else "linear" for floats (EXR, HDR, TIFF) and "srgb" for integers
    path     the file
    reading  what `reading_of` returns
    factor   on red, green and blue, linear Rec.709, or on numbers, or on right, up and out of normals
    channel  0, 1 or 2: the one that holds numbers; ALPHA; None for the mean of all
    wrap     what is shown beyond its left and right sides, and beyond its lower and upper ones: repeat, it
             again; clamp, its border; mirror, it mirrored in turn; black

    working_space  the space that colours are converted to
    """

    ALPHA: ClassVar[int] = 3
    WIDEST: ClassVar[int] = 4096

    digest: str
    space: str | None = None
    path: str = field(default="", metadata=NOT_PLAIN)
    working_space: str = field(default=REC709.name, metadata=NOT_PLAIN)
    reading: str = field(default="", metadata=OMIT_DEFAULT)
    factor: Triple = field(default=WHOLE, metadata=OMIT_DEFAULT)
    channel: int | None = field(default=None, metadata=OMIT_DEFAULT)
    wrap: tuple[str, str] = field(default=REPEATED, metadata=OMIT_DEFAULT)

    @classmethod
    def of(cls, path: str, digest: str, space: str | None) -> Texture:
        """Return the texture of a file, checked: all of it that keys hold. Raises as `read_picture`."""
        read_picture(path, digest, space)
        return cls(digest, space, path, reading=reading_of(path, digest, space))

    @property
    def repeats(self) -> bool:
        """True if it is shown again beyond all its sides."""
        return self.wrap == REPEATED

    def pixels(self) -> Pixels:
        """Return pixels (H, W, 3) of the working space from 0 to 1, or data as stored. Raises as
        `read_picture`."""
        pixels = read_picture(self.path, self.digest, self.space)
        if self.factor != WHOLE:
            pixels = pixels * np.array(self.factor, np.float32)
        return pixels if self.space == "data" else converted_pixels(pixels, self.working_space)

    def numbers(self) -> Pixels:
        """Return the mean of the channels as stored, or one of them, (H, W, 1). Raises as `read_picture`."""
        if self.channel == self.ALPHA:
            return read_alpha(self.path, self.digest)
        stored = read_picture(self.path, self.digest, "data")
        if self.channel is None:
            return np.ascontiguousarray(stored.mean(axis=2, keepdims=True))
        return np.ascontiguousarray(stored[..., self.channel, None] * np.float32(self.factor[self.channel]))

    def normals(self) -> Pixels:
        """Return the normals of a tangent-space map, right, up and out, (H, W, 3), of any length; none points
        inwards. Raises as `read_picture`."""
        stored = read_picture(self.path, self.digest, "data")
        normals = (2.0 * stored - 1.0) * np.array(self.factor, np.float32)
        return np.maximum(normals, (-np.inf, -np.inf, 1e-3), dtype=np.float32)


def texels_at(
    pixels: NDArray[Any], across: NDArray[np.floating], down: NDArray[np.floating], wrap: tuple[str, str]
) -> NDArray[Any]:
    """Return those of pixels (H, W, k) at places (…) from the upper left, 0 to 1 within the picture."""
    indices, is_there = [], np.ones(across.shape, bool)
    for places, count, mode in (down, pixels.shape[0], wrap[1]), (across, pixels.shape[1], wrap[0]):
        if mode == BLACK:
            is_there &= (places >= 0.0) & (places <= 1.0)
        if mode in (REPEAT, MIRROR):
            places = places % 1.0 if mode == REPEAT else 1.0 - np.abs(places % 2.0 - 1.0)
        indices.append(np.clip((places * count).astype(int), 0, count - 1))
    return np.where(is_there[..., None], pixels[indices[0], indices[1]], 0)


@lru_cache(maxsize=6)
def read_picture(path: str, digest: str, space: str | None) -> Pixels:
    """Read a file's colours, (H, W, 3), averaged down to at most Texture.WIDEST pixels a side.

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
    return _averaged(_linear(pixels, stated or StatedSpace(usual, usual), path))


@lru_cache(maxsize=2)
def read_alpha(path: str, digest: str) -> Pixels:
    """Return the alpha of a file, (H, W, 1), which is 1 where it has none. Arguments as of `read_picture`.

    Raises BadInputError for a file that is no picture, is truncated or has pixels that are not finite.
    """
    require_decodable(path, digest)
    with _opened(path) as picture:
        alpha = picture.alpha()
    require_finite(alpha, path)
    return _averaged(alpha)


def _averaged(pixels: NDArray[np.floating]) -> Pixels:
    """Return pixels (H, W, C), averaged down to at most Texture.WIDEST a side, which cannot be written to."""
    while max(pixels.shape[:2]) > Texture.WIDEST:
        height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
        pixels = pixels[: 2 * height, : 2 * width].reshape(height, 2, width, 2, -1).mean(axis=(1, 3))
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    pixels.setflags(write=False)
    return pixels


def continued(pixels: Pixels, known: NDArray[np.bool_]) -> Pixels:
    """Return pixels (H, W, 3) with the mean of known neighbours where `known` (H, W, 1) is not True."""
    steps = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    count = sum(np.roll(known, step, (0, 1)) for step in steps)
    total = sum(np.roll(np.where(known, pixels, 0.0), step, (0, 1)) for step in steps)
    return np.where(known | (count == 0), pixels, total / np.maximum(count, 1)).astype(np.float32)


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


MOST_BYTES = 4 << 30
"""Size of the largest file."""

MOST_PIXELS = 1 << 28
"""Pixels of the largest picture: 16384 × 16384."""

_ALWAYS = 1 << 20
"""So many pixels may be in a file of any size."""

_ALWAYS_SHOWN = 1 << 23
"""Pixels that the display window of any file may have: 4096 × 2048."""

_PIXELS_A_BYTE = {"piz": 10_000, "dwaa": 10_000, "dwab": 10_000}
"""Pixels in a byte of an even picture, at most, by the name of its compression."""

_MOST_DEFLATED = 1032
"""Bytes that one byte unpacks to at most (RFC 1951)."""


def require_decodable(path: str, digest: str) -> None:
    """Raise BadInputError for a picture that is too large, or whose decoder crashes, hangs or takes too
    much memory; MissingInputError where it is no regular file.

    digest  of the file's content
    """
    InputFile(Path(path), MOST_BYTES).size()
    try:
        Parser("flowsculpt.render.scene.textures").answer_about_content(Path(path), digest, "OpenImageIO")
    except ParserError as error:
        raise BadInputError(
            f"{path}: it cannot be read as a picture ({error}); write it again, as EXR, PNG, JPEG or TIFF"
        ) from None


def _decode(path: str) -> bytes:
    import OpenImageIO as oiio

    oiio.attribute("threads", 1)
    file = oiio.ImageInput.open(path)
    if file is not None:
        with suppress(BadInputError):
            picture = OpenedPicture(file, path)
            pixels = _require_size(picture, Path(path).stat().st_size)
            Parser.allow_memory(Parser.MEMORY + 16 * pixels * len(picture.channels))
            picture.pixels()
    return b""


def _require_size(picture: OpenedPicture, size: int) -> int:
    """Return the number of pixels. Raises ValueError where a file of `size` bytes cannot hold them."""
    spec, (_, _, width, height) = picture.spec, picture.display
    stored, shown = spec.width * spec.height * max(spec.depth, 1), width * height
    ratio = _PIXELS_A_BYTE.get(spec.get_string_attribute("compression"), _MOST_DEFLATED)
    for pixels, promise, always in (
        (stored, f"{spec.width} × {spec.height} pixels", _ALWAYS),
        (shown, f"a display window of {width} × {height} pixels", _ALWAYS_SHOWN),
    ):
        if pixels > MOST_PIXELS:
            raise ValueError(f"its header promises {promise}; {MOST_PIXELS >> 20} million are the most")
        if pixels > max(always, ratio * size):
            raise ValueError(f"its header promises {promise}, and it has {size} bytes")
    return int(max(stored, shown))


if __name__ == "__main__":
    Parser.serve(_decode)
