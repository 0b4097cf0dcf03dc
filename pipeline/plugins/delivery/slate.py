"""Slates, which name a clip before its first frame, and cards for frames that failed.

They show no date: the same shot has the same slate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flowsculpt.api.pictures import Font

Floats = NDArray[np.float32]

GROUND, CENTRE = (0.075, 0.068, 0.064), (0.150, 0.137, 0.127)
"""Display colours of the corners of a card, and of the glow behind its words."""

INK, QUIET, FAINT = (0.93, 0.90, 0.85), (0.70, 0.65, 0.59), (0.30, 0.278, 0.258)
WARNING = (0.86, 0.47, 0.30)

_SANS, _SERIF = "DroidSans", "DroidSerif-Italic"

_LEVELS = 0.75, 0.0
BARS = [(red, green, blue) for green in _LEVELS for red in _LEVELS for blue in _LEVELS][:-1]
"""Colour bars of 75%, in the order of SMPTE EG 1: from white by falling luminance."""
GREYS = 11  # steps of the ramp from black to white


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
        room, right = self.width - 2 * self.margin, self.width - self.margin
        small, large = self._font(3.2, spacing=0.3), self._font(9.5, spacing=0.01)
        small.write(self.page, "SLATE", (self.margin, self._down(12.0)), QUIET)
        small.write(self.page, "FLOWSCULPT", (right, self._down(12.0)), QUIET, from_right=True)
        large.fit(slate.name, room).write(self.page, slate.name, (self.margin, self._down(27.5)), INK)
        if slate.title:
            serif = self._font(5.2, _SERIF)
            title = serif.cut_short(slate.title, room)
            serif.write(self.page, title, (self.margin, self._down(34.5)), QUIET)
        y, thick = round(self._down(39.5)), max(1, round(0.16 * self.unit))
        self.page[y : y + thick, round(self.margin) : round(right)] = FAINT
        self._picture(slate.picture, len(slate.facts))
        self._facts(slate.facts, with_picture=slate.picture is not None and not self.is_upright)
        self._references()
        return self.page

    def failure(self, heading: str, reason: str) -> Floats:
        middle = self.height / 2.0
        room = self.width - 2 * self.margin
        y = round(middle - 2.0 * self.unit)
        mark = self.page[max(0, round(y - 4.1 * self.unit)) : y, round(self.margin) :]
        mark[:, : max(1, round(0.5 * self.unit))] = WARNING
        font = self._font(5.5).fit(heading, room)
        font.write(self.page, heading, (self.margin + 2.4 * self.unit, y), INK)
        small = self._font(3.9)
        for number, words in enumerate(small.wrap(reason, room - 2.4 * self.unit, max_lines=5)):
            at = (self.margin + 2.4 * self.unit, y + (7.0 + 5.4 * number) * self.unit)
            small.write(self.page, words, at, QUIET)
        return self.page

    def _facts(self, facts: Sequence[tuple[str, str]], with_picture: bool) -> None:
        """Draw rows of a name and a value."""
        font = self._font(3.7)
        tab = max((font.width(name) for name, _ in facts), default=0) + 2.6 * self.unit
        edge = self.width - self.margin - ((58.0 + 4.0) * self.unit if with_picture else 0.0)
        room = edge - self.margin - tab
        for number, (name, value) in enumerate(facts):
            y = self._down(46.0 + 4.55 * number)
            font.write(self.page, name, (self.margin, y), QUIET)
            font.write(self.page, font.cut_short(value, room), (self.margin + tab, y), INK)

    def _picture(self, picture: Floats | None, facts: int) -> None:
        """Draw the picture small, below the rule on the right, or below the facts on an upright page."""
        if picture is None:
            return
        first = 46.0 + 4.55 * facts if self.is_upright else 43.5
        widest, highest = 58.0 * self.unit, (self.length - 20.5 - first) * self.unit
        height, width = picture.shape[:2]
        share = min(widest / width, highest / height)
        small = _resize(picture, (max(1, round(share * width)), max(1, round(share * height))))
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
            words = "75% bars, BT.709" if colours is BARS else "greys, 0 to 100%"
            self._font(3.0).write(self.page, words, (first, top + height + 3.9 * self.unit), QUIET)

    def _fill(self, top: int, left: int, values: Floats) -> None:
        place = self.page[max(0, top) :, max(0, left) :][: values.shape[0], : values.shape[1]]
        place[:] = values[: place.shape[0], : place.shape[1]]

    def _down(self, units: float) -> float:
        """Return the row at a distance from the top of the drawing, which is centred on the page."""
        return self.top + units * self.unit

    def _font(self, units: float, name: str = _SANS, spacing: float = 0.0) -> Font:
        return Font(name, max(4, round(units * self.unit)), spacing)


def _ground(size: tuple[int, int]) -> Floats:
    """Return a warm dark ground, a little lighter towards the upper left, where the name stands."""
    width, height = size
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    across, down = x / max(1, width) - 0.30, y / max(1, height) - 0.28
    glow = np.exp(-(across**2 / 0.32 + down**2 / 0.22))[..., None]
    ground, centre = np.array(GROUND, np.float32), np.array(CENTRE, np.float32)
    return np.asarray(ground + (centre - ground) * glow, dtype=np.float32)


def _resize(picture: Floats, size: tuple[int, int]) -> Floats:
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
