"""Flat pictures in wide ones: cards of words stand like a screen before the viewer."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from render.scene.projection import Projection, pixel_places

Floats = NDArray[np.float32]

ANGLE = math.radians(75.0)
"""Horizontal angle of a screen: words that one reads in a headset without turning the head."""

ASPECT = 16 / 9
"""Width to height of a screen in a wide picture."""

_ROWS = 64
"""Rows whose directions are computed at once: those of a whole picture would fill a gigabyte."""


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
        return list(self._find_covered())

    def _find_covered(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]]:
        (width, height), half = self.size, math.tan(ANGLE / 2.0)
        places = pixel_places(*self.picture)
        for row in range(0, len(places), _ROWS):
            right, up, forward = np.moveaxis(self.projection.directions(places[row : row + _ROWS]), -1, 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                x, y = right / forward / half, up / forward / half * width / height
            pixels = np.flatnonzero((forward > 0.0) & (np.abs(x) <= 1.0) & (np.abs(y) <= 1.0))
            across = np.clip((x.ravel()[pixels] + 1.0) * 0.5 * width - 0.5, 0.0, width - 1.001)
            down = np.clip((1.0 - y.ravel()[pixels]) * 0.5 * height - 0.5, 0.0, height - 1.001)
            first = np.floor(down).astype(np.int64) * width + np.floor(across).astype(np.int64)
            right_share, lower_share = (
                (along - np.floor(along)).astype(np.float32)[:, None] for along in (across, down)
            )
            yield pixels + row * self.picture[0], first, right_share, lower_share
