"""Edges that stay hard whatever becomes of them (P31): by their angle at rest, or by their position."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.errors import UsageError
from pipeline.mesh.meshes import PolygonMesh, TriangleMesh
from pipeline.mesh.normals import angles_between, dihedral_angles
from pipeline.mesh.validation import twin_corners

Mesh = TriangleMesh | PolygonMesh

Region = Callable[[Points], AnyArray]
"""A callable: points (N, 3) to (N,) flags, True for points inside."""


@dataclass(frozen=True)
class WithinBox:
    """The axis-aligned box between two corners, borders included; scene units."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __call__(self, points: Points) -> AnyArray:
        return np.all((points >= self.low) & (points <= self.high), axis=1)


@dataclass(frozen=True)
class WithinBall:
    """The ball around a centre, border included; scene units."""

    centre: tuple[float, float, float]
    radius: float

    def __call__(self, points: Points) -> AnyArray:
        return np.linalg.norm(points - np.asarray(self.centre), axis=1) <= self.radius


def edges_by_angle(mesh: Mesh, hard_angle: float | Floats) -> Indices:
    """Return the edges (K, 2) whose faces enclose more than hard_angle (radians), as creases for a mesh.

    With one angle per vertex, an edge has the mean of its two ends' angles.

    Raises MeshError where the mesh is not an oriented manifold.
    """
    turns = _turns(mesh)
    if isinstance(hard_angle, float):
        return _once(_sides(mesh, np.flatnonzero(turns > hard_angle)))  # not where they are nan
    ends = _sides(mesh)
    return _once(ends[np.nan_to_num(turns) > hard_angle[ends].mean(axis=1)])


def edges_in_region(mesh: Mesh, region: Region) -> Indices:
    """Return the edges (K, 2) with both ends in a region, as creases for a mesh.

    Raises UsageError where the region does not return one flag per vertex.
    """
    within = np.asarray(region(mesh.vertices))
    if within.shape != (len(mesh.vertices),):
        raise UsageError(
            f"the region returned shape {within.shape} for {len(mesh.vertices)} vertices; "
            "it must return one flag for each vertex"
        )
    ends = _sides(mesh)
    return _once(ends[within.astype(bool)[ends].all(axis=1)])


def _sides(mesh: Mesh, chosen: AnyArray | slice = slice(None)) -> Indices:
    """Return the two vertices (C, 2) of each side of each face, or of the chosen ones only."""
    if isinstance(mesh, PolygonMesh):
        return np.column_stack([mesh.corners[chosen], mesh.heads[chosen]])
    return mesh.halfedge_ends if isinstance(chosen, slice) else mesh.ends_of(chosen)


def _turns(mesh: Mesh) -> Floats:
    """Return the angle (C,) between the normals of the two faces at each side, radians; nan on a boundary."""
    if isinstance(mesh, TriangleMesh):
        return dihedral_angles(mesh)
    twin, normals = twin_corners(mesh), mesh.normals
    return angles_between(normals[mesh.owners], normals[mesh.owners[twin]], twin)


def _once(pairs: Indices) -> Indices:
    return np.unique(np.sort(pairs, axis=1), axis=0)
