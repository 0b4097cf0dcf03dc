"""Mix sounds of the parts of a movie, each at its place and as long as its part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from render.movie.movie_sound import BLOCK, RATE, Samples, Sound, blocks


@dataclass(frozen=True)
class Segment:
    """Sounds under a part of a movie.

    sounds        their starts count from the beginning of the part
    start         second of the movie at which the part begins
    seconds       length of the part
    rise, fall    seconds at its beginning and end over which it comes and goes, linearly
    """

    sounds: tuple[Sound, ...]
    start: Fraction
    seconds: Fraction
    rise: Fraction = Fraction(0)
    fall: Fraction = Fraction(0)


def mixed(segments: Sequence[Segment], seconds: Fraction) -> Iterator[Samples]:
    """Yield the sum of all segments in a movie of that length, in blocks; silence where there is none.

    Raises as `require_sound` does.
    """
    total = round(seconds * RATE)
    waiting = sorted(segments, key=lambda segment: segment.start, reverse=True)
    playing: list[_Player] = []
    for position in range(0, total, BLOCK):
        size = min(BLOCK, total - position)
        while waiting and round(waiting[-1].start * RATE) < position + size:
            segment = waiting.pop()
            playing += [_Player(segment, sound) for sound in segment.sounds]
        block = np.zeros((2, size), np.float32)
        for player in playing:
            player.add_to(block, position)
        playing = [player for player in playing if player.end > position + size]
        yield block


class _Player:
    """One sound of a segment, read as the movie goes on."""

    def __init__(self, segment: Segment, sound: Sound) -> None:
        self.start = round(segment.start * RATE)
        self.end = self.start + round(segment.seconds * RATE)
        self._rise, self._fall = float(segment.rise) * RATE, float(segment.fall) * RATE
        self._blocks = blocks(sound, segment.seconds)
        self._held = np.zeros((2, 0), np.float32)

    def add_to(self, block: Samples, position: int) -> None:
        """Add the samples that lie in a block (2, N), which begins at sample `position` of the movie."""
        first = max(self.start, position)
        last = min(self.end, position + block.shape[1])
        while self._held.shape[1] < last - first:
            self._held = np.concatenate([self._held, next(self._blocks)], axis=1)
        at = np.arange(first, last)
        factor = np.ones(len(at))
        if self._rise:
            factor = np.minimum(factor, (at - self.start + 0.5) / self._rise)
        if self._fall:
            factor = np.minimum(factor, (self.end - at - 0.5) / self._fall)
        block[:, first - position : last - position] += self._held[:, : last - first] * factor.astype("f4")
        self._held = self._held[:, last - first :]
