"""Following pixels to another frame and taking in what they find there, compiled: NumPy would walk both
frames some fifty times."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Floats = NDArray[np.float32]


@compiled()
def take_in(
    here: Floats,
    there: Floats,
    places: Floats,
    arrivals: Floats,
    reach: Floats,
    spread: Floats,
    total: Floats,
) -> None:
    """Add to `total` what pixels of one frame find in another, as far as they find themselves.

    here      (H, W, 4): light and matte of the frame
    there     (H, W, 7): light, matte and position of the other
    places    (H, W, 2): where in the other picture a pixel's point is, column and row; centres are whole
    arrivals  (H, W, 3): where in the scene it is then
    reach     (H, W): how far from there what is seen may be
    spread    (H, W): how much light may differ, as a share of it
    total     (H, W, 4): light times weight, and the weight
    """
    height, width = here.shape[:2]
    found = np.zeros(7)
    for y in range(height):
        for x in range(width):
            column, row = places[y, x, 0], places[y, x, 1]
            if not (0.0 <= column <= width - 1.0 and 0.0 <= row <= height - 1.0):
                continue
            _fetch(there, column, row, found)
            if abs(found[3] - here[y, x, 3]) > 0.1:
                continue
            away = 0.0
            for axis in range(3):
                away += (found[4 + axis] - arrivals[y, x, axis]) ** 2
            if not away <= reach[y, x] ** 2:
                continue
            apart, light = 0.0, 0.02
            for channel in range(3):
                apart = max(apart, abs(found[channel] - here[y, x, channel]))
                light = max(light, max(found[channel], here[y, x, channel]))
            weight = math.exp(-0.5 * (apart / (light * spread[y, x])) ** 2)
            for channel in range(3):
                total[y, x, channel] += weight * found[channel]
            total[y, x, 3] += weight


@compiled()
def fetch_all(picture: Floats, places: Floats, found: Floats) -> None:
    """Read `picture` (H, W, C) between its pixels, at `places` (H, W, 2), into `found` (H, W, C)."""
    height, width = picture.shape[:2]
    values = np.zeros(picture.shape[2])
    for y in range(places.shape[0]):
        for x in range(places.shape[1]):
            column = min(max(places[y, x, 0], 0.0), width - 1.0)
            row = min(max(places[y, x, 1], 0.0), height - 1.0)
            _fetch(picture, column, row, values)
            found[y, x, :] = values


@compiled()
def _fetch(picture: Floats, column: float, row: float, found: NDArray[np.float64]) -> None:
    """The values at a place, weighted by distance between the four pixels around it."""
    left, top = int(column), int(row)
    right, bottom = min(left + 1, picture.shape[1] - 1), min(top + 1, picture.shape[0] - 1)
    u, v = column - left, row - top
    for channel in range(picture.shape[2]):
        upper = picture[top, left, channel] * (1.0 - u) + picture[top, right, channel] * u
        lower = picture[bottom, left, channel] * (1.0 - u) + picture[bottom, right, channel] * u
        found[channel] = upper * (1.0 - v) + lower * v
