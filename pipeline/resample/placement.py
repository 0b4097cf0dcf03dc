"""Where new vertices go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from pipeline.arrays import Indices
from pipeline.mesh.halfedge import HalfedgeMesh


class Placement(Protocol):
    """How splits place their new vertices and whether collapses may leave the old ones."""

    @property
    def merges_at_midpoint(self) -> bool:
        """Whether two soft ends merge halfway (P27) or at one of them."""

    def place(self, mesh: HalfedgeMesh, first: int, parents: Indices) -> None:
        """Move the vertices from `first` on, which now lie at the middle of their `parents` (N, 2).

        Called once after each pass of splits, with all its new vertices together.
        """


@dataclass(frozen=True)
class Chord:
    """Where the paper has them: at the middle of the edge (P25, P27)."""

    merges_at_midpoint: bool = True

    def place(self, mesh: HalfedgeMesh, first: int, parents: Indices) -> None:
        """They are there already."""
