"""Lines of type on pages of display values: set once, laid wherever they are needed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.post.image import lettering

Floats = NDArray[np.float32]

BASELINE = 1.4
"""Where letters stand in a line, in font sizes below its upper edge."""


@lru_cache(maxsize=1024)
def line(text: str, font: str, size: int, spacing: float = 0.0) -> Floats:
    """Coverage (h, w) of one line of text; nothing wide where there is no text."""
    if not text:
        return np.zeros((1, 0), np.float32)
    return lettering(text, font, size, spacing)


def lay(page: Floats, cover: Floats, x: int, y: int, ink: float | Triple) -> None:
    """Lay a coverage (h, w) over a page (H, W, 3), its left upper corner there; what is outside is lost."""
    cover = cover[max(0, -y) :, max(0, -x) :]
    place = page[max(0, y) :, max(0, x) :][: cover.shape[0], : cover.shape[1]]
    strength = cover[: place.shape[0], : place.shape[1], None]
    place += (np.asarray(ink, dtype=np.float32) - place) * strength


def write(
    page: Floats,
    text: str,
    font: str,
    size: int,
    at: tuple[float, float],
    ink: float | Triple,
    spacing: float = 0.0,
    from_right: bool = False,
) -> int:
    """Set a line whose letters stand on `at`, its left end, or its right one; returns how wide it is."""
    cover = line(text, font, size, spacing)
    x = round(at[0]) - cover.shape[1] * from_right
    lay(page, cover, x, round(at[1]) - round(BASELINE * size), ink)
    return int(cover.shape[1])


def fitting(text: str, font: str, size: int, room: float, spacing: float = 0.0) -> int:
    """The size, or a smaller one by which the line is no wider than `room`."""
    width = line(text, font, size, spacing).shape[1]
    return size if width <= room else max(4, int(size * room / width))


def wrapped(text: str, font: str, size: int, room: float, most: int) -> list[str]:
    """The text in lines no wider than `room`, `most` of them; what is left over ends in dots."""
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and line(longer, font, size).shape[1] <= room:
            lines[-1] = longer
        else:
            lines.append(word)
    if len(lines) > most:
        lines = [*lines[: most - 1], f"{lines[most - 1]} ..."]
    return [cut_short(each, font, size, room) for each in lines]


def cut_short(text: str, font: str, size: int, room: float) -> str:
    """The line, or as much of its beginning as there is room for, and dots."""
    while text and (width := line(text, font, size).shape[1]) > room:
        kept = text.removesuffix("...")
        kept = kept[: max(0, min(len(kept) - 1, int(len(kept) * room / width)))]
        text = f"{kept}..." if kept else ""
    return text
