"""Set lines of text with OpenImageIO, and lay them over pages of display values."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from render.base.render_errors import BadInputError
from render.base.serialise import Triple

Floats = NDArray[np.float32]

BASELINE = 1.4
"""Distance from the upper edge of a line to its baseline, in font sizes."""

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
    bearings = _ink_width("HH", fine_size, font)
    offsets, x = [], 0.0
    for letter in text:
        offsets.append(round(x))
        x += _ink_width(f"H{letter}H", fine_size, font) - bearings + spacing * fine_size
    width = max(1, round(x - spacing * fine_size))
    page = oiio.ImageBuf(oiio.ImageSpec(-(-width // _FINE) * _FINE, 2 * fine_size, 3, oiio.FLOAT))
    baseline = int(BASELINE * fine_size)
    for letter, offset in zip(text, offsets, strict=True):
        oiio.ImageBufAlgo.render_text(page, offset, baseline, letter, fine_size, font, [1.0, 1.0, 1.0])
    ink = np.asarray(page.get_pixels(oiio.FLOAT))[..., 0]
    rows, columns = ink.shape[0] // _FINE, ink.shape[1] // _FINE
    return np.asarray(ink.reshape(rows, _FINE, columns, _FINE).mean(axis=(1, 3)), dtype=np.float32)


@lru_cache(maxsize=4096)
def line(text: str, font: str, size: int, spacing: float = 0.0) -> Floats:
    """Return the coverage (h, w) of one line of text; w is 0 for an empty text."""
    if not text:
        return np.zeros((1, 0), np.float32)
    return lettering(text, font, size, spacing)


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


def write(
    page: NDArray[Any],
    text: str,
    font: str,
    size: int,
    at: tuple[float, float],
    ink: float | Triple,
    spacing: float = 0.0,
    from_right: bool = False,
) -> None:
    """Write a line whose baseline begins at `at`, or ends there if `from_right`."""
    cover = line(text, font, size, spacing)
    x = round(at[0]) - cover.shape[1] * from_right
    overlay(page, cover, x, round(at[1]) - round(BASELINE * size), ink)


def fit_size(text: str, font: str, size: int, max_width: float, spacing: float = 0.0) -> int:
    """Return the size, or a smaller one at which the line fits into `max_width`."""
    width = line(text, font, size, spacing).shape[1]
    return size if width <= max_width else max(4, int(size * max_width / width))


def wrap(
    text: str, font: str, size: int, max_width: float, max_lines: int, spacing: float = 0.0
) -> list[str]:
    """Break a text into lines; what does not fit ends in dots."""
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and line(longer, font, size, spacing).shape[1] <= max_width:
            lines[-1] = longer
        else:
            lines.append(word)
    if len(lines) > max_lines:
        lines = [*lines[: max_lines - 1], f"{lines[max_lines - 1]} ..."]
    return [cut_short(words, font, size, max_width, spacing) for words in lines]


def cut_short(text: str, font: str, size: int, max_width: float, spacing: float = 0.0) -> str:
    """Return the line, or as much of its beginning as fits, with dots."""
    while text and (width := line(text, font, size, spacing).shape[1]) > max_width:
        kept = text.removesuffix("...")
        kept = kept[: max(0, min(len(kept) - 1, int(len(kept) * max_width / width)))]
        text = f"{kept}..." if kept else ""
    return text


def _ink_width(text: str, size: int, font: str) -> int:
    box = oiio.ImageBufAlgo.text_size(text, size, font)
    if not box.defined:
        raise BadInputError(f"font {font!r} not found; try DroidSans or DroidSerif")
    return int(box.xend - box.xbegin)
