"""Sound under pictures: read as stereo of 48 kHz, placed, faded, mixed, and written into a movie."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.limited_process import Parser, ParserError
from flowsculpt.render.base.render_errors import BadInputError, reason_of
from flowsculpt.render.movie.announced_sizes import WithCorrectedSizes, corrected_sizes

RATE = 48_000  # samples per second, as film sound has
BLOCK = 1024  # samples per block, as an AAC encoder takes them
MOST_BYTES = 4 << 30  # size of the largest file

_SLOWEST, _FASTEST = 1000, 768_000
"""Samples per second of a file; others are damaged, and resampling them takes forever."""

TIMED = "with its gaps"
"""Part of questions about sounds: silence stands where timestamps leave a gap."""

_SHORTEST_GAP, _LONGEST_GAP, _LONGEST_OVERLAP = 0.05, 86_400.0, 1.0
"""Seconds: timestamps of many containers are rounded, gaps over a day are damage, and time begins again where
it turns back further than by an overlap."""

_CONTAINERS = {
    "format_whitelist": "wav,w64,aiff,au,caf,flac,mp3,ogg,aac,ac3,eac3,mov,matroska,mpegts,asf,wv,tta,ape",
    "protocol_whitelist": "file",
}
"""Options of FFmpeg: formats that may be opened. Not playlists, which name other files and addresses."""

Samples = NDArray[np.float32]  # stereo samples (2, N), −1 … 1


@dataclass(frozen=True)
class Sound:
    """A sound file and its place under a film.

    start     second of the film at which it begins; below 0, so much of its beginning is left out
    gain      decibels; 0 leaves it as it is in the file
    fade_in   seconds, from where it is first heard
    fade_out  seconds, to where it is last heard
    """

    file: Path
    start: float = 0.0
    gain: float = 0.0
    fade_in: float = 0.0
    fade_out: float = 0.0


def require_sound(file: Path) -> float:
    """Read a sound to its end and return its length in seconds.

    It is decoded once for each content, in a process of its own.

    Raises MissingInputError where there is no such file, BadInputError where it holds no sound that can
    be read to its end.
    """
    return _counts(file)[0] / RATE


def silence_in(file: Path) -> float:
    """Return the seconds of silence that a file's timestamps ask for, before its sound or within.

    Raises as `require_sound`.
    """
    return _counts(file)[1]


def _counts(file: Path) -> tuple[int, float]:
    """Return the samples of a file, and the seconds without sound among them."""
    InputFile(file, MOST_BYTES).size()
    facts = file.stat()
    return _measure(file, facts.st_mtime_ns, facts.st_size)


def blocks(sound: Sound, seconds: Fraction) -> Iterator[Samples]:
    """Yield the sound under pictures of that length, in blocks; silence before its start and after its end.

    Raises as `require_sound` does.
    """
    total, start = round(seconds * RATE), round(sound.start * RATE)
    first, last = max(0, start), min(total, start + round(require_sound(sound.file) * RATE))
    position = 0
    for block in _in_blocks(_place(sound.file, start), total):
        at = np.arange(position, position + block.shape[1])
        yield block * _gain(sound, at, first, last)
        position += block.shape[1]


def _gain(sound: Sound, at: NDArray[np.int64], first: int, last: int) -> NDArray[np.float32]:
    """Return the factors (N,) of the samples at these places; sound is heard from `first` to `last`."""
    gain = np.full(len(at), 10.0 ** (sound.gain / 20.0))
    if sound.fade_in > 0:
        gain *= np.clip((at - first + 0.5) / (sound.fade_in * RATE), 0.0, 1.0)
    if sound.fade_out > 0:
        gain *= np.clip((last - at - 0.5) / (sound.fade_out * RATE), 0.0, 1.0)
    return gain.astype(np.float32)


def _place(file: Path, start: int) -> Iterator[Samples]:
    """Yield silence up to sample `start` of the film, then the file; below 0, leave out its beginning.

    Raises BadInputError where the file cannot be read to its end.
    """
    if start > 0:
        yield from (np.zeros((2, min(BLOCK, start - n)), np.float32) for n in range(0, start, BLOCK))
    skip = max(0, -start)
    try:
        with opened_sound(file) as source:
            for samples in _decode(source):
                kept = samples[:, skip:]
                skip -= samples.shape[1] - kept.shape[1]
                yield kept
    except Exception as error:  # damaged files raise errors of FFmpeg, of numpy and others
        raise unreadable(file, reading_error(error)) from None


def _in_blocks(parts: Iterator[Samples], total: int) -> Iterator[Samples]:
    """Cut the samples into blocks, `total` samples in all; pad the end with silence."""
    held = np.zeros((2, 0), np.float32)
    while total:
        size = min(BLOCK, total)
        while held.shape[1] < size:
            more = next(parts, None)
            held = np.concatenate([held, np.zeros((2, size), np.float32) if more is None else more], axis=1)
        yield held[:, :size]
        held, total = held[:, size:], total - size


def _decode(source: SoundSource) -> Iterator[Samples]:
    """Decode a sound as stereo of 48 kHz."""
    layout = "mono" if source.stream.channels == 1 else "stereo"  # FFmpeg makes one channel in two quieter
    for samples in source.resampled(layout, RATE):
        yield np.broadcast_to(samples, (2, samples.shape[1]))


@contextmanager
def opened_sound(file: Path) -> Iterator[SoundSource]:
    """Open a sound file; yield the first stream of sound in it.

    imageio reads no files without pictures, so FFmpeg does. Raises ValueError where there is no sound in it,
    or it was cut off, and errors of FFmpeg: call it in a process of its own (`limited_process`).
    """
    sizes = corrected_sizes(file)
    with file.open("rb") as opened:
        source: Any = WithCorrectedSizes(opened, sizes) if sizes else str(file)
        with av.open(source, options=_CONTAINERS) as container:
            if not container.streams.audio:
                raise ValueError("it holds none")
            stream = container.streams.audio[0]
            if not _SLOWEST <= stream.rate <= _FASTEST:
                raise ValueError(f"it has {stream.rate} samples a second")
            yield SoundSource(container, stream)


@dataclass
class SoundSource:
    """A stream of sound in FFmpeg's container. Its time 0 is where the container begins, as players have it.

    silence  seconds without sound before it and within, as far as it was read
    """

    container: Any
    stream: Any
    silence: float = 0.0

    def resampled(self, layout: str, rate: int) -> Iterator[NDArray[np.float32]]:
        """Yield samples (channels, N) in a layout of channels, at a rate in samples per second.

        Raises ValueError for samples that are not finite, and errors of FFmpeg.
        """
        resampler, count = av.AudioResampler(format="fltp", layout=layout, rate=rate), 0
        for frame in itertools.chain(self._frames(), [None]):
            for part in resampler.resample(frame):
                samples = np.asarray(part.to_ndarray(), dtype=np.float32)
                if not np.isfinite(samples).all():
                    bad = count + int(np.argmin(np.isfinite(samples).all(axis=0)))
                    raise ValueError(f"its sample at {bad / rate:.4g} s is not a finite number")
                count += samples.shape[1]
                yield samples

    def _frames(self) -> Iterator[av.AudioFrame]:
        """Yield the frames of the stream one after another, with silence where their timestamps leave gaps.

        Where timestamps turn back, as in files that were joined, or are unsteady, the sound goes on.
        """
        end: float | None = None
        for frame in self.container.decode(self.stream):
            if (time := frame.time) is not None:
                if end is None or not -_LONGEST_OVERLAP < time - end <= _SHORTEST_GAP:
                    yield from self._silence(frame, self._begin(time) if end is None else end)
                    end = time
                end += frame.samples / frame.sample_rate
            yield frame

    def _begin(self, first: float) -> float:
        """Return the time at which the container begins, or that of the first frame if it does not say."""
        start = self.container.start_time
        return first if start is None else float(start / av.time_base)

    def _silence(self, frame: av.AudioFrame, end: float) -> Iterator[av.AudioFrame]:
        """Yield silence between a time and a frame, in its form. Raises ValueError if it is over a day."""
        rate, seconds = frame.sample_rate, max(0.0, frame.time - end)
        if seconds > _LONGEST_GAP:
            raise ValueError(f"it has nothing for {seconds:.4g} s")
        count = round(seconds * rate)
        self.silence += count / rate
        for first in range(0, count, rate):
            silent = av.AudioFrame(frame.format.name, frame.layout.name, min(rate, count - first))
            silent.sample_rate, silent.time_base = rate, frame.time_base
            for plane in silent.planes:
                plane.update(bytes([128 if frame.format.name[:2] == "u8" else 0]) * plane.buffer_size)
            yield silent


def reading_error(error: Exception) -> str:
    """Return the reason of an error while sound is read, in one line."""
    return str(error.strerror) if isinstance(error, av.error.FFmpegError) else reason_of(error)


def unreadable(file: Path, reason: object) -> BadInputError:
    """Return the error of a sound file that cannot be read, for a reason."""
    return BadInputError(f"{file}: cannot be read as sound ({reason}); save it as WAV or FLAC")


@lru_cache(maxsize=16)
def _measure(file: Path, _modified: int, _size: int) -> tuple[int, float]:
    """Return what `_counted` answers, asked once for each content."""
    try:
        answer = Parser("flowsculpt.render.movie.movie_sound").answer_about_content(
            file, InputFile(file).digest(), "av", TIMED
        )
    except ParserError as error:
        raise unreadable(file, error) from None
    count, silence = answer.split()
    return int(count), float(silence)


def _counted(file: str, _timed: str = TIMED) -> bytes:
    """Answer the number of samples of a file, and the seconds of silence among them."""
    try:
        with opened_sound(Path(file)) as source:
            count = sum(part.shape[1] for part in _decode(source))
    except Exception as error:
        raise ValueError(reading_error(error)) from None
    if not count:
        raise ValueError("it holds none")
    return f"{count} {source.silence!r}".encode()


class AudioStream:
    """The sound of a movie that is being written to one of FFmpeg's containers."""

    def __init__(self, container: Any, codec: str, samples: Iterator[Samples]) -> None:
        self._container, self._samples, self._written = container, samples, 0
        self._stream = container.add_stream(codec, rate=RATE, layout="stereo")
        self._is_float = codec == "aac"
        if self._is_float:
            self._stream.bit_rate = 320_000

    def write_until(self, seconds: Fraction) -> None:
        """Write the sound up to a time, so that pictures and sound lie side by side in the file."""
        while self._written < seconds * RATE and (block := next(self._samples, None)) is not None:
            frame = _audio_frame(block, self._is_float)
            frame.sample_rate, frame.pts, frame.time_base = RATE, self._written, Fraction(1, RATE)
            self._written += block.shape[1]
            self._container.mux(self._stream.encode(frame))

    def finish(self) -> None:
        """Write what the encoder still holds."""
        self._container.mux(self._stream.encode(None))


def _audio_frame(block: Samples, is_float: bool) -> av.AudioFrame:
    """Return samples as floats, or of 24 bits in the upper bits of 32."""
    if is_float:
        return av.AudioFrame.from_ndarray(np.ascontiguousarray(block), format="fltp", layout="stereo")
    steps = np.rint(np.clip(block.T.astype(np.float64), -1.0, 1.0) * (2**23 - 1)).astype(np.int32) << 8
    return av.AudioFrame.from_ndarray(steps.reshape(1, -1), format="s32", layout="stereo")


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


if __name__ == "__main__":
    Parser.serve(_counted)
