"""Batches: how the frames of a stage are divided among the cores of this machine, or the nodes of a farm."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from flowsculpt.pipeline.production.store.store import Key

MAX_BATCH = 256
"""Frames a process renders at most before it gives its memory back."""

MIN_BATCH = 4
"""Frames that are not worth the start of a second process: one renders them on all cores."""

MIN_LAST_BATCH = 64
"""The smallest last batches, in frames, while there are more batches than cores."""


def batches(numbers: Sequence[int], cores: int) -> list[tuple[int, ...]]:
    """Split frames into batches, none longer than MAX_BATCH, enough of them to keep the cores busy, but none
    needlessly shorter than MIN_BATCH.

    Frames in ascending order are split into neighbours, long batches first, for each costs a process the time
    to start, and shorter ones towards the end, so that no core waits long for another (guided
    self-scheduling: Polychronopoulos & Kuck, 1987). Frames in another order, such as coarse first, are dealt
    out, so that all cores work on the first ones first.
    """
    cores = max(1, cores)
    share = -(-len(numbers) // cores)
    if _ascend(numbers):
        return list(_halving_batches(numbers, cores, max(MIN_BATCH, min(MIN_LAST_BATCH, share))))
    size = min(MAX_BATCH, max(MIN_BATCH, share))
    hands = [numbers[i : i + size * cores] for i in range(0, len(numbers), size * cores)]
    dealt = (tuple(hand[i::cores]) for hand in hands for i in range(cores))
    return [batch for batch in dealt if batch]


def _halving_batches(numbers: Sequence[int], cores: int, least: int) -> Iterator[tuple[int, ...]]:
    """Yield batches of half of each core's share of what is left."""
    begun = 0
    while begun < len(numbers):
        size = min(MAX_BATCH, max(least, (len(numbers) - begun) // (2 * cores)))
        yield tuple(numbers[begun : begun + size])
        begun += size


def even_batches(numbers: Sequence[int], size: int) -> list[tuple[int, ...]]:
    """Split frames into equal batches of at most `size`: of neighbours, or dealt out, as `batches` does."""
    count = max(1, -(-len(numbers) // size))
    if not _ascend(numbers):
        return [tuple(numbers[i::count]) for i in range(count)]
    ends = [i * len(numbers) // count for i in range(count + 1)]
    return [tuple(numbers[first:end]) for first, end in pairwise(ends)]


def _ascend(numbers: Sequence[int]) -> bool:
    return list(numbers) == sorted(numbers)


@dataclass(frozen=True)
class FrameWork:
    """The frames that a farm makes of one stage of one request.

    frames   how many, at least 1
    seconds  what a node takes for one
    least    fewest frames of a batch, where there are so many
    """

    frames: int
    seconds: float
    least: int = 1

    def size(self, seconds: float) -> int:
        """Return the frames of a batch of about so many seconds."""
        size = min(MAX_BATCH, max(self.least, int(seconds / self.seconds + 0.5)))
        return math.ceil(self.frames / self.batches(size))

    def batches(self, size: int) -> int:
        """Return the number of batches of at most so many frames."""
        return math.ceil(self.frames / size)


def batch_sizes(works: Sequence[FrameWork], nodes: int, start: float) -> tuple[int, ...]:
    """Return the frames of a batch of each of several works, so that `nodes` make all of them soonest.

    start  seconds that a batch takes besides its frames, while a node starts a process

    Batches of equal seconds are tried, from one frame on. Each goes to the node that is free first. The last
    one ends at the latest after so many rounds of the longest, and at the latest when all work is shared out
    and the longest still runs (Graham, 1969). Of batches that end alike, the longest are taken.
    """
    seconds = sum(work.frames * work.seconds for work in works)
    mean = seconds / sum(work.frames for work in works)

    def end_and_count(sizes: Sequence[int]) -> tuple[float, int]:
        pairs = list(zip(works, sizes, strict=True))
        many = sum(work.batches(size) for work, size in pairs)
        longest = start + max(size * work.seconds for work, size in pairs)
        shared_out = (seconds + many * start) / nodes + longest * (1.0 - 1.0 / nodes)
        return round(min(math.ceil(many / nodes) * longest, shared_out), 6), many

    tried = {tuple(work.size(n * mean) for work in works) for n in range(1, MAX_BATCH + 1)}
    return min(tried, key=end_and_count)


@dataclass
class SharedFrames:
    """The frames of a stage that a farm's nodes share.

    frames  how many, by the place of their request
    sizes   the most of a batch, by the same place
    """

    frames: Counter[int] = field(default_factory=Counter)
    sizes: Mapping[int, int] = field(default_factory=dict)
    _known: set[Key] = field(default_factory=set)

    def count(self, place: int, keys: Collection[Key]) -> None:
        """Count the frames of a request that no request before it has."""
        new = set(keys) - self._known
        self._known |= new
        if new:
            self.frames[place] += len(new)
