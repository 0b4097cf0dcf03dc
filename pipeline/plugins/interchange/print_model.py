"""Models to be printed: a closed surface as STL at a size in millimetres, and a report of it.

Its thinnest wall is estimated by rays from faces against their normals, up to where they leave the body
again. Rays are intersected with triangles as by T. Möller and B. Trumbore, "Fast, minimum storage
ray-triangle intersection", Journal of Graphics Tools 2(1), 1997.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points, Vectors
from pipeline.errors import MeshError
from pipeline.flow.regions import TriangleTree
from pipeline.mesh import TriangleMesh, face_normals
from pipeline.mesh.validation import validate
from pipeline.plugins.interchange.exported_frame import ExportedFrame
from pipeline.statistics import self_intersections

RAYS = 4000  # the most faces that rays start from, chosen evenly


def wall_thickness(mesh: TriangleMesh, rays: int = RAYS) -> Floats:
    """Return distances through the body of a closed mesh, (R,), in its units, from R of its faces.

    Infinite where a ray does not meet the surface again. No wall is thicker than the distances at its faces.
    """
    normals, corners = face_normals(mesh), mesh.vertices[mesh.faces]
    sound = np.flatnonzero(np.linalg.norm(normals, axis=1) > 0.5)  # a face without area has no normal
    starts = sound[np.linspace(0, len(sound) - 1, min(rays, len(sound))).astype(int)]
    return _distances(TriangleTree.of(corners), corners[starts].mean(axis=1), -normals[starts], starts)


def _distances(tree: TriangleTree, origins: Points, directions: Vectors, starts: AnyArray) -> Floats:
    """Return how far rays go until they meet a triangle, (R,), infinite where they meet none.

    starts  (R,) the triangle that each starts on, which does not count

    All rays go down the tree together, a level at a time.
    """
    boxes = tree.memory[: tree.triangles].reshape(-1, 8)
    triangles = tree.memory[tree.triangles :].reshape(-1, 3, 3)
    nearest = np.full(len(starts), np.inf)
    ray, box = np.arange(len(starts)), np.zeros(len(starts), np.int64)
    while len(ray):
        kept = _entries(origins[ray], directions[ray], boxes[box]) < nearest[ray]
        ray, box = ray[kept], box[kept]
        is_leaf = boxes[box, 7] > 0
        first, end = tree.ranges[box[is_leaf]].T
        counts = end - first
        of_leaf = np.repeat(ray[is_leaf], counts)
        triangle = np.arange(len(of_leaf)) + np.repeat(first - np.cumsum(counts) + counts, counts)
        other = tree.order[triangle] != starts[of_leaf]
        of_leaf, triangle = of_leaf[other], triangle[other]
        np.minimum.at(nearest, of_leaf, _hits(triangles[triangle], origins[of_leaf], directions[of_leaf]))
        ray, parent = ray[~is_leaf], box[~is_leaf]
        second = boxes[parent, 6].astype(np.int64)
        ray, box = np.concatenate([ray, ray]), np.concatenate([parent + 1, second])
    return nearest


def _entries(origins: Points, directions: Vectors, boxes: Floats) -> Floats:
    """Return where rays (N,) enter their boxes, infinite where they miss them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (boxes[:, :3] - origins) / directions
        high = (boxes[:, 3:6] - origins) / directions
    first = np.nanmax(np.minimum(low, high), axis=1)
    last = np.nanmin(np.maximum(low, high), axis=1)
    return np.where((last >= first) & (last >= 0.0), first, np.inf)


def _hits(triangles: Floats, origins: Points, directions: Vectors) -> Floats:
    """Return where rays (N,) meet their triangles (N, 3, 3), infinite where they miss them."""
    a, b, c = triangles.transpose(1, 0, 2)
    from_corner, across = origins - a, np.cross(directions, c - a)
    determinant = np.einsum("ij,ij->i", b - a, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", from_corner, across) / determinant
        along = np.cross(from_corner, b - a)
        v = np.einsum("ij,ij->i", directions, along) / determinant
        distance = np.einsum("ij,ij->i", c - a, along) / determinant
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
    return np.where(inside, distance, np.inf)


LONGEST_SIDE = 100.0  # millimetres of the longest side of a printed model


@dataclass(frozen=True)
class PrintReport:
    """Measures of a model as it is printed.

    size       width, depth and height, millimetres
    volume     cubic millimetres
    thinnest   the thinnest wall, millimetres, estimated by rays; None where none met the surface again
    thin       the wall that a hundredth of the faces are thinner than, as `thinnest`
    crossings  pairs of faces that pass through each other
    """

    size: tuple[float, float, float]
    volume: float
    triangles: int
    thinnest: float | None
    thin: float | None
    crossings: int

    @classmethod
    def of(cls, model: TriangleMesh) -> PrintReport:
        """Measure a model in millimetres, with z up."""
        low, high = model.bounds
        width, depth, height = (high - low).tolist()
        walls = wall_thickness(model)
        known = walls[np.isfinite(walls)]
        return cls(
            size=(width, depth, height),
            volume=volume_of(model.vertices, model),
            triangles=len(model.faces),
            thinnest=float(known.min()) if len(known) else None,
            thin=float(np.quantile(known, 0.01)) if len(known) else None,
            crossings=self_intersections(model),
        )

    def in_words(self) -> str:
        """Return the report in a few sentences."""
        size = " × ".join(f"{side:.1f}" for side in self.size)
        words = f"{size} mm, {self.volume / 1000.0:.4g} cm³, {self.triangles} triangles, closed."
        if self.thinnest is not None:
            words += f" Its thinnest wall is about {self.thinnest:.2g} mm, and 1% of its faces"
            words += f" have less than {self.thin:.2g} mm below them."
        if self.crossings:
            words += f" {self.crossings} pairs of faces pass through each other; let the slicer merge them."
        return words

    def as_data(self) -> dict[str, Any]:
        """Return the report as JSON data, with its unit."""
        return {"unit": "mm", **asdict(self)}


def print_model(frame: ExportedFrame, longest: float, name: str) -> TriangleMesh:
    """Return a frame standing on z = 0 with z up, as printers have it, `longest` mm long on its longest side.

    Raises MeshError, with its name, for a point cloud, and for a surface that is not closed.
    """
    if not len(frame.faces):
        raise MeshError(f"{name}: a point cloud has no surface to print; export it as ply or usd")
    mesh = TriangleMesh(frame.points, frame.faces)
    found = validate(mesh)
    if found.problem is not None:
        raise MeshError(f"{name}: {found.problem}, so it cannot be printed; export it as ply and repair it")
    if not found.closed:
        raise MeshError(
            f"{name}: {found.boundary_edges} edges have a face on one side only; a printer needs a closed "
            "surface. Export it as ply and give it a thickness, or choose a closed subject"
        )
    x, y, z = frame.points.T
    stood = np.stack([x, -z, y], axis=1)
    low, high = stood.min(axis=0), stood.max(axis=0)
    middle = np.array([*(0.5 * (low + high))[:2], low[2]])
    points = (stood - middle) * (longest / float((high - low).max()))
    faces = mesh.faces if volume_of(points, mesh) > 0.0 else mesh.faces[:, ::-1]
    return TriangleMesh(points, faces)


def volume_of(points: Points, mesh: TriangleMesh) -> float:
    """Return the volume that a closed mesh encloses with vertices at points (V, 3); below 0 if inside out."""
    a, b, c = points[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
