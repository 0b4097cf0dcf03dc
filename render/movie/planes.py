"""Display pictures as the planes of samples that encoders take: colours by BT.709, rounded with grain."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.movie.kernels.planes import to_ycbcr
from render.post.dither import dither_pattern

Frame = NDArray[np.uint8] | NDArray[np.uint16]
"""A display picture (H, W, 3), or (H, W, 4) with its coverage; uint8 counts 0 … 255, uint16 0 … 65535."""


def require_frame(frame: NDArray[Any], channels: tuple[int, ...] = (3,)) -> None:
    """Raises BadInputError for what is no display picture of so many channels."""
    kinds = (np.uint8, np.uint16)
    if frame.ndim != 3 or frame.shape[2] not in channels or frame.dtype not in kinds:
        shapes = " or ".join(f"(H, W, {count})" for count in channels)
        raise BadInputError(f"a frame is {frame.dtype} {frame.shape}; it must be uint8 or uint16 {shapes}")


def even(frame: Frame) -> Frame:
    """The frame, an odd last column or row repeated once: where colour has half the resolution, sizes are
    even."""
    height, width = frame.shape[:2]
    if height % 2 == width % 2 == 0:
        return frame
    padded: NDArray[Any] = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return padded


def ycbcr(frame: Frame, bits: int) -> NDArray[Any]:
    """Full-range RGB as limited-range BT.709 Y, Cb, Cr planes (3, H, W) of so many bits; dithered.

    A coverage becomes a fourth plane, full range.
    """
    height, width, channels = frame.shape
    top, scale = np.float32(np.iinfo(frame.dtype).max), np.float32(2 ** (bits - 8))
    noise = dither_pattern(height, width) if frame.dtype == np.uint16 else _half(height, width)
    planes = np.empty((channels, height, width), np.uint8 if bits == 8 else np.uint16)
    to_ycbcr(np.ascontiguousarray(frame), top, scale, noise, planes)
    if channels == 4:
        planes[3] = np.rint(frame[..., 3].astype(np.float32) / top * np.float32(2**bits - 1))
    return planes


def prepare() -> None:
    """Compile the kernel, so that the first movie need not wait for it."""
    for bits in (8, 10):
        ycbcr(np.zeros((2, 2, 3), np.uint8), bits)
        ycbcr(np.zeros((2, 2, 3), np.uint16), bits)


@lru_cache(maxsize=4)
def _half(height: int, width: int) -> NDArray[np.float32]:
    """(H, W) of a half: what is 8 bits already was dithered then."""
    noise = np.full((height, width), 0.5, np.float32)
    noise.setflags(write=False)  # everyone is given this one
    return noise


def gbr(frame: Frame) -> NDArray[np.uint16]:
    """G, B, R planes (3, H, W) of 16 bits, without any loss."""
    sixteen = frame.astype(np.uint16) * 257 if frame.dtype == np.uint8 else frame
    return np.asarray(np.moveaxis(sixteen[..., [1, 2, 0]], 2, 0), dtype=np.uint16)


def bgra(frame: Frame) -> NDArray[np.uint8]:
    """B, G, R and a coverage of 1 side by side, (1, H, 4 · W), of 8 bits; dithered."""
    height, width = frame.shape[:2]
    if frame.dtype == np.uint16:
        noise = dither_pattern(height, width)[..., None]
        frame = np.floor(frame.astype(np.float32) * np.float32(255 / 65535) + noise).astype(np.uint8)
    opaque = np.full((height, width, 1), 255, dtype=np.uint8)
    pixels = np.concatenate([frame[..., 2::-1], opaque], axis=2)
    return np.asarray(pixels.reshape(1, height, 4 * width), dtype=np.uint8)
