"""A low-discrepancy sequence for the samples of a pixel: every prefix of it is spread evenly.

A digital sequence in base 2 (Niederreiter 1987): the digits of a coordinate are the digits of the point's
number times a matrix of bits. Coordinates come in pairs of U and P U, where P is Pascal's triangle modulo 2
and U one of `_PAIRS`. Each pair alone is Sobol's first two dimensions in another order: of 2ⁿ points from a
multiple of 2ⁿ on, none of the elementary rectangles of area 2⁻ⁿ is empty. The orders are the best of 1500
tried for each pair: 4, 16 and 64 points are also even in coordinates of different pairs that act together,
such as the direction from a surface and the position on an emitter.
"""

from __future__ import annotations

import math
from functools import cache

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


def points(first: int, count: int) -> NDArray[np.uint32]:
    """Return points from number `first` on, (COORDINATES, count), digits reversed: bit 0 is a half."""
    numbers = (first + np.arange(count)) % LENGTH
    bits = (numbers[:, None] >> np.arange(_DIGITS)) & 1
    digits = [np.bitwise_xor.reduce(bits * matrix, axis=1) for matrix in _matrices()]
    return np.array(digits, dtype=np.uint32)


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
