"""Dissolves: pictures of two clips shown through one another, as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from render.movie.planes import Frame

T = TypeVar("T")

Piece = tuple[int, int, Iterator[T]]
"""How many frames it has, over how many it dissolves from what is before it, and the frames."""


def dissolved(pieces: Sequence[Piece[T]], mix: Callable[[T, T, float], T]) -> Iterator[T]:
    """The pieces one after the other; where one dissolves from the one before, their frames overlap.

    mix  two frames, and how much of the second is seen, above 0 and below 1

    Only the frames shown now are held.
    """
    for place, (count, lead, frames) in enumerate(pieces):
        _, tail, following = pieces[place + 1] if place + 1 < len(pieces) else (0, 0, iter(()))
        yield from islice(frames, count - lead - tail)
        for step in range(1, tail + 1):
            yield mix(next(frames), next(following), step / (tail + 1))


def mixed(before: Frame, after: Frame, share: float) -> Frame:
    """Two display frames of one size and type, as editing programs mix them: by their display values."""
    values = before.astype(np.float32) * np.float32(1.0 - share) + after.astype(np.float32) * np.float32(
        share
    )
    found: NDArray[Any] = np.rint(values).astype(before.dtype)
    return found
