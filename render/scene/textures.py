"""Textures: pictures from files that cover the sculpture, as colours, roughness or height."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError, reason_of
from render.base.input_files import parsing
from render.base.serialise import NOT_PLAIN
from render.scene.picture_check import require_decodable
from render.scene.working_space import REC709, converted_pixels

Pixels = NDArray[np.float32]

DEFAULT_CONFIG = "ocio://default"
"""OpenColorIO's own config, which names the colour spaces of textures."""

WIDEST = 4096
"""Pixels along a side that are kept of a texture; finer ones are averaged."""

SPACES = ("srgb", "linear", "data")
"""Short names of colour spaces: display values, linear Rec.709, and numbers that are no colour."""

_LINEAR = "lin_rec709_scene"
"""The name of linear Rec.709 in OpenColorIO's own config."""


@dataclass(frozen=True)
class Texture:
    """A picture that covers a surface.

    digest  SHA-256 of the file's content
    space   one of SPACES, or a colour space of OpenColorIO's config. None means "linear" for a file of
            floats (EXR, HDR, TIFF), else "srgb"
    path    the file

    working_space  the space that colours are converted to
    """

    digest: str
    space: str | None = None
    path: str = field(default="", metadata=NOT_PLAIN)
    working_space: str = field(default=REC709.name, metadata=NOT_PLAIN)

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
    """Read the first three channels of a file, (H, W, 3), averaged down to at most WIDEST pixels a side.

    A single channel becomes grey; alpha is left out. Colours are clipped to reflectances, 0 to 1; data are
    kept as stored.

    digest  of the content, so that a changed file is read again

    Raises BadInputError for a file that is no picture, is truncated or has pixels that are not finite, and
    for an unknown colour space.
    """
    require_space(space)
    require_decodable(path, digest)
    pixels, is_float = _read(path)
    require_finite(pixels, path)
    texture = _linear(pixels, space or ("linear" if is_float else "srgb"), path)
    while max(texture.shape[:2]) > WIDEST:
        height, width = texture.shape[0] // 2, texture.shape[1] // 2
        texture = texture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    texture = np.ascontiguousarray(texture, dtype=np.float32)
    texture.setflags(write=False)
    return texture


def require_finite(pixels: NDArray[np.floating], path: str) -> None:
    """Raise BadInputError where pixels (H, W, C) are not finite; the message names the first."""
    bad = np.argwhere(~np.isfinite(pixels).all(axis=2))
    if len(bad):
        row, column = bad[0]
        raise BadInputError(
            f"{path}: pixel {column}, {row} and {len(bad) - 1} others are not finite; mend the file, with "
            "oiiotool --fixnan box3 for one"
        )


def require_space(space: str | None) -> None:
    """Raise BadInputError for an unknown colour space."""
    if space is None or space in SPACES or space in _names():
        return
    by_lower_case = {name.lower(): name for name in (*_names(), *SPACES)}
    close = get_close_matches(space.lower(), by_lower_case, 1)
    hint = f"Did you mean {by_lower_case[close[0]]!r}?" if close else f"Write one of {', '.join(SPACES)}."
    raise BadInputError(f"space {space!r} is none that OpenColorIO's {DEFAULT_CONFIG} knows. {hint}")


@cache
def _names() -> frozenset[str]:
    """Return the names and aliases of the colour spaces in OpenColorIO's own config."""
    import OpenImageIO as oiio

    config = oiio.ColorConfig(DEFAULT_CONFIG)
    return frozenset(n for name in config.getColorSpaceNames() for n in (name, *config.getAliases(name)))


def _linear(pixels: Pixels, space: str, path: str) -> NDArray[np.floating]:
    if space == "data":
        return pixels
    if space == "srgb":
        return linear_of_srgb(np.clip(pixels, 0.0, 1.0))
    if space == "linear":
        return np.clip(pixels, 0.0, 1.0)
    import OpenImageIO as oiio

    converted = oiio.ImageBufAlgo.colorconvert(
        oiio.ImageBuf(pixels), space, _LINEAR, colorconfig=DEFAULT_CONFIG
    )
    if converted.has_error:
        raise BadInputError(f"{path}: OpenColorIO cannot convert it from {space!r}: {converted.geterror()}")
    return np.clip(np.asarray(converted.get_pixels(oiio.FLOAT), dtype=np.float32), 0.0, 1.0)


def _read(path: str) -> tuple[Pixels, bool]:
    """Return pixels (H, W, 3) as stored, and True if the file stores floats."""
    import OpenImageIO as oiio

    unassociated = oiio.ImageSpec()
    unassociated["oiio:UnassociatedAlpha"] = 1
    with opened_picture(path, "EXR, PNG, JPEG or TIFF", unassociated) as file:
        is_float = str(file.spec().format) in ("half", "float", "double")
        pixels = read_channels(file, 3 if file.spec().nchannels >= 3 else 1, path)
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    return np.ascontiguousarray(np.broadcast_to(pixels, (*pixels.shape[:2], 3))), is_float


@contextmanager
def opened_picture(path: str, kinds: str, *options: Any) -> Iterator[Any]:
    """Open a file with OpenImageIO.

    kinds    file formats that the message recommends
    options  an ImageSpec for the reader

    Raises BadInputError where it is no picture, and for any error of OpenImageIO while it is open.
    """
    import OpenImageIO as oiio

    with parsing(Path(path), "a picture", f"Write an {kinds}."):
        file = oiio.ImageInput.open(path, *options)
        if file is None:
            raise BadInputError(
                f"{path}: it cannot be read as a picture ({last_message(oiio)}); write an {kinds}"
            )
        try:
            yield file
        finally:
            file.close()


def read_channels(file: Any, count: int, path: str) -> Pixels:
    """Return the first channels of an opened picture. Raises BadInputError where it is truncated."""
    pixels = file.read_image(0, 0, 0, count)
    if pixels is None:
        raise BadInputError(f"{path}: it cannot be read to its end ({last_message(file)}); write it again")
    return np.asarray(pixels, dtype=np.float32)


def last_message(source: Any) -> str:
    """Return the first line of OpenImageIO's last message."""
    try:
        lines = str(source.geterror()).strip().splitlines()
    except UnicodeDecodeError:  # it quotes the file
        lines = []
    return reason_of(ValueError(lines[0] if lines else "unknown format"))


def srgb_of_linear(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return sRGB values from 0 to 1 of linear ones (IEC 61966-2-1)."""
    light = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)


def linear_of_srgb(srgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the linear values of sRGB values 0 … 1 (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, dtype=np.float64)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
