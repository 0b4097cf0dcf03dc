"""Pictures from files that are laid on the sculpture: colours, or numbers such as roughness and height."""

from __future__ import annotations

from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.finite import require_finite
from render.base.serialise import NOT_PLAIN
from render.scene.colour_maps import linear_of_srgb

Pixels = NDArray[np.float32]

DEFAULT_CONFIG = "ocio://default"
"""OpenColorIO's own config, which names the colour spaces of textures."""

WIDEST = 4096
"""Pixels along a side that are kept of a picture; finer ones are averaged."""

SPACES = ("srgb", "linear", "data")
"""What pixels may be, in short: shown as a screen does, linear Rec.709, or numbers that are no colour."""

_LINEAR = "lin_rec709_scene"
"""What OpenColorIO's own config calls the space that pictures are in."""


@dataclass(frozen=True)
class Texture:
    """A picture that is laid on.

    digest  SHA-256 of the file's content
    space   one of SPACES, or a colour space that OpenColorIO's config knows; None: by what the file is,
            "linear" where its pixels are floats (EXR, HDR, TIFF), and "srgb" otherwise
    path    where the file lies
    """

    digest: str
    space: str | None = None
    path: str = field(default="", metadata=NOT_PLAIN)

    def pixels(self) -> Pixels:
        """(H, W, 3) linear Rec.709 from 0 to 1, or data as they are. Raises what `read_picture` raises."""
        return read_picture(self.path, self.digest, self.space)

    def numbers(self) -> Pixels:
        """(H, W, 1): the mean of the channels, whatever they are."""
        return np.ascontiguousarray(read_picture(self.path, self.digest, "data").mean(axis=2, keepdims=True))


@lru_cache(maxsize=6)
def read_picture(path: str, digest: str, space: str | None) -> Pixels:
    """(H, W, 3): a file's first three channels, at most WIDEST pixels along a side; a lone channel is grey.

    Alpha is left out. Colours are cut to what surfaces reflect, 0 to 1; data are kept as they are.

    digest  names the content, so that a file that changes is read again

    Raises BadInputError for a file that is no picture, ends too early or holds what is not finite, and for
    a space that is unknown.
    """
    require_space(space)
    pixels, is_float = _read(path)
    require_finite(pixels, path)
    found = _linear(pixels, space or ("linear" if is_float else "srgb"), path)
    while max(found.shape[:2]) > WIDEST:
        height, width = found.shape[0] // 2, found.shape[1] // 2
        found = found[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    found = np.ascontiguousarray(found, dtype=np.float32)
    found.setflags(write=False)
    return found


def require_space(space: str | None) -> None:
    """Raises BadInputError for a colour space that is unknown."""
    if space is None or space in SPACES or space in _names():
        return
    spelt = {name.lower(): name for name in (*_names(), *SPACES)}
    close = get_close_matches(space.lower(), spelt, 1)
    hint = f"Did you mean {spelt[close[0]]!r}?" if close else f"Write one of {', '.join(SPACES)}."
    raise BadInputError(f"space {space!r} is none that OpenColorIO's {DEFAULT_CONFIG} knows. {hint}")


@cache
def _names() -> frozenset[str]:
    """Colour spaces of OpenColorIO's own config, and what else they are called."""
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

    shown = oiio.ImageBuf(pixels)
    found = oiio.ImageBufAlgo.colorconvert(shown, space, _LINEAR, colorconfig=DEFAULT_CONFIG)
    if found.has_error:
        raise BadInputError(f"{path}: OpenColorIO cannot convert it from {space!r}: {found.geterror()}")
    return np.clip(np.asarray(found.get_pixels(oiio.FLOAT), dtype=np.float32), 0.0, 1.0)


def _read(path: str) -> tuple[Pixels, bool]:
    """(H, W, 3) as the file has them, and whether they are floats there."""
    import OpenImageIO as oiio

    as_they_are = oiio.ImageSpec()
    as_they_are["oiio:UnassociatedAlpha"] = 1
    file = oiio.ImageInput.open(path, as_they_are)
    if file is None:
        reason = str(oiio.geterror() or "unknown format").splitlines()[0]
        raise BadInputError(
            f"{path}: it cannot be read as a picture ({reason}); write an EXR, PNG, JPEG or TIFF"
        )
    try:
        count, is_float = min(file.spec().nchannels, 3), _is_float(file.spec().format)
        pixels = file.read_image(0, 0, 0, count if count == 3 else 1, oiio.FLOAT)
        if pixels is None:
            raise BadInputError(f"{path}: it cannot be read to its end ({file.geterror()}); write it again")
    finally:
        file.close()
    pixels = np.asarray(pixels, dtype=np.float32).reshape(*pixels.shape[:2], -1)
    return np.ascontiguousarray(np.broadcast_to(pixels, (*pixels.shape[:2], 3))), is_float


def _is_float(kind: Any) -> bool:
    return str(kind) in ("half", "float", "double")
