"""The level of a frequency band of a sound over time, by short-time Fourier transforms.

The level is the amplitude of the sine wave that has the band's power: √2 · RMS, so that a sine of amplitude a
within the band has the level a. Channels are not mixed before: their powers are averaged, and what is out of
phase between them counts. Windows are Hann's. They overlap by seven eighths, or lie 5 ms apart, whichever is
longer. They are eight times as long as a period of the band's width and at least 25 ms, so that edges of a
band are soft over a quarter of its width.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.limited_process import Parser, ParserError
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.movie.movie_sound import (
    MOST_BYTES,
    TIMED,
    SoundSource,
    opened_sound,
    reading_error,
    unreadable,
)

SHORTEST_WINDOW, SHORTEST_HOP = 0.025, 0.005  # seconds

STEPS = 1_000_000
"""Steps of a level, from 0 to the highest of the sound: rounded, it is the same on every machine."""

_MOST_AT_ONCE = 1 << 18  # samples of a channel in the windows that are transformed together


@dataclass(frozen=True)
class BandLevel:
    """Levels of a band at equal intervals, from the beginning of the sound on.

    interval  seconds
    levels    (N,) at least 0; a sine of full scale has the level 1
    seconds   length of the sound
    silence   seconds of it that are in no file: before its sound and within; see `SoundSource`
    """

    interval: float
    levels: NDArray[np.float64]
    seconds: float
    silence: float = 0.0


def band_level(file: Path, digest: str, low: float, high: float) -> BandLevel:
    """Return the level over time of the band from `low` to `high` Hz; the disk cache stores it by content.

    digest  SHA-256 of the file's content

    Raises MissingInputError where there is no such file, BadInputError where it cannot be read to its end, or
    where the band lies above half of its sample rate.
    """
    InputFile(file, MOST_BYTES).size()
    try:
        text = Parser("flowsculpt.render.movie.band_level").answer_about_content(
            file, digest, "av", repr(low), repr(high), TIMED
        )
    except ParserError as error:
        raise unreadable(file, error) from None
    answer = json.loads(text)
    if low >= answer["rate"] / 2:
        raise BadInputError(
            f"{file}: it has {answer['rate']} samples a second, so it has nothing above "
            f"{answer['rate'] / 2:g} Hz, and the band begins at {low:g} Hz; lower the band"
        )
    levels = np.array(answer["steps"], dtype=np.float64) * (answer["highest"] / STEPS)
    return BandLevel(answer["interval"], levels, answer["seconds"], answer["silence"])


def _analysed(file: str, low: str, high: str, _timed: str = TIMED) -> bytes:
    """Answer the levels of a band as JSON. Raises ValueError for a file that cannot be read."""
    try:
        with opened_sound(Path(file)) as source:
            return _levels(source, float(low), float(high))
    except Exception as error:
        raise ValueError(reading_error(error)) from None


def _levels(source: SoundSource, low: float, high: float) -> bytes:
    rate = int(source.stream.rate)
    window = max(SHORTEST_WINDOW, 8.0 / (high - low))
    size, hop = round(window * rate), round(max(SHORTEST_HOP, window / 8.0) * rate)
    weights = _weights(size, rate, low, high)
    parts = source.resampled(source.stream.layout, rate)
    count, found = 0, []
    for windows, read in _windows(parts, size, hop):
        count = read
        spectrum = np.abs(np.fft.rfft(windows, axis=-1)) ** 2
        found.append((spectrum @ weights).mean(axis=0))
    if not count:
        raise ValueError("it holds none")
    levels = np.sqrt(2.0 * np.concatenate(found))
    highest = float(f"{levels.max():.6g}")
    steps = np.rint(levels * (STEPS / highest)).astype(int) if highest else np.zeros(len(levels), int)
    times = {"rate": rate, "interval": hop / rate, "seconds": count / rate, "silence": source.silence}
    return json.dumps({**times, "highest": highest, "steps": steps.tolist()}).encode()


def _weights(size: int, rate: int, low: float, high: float) -> NDArray[np.float64]:
    """Return the factors (size // 2 + 1,) of squared magnitudes in the mean power of a band.

    A bin counts by the part of it that lies in the band; all but the first and the last stand for two.
    """
    bins = np.arange(size // 2 + 1) * (rate / size)
    half = 0.5 * rate / size
    inside = (np.minimum(bins + half, high) - np.maximum(bins - half, low)) / (2.0 * half)
    both = np.where((bins == 0.0) | (bins == rate / 2), 1.0, 2.0)
    power: NDArray[np.float64] = both * np.clip(inside, 0.0, 1.0) / (size * (_hann(size) ** 2).sum())
    return power


def _hann(size: int) -> NDArray[np.float64]:
    """Return the periodic Hann window (size,)."""
    return np.sin(np.pi * np.arange(size) / size) ** 2


def _windows(
    parts: Iterator[NDArray[np.float32]], size: int, hop: int
) -> Iterator[tuple[NDArray[np.float64], int]]:
    """Yield windowed samples (channels, windows, size), and the number of samples read so far.

    The first window is centred at the first sample, the last at or after the last sample; beyond is silence.
    """
    held: NDArray[np.float64] | None = None
    count, hann, most = 0, _hann(size), max(1, _MOST_AT_ONCE // size)

    def cut(samples: NDArray[np.float64], windows: int) -> NDArray[np.float64]:
        views = np.lib.stride_tricks.sliding_window_view(samples, size, axis=1)
        return views[:, : windows * hop : hop] * hann

    for part in parts:
        if held is None:
            held = np.zeros((part.shape[0], size // 2))
        held = np.concatenate([held, part], axis=1)
        count += part.shape[1]
        while (held.shape[1] - size) // hop + 1 >= most:
            yield cut(held, most), count
            held = held[:, most * hop :]
    if held is None or not count:
        return
    held = np.concatenate([held, np.zeros((held.shape[0], size + hop))], axis=1)
    yield cut(held, (held.shape[1] - size) // hop + 1), count


if __name__ == "__main__":
    Parser.serve(_analysed)
