"""Contact sheets: pictures in rows on a dark neutral ground, a caption below each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.post.image import lettering

Caption = tuple[tuple[str, str], ...]
"""Lines below a picture: what it says in quiet ink, and then in bright ink."""

GROUND, VACANT, QUIET, INK = 24 / 255, 38 / 255, 0.56, 0.92
"""Display values: of the ground, of the place of a picture that is not there, and of words."""

FONT = "DroidSans"
_ASPECT = 16 / 9
_CAPTIONED = 1.15
"""How much higher a picture is with its caption."""

_SMALLEST, _LARGEST, _SHARE = 12, 30, 0.043
"""The size of words in pixels, as a share of a picture's width within bounds."""

_LONGEST = 22.0
"""How far a caption may reach beyond a small picture, in sizes of its words; what is longer is cut short."""

MOST_PIXELS = 3840
"""Along a side of a sheet, where its pictures can be made smaller by whole factors."""


@dataclass(frozen=True, eq=False)
class ContactSheet:
    """A page for pictures that all have one size.

    heading   what stands above all of them
    captions  one for each picture, in the order of the pictures: rows from the left
    size      width and height of a picture, pixels
    columns   pictures in a row
    bits      8 or 16, those of the pictures and of the page
    """

    heading: str
    captions: Sequence[Caption]
    size: tuple[int, int]
    columns: int
    bits: int = 8

    def __post_init__(self) -> None:
        if not self.captions or self.columns < 1 or min(self.size) < 1:
            raise BadInputError(
                f"a contact sheet of {len(self.captions)} pictures of {self.size[0]} × {self.size[1]} pixels "
                f"in {self.columns} columns is not possible; it needs at least one of each"
            )

    def picture(self, pictures: Sequence[NDArray[Any] | None], note: str = "") -> NDArray[Any]:
        """The page (H, W, 3) with display pictures (h, w, 3) of uint8, or of uint16 where `bits` is 16.

        A picture that is None is told to be missing; `note` stands above, on the right. Raises BadInputError
        for pictures of another number, size or type.
        """
        if len(pictures) != len(self.captions):
            raise BadInputError(
                f"{len(pictures)} pictures for {len(self.captions)} captions; give one for each"
            )
        page = self._page.copy()
        line, margin = round(2.95 * self._words), 2 * self._words
        right = page.shape[1] - margin
        self._write(page, note, right, line, self._words, QUIET, from_right=True)
        room = right - margin - _width(note, self._words) - self._words
        self._write(page, self.heading, margin, line, self._title, INK, room)
        for index, picture in enumerate(pictures):
            x, y = self._place(index)
            if picture is not None:
                self._require(picture)
                page[y : y + self.size[1], x : x + self.size[0]] = picture
        return page

    @cached_property
    def _page(self) -> NDArray[Any]:
        """All that is the same whatever the pictures show."""
        last_x, last_y = self._place(self.columns * self._rows - 1)
        margin = self._words * 2
        height = last_y + self.size[1] + self._below + margin
        heading = margin + min(_width(self.heading, self._title), round(_LONGEST * self._title))
        width = max(last_x + self._cell, heading + 14 * self._words) + margin
        page = np.full((height, width, 3), self._level(GROUND), np.uint16 if self.bits > 8 else np.uint8)
        for index, caption in enumerate(self.captions):
            x, y = self._place(index)
            page[y : y + self.size[1], x : x + self.size[0]] = self._level(VACANT)
            self._vacant(page, x, y)
            for line, (name, value) in enumerate(caption):
                baseline = y + self.size[1] + round((1.45 + 1.45 * line) * self._words)
                self._write(page, name, x, baseline, self._words, QUIET, self._tab)
                room = self._cell - self._tab
                self._write(page, value, x + self._tab, baseline, self._words, INK, room)
        return page

    # Distances, in pixels

    @property
    def _words(self) -> int:
        """The size of words, which all distances are measured by."""
        return min(_LARGEST, max(_SMALLEST, round(_SHARE * self.size[0])))

    @property
    def _title(self) -> int:
        """The size of the heading's words."""
        return round(1.25 * self._words)

    @cached_property
    def _cell(self) -> int:
        """How wide a picture's place is: as wide as the picture, or as its caption where that is wider."""
        longest = max(
            (_width(value, self._words) for caption in self.captions for _, value in caption), default=0
        )
        return max(self.size[0], min(self._tab + longest, round(_LONGEST * self._words)))

    @cached_property
    def _tab(self) -> int:
        """Where in all captions what is in bright ink begins, right of their left edge."""
        names = {name for caption in self.captions for name, _ in caption if name}
        longest = max((_width(name, self._words) for name in names), default=0)
        tab = longest + round(0.6 * self._words) if names else 0
        return min(tab, round(0.6 * _LONGEST * self._words))

    @property
    def _rows(self) -> int:
        return ceil(len(self.captions) / self.columns)

    @property
    def _below(self) -> int:
        """What captions take."""
        lines = max(len(caption) for caption in self.captions)
        return round((0.45 + 1.45 * lines) * self._words) if lines else 0

    def _place(self, index: int) -> tuple[int, int]:
        """The left upper corner of a picture."""
        row, column = divmod(index, self.columns)
        across = self._cell + round(1.2 * self._words)
        down = self.size[1] + self._below + round(1.2 * self._words)
        return 2 * self._words + column * across, round(4.2 * self._words) + row * down

    def _level(self, value: float) -> int:
        return round(value * (65535 if self.bits > 8 else 255))

    def _write(
        self,
        page: NDArray[Any],
        text: str,
        x: int,
        baseline: int,
        size: int,
        ink: float,
        room: int | None = None,
        from_right: bool = False,
    ) -> None:
        """Set a line of text, cut short where it needs more than `room`."""
        if not text.strip():
            return
        line = _line(text, size)
        while room is not None and line.shape[1] > room and text:
            text = text.removesuffix("...")
            text = text[: min(len(text) - 1, int(len(text) * room / line.shape[1]))]
            text += "..." if text else ""
            line = _line(text, size)
        left, top = x - line.shape[1] if from_right else x, baseline - round(1.4 * size)
        line = line[max(0, -top) :, max(0, -left) :]
        there = page[max(0, top) :, max(0, left) :][: line.shape[0], : line.shape[1]]
        cover = line[: there.shape[0], : there.shape[1], None]
        there[:] = np.rint(there * (1.0 - cover) + self._level(ink) * cover).astype(page.dtype)

    def _vacant(self, page: NDArray[Any], x: int, y: int) -> None:
        """Words that a picture will cover."""
        words = "not rendered"
        wide = _width(words, self._words)
        if wide < self.size[0] and 2 * self._words < self.size[1]:
            middle = y + self.size[1] // 2 + round(0.35 * self._words)
            self._write(page, words, x + (self.size[0] - wide) // 2, middle, self._words, QUIET)

    def _require(self, picture: NDArray[Any]) -> None:
        expected = (self.size[1], self.size[0], 3)
        if picture.shape != expected or picture.dtype != self._page.dtype:
            raise BadInputError(
                f"a picture is {picture.dtype} {picture.shape}; on this sheet it must be {self._page.dtype} "
                f"{expected}"
            )


def columns_for(count: int, size: tuple[int, int]) -> int:
    """How many columns make a sheet of so many pictures most like a screen, without an empty row."""

    def off(columns: int) -> float:
        rows = ceil(count / columns)
        empty = columns * rows - count
        aspect = columns * size[0] / (rows * size[1] * _CAPTIONED)
        return abs(log(aspect / _ASPECT)) + 3.0 * empty / count

    return min(range(1, count + 1), key=off)


def reduction(count: int, columns: int, size: tuple[int, int]) -> int:
    """By which whole factor pictures are made smaller, so that no side is much over MOST_PIXELS."""
    longest = max(columns * size[0], ceil(count / columns) * size[1])
    return min(max(1, ceil(longest / MOST_PIXELS)), *size)


def reduced(light: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Light (H, W, 3) in pixels `factor` times as large, each the mean of those whose place it takes.

    What is left over at the right and below is not shown.
    """
    height, width = (side // factor for side in light.shape[:2])
    blocks = light[: height * factor, : width * factor].reshape(height, factor, width, factor, -1)
    return np.ascontiguousarray(blocks.mean(axis=(1, 3)), dtype=np.float32)


def _width(text: str, size: int) -> int:
    return int(_line(text, size).shape[1]) if text.strip() else 0


@lru_cache(maxsize=4096)
def _line(text: str, size: int) -> NDArray[np.float32]:
    """A line of text: names and values stand on a sheet again and again, and setting them takes its time."""
    return lettering(text, FONT, size)
