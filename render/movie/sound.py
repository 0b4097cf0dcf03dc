"""Sound laid under pictures: read, made stereo of 48 kHz, moved, faded, cut or padded to length. Knows av."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from render.base.errors import CorruptImageError, MissingImageError

RATE = 48_000
"""Samples per second, what film sound has."""
BLOCK = 1024
"""Samples handed on at a time: what an AAC encoder takes."""

Samples = NDArray[np.float32]


@dataclass(frozen=True)
class Sound:
    """A file of sound and how it lies under a film.

    start     second of the film at which it begins; before 0, so much of its beginning is left out
    gain      decibels; 0 is as it is in the file
    fade_in   seconds, from where it is first heard
    fade_out  seconds, to where it is last heard
    """

    file: Path
    start: float = 0.0
    gain: float = 0.0
    fade_in: float = 0.0
    fade_out: float = 0.0


def require_sound(file: Path) -> float:
    """How many seconds it lasts, found by reading all of it.

    Raises MissingImageError where there is no such file, CorruptImageError where it holds no sound that can
    be read to its end.
    """
    if not file.is_file():
        raise MissingImageError(f"{file}: there is no such sound")
    facts = file.stat()
    return _length(file, facts.st_mtime_ns, facts.st_size) / RATE


def blocks(sound: Sound, seconds: Fraction) -> Iterator[Samples]:
    """What is heard under pictures of that length, (2, ≤ BLOCK) at a time: silence where the sound is not.

    Raises as `require_sound` does.
    """
    total = round(seconds * RATE)
    length = round(require_sound(sound.file) * RATE)
    first = round(sound.start * RATE)
    heard = max(0, first), min(total, first + length)
    position = 0
    for block in _exactly(_placed(sound.file, first), total):
        yield block * _loudness(sound, np.arange(position, position + block.shape[1]), heard)
        position += block.shape[1]


def _loudness(sound: Sound, at: NDArray[np.int64], heard: tuple[int, int]) -> NDArray[np.float32]:
    """(N,) by which samples are multiplied."""
    level = np.full(len(at), 10.0 ** (sound.gain / 20.0))
    if sound.fade_in > 0:
        level *= np.clip((at - heard[0] + 0.5) / (sound.fade_in * RATE), 0.0, 1.0)
    if sound.fade_out > 0:
        level *= np.clip((heard[1] - at - 0.5) / (sound.fade_out * RATE), 0.0, 1.0)
    return level.astype(np.float32)


def _placed(file: Path, first: int) -> Iterator[Samples]:
    """The samples of a file, from sample `first` of the film on."""
    if first > 0:
        yield from (np.zeros((2, min(BLOCK, first - n)), np.float32) for n in range(0, first, BLOCK))
    skipped = max(0, -first)
    for samples in _read(file):
        kept = samples[:, skipped:]
        skipped -= samples.shape[1] - kept.shape[1]
        yield kept


def _exactly(parts: Iterator[Samples], total: int) -> Iterator[Samples]:
    """The same samples in blocks, `total` of them, silence at the end where there are fewer."""
    held = np.zeros((2, 0), np.float32)
    while total:
        size = min(BLOCK, total)
        while held.shape[1] < size:
            more = next(parts, None)
            held = np.concatenate([held, np.zeros((2, size), np.float32) if more is None else more], axis=1)
        yield held[:, :size]
        held, total = held[:, size:], total - size


def _read(file: Path) -> Iterator[Samples]:
    """All of a file, stereo of 48 kHz, (2, N) as it comes."""
    try:
        with av.open(str(file)) as container:
            stream = container.streams.audio[0]
            layout = "mono" if stream.channels == 1 else "stereo"  # FFmpeg makes one channel in two quieter
            resampler = av.AudioResampler(format="fltp", layout=layout, rate=RATE)
            for frame in itertools.chain(container.decode(stream), [None]):
                for part in resampler.resample(frame):
                    samples = np.asarray(part.to_ndarray(), dtype=np.float32)
                    yield np.broadcast_to(samples, (2, samples.shape[1]))
    except (av.error.FFmpegError, IndexError) as error:
        reason = "it holds none" if isinstance(error, IndexError) else error.strerror
        raise CorruptImageError(
            f"{file}: cannot be read as sound ({reason}); save it as WAV or FLAC"
        ) from None


@lru_cache(maxsize=16)
def _length(file: Path, _time: int, _size: int) -> int:
    """Samples; asked of a file that nobody has changed."""
    length: int = sum(part.shape[1] for part in _read(file))
    if not length:
        raise CorruptImageError(f"{file}: cannot be read as sound (it holds none); save it as WAV or FLAC")
    return length
