"""What a surface loses when a vertex merges into a neighbour: volume, and how far it stays behind."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.arrays import Points
from pipeline.kernels import kernel
from pipeline.mesh._kernels_halfedge import LEAN, MATRIX
from pipeline.resample._kernels_lists import squared
from pipeline.resample._kernels_ring import NX, NY, NZ, RING, Ring


@kernel(numba.float64(MATRIX, numba.int64, numba.int64, RING), **LEAN)
def swept(points: Points, centre: int, to: int, ring: Ring) -> float:
    """Six times the volume that a ring sweeps if its centre moves to another vertex."""
    total, rows = 0.0, ring.rows
    x = points[to, 0] - points[centre, 0]
    y = points[to, 1] - points[centre, 1]
    z = points[to, 2] - points[centre, 2]
    for j in range(1, ring.size[0] + 1):
        i = np.uint64(j)
        total += x * rows[NX + i] + y * rows[NY + i] + z * rows[NZ + i]
    return abs(total)


@kernel(numba.float64(numba.float64, numba.float64, numba.float64, numba.float64, numba.float64), **LEAN)
def _to_triangle(aa: float, ab: float, bb: float, ap: float, bp: float) -> float:
    """How much nearer than its corner o the nearest point of a triangle is to a point p, as squares.

    Given are the products of its sides a and b, which leave o, with each other and with p - o.
    """
    det = aa * bb - ab * ab
    s, t = bb * ap - ab * bp, aa * bp - ab * ap
    if s >= 0.0 and t >= 0.0 and s + t <= det and det > 0.0:
        return (s * ap + t * bp) / det
    best = 0.0
    if aa > 0.0:
        u = min(1.0, max(0.0, ap / aa))
        best = max(best, u * (2.0 * ap - u * aa))
    if bb > 0.0:
        u = min(1.0, max(0.0, bp / bb))
        best = max(best, u * (2.0 * bp - u * bb))
    cc = aa - 2.0 * ab + bb
    if cc > 0.0:
        u = min(1.0, max(0.0, (bp - ab - ap + aa) / cc))
        best = max(best, 2.0 * ap - aa + u * (2.0 * (bp - ab - ap + aa) - u * cc))
    return best


@kernel(numba.float64(MATRIX, RING, numba.int64, numba.int64), **LEAN)
def left_behind(points: Points, ring: Ring, centre: int, to: int) -> float:
    """Squared distance of the ring's centre from its faces once it has merged into the vertex `to`."""
    away, best = squared(points, centre, to), 0.0
    for i in range(ring.size[0]):
        b, c = ring.vertex[i], ring.vertex[i + 1]
        if b == to or c == to:
            continue
        aa, bb, ab, ap, bp = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            origin = points[to, k]
            u, v, w = points[b, k] - origin, points[c, k] - origin, points[centre, k] - origin
            aa += u * u
            bb += v * v
            ab += u * v
            ap += u * w
            bp += v * w
        best = max(best, _to_triangle(aa, ab, bb, ap, bp))
    return away - best
