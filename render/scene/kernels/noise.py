"""Noise at many points, compiled: NumPy would walk them some four hundred times an octave."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Rows = NDArray[np.float64]

_WORD = np.uint64(0xFFFFFFFF)


@compiled()
def mixed(word: np.uint64) -> np.uint64:
    """The finaliser of MurmurHash3 (Appleby, public domain) on 32 bits."""
    word = (word ^ (word >> np.uint64(16))) * np.uint64(0x85EBCA6B) & _WORD
    word = (word ^ (word >> np.uint64(13))) * np.uint64(0xC2B2AE35) & _WORD
    return word ^ (word >> np.uint64(16))


@compiled()
def draw(x: int, y: int, z: int, seed: int, drawn: Rows) -> None:
    """Numbers from 0 to 1 into `drawn`: the same for the same cell and seed, everywhere."""
    a = np.uint64(x) * np.uint64(0x8DA6B343)
    b = np.uint64(y) * np.uint64(0xD8163841)
    c = np.uint64(z) * np.uint64(0xCB1AB31F)
    word = mixed(((a ^ b ^ c) + np.uint64(seed)) & _WORD)
    for channel in range(len(drawn)):
        word = mixed((word + np.uint64(0x9E3779B9)) & _WORD)
        drawn[channel] = word / 4294967296.0


@compiled()
def add_value_noise(points: Rows, seed: int, strength: float, total: Rows) -> None:
    """Adds to `total` (N, 3) noise of three channels at points (N, 3), between −strength and strength.

    Cubic interpolation of the eight values around, quintic fade.
    """
    cell, fade, drawn = np.zeros(3, np.int64), np.zeros(3), np.zeros(3)
    for i in range(len(points)):
        for axis in range(3):
            low = math.floor(points[i, axis])
            t = points[i, axis] - low
            cell[axis] = int(low)
            fade[axis] = t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
        for corner in range(8):
            dx, dy, dz = corner >> 2, corner >> 1 & 1, corner & 1
            weight = fade[0] if dx else 1.0 - fade[0]
            weight *= fade[1] if dy else 1.0 - fade[1]
            weight *= fade[2] if dz else 1.0 - fade[2]
            draw(cell[0] + dx, cell[1] + dy, cell[2] + dz, seed, drawn)
            for channel in range(3):
                total[i, channel] += strength * weight * (2.0 * drawn[channel] - 1.0)


@compiled()
def find_spots(points: Rows, seed: int, nearest: Rows) -> None:
    """Into `nearest` (N,) the distance from points (N, 3) to the spot that is nearest for its size."""
    drawn = np.zeros(4)
    for i in range(len(points)):
        x, y, z = points[i]
        low = (math.floor(x), math.floor(y), math.floor(z))
        best = math.inf
        for there in range(27):
            cx, cy, cz = low[0] + there // 9 - 1, low[1] + there // 3 % 3 - 1, low[2] + there % 3 - 1
            draw(cx, cy, cz, seed, drawn)
            dx, dy, dz = x - cx - drawn[0], y - cy - drawn[1], z - cz - drawn[2]
            away = math.sqrt(dx * dx + dy * dy + dz * dz)
            best = min(best, away / (0.5 + 0.5 * drawn[3]))
        nearest[i] = best
