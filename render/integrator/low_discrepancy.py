"""A sequence of points of which every beginning is spread evenly, for the samples of a pixel.

A digital sequence in base 2 (Niederreiter 1987): the digits of a coordinate are the digits of the point's
number times a matrix of bits. The coordinates come in pairs of U and P U, where P is Pascal's triangle and U
one of `_PAIRS`: by each pair alone the points are Sobol's first two coordinates in another order, so that 2ⁿ
of them, from a multiple of 2ⁿ on, leave no rectangle of area 2⁻ⁿ empty. The orders were found by trying 1500
for each pair: so that 4, 16 and 64 points are even too by coordinates of different pairs that decide together
what a path finds, such as where it leaves a surface and where on a lamp it looks then.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

_DIGITS = 10
LENGTH = 1 << _DIGITS
"""Points until it begins again."""

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
"""Columns of each U: bit r is the digit 2^-(r + 1). Of the pixel, the lens, and of each of three vertices of
a path: the place on a lamp, the way on, and the choices of lobe and lamp."""

COORDINATES = 2 * len(_PAIRS)


def points(first: int, count: int) -> NDArray[np.uint32]:
    """(COORDINATES, count) of the points from number `first` on, their digits in reverse: bit 0 is a half."""
    numbers = (first + np.arange(count)) % LENGTH
    bits = (numbers[:, None] >> np.arange(_DIGITS)) & 1
    found = [np.bitwise_xor.reduce(bits * column, axis=1) for column in _columns()]
    return np.array(found, dtype=np.uint32)


@cache
def _columns() -> list[NDArray[np.int64]]:
    """Of the matrices of all coordinates."""
    pascal = [sum((math.comb(c, r) & 1) << r for r in range(_DIGITS)) for c in range(_DIGITS)]
    found = []
    for pair in _PAIRS:
        turned = [_product(pascal, column) for column in pair]
        found += [np.array(pair), np.array(turned)]
    return found


def _product(matrix: list[int], vector: int) -> int:
    """Of bits, columns of the matrix given."""
    found = 0
    for r, column in enumerate(matrix):
        if vector >> r & 1:
            found ^= column
    return found
