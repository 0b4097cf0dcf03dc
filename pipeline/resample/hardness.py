"""Which edges are hard whatever becomes of them (P31): by their angle at rest."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats, Indices
from pipeline.mesh.normals import dihedral_angles
from pipeline.mesh.triangles import TriangleMesh


def edges_by_angle(mesh: TriangleMesh, hard_angle: float | Floats) -> Indices:
    """(K, 2) the edges whose faces turn by more than hard_angle (radians), as creases for a TriangleMesh.

    With an angle for each vertex, that of an edge is the mean of its ends'.

    Raises MeshError where the mesh is not an oriented manifold.
    """
    ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    limit = hard_angle if isinstance(hard_angle, float) else hard_angle[ends].mean(axis=1)
    hard = np.nan_to_num(dihedral_angles(mesh)) > limit
    return np.unique(np.sort(ends[hard], axis=1), axis=0)
