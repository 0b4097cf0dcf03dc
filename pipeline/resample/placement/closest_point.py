"""Where the surface comes nearest to a point now, among what lies around a vertex at rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points, Vectors
from pipeline.mesh.tangents import unit

PointMap = Callable[[Points], Points]

_CUTS = 3  # of the sides of the triangles that are looked through
_WITHIN = np.array([(_CUTS - i - j, i, j) for i in range(_CUTS) for j in range(_CUTS - i)][1:]) / _CUTS
_REFINED = 2  # times
_STEP = 1e-4  # of a difference, in sides of the triangle
_STRIDE = 0.5 / _CUTS  # the longest way that one refinement may take, in the same


def nearest(
    carried: PointMap, truly: PointMap, centre: Points, corners: Points, goals: Points
) -> tuple[Points, Points]:
    """Points of the surface at rest that the flow brings as near to the goals as it can: at rest, and now.

    carried  points at rest (N, 3) to where they are now
    truly    points beside the surface at rest (N, 3) to it
    centre   (N, 3) vertices at rest
    corners  (N, K, 2, 3) the other corners of K triangles at each, at rest; nan where there are fewer, and
             twice the same where only a line may be looked along
    goals    (N, 3) points now

    First the best of a lattice within the triangles, then Gauss-Newton steps from there, as far as they gain.
    """
    lattice = np.einsum("wc,nkcx->nkwx", _WITHIN[:, 1:], corners)
    lattice += _WITHIN[:, :1] * centre[:, None, None]
    lattice = lattice.reshape(len(centre), -1, 3)
    there = np.flatnonzero(np.isfinite(lattice[..., 0]).ravel())
    candidates = truly(lattice.reshape(-1, 3)[there])
    places = carried(candidates)
    away = np.full(lattice.shape[:2], np.inf)
    away.ravel()[there] = np.linalg.norm(places - goals[there // lattice.shape[1]], axis=1)
    best = away.argmin(axis=1) + lattice.shape[1] * np.arange(len(centre))
    chosen = np.searchsorted(there, best)
    found, place = candidates[chosen], places[chosen]
    sides, normals = _blade(centre, corners)
    for _ in range(_REFINED):
        _refine(carried, truly, found, place, sides, normals, goals)
    return found, place


def _blade(centre: Points, corners: Points) -> tuple[Vectors, Vectors]:
    """A side (N, 3) of the first triangle of each, and the unit normal of all, zero where they are lines."""
    spokes = corners - centre[:, None, None]
    return spokes[:, 0, 0], unit(np.nansum(np.cross(spokes[:, :, 0], spokes[:, :, 1]), axis=1))


def _refine(
    carried: PointMap,
    truly: PointMap,
    found: Points,
    place: Points,
    sides: Vectors,
    normals: Vectors,
    goals: Points,
) -> None:
    """One step within the surface towards the goals, taken by those that it brings nearer."""
    across = np.cross(normals, sides)
    along = np.cross(across, normals)
    ahead, left = np.split(carried(truly(np.concatenate([found + _STEP * along, found + _STEP * across]))), 2)
    one, two, gap = (ahead - place) / _STEP, (left - place) / _STEP, goals - place
    u, v = _least_squares(one, two, gap)
    there = truly(found + u * along + v * across)
    then = carried(there)
    nearer = np.linalg.norm(then - goals, axis=1) < np.linalg.norm(gap, axis=1)
    found[nearer], place[nearer] = there[nearer], then[nearer]


def _least_squares(one: Vectors, two: Vectors, gap: Vectors) -> tuple[Floats, Floats]:
    """How much (N, 1) of two vectors makes up a third best; not more than _STRIDE, nothing where they are
    parallel."""
    aa, ab, bb = _dot(one, one), _dot(one, two), _dot(two, two)
    ag, bg = _dot(one, gap), _dot(two, gap)
    det = aa * bb - ab * ab
    solvable = det > 1e-12 * aa * bb
    det = np.where(solvable, det, 1.0)
    u, v = solvable * (bb * ag - ab * bg) / det, solvable * (aa * bg - ab * ag) / det
    size = np.hypot(u, v)
    scale = np.minimum(1.0, _STRIDE / np.where(size > 0, size, 1.0))
    return u * scale, v * scale


def _dot(a: Vectors, b: Vectors) -> AnyArray:
    products: AnyArray = np.einsum("nx,nx->n", a, b)
    return products[:, None]
