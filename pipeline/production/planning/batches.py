"""Batches: the frames that one process renders."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

MAX_BATCH = 256
"""Frames a process renders at most before it gives its memory back."""

MIN_BATCH = 4
"""Frames that are not worth the start of a second process: one renders them on all cores."""

MIN_LAST_BATCH = 64
"""Frames of a batch from which on batches become no smaller, while there are more of them than cores."""


def batches(numbers: Sequence[int], cores: int, least: int = MIN_BATCH) -> list[tuple[int, ...]]:
    """Split frames into batches, none longer than MAX_BATCH, enough of them to keep the cores busy, but none
    needlessly shorter than `least`.

    Frames in ascending order are split into neighbours, long batches first, for each costs a process the time
    to start, and shorter ones towards the end, so that no core waits long for another (guided
    self-scheduling: Polychronopoulos & Kuck, 1987). Frames in another order, such as coarse first, are dealt
    out, so that all cores work on the first ones first.
    """
    cores = max(1, cores)
    share = -(-len(numbers) // cores)
    if list(numbers) == sorted(numbers):
        return list(_guided(numbers, cores, max(least, min(MIN_LAST_BATCH, share))))
    size = min(MAX_BATCH, max(least, share))
    hands = [numbers[i : i + size * cores] for i in range(0, len(numbers), size * cores)]
    dealt = (tuple(hand[i::cores]) for hand in hands for i in range(cores))
    return [batch for batch in dealt if batch]


def _guided(numbers: Sequence[int], cores: int, least: int) -> Iterator[tuple[int, ...]]:
    """Yield batches of half of each core's share of what is left."""
    begun = 0
    while begun < len(numbers):
        size = min(MAX_BATCH, max(least, (len(numbers) - begun) // (2 * cores)))
        yield tuple(numbers[begun : begun + size])
        begun += size
