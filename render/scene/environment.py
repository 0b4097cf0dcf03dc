"""Environment maps: light from all directions, as an equirectangular picture in linear Rec.709."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.serialise import NOT_PLAIN
from render.scene.textures import require_finite

WIDEST = 4096
"""Columns that are kept of a map; finer ones are averaged. A lens of 26° sees 300 of them."""

_FORMATS = ("openexr", "hdr", "tiff")
"""File formats that hold linear light; others hold display values."""


@dataclass(frozen=True)
class Environment:
    """An environment map that lights the scene. It keeps its place; softboxes follow the camera.

    digest     SHA-256 of the file's content
    turn       radians about the vertical, from +z towards +x; at 0 the middle of the map is at −z, behind
               the subject for a camera at azimuth 0, and its right edge on the camera's right
    intensity  factor on the light
    visible    True if the lens sees it
    path       the file
    """

    digest: str
    turn: float = 0.0
    intensity: float = 1.0
    visible: bool = True
    path: str = field(default="", metadata=NOT_PLAIN)


@lru_cache(maxsize=2)
def read_map(path: str, digest: str) -> NDArray[np.float32]:
    """Read a map: radiance (H, 2H, 3), linear Rec.709, averaged down to at most WIDEST columns.

    digest  of the content, so that a changed file is read again

    Raises BadInputError for a file that holds no linear light, is truncated, is not twice as wide as high,
    or has pixels that are not finite or below 0.
    """
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
    import OpenImageIO as oiio

    file = oiio.ImageInput.open(path)
    if file is None:
        raise BadInputError(f"{path}: it cannot be read as a picture ({_reason(oiio)}); write an EXR or HDR")
    try:
        kind, channels = file.format_name(), file.spec().nchannels
        if kind not in _FORMATS or channels < 3:
            raise BadInputError(
                f"{path}: it is a picture of {channels} channels in {kind}; a map of light has 3, in an EXR "
                "or HDR"
            )
        pixels = file.read_image(0, 0, 0, 3, oiio.FLOAT)
        if pixels is None:
            raise BadInputError(f"{path}: it cannot be read to its end ({file.geterror()}); write it again")
    finally:
        file.close()
    return np.asarray(pixels, dtype=np.float32)


def _reason(oiio: Any) -> str:
    return str(oiio.geterror() or "unknown format").splitlines()[0]


def _averaged(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the map averaged over squares of pixels until it is at most WIDEST wide."""
    while pixels.shape[1] > WIDEST and not pixels.shape[0] % 2:
        height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
        pixels = pixels.reshape(height, 2, width, 2, 3).mean(axis=(1, 3), dtype=np.float32)
    return np.ascontiguousarray(pixels)
