"""Surfaces of the points that a curve of seeds releases, resampled while they grow (paper: P1, P8, P9).

A point of such a surface has two coordinates: its place on the curve, and a time. On a streak surface that
is when it was released: all points move on, and the newest row is on the curve. On a path surface, and on a
stream surface, it is how long the point has travelled: the points stay where they are, and the last row moves
on. Both are ordinary surfaces in flow: one row of vertices changes its coordinates, the edges that this draws
out are split, and new vertices get their places exactly, by integration from their seeds. Hultquist (1992)
and Garth et al. (2004) add and drop points at the front alone.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from flowsculpt import Resampler, Streamlines, Thresholds, TriangleMesh
from flowsculpt.api.meshes import Floats, carried_normals
from flowsculpt.pipeline.plugins.streams.released_lines import unit_rows
from flowsculpt.pipeline.plugins.streams.seed_curves import Seeds
from flowsculpt.pipeline.plugins.streams.seed_placement import ASTRAY, REST, SeedPlacement
from flowsculpt.pipeline.plugins.streams.sheet_cuts import cut_below, stretches, with_faces
from flowsculpt.pipeline.plugins.streams.stream_values import Parcels, evaluated
from flowsculpt.pipeline.plugins.streams.travels import Travel, travelled_both_ways

MATERIAL = "material"
"""Vertex attribute of frames, (V, 3): the coordinates, which patterns go by."""

_FIRST = 0.7  # edges of the first row, over the longest that may be
HEIGHT = 0.00125
"""How far the middle of an edge may be from the surface by default, over the longest edge."""

NORMAL = "normal"
"""Vertex attribute: unit normals (V, 3), 0 where there is none. They face the same side of the surface."""

_TRIES = 4  # passes in a step, at most
_ALONG = 1e-8  # step of a derivative, over the length of the seeds
_FLAT = 1e-3  # sine of the angle between two directions on the surface, below which it has no normal


class SeedCoordinates:
    """Places on the curve of seeds and times, as points (N, 3) of a flat strip.

    Where the curve is closed they are points of a tube, since the middle of two of them must be between them.
    A second is as long as points travel in one, on average, when they leave the seeds.
    """

    def __init__(self, seeds: Seeds, second: float) -> None:
        self._seeds, self._second = seeds, second
        self._radius = seeds.length / (2.0 * math.pi)

    def of(self, along: Floats, times: Floats) -> Floats:
        """Return coordinates (N, 3) of lengths (N,) along the curve and times (N,)."""
        height = self._second * times
        if not self._seeds.is_closed:
            return np.column_stack([along, np.zeros(len(along)), height])
        angle = along / self._radius
        return np.column_stack([self._radius * np.cos(angle), self._radius * np.sin(angle), height])

    def seeds(self, coordinates: Floats) -> Floats:
        """Return the points (N, 3) of the curve."""
        return self._seeds.points(self.along(coordinates))

    def along(self, coordinates: Floats) -> Floats:
        """Return lengths (N,) along the curve."""
        if not self._seeds.is_closed:
            return np.clip(coordinates[:, 0], 0.0, self._seeds.length)
        angle = np.arctan2(coordinates[:, 1], coordinates[:, 0])
        return np.asarray(self._radius * np.mod(angle, 2.0 * math.pi))

    def times(self, coordinates: Floats) -> Floats:
        return np.asarray(coordinates[:, 2] / self._second)

    def with_time(self, coordinates: Floats, rows: np.ndarray, time: float) -> Floats:
        """Return coordinates of which some rows, by their numbers, have another time."""
        changed = coordinates.copy()
        changed[rows, 2] = self._second * time
        return changed

    def nearest(self, points: Floats) -> Floats:
        """Return the points (N, 3) of the strip or tube nearest to others beside it."""
        if not self._seeds.is_closed:
            return points * np.array([1.0, 0.0, 1.0])
        on = points.copy()
        on[:, :2] *= self._radius / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        return on

    def within(self, coordinates: Floats, low: float, high: float, inside: Floats) -> Floats:
        """Return the nearest coordinates (N, 3) of the curve, between two times.

        inside  (N,) coordinates that are kept from either: a row of one time moves on as a whole
        """
        on = self.nearest(coordinates)
        on[:, 2] = np.clip(on[:, 2], self._second * low + inside, self._second * high - inside)
        if not self._seeds.is_closed:
            on[:, 0] = np.clip(on[:, 0], 0.0, self._seeds.length)
        return on

    def beside(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """Return coordinates (N, 3) a little farther along the curve, with 1, or before, with −1 (N, 1)."""
        along, length = self.along(coordinates), self._seeds.length
        side = np.where(along > 0.5 * length, -1.0, 1.0)  # never beyond an end
        return self.of(along + side * _ALONG * length, self.times(coordinates)), side[:, None]

    def tangents(self, coordinates: Floats) -> Floats:
        """Return the unit vectors (N, 3) along which the length along the curve grows."""
        if not self._seeds.is_closed:
            return np.broadcast_to([1.0, 0.0, 0.0], coordinates.shape)
        x, y = coordinates[:, 0], coordinates[:, 1]
        return np.column_stack([-y, x, np.zeros(len(x))]) / self._radius


class ReleasedSurface(ABC):
    """A surface that grows from a curve of seeds, step after step.

    seeds       the curve
    flow        moves the points
    begin       seconds, when the first ones are released
    thresholds  of its edges; the lengths are numbers
    tear        how far the curve may be stretched; faces that stretch it farther are left out
    length      seconds that points travel
    tolerance   how far the middle of an edge may be from the surface, units; by default HEIGHT
    """

    def __init__(
        self,
        seeds: Seeds,
        flow: Streamlines,
        begin: float,
        thresholds: Thresholds,
        tear: float = math.inf,
        length: float = math.inf,
        tolerance: float | None = None,
    ) -> None:
        self.travel, self._back = Travel(flow, begin), Travel(flow, begin)
        longest, _, _ = thresholds.numbers
        self.thresholds, self.tear, self.length = replace(thresholds, bends=self._bends), tear, length
        count = max(3, math.ceil(seeds.length / (_FIRST * longest)) + 1)
        self._along = np.linspace(0.0, seeds.length, count)[: -1 if seeds.is_closed else None]
        self._first, self._is_closed = seeds.points(self._along), seeds.is_closed
        self._tolerance = tolerance or HEIGHT * longest
        self._step = min(longest, math.sqrt(longest * self._tolerance / HEIGHT))
        speed = np.linalg.norm(flow.field.velocity(self._first, begin), axis=1).mean()
        self.coordinates = SeedCoordinates(seeds, float(speed) or 1.0)
        self._grown: Resampler | None = None
        self._row_time = begin

    @property
    def mesh(self) -> TriangleMesh:
        """The surface, with its coordinates in the attribute `material`."""
        mesh = self._resampler.mesh
        return TriangleMesh(mesh.vertices, mesh.faces, {MATERIAL: mesh.attributes[REST]})

    def parcels(self) -> Parcels:
        """Return the vertices of `mesh`."""
        mesh = self._resampler.mesh
        coordinates = mesh.attributes[REST]
        ages, times = self._ages_and_times(self.coordinates.times(coordinates))
        seeds = self.coordinates.seeds(coordinates)
        return Parcels(mesh.vertices, seeds, ages, times, np.arange(len(seeds)))

    @abstractmethod
    def displaced(self, seeds: Floats, ages: Floats) -> Floats:
        """Return where points (N, 3) that are released elsewhere are, by the ages (N,) of `parcels`."""

    @abstractmethod
    def _ages_and_times(self, times: Floats) -> tuple[Floats, Floats]:
        """Return how long points of times (N,) have travelled, and when they are there, seconds."""

    @property
    def _resampler(self) -> Resampler:
        assert self._grown is not None, "it has grown before it is asked for"
        return self._grown

    def grow(self, until: float) -> None:
        """Move points until a time, in steps in which none goes much farther than an edge that bends may be.

        Raises FrameError where the flow fails or the surface needs more vertices than it may have.
        """
        self._grow(self.travel, until)

    def grow_back(self, until: float) -> None:
        """Move points of a path surface against the flow until a time, before `begin`."""
        self._grow(self._back, until)

    def _grow(self, travel: Travel, until: float) -> None:
        while travel.now != until:
            moving = self._first if self._grown is None else self._moving(travel)
            travel.advance(moving, until, self._leading(travel), self._step)
            self._row_time = self._time_of_row(travel, travel.now)
            if self._grown is None:
                self._grown = Resampler(self._strip(travel), self.thresholds, self._placement)
            else:
                self._move(travel)
            self._resample()
            if self.tear < math.inf:
                self._remove_stretched()

    def _resample(self) -> None:
        """Resample; again where slivers were split so often that vertices were left on their edges."""
        for _ in range(_TRIES):
            if self._resampler.resample().passes <= SeedPlacement.most_rounds:
                return
            mesh = self._resampler.mesh
            is_exact = mesh.attributes[ASTRAY] == 0
            self._resampler.vertices[is_exact] = self.carry(mesh.attributes[REST][is_exact])

    def _bends(self, mesh: TriangleMesh) -> Floats:
        return self._normals(mesh) / (8.0 * self._tolerance)

    @property
    def _placement(self) -> SeedPlacement:
        return SeedPlacement(self.carry, strip=self.coordinates, times=self.times, moves=self._moves)

    def _strip(self, travel: Travel) -> TriangleMesh:
        """Return the first two rows."""
        count = len(self._along)
        rows = [self.coordinates.of(self._along, np.full(count, time)) for time in self._first_times(travel)]
        a = np.arange(count if self._is_closed else count - 1)
        b = (a + 1) % count
        corners = [a, b, b + count], [a, b + count, a + count]
        faces = np.concatenate([np.column_stack(triangles) for triangles in corners])
        coordinates = np.concatenate(rows)
        return TriangleMesh(self.carry(coordinates), faces, {REST: coordinates})

    def _row(self, time: float) -> np.ndarray:
        """Return the numbers of the vertices of one time."""
        coordinates = self._resampler.vectors(REST)
        assert coordinates is not None, "exact placement keeps them"
        return np.flatnonzero(self._are_at(coordinates, time))

    def _are_at(self, coordinates: Floats, time: float) -> np.ndarray:
        """Return flags (N,) of the coordinates (N, 3) that have this time."""
        return np.abs(self.coordinates.times(coordinates) - time) <= 1e-9 * (1.0 + abs(time))

    def _moves(self, coordinates: Floats) -> np.ndarray:
        """Return flags (N,) of the coordinates (N, 3) in the row that the last step moved."""
        return self._are_at(coordinates, self._row_time)

    def _set_time(self, row: np.ndarray, time: float) -> None:
        coordinates = self._resampler.vectors(REST)
        assert coordinates is not None, "exact placement keeps them"
        self._resampler.set_attributes(**{REST: self.coordinates.with_time(coordinates, row, time)})

    def _remove_stretched(self) -> None:
        """Leave out faces in which a length along the seeds has become `tear` times as long."""
        mesh = self._resampler.mesh
        kept = stretches(mesh.vertices, self._flat(mesh), mesh.faces) <= self.tear
        if not kept.all() and kept.any():
            self._go_on(with_faces(mesh, kept))

    def _go_on(self, mesh: TriangleMesh) -> None:
        """Go on with a part of the surface; vertices that could not be placed are still tried again."""
        self._grown = Resampler(mesh, self.thresholds, self._placement)
        self._grown.set_attributes(**{ASTRAY: mesh.attributes[ASTRAY]})

    def _flat(self, mesh: TriangleMesh) -> Floats:
        """Return lengths along the seeds and times (F, 3, 2) of the corners of each face."""
        coordinates = mesh.attributes[REST]
        flat = np.column_stack([self.coordinates.along(coordinates), coordinates[:, 2]])[mesh.faces]
        if self._is_closed:  # a face may lie across the start of the curve
            whole = self._along[-1] + self._along[1]
            flat[..., 0] -= whole * np.round((flat[..., 0] - flat[:, :1, 0]) / whole)
        return flat

    @abstractmethod
    def _first_times(self, travel: Travel) -> tuple[float, float]:
        """Return the times of the two rows after the first step, so that faces are seen from outside."""

    @abstractmethod
    def _time_of_row(self, travel: Travel, end: float) -> float:
        """Return the time of the row that moves on, once a step ends at `end`."""

    def _leading(self, travel: Travel) -> Floats:
        """Return the points (N, 3) between which and their row the next step draws out edges."""
        return self._first

    @abstractmethod
    def _moving(self, travel: Travel) -> Floats:
        """Return the points (N, 3) that the next step moves."""

    @abstractmethod
    def _move(self, travel: Travel) -> None:
        """Move what the last step moves."""

    @abstractmethod
    def times(self) -> tuple[float, float]:
        """Return the first and the last time of points of the surface."""

    @abstractmethod
    def _normals(self, mesh: TriangleMesh) -> Floats:
        """Return the unit normals (V, 3) of the vertices; 0 where there is none."""

    @abstractmethod
    def carry(self, coordinates: Floats) -> Floats:
        """Return where points (N, 3) of these coordinates are now."""

    @abstractmethod
    def velocities(self) -> Floats:
        """Return the velocities (V, 3) of the vertices, units per second."""


class StreakSurface(ReleasedSurface):
    """All points that the seeds have released so far. A time is that of release."""

    def _first_times(self, travel: Travel) -> tuple[float, float]:
        return travel.begin, travel.now

    def _time_of_row(self, travel: Travel, end: float) -> float:
        return end

    def _moving(self, travel: Travel) -> Floats:
        return self._resampler.vertices

    def _move(self, travel: Travel) -> None:
        newest, before = self._row(travel.before), self._resampler.vertices.copy()
        normals = self._resampler.vectors(NORMAL)
        assert normals is not None, "the strip has them"
        self._resampler.vertices[:] = travel.moved(before)
        normals[:] = self._moved_normals(travel, before, unit_rows(normals, fallback=0.0))
        self._set_time(newest, travel.now)
        coordinates, normals = self._resampler.vectors(REST), self._resampler.vectors(NORMAL)
        assert coordinates is not None and normals is not None, "exact placement keeps them"
        self._resampler.vertices[newest] = self.coordinates.seeds(coordinates[newest])
        normals[newest] = self._seed_normals(travel, coordinates[newest])
        if travel.now - travel.begin > self.length:
            self._remove_older(travel.now - self.length)

    def _strip(self, travel: Travel) -> TriangleMesh:
        strip = super()._strip(travel)
        newest = self._seed_normals(travel, strip.attributes[REST][len(self._along) :])
        older = self._moved_normals(travel, self._first, newest)
        return strip.with_attributes(**{NORMAL: np.concatenate([older, newest])})

    def _seed_normals(self, travel: Travel, coordinates: Floats) -> Floats:
        """Return the normals (N, 3) of points that are just released."""
        seeds, (beside, side) = self.coordinates.seeds(coordinates), self.coordinates.beside(coordinates)
        ahead = travel.flow.field.velocity(seeds, travel.now)
        return _normals_between(side * (self.coordinates.seeds(beside) - seeds), ahead)

    def _moved_normals(self, travel: Travel, points: Floats, normals: Floats) -> Floats:
        """Return normals (N, 3) of points after the last step by those before it."""
        return carried_normals(travel.moved, points, travel.moved(points), normals)

    def _remove_older(self, limit: float) -> None:
        """Leave out what was released before a time."""
        mesh = self._resampler.mesh
        part = cut_below(mesh, self.coordinates.times(mesh.attributes[REST]), limit)
        rest = self.coordinates.nearest(part.attributes[REST])
        row = np.flatnonzero(self._are_at(rest, limit))
        rest, points = self.coordinates.with_time(rest, row, limit), part.vertices.copy()
        points[row] = self.carry(rest[row])
        self._go_on(part.with_vertices(points).with_attributes(**{REST: rest}))

    def times(self) -> tuple[float, float]:
        return max(self.travel.begin, self.travel.now - self.length), self.travel.now

    def _normals(self, mesh: TriangleMesh) -> Floats:
        return unit_rows(mesh.attributes[NORMAL], fallback=0.0)

    def carry(self, coordinates: Floats) -> Floats:
        seeds = self.coordinates.seeds(coordinates)
        return self.travel.released(seeds, self.coordinates.times(coordinates))

    def displaced(self, seeds: Floats, ages: Floats) -> Floats:
        return self.travel.released(seeds, self.travel.now - ages)

    def _ages_and_times(self, times: Floats) -> tuple[Floats, Floats]:
        return self.travel.now - times, np.full(len(times), self.travel.now)

    def velocities(self) -> Floats:
        found = self.travel.flow.field.velocity(self._resampler.vertices, self.travel.now)
        found[self._row(self.travel.now)] = 0.0
        return found


class PathSurface(ReleasedSurface):
    """The paths of points released at one time. A time is how long they have travelled, below 0 backwards."""

    _known_normals: Mapping[bytes, Floats] = MappingProxyType({})

    def _first_times(self, travel: Travel) -> tuple[float, float]:
        first, last = sorted([travel.now - travel.begin, 0.0])
        return last, first

    def _time_of_row(self, travel: Travel, end: float) -> float:
        return end - travel.begin

    def _front(self, travel: Travel, end: float) -> np.ndarray:
        return self._row(self._time_of_row(travel, end))

    def _moving(self, travel: Travel) -> Floats:
        return self._resampler.vertices[self._front(travel, travel.now)]

    def _leading(self, travel: Travel) -> Floats:
        return self._first if self._grown is None else self._moving(travel)

    def _move(self, travel: Travel) -> None:
        front = self._front(travel, travel.before)
        self._resampler.vertices[front] = travel.moved(self._resampler.vertices[front])
        self._set_time(front, self._row_time)

    def times(self) -> tuple[float, float]:
        return self._back.now - self._back.begin, self.travel.now - self.travel.begin

    def _normals(self, mesh: TriangleMesh) -> Floats:
        """Return exact normals; points that stay where they are keep theirs.

        Those of faces are one-sided at the front, and the edges that are split there stay.
        """
        coordinates, known = mesh.attributes[REST], dict(self._known_normals)
        names = [row.tobytes() for row in coordinates]
        new = [number for number, name in enumerate(names) if name not in known]
        if new:
            beside, side = self.coordinates.beside(coordinates[new])
            points, others = np.split(self.carry(np.concatenate([coordinates[new], beside])), 2)
            times = self.travel.begin + self.coordinates.times(coordinates[new])
            ahead = evaluated(self.travel.flow.field.velocity, points, times)
            normals = _normals_between(side * (others - points), ahead)
            known.update(zip((names[number] for number in new), normals, strict=True))
        self._known_normals = {name: known[name] for name in names}
        return np.array([known[name] for name in names])

    def carry(self, coordinates: Floats) -> Floats:
        return self.displaced(self.coordinates.seeds(coordinates), self.coordinates.times(coordinates))

    def displaced(self, seeds: Floats, ages: Floats) -> Floats:
        return travelled_both_ways(self.travel, self._back, seeds, ages)

    def _ages_and_times(self, times: Floats) -> tuple[Floats, Floats]:
        return times, self.travel.begin + times

    def velocities(self) -> Floats:
        found = np.zeros_like(self._resampler.vertices)
        front = self._front(self.travel, self.travel.now)
        found[front] = self.travel.flow.field.velocity(self._resampler.vertices[front], self.travel.now)
        return found


def _normals_between(along: Floats, ahead: Floats) -> Floats:
    """Return unit normals (N, 3) of two directions on the surface, 0 where they are about the same."""
    normals = np.cross(unit_rows(along), unit_rows(ahead))
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), _FLAT))
