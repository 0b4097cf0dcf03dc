"""The surface of a subject at any time, between samples of another program.

A time of the flow is one of the samples, times `speed`. Where all samples have the same faces, vertices
follow the line, or the cubic curve, through their samples. Where faces change, the nearest sample is shown,
moved by its velocities: those of the file, else those of vertices whose faces are the same a sample later.
Normals of the file are those of its vertices, except where it has several at one place.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from flowsculpt import MeshError
from flowsculpt.api.files import CachedAnswer
from flowsculpt.api.materials import with_known
from flowsculpt.api.meshes import FileSurface, Floats, find_coincident, repair_surface
from flowsculpt.api.shots import SurfaceSequence
from flowsculpt.pipeline.plugins.sequences.face_comparison import (
    difference_in_words,
    faces_inwards,
    have_same_faces,
)
from flowsculpt.pipeline.plugins.sequences.sliver_normals import sliver_normals
from flowsculpt.pipeline.plugins.sequences.surface_samples import Files, SurfaceSamples, joint

VERSION = 5
"""Raised when equal files and settings give other surfaces."""

EXACT = 1e-6
"""Distance of a time from a sample, in intervals, up to which it is the sample's."""

EARLY = 1 / 16
"""Intervals before a sample from which on it is held: velocities are differences around a frame."""

WELDED = 1e-5
"""Distance, over the size of the surface, up to which vertices that were one in the first frame still are."""

AGREEING = 0.9999
"""Cosine of the angle between normals of vertices at one place from which on they are one normal."""

Between = Literal["linear", "cubic", "hold"]


@dataclass(frozen=True)
class SampleTimes:
    """From the time of the flow to samples.

    times     float64 (T,): seconds of the samples, the first frame of the shot at 0
    interval  seconds between two samples
    speed     seconds of the samples in a second of the flow
    period    seconds after which the first sample follows; None where time does not loop
    may_lack  True if samples may be missing, as numbered files: then times further apart are a gap
    """

    times: Floats
    interval: float
    speed: float
    period: float | None
    may_lack: bool = True

    @property
    def loops(self) -> bool:
        """True if the first sample follows the last."""
        return self.period is not None

    def place(self, seconds: float) -> tuple[int, float]:
        """Return the last sample that is not later, and the share of the way to the next one.

        The share is 0 at a sample. Before the first one it is negative, and after the last one positive.
        """
        time, last = seconds * self.speed, len(self.times) - 1
        if self.period is not None:
            time = self.times[0] + (time - self.times[0]) % self.period
        sample = int(
            np.clip(np.searchsorted(self.times, time + EXACT * self.interval, side="right") - 1, 0, last)
        )
        share = (time - self.times[sample]) / self.length(sample)
        return sample, 0.0 if abs(share) < EXACT else float(share)

    def length(self, sample: int) -> float:
        """Return the seconds from a sample to the next one."""
        last = len(self.times) - 1
        if sample == last:
            return (
                self.interval
                if self.period is None
                else float(self.times[0] + self.period - self.times[last])
            )
        return float(self.times[sample + 1] - self.times[sample])

    def following(self, sample: int, by: int = 1) -> int:
        """Return the sample after another one, or `by` after it: at an end, that end."""
        count = len(self.times)
        return (sample + by) % count if self.loops else min(max(sample + by, 0), count - 1)

    def is_gap(self, sample: int) -> bool:
        """Tell whether samples are missing after one."""
        return self.may_lack and self.length(sample) > (1.0 + EXACT) * self.interval


def looped(times: SampleTimes, samples: SurfaceSamples) -> SampleTimes:
    """Return times that begin again after the last sample; one that equals the first is the first again."""
    last = len(times.times) - 1
    span = float(times.times[last] - times.times[0])
    if last and _same_surface(samples.surface(0), samples.surface(last)):
        return replace(times, times=times.times[:last], period=span)
    return replace(times, period=span + times.interval)


def _same_surface(one: FileSurface, other: FileSurface) -> bool:
    """Tell whether two surfaces have the same faces, and the same points within rounding."""
    if not have_same_faces(one, other):
        return False
    size = float(np.linalg.norm(np.ptp(one.points, axis=0)))
    return float(np.abs(one.points - other.points).max()) <= WELDED * size


@dataclass(frozen=True, eq=False)
class GivenSurfaces(SurfaceSequence):
    """The surfaces of samples at any time.

    asked    whether the shot says that faces are kept; None leaves it to the samples
    repair   as of models
    seconds  the times of the flow at the frames of the shot
    absent   as of `SurfaceSequence`
    array    of numbers at its vertices that looks show; None for none. Each frame then shows its own faces
    """

    samples: SurfaceSamples
    times: SampleTimes
    between: Between
    asked: bool | None
    repair: bool
    seconds: tuple[float, ...]
    absent: tuple[str, str] | None = None
    array: str | None = None

    @property
    def path(self) -> Path:
        return self.samples.model(self._first).path

    @property
    def digest(self) -> str:
        return joint(self.samples.files(self._first))

    @property
    def up(self) -> str | None:
        return self.samples.up

    @cached_property
    def files(self) -> Files:
        """The files of the samples that the frames show, or that their velocities need, and their digests."""
        needed = sorted({sample for seconds in self.seconds for sample in self._near(seconds)})
        return tuple(dict(file for sample in needed for file in self.samples.files(sample)).items())

    @cached_property
    def keeps_faces(self) -> bool:
        """As the shot or the file says; else whether the first, the second and the last sample agree."""
        if self.array is not None:
            return False
        if self.asked is not None:
            return self.asked
        if self.samples.is_fixed is not None:
            return self.samples.is_fixed
        first = self._start.surface
        return all(have_same_faces(first, self.samples.surface(other)) for other in self._others)

    @cached_property
    def _others(self) -> list[int]:
        """The second and the last sample shown, where they are compared with the first; else none."""
        if self.array is not None or self.asked is not None or self.samples.is_fixed is not None:
            return []
        shown = list(dict.fromkeys(self._place(seconds)[0] for seconds in self.seconds))
        return sorted({*shown[1:2], *shown[-1:]} - {self._first})

    @property
    def notes(self) -> tuple[str, ...]:
        return *self._notes_of_facing(), *self._notes_of_velocities()

    def _notes_of_facing(self) -> Iterator[str]:
        """Yield lines about closed surfaces that face inwards; the first, if repaired, has its own line."""
        remedy = ". Write repair: on, which reverses them, or export it with its faces outwards"
        done = "; they are reversed" if self.repair else remedy
        for sample in [*([] if self.repair else [self._first]), *([] if self.keeps_faces else self._others)]:
            if faces_inwards(self.samples.surface(sample)):
                yield f"{self.samples.name(sample)}: the faces of its closed surface are turned inwards{done}"

    def _notes_of_velocities(self) -> tuple[str, ...]:
        if self.keeps_faces or self._start.surface.velocities is not None:
            return ()
        other = self.times.following(self._first)
        if other != self._first and have_same_faces(self._start.surface, self.samples.surface(other)):
            return (
                f"{self.path.name} has no velocities; blur follows vertices where files have the same faces",
            )
        return (f"{self.path.name} has no velocities, and its faces change, so nothing is blurred",)

    def start(self) -> Any:
        return self._start.imported

    def posed(self, points: Floats) -> Floats:
        surface, still = self._start.surface, self.samples.still(self._first)
        if still is surface or not have_same_faces(still, surface):
            return points
        if np.array_equal(points, still.points):
            return surface.points
        origins = _origins(points, still.points)
        known = origins < len(still.points)
        return np.where(known[:, None], surface.points[np.where(known, origins, 0)], points)

    def points(self, seconds: float) -> Floats:
        sample, share = self._place(seconds)
        if not share:
            return self._points(sample)
        if share < 0.0 or (share > 0.0 and self._is_end(sample)):
            return self._beyond(sample, share)
        exact = self.samples.between(float(self.times.times[sample] + share * self.times.length(sample)))
        if exact is not None:
            return self._checked(exact, f"{self.path.name} between its frames")
        here, there = self._points(sample), self._points(self.times.following(sample))
        if self.between == "cubic":
            before = self._points(self.times.following(sample, -1))
            after = self._points(self.times.following(sample, 2))
            return _cubic(before, here, there, after, share)
        return (1.0 - share) * here + share * there

    def normals(self, seconds: float) -> Floats | None:
        sample, share = self._place(seconds)
        here = self._normals(sample)
        if here is None or not 0.0 < share < 1.0 or self._is_end(sample):
            return here
        there = self._normals(self.times.following(sample))
        if there is None:
            return None
        is_known = here.any(axis=1, keepdims=True) & there.any(axis=1, keepdims=True)
        return np.where(is_known, (1.0 - share) * here + share * there, 0.0)

    def surface(self, seconds: float) -> tuple[Any, Floats | None]:
        sample, share = self._place(seconds)
        nearest = self.times.following(sample) if share > 0.5 and not self._is_end(sample) else sample
        polygons = self.samples.surface(nearest)
        mesh = _repaired(self.samples, nearest, self.repair)
        velocities, origins = self._velocities(nearest, polygons), _origins(mesh.vertices, polygons.points)
        if polygons.normals is not None:
            mesh = mesh.with_attributes(normal=_single_normals(polygons)[origins])
        elif (normals := sliver_normals(mesh)) is not None:
            mesh = mesh.with_attributes(normal=normals)
        if self.array is not None:
            values = self._numbers(sample, share, nearest, polygons, self.array)[origins]
            mesh = mesh.with_attributes(values=with_known(values))
        if velocities is None:
            return mesh, None
        moving = velocities[origins]
        away = (
            share * self.times.length(sample)
            if nearest == sample
            else (share - 1.0) * self.times.length(sample)
        )
        mesh = mesh.with_vertices(mesh.vertices + away * moving) if away and self.between != "hold" else mesh
        still = self.between == "hold" or (share != 0.0 and self.times.is_gap(sample))
        return mesh, None if still else self.times.speed * moving

    def data(self, seconds: float) -> Any:
        sample, share = self._place(seconds)
        times, near = self.times, self._near(seconds)
        return {
            "version": VERSION,
            "files": [self.samples.content(each) for each in near],
            "times": [round((times.times[each] - times.times[sample]) / times.interval, 6) for each in near],
            "share": share,
            "interval": times.interval,
            "length": times.length(sample),
            "speed": times.speed,
            "between": self.between,
            "keeps_faces": self.keeps_faces,
            **({} if self.array is None else {"values": self.array}),
        }

    def _numbers(self, sample: int, share: float, nearest: int, polygons: FileSurface, array: str) -> Floats:
        """Return the numbers (V,) of the vertices of the nearest sample, by a straight line between two."""
        here = numbers_of(polygons, array, self.samples.name(nearest))
        other = self.times.following(sample) if nearest == sample else sample
        if not 0.0 < share < 1.0 or self.between == "hold" or other == nearest:
            return here
        there = self.samples.surface(other)
        if not have_same_faces(polygons, there):
            return here
        part = share if nearest == sample else 1.0 - share
        return (1.0 - part) * here + part * numbers_of(there, array, self.samples.name(other))

    def facts(self, seconds: float) -> dict[str, Any]:
        return {} if self.array is None else {"values": self.array, "unit": ""}

    def quantiles(self, shares: Any) -> Any:
        assert self.array is not None, "looks of values need some"
        known = json.dumps(["quantiles", self.array, [self.data(time) for time in self.seconds]])
        answer = CachedAnswer.of("values", [known])
        table = answer.load(lambda kept: [float(each) for each in kept["quantiles"]])
        steps = np.linspace(0.0, 1.0, 1001)
        if table is None or len(table) != len(steps):
            found = [self.surface(time)[0].attributes["values"] for time in self.seconds]
            values = np.concatenate([each[each[:, 1] > 0.5, 0] for each in found])
            if not len(values):
                raise MeshError(f"{self.array} has no number in any frame. Show another array.")
            table = np.quantile(values, steps).tolist()
            answer.store_alone({"quantiles": table})
        return np.interp(shares, steps, table).tolist()

    def _near(self, seconds: float) -> list[int]:
        """Return the samples that decide the surface at a time, and its velocities."""
        sample, share = self._place(seconds)
        around: tuple[int, ...] = (-1, 0, 1, 2) if share else (-1, 0, 1)
        if share and self.keeps_faces and self.between != "cubic":
            around = 0, 1
        return sorted({self.times.following(sample, by) for by in around})

    # Samples

    @cached_property
    def _first(self) -> int:
        return self._place(0.0)[0]

    def _place(self, seconds: float) -> tuple[int, float]:
        """Return the sample and the share that are shown at a time: 0 where the sample is held."""
        sample, share = self.times.place(seconds)
        if share > 0.0 and (self.between == "hold" or self.times.is_gap(sample)) and not self._is_end(sample):
            early = EARLY * self.times.interval / self.times.length(sample)
            return (self.times.following(sample), 0.0) if share > 1.0 - early else (sample, 0.0)
        is_far = (self._is_end(sample) and share > EARLY) or share < -EARLY
        return sample, 0.0 if is_far or (share and self.between == "hold") else share

    def _is_end(self, sample: int) -> bool:
        return not self.times.loops and sample == len(self.times.times) - 1

    def _beyond(self, sample: int, share: float) -> Floats:
        """Return points a little before the first sample, or after the last: their path goes straight on."""
        other = self.times.following(sample, -1 if share > 0.0 else 1)
        if other == sample:
            return self._points(sample)
        here, step = self._points(sample), self.times.length(min(sample, other))
        rate = (here - self._points(other)) / step * (1.0 if share > 0.0 else -1.0)
        return here + share * self.times.length(sample) * rate

    def _points(self, sample: int) -> Floats:
        """Return the positions (V, 3) of a sample of the vertices of the first frame's surface."""
        return self._checked(self.samples.surface(sample), self.samples.name(sample))

    def _normals(self, sample: int) -> Floats | None:
        """Return the normals (V, 3) that a sample has at the vertices of the first frame's surface."""
        surface = self.samples.surface(sample)
        return None if surface.normals is None else _single_normals(surface)[self._start.origins]

    def _checked(self, surface: FileSurface, name: str) -> Floats:
        """Return where a surface, called `name` in messages, has the vertices (V, 3) of the first one."""
        start, first = self._start, self.samples.name(self._first)
        if not have_same_faces(start.surface, surface):
            raise MeshError(f"{name}: {difference_in_words(start.surface, surface, first)}")
        points = surface.points[start.origins]
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            vertex = int(start.origins[bad[0]]) + (surface.base or 0)
            raise MeshError(
                f"{name}: vertex {vertex} is at ({', '.join(f'{x:g}' for x in points[bad[0]])}), which is "
                "not finite; coordinates must be numbers. Export it again."
            )
        apart = np.linalg.norm(
            surface.points[start.welded[:, 0]] - surface.points[start.welded[:, 1]], axis=1
        )
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        if len(apart) and apart.max() > WELDED * size:
            a, b = start.welded[int(apart.argmax())] + (surface.base or 0)
            raise MeshError(
                f"{name}: vertices {a} and {b}, which are one in {first}, are {apart.max():.3g} apart. "
                "Begin with a frame in which they are apart, or write faces: changing."
            )
        return points

    def _velocities(self, sample: int, surface: FileSurface) -> Floats | None:
        """Return the velocities (V, 3) of a file's vertices, units per second of it; None if unknown."""
        if surface.velocities is not None:
            return surface.velocities
        ends: list[tuple[Floats, float]] = []
        for by in (-1, 1):
            other = self.times.following(sample, by)
            first = sample if by > 0 else other
            if other == sample or self.times.is_gap(first):
                continue
            there = self.samples.surface(other)
            if have_same_faces(surface, there):
                ends.append((there.points, by * self.times.length(first)))
        if not ends:
            return None
        if len(ends) == 1:
            ends.append((surface.points, 0.0))
        (here, begin), (there_points, end) = ends
        return (there_points - here) / (end - begin)

    @cached_property
    def _start(self) -> _Start:
        return _start(self.samples, self._first, self.repair)


@dataclass(frozen=True, eq=False)
class _Start:
    """The first frame's surface.

    imported  the sound surface
    surface   the polygons of its file
    origins   int64 (V,): a vertex of the file at the place of each of the sound surface
    welded    int64 (K, 2): vertices of the file at one place
    """

    imported: Any
    surface: FileSurface
    origins: np.ndarray
    welded: np.ndarray


@lru_cache(maxsize=2)
def _start(samples: SurfaceSamples, first: int, repair: bool) -> _Start:
    surface, still, imported = (
        samples.surface(first),
        samples.still(first),
        samples.model(first).surface(repair),
    )
    used = np.zeros(len(still.points), bool)
    used[still.corners] = True
    one = find_coincident(still.points, used)
    double = np.flatnonzero(used & (one != np.arange(len(one))))
    origins = _origins(imported.mesh.vertices, still.points)
    if still is not surface:  # of an animation that the shot does not show from its beginning
        is_same = have_same_faces(still, surface)
        moved = imported.mesh.with_vertices(surface.points[origins]) if is_same else None
        mesh = moved or _repaired(samples, first, repair)
        imported = replace(imported, mesh=mesh, notes=surface.notes)  # those of the still one may not hold
    return _Start(imported, surface, origins, np.column_stack([one[double], double]))


@lru_cache(maxsize=2)
def _repaired(samples: SurfaceSamples, sample: int, repair: bool) -> Any:
    try:
        return repair_surface(samples.surface(sample), repair).mesh
    except MeshError as error:
        raise MeshError(f"{samples.name(sample)}: {error}") from None


def _origins(vertices: Floats, points: Floats) -> np.ndarray:
    """Return a point of the file (V,) at the place of each vertex of a surface that was made of it."""
    if np.array_equal(vertices, points):  # nothing was merged, as in most files
        return np.arange(len(points))
    every = np.concatenate([points, vertices]) + 0.0  # -0.0 is 0.0
    _, first, place = np.unique(every.view("V24").ravel(), return_index=True, return_inverse=True)
    return np.asarray(first[place.reshape(-1)[len(points) :]])


def _single_normals(surface: FileSurface) -> Floats:
    """Return the normals (V, 3) of a file's vertices, 0 where vertices at one place have others."""
    assert surface.normals is not None, "the file has them"
    one = find_coincident(surface.points, np.ones(len(surface.points), bool))
    normals = surface.normals.copy()
    cosines = np.einsum("ij,ij->i", normals, normals[one])
    sizes = np.linalg.norm(normals, axis=1)
    normals[one[~(cosines >= AGREEING * sizes * sizes[one])]] = 0.0
    return normals


def numbers_of(surface: FileSurface, array: str, name: str) -> Floats:
    """Return the numbers (V,) of an array of a file. Raises MeshError, with its name, where it has none."""
    if surface.numbers is None:
        raise MeshError(f"{name}: values are read from files of VTK, as .vtp and .vtu. Leave values out.")
    try:
        return surface.numbers(array)
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from None


def _cubic(before: Floats, here: Floats, there: Floats, after: Floats, share: float) -> Floats:
    """Return points on curves through samples, whose slopes are those between their neighbours."""
    slope, end = 0.5 * (there - before), 0.5 * (after - here)
    s2, s3 = share * share, share**3
    return (
        (2.0 * s3 - 3.0 * s2 + 1.0) * here
        + (s3 - 2.0 * s2 + share) * slope
        + (3.0 * s2 - 2.0 * s3) * there
        + (s3 - s2) * end
    )
