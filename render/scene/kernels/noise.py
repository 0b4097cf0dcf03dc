"""Kernels: noise for patterns. NumPy would need some four hundred passes over the points per octave."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from render.base.kernel_cache import compiled

Vectors = NDArray[np.float64]

_WORD = np.uint64(0xFFFFFFFF)


@compiled()
def hash_word(word: np.uint64) -> np.uint64:
    """Return the finaliser of MurmurHash3 (Appleby, public domain) of 32 bits."""
    word = (word ^ (word >> np.uint64(16))) * np.uint64(0x85EBCA6B) & _WORD
    word = (word ^ (word >> np.uint64(13))) * np.uint64(0xC2B2AE35) & _WORD
    return word ^ (word >> np.uint64(16))


@compiled()
def cell_numbers(x: int, y: int, z: int, seed: int, numbers: Vectors) -> None:
    """Write numbers from 0 to 1 into `numbers`, decided by the lattice cell and the seed."""
    a = np.uint64(x) * np.uint64(0x8DA6B343)
    b = np.uint64(y) * np.uint64(0xD8163841)
    c = np.uint64(z) * np.uint64(0xCB1AB31F)
    word = hash_word(((a ^ b ^ c) + np.uint64(seed)) & _WORD)
    for channel in range(len(numbers)):
        word = hash_word((word + np.uint64(0x9E3779B9)) & _WORD)
        numbers[channel] = word / 4294967296.0


@compiled()
def add_value_noise(points: Vectors, seed: int, strength: float, total: Vectors) -> None:
    """Add noise of three channels at points (N, 3), between −strength and strength, to `total` (N, 3).

    Interpolates the eight values of the lattice cell, with a quintic fade.
    """
    cell, fade, numbers = np.zeros(3, np.int64), np.zeros(3), np.zeros(3)
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
            cell_numbers(cell[0] + dx, cell[1] + dy, cell[2] + dz, seed, numbers)
            for channel in range(3):
                total[i, channel] += strength * weight * (2.0 * numbers[channel] - 1.0)


@compiled()
def find_spots(points: Vectors, seed: int, nearest: Vectors) -> None:
    """Write the distance from points (N, 3) to the nearest spot, over its size, into `nearest` (N,)."""
    numbers = np.zeros(4)
    for i in range(len(points)):
        x, y, z = points[i]
        low = (math.floor(x), math.floor(y), math.floor(z))
        best = math.inf
        for neighbour in range(27):
            cx, cy, cz = (
                low[0] + neighbour // 9 - 1,
                low[1] + neighbour // 3 % 3 - 1,
                low[2] + neighbour % 3 - 1,
            )
            cell_numbers(cx, cy, cz, seed, numbers)
            dx, dy, dz = x - cx - numbers[0], y - cy - numbers[1], z - cz - numbers[2]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            best = min(best, distance / (0.5 + 0.5 * numbers[3]))
        nearest[i] = best
