"""The vertex budget: errors for a frame that would take more vertices than `max_vertices`."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Faces, Points
from pipeline.errors import VertexBudgetError
from render.base.plural import plural

_SHARE_OF_BOUND = 1.01  # a surface of equilateral triangles takes a little fewer vertices than faces / 2


def require_room(vertices: int, more: int, budget: int, lengths: str = "") -> None:
    """Raise VertexBudgetError where that many splits would exceed the budget.

    vertices  those of the surface, without collapsed ones
    lengths   a clause on edge lengths, for the message
    """
    if vertices + more > budget:
        raise VertexBudgetError(
            f"{vertices} vertices and {plural(more, 'edge')} to split exceed the budget of {budget} "
            f"vertices{lengths}"
        )


def require_room_for_area(points: Points, faces: Faces, longest: float, budget: int) -> None:
    """Raise VertexBudgetError where even the largest triangles allowed, equilateral ones, are too many."""
    a, b, c = (points[corners] for corners in faces.T)
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    needed = 0.5 * area / (math.sqrt(3.0) / 4.0 * longest**2)  # half as many vertices as faces
    if needed > _SHARE_OF_BOUND * budget:
        raise VertexBudgetError(
            f"a surface of {area:.3g} square units takes at least {needed:,.0f} vertices where edges are "
            f"{longest:g} units long at most, which exceeds the budget of {budget}"
        )
