"""Noise for patterns: displacements that vary smoothly, and spots scattered evenly; seeded, without state."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float64]

_SEEDS = 2**32


def fractal_noise(points: Rows, octaves: int, seed: int) -> Rows:
    """(N, 3) displacements at points (N, 3): value noise of three channels, each octave twice as fine and
    half as strong; about 0.3 root mean square, and never above 1.

    Cubic interpolation of the eight values around (quintic fade after Perlin, *Improving noise*, 2002).
    """
    from render.scene.kernels.noise import add_value_noise  # compiled code, which most looks do without

    total, strength, turn = np.zeros((len(points), 3)), 0.5, _turn()
    place = np.ascontiguousarray(points, dtype=np.float64)
    for octave in range(octaves):
        add_value_noise(place, (0x9E3779B9 * (octave + 1) + seed) % _SEEDS, strength, total)
        strength *= 0.5
        place = 2.0 * place @ turn + 17.31  # lattices of two octaves never lie in each other
    return total


def nearest_spot(points: Rows, seed: int) -> NDArray[np.float64]:
    """(N,): distance to the spot that is nearest for its size, in spots of full size; cells are units.

    One spot a cell (Worley, *A cellular texture basis function*, SIGGRAPH 1996), between half and full size.
    """
    from render.scene.kernels.noise import find_spots

    nearest = np.empty(len(points))
    find_spots(np.ascontiguousarray(points, dtype=np.float64), seed % _SEEDS, nearest)
    return nearest


def _turn() -> Rows:
    """A rotation by an angle that no lattice repeats under, about (1, 1, 1)."""
    axis, angle = np.full(3, 1.0 / math.sqrt(3.0)), 1.0
    across = np.cross(np.eye(3), axis)
    return np.asarray(np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * across @ across)
