"""Normals carried through a flow, so that shading does not depend on the triangles.

Under a map with the Jacobian J, tangents go to J t and normals to the direction of cof(J) n = det(J) J⁻ᵀ n,
which is (J t₁) × (J t₂) for t₁ × t₂ = n. J t is differenced: two points beside each vertex go with it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arrays import Floats, Points, Vectors
from pipeline.kernels import readable
from pipeline.mesh.kernels.normals import count_known, cross_beside, longest_side, place_beside

STEP = 1e-7
"""How far tangent points lie from theirs, in sizes of the surface.

A one-sided difference errs by about STEP (what it leaves out) + 2e-16 / STEP (rounding), least near 1.5e-8;
a little more lets a surface lie off the origin. A frame then turns a normal by a millionth of a degree too
much (docs/normals.md); two-sided differences would cost twice as many points.
"""


def carried_normals(
    move: Callable[[Points], Points],
    points: Points,
    moved: Points,
    normals: Vectors,
    apart: Floats | None = None,
) -> Vectors:
    """Unit normals (V, 3) of a surface after a flow has moved it.

    move     the flow over the step: points (N, 3) to where it takes them; called once, with 2V points or
             fewer
    points   (V, 3) vertices before the step
    moved    (V, 3) the same vertices after it
    normals  (V, 3) unit normals before it; zero where there is none, which stays so
    apart    (V,) how far tangent points lie beside theirs; by default STEP sizes of the surface

    A vertex whose surroundings the flow has collapsed to a line gets zero: it has no normal any more.
    """
    known, carried = readable(normals), np.zeros((len(normals), 3))
    if not count_known(known):
        return carried
    if apart is None:
        apart = np.full(len(points), STEP * longest_side(readable(points)))
    beside = move(_beside(points, known, apart))
    cross_beside(known, readable(moved), readable(beside), carried)
    return carried


def tangents(normals: Vectors) -> tuple[Vectors, Vectors]:
    """Two unit vectors (N, 3) each, with t₁ × t₂ = n, for unit normals (N, 3)."""
    beside = _beside(np.zeros((len(normals), 3)), normals, np.ones(len(normals)))
    return beside[: len(beside) // 2], beside[len(beside) // 2 :]


def _beside(points: Points, normals: Vectors, apart: Floats) -> Points:
    """(2K, 3) tangent points of the K vertices with a normal: first all along one tangent."""
    known = readable(normals)
    beside = np.empty((2 * count_known(known), 3))
    place_beside(readable(points), known, readable(apart), beside)
    return beside


def unit(vectors: Vectors, otherwise: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Vectors:
    """Vectors (N, 3) of length 1; `otherwise` for those without a length, or not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths: Floats = np.linalg.norm(vectors, axis=1, keepdims=True)
        good = (lengths > 0) & np.isfinite(lengths)
        scaled: Vectors = np.divide(vectors, lengths, out=np.tile(otherwise, (len(vectors), 1)), where=good)
    return scaled
