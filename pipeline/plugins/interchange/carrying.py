"""One mesh of a sequence whose faces change: the surface of one frame, carried through all others.

From frame to frame its vertices follow the velocities of the files, by the trapezoidal rule, and are drawn
to the nearest place of the file's surface whose normal agrees, so not across thin walls. Creases stay on
creases, and poor triangles are smoothed along the surface. Where the mesh stretches or leaves the files'
surfaces, edges are split at the frame that it begins with, and it is carried again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flowsculpt import FrameError, TriangleMesh, vertex_normals
from flowsculpt.api.flows import TriangleTree
from flowsculpt.api.meshes import Floats, Indices, RefinableSurface, edge_keys
from flowsculpt.pipeline.plugins.interchange.mesh_smoothing import smoothed
from flowsculpt.pipeline.plugins.interchange.refining import Began
from flowsculpt.pipeline.plugins.interchange.shown_surfaces import (
    AGREEING,
    Places,
    ShownSurface,
    bound_vertices,
    edges_of,
    ends_of_keys,
    nearest_points,
    unit,
)

VERSION = 1
"""Raised when equal frames and settings give another mesh."""

MOST_ROUNDS = 5
"""Times that the mesh is refined and carried again."""

REFINED = 0.7
"""The share of the tolerance from which on edges are split: the rest is for places between samples."""

STRETCHED = 2.0
"""The length of an edge, over the median of the file's or those around it, from which on it is split."""

SHORTEST = 0.3
"""The length of an edge, over the file's, up to which it is never split."""


class Deviation(NamedTuple):
    """The largest distance between the mesh and a file's surface, in median edges of that, and its place."""

    distance: float
    place: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class CarriedMesh:
    """A mesh at the frame that it begins with, with its creases, and its places on all surfaces.

    deviations  of each frame
    """

    mesh: TriangleMesh
    places: dict[int, Places]
    deviations: dict[int, Deviation]


@dataclass(eq=False)
class Carrier:
    """Carries the surface of one frame through others.

    surface_of    returns the surface of a frame
    numbers       of the frames, in order
    start         the frame that it begins with
    tolerance     the largest distance of the mesh and a surface, in median edges of the surface
    max_vertices  of the mesh
    """

    surface_of: Callable[[int], ShownSurface]
    numbers: range
    start: int
    tolerance: float
    max_vertices: int
    _marks: dict[int, float] = field(default_factory=dict)
    _deviations: dict[int, Deviation] = field(default_factory=dict)

    def carried(self, began: Began) -> CarriedMesh:
        """Return the mesh, refined until it is within the tolerance or edges are too short to be split.

        began  called with the name of each part of the work and its number of frames; returns what is called
               after each

        Raises FrameError where it needs too many vertices.
        """
        first = self.surface_of(self.start)
        surface = RefinableSurface(first.with_creases())
        for count in range(MOST_ROUNDS + 1):
            self._marks, self._deviations = {}, {}
            mesh, places = surface.mesh(), dict[int, Places]()
            passed = began(f"carrying {count + 1}" if count else "carrying", len(self.numbers))
            for shown, here in self._through(mesh):
                places[shown.number] = here
                self._compare_edges(shown, mesh, here)
                passed()
            if self._marks and count < MOST_ROUNDS:
                self._split(surface, mesh, first)
                continue
            passed = began("comparing", len(self.numbers))
            for number in self.numbers:
                self._compare_faces(self.surface_of(number), mesh.with_vertices(places[number].points))
                passed()
            worst = self._deviations[farthest(self._deviations)].distance
            if worst <= self.tolerance or not self._marks or count == MOST_ROUNDS:
                break
            self._split(surface, mesh, first)
        return CarriedMesh(mesh, places, self._deviations)

    def step(self) -> Deviation:
        """Return the deviation at the last frame of the surface of the frame before it, carried there."""
        before, after = self.surface_of(self.numbers[-2]), self.surface_of(self.numbers[-1])
        mesh = before.with_creases()
        self._deviations = {}
        there = moved(before, after, mesh, before.vertices_places())
        self._compare_faces(after, mesh.with_vertices(there.points))
        return self._deviations[after.number]

    def _through(self, mesh: TriangleMesh) -> Iterator[tuple[ShownSurface, Places]]:
        """Yield the surface of each frame, and the places of the vertices on it."""
        first = self.surface_of(self.start)
        begin = first.followed(mesh.vertices, vertex_normals(mesh))
        yield first, begin._replace(points=mesh.vertices)
        for step, end in ((1, self.numbers[-1]), (-1, self.numbers[0])):
            before, places = first, begin._replace(points=mesh.vertices)
            for number in range(self.start + step, end + step, step):
                after = self.surface_of(number)
                places = smoothed(after, mesh, moved(before, after, mesh, places))
                yield after, places
                before = after

    def _compare_edges(self, shown: ShownSurface, mesh: TriangleMesh, here: Places) -> None:
        """Mark the edges that are too long in a frame, or whose middles are off its surface."""
        edges = edges_of(mesh.faces)[0]
        ends, facing = here.points[edges], unit(here.normals[edges].sum(axis=1))
        places, away = self._measure(shown, ends.mean(axis=1), facing)
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        of_file = places.values(shown.mesh.faces, shown.lengths)[:, 0]
        stretch = lengths / np.maximum(of_file, shown.edge)
        need = np.maximum(away / (REFINED * self.tolerance), stretch / STRETCHED)
        rows = np.flatnonzero((need > 1.0) & (lengths > SHORTEST * of_file))
        self._mark(edges[rows], lengths[rows])

    def _compare_faces(self, shown: ShownSurface, mesh: TriangleMesh) -> None:
        """Mark the longest edges of faces that are off the surface of a frame, or that it is off."""
        limit, corners = REFINED * self.tolerance, mesh.vertices[mesh.faces]
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        _, off = self._measure(shown, corners.mean(axis=1), self._facing(shown, mesh))
        theirs = np.concatenate([shown.mesh.vertices, shown.mesh.vertices[shown.mesh.faces].mean(axis=1)])
        normals = np.concatenate([shown.normals, self._facing(shown, shown.mesh)])
        on, face, _ = nearest_points(TriangleTree.of(corners), mesh, theirs, normals, -AGREEING)
        away = self._distances(shown, theirs, on, face)
        faces = np.union1d(face[(away > limit) & (face >= 0)], np.flatnonzero(off > limit))
        faces = faces[lengths[faces].max(axis=1) > SHORTEST * shown.edge]
        side = np.argmax(lengths[faces], axis=1)
        ends = np.stack([mesh.faces[faces, side], mesh.faces[faces, (side + 1) % 3]], axis=1)
        self._mark(ends, lengths[faces, side])

    def _facing(self, shown: ShownSurface, mesh: TriangleMesh) -> Floats:
        """Return the normals (F, 3) of faces, zero for those lower than the tolerance: they may be folded."""
        corners = mesh.vertices[mesh.faces]
        sides = np.roll(corners, -1, axis=1) - corners
        areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        longest = np.linalg.norm(sides, axis=2).max(axis=1)
        is_low = 2.0 * areas < self.tolerance * shown.edge * longest
        return np.where(is_low[:, None], 0.0, mesh.face_normals)

    def _measure(self, shown: ShownSurface, points: Floats, normals: Floats) -> tuple[Places, Floats]:
        """Return the places of points (N, 3) of the mesh on a surface, and their distances (N,) in edges."""
        places = shown.nearest(points, normals, 0.0)
        return places, self._distances(shown, points, places.points, places.face)

    def _distances(self, shown: ShownSurface, points: Floats, on: Floats, face: np.ndarray) -> Floats:
        """Return the distances (N,) of points from those on faces, in edges, and note the largest."""
        away = np.linalg.norm(on - points, axis=1) / shown.edge
        away[face < 0] = np.inf
        worst = int(np.argmax(away))
        known = self._deviations.get(shown.number)
        if known is None or away[worst] > known.distance:
            x, y, z = points[worst].tolist()
            self._deviations[shown.number] = Deviation(float(away[worst]), (x, y, z))
        return away

    def _mark(self, edges: Indices, lengths: Floats) -> None:
        for key, length in zip(edge_keys(edges).tolist(), lengths.tolist(), strict=True):
            self._marks[key] = max(length, self._marks.get(key, 0.0))

    def _split(self, surface: RefinableSurface, mesh: TriangleMesh, first: ShownSurface) -> None:
        """Split the marked edges, those that are longest in a frame first."""
        keys = np.array(sorted(self._marks, key=lambda key: (-self._marks[key], key)))
        if len(mesh.vertices) + len(keys) > self.max_vertices:
            raise FrameError(
                f"one mesh for all these frames needs more than {self.max_vertices} vertices; choose a "
                "coarser --tolerance, or fewer frames"
            )
        parents = ends_of_keys(keys)
        middles = mesh.vertices[parents].mean(axis=1)
        facing = unit(vertex_normals(mesh)[parents].sum(axis=1))
        is_crease = np.isin(keys, edge_keys(mesh.creases))
        on = np.where(is_crease[:, None], middles, first.nearest(middles, facing, 0.0).points)
        surface.replay(parents, np.hstack([on, facing]))


def moved(before: ShownSurface, after: ShownSurface, mesh: TriangleMesh, places: Places) -> Places:
    """Return the places on the surface of a frame of vertices that are at places on that of another."""
    seconds, here = after.seconds - before.seconds, before.velocities(places)
    first = after.followed(places.points + seconds * here, places.normals)
    goals = places.points + 0.5 * seconds * (here + after.velocities(first))
    arrived = after.followed(goals, first.normals)
    rows = bound_vertices(mesh)
    if len(rows):
        on = after.on_bounds(arrived.points[rows])
        arrived.put(rows, after.followed(on, arrived.normals[rows])._replace(points=on))
    return arrived


def farthest(deviations: dict[int, Deviation]) -> int:
    """Return the frame with the largest deviation."""
    return max(deviations, key=lambda number: deviations[number].distance)


def in_words(deviation: Deviation) -> str:
    """Return a distance and a place for messages."""
    x, y, z = deviation.place
    far = "far" if math.isinf(deviation.distance) else f"{deviation.distance:.2g} edges"
    return f"{far} at ({x:.4g}, {y:.4g}, {z:.4g})"
