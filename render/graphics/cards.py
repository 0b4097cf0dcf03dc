"""Title cards of a film: words on a ground, or over pictures. In wide pictures a card stands like a screen
before the viewer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.plural import plural
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.graphics.title_card import MIDDLES, SIDES, CardStyle, TitleCard
from flowsculpt.render.graphics.typesetting import Font
from flowsculpt.render.post.colour import quantise
from flowsculpt.render.scene.render_camera import Projection, pixel_places

Floats = NDArray[np.float32]

T = TypeVar("T")

GROUND, CENTRE = (0.062, 0.066, 0.075), (0.150, 0.157, 0.172)
"""Display colours of the corners of a card, and of the glow behind its words."""

INK, SUBTITLE_INK = (0.93, 0.90, 0.85), (0.80, 0.75, 0.68)

NARROW, MOST_LINES = 1.5, 6
"""Width to height below which titles are set in several lines, and the most of them."""


def title_frames(card: TitleCard, size: tuple[int, int], count: int, fade: int) -> Iterator[Floats]:
    """Yield `count` frames of display values (H, W, 3); the words fade in over `fade` frames and out again.

    The ground does not fade, so a cut to the card does not flash black; its glow grows a little meanwhile.
    Raises BadInputError where the fades do not fit into `count`.
    """
    if fade < 0 or count < 1 or 2 * fade > count:
        raise BadInputError(
            f"a title of {plural(count, 'frame')} cannot fade over {fade} at each end; at most half"
        )
    words = _words(card, size)
    for number in range(count):
        picture = _ground(card.style, size, swell=_smooth(number / max(1, count - 1)))
        for ink, mask, strength in _fading(card.style, words, number, count, fade):
            cover = (mask * strength)[..., None]
            picture = picture * (1.0 - cover) + np.array(ink, dtype=np.float32) * cover
        yield np.asarray(picture, dtype=np.float32)


def card_frames(card: TitleCard, screen: Screen, count: int) -> Iterator[NDArray[np.uint16]]:
    """Yield the frames of a card of a film; its words take a quarter of the time to come, another to go."""
    for drawn in title_frames(card, screen.size, count, fade=count // 4):
        yield screen.frame(drawn)


def with_words_over(
    pictures: Iterator[T],
    cards: Sequence[tuple[int, int, TitleCard]],
    screen: Screen,
    page: Callable[[NDArray[np.uint16]], T],
    mix: Callable[[T, T, Any], T],
) -> Iterator[T]:
    """Yield the pictures of a film with the words of cards over them.

    cards  with the number of each one's first picture, from 0, and of its pictures
    page   turns a frame (H, W, 3) of one colour into a picture
    mix    mixes two pictures by the weight of the second in each pixel, (H, W, 1)
    """
    set_words = [_words(card, screen.size) for *_, card in cards]
    for number, picture in enumerate(pictures):
        for (first, count, card), words in zip(cards, set_words, strict=True):
            if not first <= number < first + count:
                continue
            for ink, mask, strength in _fading(card.style, words, number - first, count, count // 4):
                coloured = np.broadcast_to(np.array(ink, np.float32), (*mask.shape, 3))
                picture = mix(picture, page(screen.frame(coloured)), screen.show(strength * mask[..., None]))
        yield picture


def _fading(
    style: CardStyle, words: tuple[Floats, Floats], number: int, count: int, fade: int
) -> Iterator[tuple[Triple, Floats, float]]:
    """Yield ink, coverage (H, W) and strength of title and subtitle in a frame.

    The subtitle follows the title, and leaves with it.
    """
    first, second = style.colour or INK, style.colour or SUBTITLE_INK
    yield first, words[0], _fade(number, count, fade)
    yield second, words[1], _fade(number - fade // 2, count - fade // 2, fade)


def _ground(style: CardStyle, size: tuple[int, int], swell: float) -> Floats:
    width, height = size
    if style.ground is not None:
        return np.broadcast_to(np.array(style.ground, np.float32), (height, width, 3))
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    reach = math.hypot(width, height)
    across, down = (x - 0.5 * width) / (0.75 * reach), (y - style.middle * height) / (0.5 * reach)
    glow = np.exp(-(across**2 + down**2) / (0.10 + 0.03 * swell))[..., None]
    ground, centre = np.array(GROUND), np.array(CENTRE)
    return np.asarray(ground + (centre - ground) * glow, dtype=np.float32)


def _words(card: TitleCard, size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return the coverage (H, W) of the title, and of the subtitle below it."""
    width, height = size
    style, middle = card.style, card.style.middle
    if width < NARROW * height:
        return _stack(card, size, middle)
    if style.position in SIDES:
        half = width // 2
        before = round(SIDES[style.position] * width)
        places = (0, 0), (before, width - half - before)
        title, subtitle = (np.pad(cover, places) for cover in _stack(card, (half, height), MIDDLES["middle"]))
        return title, subtitle
    title = _fit(card.title.upper(), style.font, 0.095 * height * style.size, 0.20, width)
    subtitle = _fit(card.subtitle, style.subtitle_font, 0.06 * height * style.size, 0.03, width)
    apart = 0.06 * style.size if card.subtitle else 0.0
    return _centre(title, size, middle - apart), _centre(subtitle, size, middle + apart)


def _stack(card: TitleCard, size: tuple[int, int], middle: float) -> tuple[Floats, Floats]:
    """Return the coverage (H, W) of both on a narrow page, each in as many lines as it needs.

    middle  of the words, as a share of the height from the upper edge
    """
    width, height = size
    style = card.style
    title = _block(card.title.upper(), style.font, 0.09 * width * style.size, 0.20, width)
    subtitle = _block(card.subtitle, style.subtitle_font, 0.065 * width * style.size, 0.03, width)
    gap = 0.07 * width if card.subtitle else 0.0
    above, below = (gap + len(block) for block in (subtitle, title))
    return (
        _centre(title, size, middle - above / 2.0 / height),
        _centre(subtitle, size, middle + below / 2.0 / height),
    )


def _block(text: str, name: str, height: float, spacing: float, width: int) -> Floats:
    """Set lines (H, W) in four fifths of a width, at that height in pixels or as the longest word needs."""
    font, room = Font(name, max(2, round(height)), spacing), 0.8 * width
    sizes = [font.fit(word, room).size for word in text.split()]
    if not sizes:
        return np.zeros((0, width), np.float32)
    font = replace(font, size=max(2, min(sizes)))
    covers = [font.line(each) for each in font.wrap(text, room, MOST_LINES)]
    leading = round(1.5 * font.size)
    block = np.zeros((leading * (len(covers) - 1) + len(covers[0]), width), np.float32)
    for number, cover in enumerate(covers):
        left = (width - cover.shape[1]) // 2
        block[number * leading :, max(0, left) :][: len(cover), : cover.shape[1]] += cover[:, :width]
    return block


def _fit(text: str, name: str, height: float, spacing: float, width: int) -> Floats:
    """Set a line at that height in pixels, or smaller where it would fill over four fifths of the width."""
    font = Font(name, max(2, round(height)), spacing)
    if (wide := font.width(text)) > 0.8 * width:
        font = replace(font, size=max(2, int(height * 0.8 * width / wide)))
    return font.line(text)[:, :width]


def _centre(cover: Floats, size: tuple[int, int], middle: float) -> Floats:
    """Place a line on an empty page: centred across, the middle of its ink at a share of the height."""
    width, height = size
    page = np.zeros((height, width), dtype=np.float32)
    rows = np.flatnonzero(cover.any(axis=1))
    if not len(rows):
        return page
    ink = cover[rows[0] : rows[-1] + 1][:height]
    top = min(max(0, round(middle * height - ink.shape[0] / 2.0)), height - ink.shape[0])
    left = (width - ink.shape[1]) // 2
    page[top : top + ink.shape[0], left : left + ink.shape[1]] = ink
    return page


def _fade(number: int, count: int, fade: int) -> float:
    """Rise from 0 to 1 over the first `fade` frames and fall over the last."""
    if fade == 0:
        return 1.0
    return _smooth(min((number + 0.5) / fade, (count - number - 0.5) / fade, 1.0))


def _smooth(t: float) -> float:
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


ANGLE = math.radians(75.0)
"""Horizontal angle of a screen: words that one reads in a headset without turning the head."""

ASPECT = 16 / 9  # width to height of a screen in a wide picture

_ROWS = 64  # rows whose directions are computed at once: those of a whole picture would fill a gigabyte


@dataclass(frozen=True)
class Screen:
    """A screen that fills a perspective picture, and stands straight ahead in a wide one, black around it.

    projection  of the pictures
    picture     their width and height, pixels
    """

    projection: Projection
    picture: tuple[int, int]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of what is drawn for the screen, pixels: about as fine as the picture there."""
        if not self.projection.is_wide:
            return self.picture
        width = max(2, math.ceil(self.picture[0] * ANGLE / self.projection.picture_angle))
        return width, max(2, round(width / ASPECT))

    def frame(self, drawn: Floats) -> NDArray[np.uint16]:
        """Return the same as `show` as a frame of a movie, uint16 (H, W, 3)."""
        return quantise(self.show(drawn), bits=16)

    def show(self, drawn: Floats) -> Floats:
        """Return the picture (H, W, 3) with the screen that shows what was drawn, (h, w, 3) of `size`."""
        if not self.projection.is_wide:
            return drawn
        width, height = self.picture
        picture = np.zeros((height, width, drawn.shape[2]), np.float32)
        columns, lines = drawn.reshape(-1, drawn.shape[2]), self.size[0]
        for pixels, first, across, down in self._covered:
            upper = columns[first] * (1.0 - across) + columns[first + 1] * across
            lower = columns[first + lines] * (1.0 - across) + columns[first + lines + 1] * across
            picture.reshape(-1, drawn.shape[2])[pixels] = upper * (1.0 - down) + lower * down
        return picture

    @cached_property
    def _covered(self) -> list[tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]]:
        """Pixels (N,) that show the screen, by some rows each.

        With each the drawn pixel to its upper left, and the shares (N, 1) of those to the right and below.
        """
        (width, height), half, covered = self.size, math.tan(ANGLE / 2.0), []
        places = pixel_places(*self.picture)
        for row in range(0, len(places), _ROWS):
            right, up, forward = np.moveaxis(self.projection.directions(places[row : row + _ROWS]), -1, 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                x, y = right / forward / half, up / forward / half * width / height
            pixels = np.flatnonzero((forward > 0.0) & (np.abs(x) <= 1.0) & (np.abs(y) <= 1.0))
            across = np.clip((x.ravel()[pixels] + 1.0) * 0.5 * width - 0.5, 0.0, width - 1.001)
            down = np.clip((1.0 - y.ravel()[pixels]) * 0.5 * height - 0.5, 0.0, height - 1.001)
            first = np.floor(down).astype(np.int64) * width + np.floor(across).astype(np.int64)
            shares = ((along - np.floor(along)).astype(np.float32)[:, None] for along in (across, down))
            covered.append((pixels + row * self.picture[0], first, *shares))
        return covered
