"""Set lines of text with OpenImageIO, lay them over pages of display values, and burn them into pictures.

Burn-ins show shot, frame and timecode in small type along the upper and lower edge, on bands that darken the
picture softly, so they can be read on any picture. Words, and the letters of changing values, are set once: a
burn-in costs next to nothing per frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError, suggest
from flowsculpt.render.base.serialise import Triple

Floats = NDArray[np.float32]

BASELINE = 1.4  # distance from the upper edge of a line to its baseline, in font sizes

_FINE = 4
"""Letters are set this many times too large and scaled down, which places them to a quarter of a pixel."""


def lettering(text: str, font: str, size: int, spacing: float = 0.0) -> Floats:
    """Set one line of text; return its coverage (H, W), 0 … 1.

    font     a font that OpenImageIO ships or the system has
    size     of the font, in pixels
    spacing  added after each letter, in font sizes

    Raises BadInputError for an unknown font.
    """
    fine_size = size * _FINE
    offsets, width = _set_letters(text, font, size, spacing)
    page = oiio.ImageBuf(oiio.ImageSpec(width * _FINE, 2 * fine_size, 3, oiio.FLOAT))
    baseline = int(BASELINE * fine_size)
    for letter, offset in zip(text, offsets, strict=True):
        oiio.ImageBufAlgo.render_text(page, offset, baseline, letter, fine_size, font, [1.0, 1.0, 1.0])
    ink = np.asarray(page.get_pixels(oiio.FLOAT))[..., 0]
    rows, columns = ink.shape[0] // _FINE, ink.shape[1] // _FINE
    return np.asarray(ink.reshape(rows, _FINE, columns, _FINE).mean(axis=(1, 3)), dtype=np.float32)


def require_font(name: str) -> str:
    """Return the name of a font. Raises BadInputError where there is none of that name."""
    _ink_width("H", 12, name)
    return name


def _set_letters(text: str, font: str, size: int, spacing: float) -> tuple[list[int], int]:
    """Return where the letters of a line begin, in fine pixels, and the width of the line in pixels."""
    bearings = _ink_width("HH", size * _FINE, font)
    offsets, x = [], 0.0
    for letter in text:
        offsets.append(round(x))
        x += _ink_width(f"H{letter}H", size * _FINE, font) - bearings + spacing * size * _FINE
    return offsets, -(-max(1, round(x - spacing * size * _FINE)) // _FINE)


@lru_cache(maxsize=4096)
def set_line(text: str, font: str, size: int, spacing: float) -> Floats:
    """Set a line of text, or an empty one; each once."""
    return lettering(text, font, size, spacing) if text else np.zeros((1, 0), np.float32)


def overlay(page: NDArray[Any], cover: Floats, x: int, y: int, ink: float | Triple) -> None:
    """Lay a coverage (h, w) over a page (H, W, 3) with its upper left corner at x, y; clip it to the page.

    ink  in the page's values; pages of integers are rounded
    """
    cover = cover[max(0, -y) :, max(0, -x) :]
    place = page[max(0, y) :, max(0, x) :][: cover.shape[0], : cover.shape[1]]
    weight = cover[: place.shape[0], : place.shape[1], None]
    if page.dtype.kind == "f":
        place += (np.asarray(ink, dtype=np.float32) - place) * weight
    else:
        place[:] = np.rint(place * (1.0 - weight) + ink * weight)


@dataclass(frozen=True)
class Font:
    """A font at a size, which sets lines of text.

    name     of a font that OpenImageIO ships or the system has
    size     pixels
    spacing  added after each letter, in font sizes

    Methods raise BadInputError for an unknown font.
    """

    name: str
    size: int
    spacing: float = 0.0

    def line(self, text: str) -> Floats:
        """Return the coverage (h, w), 0 … 1, of one line of text; w is 0 for an empty text."""
        return set_line(text, self.name, self.size, self.spacing)

    def width(self, text: str) -> int:
        """Return the width of one line of text, pixels."""
        return _set_letters(text, self.name, self.size, self.spacing)[1] if text else 0

    def write(
        self,
        page: NDArray[Any],
        text: str,
        at: tuple[float, float],
        ink: float | Triple,
        from_right: bool = False,
    ) -> None:
        """Write a line on a page (H, W, 3); its baseline begins at `at`, or ends there if `from_right`.

        ink  in the page's values; pages of integers are rounded
        """
        cover = self.line(text)
        x = round(at[0]) - cover.shape[1] * from_right
        overlay(page, cover, x, round(at[1]) - round(BASELINE * self.size), ink)

    def fit(self, text: str, max_width: float) -> Font:
        """Return the font, or a smaller one in which the line fits into `max_width`."""
        width = self.width(text)
        return self if width <= max_width else replace(self, size=max(4, int(self.size * max_width / width)))

    def wrap(self, text: str, max_width: float, max_lines: int) -> list[str]:
        """Break a text into lines; what does not fit ends in dots."""
        lines: list[str] = []
        for word in text.split():
            longer = f"{lines[-1]} {word}" if lines else word
            if lines and self.width(longer) <= max_width:
                lines[-1] = longer
            else:
                lines.append(word)
        if len(lines) > max_lines:
            lines = [*lines[: max_lines - 1], f"{lines[max_lines - 1]} ..."]
        return [self.cut_short(words, max_width) for words in lines]

    def cut_short(self, text: str, max_width: float) -> str:
        """Return the line, or as much of its beginning as fits, with dots."""
        while text and (width := self.width(text)) > max_width:
            kept = text.removesuffix("...")
            kept = kept[: max(0, min(len(kept) - 1, int(len(kept) * max_width / width)))]
            text = f"{kept}..." if kept else ""
        return text


@lru_cache(maxsize=4096)
def _ink_width(text: str, size: int, font: str) -> int:
    box = oiio.ImageBufAlgo.text_size(text, size, font)
    if not box.defined:
        known = filter(None, oiio.get_string_attribute("font_list").split(";"))
        raise BadInputError(f"font {font!r} not found. {suggest(font, known)}")
    return int(box.xend - box.xbegin)


FIELDS = ("shot", "frame", "timecode", "key", "quality", "version")  # the fields that a burn-in can show

Strip = NDArray[np.float32]

_CORNERS = {  # fields by band and side; the first of a corner stands at the edge of the picture
    ("upper", "left"): ("quality",),
    ("upper", "right"): ("key",),
    ("lower", "left"): ("shot", "version"),
    ("lower", "right"): ("timecode", "frame"),
}
_BRIGHT, _QUIET = 0.96, 0.78
_INKS = {"shot": _BRIGHT, "timecode": _BRIGHT}
_FONT = "DroidSans"  # all its digits have one width, so numbers stand still while they count
_CHANGING = ("frame", "timecode", "key")
"""Fields that change with every frame: put together from letters that are set once."""

_SIZE, _MIN_SIZE = 0.0265, 9  # font size as a share of the picture's height, and its minimum in pixels
_WIDTH_SHARE = 0.0165  # font size as a share of the width, for upright pictures
_BAND, _DARKEST = 3.2, 0.66
"""Height of a band in font sizes, and the share of light that it takes at the picture's edge."""


@dataclass(frozen=True)
class BurnIn:
    """The fields to burn in: shot and version below on the left, frame and timecode below on the right,
    quality and key above.

    fields  some of FIELDS; a field without a value is left out

    Raises BadInputError for an unknown field.
    """

    fields: tuple[str, ...] = FIELDS

    def __post_init__(self) -> None:
        for field in self.fields:
            if field not in FIELDS:
                raise BadInputError(f"{field!r} cannot be burnt in. {suggest(field, FIELDS)}")

    @classmethod
    def parse(cls, text: str) -> BurnIn:
        """Read `shot,frame,timecode`; `all` means all fields. Raises BadInputError."""
        words = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
        return cls() if words in ((), ("all",)) else cls(words)

    def over(self, picture: NDArray[Any], values: Mapping[str, str | int]) -> NDArray[Any]:
        """Return a copy of a display picture (H, W, 3), uint8, uint16 or float 0 … 1, with `values` over it.

        A frame number is written as in file names: 0012. Raises BadInputError for another shape.
        """
        if picture.ndim != 3 or picture.shape[2] != 3:
            raise BadInputError(f"a burn-in goes over a picture (H, W, 3), not over {picture.shape}")
        height, width = picture.shape[:2]
        size = max(_MIN_SIZE, round(min(_SIZE * height, _WIDTH_SHARE * width)))
        done = picture.copy()
        for band in ("upper", "lower"):
            texts = {side: self._texts(band, side, values) for side in ("left", "right")}
            if any(texts.values()):
                strip = done[: round(_BAND * size)] if band == "upper" else done[-round(_BAND * size) :]
                _print(strip, size, band, texts["left"], texts["right"])
        return done

    def _texts(self, band: str, side: str, values: Mapping[str, str | int]) -> list[tuple[str, str]]:
        shown = [field for field in _CORNERS[band, side] if field in self.fields and field in values]
        number = values.get("frame")
        written = {**values, **({"frame": f"{number:04d}"} if isinstance(number, int) else {})}
        texts = [(field, str(written[field]).strip()) for field in shown]
        return [(field, text) for field, text in texts if text]


def _print(
    strip: NDArray[Any], size: int, band: str, left: list[tuple[str, str]], right: list[tuple[str, str]]
) -> None:
    """Darken the pixels (h, W, 3) of a band and write the texts of its left and right corner."""
    width, gap = strip.shape[1], round(0.9 * size)
    light = _band(size, band)[: len(strip)] if band == "upper" else _band(size, band)[-len(strip) :]
    top = 1.0 if strip.dtype.kind == "f" else float(np.iinfo(strip.dtype).max)
    made = strip * light[:, None, None]
    baseline = round(1.55 * size) if band == "upper" else len(strip) - round(0.85 * size)
    at = width - size
    for field, text in right:
        words = _set(field, text, size)
        at -= words.shape[1]
        overlay(made, words, at, baseline - round(BASELINE * size), _INKS.get(field, _QUIET) * top)
        at -= gap
    start, room, font = size, at - size, Font(_FONT, size)
    for field, text in left:
        words = font.line(font.cut_short(text, room))
        overlay(made, words, start, baseline - round(BASELINE * size), _INKS.get(field, _QUIET) * top)
        start, room = start + words.shape[1] + gap, room - words.shape[1] - gap
    strip[:] = made if strip.dtype.kind == "f" else np.rint(made)


def _set(field: str, text: str, size: int) -> Strip:
    font = Font(_FONT, size)
    if field not in _CHANGING:
        return font.line(text)
    letters = [font.line(letter) for letter in text]
    return np.concatenate(letters, axis=1) if letters else np.zeros((1, 0), np.float32)


@lru_cache(maxsize=16)
def _band(size: int, band: str) -> Strip:
    """Return the share of light that each row keeps: little along the edge, all where the band ends."""
    rows = round(_BAND * size)
    inward = (np.arange(rows, dtype=np.float32) + 0.5) / rows
    fade = np.clip((1.0 - inward) / 0.6, 0.0, 1.0)
    left = 1.0 - _DARKEST * fade * fade * (3.0 - 2.0 * fade)
    return np.asarray(left if band == "upper" else left[::-1], dtype=np.float32)
