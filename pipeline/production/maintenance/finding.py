"""A finding about the scene of a shot, and the frames at which rules look at it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pipeline.shot import Shot

Where = tuple[Any, ...]

SAMPLED_FRAMES = 8
"""Frames at which cameras and flows are looked at."""


class Finding(NamedTuple):
    """Something that is wrong with a scene, or that should be known.

    where     the path of the setting in the shot file
    text      fact, rule and remedy
    is_error  True if a frame would fail
    """

    where: Where
    text: str
    is_error: bool = False


def sampled_frames(shot: Shot) -> list[int]:
    """Return up to SAMPLED_FRAMES frames, the first and the last among them."""
    frames = list(shot.frames)
    picks = np.linspace(0, len(frames) - 1, min(SAMPLED_FRAMES, len(frames))).round().astype(int)
    return [frames[k] for k in picks]
