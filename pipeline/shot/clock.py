"""When things happen: the keys of a shot file, as seconds from its start."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from pipeline.errors import UsageError
from pipeline.flow.keyframes import Number
from pipeline.flow.retiming import elapsed
from pipeline.frames import FrameRange, FrameRate

_SECONDS = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*s\s*")

A_LENGTH = r"^\s*[+-]?(\d+\.?\d*|\.\d+)\s*s\s*$"
"""What is seconds in a shot file, for JSON Schemas; numbers are frames."""

A_TIME = rf"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|{A_LENGTH}"
"""Frames or seconds, where numbers are written too as text: the names of a mapping."""

FAR = 10**12
"""Frames from here on are at infinity, and so in no shot; and seconds of the flow."""


@dataclass(frozen=True)
class Clock:
    """Frames and their rate. The first frame of the shot is at 0 seconds.

    speed  at which time runs for the flow; all keys but those of the flow go by the time of the frames
    """

    frames: FrameRange
    rate: FrameRate
    speed: Number = 1.0

    def time(self, frame: float) -> float:
        """Seconds from the start of the shot; frames may have fractions."""
        return self.rate.seconds(frame - self.frames.first)

    def flow_time(self, frame: float) -> float:
        """Seconds that have passed for the flow by a frame: the integral of the speed."""
        return elapsed(self.speed, self.time(frame))

    def step(self, frame: int) -> tuple[float, float]:
        """When the step that leads into `frame` starts for the flow, and how long it lasts, in seconds."""
        return self.between(frame - 1, frame)

    def between(self, frame: float, other: float) -> tuple[float, float]:
        """The step of the flow from one moment to another, which may lie before it: its start and length."""
        start = self.flow_time(frame)
        return start, self.flow_time(other) - start

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return self.time(self.frames.last)

    def seconds(self, key: object) -> float | None:
        """A key of a shot file: numbers are frames, "0.5s" is seconds; None for anything else.

        What is too far away for a number is at infinity.
        """
        length = self.length(key)
        numbered = isinstance(key, int | float) and length is not None and math.isfinite(length)
        return self.time(key) if numbered else length  # type: ignore[arg-type]  # a number, as it says

    def length(self, value: object) -> float | None:
        """How long something of a shot file lasts, in seconds: numbers are frames, "0.5s" is seconds."""
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            return self.rate.seconds(value) if abs(value) < FAR else math.copysign(math.inf, value)
        match = _SECONDS.fullmatch(value) if isinstance(value, str) else None
        return float(match[1]) if match else None

    def speed_fault(self) -> str | None:
        """What is wrong with the speed on the way to the last frame; None if nothing."""
        for frame in range(self.frames.first + 1, self.frames.last + 1):
            try:
                reached = self.flow_time(frame)
            except UsageError as error:
                return f"speed has a value that is none: {error}"
            if not abs(reached) <= FAR:
                return (
                    f"speed takes the flow to {reached:.3g} s by frame {frame}; its time goes up to 1e12 s. "
                    "Lower it."
                )
        return None

    def holds(self, seconds: float) -> bool:
        """Whether a time lies within the shot."""
        return _within(seconds, self.duration)

    def flow_holds(self, seconds: float) -> bool:
        """Whether a time of the flow lies within the shot, or would at a speed of 1."""
        fastest = max(self.flow_time(frame) for frame in range(self.frames.first, self.frames.last + 1))
        return _within(seconds, max(self.duration, fastest))


def _within(seconds: float, duration: float) -> bool:
    slack = 1e-9
    return -slack <= seconds <= duration + slack and math.isfinite(seconds)
