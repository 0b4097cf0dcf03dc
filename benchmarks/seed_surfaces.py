"""`python -m benchmarks.seed_surfaces [FIELD …]`: surfaces from seeds against the exact ones, and VTK's.

Four fields, each on a grid of 96³ samples, which both programs interpolate linearly: ABC, a double gyre as it
is at one time, Enright's, and a dipole of two vortices, whose saddle tears a front apart. Seeds on a line
travel for some seconds. The exact surface is a table of points, in 16 steps a frame, of 320 seeds and of more
where these come to be farther apart than an 80th of the length of all. Columns:

    vertices       of the surface
    distance       rms of its vertices and face centres from the exact surface
    gap            the largest distance of the exact surface from it
    longest        the longest edge
    placed         the largest distance of a vertex from where its seed and age put it, over the diagonal
    off            share of vertices that were not placed exactly, %
    CPU s          of the surface, without reading the field

Lengths are in twentieths of the seeds. In all fields our edges may be LONGEST of them long, and their middles
TOLERANCE off the surface: so flat parts are coarse, and bends fine.

VTK's is ruled between as many streamlines as give it as many vertices, cut off at the same travel, as
`vtkStreamSurface` rules it, in the steps along them, of STEPS, with which it comes nearest: its edges have no
maximum. Surfaces that leave out a part of the exact one count only where all do, and then those that leave
out about the least: at a saddle others are near, since what is hard is not there. VTK has no path and streak
surfaces of changing fields. Needs `benchmarks/requirements.txt`.
"""

from __future__ import annotations

import importlib
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks import peers
from benchmarks.report import Row, Target, keep, show
from flowsculpt import Streamlines, Thresholds, VelocityField
from flowsculpt.api.flows import Sampled, Samples, TriangleTree
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.flow.catalogue.basic import DoubleGyre, Enright
from flowsculpt.pipeline.plugins.streams.released_surfaces import (
    MATERIAL,
    PathSurface,
    ReleasedSurface,
    StreakSurface,
)
from flowsculpt.pipeline.plugins.streams.seed_curves import SeedCurve
from flowsculpt.pipeline.plugins.streams.seed_placement import REST
from flowsculpt.pipeline.plugins.streams.travels import Travel

SAMPLES, FRAMES, DENSER, PER_FRAME, WIDEST = 96, 72, 16, 16, 0.25
UNIT = 1 / 20
"""The unit of lengths, over the length of the seeds."""

LONGEST, TOLERANCE = 3.0, 1 / 800
"""The longest that our edges may be, and the farthest that their middles may be off the surface, units."""

STEPS = 1.0, 0.7, 0.5, 0.35, 0.25
"""Steps along the streamlines of VTK, units."""

_LESS_LEFT_OUT = 1.5  # times the smallest gap of VTK's surfaces that all leave out a part

Velocities = Callable[[Floats, Floats, Floats], tuple[Floats, Floats, Floats]]


@dataclass(frozen=True)
class Work:
    """A field within a box, the ends of a line of seeds, and seconds of travel."""

    velocities: Velocities
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    ends: tuple[tuple[float, float, float], tuple[float, float, float]]
    seconds: float

    def axes(self) -> tuple[Floats, Floats, Floats]:
        x, y, z = (np.linspace(low, high, SAMPLES) for low, high in zip(self.low, self.high, strict=True))
        return x, y, z

    def grid(self) -> Floats:
        """Return velocities (X, Y, Z, 3)."""
        return np.stack(
            np.broadcast_arrays(*self.velocities(*np.meshgrid(*self.axes(), indexing="ij"))), axis=-1
        )

    def field(self) -> Sampled:
        return Sampled(samples=Samples.of_arrays(self.axes(), np.zeros(1), self.grid()[None], ("",)))


def _abc(x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
    a, b, c, k = 1.0, math.sqrt(2 / 3), math.sqrt(1 / 3), math.pi / 2
    return (
        a * np.sin(k * z) + c * np.cos(k * y),
        b * np.sin(k * x) + a * np.cos(k * z),
        c * np.sin(k * y) + b * np.cos(k * x),
    )


def _of(field: VelocityField, moment: float, lift: float = 0.0) -> Velocities:
    """Return the velocities of a field at a time, and with `lift` across its plane."""

    def velocities(x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
        points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
        u, v, w = field.velocity(points, moment).T.reshape(3, *x.shape)
        return u, v, w + lift * np.sin(np.pi * x)

    return velocities


def _dipole(x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
    """Two vortices that turn against each other, in a stream against them: ahead of them is a saddle."""
    u, v = np.full_like(x, -0.25), np.zeros_like(x)
    for centre, strength in ((0.4, 1.0), (-0.4, -1.0)):
        dx, dy = x, y - centre
        turn = strength * 0.5 / (dx * dx + dy * dy + 0.05)
        u, v = u + turn * dy * -1.0, v + turn * dx
    return u, v, 0.1 * np.cos(y)


WORKS = {
    "ABC": Work(_abc, (-4, -4, -4), (4, 4, 4), ((-1, 0.1, 0.2), (1, 0.1, 0.2)), 3.0),
    "double gyre": Work(
        _of(DoubleGyre(), 0.4, 0.1), (-2, -2, -1), (2, 2, 1), ((-0.6, 0.1, -0.2), (0.6, 0.2, 0.2)), 6.0
    ),
    "Enright": Work(_of(Enright(), 0.0), (-1, -1, -1), (2, 2, 2), ((0.2, 0.3, 0.35), (0.5, 0.3, 0.35)), 1.5),
    "dipole": Work(_dipole, (-3, -3, -3), (3, 3, 3), ((-1.6, -0.5, 0), (-1.6, 0.6, 0)), 4.0),
}


def main() -> list[Target]:
    """Measure the works that are named, or all; return the targets."""
    rows: list[Row] = []
    targets: list[Target] = []
    for name in sys.argv[1:] or WORKS:
        work = WORKS[name]
        field, seeds = work.field(), SeedCurve(np.array(work.ends, np.float64))
        exact, seen = Exact(field, seeds, work.seconds), {}
        for kind in (PathSurface, StreakSurface):
            seen[kind.__name__] = ours(name, work, field, seeds, exact, kind)
        if peers.found("vtkmodules"):
            seen["VTK"] = theirs(name, work, seeds, exact, int(seen["PathSurface"]["vertices"]))
        rows += seen.values()
        targets += _targets(name, seen)
    keep("seed_surfaces", rows)
    show(f"Surfaces from seeds, {FRAMES} frames, lengths in 1/{round(1 / UNIT)} of the seeds", rows)
    return targets


class Exact:
    """The exact surface of a steady field: points (T, N, 3) by time of travel and seed."""

    def __init__(self, field: VelocityField, seeds: SeedCurve, seconds: float) -> None:
        self.unit = UNIT * seeds.length
        self._travel, self._seeds = Travel(Streamlines(field), 0.0), seeds
        along = np.linspace(0.0, seeds.length, DENSER * math.ceil(seeds.length / self.unit) + 1)
        rows = [seeds.points(along)]
        for step in range(1, PER_FRAME * FRAMES + 1):
            self._travel.advance(rows[-1], seconds * step / (PER_FRAME * FRAMES), rows[-1], np.inf)
            rows.append(self._travel.moved(rows[-1]))
        self.points = np.stack(rows)
        while True:
            apart = np.linalg.norm(np.diff(self.points, axis=1), axis=2).max(axis=0)
            far = np.flatnonzero((apart > WIDEST * self.unit) & (np.diff(along) > 1e-13 * seeds.length))
            if not len(far):
                break
            between = 0.5 * (along[far] + along[far + 1])
            self.points = np.insert(self.points, far + 1, self._paths(between), axis=1)
            along = np.insert(along, far + 1, between)
        columns = len(along)
        size = np.arange(self.points.shape[0] * columns).reshape(-1, columns)
        a, b, c, d = size[:-1, :-1], size[:-1, 1:], size[1:, 1:], size[1:, :-1]
        self.faces = np.concatenate(
            [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
        )

    def _paths(self, along: Floats) -> Floats:
        """Return the points (T, N, 3) of other seeds."""
        rows = [self._seeds.points(along)]
        for step in self._travel.steps:
            rows.append(step.moved(rows[-1]))
        return np.stack(rows)

    @cached_property
    def _nearest(self) -> tuple[Floats, TriangleTree]:
        corners = np.ascontiguousarray(self.points.reshape(-1, 3)[self.faces])
        return corners, TriangleTree.of(corners)

    def compare(self, points: Floats, faces: np.ndarray) -> Row:
        """Return how far a surface and the exact one are from each other."""
        here = np.concatenate([points, points[faces].mean(axis=1)])
        away = _distances(here, *self._nearest)
        corners = points[faces]
        sparse = self.points[::PER_FRAME, ::4].reshape(-1, 3)
        gap = _distances(sparse, corners, TriangleTree.of(np.ascontiguousarray(corners))).max()
        ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        edges = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
        return {
            "vertices": len(points),
            "distance": float(np.sqrt((away**2).mean())) / self.unit,
            "gap": float(gap) / self.unit,
            "longest": float(edges.max()) / self.unit,
        }


def _distances(points: Floats, corners: Floats, tree: TriangleTree) -> Floats:
    face, shares = tree.nearest(np.ascontiguousarray(points))
    weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
    return np.asarray(np.linalg.norm(np.einsum("nk,nkj->nj", weights, corners[face]) - points, axis=1))


def ours(
    name: str, work: Work, field: VelocityField, seeds: SeedCurve, exact: Exact, kind: type[ReleasedSurface]
) -> Row:
    """Measure a path or streak surface; of a steady field both are its stream surface."""
    began = time.process_time()
    thresholds = Thresholds(LONGEST * exact.unit)
    surface = kind(seeds, Streamlines(field), 0.0, thresholds, tolerance=TOLERANCE * exact.unit)
    for frame in range(1, FRAMES + 1):
        surface.grow(work.seconds * frame / FRAMES)
    seconds, mesh = time.process_time() - began, surface.mesh
    inner = surface._resampler.mesh
    on = inner.attributes["astray"] == 0
    off = np.linalg.norm(surface.carry(inner.attributes[REST]) - inner.vertices, axis=1)
    assert MATERIAL in mesh.attributes
    return {
        "field": name,
        "surface": kind.__name__,
        **exact.compare(mesh.vertices, mesh.faces),
        "placed": float(off[on].max() / np.linalg.norm(np.ptp(mesh.vertices, axis=0))),
        "off": 100.0 * float(1.0 - on.mean()),
        "CPU s": seconds,
    }


def theirs(name: str, work: Work, seeds: SeedCurve, exact: Exact, vertices: int) -> Row:
    """Measure vtkStreamSurface at about as many vertices, in the steps with which it comes nearest.

    A surface leaves out a part of the exact one where this is farther away than a twentieth of the seeds.
    """
    found: list[Row] = []
    for step in STEPS:
        count, used = 30, 30
        for _ in range(3):
            used, (places, faces, seconds) = count, _ruled(work, seeds, exact.unit, count, step)
            if abs(len(places) - vertices) < 0.1 * vertices:
                break
            count = max(4, round(count * vertices / len(places)))
        about = {"field": name, "surface": f"VTK, {used} streamlines, steps of {step:g}"}
        found.append(about | exact.compare(places, faces) | {"CPU s": seconds})
    most = max(1.0, _LESS_LEFT_OUT * min(float(row["gap"]) for row in found))
    return min(found, key=lambda row: (float(row["gap"]) > most, float(row["distance"])))


def _ruled(
    work: Work, seeds: SeedCurve, unit: float, count: int, step: float
) -> tuple[Floats, np.ndarray, float]:
    """Return vertices and faces of VTK's surface, and CPU seconds."""
    model = importlib.import_module("vtkmodules.vtkCommonDataModel")
    support = importlib.import_module("vtkmodules.util.numpy_support")
    paths = importlib.import_module("vtkmodules.vtkFiltersFlowPaths")
    core, filters, modelling = (
        importlib.import_module(f"vtkmodules.{each}")
        for each in ("vtkCommonCore", "vtkFiltersCore", "vtkFiltersModeling")
    )
    grid = model.vtkImageData()
    axes = work.axes()
    grid.SetDimensions(*map(len, axes))
    grid.SetOrigin(*(axis[0] for axis in axes))
    grid.SetSpacing(*(axis[1] - axis[0] for axis in axes))
    velocity = support.numpy_to_vtk(work.grid().transpose(2, 1, 0, 3).reshape(-1, 3), deep=True)
    velocity.SetName("velocity")
    grid.GetPointData().SetVectors(velocity)
    points, line, source = core.vtkPoints(), model.vtkCellArray(), model.vtkPolyData()
    line.InsertNextCell(count)
    for place in seeds.points(np.linspace(0.0, seeds.length, count)):
        line.InsertCellPoint(points.InsertNextPoint(*place))
    source.SetPoints(points)
    source.SetLines(line)
    began = time.process_time()
    tracer = paths.vtkStreamTracer()
    tracer.SetInputData(grid)
    tracer.SetSourceData(source)
    tracer.SetIntegrationDirectionToForward()
    tracer.SetIntegratorTypeToRungeKutta4()
    fastest = float(np.linalg.norm(work.grid(), axis=-1).max())
    tracer.SetMaximumPropagation(fastest * work.seconds)
    tracer.SetIntegrationStepUnit(1)
    tracer.SetInitialIntegrationStep(step * unit)
    tracer.Update()
    ruled = modelling.vtkRuledSurfaceFilter()
    ruled.SetInputData(_cut_off(tracer.GetOutput(), work.seconds, core, model, support))
    ruled.SetRuledModeToPointWalk()
    ruled.SetOnRatio(1)
    triangles = filters.vtkTriangleFilter()
    triangles.SetInputConnection(ruled.GetOutputPort())
    triangles.Update()
    seconds, out = time.process_time() - began, triangles.GetOutput()
    places = support.vtk_to_numpy(out.GetPoints().GetData()).astype(np.float64)
    faces = support.vtk_to_numpy(out.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return places, faces, seconds


def _cut_off(lines: Any, seconds: float, core: Any, model: Any, support: Any) -> Any:
    """Return streamlines of VTK that end after so many seconds."""
    places = support.vtk_to_numpy(lines.GetPoints().GetData())
    times = support.vtk_to_numpy(lines.GetPointData().GetArray("IntegrationTime"))
    offsets = support.vtk_to_numpy(lines.GetLines().GetOffsetsArray())
    corners = support.vtk_to_numpy(lines.GetLines().GetConnectivityArray())
    points, kept, out = core.vtkPoints(), model.vtkCellArray(), model.vtkPolyData()
    for first, last in pairwise(offsets):
        line = corners[first:last]
        inside = line[times[line] < seconds]
        end = [np.interp(min(seconds, times[line].max()), times[line], places[line, k]) for k in range(3)]
        kept.InsertNextCell(len(inside) + 1)
        for place in [*places[inside], end]:
            kept.InsertCellPoint(points.InsertNextPoint(*place))
    out.SetPoints(points)
    out.SetLines(kept)
    return out


def _targets(name: str, seen: dict[str, Row]) -> list[Target]:
    found = []
    for kind in ("PathSurface", "StreakSurface"):
        found.append(Target(name, "longest edge", float(seen[kind]["longest"]), most=LONGEST))
        placed = float(seen[kind]["placed"])
        found.append(Target(name, "vertices placed, over the diagonal", placed, most=1e-5))
    if "VTK" in seen:
        one, other = seen["PathSurface"], seen["VTK"]
        for what, most in (("distance", 0.5), ("gap", 0.05)):
            ratio = float(one[what]) / float(other[what])
            found.append(Target(name, f"{what}, over VTK's", ratio, most=most))
        worse = float(seen["StreakSurface"]["distance"]) / float(one["distance"])
        found.append(Target(name, "distance of a streak surface, over a path surface's", worse, most=1.25))
    return found


if __name__ == "__main__":
    show("Targets", [target.row for target in main()])
