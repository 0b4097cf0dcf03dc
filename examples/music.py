"""A short piece of music with bass, mid and high parts, for shots that follow a sound.

`python -m examples.music` writes shots/pulse.opus: 24 s, nine bars in D minor at 90 beats a minute, so that a
beat is 16 frames of 24 a second. A bass and a pad begin; plucked strings join in the second bar, hats and
bells in the third; the ninth bar fades.
"""

from __future__ import annotations

import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.atomic_write import atomic_write

RATE, BEAT, BARS = 48_000, 2.0 / 3.0, 9
"""Samples per second, seconds, and bars of four beats."""

SECONDS = 4 * BEAT * BARS

CHORDS = ((38, 41, 45, 48), (34, 38, 41, 45), (41, 45, 48, 52), (36, 40, 43, 47))
"""MIDI notes from the bass up: D minor 7, B♭ major 7, F major 7, C major 7."""

PATTERN = (0, 2, 1, 3, 2, 1, 3, 2)
"""Notes of the chord that the strings pluck in a bar, one each half beat."""

Mono = NDArray[np.float64]
Stereo = NDArray[np.float64]
"""(2, N)."""


def frequency(note: float) -> float:
    """Return the frequency of a MIDI note, Hz."""
    return float(440.0 * 2.0 ** ((note - 69.0) / 12.0))


def clock(seconds: float) -> Mono:
    """Return the times of samples."""
    return np.arange(round(seconds * RATE)) / RATE


def bass(note: int) -> Mono:
    """Return a beat of the bass: a sine that falls to its pitch, with a little of its octave."""
    t = clock(BEAT * 0.95)
    pitch = frequency(note)
    phase = 2.0 * np.pi * (pitch * t + 0.9 * pitch * 0.03 * (1.0 - np.exp(-t / 0.03)))
    tone = np.sin(phase) + 0.25 * np.sin(2.0 * phase) * np.exp(-t / 0.15)
    return tone * np.exp(-t / 0.24) * np.clip(t / 0.004, 0, 1) * np.clip((t[-1] - t) / 0.03, 0, 1)


def pluck(note: int) -> Mono:
    """Return a plucked string: harmonics that die the sooner the higher they are."""
    t, pitch = clock(1.4), frequency(note)
    parts = [
        np.sin(2 * np.pi * k * pitch * t * (1 + 2e-4 * k * k)) * np.exp(-t * (1.8 + 1.1 * k)) / k**1.3
        for k in range(1, 9)
    ]
    return np.sum(parts, axis=0) * np.clip(t / 0.002, 0, 1)


def pad(notes: tuple[int, ...], seconds: float, detune: float) -> Mono:
    """Return a soft chord that swells and goes."""
    t = clock(seconds)
    chord = [
        np.sin(2 * np.pi * frequency(note + detune * (-1) ** i) * t + i) / (1 + 0.3 * k)
        for i, note in enumerate(notes)
        for k in range(2)
    ]
    return np.sum(chord, axis=0) * np.sin(np.pi * np.clip(t / seconds, 0, 1)) ** 0.7


def bell(note: int) -> Mono:
    """Return a small bell: inharmonic partials, most of them above 4 kHz."""
    t, pitch = clock(1.8), frequency(note)
    partials = ((1.0, 0.25, 2.2), (2.76, 0.8, 3.0), (5.40, 0.5, 4.5), (8.93, 0.25, 7.0))
    return np.sum([a * np.sin(2 * np.pi * pitch * f * t) * np.exp(-d * t) for f, a, d in partials], axis=0)


def hat(rng: np.random.Generator, decay: float) -> Mono:
    """Return a hat: noise above 6 kHz."""
    t = clock(0.25)
    spectrum = np.fft.rfft(rng.standard_normal(len(t)))
    hertz = np.fft.rfftfreq(len(t), 1.0 / RATE)
    noise = np.fft.irfft(spectrum * np.clip((hertz - 5000.0) / 3000.0, 0, 1), len(t))
    return noise * np.exp(-t / decay)


def lay(track: Stereo, sound: Mono, second: float, gain: float, side: float = 0.0) -> None:
    """Add a sound to a track; `side` is −1 left … 1 right."""
    start = round(second * RATE)
    stop = min(track.shape[1], start + len(sound))
    angle = 0.25 * np.pi * (1.0 + side)
    for channel, share in enumerate((np.cos(angle), np.sin(angle))):
        track[channel, start:stop] += gain * share * sound[: stop - start]


def room(track: Stereo, rng: np.random.Generator, seconds: float) -> Stereo:
    """Return a track in a room: folded with noise that dies away, other noise on each side."""
    t = clock(2.5 * seconds)
    size = 1 << (track.shape[1] + len(t)).bit_length()
    echo = rng.standard_normal((2, len(t))) * np.exp(-t / seconds * 2.5) * np.clip(t / 0.02, 0, 1)
    spectrum = np.fft.rfft(echo, size) * np.fft.rfft(track, size)
    wet: Stereo = np.fft.irfft(spectrum, size)[:, : track.shape[1]] / np.sqrt((echo**2).sum(axis=1))[:, None]
    return wet


def compose() -> Stereo:
    """Return the piece as stereo samples (2, N), −1 … 1; the same on every call."""
    rng = np.random.default_rng(1991)
    dry, far = np.zeros((2, round(SECONDS * RATE))), np.zeros((2, round(SECONDS * RATE)))
    for bar in range(BARS):
        chord, begin = CHORDS[bar % 4] if bar < BARS - 1 else CHORDS[0], 4 * BEAT * bar
        for detune, side in ((-0.06, -0.7), (0.06, 0.7)):
            lay(far, pad(tuple(n + 24 for n in chord), 4.4 * BEAT, detune), begin, 0.035, side)
        beats = (0.0, 1.0, 2.0, 3.0) if bar < BARS - 1 else (0.0,)
        for beat in beats:
            lay(dry, bass(chord[0]), begin + beat * BEAT, 0.5 if beat in (0.0, 2.0) else 0.34)
        if 1 <= bar < BARS - 1:
            for step, index in enumerate(PATTERN):
                octave = 24 if step % 4 != 3 else 36
                when = begin + 0.5 * step * BEAT
                lay(far, pluck(chord[index] + octave), when, 0.15, 0.5 * (-1) ** step)
                lay(dry, pluck(chord[index] + octave), when, 0.10, 0.5 * (-1) ** step)
        if 2 <= bar < BARS - 1:
            for step in range(8):
                lay(dry, hat(rng, 0.03 if step % 2 else 0.012), begin + (step / 2) * BEAT, 0.10, 0.2)
            for beat, index in ((0.0, 3), (1.5, 1), (3.0, 2)):
                lay(far, bell(chord[index] + 48), begin + beat * BEAT, 0.07, -0.4)
    mix = dry + 0.5 * far + 0.55 * room(far + 0.05 * dry, rng, 1.6)
    t = clock(SECONDS)
    mix *= np.clip((SECONDS - t) / 2.0, 0, 1)
    loud: Stereo = np.tanh(1.1 * mix / np.abs(mix).max()) / np.tanh(1.1) * 0.89
    return loud


def write(path: Path, samples: Stereo, bits_per_second: int = 48_000) -> None:
    """Write stereo samples (2, N) as Opus. Raises MachineError where the disk refuses."""
    import av

    with (
        atomic_write(path) as draft,
        av.open(str(draft), "w", format="ogg", container_options={"fflags": "+bitexact"}) as container,
    ):
        stream = container.add_stream("libopus", rate=RATE, layout="stereo")
        stream.bit_rate = bits_per_second
        for start in range(0, samples.shape[1], 960):
            block = np.ascontiguousarray(samples[:, start : start + 960].T.reshape(1, -1), dtype=np.float32)
            frame = av.AudioFrame.from_ndarray(block, format="flt", layout="stereo")
            frame.sample_rate, frame.pts, frame.time_base = RATE, start, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


if __name__ == "__main__":
    write(Path(sys.argv[1] if len(sys.argv) > 1 else "shots/pulse.opus"), compose())
