"""How finely curved patches are cut for a picture: until an edge spans so many of its pixels (P37).

One number for a whole frame, by its longest edge in the picture: then no two patches can part, and where a
surface nears the lens and is cut more finely from one frame to the next, the pieces are too small for that
to be seen. The idea is that of dicing rates: Cook, Carpenter & Catmull, *The Reyes Image Rendering
Architecture*, SIGGRAPH 1987.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import AnyArray
from render.scene.camera import Camera
from render.scene.quality import Quality

MOST_FACES = 4_000_000
"""A frame is not cut into more."""

MOST_SPANS = 256
"""Pieces of a span between two control points of a net."""

_EDGE = 1.1
"""How far from the middle of the picture edges count, in halves of its sides: a little outside too."""


def pieces_for(
    points: AnyArray, faces: AnyArray, camera: Camera, quality: Quality, pixels: float, most: int
) -> int:
    """Into how many pieces every edge is cut, so that each spans at most so many pixels.

    points  (V, 3) of the uncut surface, scene units
    faces   (F, 3)

    Edges behind the lens or beside the picture do not count. `most` at most, and few enough for MOST_FACES.
    """
    wanted = math.ceil(_longest_edge(points, faces, camera, quality) / pixels - 1e-9)
    return max(1, min(wanted, most, math.isqrt(MOST_FACES // max(1, len(faces)))))


def _longest_edge(points: AnyArray, faces: AnyArray, camera: Camera, quality: Quality) -> float:
    """In pixels, of those in the picture; 0 where there is none."""
    seen = camera.project(points, quality.aspect)
    within = (seen[:, 2] > camera.near) & (np.abs(seen[:, :2]) <= _EDGE).all(axis=1)
    pixels = seen[:, :2] * (quality.width / 2.0, quality.height / 2.0)
    longest = 0.0
    for corner in range(3):
        a, b = faces[:, corner], faces[:, (corner + 1) % 3]
        counted = within[a] & within[b]
        if counted.any():
            longest = max(longest, float(np.hypot(*(pixels[a] - pixels[b])[counted].T).max()))
    return longest
