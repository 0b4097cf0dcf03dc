"""Timecode as editors count: hours, minutes, seconds and frames of a nominal rate; nothing is dropped."""

from __future__ import annotations

from fractions import Fraction
from math import ceil

MOST_COUNTED = 99
"""Frames a second that two digits can count; beyond, there is no timecode."""

FILM_BEGINS = 3600
"""Seconds of timecode at which films begin: what comes before them has room to."""


def timecode(frame: int, rate: Fraction) -> str:
    """`00:00:01:18` of frame 42 at 24 frames per second, where frame 0 is 00:00:00:00.

    24000/1001 counts 24 frames a second as all non-drop timecode does, so it runs behind the clock. It wraps
    after 24 hours, and frames before 0 lie at the end of the day. Empty for a rate that has no timecode.
    """
    counted = ceil(rate)
    if counted > MOST_COUNTED or (rate.denominator not in (1, 1001)):
        return ""
    seconds, frames = divmod(frame % (counted * 86400), counted)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}:{frames:02d}"
