"""How mesh-like a surface is: short edges against its size, flat angles between neighbours (P7)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.mesh import TriangleMesh, dihedral_angles


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
    """Raises MeshError where the mesh is not an oriented manifold."""
    corners = mesh.vertices[mesh.faces]
    sides = corners[:, (1, 2, 0)] - corners
    turns = dihedral_angles(mesh)
    inner = turns[~np.isnan(turns)]
    low, high = mesh.bounds
    return MeshStatistics(
        mean_edge=float(np.linalg.norm(sides, axis=2).mean()),
        diameter=float(np.linalg.norm(high - low)),
        median_dihedral=math.pi - float(np.median(inner)) if len(inner) else math.pi,
        area=float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2),
    )
