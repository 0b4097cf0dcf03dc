"""Sequences of frames: timecode, prefetching, and dissolves from clip to clip."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import islice
from math import ceil
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from render.movie.planes import Frame

MAX_RATE = 99
"""The highest nominal rate: timecode has two digits for frames."""

FILM_START = 3600
"""The timecode of a film's first frame, in seconds: 01:00:00:00 leaves room for leaders."""

T = TypeVar("T")

ClipFrames = tuple[int, int, Iterator[T]]
"""The number of frames of a clip, the length of its dissolve from the clip before, and the frames."""


def timecode(frame: int, rate: Fraction) -> str:
    """Return the timecode of a frame: `00:00:01:18` for frame 42 at 24 frames per second.

    Frame 0 is 00:00:00:00. 24000/1001 counts 24 frames per second, as all non-drop timecode does, so it runs
    behind the clock. It wraps after 24 hours; frames before 0 lie at the end of the day. A rate that has no
    timecode gives an empty string.
    """
    nominal = ceil(rate)
    if nominal > MAX_RATE or rate.denominator not in (1, 1001):
        return ""
    seconds, frames = divmod(frame % (nominal * 86400), nominal)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}:{frames:02d}"


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
