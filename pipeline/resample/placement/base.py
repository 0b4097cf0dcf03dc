"""Where new vertices go: on the chord, or on a curve through their surroundings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.mesh._kernels_halfedge import Surface
from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.resample._kernels_lists import Changes
from pipeline.resample._kernels_patch import curved_middles
from pipeline.resample._kernels_place import settle
from pipeline.resample._kernels_ring import new_ring
from pipeline.resample._kernels_split import LEAVING


class Placement(Protocol):
    """How splits place their new vertices, and how far others may be moved."""

    @property
    def leaves_chord(self) -> bool:
        """Whether new vertices go anywhere but to the middle of their edge."""

    @property
    def merges_at_midpoint(self) -> bool:
        """Whether two soft ends merge halfway (P27) or at one of them."""

    @property
    def knows_surroundings(self) -> bool:
        """Whether `relax` can move anything."""

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        """The mesh with all that this placement keeps at its vertices and edges.

        hard_angle  radians, one for all or one a vertex
        """

    def at_rest(self, mesh: HalfedgeMesh) -> tuple[int, int]:
        """The columns of the vertices' places at rest and of the normals there; -1 where it keeps none."""

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Floats) -> int:
        """Move the last vertices of the mesh, which lie halfway between their parents; answers how many
        had to stay there.

        births  (N, 3) of each: its parents a and b, the half-edge vertex→b
        limits  the numbers that kernels go by

        Called once after each pass of splits, with all its new vertices together.
        """

    def heal(self, mesh: HalfedgeMesh, limits: Floats) -> None:
        """Mend what earlier frames had to leave, before this one begins."""

    def relax(self, mesh: HalfedgeMesh, spokes: Indices, limits: Floats, changes: Changes) -> int:
        """Move vertices within the surface where their worst triangle gains; answers how many moved.

        spokes  a work list of half-edges, one from each vertex to look at
        changes what the frame has changed, to which the faces around what moved are added
        """


@dataclass(frozen=True)
class Chord:
    """Where the paper has them: at the middle of the edge (P25, P27)."""

    leaves_chord: bool = False
    merges_at_midpoint: bool = True
    knows_surroundings: bool = False

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        return mesh

    def at_rest(self, mesh: HalfedgeMesh) -> tuple[int, int]:
        return -1, -1

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Floats) -> int:
        return 0

    def heal(self, mesh: HalfedgeMesh, limits: Floats) -> None:
        """They need none."""

    def relax(self, mesh: HalfedgeMesh, spokes: Indices, limits: Floats, changes: Changes) -> int:
        return 0


@dataclass(frozen=True)
class Curved:
    """On a curved patch over the edge, which ends at creases (P37); for surfaces whose flow is not known."""

    leaves_chord: bool = True
    merges_at_midpoint: bool = False
    knows_surroundings: bool = False

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        return mesh

    def at_rest(self, mesh: HalfedgeMesh) -> tuple[int, int]:
        return -1, -1

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Floats) -> int:
        places, _ = on_patches(mesh.surface, births, limits[2])
        went = settled(mesh, births[:, LEAVING], places, places, limits)
        return len(births) - int(went.sum())

    def heal(self, mesh: HalfedgeMesh, limits: Floats) -> None:
        """They need none."""

    def relax(self, mesh: HalfedgeMesh, spokes: Indices, limits: Floats, changes: Changes) -> int:
        return 0


def on_patches(surface: Surface, births: Indices, cosine: float) -> tuple[Points, Vectors]:
    """Places (N, 3) of new vertices on curved patches, and unit normals there, zero on creases."""
    places, normals = np.empty((len(births), 3)), np.empty((len(births), 3))
    curved_middles(surface, births, cosine, np.empty(7), places, normals)
    return places, normals


def settled(mesh: HalfedgeMesh, spokes: Indices, places: Points, goals: Points, limits: Floats) -> AnyArray:
    """Move vertices to their places where nothing folds; answers (N,) booleans: which went.

    spokes  (N,) a half-edge that leaves each
    goals   (N, 3) their places at rest, where they have such
    """
    went = np.zeros(len(spokes), np.uint8)
    settle(mesh.surface, np.ascontiguousarray(spokes), new_ring(), places, goals, limits, went)
    return went > 0
