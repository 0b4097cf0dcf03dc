"""The random numbers of paths, drawn by compiled code from `render.integrator.low_discrepancy`.

Each pixel scrambles the sequence for itself, each coordinate by a tree of random turns (Owen 1995), which
leaves points as even as they were and makes pixels know nothing of each other. The tree is a hash of the
digits (Laine and Karras 2011, with Vegdahl's constants), as Burley found it to be good enough (*Practical
Hash-based Owen Scrambling*, 2020). An engine must have been started before anything here is called.
"""

from __future__ import annotations

from typing import Any

from render.integrator import low_discrepancy as sequence

PIXEL, LENS, _VERTEX = 0, 2, 4
LAMP, ONWARDS, LOBE, CHOICE = 0, 2, 4, 5
"""Coordinates, of a sample and of each vertex of its path."""

_OF_A_VERTEX = 6
_ALIKE = (sequence.COORDINATES - _VERTEX) // _OF_A_VERTEX
"""Vertices with coordinates of their own; those after them take the same ones scrambled otherwise."""

_ANOTHER = 1 << 16
"""What numbers of draws are apart that take the same coordinate for different things."""


class Draws:
    """Of some samples of every pixel.

    pixels  which these are, numbered so that no two are the same
    first   how many samples the pixel has had before
    seed    of the picture

    `sample`, from 0 to `count`, is set to the one that is drawn for.
    """

    def __init__(self, pixels: Any, first: int, count: int, seed: int) -> None:
        import drjit as dr
        import mitsuba as mi

        self._points = mi.UInt32(sequence.points(first, count).ravel())
        self.count = dr.opaque(mi.UInt32, count)
        self._key = _mixed(_mixed(pixels) ^ dr.opaque(mi.UInt32, (seed + first // sequence.LENGTH) % 2**32))
        self.sample = mi.UInt32(0)

    def of_sample(self, coordinate: int) -> Any:
        """Two numbers for PIXEL or LENS."""
        import mitsuba as mi

        return mi.Point2f(*(self._number(mi.UInt32(c), mi.UInt32(c)) for c in (coordinate, coordinate + 1)))

    def one(self, vertex: Any, coordinate: int) -> Any:
        """A number for LOBE or CHOICE at a vertex of the path, counted from 0."""
        return self._number(*self._place(vertex, coordinate, 0))

    def two(self, vertex: Any, coordinate: int, again: int = 0) -> Any:
        """Two numbers for LAMP or ONWARDS. again: of how many others that know nothing of these"""
        import mitsuba as mi

        return mi.Point2f(*(self._number(*self._place(vertex, coordinate + i, again)) for i in (0, 1)))

    def _place(self, vertex: Any, coordinate: int, again: int) -> tuple[Any, Any]:
        """A row of the table, and the number of what is drawn."""
        row = _VERTEX + vertex % _ALIKE * _OF_A_VERTEX + coordinate
        return row, _VERTEX + vertex * _OF_A_VERTEX + coordinate + again * _ANOTHER

    def _number(self, row: Any, drawn: Any) -> Any:
        """From 0 to 1, 1 excluded."""
        import drjit as dr
        import mitsuba as mi

        digits = dr.gather(mi.UInt32, self._points, row * self.count + self.sample)
        turns = _mixed(self._key ^ (drawn * 0x9E3779B9))
        digits ^= digits * 0x3D20ADEA
        digits += turns
        digits *= (turns >> 16) | 1
        digits ^= digits * 0x05526C56
        digits ^= digits * 0x53A22864
        return mi.Float(dr.brev(digits) >> 8) * 2.0**-24


def _mixed(number: Any) -> Any:
    """A hash of 32 bits (triple rounds of Wellons' search for good ones, 2018)."""
    number = number ^ (number >> 16)
    number = number * 0x21F0AAAD
    number = number ^ (number >> 15)
    number = number * 0xD35A2D97
    return number ^ (number >> 15)
