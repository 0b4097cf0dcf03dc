"""Surfaces of edits that are not simulated: moved by the change of a flow, or rebuilt and carried there.

A frame depends on all frames before it, and these cannot be simulated while somebody drags. Where the flow
changes, the vertices of the known frame are moved by how far the old flow and the new one carry points of the
first frame apart. Where the subject changes, a coarse mesh of it is carried from the first frame to the one
that is shown. Neither is resampled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pipeline.animation import FrameReport, MeshFrame
from pipeline.animation.frame import with_material
from pipeline.arrays import AnyArray, Floats, Points, Vectors
from pipeline.flow.flow_map import checked_displacement
from pipeline.mesh import TriangleMesh
from pipeline.mesh.normals import vertex_normals
from pipeline.production.request.keys import thresholds_at
from pipeline.production.request.shading import STEP, Shading
from pipeline.resample import Thresholds
from pipeline.shot import Motion, Resampling, Solid
from render.scene.measure import SPEED

MOST_STEPS = 24
"""Steps in which points are carried to a frame; each spans several frames in a long shot."""

MOST_WEIGHTS = 1 << 21
"""Weights of carried points for vertices, at most, and with it their memory: 8 MiB."""

MOST_CARRIED, LEAST_CARRIED = 500, 60
"""Points that are carried: the more vertices, the fewer."""

MOST_BUILT = 3000
"""Approximate vertices of a subject that is rebuilt, and of one whose vertices are carried individually."""


def carried_to(motion: Motion, points: Points, number: int) -> Points:
    """Carry points (S, 3) of the first frame to another, in at most MOST_STEPS steps. Raises FrameError."""
    first = motion.frames.first
    stops = np.unique(np.linspace(first, number, min(MOST_STEPS, number - first) + 1).round()).tolist()
    for start, end in pairwise(stops):
        time, dt = motion.clock.between(start, end)
        points = checked_displacement(motion.flow, points, time, dt, int(end))
    return points


@dataclass(frozen=True, eq=False)
class CarriedPoints:
    """Points of the first frame that a flow carries to another, and what each means for its vertices.

    start    (S, 3) in the first frame
    end      (S, 3) in the frame that is shown
    weights  (V, S) float32, for each vertex of that frame
    arrays   of that frame
    normals  (V, 3), those of its faces around each vertex; None for points
    """

    start: Points
    end: Points
    weights: AnyArray
    arrays: Mapping[str, AnyArray]
    normals: Vectors | None

    @classmethod
    def of(
        cls,
        motion: Motion,
        at_first: AnyArray,
        arrays: Mapping[str, AnyArray],
        number: int,
        subjects: int = 1,
    ) -> CarriedPoints:
        """Carry some of the first frame's vertices to a frame with these arrays. Raises FrameError.

        subjects  number of subjects that are moved; the more, the fewer points are carried for each
        """
        vertices = arrays["vertices"]
        start = _spread(at_first, _points_for(subjects * len(vertices))).astype(np.float64)
        end = carried_to(motion, start, number)
        normals = _normals(arrays, vertices) if "normals" in arrays else None
        return cls(start, end, _weights(vertices, end), arrays, normals)

    def moved(self, motion: Motion, number: int) -> dict[str, AnyArray]:
        """Return the arrays of the frame, moved by the difference between this flow and another one.

        Raises FrameError where that flow fails.
        """
        end = carried_to(motion, self.start, number)
        vertices = self.arrays["vertices"] + _blended(self.weights, end - self.end)
        moved = {**self.arrays, "vertices": vertices}
        if self.normals is not None:
            now = _normals(self.arrays, vertices)
            moved["normals"] = _turned(self.arrays["normals"], self.normals, now)
        return moved


def built(motion: Motion, number: int, tessellate: int) -> dict[str, AnyArray]:
    """Build the subject coarsely, carry it to a frame and return its arrays there.

    tessellate  pieces into which spans of a control net are cut

    Raises FrameError where the flow fails, and the errors of `Subject.build`.
    """
    mesh = with_material(_coarse(motion))
    lattice = motion.subject.lattice
    frame = MeshFrame(number, mesh, FrameReport(None, lambda: None), lattice=lattice)
    shading = Shading.of(frame, thresholds_at(motion, number), tessellate if lattice else 1)
    if len(mesh.vertices) <= 2 * MOST_BUILT:
        points = carried_to(motion, mesh.vertices, number)
    else:
        start = _spread(mesh.vertices, _points_for(len(mesh.vertices)))
        offsets = carried_to(motion, start, number) - start
        points = mesh.vertices + _blended(_weights(mesh.vertices, start), offsets)
    vertices, normals = shading.at(points)
    arrays = {**shading.arrays(), "vertices": vertices.astype(np.float32)}
    return arrays if normals is None else {**arrays, "normals": normals.astype(np.float32)}


def with_speeds(arrays: Mapping[str, AnyArray], motion: Motion, number: int) -> dict[str, AnyArray]:
    """Return arrays with the speed of their vertices, (V, 1) float32, scene units per second."""
    time, dt = motion.clock.between(number, number + STEP)
    points = arrays["vertices"].astype(np.float64)
    moved = checked_displacement(motion.flow, points, time, dt, number)
    speed = np.linalg.norm(moved - points, axis=1, keepdims=True) / motion.rate.seconds(STEP)
    return {**arrays, SPEED: speed.astype(np.float32)}


def _coarse(motion: Motion) -> TriangleMesh:
    """Return the subject at rest with about MOST_BUILT vertices; models, clouds and nets as they are."""
    subject, copies = motion.subject, motion.copies
    if not isinstance(subject, Solid):
        return replace(motion, resampling=None).mesh_at_rest()
    rough = subject.build()
    corners = rough.vertices[rough.faces]
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum())
    vertices = MOST_BUILT / (copies.count if copies else 1)
    edge = max(1.07 * (area / vertices) ** 0.5, 1e-9)  # equilateral triangles have half a vertex each
    return replace(motion, resampling=Resampling(Thresholds(edge))).mesh_at_rest()


def _points_for(count: int) -> int:
    """Return how many points are carried for so many vertices."""
    return max(LEAST_CARRIED, min(MOST_CARRIED, MOST_WEIGHTS // max(1, count)))


def _spread(points: AnyArray, count: int) -> AnyArray:
    """Return about `count` of points (N, 3), spread evenly over their order."""
    return points[:: -(-len(points) // count)]


def _weights(vertices: AnyArray, points: Points) -> AnyArray:
    """Return the weight (V, S) of each point for each vertex, float32: the inverse fourth power of their
    distance.
    """
    middle = points.mean(axis=0)
    near, places = (points - middle).astype(np.float32), (vertices - middle).astype(np.float32)
    least = np.float32((0.02 * (float(np.ptp(near, axis=0).max()) or 1.0)) ** 2)
    of_points = np.column_stack([-2.0 * near, (near**2).sum(axis=1) + least, np.ones_like(near[:, 0])])
    of_vertices = np.column_stack([places, np.ones_like(places[:, 0]), (places**2).sum(axis=1)])
    weights: AnyArray = of_vertices @ of_points.T  # squared distances; every step in place: they are millions
    np.maximum(weights, least, out=weights)
    np.multiply(weights, weights, out=weights)
    return np.reciprocal(weights, out=weights)


def _blended(weights: AnyArray, offsets: Floats) -> AnyArray:
    """Return the offset (V, 3) float32 of each vertex: the mean of offsets (S, 3) by weights (V, S)."""
    summed = weights @ np.column_stack([offsets, np.ones(len(offsets))]).astype(np.float32)
    return np.asarray(summed[:, :3] / summed[:, 3:])


def _normals(arrays: Mapping[str, AnyArray], vertices: AnyArray) -> Vectors:
    """Return the normals (V, 3) of the faces around vertices (V, 3)."""
    return vertex_normals(TriangleMesh(vertices.astype(np.float64), arrays["faces"]))


def _turned(normals: AnyArray, before: Vectors, now: Vectors) -> AnyArray:
    """Return normals (V, 3) float32, turned as those of the faces around them turn."""
    turned = normals + (now - before)
    lengths = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.where(lengths > 0.1, turned / np.maximum(lengths, 0.1), now).astype(np.float32)
