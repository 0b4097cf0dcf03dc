"""The faces of a shape that a camera may see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.raster.kernels.projection import CLOCKWISE, sort_faces
from render.raster.shapes import ScreenProjection, Shape


@dataclass(frozen=True, eq=False)
class VisibleFaces:
    """A shape in a picture.

    screen    (V, 3), screen coordinates, as the kernel `project` computes them
    orders    arrays of indices of the faces that may be visible
    corners   (V,), bits SMALL and LARGE: which triangles a vertex is a corner of
    outwards  1 where faces that run counter-clockwise on the screen are the outer side of a closed surface,
              -1 where they are the inner side, 0 where both sides may be visible
    """

    shape: Shape
    screen: NDArray[np.float32]
    orders: tuple[NDArray[np.int32], ...]
    corners: NDArray[np.uint8]
    outwards: int

    @classmethod
    def of(cls, shape: Shape, projection: ScreenProjection, size: tuple[int, int]) -> VisibleFaces:
        """Find the faces of a shape that may be visible. size: rows and columns of the picture"""
        screen = projection.project(shape.vertices, *size)
        order, corners = np.empty(len(shape.faces), np.int32), np.zeros(len(screen), np.uint8)
        front, back, volume, is_whole = sort_faces(screen, shape.faces, *size, order, corners)
        counter_clockwise, clockwise = order[:front], order[len(order) - back :]
        if not (shape.closed and is_whole):
            both = corners | corners >> np.uint8(CLOCKWISE)
            return cls(shape, screen, (counter_clockwise, clockwise), both, 0)
        if volume > 0.0:
            return cls(shape, screen, (counter_clockwise,), corners, 1)
        return cls(shape, screen, (clockwise,), corners >> np.uint8(CLOCKWISE), -1)

    def corners_of(self, kind: int) -> NDArray[np.intp]:
        """Return the vertices (N,) that are corners of SMALL or LARGE triangles."""
        return np.flatnonzero(self.corners & kind)
