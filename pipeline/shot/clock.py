"""The clock of a shot: frames, frame rate and speed, and the times of keys in seconds from its start."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cached_property

from pipeline.errors import UsageError
from pipeline.flow.keyframes import elapsed
from pipeline.flow.parameters import Curve, Number
from pipeline.frames import FrameRange, FrameRate

_SECONDS = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*s\s*")

SECONDS_PATTERN = r"^\s*[+-]?(\d+\.?\d*|\.\d+)\s*s\s*$"
"""JSON Schema pattern of seconds in a shot file; plain numbers are frames."""

TIME_PATTERN = rf"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|{SECONDS_PATTERN}"
"""JSON Schema pattern of a key's time: frames or seconds, both as text since names of a mapping are text."""

FURTHEST = 10**12
"""Frames beyond this number count as infinite; the flow's time may reach as many seconds."""


MOST_CHECKED = 1000
"""First frames at which a changing speed is checked while a shot is read: each takes integrals."""


@dataclass(frozen=True)
class Clock:
    """Frames and their rate. The first frame of the shot is at 0 seconds.

    speed  rate of the flow's time; all keys but those of flows go by the time of the frames
    """

    frames: FrameRange
    rate: FrameRate
    speed: Number = 1.0

    def time(self, frame: float) -> float:
        """Return seconds from the start of the shot; frames may have fractions."""
        return self.rate.seconds(frame - self.frames.first)

    def flow_time(self, frame: float) -> float:
        """Return the flow's time at a frame, in seconds: the integral of the speed."""
        return elapsed(self.speed, self.time(frame))

    def step(self, frame: int) -> tuple[float, float]:
        """Return start and duration, in seconds of the flow, of the step that leads into `frame`."""
        return self.between(frame - 1, frame)

    def between(self, frame: float, other: float) -> tuple[float, float]:
        """Return start and duration, in seconds of the flow, of a step between frames, maybe backwards."""
        start = self.flow_time(frame)
        return start, self.flow_time(other) - start

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return self.time(self.frames.last)

    def seconds(self, key: object) -> float | None:
        """Return the time of a key of a shot file: numbers are frames, "0.5s" is seconds.

        None for anything else; frames beyond FURTHEST are infinite.
        """
        length = self.length(key)
        if isinstance(key, int | float) and length is not None and math.isfinite(length):
            return self.time(key)
        return length

    def length(self, value: object) -> float | None:
        """Return a duration of a shot file in seconds: numbers are frames, "0.5s" is seconds; else None."""
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            return self.rate.seconds(value) if abs(value) < FURTHEST else math.copysign(math.inf, value)
        match = _SECONDS.fullmatch(value) if isinstance(value, str) else None
        return float(match[1]) if match else None

    def speed_fault(self) -> str | None:
        """Return the message about a speed that fails before the last frame; None if it is good."""
        for frame in self._checked_frames:
            try:
                reached = self.flow_time(frame)
            except UsageError as error:
                return f"speed is not finite: {error}"
            if not abs(reached) <= FURTHEST:
                return (
                    f"speed takes the flow to {reached:.3g} s by frame {frame}; its time goes up to 1e12 s. "
                    "Lower it."
                )
        return None

    def holds(self, seconds: float) -> bool:
        """Tell whether a time lies within the shot."""
        return _is_within(seconds, self.duration)

    def flow_holds(self, seconds: float) -> bool:
        """Tell whether a time of the flow lies within the shot, at its speed or at a speed of 1."""
        is_checked = len(self.frames) <= MOST_CHECKED or not isinstance(self.speed, Curve)
        return _is_within(seconds, max(self.duration, self._furthest) if is_checked else math.inf)

    @cached_property
    def _furthest(self) -> float:
        """The latest time that the flow reaches."""
        return max(map(self.flow_time, self._checked_frames))

    @property
    def _checked_frames(self) -> tuple[int, ...]:
        numbers = self.frames.numbers
        return numbers[:MOST_CHECKED] if isinstance(self.speed, Curve) else (numbers[0], numbers[-1])


def parse_frames(text: str, rate: FrameRate | None = None) -> FrameRange:
    """Parse the frames of a shot, such as 1-96. Raises UsageError where they have gaps or no form.

    rate  by which the message says how many frames a duration has
    """
    if (
        rate
        and (match := _SECONDS.fullmatch(text))
        and 1 <= (count := round(float(match[1]) * rate.fps)) < FURTHEST
    ):
        raise UsageError(
            f"{text} is a duration, and frames is a range. At {rate} frames a second, write 1-{count}."
        )
    frames = FrameRange.parse(text, such_as="1-48")
    if frames.numbers != tuple(range(frames.first, frames.last + 1)):
        ends = [abs(int(number)) for number in re.findall(r"(?<![x:y\d])\d+", text)]
        raise UsageError(f"frames {text} skip or turn back; a shot plays all. Write {min(ends)}-{max(ends)}.")
    return frames


def parse_rate(value: object) -> FrameRate:
    """Parse a frame rate, 24 for None. Raises UsageError where it is none."""
    return FrameRate.of(24 if value is None else value)


def _is_within(seconds: float, duration: float) -> bool:
    slack = 1e-9
    return -slack <= seconds <= duration + slack and math.isfinite(seconds)
