"""Lines of the points that seeds release, as tubes: streamlines, paths and streaks, many at once.

All lines have points at the same times, so that they are one array (T, L, 3). Where any line has two points
farther apart than an edge may be long, all get one more between them, by integration from the seeds.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from flowsculpt import FrameError, Streamlines, TriangleMesh
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.streams.seed_curves import Seeds
from flowsculpt.pipeline.plugins.streams.stream_values import Parcels
from flowsculpt.pipeline.plugins.streams.travels import Travel, travelled_both_ways

SIDES = 12
"""Of a tube."""

MOST_POINTS = 2000
"""Of a line, in a frame."""

_THINNEST = 1e-3  # radius of a tube that does not show, over what it would be: its faces keep an area
_CAP = np.radians([90.0, 60.0, 30.0])  # latitudes of the rings that round an end off


class ReleasedLines(ABC):
    """Lines that grow from seeds, step after step.

    along    (L,) lengths along the curve of seeds, where lines begin
    longest  distance of two neighbours on a line, units
    radius   of the tubes, units
    flatten  thickness of a tube over its width, which lies across the line and along the seeds
    taper    width of a tube where its points come from, over that where they go
    length   seconds that points of a streak travel
    """

    _source = 0  # the row of points that come last along the flow

    def __init__(
        self,
        seeds: Seeds,
        flow: Streamlines,
        begin: float,
        count: int,
        longest: float,
        radius: float,
        flatten: float = 1.0,
        taper: float = 1.0,
        length: float = math.inf,
    ) -> None:
        self.along = np.linspace(0.0, seeds.length, count + seeds.is_closed)[:count]
        self.travel, self.back = Travel(flow, begin), Travel(flow, begin)
        self._seeds = seeds.points(self.along)
        ahead = seeds.points(np.minimum(self.along + 1e-4 * seeds.length, seeds.length))
        behind = seeds.points(np.maximum(self.along - 1e-4 * seeds.length, 0.0))
        self._across = ahead - behind
        self._longest, self._length = longest, length
        self._radius, self._flatten, self._taper = radius, flatten, taper
        speed = np.linalg.norm(flow.field.velocity(self._seeds, begin), axis=1).mean()
        self._second = float(speed) or 1.0
        self._times, self._points = [0.0], self._seeds[None]

    def grow(self, until: float) -> None:
        """Move points until a time. Raises FrameError where the flow fails."""
        self._grow(self.travel, until)

    def grow_back(self, until: float) -> None:
        """Move points against the flow until a time, before `begin`."""
        self._grow(self.back, until)

    def _grow(self, travel: Travel, until: float) -> None:
        while travel.now != until:
            travel.advance(self._moving(travel), until, self._leading(travel), self._longest)
            self._move(travel)

    @property
    def mesh(self) -> TriangleMesh:
        """The tubes, with the attribute `material`: length along the seeds, 0, and time."""
        times = self._second * np.array(self._times)
        ages = np.abs(np.array(self._times) - self._times[self._source])
        widths = self._taper + (1.0 - self._taper) * ages / (ages.max() or 1.0)
        mesh, rows = tubes(self._points, self._across, self._radius * widths, self._flatten)
        self._rows = rows
        line = np.arange(len(rows)) // (len(rows) // len(self.along))
        material = np.column_stack([self.along[line], np.zeros(len(rows)), times[rows]])
        return mesh.with_attributes(material=material)

    def velocities(self) -> Floats:
        """Return the velocities (V, 3) of the vertices of the last `mesh`, units per second."""
        moving = self._velocities()
        line = np.arange(len(self._rows)) // (len(self._rows) // len(self.along))
        return moving[self._rows, line]

    def parcels(self) -> Parcels:
        """Return the points of the lines, of which the vertices of the last `mesh` show some."""
        rows, lines, _ = self._points.shape
        line = np.arange(len(self._rows)) // (len(self._rows) // lines)
        ages, times = (np.repeat(each, lines) for each in self._ages_and_times())
        seeds = np.tile(self._seeds, (rows, 1))
        return Parcels(self._points.reshape(-1, 3), seeds, ages, times, self._rows * lines + line)

    @abstractmethod
    def displaced(self, seeds: Floats, ages: Floats) -> Floats:
        """Return where points (N, 3) that are released elsewhere are, by the ages (N,) of `parcels`."""

    @abstractmethod
    def _ages_and_times(self) -> tuple[Floats, Floats]:
        """Return how long the points of each row (T,) have travelled, and when they are there, seconds."""

    def _leading(self, travel: Travel) -> Floats:
        """Return the points (N, 3) that the next step draws out lines between and their neighbours."""
        return self._seeds

    @abstractmethod
    def _moving(self, travel: Travel) -> Floats:
        """Return the points (N, 3) that the next step moves."""

    @abstractmethod
    def _move(self, travel: Travel) -> None:
        """Move what the last step moves."""

    @abstractmethod
    def _velocities(self) -> Floats:
        """Return the velocities (T, L, 3) of the points."""


class StreakLines(ReleasedLines):
    """All points that the seeds have released so far, each line from the oldest to the newest."""

    _source = -1

    def _moving(self, travel: Travel) -> Floats:
        return self._points.reshape(-1, 3)

    def _move(self, travel: Travel) -> None:
        moved = travel.moved(self._points.reshape(-1, 3)).reshape(self._points.shape)
        self._points = np.concatenate([moved, self._seeds[None]])
        self._times.append(travel.now - travel.begin)
        oldest = self._times[-1] - self._length
        if oldest > self._times[0]:
            kept = int(np.searchsorted(self._times, oldest, side="right"))
            first = travel.released(self._seeds, np.full(len(self._seeds), travel.begin + oldest))
            self._points = np.concatenate([first[None], self._points[kept:]])
            self._times = [oldest, *self._times[kept:]]
        self._refine()

    def displaced(self, seeds: Floats, ages: Floats) -> Floats:
        return self.travel.released(seeds, self.travel.now - ages)

    def _ages_and_times(self) -> tuple[Floats, Floats]:
        ages = self.travel.now - self.travel.begin - np.array(self._times)
        return ages, np.full(len(ages), self.travel.now)

    def _refine(self) -> None:
        """Add points between neighbours that are too far apart, and leave out those that are too near."""
        while True:
            gaps = np.linalg.norm(np.diff(self._points, axis=0), axis=2).max(axis=1)
            long = np.flatnonzero(gaps > self._longest)
            times = np.array(self._times)
            middles = 0.5 * (times[long] + times[long + 1])
            if not len(long) or (times[long + 1] - times[long]).min() < 1e-9:
                break
            if len(times) + len(middles) > MOST_POINTS:
                raise FrameError(
                    f"a line needs more than {MOST_POINTS} points, since neighbours on it are carried apart. "
                    "Raise max_edge_length, or write a shorter length."
                )
            seeds = np.tile(self._seeds, (len(middles), 1))
            when = np.repeat(self.travel.begin + middles, len(self._seeds))
            between = self.travel.released(seeds, when).reshape(len(middles), -1, 3)
            self._points = np.insert(self._points, long + 1, between, axis=0)
            self._times = np.insert(times, long + 1, middles).tolist()
        reach = np.linalg.norm(self._points[2:] - self._points[:-2], axis=2).max(axis=1, initial=0.0)
        spare = 1 + np.flatnonzero(reach < 0.5 * self._longest)
        spare = spare[np.concatenate([[True], np.diff(spare) > 1])] if len(spare) else spare
        self._points = np.delete(self._points, spare, axis=0)
        self._times = np.delete(self._times, spare).tolist()

    def _velocities(self) -> Floats:
        found = self.travel.flow.field.velocity(self._points.reshape(-1, 3), self.travel.now)
        found = found.reshape(self._points.shape)
        found[-1] = 0.0
        return found


class PathLines(ReleasedLines):
    """The paths of points released at one time; backwards they have negative times."""

    def _moving(self, travel: Travel) -> Floats:
        return self._points[-1 if travel is self.travel else 0]

    def _leading(self, travel: Travel) -> Floats:
        return self._moving(travel)

    def _move(self, travel: Travel) -> None:
        moved = travel.moved(self._moving(travel))[None]
        ahead = travel is self.travel
        self._points = np.concatenate([self._points, moved] if ahead else [moved, self._points])
        self._times.insert(len(self._times) if ahead else 0, travel.now - travel.begin)

    def displaced(self, seeds: Floats, ages: Floats) -> Floats:
        return travelled_both_ways(self.travel, self.back, seeds, ages)

    def _ages_and_times(self) -> tuple[Floats, Floats]:
        ages = np.array(self._times)
        return ages, self.travel.begin + ages

    def _velocities(self) -> Floats:
        found = np.zeros_like(self._points)
        found[-1] = self.travel.flow.field.velocity(self._points[-1], self.travel.now)
        return found


def tubes(centres: Floats, across: Floats, radii: Floats, flatten: float) -> tuple[TriangleMesh, np.ndarray]:
    """Return tubes about lines, with round ends, and the row (V,) of `centres` that each vertex belongs to.

    centres  (T, L, 3), two rows or more
    across   (L, 3) along which a tube is wide where it begins; it is carried along the line without a twist
    radii    (T,) half the width at each row
    flatten  thickness over width

    Lines shorter than a tube is wide are as thin as they are short, so those that stand still do not show.
    """
    rows, lines, _ = centres.shape
    length = np.linalg.norm(np.diff(centres, axis=0), axis=2).sum(axis=0)
    thin = np.clip(length / (2.0 * radii.max()), _THINNEST, 1.0)[None, :, None]
    ahead = unit_rows(np.gradient(centres, axis=0))
    wide = _carried(ahead, across)
    thick = np.cross(ahead, wide)
    rings = np.concatenate([np.zeros(len(_CAP), int), np.arange(rows), np.full(len(_CAP), rows - 1)])
    latitude = np.concatenate([_CAP, np.zeros(rows), _CAP[::-1]])
    shift = (
        radii[rings] * flatten * np.sin(latitude) * np.repeat([-1.0, 0.0, 1.0], [len(_CAP), rows, len(_CAP)])
    )
    size = radii[rings] * np.cos(latitude)
    middles = centres[rings] + shift[:, None, None] * thin * ahead[rings]
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    cosines, sines = np.cos(angle)[:, None], flatten * np.sin(angle)[:, None]
    offsets = cosines * wide[rings][:, :, None] + sines * thick[rings][:, :, None]
    sizes = size[:, None, None, None] * thin[..., None]
    points = middles[:, :, None] + sizes * offsets  # (R, L, SIDES, 3)
    count = len(rings)
    inner = points[1:-1].transpose(1, 0, 2, 3).reshape(lines, -1, 3)  # the first and last rings are poles
    body = np.concatenate([inner, middles[:1].transpose(1, 0, 2), middles[-1:].transpose(1, 0, 2)], axis=1)
    one, row_of = _tube_faces(count - 2), np.concatenate([np.repeat(rings[1:-1], SIDES), [0, rows - 1]])
    faces = (one[None] + body.shape[1] * np.arange(lines)[:, None, None]).reshape(-1, 3)
    return TriangleMesh(body.reshape(-1, 3), faces), np.tile(row_of, lines)


def _tube_faces(rings: int) -> np.ndarray:
    """Return the faces of a tube: vertices of rings, SIDES each, then the poles before and after them."""
    side = np.arange(SIDES)
    after = (side + 1) % SIDES
    first = SIDES * np.arange(rings - 1)[:, None]
    a, b, c, d = first + side, first + after, first + SIDES + after, first + SIDES + side
    walls = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    low, high, last = SIDES * rings, SIDES * rings + 1, SIDES * (rings - 1)
    caps = [np.column_stack([np.full(SIDES, low), after, side])]
    caps.append(np.column_stack([np.full(SIDES, high), last + side, last + after]))
    return np.concatenate([walls, *caps])


def _carried(ahead: Floats, across: Floats) -> Floats:
    """Return unit vectors (T, L, 3) across lines that turn as little as they can from row to row."""
    sides = np.empty_like(ahead)
    side = across
    for row, along in enumerate(ahead):
        side = side - np.einsum("ij,ij->i", side, along)[:, None] * along
        weak = np.linalg.norm(side, axis=1) < 1e-9 * (1e-12 + np.linalg.norm(across, axis=1).max())
        if weak.any():  # the seeds lie along the line
            axis = np.eye(3)[np.argmin(np.abs(along[weak]), axis=1)]
            side[weak] = np.cross(along[weak], axis)
        side = unit_rows(side)
        sides[row] = side
    return sides


def unit_rows(vectors: Floats, fallback: float = 1.0) -> Floats:
    """Return vectors (…, 3) with length 1; those of length 0 along x, as long as `fallback`."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    along = np.zeros_like(vectors)
    along[..., 0] = fallback
    return np.where(length > 0.0, vectors / np.where(length > 0.0, length, 1.0), along)
