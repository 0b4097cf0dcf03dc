"""Cards of words on a warm dark ground: titles of a film, slates, and cards for frames that failed.

Slates name a clip before its first frame. They show no date: the same shot has the same slate. In wide
pictures a card stands like a screen before the viewer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.plural import plural
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.graphics.typesetting import cut_short, fit_size, line, wrap, write
from flowsculpt.render.post.colour import quantise
from flowsculpt.render.scene.render_camera import Projection, pixel_places

Floats = NDArray[np.float32]

GROUND, CENTRE = (0.075, 0.068, 0.064), (0.150, 0.137, 0.127)
TITLE_CENTRE = 0.205, 0.186, 0.172
"""Display colours of the corners of a card, and of the glow behind the words of slates and of titles."""

INK, QUIET, FAINT = (0.93, 0.90, 0.85), (0.70, 0.65, 0.59), (0.30, 0.278, 0.258)
SUBTITLE_INK = 0.80, 0.75, 0.68
WARNING: Triple = (0.86, 0.47, 0.30)

_SANS, _SERIF = "DroidSans", "DroidSerif-Italic"

_LEVELS = 0.75, 0.0
BARS = [(red, green, blue) for green in _LEVELS for red in _LEVELS for blue in _LEVELS][:-1]
"""Colour bars of 75%, in the order of SMPTE EG 1: from white by falling luminance."""
GREYS = 11  # steps of the ramp from black to white

NARROW, MOST_LINES = 1.5, 6
"""Width to height below which titles are set in several lines, and the most of them."""


@dataclass(frozen=True)
class TitleCard:
    """A title card: title in wide capitals and subtitle, a line each where the page is wide enough."""

    title: str
    subtitle: str = ""


def title_frames(card: TitleCard, size: tuple[int, int], count: int, fade: int) -> Iterator[Floats]:
    """Yield `count` frames of display values (H, W, 3); the words fade in over `fade` frames and out again.

    The ground does not fade, so a cut to the card does not flash black; its glow grows a little meanwhile.
    Raises BadInputError where the fades do not fit into `count`.
    """
    if fade < 0 or count < 1 or 2 * fade > count:
        raise BadInputError(
            f"a title of {plural(count, 'frame')} cannot fade over {fade} at each end; at most half"
        )
    title, subtitle = _words(card, size)
    for number in range(count):
        time = number / max(1, count - 1)
        picture = _title_ground(size, swell=_smooth(time))
        strength = _fade(number, count, fade)
        # The subtitle follows the title and leaves with it.
        late = _fade(number - fade // 2, count - fade // 2, fade)
        for ink, mask, amount in ((INK, title, strength), (SUBTITLE_INK, subtitle, late)):
            cover = (mask * amount)[..., None]
            picture = picture * (1.0 - cover) + np.array(ink, dtype=np.float32) * cover
        yield np.asarray(picture, dtype=np.float32)


def card_frames(title: str, subtitle: str, screen: Screen, count: int) -> Iterator[NDArray[np.uint16]]:
    """Yield the frames of a card of a film; its words take a quarter of the time to come, another to go."""
    for drawn in title_frames(TitleCard(title, subtitle), screen.size, count, fade=count // 4):
        yield quantise(screen.show(drawn), bits=16)


def _title_ground(size: tuple[int, int], swell: float) -> Floats:
    width, height = size
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    across = (x - width / 2.0) / (0.80 * width)
    down = (y - 0.46 * height) / (0.95 * height)
    glow = np.exp(-(across**2 + down**2) / (0.10 + 0.03 * swell))[..., None]
    ground, centre = np.array(GROUND), np.array(TITLE_CENTRE)
    return np.asarray(ground + (centre - ground) * glow, dtype=np.float32)


def _words(card: TitleCard, size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return the coverage (H, W) of the title, a little above the middle, and of the subtitle below it."""
    width, height = size
    if width < NARROW * height:
        return _stacked(card, size)
    title = _fitted(card.title.upper(), _SANS, 0.085 * height, 0.30, width)
    subtitle = _fitted(card.subtitle, _SERIF, 0.06 * height, 0.03, width)
    return _centred(title, size, 0.46), _centred(subtitle, size, 0.585)


def _stacked(card: TitleCard, size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return the coverage (H, W) of both on a narrow page, each in as many lines as it needs."""
    width, height = size
    title = _block(card.title.upper(), _SANS, 0.09 * width, 0.20, width)
    subtitle = _block(card.subtitle, _SERIF, 0.065 * width, 0.03, width)
    gap = 0.07 * width if card.subtitle else 0.0
    above, below = (gap + len(block) for block in (subtitle, title))
    middle = 0.48 * height
    return (
        _centred(title, size, (middle - above / 2.0) / height),
        _centred(subtitle, size, (middle + below / 2.0) / height),
    )


def _block(text: str, font: str, height: float, spacing: float, width: int) -> Floats:
    """Set lines (H, W) in four fifths of a width, at that height in pixels or as the longest word needs."""
    room = 0.8 * width
    sizes = [fit_size(word, font, max(2, round(height)), room, spacing) for word in text.split()]
    if not sizes:
        return np.zeros((0, width), np.float32)
    size = max(2, min(sizes))
    covers = [line(each, font, size, spacing) for each in wrap(text, font, size, room, MOST_LINES, spacing)]
    leading = round(1.5 * size)
    block = np.zeros((leading * (len(covers) - 1) + len(covers[0]), width), np.float32)
    for number, cover in enumerate(covers):
        left = (width - cover.shape[1]) // 2
        block[number * leading :, max(0, left) :][: len(cover), : cover.shape[1]] += cover[:, :width]
    return block


def _fitted(text: str, font: str, height: float, spacing: float, width: int) -> Floats:
    """Set a line at that height in pixels, or smaller where it would fill over four fifths of the width."""
    cover = line(text, font, max(2, round(height)), spacing)
    if cover.shape[1] > 0.8 * width:
        cover = line(text, font, max(2, int(height * 0.8 * width / cover.shape[1])), spacing)
    return cover[:, :width]


def _centred(cover: Floats, size: tuple[int, int], middle: float) -> Floats:
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


@dataclass(frozen=True, eq=False)
class Slate:
    """A slate.

    name      of the shot, large
    title     of the shot, below it
    facts     names and values, in two columns
    picture   display values 0 … 1 (h, w, 3), shown small; None for none
    """

    name: str
    title: str
    facts: Sequence[tuple[str, str]]
    picture: Floats | None = None

    def draw(self, size: tuple[int, int]) -> Floats:
        """Draw the slate in display values (H, W, 3), for frames of that width and height."""
        return _Card(size).slate(self)


def failure_card(size: tuple[int, int], heading: str, reason: str) -> Floats:
    """Draw a card (H, W, 3) that stands for a missing frame and says which one, and why it failed."""
    return _Card(size).failure(heading, reason)


class _Card:
    """A page. Its distances are in units, 160 across and 100 down, or 100 across and 150 down if upright."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.width, self.height = size
        self.is_upright = self.height >= 1.4 * self.width
        across, self.length = (100.0, 150.0) if self.is_upright else (160.0, 100.0)
        self.unit = min(self.height / self.length, self.width / across)
        self.margin = 9.0 * self.unit
        self.top = (self.height - self.length * self.unit) / 2.0
        self.page = _ground(size)

    def slate(self, slate: Slate) -> Floats:
        room, right, small = self.width - 2 * self.margin, self.width - self.margin, self._size(3.2)
        write(self.page, "SLATE", _SANS, small, (self.margin, self._down(12.0)), QUIET, 0.3)
        write(self.page, "FLOWSCULPT", _SANS, small, (right, self._down(12.0)), QUIET, 0.3, from_right=True)
        name = fit_size(slate.name, _SANS, self._size(9.5), room, 0.01)
        write(self.page, slate.name, _SANS, name, (self.margin, self._down(27.5)), INK, 0.01)
        if slate.title:
            size = self._size(5.2)
            title = cut_short(slate.title, _SERIF, size, room)
            write(self.page, title, _SERIF, size, (self.margin, self._down(34.5)), QUIET)
        y, thick = round(self._down(39.5)), max(1, round(0.16 * self.unit))
        self.page[y : y + thick, round(self.margin) : round(right)] = FAINT
        self._picture(slate.picture, len(slate.facts))
        self._facts(slate.facts, with_picture=slate.picture is not None and not self.is_upright)
        self._references()
        return self.page

    def failure(self, heading: str, reason: str) -> Floats:
        middle = self.height / 2.0
        room = self.width - 2 * self.margin
        size = fit_size(heading, _SANS, self._size(5.5), room)
        y = round(middle - 2.0 * self.unit)
        mark = self.page[max(0, round(y - 4.1 * self.unit)) : y, round(self.margin) :]
        mark[:, : max(1, round(0.5 * self.unit))] = WARNING
        write(self.page, heading, _SANS, size, (self.margin + 2.4 * self.unit, y), INK)
        small = self._size(3.9)
        for number, words in enumerate(wrap(reason, _SANS, small, room - 2.4 * self.unit, max_lines=5)):
            at = (self.margin + 2.4 * self.unit, y + (7.0 + 5.4 * number) * self.unit)
            write(self.page, words, _SANS, small, at, QUIET)
        return self.page

    def _facts(self, facts: Sequence[tuple[str, str]], with_picture: bool) -> None:
        """Draw rows of a name and a value."""
        size = self._size(3.7)
        tab = max((line(name, _SANS, size).shape[1] for name, _ in facts), default=0) + 2.6 * self.unit
        edge = self.width - self.margin - ((58.0 + 4.0) * self.unit if with_picture else 0.0)
        room = edge - self.margin - tab
        for number, (name, value) in enumerate(facts):
            y = self._down(46.0 + 4.55 * number)
            write(self.page, name, _SANS, size, (self.margin, y), QUIET)
            write(self.page, cut_short(value, _SANS, size, room), _SANS, size, (self.margin + tab, y), INK)

    def _picture(self, picture: Floats | None, facts: int) -> None:
        """Draw the picture small, below the rule on the right, or below the facts on an upright page."""
        if picture is None:
            return
        first = 46.0 + 4.55 * facts if self.is_upright else 43.5
        widest, highest = 58.0 * self.unit, (self.length - 20.5 - first) * self.unit
        height, width = picture.shape[:2]
        share = min(widest / width, highest / height)
        small = _resized(picture, (max(1, round(share * width)), max(1, round(share * height))))
        left = self.margin if self.is_upright else self.width - self.margin - small.shape[1]
        self._fill(round(self._down(first)), round(left), small)

    def _references(self) -> None:
        """Draw colour bars and a ramp of greys along the lower edge, to judge a display by."""
        top, height = self._down(self.length - 15.0), 2.6 * self.unit
        left, right = round(self.margin), round(self.width - self.margin)
        middle = (left + right) // 2
        gap = round(self.unit)
        greys = [(n / (GREYS - 1),) * 3 for n in range(GREYS)]
        for colours, first, last in ((BARS, left, middle - gap), (greys, middle + gap, right)):
            edges = np.rint(np.linspace(first, last, len(colours) + 1)).astype(int)
            strip = np.zeros((max(1, round(height)), max(0, last - first), 3), np.float32)
            for colour, start, end in zip(colours, edges, edges[1:], strict=False):
                strip[:, start - first : end - first] = colour
            self._fill(round(top), first, strip)
            size = self._size(3.0)
            words = "75% bars, BT.709" if colours is BARS else "greys, 0 to 100%"
            write(self.page, words, _SANS, size, (first, top + height + 3.9 * self.unit), QUIET)

    def _fill(self, top: int, left: int, values: Floats) -> None:
        place = self.page[max(0, top) :, max(0, left) :][: values.shape[0], : values.shape[1]]
        place[:] = values[: place.shape[0], : place.shape[1]]

    def _down(self, units: float) -> float:
        """Return the row at a distance from the top of the drawing, which is centred on the page."""
        return self.top + units * self.unit

    def _size(self, units: float) -> int:
        return max(4, round(units * self.unit))


def _ground(size: tuple[int, int]) -> Floats:
    """Return a warm dark ground, a little lighter towards the upper left, where the name stands."""
    width, height = size
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    across, down = x / max(1, width) - 0.30, y / max(1, height) - 0.28
    glow = np.exp(-(across**2 / 0.32 + down**2 / 0.22))[..., None]
    ground, centre = np.array(GROUND, np.float32), np.array(CENTRE, np.float32)
    return np.asarray(ground + (centre - ground) * glow, dtype=np.float32)


def _resized(picture: Floats, size: tuple[int, int]) -> Floats:
    """Resize a picture by area means, from cumulative sums along both axes."""
    made = picture.astype(np.float64)
    for axis, target in ((0, size[1]), (1, size[0])):
        length = made.shape[axis]
        sums = np.concatenate([np.zeros_like(made.take([0], axis)), np.cumsum(made, axis=axis)], axis)
        edges = np.linspace(0.0, length, target + 1)
        whole = np.minimum(edges.astype(int), length - 1)
        share = np.expand_dims(edges - whole, tuple(a for a in range(3) if a != axis))
        at = sums.take(whole, axis) * (1.0 - share) + sums.take(whole + 1, axis) * share
        made = np.diff(at, axis=axis) * (target / length)
    return np.asarray(made, dtype=np.float32)


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
