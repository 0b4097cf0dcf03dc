"""Light as a picture of a place has it: equirectangular maps, twice as wide as high, linear."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.base.finite import require_finite
from render.base.serialise import NOT_PLAIN

WIDEST = 4096
"""Columns that are kept of a map. Finer ones are averaged; a lens of 26° sees 300 of them."""

_FORMATS = ("openexr", "hdr", "tiff")
"""Those that hold light; others hold what a screen shows."""


@dataclass(frozen=True)
class Environment:
    """Light from all around, as a picture of a place has it. It stands still in the scene.

    digest     SHA-256 of the file's content
    turn       radians about the vertical, from +z towards +x; at 0 the middle of the map lies at −z,
               behind the subject for a camera at azimuth 0, and its right edge to the camera's right
    intensity  factor on the light
    visible    whether the lens sees it
    path       where the file lies
    """

    digest: str
    turn: float = 0.0
    intensity: float = 1.0
    visible: bool = True
    path: str = field(default="", metadata=NOT_PLAIN)


def emitter(environment: Environment) -> dict[str, Any]:
    """As Mitsuba's emitter. Raises BadInputError where the file is not what it was."""
    import mitsuba as mi

    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(read_map(environment.path, environment.digest)),
        "scale": environment.intensity,
        "to_world": mi.ScalarTransform4f().rotate([0.0, 1.0, 0.0], math.degrees(environment.turn) + 180.0),
    }


@lru_cache(maxsize=2)
def read_map(path: str, digest: str) -> NDArray[np.float32]:
    """(H, 2H, 3) radiance of the file, linear Rec.709, at most WIDEST columns.

    digest  names the content, so that a file that changes is read again

    Raises BadInputError for a file that is no picture of light, ends too early, is not twice as wide as
    high, or holds what is not finite or below 0.
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
    return _coarser(pixels)


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


def _coarser(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Averaged over squares of pixels until it is small enough."""
    while pixels.shape[1] > WIDEST and not pixels.shape[0] % 2:
        height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
        pixels = pixels.reshape(height, 2, width, 2, 3).mean(axis=(1, 3), dtype=np.float32)
    return np.ascontiguousarray(pixels)
