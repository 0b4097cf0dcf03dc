"""Non-drop timecode: hours, minutes, seconds and frames of the nominal rate."""

from __future__ import annotations

from fractions import Fraction
from math import ceil

MAX_RATE = 99
"""The highest nominal rate: timecode has two digits for frames."""

FILM_START = 3600
"""The timecode of a film's first frame, in seconds: 01:00:00:00 leaves room for leaders."""


def timecode(frame: int, rate: Fraction) -> str:
    """Return the timecode of a frame: `00:00:01:18` for frame 42 at 24 frames per second.

    Frame 0 is 00:00:00:00. 24000/1001 counts 24 frames per second, as all non-drop timecode does, so it runs
    behind the clock. It wraps after 24 hours; frames before 0 lie at the end of the day. A rate that has no
    timecode gives an empty string.
    """
    nominal = ceil(rate)
    if nominal > MAX_RATE or rate.denominator not in (1, 1001):
        return ""
    seconds, frames = divmod(frame % (nominal * 86400), nominal)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}:{frames:02d}"
