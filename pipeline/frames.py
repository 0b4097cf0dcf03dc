"""Frame ranges as artists write them, and frame rates. Frames are integers, time is seconds."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from flowsculpt.pipeline.errors import UsageError, quote, shorten, suggest

MOST_FRAMES = 100_000
"""Frames in one range: over an hour at 24 frames per second."""

MOST_CHARACTERS = 4000
"""Length of a range's text; its grammar takes long on more."""

SLOWEST, FASTEST = Fraction(1, 10), Fraction(1000)
"""Frames per second."""


WORDS = ("all", "missing", "stale", "failed")
"""States of frames by which they are asked for."""


class FrameSelection:
    """Frames that a user asks for: a `FrameRange`, or `FrameWords`."""

    @staticmethod
    def of_text(text: str) -> FrameRange | FrameWords:
        """Return the range of a text, or the words where it holds some: `failed`, or `missing,stale`.

        Raises UsageError for an unknown word, for words mixed with numbers, and as `FrameRange.parse`.
        """
        words = tuple(part.strip() for part in text.split(","))
        if not any(word.isalpha() for word in words):
            return FrameRange.parse(text)
        for word in words:
            if not word.isalpha():
                remedy = "write one as 1-48x2, or words alone: failed,stale"
                raise UsageError(f"{text!r} is not a frame range; {remedy}")
            if word not in WORDS:
                raise UsageError(f"{word!r} is not a frame range or a word. {suggest(word, WORDS)}")
        return FrameWords(words)


@dataclass(frozen=True)
class FrameWords(FrameSelection):
    """Frames by their states, some of WORDS."""

    words: tuple[str, ...]

    def __str__(self) -> str:
        """Return the words as an option has them: `missing,stale`."""
        return ",".join(self.words)


class FrameRange(tuple[int, ...], FrameSelection):
    """An ordered set of frame numbers: ``FrameRange.parse("1-48x2,60")``.

    The syntax is fileseq's: ``1-10`` every frame, ``1-10x2`` every second, ``1-10:5`` coarse first,
    ``1-10y3`` all but every third; parts are joined by commas.
    """

    @classmethod
    def parse(cls, text: str, such_as: str = "12, 1-48, 1-48x2 or 1-24,30,40-48") -> FrameRange:
        """Return the range. Raises UsageError, with the text, for no range, no whole frame, or too many.

        such_as  ranges that the message proposes where the text is none and means none that is known
        """
        if len(text) > MOST_CHARACTERS or _reach(text) > MOST_FRAMES:
            raise UsageError(f"{quote(text)} reaches over more than {MOST_FRAMES} frames; split it")
        if plain := _PLAIN.fullmatch(text):
            first, last = map(int, plain.groups())
            return cls(tuple(range(first, last + 1) if first <= last else range(first, last - 1, -1)))
        import fileseq  # a grammar, which takes a moment to import, and most processes read no other range

        try:
            numbers = tuple(fileseq.FrameSet(text))
        except (fileseq.exceptions.FileSeqException, ValueError):
            remedy = likely_range(text) or f"one as {such_as}"
            raise UsageError(f"{quote(text)} is not a frame range; write {remedy}") from None
        if not numbers or any(not isinstance(n, int) for n in numbers):
            raise UsageError(f"{quote(text)} contains no whole frame; write a range as 1-48 or 1-48x2")
        return cls(numbers)

    @classmethod
    def of(cls, numbers: Iterable[int]) -> FrameRange:
        """Return the range of these frames, in this order."""
        return cls(numbers)

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers alone."""
        return tuple(self)

    @cached_property
    def first(self) -> int:
        return min(self)

    @cached_property
    def last(self) -> int:
        return max(self)

    def outside(self, other: FrameRange) -> FrameRange:
        """Return the frames that `other` does not hold, in this order."""
        theirs = set(other)
        return FrameRange(n for n in self if n not in theirs)

    def __str__(self) -> str:
        """Return the shortest text in ascending order: `1-48x2`."""
        import fileseq

        return str(fileseq.framesToFrameRange(sorted(self), sort=True)) if self else ""


@dataclass(frozen=True)
class FrameRate:
    """Frames per second, exact: 24 or 24000/1001."""

    fps: Fraction

    @classmethod
    def of(cls, value: object) -> FrameRate:
        """Return the rate for 24, 29.97 (read as 30000/1001) or "24000/1001".

        Raises UsageError for anything else, and for rates outside SLOWEST to FASTEST.
        """
        try:
            if not _RATE.fullmatch(str(value)):
                raise ValueError
            fps = Fraction(str(value))
        except (ValueError, ZeroDivisionError):
            number = re.fullmatch(r"\s*(\d+)(?:[.,](\d+))?\s*[A-Za-z/]*", str(value))
            remedy = ".".join(filter(None, number.groups())) if number else "24, 23.976 or 24000/1001"
            raise UsageError(f"{quote(value)} is not a frame rate; write {remedy}") from None
        if not SLOWEST <= fps <= FASTEST:
            raise UsageError(
                f"frame rate {shorten(value)} is not from {float(SLOWEST):g} to {FASTEST}, in frames per "
                "second; 24 is usual"
            )
        return cls(_NTSC.get(fps, fps))

    def seconds(self, frames: float) -> float:
        """Return the duration of that many frames, as exactly as a float can hold it."""
        numerator, denominator = frames.as_integer_ratio()
        return numerator * self.fps.denominator / (denominator * self.fps.numerator)

    def timecode(self, frame: int) -> str:
        """Return the timecode of a frame, such as 00:00:01:18; empty where the rate has none."""
        from flowsculpt.render.movie.codecs import timecode

        return timecode(frame, self.fps)

    def __str__(self) -> str:
        return str(self.fps)


def likely_range(text: str) -> str | None:
    """Return the range that other notations mean, such as 1..48, 1:48:2 or 1 to 48; None for others."""
    match = _OTHER_NOTATIONS.fullmatch(text)
    if not match:
        return None
    first, last, step = match.groups()
    if step and not int(step):
        return None
    return f"{first}-{last}x{step}" if step else f"{first}-{last}"


def _reach(text: str) -> int:
    """Return the number of frames between the ends of a range's parts; too many for absurd numbers."""
    if any(len(digits.lstrip("0")) > 9 for digits in re.findall(r"\d+", text)):
        return MOST_FRAMES + 1
    return sum(abs(int(last) - int(first)) + 1 for first, last in re.findall(r"(-?\d+)-(-?\d+)", text))


_PLAIN = re.compile(r"([0-9]+)-([0-9]+)")
"""A range of every frame, as most shots and edits have it."""

_OTHER_NOTATIONS = re.compile(
    r"\s*\[?\s*(\d+)\s*(?:\.{2,3}|[-–—:,~>_ ]|->|to|until|through)\s*(\d+)\s*\]?"
    r"(?:\s*(?:[:x/@,%]|step|by)\s*(\d+))?\s*"
)
"""Two numbers and perhaps a step, as Python, Houdini, Blender and words have them."""

_RATE = re.compile(r"\s*[+-]?\d{1,20}(\.\d{0,20}([eE][+-]?\d{1,3})?|[eE][+-]?\d{1,3}|/\d{1,20})?\s*")
"""Numbers short enough to be computed exactly."""

_NTSC = {
    Fraction(text): Fraction(nominal * 1000, 1001)
    for text, nominal in (("23.976", 24), ("23.98", 24), ("29.97", 30), ("47.952", 48), ("59.94", 60))
}
