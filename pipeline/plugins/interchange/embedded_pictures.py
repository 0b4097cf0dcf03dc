"""Textures as PNG or JPEG within other files, as glTF and pages hold them: sRGB colours, or numbers.

A PNG or JPEG is taken as the file is, where readers see in it what we render; other pictures, and those that
are too large, are encoded again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.api.materials import Texture, srgb_of_linear

Levels = NDArray[np.uint8]

_LEAST_BORDERED = 64  # pixels along the shorter side of a picture with a border

_KINDS = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}


class EmbeddedPicture(NamedTuple):
    """A PNG or a JPEG: its media type, its bytes, and what is shown beyond its sides, as of `Texture`.

    widest  the most pixels along a side; finer ones are averaged
    """

    kind: str
    content: bytes
    wrap: tuple[str, str] = ("repeat", "repeat")

    @classmethod
    def of_texture(cls, texture: Texture, widest: int, is_colour: bool) -> EmbeddedPicture:
        """Return the picture of a texture, without its factor. Raises as `read_picture`.

        is_colour  True for colours, linear Rec.709 to sRGB; False for numbers as stored
        """
        encode: Callable[[Any], Any] = srgb_of_linear if is_colour else np.asarray
        pixels = Texture.of(texture.path, texture.digest, texture.space if is_colour else "data").pixels()
        content = Path(texture.path).read_bytes()
        kind = next((kind for start, kind in _KINDS.items() if content.startswith(start)), None)
        if kind is not None and max(pixels.shape[:2]) <= widest and "black" not in texture.wrap:
            is_same = hashlib.sha256(content).hexdigest() == texture.digest
            if is_same and _shows(texture.path, _levels(encode(pixels))):
                return cls(kind, content, texture.wrap)
        shown = _add_border(_levels(encode(_at_most(pixels, widest))), texture.wrap)
        if kind == "image/jpeg" and is_colour:
            from flowsculpt.api.pictures import jpeg_bytes  # needs OpenEXR, and GLBs without pictures do not

            return cls(kind, jpeg_bytes(shown), texture.wrap)
        return cls("image/png", _png(shown), texture.wrap)

    @classmethod
    def of_numbers(
        cls,
        planes: Sequence[NDArray[np.float32] | None],
        widest: int,
        wrap: tuple[str, str] = ("repeat", "repeat"),
    ) -> EmbeddedPicture:
        """Return a picture of up to three planes (H, W, 1) of numbers from 0 to 1; one that is None is white.

        The planes may differ in size: smaller ones are repeated.
        """
        reduced = [None if plane is None else _at_most(plane, widest) for plane in planes]
        height, width = np.max([plane.shape[:2] for plane in reduced if plane is not None], axis=0)
        pixels = np.ones((height, width, 3), np.float32)
        for channel, plane in enumerate(reduced):
            if plane is not None:
                pixels[..., channel] = _resize(plane, height, width)[..., 0]
        return cls("image/png", _png(_levels(pixels)), wrap)

    @classmethod
    def with_alpha(
        cls, colours: NDArray[np.float32], alpha: NDArray[np.float32], widest: int, wrap: tuple[str, str]
    ) -> EmbeddedPicture:
        """Return a picture of colours (H, W, 3), linear Rec.709, and an alpha (H, W, 1), maybe of another
        size."""
        parts = [_at_most(np.clip(alpha, 0.0, 1.0), widest), _at_most(colours, widest)]
        height, width = np.maximum(*(part.shape[:2] for part in parts))
        alpha, colours = (_resize(part, height, width) for part in parts)
        levels = _levels(np.concatenate([srgb_of_linear(colours), alpha], axis=2))
        return cls("image/png", _png(_add_border(levels, wrap)), wrap)


def _add_border(levels: Levels, wrap: tuple[str, str]) -> Levels:
    """Return levels (H, W, C) with a black border at sides beyond which black is shown.

    Programs without that show the border there. Small pictures are enlarged, so that it stays thin.
    """
    if "black" not in wrap:
        return levels
    height, width = levels.shape[:2]
    factor = -(-_LEAST_BORDERED // min(height, width))
    levels = _resize(levels, factor * height, factor * width)
    for axis in (axis for axis, mode in ((1, wrap[0]), (0, wrap[1])) if mode == "black"):
        np.moveaxis(levels, axis, 0)[[0, -1]] = 0
    return levels


def _shows(path: str, shown: Levels) -> bool:
    """Tell whether readers that follow no header see these pixels (H, W, 3) in a PNG or JPEG."""
    import OpenImageIO as oiio

    wanted = oiio.ImageSpec()
    wanted["oiio:UnassociatedAlpha"] = 1
    file = oiio.ImageInput.open(path, wanted)
    if file is None:
        return False
    spec, stored = file.spec(), file.read_image(oiio.UINT8)
    followed = spec.get_int_attribute("Orientation", 1) != 1 or spec.getattribute("ICCProfile") is not None
    followed |= spec.get_float_attribute("PixelAspectRatio", 1.0) != 1.0  # glTF has square pixels
    if followed or stored is None or spec.nchannels > 4 or stored.shape[:2] != shown.shape[:2]:
        return False
    colours = stored[..., :3] if spec.nchannels > 2 else stored[..., :1]
    return bool((np.abs(colours.astype(np.int16) - shown) <= 1).all())


def _at_most(pixels: NDArray[np.float32], widest: int) -> NDArray[np.float32]:
    """Return pixels (H, W, C), averaged down to at most so many a side."""
    while max(pixels.shape[:2]) > widest:
        down, across = (2 if side > 1 else 1 for side in pixels.shape[:2])
        height, width = pixels.shape[0] // down, pixels.shape[1] // across
        cut = pixels[: height * down, : width * across]
        pixels = cut.reshape(height, down, width, across, -1).mean(axis=(1, 3))
    return pixels


def _resize(pixels: NDArray[Any], height: int, width: int) -> NDArray[Any]:
    """Return pixels (H, W, C) repeated to another size."""
    rows = np.arange(height) * pixels.shape[0] // height
    columns = np.arange(width) * pixels.shape[1] // width
    return pixels[rows[:, None], columns]


def _levels(pixels: NDArray[np.floating]) -> Levels:
    return np.rint(255.0 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8)


def _png(levels: Levels) -> bytes:
    """Return levels (H, W, C) as a PNG."""
    import imageio.v3 as iio  # takes a moment

    content: bytes = iio.imwrite("<bytes>", levels, extension=".png", plugin="pillow")
    return content
