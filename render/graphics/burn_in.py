"""Burn-ins: which frame of which shot a picture is, in small type along its upper and lower edge.

The type stands on bands that darken the picture softly, so it can be read on snow and on night alike. Words
are set once and letters of numbers too, so a burn-in costs next to nothing a frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError, suggestion
from render.graphics.typesetting import BASELINE, cut_short, lay, line

FIELDS = ("shot", "frame", "timecode", "key", "quality", "version")
"""What a burn-in can tell."""

Strip = NDArray[np.float32]

_CORNERS = {  # fields by band and side; the first of a corner stands at the edge of the picture
    ("upper", "left"): ("quality",),
    ("upper", "right"): ("key",),
    ("lower", "left"): ("shot", "version"),
    ("lower", "right"): ("timecode", "frame"),
}
_BRIGHT, _QUIET = 0.96, 0.78
_INKS = {"shot": _BRIGHT, "timecode": _BRIGHT}
_FONT = "DroidSans"
"""Its digits are all as wide, so numbers stand still while they count."""
_CHANGING = ("frame", "timecode", "key")
"""Fields of another value in every frame: put together of letters that were set before."""

_SIZE, _SMALLEST = 0.0265, 9
"""The size of type, as a share of the picture's height, and in pixels."""
_WIDEST = 0.0165
"""The same as a share of its width, for pictures that are upright."""
_BAND, _DARKEST = 3.2, 0.66
"""How high a band is, in sizes of its type, and how much light it takes away along the edge."""


@dataclass(frozen=True)
class BurnIn:
    """Puts facts about a picture over it: shot and version below on the left, frame and timecode below on
    the right, quality and key above.

    fields  which of FIELDS are shown; a field without a value is left out

    Raises BadInputError for a field that there is none of.
    """

    fields: tuple[str, ...] = FIELDS

    def __post_init__(self) -> None:
        for field in self.fields:
            if field not in FIELDS:
                raise BadInputError(f"{field!r} is nothing to burn in. {suggestion(field, FIELDS)}")

    @classmethod
    def parse(cls, text: str) -> BurnIn:
        """`shot,frame,timecode`; `all` is everything. Raises BadInputError."""
        words = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
        return cls() if words in ((), ("all",)) else cls(words)

    def over(self, picture: NDArray[Any], values: Mapping[str, str | int]) -> NDArray[Any]:
        """A copy of a display picture (H, W, 3), uint8, uint16 or float 0 … 1, with `values` over it.

        A frame that is a number is written as in file names: 0012. Raises BadInputError for another shape.
        """
        if picture.ndim != 3 or picture.shape[2] != 3:
            raise BadInputError(f"a burn-in goes over a picture (H, W, 3), not over {picture.shape}")
        height, width = picture.shape[:2]
        size = max(_SMALLEST, round(min(_SIZE * height, _WIDEST * width)))
        done = picture.copy()
        for band in ("upper", "lower"):
            told = {side: self._told(band, side, values) for side in ("left", "right")}
            if any(told.values()):
                strip = done[: round(_BAND * size)] if band == "upper" else done[-round(_BAND * size) :]
                _print(strip, size, band, told["left"], told["right"])
        return done

    def _told(self, band: str, side: str, values: Mapping[str, str | int]) -> list[tuple[str, str]]:
        shown = [field for field in _CORNERS[band, side] if field in self.fields and field in values]
        written = [(field, _written(field, values[field])) for field in shown]
        return [(field, text) for field, text in written if text]


def _written(field: str, value: str | int) -> str:
    return f"{value:04d}" if field == "frame" and isinstance(value, int) else str(value).strip()


def _print(
    strip: NDArray[Any], size: int, band: str, left: list[tuple[str, str]], right: list[tuple[str, str]]
) -> None:
    """Darken the pixels (h, W, 3) of a band, and set its type on them."""
    width, gap = strip.shape[1], round(0.9 * size)
    light = _band(size, band)[: len(strip)] if band == "upper" else _band(size, band)[-len(strip) :]
    top = 1.0 if strip.dtype.kind == "f" else float(np.iinfo(strip.dtype).max)
    made = strip * light[:, None, None]
    baseline = round(1.55 * size) if band == "upper" else len(strip) - round(0.85 * size)
    at = width - size
    for field, text in right:
        words = _line(field, text, size)
        at -= words.shape[1]
        lay(made, words, at, baseline - round(BASELINE * size), _INKS.get(field, _QUIET) * top)
        at -= gap
    start, room = size, at - size
    for field, text in left:
        words = line(cut_short(text, _FONT, size, room), _FONT, size)
        lay(made, words, start, baseline - round(BASELINE * size), _INKS.get(field, _QUIET) * top)
        start, room = start + words.shape[1] + gap, room - words.shape[1] - gap
    strip[:] = made if strip.dtype.kind == "f" else np.rint(made)


def _line(field: str, text: str, size: int) -> Strip:
    if field not in _CHANGING:
        return line(text, _FONT, size)
    letters = [line(letter, _FONT, size) for letter in text]
    return np.concatenate(letters, axis=1) if letters else np.zeros((1, 0), np.float32)


@lru_cache(maxsize=16)
def _band(size: int, band: str) -> Strip:
    """How much light each row of a band leaves: little along the edge, all where the band ends."""
    rows = round(_BAND * size)
    inward = (np.arange(rows, dtype=np.float32) + 0.5) / rows
    fade = np.clip((1.0 - inward) / 0.6, 0.0, 1.0)
    left = 1.0 - _DARKEST * fade * fade * (3.0 - 2.0 * fade)
    return np.asarray(left if band == "upper" else left[::-1], dtype=np.float32)
