"""Letters, lines and colours of the parts of a legend, and how they are laid over light."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from flowsculpt.api.pictures import Font

Pixels = np.ndarray

FONT = "DroidSans"  # of the cards of films; all its digits have one width

SIZE, LEAST = 0.0205, 10  # of letters: of the shorter side, and the fewest pixels, before the factor
SMALL = 0.82  # of numbers and units
QUIET = 0.74  # strength of what matters less
BRIGHTNESS = 1.9  # of a palette: what lights make of reflectances, about
KEYLINE = 0.3  # strength of the line around a palette, whose ends may be as dark or light as the ground
PALETTE_WIDTH, PALETTE_HEIGHT = 13.0, 0.42  # in sizes of letters
SCALE_WIDTH = 11.0
HALO, HALO_STRENGTH = 0.5, 0.32
"""Size of the soft edge in the other ink around letters, in their sizes, and its strength."""


class Ink(Enum):
    """Linear light of letters and lines, and of the halo about them."""

    LIGHT = (0.92, 0.0)
    DARK = (0.012, 0.75)


@dataclass(frozen=True)
class DrawnPart:
    """A part of a legend.

    cover   (h, w) of ink, 0 to 1
    colours (h, w, 3) linear light under it, and `painted` (h, w), 0 to 1, where it is
    """

    cover: Pixels
    colours: Pixels
    painted: Pixels
    ink: Ink
    size: int

    @property
    def height(self) -> int:
        return len(self.cover)

    @property
    def width(self) -> int:
        return self.cover.shape[1]


@dataclass(frozen=True)
class LegendType:
    """The type of a legend: letters of a size in pixels, and lines to match."""

    size: int

    @classmethod
    def of(cls, factor: float, width: int, height: int) -> LegendType:
        return cls(round(factor * max(LEAST, SIZE * min(width, height))))

    @property
    def scale_width(self) -> float:
        """The most pixels that a scale may be long."""
        return SCALE_WIDTH * self.size

    @property
    def _hair(self) -> int:
        return max(1, round(self.size / 16))

    @property
    def _small(self) -> Font:
        return Font(FONT, round(SMALL * self.size), 0.01)

    @property
    def _normal(self) -> Font:
        return Font(FONT, self.size, 0.015)

    def line(self, text: str, ink: Ink) -> DrawnPart:
        """Return one line of text."""
        page = _Page(self._normal.width(text), round(1.12 * self.size))
        page.write(self._normal, text, (0, 0.86 * self.size))
        return page.part(ink, self.size)

    def palette(
        self, label: str, unit: str, ramp: Pixels, marks: list[tuple[float, str]], ink: Ink
    ) -> DrawnPart:
        """Return a palette with its label above and numbers below."""
        size, hair = self.size, self._hair
        wide, high = round(PALETTE_WIDTH * size), max(3, round(PALETTE_HEIGHT * size))
        small = self._small
        titled = self._normal.width(label) + (round(0.5 * size) + small.width(unit) if unit else 0)
        page = _Page(max(wide, titled), round(3.28 * size))
        page.write(self._normal, label, (0, 0.86 * size))
        if unit:
            page.write(small, unit, (self._normal.width(label) + 0.5 * size, 0.86 * size), QUIET)
        top = round(1.42 * size)
        places = (np.arange(wide) + 0.5) / wide
        columns = np.stack([np.interp(places, np.linspace(0, 1, len(ramp)), part) for part in ramp.T], axis=1)
        page.paint(BRIGHTNESS * np.broadcast_to(columns, (high, wide, 3)), 0, top)
        page.frame((0, top, wide, high), hair, KEYLINE)
        for place, text in marks:
            x = min(max(0, round(place * wide - hair / 2)), wide - hair)
            page.cover[top + high : top + high + round(0.26 * size), x : x + hair] = QUIET
            left = x + hair / 2 - small.width(text) / 2
            left = min(max(0.0, left), max(0.0, page.cover.shape[1] - small.width(text)))
            page.write(small, text, (left, top + high + 1.18 * size), QUIET + 0.1)
        return page.part(ink, size)

    def scale(self, length: float, text: str, ink: Ink, from_right: bool) -> DrawnPart:
        """Return a line of a length in pixels between two short ones, with its text above, at one end."""
        size, hair, small = self.size, self._hair, self._small
        wide, written = max(2 * hair, round(length)), small.width(text)
        page = _Page(max(wide, written), round(1.55 * size))
        room = page.cover.shape[1]
        page.write(small, text, ((room - written) * from_right, 0.72 * size), QUIET + 0.1)
        line, first = round(1.36 * size), (room - wide) * from_right
        page.cover[line : line + hair, first : first + wide] = QUIET + 0.1
        for x in (first, first + wide - hair):
            page.cover[line - round(0.26 * size) : line + hair, x : x + hair] = QUIET + 0.1
        return page.part(ink, size)


class _Page:
    def __init__(self, width: int, height: int) -> None:
        self.cover = np.zeros((height, max(1, width)), np.float32)
        self._colours = np.zeros((*self.cover.shape, 3), np.float32)
        self._painted = np.zeros(self.cover.shape, np.float32)

    def write(self, font: Font, text: str, at: tuple[float, float], strength: float = 1.0) -> None:
        """Write a line whose baseline begins at a place."""
        page = np.zeros((*self.cover.shape, 1), np.float32)
        font.write(page, text, at, strength)
        self.cover = np.maximum(self.cover, page[..., 0])

    def paint(self, colours: Pixels, x: int, y: int) -> None:
        high, wide = colours.shape[:2]
        self._colours[y : y + high, x : x + wide] = colours
        self._painted[y : y + high, x : x + wide] = 1.0

    def frame(self, box: tuple[int, int, int, int], line: int, strength: float) -> None:
        """Draw lines along the inner edges of a box: x, y, width and height."""
        x, y, wide, high = box
        inner = np.zeros((high, wide), bool)
        inner[line : high - line, line : wide - line] = True
        part = self.cover[y : y + high, x : x + wide]
        part[~inner] = np.maximum(part[~inner], strength)

    def part(self, ink: Ink, size: int) -> DrawnPart:
        return DrawnPart(self.cover, self._colours, self._painted, ink, size)


def laid_over(light: Pixels, alpha: Pixels, part: DrawnPart, at: tuple[int, int]) -> tuple[Pixels, Pixels]:
    """Return light (H, W, 3) and alpha (H, W) with a part whose upper left corner is at x, y.

    Ink is blended by the roots of light, about as the eye sees steps, so thin strokes keep their weight on
    light and on dark ground.
    """
    around = round(2.0 * HALO * part.size)
    cover, painted, colours = (_padded(each, around) for each in (part.cover, part.painted, part.colours))
    halo = HALO_STRENGTH * np.clip(2.2 * _blurred(cover, HALO * part.size), 0.0, 1.0)
    x, y = at[0] - around, at[1] - around
    high, wide = light.shape[:2]
    rows, columns = (
        slice(max(0, y), min(high, y + len(cover))),
        slice(max(0, x), min(wide, x + cover.shape[1])),
    )
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return light, alpha
    inner = slice(rows.start - y, rows.stop - y), slice(columns.start - x, columns.stop - x)
    cover, painted, colours, halo = (each[inner] for each in (cover, painted, colours, halo))
    front, behind = part.ink.value
    roots = np.sqrt(np.maximum(light[rows, columns], 0.0))
    for weight, value in ((halo, behind), (painted, colours), (cover, front)):
        goal = np.sqrt(np.asarray(value, np.float32))
        roots += (goal - roots) * weight[..., None]
    light, alpha = light.copy(), alpha.copy()
    light[rows, columns] = roots**2
    alpha[rows, columns] = np.maximum(alpha[rows, columns], np.maximum(np.maximum(halo, painted), cover))
    return light.astype(np.float32), alpha.astype(np.float32)


def _padded(values: Pixels, around: int) -> Pixels:
    return np.pad(values, [(around, around), (around, around), (0, 0)][: values.ndim])


def _blurred(values: Pixels, radius: float) -> Pixels:
    """Return values (h, w) blurred by three boxes, nearly a Gaussian."""
    reach = max(1, round(radius / 2.0))
    for axis in (0, 1) * 3:
        padded = np.pad(values, [(reach + 1, reach) if axis == k else (0, 0) for k in (0, 1)])
        sums = np.cumsum(padded, axis=axis, dtype=np.float64)
        ahead, back = (
            np.take(sums, range(2 * reach + 1, sums.shape[axis]), axis),
            np.take(sums, range(sums.shape[axis] - 2 * reach - 1), axis),
        )
        values = (ahead - back) / (2 * reach + 1)
    return values.astype(np.float32)
