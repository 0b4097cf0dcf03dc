"""Placements of new vertices: a rule's interface, on the chord, and on a curved patch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.mesh.meshes import TriangleMesh
from pipeline.resample.kernels.curved_patches import curved_midpoints
from pipeline.resample.kernels.limits import Changes, Limits
from pipeline.resample.kernels.place_vertices import place_vertices
from pipeline.resample.kernels.ring import new_ring
from pipeline.resample.kernels.split import BIRTH_HALFEDGE

RING, SCRATCH = new_ring(), np.empty(7)
"""Scratch arrays of the kernels that place vertices."""


class Placement:
    """A rule for where splits place new vertices, and how far others may move.

    leaves_chord        True if new vertices may lie off the middle of their edge
    merges_at_midpoint  True if two soft ends merge halfway (P27), False if at one of them
    can_relax           True if `relax` can move vertices
    hard_by_angle       True if edges beyond the hard angle are hard in each frame (P29), False if only tagged
                        ones and boundaries are

    The base keeps nothing at the vertices and places new ones in the middle of their edges.
    """

    leaves_chord: ClassVar[bool] = False
    merges_at_midpoint: ClassVar[bool] = False
    can_relax: ClassVar[bool] = False
    hard_by_angle: ClassVar[bool] = True

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        """Return the mesh with all that this placement keeps at its vertices and edges.

        hard_angle  radians, one for all or one a vertex
        """
        return mesh

    def rest_columns(self, mesh: HalfedgeMesh) -> tuple[int, int]:
        """Return the attribute columns of rest positions and rest normals; -1 where it keeps none."""
        return -1, -1

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Limits) -> int:
        """Move the last vertices of the mesh from the midpoints of their parents to their places.

        births  (N, 3) of each: its parents a and b, the half-edge vertex→b

        Returns how many had to stay at the midpoint. Called once after each round of splits, with all its
        new vertices together.
        """
        return 0

    def restore(self, mesh: HalfedgeMesh, limits: Limits) -> None:
        """Move vertices that earlier passes had to leave off the surface back onto it."""

    def relax(self, mesh: HalfedgeMesh, spokes: Indices, limits: Limits, changes: Changes) -> int:
        """Move vertices within the surface where their worst triangle improves; return how many moved.

        spokes   a work list of half-edges, one from each vertex to move
        changes  receives the faces around moved vertices
        """
        return 0


@dataclass(frozen=True)
class Chord(Placement):
    """New vertices in the middle of their edge, as in the paper (P25, P27)."""

    merges_at_midpoint: ClassVar[bool] = True


@dataclass(frozen=True)
class Curved(Placement):
    """New vertices on a curved patch over the edge, which ends at creases (P37); for unknown flows."""

    leaves_chord: ClassVar[bool] = True

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Limits) -> int:
        places, normals = np.empty((2, len(births), 3))
        curved_midpoints(mesh.arrays, births, limits.hard_cosine, SCRATCH, places, normals)
        moved = move_without_folds(mesh, births[:, BIRTH_HALFEDGE], places, places, limits)
        return len(births) - int(moved.sum())


def move_without_folds(
    mesh: HalfedgeMesh, spokes: Indices, places: Points, goals: Points, limits: Limits
) -> AnyArray:
    """Move vertices to their places where no face folds; return flags (N,) of those that moved.

    spokes  (N,) a half-edge that leaves each
    goals   (N, 3) their places at rest, if they have any
    """
    moved = np.zeros(len(spokes), np.uint8)
    place_vertices(mesh.arrays, np.ascontiguousarray(spokes), RING, places, goals, limits, moved)
    return moved > 0
