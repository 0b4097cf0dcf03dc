"""Frames in words: those that something is to be done about."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.errors import UsageError, suggestion
from pipeline.frames import FrameRange
from pipeline.production.planning.frame_states import FrameStates

WORDS = ("all", "missing", "stale", "failed")


def is_in_words(text: str) -> bool:
    """Whether frames are named by what is to be done about them: `failed`, `missing,stale`."""
    return any(part.strip().isalpha() for part in text.split(","))


def selected(text: str, whole: FrameRange, states: Callable[[], FrameStates]) -> FrameRange:
    """The frames of a shot that are meant, in its order.

    Raises UsageError for a word that is none, and for words beside numbers.
    """
    words = [part.strip() for part in text.split(",")]
    for word in words:
        if word not in WORDS:
            if not word.isalpha():
                raise UsageError(
                    f"{text!r} is not a frame range; write one as 1-48x2, or words alone: failed,stale"
                )
            raise UsageError(f"{word!r} is not a frame range or a word. {suggestion(word, WORDS)}")
    if "all" in words:
        return whole
    known = states()
    wanted = {number for word in words for number in getattr(known, word)}
    return FrameRange.of(n for n in whole if n in wanted)
