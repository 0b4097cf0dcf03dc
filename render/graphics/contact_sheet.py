"""Contact sheets: pictures in rows on a dark neutral ground, each with a caption below it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.graphics.typesetting import Font

Caption = tuple[tuple[str, str], ...]  # lines below a picture: a name in quiet ink and a value in bright ink

GROUND, VACANT, QUIET, INK = 24 / 255, 38 / 255, 0.56, 0.92
"""Display values of the ground, of a missing picture, and of names and values."""

FONT = "DroidSans"
_ASPECT = 16 / 9
_CAPTIONED = 1.15  # height of a picture with its caption, in picture heights

_MIN_TEXT, _MAX_TEXT, _TEXT_SHARE = 12, 30, 0.043
"""Font size in pixels, as a share of a picture's width within bounds."""

_MAX_CAPTION = 22.0  # width up to which a caption widens a cell, in font sizes; longer captions are cut short

MAX_PIXELS = 3840  # side of a sheet above which its pictures are reduced by whole factors


@dataclass(frozen=True, eq=False)
class ContactSheet:
    """A page for pictures of one size, or smaller ones in the middle of their places.

    heading   stands above all pictures
    captions  one for each picture, row by row from the left
    size      width and height of a picture, pixels; the largest of each
    columns   pictures in a row
    bits      8 or 16: those of the pictures and of the page
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

    @classmethod
    def fitted(
        cls, heading: str, captions: Sequence[Caption], size: tuple[int, int], columns: int, bits: int = 8
    ) -> tuple[ContactSheet, int]:
        """Return a sheet for pictures of a width and height, and the factor that reduces them."""
        factor = reduction(len(captions), columns, size)
        return cls(heading, captions, (size[0] // factor, size[1] // factor), columns, bits), factor

    @staticmethod
    def columns_for(count: int, size: tuple[int, int]) -> int:
        """Return the number of columns that gives a sheet the shape of a screen, without an empty row."""

        def cost(columns: int) -> float:
            rows = ceil(count / columns)
            empty = columns * rows - count
            aspect = columns * size[0] / (rows * size[1] * _CAPTIONED)
            return abs(log(aspect / _ASPECT)) + 3.0 * empty / count

        return min(range(1, count + 1), key=cost)

    def picture(self, pictures: Sequence[NDArray[Any] | None], note: str = "") -> NDArray[Any]:
        """Return the page (H, W, 3) with display pictures (h, w, 3), uint8 or, for 16 bits, uint16.

        A picture that is None is shown as missing; `note` stands above on the right. Raises BadInputError for
        pictures of another number or type, and for larger ones.
        """
        if len(pictures) != len(self.captions):
            raise BadInputError(
                f"{len(pictures)} pictures for {len(self.captions)} captions; give one for each"
            )
        page = self._page.copy()
        baseline, margin = round(2.95 * self._text_size), 2 * self._text_size
        right = page.shape[1] - margin
        self._write(page, note, right, baseline, self._text_size, QUIET, from_right=True)
        room = right - margin - _width(note, self._text_size) - self._text_size
        self._write(page, self.heading, margin, baseline, self._heading_size, INK, room)
        for index, picture in enumerate(pictures):
            x, y = self._corner(index)
            if picture is not None:
                self._require(picture)
                height, width = picture.shape[:2]
                x, y = x + (self.size[0] - width) // 2, y + (self.size[1] - height) // 2
                page[y : y + height, x : x + width] = picture
        return page

    @cached_property
    def _page(self) -> NDArray[Any]:
        """The page without pictures: captions, and places that say that nothing is rendered."""
        last_x, last_y = self._corner(self.columns * ceil(len(self.captions) / self.columns) - 1)
        margin = self._text_size * 2
        height = last_y + self.size[1] + self._caption_height + margin
        heading = _width(self.heading, self._heading_size)
        heading = margin + min(heading, round(_MAX_CAPTION * self._heading_size))
        width = max(last_x + self._cell_width, heading + 14 * self._text_size) + margin
        page = np.full((height, width, 3), self._level(GROUND), np.uint16 if self.bits > 8 else np.uint8)
        for index, caption in enumerate(self.captions):
            x, y = self._corner(index)
            page[y : y + self.size[1], x : x + self.size[0]] = self._level(VACANT)
            self._write_vacant(page, x, y)
            for row, (name, value) in enumerate(caption):
                baseline = y + self.size[1] + round((1.45 + 1.45 * row) * self._text_size)
                self._write(page, name, x, baseline, self._text_size, QUIET, self._tab)
                room = self._cell_width - self._tab
                self._write(page, value, x + self._tab, baseline, self._text_size, INK, room)
        return page

    # Distances, in pixels

    @property
    def _text_size(self) -> int:
        """The font size of captions, the unit of all distances."""
        return min(_MAX_TEXT, max(_MIN_TEXT, round(_TEXT_SHARE * self.size[0])))

    @property
    def _heading_size(self) -> int:
        return round(1.25 * self._text_size)

    @cached_property
    def _cell_width(self) -> int:
        """The width of a picture, or of its caption where that is wider."""
        values = [value for caption in self.captions for _, value in caption]
        longest = max((_width(value, self._text_size) for value in values), default=0)
        return max(self.size[0], min(self._tab + longest, round(_MAX_CAPTION * self._text_size)))

    @cached_property
    def _tab(self) -> int:
        """The distance from the left edge of captions to their values."""
        names = {name for caption in self.captions for name, _ in caption if name}
        longest = max((_width(name, self._text_size) for name in names), default=0)
        tab = longest + round(0.6 * self._text_size) if names else 0
        return min(tab, round(0.6 * _MAX_CAPTION * self._text_size))

    @property
    def _caption_height(self) -> int:
        lines = max(len(caption) for caption in self.captions)
        return round((0.45 + 1.45 * lines) * self._text_size) if lines else 0

    def _corner(self, index: int) -> tuple[int, int]:
        """The upper left corner of a picture."""
        row, column = divmod(index, self.columns)
        across = self._cell_width + round(1.2 * self._text_size)
        down = self.size[1] + self._caption_height + round(1.2 * self._text_size)
        return 2 * self._text_size + column * across, round(4.2 * self._text_size) + row * down

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
        max_width: int | None = None,
        from_right: bool = False,
    ) -> None:
        """Write a line of text, cut short to `max_width`."""
        if text.strip():
            font = Font(FONT, size)
            shown = text if max_width is None else font.cut_short(text, max_width)
            font.write(page, shown, (x, baseline), self._level(ink), from_right)

    def _write_vacant(self, page: NDArray[Any], x: int, y: int) -> None:
        """Write the words that a picture will cover."""
        words = "not rendered"
        width = _width(words, self._text_size)
        if width < self.size[0] and 2 * self._text_size < self.size[1]:
            baseline = y + self.size[1] // 2 + round(0.35 * self._text_size)
            self._write(page, words, x + (self.size[0] - width) // 2, baseline, self._text_size, QUIET)

    def _require(self, picture: NDArray[Any]) -> None:
        most = (self.size[1], self.size[0], 3)
        fits = picture.ndim == 3 and all(own <= side for own, side in zip(picture.shape, most, strict=True))
        if not fits or picture.dtype != self._page.dtype:
            raise BadInputError(
                f"a picture is {picture.dtype} {picture.shape}; on this sheet it must be {self._page.dtype} "
                f"of at most {most}"
            )


def reduction(count: int, columns: int, size: tuple[int, int]) -> int:
    """Return the whole factor that reduces pictures so that no side is much over MAX_PIXELS."""
    longest = max(columns * size[0], ceil(count / columns) * size[1])
    return min(max(1, ceil(longest / MAX_PIXELS)), *size)


def reduced(light: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Reduce a picture (H, W, 3) by a whole factor; each pixel is the mean of a block.

    Incomplete blocks at the right and below are dropped.
    """
    height, width = (side // factor for side in light.shape[:2])
    blocks = light[: height * factor, : width * factor].reshape(height, factor, width, factor, -1)
    return np.ascontiguousarray(blocks.mean(axis=(1, 3)), dtype=np.float32)


def _width(text: str, size: int) -> int:
    return Font(FONT, size).width(text) if text.strip() else 0
