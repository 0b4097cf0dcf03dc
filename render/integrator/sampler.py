"""The sampler of the path tracer: a low-discrepancy sequence, scrambled for each pixel.

The sequence is a digital one in base 2 (Niederreiter 1987): the digits of a coordinate are the digits of the
point's number times a matrix of bits. Coordinates come in pairs of U and P U, where P is Pascal's triangle
modulo 2 and U one of `_PAIRS`. Each pair alone is Sobol's first two dimensions in another order: of 2ⁿ points
from a multiple of 2ⁿ on, none of the elementary rectangles of area 2⁻ⁿ is empty. The orders are the best of
1500 tried for each pair: 4, 16 and 64 points are also even in coordinates of different pairs that act
together, such as the direction from a surface and the position on an emitter.

Each pixel scrambles each coordinate by its own tree of random digit flips (Owen 1995). Scrambled points are
as even as before, and pixels are independent. The tree is a hash of the digits (Laine and Karras 2011, with
Vegdahl's constants), which Burley recommends (*Practical Hash-based Owen Scrambling*, 2020). Later vertices
of a path reuse the coordinates of the first ones; the order of their points is shuffled in the same way, by a
tree for each pixel. Otherwise products of the two would be less even than random numbers. Needs a started
engine.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

_DIGITS = 10
LENGTH = 1 << _DIGITS
"""Points until the sequence repeats."""

_PAIRS = (
    (0x001, 0x002, 0x004, 0x008, 0x010, 0x020, 0x040, 0x080, 0x100, 0x200),
    (0x001, 0x003, 0x006, 0x009, 0x018, 0x02F, 0x04F, 0x0E8, 0x1D6, 0x2CE),
    (0x001, 0x003, 0x006, 0x00D, 0x01F, 0x025, 0x04B, 0x0DE, 0x13E, 0x28E),
    (0x001, 0x003, 0x005, 0x00E, 0x012, 0x031, 0x068, 0x0DB, 0x17D, 0x2D3),
    (0x001, 0x002, 0x005, 0x00A, 0x01A, 0x02B, 0x06C, 0x082, 0x13E, 0x3A1),
    (0x001, 0x002, 0x007, 0x009, 0x01A, 0x02F, 0x06A, 0x0CA, 0x1F9, 0x399),
    (0x001, 0x002, 0x005, 0x00B, 0x011, 0x03C, 0x047, 0x09E, 0x163, 0x2E0),
    (0x001, 0x002, 0x004, 0x008, 0x011, 0x03E, 0x055, 0x0EA, 0x1E6, 0x276),
    (0x001, 0x002, 0x007, 0x009, 0x012, 0x03C, 0x04A, 0x097, 0x16B, 0x280),
    (0x001, 0x003, 0x006, 0x008, 0x016, 0x03C, 0x04C, 0x0AB, 0x151, 0x3BD),
    (0x001, 0x003, 0x005, 0x00F, 0x016, 0x026, 0x06E, 0x0F7, 0x12D, 0x2B5),
)
"""Columns of each U: bit r is the digit 2^-(r + 1). Pairs are for the pixel, the lens and, of three vertices
of a path each: position on an emitter, next direction, choices of lobe and emitter."""

COORDINATES = 2 * len(_PAIRS)

PIXEL, LENS, _VERTEX = 0, 2, 4
EMITTER_POSITION, DIRECTION, LOBE, EMITTER_CHOICE = 0, 2, 4, 5
"""Coordinates: of a sample, and of each vertex of its path."""

_PER_VERTEX = 6
_VERTICES = (COORDINATES - _VERTEX) // _PER_VERTEX
"""Vertices with coordinates of their own. Later vertices use the same, shuffled and scrambled differently."""

_REPETITION = 1 << 16
"""Distance between the numbers of scrambles of one coordinate that is used repeatedly at a vertex."""


class OwenSampler:
    """Random numbers for some samples of every pixel.

    pixels  unique numbers of the pixels
    first   samples that the pixels have had before
    count   number of samples
    seed    of the picture

    Set `sample`, from 0 to `count`, before drawing.
    """

    def __init__(self, pixels: Any, first: int, count: int, seed: int) -> None:
        import drjit as dr
        import mitsuba as mi

        self._points = mi.UInt32(_all_points())
        self._first = dr.opaque(mi.UInt32, first % LENGTH)
        self.count = dr.opaque(mi.UInt32, count)
        epoch = dr.opaque(mi.UInt32, (seed + first // LENGTH) % 2**32)
        self._key = _hash(_hash(pixels) ^ epoch)
        self.sample = mi.UInt32(0)

    def sample_2d(self, coordinate: int) -> Any:
        """Return two numbers of the sample, for PIXEL or LENS."""
        import mitsuba as mi

        columns = (mi.UInt32(coordinate), mi.UInt32(coordinate + 1))
        return mi.Point2f(*(self._number(column, column, self._digits) for column in columns))

    def vertex_1d(self, vertex: Any, coordinate: int, repetition: Any = 0) -> Any:
        """Return a number for LOBE or EMITTER_CHOICE at a vertex of the path, counted from 0.

        From vertex _VERTICES on, the order of the points is shuffled.
        """
        import drjit as dr

        reuse = vertex // _VERTICES
        shuffled = _scramble(self._digits, _hash(self._key + reuse)) & (LENGTH - 1)
        digits = dr.select(reuse == 0, self._digits, shuffled)
        row = _VERTEX + vertex % _VERTICES * _PER_VERTEX + coordinate
        scramble = _VERTEX + vertex * _PER_VERTEX + coordinate + repetition * _REPETITION
        return self._number(row, scramble, digits)

    def vertex_2d(self, vertex: Any, coordinate: int, repetition: Any = 0) -> Any:
        """Return two numbers for EMITTER_POSITION or DIRECTION, independent for each `repetition`."""
        import mitsuba as mi

        return mi.Point2f(*(self.vertex_1d(vertex, coordinate + i, repetition) for i in (0, 1)))

    @property
    def _digits(self) -> Any:
        """Digits of the point's number, reversed: bit 0 is a half of LENGTH."""
        import drjit as dr

        return dr.brev(self._first + self.sample) >> (32 - _DIGITS)

    def _number(self, row: Any, scramble: Any, digits: Any) -> Any:
        """Return a scrambled number from 0 to 1, excluding 1: a coordinate of the point with these digits."""
        import drjit as dr
        import mitsuba as mi

        point = dr.gather(mi.UInt32, self._points, row * LENGTH + digits)
        point = _scramble(point, _hash(self._key ^ (scramble * 0x9E3779B9)))
        return mi.Float(dr.brev(point) >> 8) * 2.0**-24


def _scramble(digits: Any, key: Any) -> Any:
    """Flip reversed digits at random, each by those before it (Laine and Karras 2011)."""
    digits = digits ^ digits * 0x3D20ADEA
    digits += key
    digits *= (key >> 16) | 1
    digits ^= digits * 0x05526C56
    digits ^= digits * 0x53A22864
    return digits


def _hash(number: Any) -> Any:
    """Return a 32-bit hash (triple rounds of Wellons' search for good ones, 2018)."""
    number = number ^ (number >> 16)
    number = number * 0x21F0AAAD
    number = number ^ (number >> 15)
    number = number * 0xD35A2D97
    return number ^ (number >> 15)


def points(first: int, count: int) -> NDArray[np.uint32]:
    """Return points from number `first` on, (COORDINATES, count), digits reversed: bit 0 is a half."""
    numbers = (first + np.arange(count)) % LENGTH
    bits = (numbers[:, None] >> np.arange(_DIGITS)) & 1
    digits = [np.bitwise_xor.reduce(bits * matrix, axis=1) for matrix in _matrices()]
    return np.array(digits, dtype=np.uint32)


@cache
def _all_points() -> NDArray[np.uint32]:
    """Return all points, (COORDINATES * LENGTH,), in the order of their numbers with digits reversed."""
    bits = np.arange(LENGTH)[:, None] >> np.arange(_DIGITS) & 1
    return points(0, LENGTH)[:, bits @ (1 << np.arange(_DIGITS)[::-1])].ravel()


@cache
def _matrices() -> list[NDArray[np.int64]]:
    """Return the matrices of all coordinates, by columns of bits."""
    pascal = [sum((math.comb(c, r) & 1) << r for r in range(_DIGITS)) for c in range(_DIGITS)]
    matrices = []
    for columns in _PAIRS:
        product = [_product(pascal, column) for column in columns]
        matrices += [np.array(columns), np.array(product)]
    return matrices


def _product(matrix: list[int], vector: int) -> int:
    """Return a matrix, given by columns of bits, times a vector of bits."""
    result = 0
    for r, column in enumerate(matrix):
        if vector >> r & 1:
            result ^= column
    return result
