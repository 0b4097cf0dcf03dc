"""How mesh-like a surface is: short edges against its size, flat angles between neighbours (P7)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Vectors
from pipeline.mesh import TriangleMesh, face_normals
from pipeline.mesh._kernels_halfedge import match_twins


@dataclass(frozen=True)
class MeshStatistics:
    """Mesh-like means that `mean_edge / diameter` is small and `median_dihedral` near π.

    mean_edge        mean edge length, scene units; every edge counts once for each of its faces
    diameter         diagonal of the bounding box, scene units
    median_dihedral  median inner angle between neighbouring faces, radians: π is flat
    area             scene units squared
    """

    mean_edge: float
    diameter: float
    median_dihedral: float
    area: float


def mesh_statistics(mesh: TriangleMesh) -> MeshStatistics:
    """The statistics of a sound mesh."""
    corners = mesh.vertices[mesh.faces]
    sides = corners[:, (1, 2, 0)] - corners
    squares = np.einsum("fij,fij->fi", sides, sides)
    a, b, c = squares.T  # Heron's formula, from squared lengths
    sixteenfold = 4 * a * b - (a + b - c) ** 2
    low, high = mesh.bounds
    return MeshStatistics(
        mean_edge=float(np.sqrt(squares).mean()),
        diameter=float(np.linalg.norm(high - low)),
        median_dihedral=_median_dihedral(mesh, face_normals(mesh)),
        area=float(np.sqrt(np.maximum(sixteenfold, 0.0)).sum() / 4),
    )


def _median_dihedral(mesh: TriangleMesh, normals: Vectors) -> float:
    """The angle falls as the cosine grows, so the median cosine will do; π where no faces meet."""
    twin = np.empty(3 * len(mesh.faces), np.int32)
    match_twins(mesh.faces.flatten(), len(mesh.vertices), twin)
    first = np.flatnonzero(twin > np.arange(len(twin)))
    if not len(first):
        return math.pi
    cosine = float(np.median(np.einsum("ei,ei->e", normals[first // 3], normals[twin[first] // 3])))
    return math.pi - math.acos(min(max(cosine, -1.0), 1.0))
