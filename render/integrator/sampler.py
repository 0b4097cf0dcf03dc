"""The sampler of the path tracer: Owen-scrambled points of `render.integrator.low_discrepancy`.

Each pixel scrambles each coordinate by its own tree of random digit flips (Owen 1995). Scrambled points are
as even as before, and pixels are independent. The tree is a hash of the digits (Laine and Karras 2011, with
Vegdahl's constants), which Burley recommends (*Practical Hash-based Owen Scrambling*, 2020). Needs a started
engine.
"""

from __future__ import annotations

from typing import Any

from render.integrator import low_discrepancy

PIXEL, LENS, _VERTEX = 0, 2, 4
EMITTER_POSITION, DIRECTION, LOBE, EMITTER_CHOICE = 0, 2, 4, 5
"""Coordinates: of a sample, and of each vertex of its path."""

_PER_VERTEX = 6
_VERTICES = (low_discrepancy.COORDINATES - _VERTEX) // _PER_VERTEX
"""Vertices with coordinates of their own. Later vertices use the same ones, scrambled differently."""

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

        self._points = mi.UInt32(low_discrepancy.points(first, count).ravel())
        self.count = dr.opaque(mi.UInt32, count)
        epoch = dr.opaque(mi.UInt32, (seed + first // low_discrepancy.LENGTH) % 2**32)
        self._key = _hash(_hash(pixels) ^ epoch)
        self.sample = mi.UInt32(0)

    def sample_2d(self, coordinate: int) -> Any:
        """Return two numbers of the sample, for PIXEL or LENS."""
        import mitsuba as mi

        return mi.Point2f(*(self._number(mi.UInt32(c), mi.UInt32(c)) for c in (coordinate, coordinate + 1)))

    def vertex_1d(self, vertex: Any, coordinate: int) -> Any:
        """Return a number for LOBE or EMITTER_CHOICE at a vertex of the path, counted from 0."""
        return self._number(*self._indices(vertex, coordinate, 0))

    def vertex_2d(self, vertex: Any, coordinate: int, repetition: int = 0) -> Any:
        """Return two numbers for EMITTER_POSITION or DIRECTION, independent for each `repetition`."""
        import mitsuba as mi

        return mi.Point2f(*(self._number(*self._indices(vertex, coordinate + i, repetition)) for i in (0, 1)))

    def _indices(self, vertex: Any, coordinate: int, repetition: int) -> tuple[Any, Any]:
        """Return the row of `_points`, and the number of its scramble."""
        row = _VERTEX + vertex % _VERTICES * _PER_VERTEX + coordinate
        return row, _VERTEX + vertex * _PER_VERTEX + coordinate + repetition * _REPETITION

    def _number(self, row: Any, scramble: Any) -> Any:
        """Return a scrambled number from 0 to 1, excluding 1."""
        import drjit as dr
        import mitsuba as mi

        digits = dr.gather(mi.UInt32, self._points, row * self.count + self.sample)
        key = _hash(self._key ^ (scramble * 0x9E3779B9))
        digits ^= digits * 0x3D20ADEA
        digits += key
        digits *= (key >> 16) | 1
        digits ^= digits * 0x05526C56
        digits ^= digits * 0x53A22864
        return mi.Float(dr.brev(digits) >> 8) * 2.0**-24


def _hash(number: Any) -> Any:
    """Return a 32-bit hash (triple rounds of Wellons' search for good ones, 2018)."""
    number = number ^ (number >> 16)
    number = number * 0x21F0AAAD
    number = number ^ (number >> 15)
    number = number * 0xD35A2D97
    return number ^ (number >> 15)
