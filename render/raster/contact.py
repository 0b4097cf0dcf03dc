"""Contact shadows of quick previews: the light that a subject close to the floor keeps from it.

A grid on the floor holds how low the subject is over each cell. A cell above takes from a point of the floor
the light that a level square of its size takes (the form factor of two parallel patches).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.raster.raster_projection import Array, fast
from render.scene.scene_stage import StagePlacement

CELLS, REACH = 48, 2.4
"""Cells along each side of the grid, and half of its side, stage units."""

LOOKS_DARK, PACKED_DARK = 0.55, 0.3
"""Exponents by which display values and packed values of a floor fall with the light that reaches it."""

CELL = 2.0 * REACH / CELLS
"""Side of a cell, stage units."""

_HIGH = 1.5
"""Height from which on a subject casts no contact shadow, stage units."""

_LEAST_HEIGHT = 1.4 * CELL
"""Height of a subject that touches the floor, stage units: a lower one would show the cells."""

_DARKEST = 0.1
"""Least fraction of light that reaches the floor: the subject reflects it."""

_OVERLAP = 1.8
"""Rate at which light falls with the sum of what cells take: of cells behind each other one takes it."""


class ContactShadow(NamedTuple):
    """The contact shadow on a floor.

    frame  (6,): origin (3) and size of the stage, cosine and sine of its turn
    open   (CELLS, CELLS), the fraction of light from above that reaches the middle of each cell; empty
           without a floor
    """

    frame: NDArray[np.float64]
    open: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        vertices: NDArray[np.float32],
        placement: StagePlacement,
        has_floor: bool,
        opacity: float = 1.0,
    ) -> ContactShadow:
        """Return the contact shadow of a subject's vertices (V, 3). opacity: of the subject"""
        turn = np.cos(placement.turn), np.sin(placement.turn)
        frame = np.array([*placement.origin, placement.size, *turn])
        if not has_floor:
            return cls(frame, np.zeros((0, 0), np.float32))
        lowest = np.full((CELLS, CELLS), np.inf, np.float32)
        lowest_points(vertices, frame, lowest)
        reached = np.empty((CELLS, CELLS), np.float32)
        unblocked(lowest, opacity, reached)
        return cls(frame, reached)

    def factors(self, exponent: float) -> NDArray[np.float32]:
        """Return the factors (CELLS, CELLS) on values of the floor. exponent: LOOKS_DARK or PACKED_DARK"""
        return np.asarray(self.open**exponent, np.float32)

    def coordinates(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the place (N, 2) of points on the grid, in cells; far outside for points off the floor."""
        x, y, z = (points - self.frame[:3]).T / self.frame[3]
        cosine, sine = self.frame[4:]
        places = np.stack([cosine * x - sine * z, sine * x + cosine * z], axis=1)
        places[np.abs(y) > 0.05] = 1e3
        return ((places + REACH) / CELL - 0.5).astype(np.float32)


@fast
def lowest_points(vertices: Array, frame: Array, lowest: Array) -> None:
    """Write the height of the lowest vertex over each cell into lowest (CELLS, CELLS), stage units."""
    scale = 1.0 / frame[3]
    for v in range(vertices.shape[0]):
        x, z = (vertices[v, 0] - frame[0]) * scale, (vertices[v, 2] - frame[2]) * scale
        x, z = frame[4] * x - frame[5] * z, frame[5] * x + frame[4] * z
        i, j = int((x + REACH) / CELL), int((z + REACH) / CELL)
        if x > -REACH and z > -REACH and i < CELLS and j < CELLS:
            height = np.float32((vertices[v, 1] - frame[1]) * scale)
            if height < lowest[i, j]:
                lowest[i, j] = height


@fast
def unblocked(lowest: Array, opacity: float, reached: Array) -> None:
    """Write the fraction of light that reaches each cell of the floor into reached (CELLS, CELLS)."""
    area = np.float32(CELL * CELL)
    reached[:] = 1.0
    for i in range(CELLS):
        for j in range(CELLS):
            if not lowest[i, j] < _HIGH:
                continue
            height = max(lowest[i, j], np.float32(_LEAST_HEIGHT))
            squared = height * height
            around = int(4.0 * height / CELL) + 1
            taken = np.float32(opacity * area * squared / np.pi)
            for m in range(max(0, i - around), min(CELLS, i + around + 1)):
                level = squared + area * (m - i) * (m - i)
                for n in range(max(0, j - around), min(CELLS, j + around + 1)):
                    distance = level + area * (n - j) * (n - j)
                    reached[m, n] -= taken / (distance * distance)
    for i in range(CELLS):
        for j in range(CELLS):
            taken = 1.0 - reached[i, j]
            reached[i, j] = _DARKEST + (1.0 - _DARKEST) * math.exp(-_OVERLAP * taken)


@fast
def open_at(reached: Array, row: float, column: float) -> float:
    """Return the fraction of light from above at a place on the grid, in cells; 1 outside of it."""
    if not (0.0 <= row < CELLS - 1.0 and 0.0 <= column < CELLS - 1.0) or reached.shape[0] == 0:
        return 1.0
    i, j = int(row), int(column)
    down, right = row - i, column - j
    near = reached[i, j] + right * (reached[i, j + 1] - reached[i, j])
    far = reached[i + 1, j] + right * (reached[i + 1, j + 1] - reached[i + 1, j])
    return float(near + down * (far - near))


@fast
def dim_floor(places: Array, factors: Array, factor: Array) -> None:
    """Write the factor on values at places (2, N) of the floor into factor (N,).

    factors  (CELLS, CELLS), of each cell, as `ContactShadow.factors` returns them
    """
    for n in range(places.shape[1]):
        row, column = places[0, n], places[1, n]
        inside = row >= 0.0 and column >= 0.0 and row < CELLS - 1.0 and column < CELLS - 1.0
        factor[n] = open_at(factors, row, column) if inside else 1.0
