"""One mesh of a sequence whose faces change: the surface of one frame, carried through all others.

From frame to frame its vertices follow the velocities of the files, by the trapezoidal rule, and are drawn
to the nearest place of the file's surface whose normal agrees, so not across thin walls; files with the same
faces carry them instead. Creases stay on creases, and poor triangles are smoothed along the surface. Where
the mesh stretches or leaves the files' surfaces, edges are split at the frame that it begins with, and it is
carried again.
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
    CarriedFaces,
    Places,
    ShownSurface,
    ends_of_keys,
    nearest_points,
    unit,
)

VERSION = 4
"""Raised when equal frames and settings give another mesh."""

MOST_ROUNDS = 16
"""Times that the mesh is refined."""

MANY = 0.02
"""The share of edges to be split from which on the mesh is carried again: new vertices of fewer edges are put
between their parents in every frame, which keeps all others."""

ENOUGH_ROUNDS, FEW = 4, 0.01
"""Rounds from which on a share of the edges may remain too long, where the mesh is within the tolerance."""

GAIN, PATIENCE = 0.95, 3
"""A mesh whose largest distance is not less than GAIN of that PATIENCE rounds ago is not refined further."""

FOLDED = 0.0
"""The shape of triangles that lie backwards, up to which the corners of faces with new vertices are moved."""

REFINED = 0.7
"""The share of the tolerance from which on edges are split: the rest is for places between samples."""

MOST_PIECES = 4.0
"""Pieces that an edge is split into at once."""

STRETCHED = 2.0
"""The length of an edge, over the median of the file's or those around it, from which on it is split."""

SHORTEST = 0.3
"""The length of an edge, over the file's, up to which it is never split."""

DRAWN = 0.5
"""The distance, in median edges, over which a vertex is drawn to a tip of a file's surface."""


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
    _marks: dict[int, tuple[float, float]] = field(default_factory=dict)
    _deviations: dict[int, Deviation] = field(default_factory=dict)

    def carried(self, began: Began) -> CarriedMesh:
        """Return the mesh, refined until it is within the tolerance.

        Else it is refined as long as that helps: the edges to be split become fewer, and distances less.

        Raises FrameError where it needs too many vertices.
        """
        first = self.surface_of(self.start)
        surface, faces = RefinableSurface(first.with_creases()), CarriedFaces(first.with_creases())
        places, far = dict[int, Places](), list[int]()
        births: list[Indices] = []
        marked, distances = 0, list[float]()
        for count in range(MOST_ROUNDS + 1):
            known = len(places[self.start].points) if births else 0
            new = faces.edges[faces.edges.max(axis=1) >= known]
            self._marks = {}
            passed = began(f"carrying {count + 1}" if count else "carrying", len(self.numbers))
            for number, here in self._born(faces, places, births) if births else self._through(faces):
                places[number] = here
                self._compare_edges(self.surface_of(number), new, here)
                passed()
            few = FEW * len(faces.edges) if count >= ENOUGH_ROUNDS else 0
            before, marked = marked, len(self._marks)
            is_last = count == MOST_ROUNDS or (count >= ENOUGH_ROUNDS and marked > max(before, few))
            if marked <= few or is_last:
                far = self._far_frames(faces, places, far, began)
                distances.append(max(found.distance for found in self._deviations.values()))
                if not far or not self._marks or is_last or _is_stuck(distances):
                    break
            is_many = len(self._marks) > MANY * len(faces.edges)
            births = self._split(surface, first)
            faces = CarriedFaces(surface.mesh())
            births = [] if is_many else births
        if far:
            self._far_frames(faces, places, [], began)
        return CarriedMesh(faces.mesh, places, self._deviations)

    def step(self) -> Deviation:
        """Return the deviation at the last frame of the surface of the frame before it, carried there."""
        before, after = self.surface_of(self.numbers[-2]), self.surface_of(self.numbers[-1])
        mesh = before.with_creases()
        self._deviations = {}
        there = moved(before, after, CarriedFaces(mesh).is_bound, before.vertices_places())
        self._compare_faces(after, mesh, there)
        return self._deviations[after.number]

    def _through(self, faces: CarriedFaces) -> Iterator[tuple[int, Places]]:
        """Yield the number of each frame, and the places of the vertices on its surface."""
        first, mesh = self.surface_of(self.start), faces.mesh
        begin = first.followed(mesh.vertices, vertex_normals(mesh))._replace(points=mesh.vertices)
        yield self.start, begin
        for step, end in ((1, self.numbers[-1]), (-1, self.numbers[0])):
            before, places = first, begin
            for number in range(self.start + step, end + step, step):
                after = self.surface_of(number)
                places = smoothed(after, faces, moved(before, after, faces.is_bound, places))
                yield number, places
                before = after

    def _born(
        self, faces: CarriedFaces, places: dict[int, Places], births: list[Indices]
    ) -> Iterator[tuple[int, Places]]:
        """Yield the number of each frame, and the places with those of new vertices, between their parents.

        places  of the other vertices
        births  parents (N, 2) of the new ones, in turn
        """
        for number in self.numbers:
            shown, here = self.surface_of(number), places[number]
            for parents in births:
                first = len(here.points)
                facing = unit(here.normals[parents].sum(axis=1))
                there = shown.followed(here.points[parents].mean(axis=1), facing)
                bound(shown, faces.is_bound[first : first + len(parents)], there)
                here = here.joined(there)
            if number == self.start:
                yield number, here._replace(points=faces.mesh.vertices)
            else:
                yield number, smoothed(shown, faces, here, FOLDED)

    def _far_frames(
        self, faces: CarriedFaces, places: dict[int, Places], before: list[int], began: Began
    ) -> list[int]:
        """Measure the frames; return those beyond the tolerance.

        before  those that were: if one still is, the others are not measured
        """
        self._deviations = {}
        passed = began("comparing", len(self.numbers))
        for numbers in (before, sorted({*self.numbers} - {*before})):
            for number in numbers:
                shown = self.surface_of(number)
                as_carried = self._compared(shown, faces, places[number])
                if as_carried.distance > self.tolerance and number != self.start:
                    drawn = self._drawn_to_tips(shown, faces, places[number])
                    if self._compared(shown, faces, drawn).distance < as_carried.distance:
                        places[number] = drawn
                    else:
                        self._deviations[number] = as_carried
                passed()
            far = [n for n, found in self._deviations.items() if found.distance > self.tolerance]
            if far:
                break
        return far

    def _compared(self, shown: ShownSurface, faces: CarriedFaces, here: Places) -> Deviation:
        """Return the deviation in a frame; mark the edges that are to be split for it."""
        self._deviations.pop(shown.number, None)
        self._compare_edges(shown, faces.edges, here)
        self._compare_faces(shown, faces.mesh, here)
        return self._deviations[shown.number]

    def _drawn_to_tips(self, shown: ShownSurface, faces: CarriedFaces, here: Places) -> Places:
        """Return places (V,) with corners of the faces that cut off vertices of a file put on these.

        A split puts the new vertex beside a tip, never on it.
        """
        mesh, tips = faces.mesh.with_vertices(here.points), shown.mesh.vertices
        tree = TriangleTree.of(mesh.vertices[mesh.faces])
        on, face, shares = nearest_points(tree, mesh, tips, shown.normals, -AGREEING)
        away = np.linalg.norm(on - tips, axis=1) / shown.edge
        vertex = np.take_along_axis(mesh.faces[face], shares.argmax(axis=1)[:, None], axis=1)[:, 0]
        is_near = np.linalg.norm(mesh.vertices[vertex] - tips, axis=1) < DRAWN * shown.edge
        may_move = ~faces.is_bound[vertex] | CarriedFaces(shown.with_creases()).is_bound
        is_cut = (face >= 0) & (away > REFINED * self.tolerance) & is_near & may_move
        rows = np.flatnonzero(is_cut)
        rows = rows[np.argsort(-away[rows], kind="stable")]
        _, once = np.unique(vertex[rows], return_index=True)
        rows, places = rows[once], Places(*(values.copy() for values in here))
        places.put(vertex[rows], Places(*(values[rows] for values in shown.vertices_places())))
        return places

    def _compare_edges(self, shown: ShownSurface, edges: Indices, here: Places) -> None:
        """Mark the edges that are too long in a frame, or whose middles are off its surface."""
        ends, facing = here.points[edges], unit(here.normals[edges].sum(axis=1))
        places, away = self._measure(shown, ends.mean(axis=1), facing)
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        of_file = places.values(shown.mesh.faces, shown.lengths)[:, 0]
        stretch = lengths / np.maximum(of_file, shown.edge)
        pieces = np.maximum(np.sqrt(away / (REFINED * self.tolerance)), stretch / STRETCHED)
        rows = np.flatnonzero((pieces > 1.0) & (lengths > SHORTEST * of_file))
        self._mark(edges[rows], lengths[rows], np.minimum(pieces[rows], MOST_PIECES))

    def _compare_faces(self, shown: ShownSurface, mesh: TriangleMesh, here: Places) -> None:
        """Mark the longest edges of faces that are off the surface of a frame, or that it is off.

        A face that lies backwards is compared with the surface that its corners are on: the mesh overlaps
        itself there, along the surface.
        """
        mesh = mesh.with_vertices(here.points)
        limit, corners = REFINED * self.tolerance, mesh.vertices[mesh.faces]
        facing, upwards = self._facing(shown, mesh), unit(here.normals[mesh.faces].sum(axis=1))
        facing = np.where((np.einsum("ij,ij->i", facing, upwards) < 0.0)[:, None], upwards, facing)
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        _, off = self._measure(shown, corners.mean(axis=1), facing)
        theirs = np.concatenate([shown.mesh.vertices, shown.mesh.vertices[shown.mesh.faces].mean(axis=1)])
        normals = np.concatenate([shown.normals, self._facing(shown, shown.mesh)])
        on, face, _ = nearest_points(TriangleTree.of(corners), mesh, theirs, normals, -AGREEING)
        away = self._distances(shown, theirs, on, face)
        faces = np.union1d(face[(away > limit) & (face >= 0)], np.flatnonzero(off > limit))
        faces = faces[lengths[faces].max(axis=1) > SHORTEST * shown.edge]
        side = np.argmax(lengths[faces], axis=1)
        ends = np.stack([mesh.faces[faces, side], mesh.faces[faces, (side + 1) % 3]], axis=1)
        self._mark(ends, lengths[faces, side], np.full(len(faces), 2.0))

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

    def _mark(self, edges: Indices, lengths: Floats, pieces: Floats) -> None:
        """Mark edges (N, 2) that are to be split into so many pieces, with their lengths in a frame."""
        for key, *mark in zip(edge_keys(edges).tolist(), lengths.tolist(), pieces.tolist(), strict=True):
            length, count = self._marks.get(key, (0.0, 0.0))
            self._marks[key] = max(length, mark[0]), max(count, mark[1])

    def _split(self, surface: RefinableSurface, first: ShownSurface) -> list[Indices]:
        """Split the marked edges, those that are longest in a frame first, and then their halves.

        Returns the parents (N, 2) of the new vertices, in turn.
        """
        marks, births = self._marks, list[Indices]()
        while marks:
            mesh = surface.mesh()
            keys = np.array(sorted(marks, key=lambda key: (-marks[key][0], key)))
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
            births.append(parents)
            middle = len(mesh.vertices) + np.arange(len(keys))
            halves = (edge_keys(np.column_stack([end, middle])).tolist() for end in parents.T)
            halved = [
                (0.5 * length, 0.5 * pieces) for length, pieces in map(marks.__getitem__, keys.tolist())
            ]
            marks = {half: mark for of_end in halves for half, mark in zip(of_end, halved, strict=True)}
            marks = {half: mark for half, mark in marks.items() if mark[1] > 1.0}
        return births


def _is_stuck(distances: list[float]) -> bool:
    """Tell whether the largest distances of a mesh, round by round, have ceased to shrink."""
    return len(distances) > PATIENCE and distances[-1] >= GAIN * distances[-1 - PATIENCE]


def moved(before: ShownSurface, after: ShownSurface, is_bound: np.ndarray, places: Places) -> Places:
    """Return the places on the surface of a frame of vertices that are at places on that of another.

    is_bound  flags (N,) of vertices that stay on creases and rims

    Where both have the same faces, these carry the places; velocities of files may miss a sudden start.
    """
    if np.array_equal(before.mesh.faces, after.mesh.faces):
        return after.on_faces(places)
    seconds, here = after.seconds - before.seconds, before.velocities(places)
    first = after.followed(places.points + seconds * here, places.normals)
    goals = places.points + 0.5 * seconds * (here + after.velocities(first))
    arrived = after.followed(goals, first.normals)
    bound(after, is_bound, arrived)
    return arrived


def bound(shown: ShownSurface, is_bound: np.ndarray, places: Places) -> None:
    """Put the places of vertices, flags (N,), on the creases and rims of a surface that are near."""
    rows = np.flatnonzero(is_bound)
    if len(rows):
        on = shown.on_bounds(places.points[rows])
        places.put(rows, shown.followed(on, places.normals[rows])._replace(points=on))


def in_words(deviation: Deviation, tolerance: float) -> str:
    """Return how a mesh deviates from a file's surface, and where, for messages."""
    place = ", ".join(f"{x:.4g}" for x in deviation.place)
    if math.isinf(deviation.distance):
        return f"turned away at ({place}) from the file's faces, which may be wound the other way round"
    away = f"{deviation.distance:.2g} edges at ({place}) from the file's surface"
    return f"{away}, and --tolerance is {tolerance:g}"
