"""The stream of sound of a file being written. Knows av."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from render.movie.codecs import Encode
from render.movie.sound import RATE, Samples

_SAMPLES = {"aac": "fltp", "pcm_s24le": "s32"}
"""How encoders of sound take their samples."""


@dataclass(eq=False)
class Track:
    """The stream of sound of a file being written."""

    container: Any
    stream: Any
    samples: Iterator[Samples]
    kind: str
    written: int = 0

    @classmethod
    def begun(cls, container: Any, encode: Encode, samples: Iterator[Samples]) -> Track | None:
        if encode.sound is None:
            return None
        stream = container.add_stream(encode.sound, rate=RATE, layout="stereo")
        if encode.sound == "aac":
            stream.bit_rate = 320_000
        return cls(container, stream, samples, _SAMPLES[encode.sound])

    def write_until(self, seconds: Fraction) -> None:
        """Hand on what is heard up to there: pictures and sound go side by side into a file."""
        while self.written < seconds * RATE and (block := next(self.samples, None)) is not None:
            self._write(block)

    def end(self) -> None:
        for packet in self.stream.encode(None):
            self.container.mux(packet)

    def _write(self, block: Samples) -> None:
        """Samples (2, N), −1 … 1."""
        frame = av.AudioFrame.from_ndarray(_sampled(block, self.kind), format=self.kind, layout="stereo")
        frame.sample_rate, frame.pts, frame.time_base = RATE, self.written, Fraction(1, RATE)
        self.written += block.shape[1]
        for packet in self.stream.encode(frame):
            self.container.mux(packet)


def _sampled(block: Samples, kind: str) -> NDArray[Any]:
    if kind == "fltp":
        return np.ascontiguousarray(block)
    steps = np.rint(np.clip(block.T.astype(np.float64), -1.0, 1.0) * (2**23 - 1)).astype(np.int32) << 8
    return np.ascontiguousarray(steps).reshape(1, -1)
