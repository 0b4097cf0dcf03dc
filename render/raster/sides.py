"""Which faces of a shape can be seen, and what of its vertices is to be known for that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.raster.kernels.projection import CLOCKWISE, sort_faces
from render.raster.parts import Lens, Shape


@dataclass(frozen=True, eq=False)
class Sides:
    """A shape in a picture.

    screen    (V, 3), as the kernel `project` finds them
    orders    of the faces that may be seen
    marks     (V,), what vertices are corners of: SMALL and LARGE triangles
    outwards  1 where faces that run counter-clockwise in the picture are the outer side of a closed surface,
              -1 where they are the inner one, 0 where both sides may be seen
    """

    shape: Shape
    screen: NDArray[np.float32]
    orders: tuple[NDArray[np.int32], ...]
    marks: NDArray[np.uint8]
    outwards: int

    @classmethod
    def of(cls, shape: Shape, lens: Lens, places: tuple[int, int]) -> Sides:
        """places  rows and columns of the picture"""
        screen = lens.project(shape.vertices, *places)
        order, marks = np.empty(len(shape.faces), np.int32), np.zeros(len(screen), np.uint8)
        front, back, volume, whole = sort_faces(screen, shape.faces, *places, order, marks)
        anti, clock = order[:front], order[len(order) - back :]
        if not (shape.closed and whole):
            return cls(shape, screen, (anti, clock), marks | marks >> np.uint8(CLOCKWISE), 0)
        if volume > 0.0:
            return cls(shape, screen, (anti,), marks, 1)
        return cls(shape, screen, (clock,), marks >> np.uint8(CLOCKWISE), -1)

    def corners(self, kind: int) -> NDArray[np.intp]:
        """(N,): the vertices that are corners of SMALL or of LARGE triangles that may be seen."""
        return np.flatnonzero(self.marks & kind)
