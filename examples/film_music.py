"""The music of the films: quiet, build, burst, rest, in 88 seconds.

`python -m examples.film_music` writes shots/film_music.opus: 33 bars in D minor at 90 beats a minute, so that
a beat is 16 frames of 24 a second and a bar 64. A melody of bells over a drone (bars 1 to 8); a bass, strings
and hats join one by one, and a noise rises (9 to 18); all play, with drums (19 to 28); bells and drone end as
they began (29 to 33), so that a film that loops has music that does.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from examples.music import (
    BEAT,
    PATTERN,
    RATE,
    Mono,
    Stereo,
    bass,
    bell,
    clock,
    frequency,
    hat,
    lay,
    pad,
    pluck,
    room,
    write,
)

BAR = 4 * BEAT
QUIET, BUILD, BURST, REST, END = 0, 8, 18, 28, 33
"""The first bar of each part, and the number of bars."""

SECONDS = BAR * END

CALM = ((38, 45, 50, 53, 57), (34, 41, 50, 53, 57), (41, 48, 52, 57, 60), (36, 43, 50, 52, 55))
"""MIDI notes from the bass up: D minor, B♭ major 7, F major 7, C with a ninth; two bars each."""

DRIVE = ((38, 45, 50, 53, 57), (34, 41, 50, 53, 58), (31, 43, 50, 53, 58), (33, 45, 49, 52, 57))
"""D minor, B♭, G minor, A: a bar each, where all play."""

MELODY = ((0.0, 81), (1.5, 77), (3.0, 79), (4.5, 76), (6.0, 74))
"""Beats in two bars, and notes."""


def chord_of(bar: int) -> tuple[int, ...]:
    """Return the chord of a bar; the last two are those of the first."""
    if bar >= END - 2:
        return CALM[0]
    return DRIVE[(bar - BURST) % 4] if BURST <= bar < REST else CALM[bar // 2 % 4]


def drone(seconds: float) -> Mono:
    """Return a deep fifth that breathes."""
    t = clock(seconds)
    tone = np.sin(2 * np.pi * frequency(38) * t) + 0.5 * np.sin(2 * np.pi * frequency(45) * t + 1.0)
    return tone * (0.7 + 0.3 * np.sin(2 * np.pi * t / (4 * BAR))) * np.clip(t / 3.0, 0, 1) * fall(t, 4.0)


def fall(t: Mono, seconds: float) -> Mono:
    """Return a fade at the end of times."""
    return np.clip((t[-1] - t) / seconds, 0, 1)


def strings(note: int, seconds: float) -> Mono:
    """Return a bowed note: harmonics that swell and tremble, few of the high ones."""
    t, pitch = clock(seconds), frequency(note)
    trembling = 0.004 * np.sin(2 * np.pi * 5.1 * t) * np.clip(t / 0.6, 0, 1)
    parts = [np.sin(2 * np.pi * k * pitch * (t + trembling / pitch)) / k**1.6 for k in range(1, 8)]
    return np.sum(parts, axis=0) * np.clip(t / 0.25, 0, 1) * fall(t, 0.3)


def drum(high: float, low: float, decay: float) -> Mono:
    """Return a drum whose pitch drops from `high` to `low` hertz."""
    t = clock(5 * decay)
    phase = 2 * np.pi * (low * t + (high - low) * 0.025 * (1.0 - np.exp(-t / 0.025)))
    return np.sin(phase) * np.exp(-t / decay) * np.clip(t / 0.002, 0, 1) * fall(t, 0.02)


def noise(rng: np.random.Generator, seconds: float, low: float, high: float) -> Mono:
    """Return noise between two frequencies."""
    count = len(clock(seconds))
    hertz = np.fft.rfftfreq(count, 1.0 / RATE)
    band = np.clip((hertz - low) / low, 0, 1) * np.clip((2.0 * high - hertz) / high, 0, 1)
    sound: Mono = np.fft.irfft(np.fft.rfft(rng.standard_normal(count)) * band, count)
    return sound / np.abs(sound).max()


def riser(rng: np.random.Generator, seconds: float) -> Mono:
    """Return noise that rises in pitch and strength to its end."""
    t = clock(seconds)
    share = t / seconds
    low, high = noise(rng, seconds, 300.0, 900.0), noise(rng, seconds, 1500.0, 4500.0)
    return (low * (1 - share) + high * share) * share**2.5


def crash(rng: np.random.Generator, seconds: float) -> Mono:
    """Return a cymbal."""
    return noise(rng, seconds, 2500.0, 7000.0) * np.exp(-clock(seconds) / (0.3 * seconds))


def compose() -> Stereo:
    """Return the piece as stereo samples (2, N), −1 … 1; the same on every call."""
    rng = np.random.default_rng(1992)
    dry, far = np.zeros((2, round(SECONDS * RATE))), np.zeros((2, round(SECONDS * RATE)))
    for begin, end in ((QUIET, BURST), (REST, END)):
        lay(far, drone(BAR * (end - begin)), BAR * begin, 0.16)
    for bar in range(END):
        _harmony(far, bar)
        _melody(dry, far, bar)
        if BUILD <= bar < REST:
            _figures(dry, far, bar)
        if BUILD + 2 <= bar < REST:
            _drums(dry, far, bar, rng)
    lay(far, riser(rng, 4 * BAR), BAR * (BURST - 4), 0.20)
    for bar, seconds in ((BURST, 4.0), (BURST + 4, 3.0), (BURST + 8, 3.0), (REST, 6.0)):
        lay(far, crash(rng, seconds), BAR * bar, 0.16, 0.3)
        lay(dry, drum(90.0, 36.7, 0.8), BAR * bar, 0.7)
    mix = dry + 0.5 * far + 0.6 * room(far + 0.06 * dry, rng, 2.2)
    mix *= np.clip((SECONDS - clock(SECONDS)) / 2.5, 0, 1)
    loud: Stereo = 0.66 * np.tanh(1.9 * mix / np.abs(mix).max()) / np.tanh(1.9)
    return loud


def _harmony(far: Stereo, bar: int) -> None:
    """Add the chord of a bar: a pad, and in the burst strings."""
    chord, begin = chord_of(bar), BAR * bar
    for detune, side in ((-0.06, -0.7), (0.06, 0.7)):
        lay(far, pad(tuple(note + 12 for note in chord[1:]), 4.6 * BEAT, detune), begin, 0.035, side)
    if BUILD + 4 <= bar < REST:
        strength = 0.028 if bar < BURST else 0.05
        for index, side in ((2, -0.6), (3, 0.2), (4, 0.6)):
            lay(far, strings(chord[index] + 12, BAR * 1.02), begin, strength, side)


def _melody(dry: Stereo, far: Stereo, bar: int) -> None:
    """Add the bells: two bars of melody in every four, and a full one at the end of the quiet."""
    if bar % 2 or bar in (2, 12, 16):
        return
    for beat, note in MELODY[: 5 if bar in (4, 6, 28, 30) or BURST <= bar < REST else 3]:
        high = note + (12 if BURST <= bar < REST else 0)
        lay(far, bell(high - 12), BAR * bar + beat * BEAT, 0.13, -0.4 + 0.2 * beat)
        lay(dry, pluck(high - 12), BAR * bar + beat * BEAT, 0.07, -0.4 + 0.2 * beat)


def _figures(dry: Stereo, far: Stereo, bar: int) -> None:
    """Add the bass and the plucked strings."""
    chord, begin = chord_of(bar), BAR * bar
    burst = bar >= BURST
    strength = 0.5 if bar >= BUILD + 4 else 0.32
    for step in range(8 if burst or bar >= BUILD + 6 else 4):
        beat = step * (0.5 if burst or bar >= BUILD + 6 else 1.0)
        lay(
            dry,
            bass(chord[0] + (12 if step % 4 == 3 else 0)),
            begin + beat * BEAT,
            strength * (0.7 if step % 2 else 1.0),
        )
    if bar < BUILD + 2:
        return
    for step, index in enumerate(PATTERN * (2 if burst else 1)):
        when = begin + step * BEAT * (0.25 if burst else 0.5)
        note = chord[1 + index] + (24 if step % 4 == 3 else 12)
        side = 0.6 * (-1) ** step
        lay(far, pluck(note), when, 0.10, side)
        lay(dry, pluck(note), when, 0.07, side)


def _drums(dry: Stereo, far: Stereo, bar: int, rng: np.random.Generator) -> None:
    """Add hats, drums, and a roll that leads into the burst."""
    begin, burst = BAR * bar, bar >= BURST
    for step in range(8):
        lay(dry, hat(rng, 0.03 if step % 2 else 0.012), begin + 0.5 * step * BEAT, 0.06, 0.3)
    if burst:
        for beat in (0.0, 1.0, 2.0, 2.75, 3.0) if bar % 2 else (0.0, 1.0, 2.0, 3.0):
            lay(dry, drum(150.0, 54.0, 0.14), begin + beat * BEAT, 0.56)
        for beat in (1.0, 3.0):
            lay(far, noise(rng, 0.25, 900.0, 3500.0) * np.exp(-clock(0.25) / 0.06), begin + beat * BEAT, 0.22)
    elif bar == BURST - 1:
        for step in range(16):
            lay(
                far,
                drum(180.0 + 6 * step, 70.0 + 4 * step, 0.12),
                begin + 0.25 * step * BEAT,
                0.012 * (step + 4),
            )
    elif bar >= BUILD + 6:
        for beat in (0.0, 2.5):
            lay(far, drum(130.0, 60.0, 0.2), begin + beat * BEAT, 0.3)


if __name__ == "__main__":
    write(Path(sys.argv[1] if len(sys.argv) > 1 else "shots/film_music.opus"), compose(), 40_000)
