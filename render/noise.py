"""Noise for patterns: displacements that vary smoothly, and spots scattered evenly; seeded, without state."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float64]
Words = NDArray[np.uint32]

_STRIDES = np.array([0x8DA6B343, 0xD8163841, 0xCB1AB31F], dtype=np.uint32)


def fractal_noise(points: Rows, octaves: int, seed: int) -> Rows:
    """(N, 3) displacements at points (N, 3): value noise of three channels, each octave twice as fine and
    half as strong; about 0.3 root mean square, and never above 1.

    Cubic interpolation of the eight values around (quintic fade after Perlin, *Improving noise*, 2002).
    """
    total, strength, turn = np.zeros((len(points), 3)), 0.5, _turn()
    place = np.asarray(points, dtype=np.float64)
    for octave in range(octaves):
        total += strength * _value_noise(place, 0x9E3779B9 * (octave + 1) + seed)
        strength *= 0.5
        place = 2.0 * place @ turn + 17.31  # lattices of two octaves never lie in each other
    return total


def nearest_spot(points: Rows, seed: int) -> NDArray[np.float64]:
    """(N,): distance to the spot that is nearest for its size, in spots of full size; cells are units.

    One spot a cell (Worley, *A cellular texture basis function*, SIGGRAPH 1996), between half and full size.
    """
    cell = np.floor(points)
    best = np.full(len(points), np.inf)
    for step in itertools.product((-1.0, 0.0, 1.0), repeat=3):
        there = cell + step
        random = _random(there, seed, 4)
        away = np.linalg.norm(points - (there + random[:, :3]), axis=1)
        best = np.minimum(best, away / (0.5 + 0.5 * random[:, 3]))
    return best


def _value_noise(points: Rows, seed: int) -> Rows:
    """(N, 3): between −1 and 1."""
    cell = np.floor(points)
    t = points - cell
    fade = t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    total = np.zeros((len(points), 3))
    for corner in itertools.product((0.0, 1.0), repeat=3):
        weight = np.prod(np.where(corner, fade, 1.0 - fade), axis=1)
        total += weight[:, None] * (2.0 * _random(cell + corner, seed, 3) - 1.0)
    return total


def _random(cells: Rows, seed: int, channels: int) -> Rows:
    """(N, channels) of 0 … 1: the same for the same whole numbers and seed, everywhere.

    Mixed by the finaliser of MurmurHash3 (Appleby, public domain).
    """
    words = (cells.astype(np.int64) & 0xFFFFFFFF).astype(np.uint32) * _STRIDES
    word = _mixed((words[:, 0] ^ words[:, 1] ^ words[:, 2]) + np.uint32(seed & 0xFFFFFFFF))
    drawn = []
    for _ in range(channels):
        word = _mixed(word + np.uint32(0x9E3779B9))
        drawn.append(word / 2.0**32)
    return np.stack(drawn, axis=1)


def _mixed(words: Words) -> Words:
    words = (words ^ (words >> np.uint32(16))) * np.uint32(0x85EBCA6B)
    words = (words ^ (words >> np.uint32(13))) * np.uint32(0xC2B2AE35)
    return words ^ (words >> np.uint32(16))


def _turn() -> Rows:
    """A rotation by an angle that no lattice repeats under, about (1, 1, 1)."""
    axis, angle = np.full(3, 1.0 / math.sqrt(3.0)), 1.0
    across = np.cross(np.eye(3), axis)
    return np.asarray(np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * across @ across)
