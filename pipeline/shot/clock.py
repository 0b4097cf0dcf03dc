"""When things happen: the keys of a shot file, as seconds from its start."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from pipeline.frames import FrameRange, FrameRate

_SECONDS = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*s\s*")


@dataclass(frozen=True)
class Clock:
    """Frames and their rate. The first frame of the shot is at 0 seconds."""

    frames: FrameRange
    rate: FrameRate

    def time(self, frame: int) -> float:
        """Seconds from the start of the shot."""
        return self.rate.seconds(frame - self.frames.first)

    def step(self, frame: int) -> tuple[float, float]:
        """When the step that leads into `frame` starts, and how long it lasts, in seconds."""
        start = self.time(frame - 1)
        return start, self.time(frame) - start

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return self.time(self.frames.last)

    def seconds(self, key: object) -> float | None:
        """A key of a shot file: whole numbers are frames, "0.5s" is seconds; None for anything else.

        What is too far away for a number is at infinity, and so in no shot.
        """
        if isinstance(key, int) and not isinstance(key, bool):
            far = math.inf if key > 0 else -math.inf
            return self.time(key) if abs(key) < 10**12 else far
        match = _SECONDS.fullmatch(key) if isinstance(key, str) else None
        return float(match[1]) if match else None

    def holds(self, seconds: float) -> bool:
        """Whether a time lies within the shot."""
        slack = 1e-9
        return -slack <= seconds <= self.duration + slack and math.isfinite(seconds)
