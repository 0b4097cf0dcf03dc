"""Times and parts of a timeline that is imported: whole frames, or refused."""

from __future__ import annotations

from typing import Any

from flowsculpt import UsageError
from flowsculpt.api import shorten
from flowsculpt.api.frames import FrameRate

CARD = "flowsculpt card"
"""The kind of generators that are cards in our timelines."""

_MOST_FRAMES, _LONGEST_CLIP = 10_000_000, 1_000_000  # a day of timecode has 5,184,000 at 60 a second

_NEAR, _SAME_RATE = 0.03, 1e-4
"""Frames by which a time may miss a frame, as milliseconds do, and the part by which rates may differ."""


def frames_in(time: Any, rate: FrameRate) -> int:
    """Return a time as frames. Raises UsageError where it lies between two frames, or is not a time."""
    is_counted = _is_same(time.rate, rate)
    frames = float((time if is_counted else time.rescaled_to(float(rate.fps))).value)
    if not (time.rate > 0 and abs(frames) < _MOST_FRAMES):
        fact = f"its time {time.value:g} at {time.rate:g} a second"
        raise UsageError(f"{fact} is out of range; export it again")
    if abs(frames - round(frames)) > _NEAR:
        fact = f"it begins or ends at frame {frames:.6g} of {rate} a second"
        raise UsageError(f"{fact}, between two; move it to a frame")
    return round(frames)


def available_range(clip: Any) -> Any:
    """Return the range of time that the media of a clip has; None if it does not say."""
    return None if clip.media_reference is None else clip.media_reference.available_range


def span_of(clip: Any, rate: FrameRate) -> tuple[int, int]:
    """Return the first frame of a clip in its media's time, and its length. Raises UsageError."""
    if clip.source_range is None and available_range(clip) is None:
        raise UsageError("it has no source_range, and its media no available_range; export it with one")
    span = clip.trimmed_range()
    count = frames_in(span.duration, rate)
    if not 1 <= count <= _LONGEST_CLIP:
        raise UsageError(f"it shows {count} frames; a clip has from 1 to {_LONGEST_CLIP}")
    return frames_in(span.start_time, rate), count


def media_offset(clip: Any, rate: FrameRate) -> int | None:
    """Return the frames of its media before a clip; None if the media does not say where it begins."""
    available = available_range(clip)
    if available is None:
        return None
    if 1 < available.duration.rate < 1000:  # others count seconds, or samples
        require_rate(available.duration.rate, rate)
    return frames_in(clip.trimmed_range().start_time - available.start_time, rate)


def require_rate(media: float, rate: FrameRate) -> None:
    """Raise UsageError for media whose rate is not that of the film."""
    if not _is_same(media, rate):
        raise UsageError(f"its media has {media:g} pictures a second, and the film {rate}; conform it")


def _is_same(media: float, rate: FrameRate) -> bool:
    return abs(media / float(rate.fps) - 1.0) < _SAME_RATE


def is_on(part: Any) -> bool:
    """Tell whether a part of a timeline is enabled, as are all that it is in."""
    return part is None or (part.enabled and is_on(part.parent()))


def fault_of(whole: Any) -> str:
    """Return why an edit cannot show a track or a stack as it is; empty if it can."""
    name = f"track {shorten(whole.name)}" if whole.name else "its track"
    if any(effect.enabled for effect in whole.effects):
        return f"{name} has an effect; an edit shows frames as they are"
    if whole.source_range not in (None, whole.available_range()):
        return f"{name} is trimmed by its source_range; trim its clips"
    return ""
