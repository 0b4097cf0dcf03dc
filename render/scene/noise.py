"""Noise for patterns, by kernels: NumPy would need some four hundred passes over the points per octave."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.kernel_cache import compiled

Vectors = NDArray[np.float64]
Numbers = NDArray[np.float64]

_SEEDS = 2**32

_WORD = np.uint64(0xFFFFFFFF)

FINER, SHRINKS, JITTER = 2.17, 2.5, 0.85
"""Chips of the next generation are so much smaller; the gap around the smallest chips, in gaps; and how far
in a cell its point may lie."""


def fractal_noise(points: Vectors, octaves: int, seed: int) -> Vectors:
    """Return displacements (N, 3) at points (N, 3): value noise with three channels.

    Each octave is twice as fine and half as strong. The displacement is about 0.3 root mean square and never
    above 1. Interpolates the eight values of a lattice cell (quintic fade of Perlin, *Improving noise*,
    2002).
    """
    total, strength, turn = np.zeros((len(points), 3)), 0.5, rotation()
    lattice = np.ascontiguousarray(points, dtype=np.float64)
    for octave in range(octaves):
        _add_value_noise(lattice, (0x9E3779B9 * (octave + 1) + seed) % _SEEDS, strength, total)
        strength *= 0.5
        if octave < octaves - 1:
            lattice = 2.0 * lattice @ turn + 17.31  # lattices of two octaves never coincide
    return total


def spots(points: Vectors, seed: int) -> tuple[Numbers, Numbers]:
    """Return a number (N,) from 0 to 1 of the spot nearest to each point (N, 3), and the distance (N,) to it
    over its size.

    Each unit cell has one spot, of size 0.5 to 1 (Worley, *A cellular texture basis function*, 1996).
    """
    choice, nearest = np.empty(len(points)), np.empty(len(points))
    _find_spots(np.ascontiguousarray(points, dtype=np.float64), seed % _SEEDS, choice, nearest)
    return choice, nearest


def chips(points: Vectors, seed: int, share: float, gap: float, sizes: int) -> tuple[Numbers, Numbers]:
    """Return a number (N,) from 0 to 1 of the chip at each point (N, 3), and the depth (N,) within it.

    The depth is 0 or less outside, and grows by 1 in half a cell. Chips are the Voronoi cells of one point in
    each unit cell, less their borders.

    share  fraction of cells that have a chip
    gap    least distance between chips, in unit cells; more around some
    sizes  generations of chips, each FINER times as fine as the one before and in the gaps of it
    """
    choice, depth = np.empty(len(points)), np.empty(len(points))
    lattice = np.ascontiguousarray(points, dtype=np.float64)
    _find_chips(lattice, seed % _SEEDS, share, gap, sizes, choice, depth)
    return choice, depth


def rotation() -> Vectors:
    """Return a rotation (3, 3) by 1 radian about (1, 1, 1), under which no lattice repeats."""
    axis, angle = np.full(3, 1.0 / math.sqrt(3.0)), 1.0
    across = np.cross(np.eye(3), axis)
    return np.asarray(np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * across @ across)


@compiled()
def _hash_word(word: np.uint64) -> np.uint64:
    """Return the finaliser of MurmurHash3 (Appleby, public domain) of 32 bits."""
    word = (word ^ (word >> np.uint64(16))) * np.uint64(0x85EBCA6B) & _WORD
    word = (word ^ (word >> np.uint64(13))) * np.uint64(0xC2B2AE35) & _WORD
    return word ^ (word >> np.uint64(16))


@compiled()
def _cell_numbers(x: int, y: int, z: int, seed: int, numbers: Vectors) -> None:
    """Write numbers from 0 to 1 into `numbers`, decided by the lattice cell and the seed."""
    a = np.uint64(x) * np.uint64(0x8DA6B343)
    b = np.uint64(y) * np.uint64(0xD8163841)
    c = np.uint64(z) * np.uint64(0xCB1AB31F)
    word = _hash_word(((a ^ b ^ c) + np.uint64(seed)) & _WORD)
    for channel in range(len(numbers)):
        word = _hash_word((word + np.uint64(0x9E3779B9)) & _WORD)
        numbers[channel] = word / 4294967296.0


@compiled()
def _add_value_noise(points: Vectors, seed: int, strength: float, total: Vectors) -> None:
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
            _cell_numbers(cell[0] + dx, cell[1] + dy, cell[2] + dz, seed, numbers)
            for channel in range(3):
                total[i, channel] += strength * weight * (2.0 * numbers[channel] - 1.0)


@compiled()
def _find_spots(points: Vectors, seed: int, choice: Numbers, nearest: Numbers) -> None:
    """Write the results of `spots`."""
    numbers = np.zeros(5)
    for i in range(len(points)):
        x, y, z = points[i]
        low = math.floor(x), math.floor(y), math.floor(z)
        best = math.inf
        for neighbour in range(27):
            cx, cy = low[0] + neighbour // 9 - 1, low[1] + neighbour // 3 % 3 - 1
            cz = low[2] + neighbour % 3 - 1
            _cell_numbers(cx, cy, cz, seed, numbers)
            dx, dy, dz = x - cx - numbers[0], y - cy - numbers[1], z - cz - numbers[2]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz) / (0.5 + 0.5 * numbers[3])
            if distance < best:
                best, choice[i] = distance, numbers[4]
        nearest[i] = best


@compiled()
def _find_chips(
    points: Vectors, seed: int, share: float, gap: float, sizes: int, choice: Numbers, depth: Numbers
) -> None:
    """Write the results of `chips`. `pattern_textures` has the same for compiled variants."""
    numbers, p, found = np.zeros(6), np.zeros(3), np.zeros(3)
    for i in range(len(points)):
        p[:] = points[i]
        clear, depth[i] = math.inf, 0.0
        for size in range(sizes):
            inside, outside, choice[i] = _find_chip(
                p, seed + size, share, gap, size < sizes - 1, numbers, found
            )
            depth[i] = min(inside, 2.0 * clear - gap) if size else inside
            if depth[i] > 0.0:
                break
            clear = FINER * min(clear, outside)
            p *= FINER


@compiled()
def _least_squared(cell: tuple[int, int, int], p: Vectors) -> float:
    """Return the least squared distance of a point from where the point of a cell of chips may lie."""
    squared = 0.0
    for k in range(3):
        away = abs(p[k] - cell[k] - 0.5) - 0.5 * JITTER
        if away > 0.0:
            squared += away * away
    return squared


@compiled()
def _find_chip(
    p: Vectors, seed: int, share: float, gap: float, is_measured: bool, numbers: Numbers, found: Numbers
) -> tuple[float, float, float]:
    """Return the depth of a point in its chip, its distance to all chips if it is outside, and the number.

    is_measured  whether the distance is needed; otherwise it may be any
    """
    low = math.floor(p[0]), math.floor(p[1]), math.floor(p[2])
    best, border, choice, is_there, cell = math.inf, 0.0, 0.0, False, low
    for step in range(27):
        neighbour = (step + 13) % 27  # the nearest first
        at = low[0] + neighbour // 9 - 1, low[1] + neighbour // 3 % 3 - 1, low[2] + neighbour % 3 - 1
        if _least_squared(at, p) > best:
            continue
        _cell_numbers(at[0], at[1], at[2], seed, numbers)
        distance = 0.0
        for k in range(3):
            distance += (at[k] + 0.5 + JITTER * (numbers[k] - 0.5) - p[k]) ** 2
        if distance < best:
            best, choice, cell, is_there = distance, numbers[4], at, numbers[5] < share
            border = gap * (0.5 + SHRINKS * numbers[3] ** 2)
            for k in range(3):
                found[k] = at[k] + 0.5 + JITTER * (numbers[k] - 0.5)
    edge, outside, radius = math.inf, math.inf, math.sqrt(best)
    for step in range(1, 27):
        neighbour = (step + 13) % 27
        at = cell[0] + neighbour // 9 - 1, cell[1] + neighbour // 3 % 3 - 1, cell[2] + neighbour % 3 - 1
        if 0.5 * (math.sqrt(_least_squared(at, p)) - radius) > (max(edge, outside) if is_measured else edge):
            continue  # no plane half way to a point there is nearer
        _cell_numbers(at[0], at[1], at[2], seed, numbers)
        along, length = 0.0, 0.0
        for k in range(3):
            other = at[k] + 0.5 + JITTER * (numbers[k] - 0.5)
            along += (0.5 * (other + found[k]) - p[k]) * (other - found[k])
            length += (other - found[k]) ** 2
        distance = along / math.sqrt(max(length, 1e-12))
        edge = min(edge, distance)
        if numbers[5] < share:
            outside = min(outside, distance + gap * (0.5 + SHRINKS * numbers[3] ** 2))
    if is_there:
        return 2.0 * (edge - border), min(outside, border - edge), choice
    return -1.0, outside, choice
