"""OneMesh: one mesh of a subject for all frames, whose vertices move and whose triangles never change.

Other programs take an animation as that: morph targets, Alembic, textures of positions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flowsculpt import TriangleMesh, UsageError, vertex_normals
from flowsculpt.api.frames import FrameRange, FrameRate
from flowsculpt.api.materials import PaintedFaces
from flowsculpt.api.meshes import Floats, Indices, split_at_creases


@dataclass(frozen=True, eq=False)
class OneMeshFrame:
    """One mesh at one frame.

    points   (V, 3), scene units
    normals  (N, 3) unit; `OneMesh.corner_normals` says which corner has which
    """

    points: Floats
    normals: Floats
    _velocities: Callable[[], Floats]

    @cached_property
    def velocities(self) -> Floats:
        """(V, 3) scene units per second. They take two evaluations of the flow."""
        return self._velocities()


@dataclass(frozen=True)
class Reduction:
    """The vertices that were left out of one mesh, and the most that this shows.

    whole  vertices before
    error  the largest distance of a vertex left out from the middle of the edge that it would split, in
           maximum edge lengths of its frame; `frame` is the frame where it is largest
    """

    whole: int
    error: float
    frame: int


@dataclass(frozen=True, eq=False)
class OneMesh:
    """One mesh of a subject for all frames of a range: V vertices and F triangles that never change.

    name            of the subject, or of the shot where it has one
    frames          of the range asked for, in order
    faces           (F, 3), counter-clockwise seen from outside; no vertex is split
    corner_normals  (F, 3): the normal of each corner of a face, by its row; the first V rows are those of the
                    vertices, further ones of other sides of creases
    creases         (K, 2): the edges that are tagged as creases, of two vertices each
    rest            (V, 3): the positions in the undeformed subject
    key             the digest of all of it
    points_at       returns the points (V, 3) of a frame, velocities_at their velocities
    normals_at      returns normals (V, 3) at the vertices of a frame that are known, zero where none is; None
                    where normals are those of the triangles
    least_agreement the cosine of the angle of a known normal and the mean of the triangles around, from which
                    on it is taken; None where it is taken if each of them agrees (`trusted_normals`)
    longest_at      returns the maximum edge length of a frame, scene units; infinite where there is none
    colours         linear Rec.709 reflectances (V, 3); None where the look has one colour
    texture         texture coordinates (F, 3, 2) of the corners, or None
    paint           what a model's file has on the faces, where the look shows its materials, or None
    reduction       None where no vertices were left out
    """

    name: str
    frames: tuple[int, ...]
    rate: FrameRate
    faces: Indices
    corner_normals: Indices
    creases: Indices
    rest: Floats
    key: str
    points_at: Callable[[int], Floats]
    velocities_at: Callable[[int], Floats]
    normals_at: Callable[[int], Floats] | None = None
    least_agreement: float | None = None
    longest_at: Callable[[int], float] = lambda number: math.inf
    colours: Floats | None = None
    texture: Floats | None = None
    paint: PaintedFaces | None = None
    reduction: Reduction | None = None

    @classmethod
    def of(
        cls,
        name: str,
        frames: tuple[int, ...],
        rate: FrameRate,
        surface: TriangleMesh,
        key: str,
        points_at: Callable[[int], Floats],
        velocities_at: Callable[[int], Floats],
    ) -> OneMesh:
        """Return the mesh of a surface at rest, whose tagged edges are its creases, without colours.

        Raises MeshError where the surface is not an oriented manifold.
        """
        corner_normals = split_at_creases(surface, math.pi).faces
        arrays = surface.faces, corner_normals, surface.creases, surface.vertices
        return cls(name, frames, rate, *arrays, key, points_at, velocities_at)

    def frame(self, number: int) -> OneMeshFrame:
        """Return the mesh at a frame, with normals that are smooth up to creases.

        Known normals are taken where the triangles agree with them. Raises FrameError where points cannot be
        read.
        """
        points = self.points_at(number)
        known = None if self.normals_at is None else self.normals_at(number)
        mesh = TriangleMesh(points, self.faces, creases=self.creases)
        if known is not None and self.least_agreement is None:
            mesh = mesh.with_attributes(normal=known)
        normals = vertex_normals(mesh, self.corner_normals)
        if known is not None and self.least_agreement is not None:
            agrees = np.einsum("ij,ij->i", normals[: len(known)], known) > self.least_agreement
            agrees[self.creases] = False
            normals[: len(known)][agrees] = known[agrees]
        return OneMeshFrame(points, normals, lambda: self.velocities_at(number))


def even_step(frames: Sequence[int]) -> int:
    """Return the frames from one sample to the next. Raises UsageError where they differ."""
    steps = set(np.diff(frames).tolist()) or {1}
    if len(steps) > 1 or min(steps) < 1:
        raise UsageError(
            f"frames {FrameRange.of(frames)} are not evenly spaced, as this format has them; write a range "
            "such as 1-48 or 1-48x2"
        )
    return int(steps.pop())
