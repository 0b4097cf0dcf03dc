"""Sounds for tests, as WAV files."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np

from flowsculpt.pipeline.arrays import Floats

RATE = 48_000

FORMATS = {"pcm_s16le": ("s16", 2**15 - 1), "pcm_s24le": ("s32", 2**31 - 256), "pcm_f32le": ("flt", 1.0)}
"""FFmpeg's format of samples, and full scale, by codec."""


def times(seconds: float, rate: int = RATE) -> Floats:
    """Return the times of samples."""
    return np.arange(round(seconds * rate)) / rate


def sine(hertz: float, seconds: float, amplitude: float = 0.5, rate: int = RATE) -> Floats:
    """Return a sine wave (N,)."""
    return amplitude * np.sin(2.0 * np.pi * hertz * times(seconds, rate))


def write_sound(
    path: Path, samples: Floats, rate: int = RATE, layout: str = "mono", codec: str = "pcm_s24le"
) -> Path:
    """Write samples (N,), or (channels, N) in FFmpeg's layout, and return the path."""
    form, scale = FORMATS[codec]
    kind = {"s16": np.int16, "s32": np.int32, "flt": np.float32}[form]
    rows = (np.atleast_2d(samples).T * scale).astype(kind)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate, layout=layout)
        frame = av.AudioFrame.from_ndarray(rows.reshape(1, -1), format=form, layout=layout)
        frame.sample_rate = rate
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path
