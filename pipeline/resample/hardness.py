"""Which edges are hard whatever becomes of them (P31): by their angle at rest."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Indices
from pipeline.mesh.normals import dihedral_angles
from pipeline.mesh.triangles import TriangleMesh


def edges_by_angle(mesh: TriangleMesh, hard_angle: float) -> Indices:
    """(K, 2) the edges whose faces turn by more than hard_angle (radians), as creases for a TriangleMesh.

    Raises MeshError where the mesh is not an oriented manifold.
    """
    hard = np.nan_to_num(dihedral_angles(mesh)) > hard_angle
    ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    return np.unique(np.sort(ends[hard], axis=1), axis=0)
