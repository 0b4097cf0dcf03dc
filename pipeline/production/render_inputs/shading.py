"""From a mesh frame to what is rendered of it, and to the same surface a moment earlier or later."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.animation import MeshFrame, material_of
from pipeline.arrays import AnyArray, Floats, Points, Vectors
from pipeline.mesh import TriangleMesh
from pipeline.mesh.control_net import bspline_surface, bspline_values
from pipeline.mesh.normals import ShadedMesh, split_at_creases, vertex_normals
from pipeline.mesh.pn_triangles import MOST_PIECES, spread, tessellate
from pipeline.production.render_inputs.dicing import MOST_SPANS, pieces_for
from pipeline.production.render_inputs.framing import turned
from pipeline.resample import Thresholds
from pipeline.shot.point_subjects import RADIUS
from render.scene.camera import Camera
from render.scene.quality import Quality


@dataclass(frozen=True, eq=False)
class Shading:
    """How a frame's mesh is rendered: points as they are, nets as their smooth surface, surfaces split at
    their creases and cut into patches.

    split   of a surface, before it is cut
    pieces  into how many every edge is cut
    """

    frame: MeshFrame
    split: ShadedMesh | None
    pieces: int

    @classmethod
    def of(cls, frame: MeshFrame, thresholds: Thresholds, pieces: int) -> Shading:
        """thresholds: those of the frame, whose hard angle makes creases"""
        if is_cloud(frame) or frame.lattice is not None:
            return cls(frame, None, pieces)
        return cls(frame, split_at_creases(frame.mesh, thresholds.hard_angles(frame.mesh)), pieces)

    def cut_for(self, camera: Camera, quality: Quality, pixels: float, spin: float) -> Shading:
        """The same, cut until edges span so many pixels at most; turned by `spin` radians."""
        if is_cloud(self.frame):
            return self
        uncut = replace(self, pieces=1)._cut(self.frame.mesh.vertices, self.split)
        most = MOST_PIECES if self.split else MOST_SPANS
        points = turned(uncut.vertices, spin)
        return replace(self, pieces=pieces_for(points, uncut.faces, camera, quality, pixels, most))

    def arrays(self) -> dict[str, AnyArray]:
        """What is kept for rendering, at the frame itself."""
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
        """Vertices and normals, float64, where the vertices of the mesh are at `points`.

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
        """The split surface with other points, its normals changed by what those of its faces change."""
        vertices = points[split.source_vertex]
        now, before = (vertex_normals(TriangleMesh(v, split.faces)) for v in (vertices, split.vertices))
        normals = split.normals + (now - before)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        turned = np.where(lengths > 0.1, normals / np.maximum(lengths, 0.1), now)
        return split._replace(vertices=vertices, normals=turned)


def is_cloud(frame: MeshFrame) -> bool:
    return not len(frame.mesh.faces)


def radii(frame: MeshFrame) -> Floats:
    """(V,) of the spheres around vertices: none where there are faces."""
    return frame.mesh.attributes[RADIUS] if is_cloud(frame) else np.zeros(len(frame.mesh.vertices))
