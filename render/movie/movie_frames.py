"""Display frames on their way into a movie: prefetched, dissolved, and in the pixel formats of encoders."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import islice
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.kernel_cache import compiled
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.post.colour import dither_pattern

Frame = NDArray[np.uint8] | NDArray[np.uint16]
"""A display frame (H, W, 3), or (H, W, 4) with coverage; uint8 counts 0 … 255, uint16 0 … 65535."""

_LUMA = {1: (0.2126, 0.7152, 0.0722), 9: (0.2627, 0.6780, 0.0593)}
"""Weights of red, green and blue in luma, by matrix (ITU-T H.273): BT.709-6, 3.2, and BT.2020-2, table 4."""


def require_frame(frame: NDArray[Any]) -> None:
    """Raises BadInputError for an array that is no display frame."""
    if frame.ndim != 3 or frame.shape[2] not in (3, 4) or frame.dtype not in (np.uint8, np.uint16):
        raise BadInputError(
            f"a frame is {frame.dtype} {frame.shape}; it must be uint8 or uint16 (H, W, 3) or (H, W, 4)"
        )


def pad_to_even(frame: Frame) -> Frame:
    """Repeat an odd last column or row once."""
    height, width = frame.shape[:2]
    if height % 2 == width % 2 == 0:
        return frame
    padded: NDArray[Any] = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return padded


def to_pixel_format(frame: Frame, pixel_format: str, matrix: int = 1) -> NDArray[Any]:
    """Return a frame in FFmpeg's pixel format yuv444p, yuv444p10le, yuva444p10le, gbrp16le or bgra.

    matrix  of Y′CbCr (ITU-T H.273): 1 is BT.709, 9 BT.2020

    Planar formats give (planes, H, W), bgra (H, W, 4). Coverage is dropped where the format has none.
    """
    if pixel_format == "bgra":
        return _bgra(frame)
    if pixel_format == "gbrp16le":
        sixteen = frame.astype(np.uint16) * 257 if frame.dtype == np.uint8 else frame
        return np.moveaxis(sixteen[..., [1, 2, 0]], 2, 0)
    kept = frame if pixel_format.startswith("yuva") else frame[..., :3]
    return _ycbcr(kept, 10 if "p10" in pixel_format else 8, matrix)


def prepare() -> None:
    """Compile the kernel, so that the first movie need not wait for it."""
    for bits in (8, 10):
        _ycbcr(np.zeros((2, 2, 3), np.uint8), bits)
        _ycbcr(np.zeros((2, 2, 3), np.uint16), bits)


def _ycbcr(frame: Frame, bits: int, matrix: int = 1) -> NDArray[Any]:
    """Convert full-range RGB to limited-range planes, dithered; coverage keeps its full range."""
    height, width, channels = frame.shape
    top, scale = np.float32(np.iinfo(frame.dtype).max), np.float32(2 ** (bits - 8))
    noise = dither_pattern(height, width) if frame.dtype == np.uint16 else _half(height, width)
    planes = np.empty((channels, height, width), np.uint8 if bits == 8 else np.uint16)
    red, green, blue = _LUMA[matrix]
    weights = np.array([red, green, blue, 112.0 / (1.0 - blue), 112.0 / (1.0 - red)], np.float32)
    _convert_to_ycbcr(np.ascontiguousarray(frame), top, scale, noise, weights, planes)
    if channels == 4:
        planes[3] = np.rint(frame[..., 3].astype(np.float32) / top * np.float32(2**bits - 1))
    return planes


@lru_cache(maxsize=4)
def _half(height: int, width: int) -> NDArray[np.float32]:
    """(H, W) filled with a half: frames of 8 bits were dithered when they were quantised."""
    noise = np.full((height, width), 0.5, np.float32)
    noise.setflags(write=False)  # shared by all callers
    return noise


def _bgra(frame: Frame) -> NDArray[np.uint8]:
    """Return B, G, R of 8 bits, dithered, and an opaque alpha."""
    height, width = frame.shape[:2]
    if frame.dtype == np.uint16:
        noise = dither_pattern(height, width)[..., None]
        frame = np.floor(frame.astype(np.float32) * np.float32(255 / 65535) + noise).astype(np.uint8)
    opaque = np.full((height, width, 1), 255, dtype=np.uint8)
    return np.concatenate([frame[..., 2::-1], opaque], axis=2)


@compiled()
def _convert_to_ycbcr(
    frame: NDArray[Any],
    white: np.float32,
    scale: np.float32,
    dither: NDArray[np.float32],
    weights: NDArray[np.float32],
    planes: NDArray[Any],
) -> None:
    """Convert full-range RGB (H, W, 3 or 4) to limited-range Y, Cb, Cr, in planes (3, H, W).

    white   the frame's value of white
    scale   steps per step of 8 bits
    dither  (H, W): a value is rounded up where its fraction is 1 - dither or more
    weights of red, green and blue in luma; steps of 8 bits per difference of blue, and of red, from luma
    """
    black, middle, luma_range = np.float32(16.0), np.float32(128.0), np.float32(219.0)
    for i in range(frame.shape[0]):
        for j in range(frame.shape[1]):
            red = np.float32(frame[i, j, 0]) / white
            green = np.float32(frame[i, j, 1]) / white
            blue = np.float32(frame[i, j, 2]) / white
            luma = red * weights[0] + green * weights[1] + blue * weights[2]
            offset = dither[i, j]
            planes[0, i, j] = np.int32((black + luma_range * luma) * scale + offset)
            planes[1, i, j] = np.int32((middle + weights[3] * (blue - luma)) * scale + offset)
            planes[2, i, j] = np.int32((middle + weights[4] * (red - luma)) * scale + offset)


T = TypeVar("T")

ClipFrames = tuple[int, int, Iterator[T]]
"""The number of frames of a clip, the length of its dissolve from the clip before, and the frames."""


def prefetch(items: Iterator[T]) -> Iterator[T]:
    """Yield the items; a thread makes the next one while this one is used."""
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(next, items, None)
        while (item := coming.result()) is not None:
            coming = pool.submit(next, items, None)
            yield item


def dissolve(clips: Sequence[ClipFrames[T]], mix: Callable[[T, T, float], T]) -> Iterator[T]:
    """Yield the frames of clip after clip; in a dissolve, the frames of two clips overlap.

    mix  takes a frame of each clip and the weight of the second, above 0 and below 1

    Only the frames shown now are held.
    """
    for place, (count, lead, frames) in enumerate(clips):
        _, tail, following = clips[place + 1] if place + 1 < len(clips) else (0, 0, iter(()))
        yield from islice(frames, count - lead - tail)
        for step in range(1, tail + 1):
            yield mix(next(frames), next(following), step / (tail + 1))


def loop_frames(
    numbers: list[int],
    lead: int,
    shown: Callable[[list[int]], Iterator[T]],
    mix: Callable[[T, T, float], T] | None = None,
) -> Iterator[T]:
    """Yield the frames of a movie that loops, of which the first `lead` come last, mixed with its end.

    shown  yields frames by their numbers
    mix    as of `dissolve`; by default `mix_frames`
    """
    if not lead:
        return shown(numbers)
    first, rest = numbers[:lead], numbers[lead:]
    mixing: Any = mix or mix_frames
    return dissolve([(len(rest), 0, shown(rest)), (lead, lead, shown(first))], mixing)


def mix_frames(before: Frame, after: Frame, weight: float) -> Frame:
    """Mix two display frames of one size and type by their display values, as editing programs do."""
    first, second = before.astype(np.float32), after.astype(np.float32)
    values = np.rint(first * np.float32(1.0 - weight) + second * np.float32(weight))
    mixed: NDArray[Any] = values.astype(before.dtype)
    return mixed
