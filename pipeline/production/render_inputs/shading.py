"""Rendered surfaces of mesh frames: split at creases, diced, and moved within the shutter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.animation import MeshFrame, material_of
from pipeline.arrays import AnyArray, Floats, Points, Vectors
from pipeline.mesh import TriangleMesh
from pipeline.mesh.control_net import bspline_surface, bspline_values
from pipeline.mesh.normals import ShadedMesh, split_at_creases, vertex_normals
from pipeline.mesh.pn_triangles import MOST_PIECES, spread, tessellate
from pipeline.production.render_inputs.framing import rotate_y
from pipeline.resample import Thresholds
from pipeline.shot.point_subjects import RADIUS
from render.scene.camera import Camera
from render.scene.quality import Quality


@dataclass(frozen=True, eq=False)
class Shading:
    """The rendered form of a mesh frame: points, the smooth surface of a control net, or patches of a mesh.

    split   a mesh split at its creases, before dicing
    pieces  into which every edge is diced
    """

    frame: MeshFrame
    split: ShadedMesh | None
    pieces: int

    @classmethod
    def of(cls, frame: MeshFrame, thresholds: Thresholds, pieces: int) -> Shading:
        """Split a mesh at its creases, which the hard angle of the frame's thresholds decides."""
        if is_cloud(frame) or frame.lattice is not None:
            return cls(frame, None, pieces)
        return cls(frame, split_at_creases(frame.mesh, thresholds.hard_angles(frame.mesh)), pieces)

    def cut_for(self, camera: Camera, quality: Quality, pixels: float, spin: float) -> Shading:
        """Dice until no edge spans more than so many pixels, with the subject turned by `spin` radians."""
        if is_cloud(self.frame):
            return self
        uncut = replace(self, pieces=1)._cut(self.frame.mesh.vertices, self.split)
        most = MOST_PIECES if self.split else MOST_SPANS
        points = rotate_y(uncut.vertices, spin)
        return replace(self, pieces=pieces_for(points, uncut.faces, camera, quality, pixels, most))

    def arrays(self) -> dict[str, AnyArray]:
        """Return the arrays of the normals file, at the frame itself."""
        material = material_of(self.frame.mesh)
        if is_cloud(self.frame):
            points = self.frame.mesh.vertices
            return {
                "vertices": points.astype(np.float32),
                "radii": radii(self.frame).astype(np.float32),
                "source_vertex": np.arange(len(points), dtype=np.int32),
                "material": material.astype(np.float32),
            }
        shaded = self._cut(self.frame.mesh.vertices, self.split)
        if self.frame.lattice is not None:
            material = bspline_values(material, self.frame.lattice, self.pieces)
        elif self.split is not None:
            material = spread(material, self.split, shaded)
        return {
            "vertices": shaded.vertices.astype(np.float32),
            "normals": shaded.normals.astype(np.float32),
            "faces": shaded.faces,
            "source_vertex": shaded.source_vertex,
            "material": material.astype(np.float32),
        }

    def at(self, points: Points) -> tuple[Points, Vectors | None]:
        """Return vertices and normals, float64, with the vertices of the mesh moved to `points`.

        Points have no normals. Creases stay where they were, and normals turn as the faces around them do.
        """
        if is_cloud(self.frame):
            return points, None
        shaded = self._cut(points, None if self.split is None else self._turned(points, self.split))
        return shaded.vertices, shaded.normals

    def _cut(self, points: Points, split: ShadedMesh | None) -> ShadedMesh:
        if split is not None:
            return tessellate(split, self.pieces)
        assert self.frame.lattice is not None, "what has no faces of its own is a net"
        return bspline_surface(points, self.frame.lattice, self.pieces)

    def _turned(self, points: Points, split: ShadedMesh) -> ShadedMesh:
        """Return the split mesh at other points; its normals turn as those of its faces do."""
        vertices = points[split.source_vertex]
        now, before = (vertex_normals(TriangleMesh(v, split.faces)) for v in (vertices, split.vertices))
        normals = split.normals + (now - before)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        turned = np.where(lengths > 0.1, normals / np.maximum(lengths, 0.1), now)
        return split._replace(vertices=vertices, normals=turned)


def is_cloud(frame: MeshFrame) -> bool:
    """Tell whether a frame has points only."""
    return not len(frame.mesh.faces)


def radii(frame: MeshFrame) -> Floats:
    """Return (V,) radii of the spheres around vertices; zeros where there are faces."""
    return frame.mesh.attributes[RADIUS] if is_cloud(frame) else np.zeros(len(frame.mesh.vertices))


MOST_FACES = 4_000_000
"""The most faces of a diced frame."""

MOST_SPANS = 256
"""Pieces of a span between two control points of a net."""

_EDGE = 1.1
"""Edges count up to here from the middle of the picture, in halves of its sides."""


def pieces_for(
    points: AnyArray, faces: AnyArray, camera: Camera, quality: Quality, pixels: float, most: int
) -> int:
    """Return into how many pieces every edge is cut, so that each spans at most so many pixels.

    points  (V, 3) of the uncut surface, scene units
    faces   (F, 3)

    Edges behind the lens or beside the picture do not count. `most` at most, and few enough for MOST_FACES.
    """
    wanted = math.ceil(_longest_edge(points, faces, camera, quality) / pixels - 1e-9)
    return max(1, min(wanted, most, math.isqrt(MOST_FACES // max(1, len(faces)))))


def _longest_edge(points: AnyArray, faces: AnyArray, camera: Camera, quality: Quality) -> float:
    """Return the longest edge in the picture, pixels; 0 where there is none."""
    seen = camera.project(points, quality.aspect)
    within = (seen[:, 2] > camera.near) & (np.abs(seen[:, :2]) <= _EDGE).all(axis=1)
    pixels = seen[:, :2] * (quality.width / 2.0, quality.height / 2.0)
    longest = 0.0
    for corner in range(3):
        a, b = faces[:, corner], faces[:, (corner + 1) % 3]
        counted = within[a] & within[b]
        if counted.any():
            longest = max(longest, float(np.hypot(*(pixels[a] - pixels[b])[counted].T).max()))
    return longest
