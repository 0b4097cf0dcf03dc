"""Whether a camera stands inside of what it looks at."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from render.base.errors import BadInputError
from render.scene.camera import Camera
from render.scene.surface import Surface

SURELY = 0.99
"""Turns of a surface around a point from which on it is closed, and the point inside. In the depth of an open
vessel there may be as many as the opening leaves."""

PIECE = 1 << 16
"""Faces that are looked at together, so that little memory is needed."""


def refuse_inside(surface: Surface, camera: Camera) -> None:
    """Raises BadInputError where the camera stands inside of a closed surface, and would see its back."""
    origin = np.array(camera.origin)
    low, high = surface.bounds
    if not ((low < origin) & (origin < high)).all():
        return
    if abs(turns(surface, origin)) >= SURELY:
        where = ", ".join(f"{x:.4g}" for x in camera.origin)
        raise BadInputError(
            f"the camera stands inside of the sculpture, at {where}; it sees nothing but its back. Move the "
            "camera away, or aim it from farther off"
        )


def turns(surface: Surface, point: NDArray[np.float64]) -> float:
    """How often a surface winds around a point: 1 inside of a closed one, 0 outside.

    The solid angles of its triangles (van Oosterom and Strackee, 1983), over that of a sphere.
    """
    total = 0.0
    for start in range(0, len(surface.faces), PIECE):
        corners = surface.vertices[surface.faces[start : start + PIECE]] - point
        a, b, c = corners.transpose(1, 0, 2)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        beside = (
            la * lb * lc
            + np.einsum("ij,ij->i", a, b) * lc
            + np.einsum("ij,ij->i", b, c) * la
            + np.einsum("ij,ij->i", c, a) * lb
        )
        total += float(np.arctan2(volume, beside).sum())
    return 2.0 * total / (4.0 * math.pi)
