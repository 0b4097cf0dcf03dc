"""Sequences of frames: prefetched, and dissolved from clip to clip."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from render.movie.planes import Frame

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


def mix_frames(before: Frame, after: Frame, weight: float) -> Frame:
    """Mix two display frames of one size and type by their display values, as editing programs do."""
    first, second = before.astype(np.float32), after.astype(np.float32)
    values = np.rint(first * np.float32(1.0 - weight) + second * np.float32(weight))
    mixed: NDArray[Any] = values.astype(before.dtype)
    return mixed
