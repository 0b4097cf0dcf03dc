"""Kernels of temporal denoising: reproject pixels to another frame and average their light."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Floats = NDArray[np.float32]


@compiled()
def accumulate(
    frame: Floats,
    neighbour: Floats,
    pixels: Floats,
    points: Floats,
    tolerance: Floats,
    spread: Floats,
    total: Floats,
) -> None:
    """Add a neighbour's light to `total` where it shows the same points in the same light.

    frame      (H, W, 4): light and matte of the frame
    neighbour  (H, W, 7): light, matte and position of the other frame
    pixels     (H, W, 2): column and row of each pixel's point in the other frame; pixel centres are whole
    points     (H, W, 3): the position of that point then
    tolerance  (H, W): distance between that position and the one found
    spread     (H, W): standard deviation of the light, as a share of it
    total      (H, W, 4): light times weight, and the weight
    """
    height, width = frame.shape[:2]
    values = np.zeros(7)
    for y in range(height):
        for x in range(width):
            column, row = pixels[y, x, 0], pixels[y, x, 1]
            if not (0.0 <= column <= width - 1.0 and 0.0 <= row <= height - 1.0):
                continue
            _sample(neighbour, column, row, values)
            if abs(values[3] - frame[y, x, 3]) > 0.1:
                continue
            distance = 0.0
            for axis in range(3):
                distance += (values[4 + axis] - points[y, x, axis]) ** 2
            if not distance <= tolerance[y, x] ** 2:
                continue
            difference, light = 0.0, 0.02
            for channel in range(3):
                difference = max(difference, abs(values[channel] - frame[y, x, channel]))
                light = max(light, max(values[channel], frame[y, x, channel]))
            weight = math.exp(-0.5 * (difference / (light * spread[y, x])) ** 2)
            for channel in range(3):
                total[y, x, channel] += weight * values[channel]
            total[y, x, 3] += weight


@compiled()
def sample_bilinear(picture: Floats, pixels: Floats, sampled: Floats) -> None:
    """Sample `picture` (H, W, C) at columns and rows `pixels` (H, W, 2) into `sampled` (H, W, C)."""
    height, width = picture.shape[:2]
    values = np.zeros(picture.shape[2])
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            column = min(max(pixels[y, x, 0], 0.0), width - 1.0)
            row = min(max(pixels[y, x, 1], 0.0), height - 1.0)
            _sample(picture, column, row, values)
            sampled[y, x, :] = values


@compiled()
def _sample(picture: Floats, column: float, row: float, values: NDArray[np.float64]) -> None:
    """Interpolate between four pixels, bilinearly."""
    left, top = int(column), int(row)
    right, bottom = min(left + 1, picture.shape[1] - 1), min(top + 1, picture.shape[0] - 1)
    u, v = column - left, row - top
    for channel in range(picture.shape[2]):
        upper = picture[top, left, channel] * (1.0 - u) + picture[top, right, channel] * u
        lower = picture[bottom, left, channel] * (1.0 - u) + picture[bottom, right, channel] * u
        values[channel] = upper * (1.0 - v) + lower * v
