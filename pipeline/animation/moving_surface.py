"""The surface that the frame loop moves: how its vertices follow the flow and how its frames are taken."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from pipeline.animation.fit_remedy import fit_remedy, is_usual_size
from pipeline.animation.frame import MATERIAL, FrameReport, MeshFrame
from pipeline.errors import FlowsculptError, FrameError, VertexBudgetError
from pipeline.flow import Flow
from pipeline.flow.flow_map import FlowMap, FrameStep
from pipeline.mesh import TriangleMesh
from pipeline.mesh.control_net import Lattice
from pipeline.mesh.identity import Register
from pipeline.mesh.normals import NORMAL, carried_normals, tangent_distance, vertex_normals
from pipeline.resample import Exact, PolyhedralResampler, Report, Resampler, Thresholds
from pipeline.resample.rest_surface import REST, REST_NORMAL
from pipeline.shot import Motion, Resampling
from pipeline.statistics import COUNTED_FRAMES, MeshStatistics, mesh_statistics


def step_into(motion: Motion, flow: Flow, frame: int) -> FrameStep:
    """Return the step of the flow that leads into `frame`."""
    return FrameStep(motion.limit_steps(flow, frame), *motion.step(frame), frame)


class RestInterval:
    """The frames that share a surface at rest: the first frame's, or every `rest_interval`-th after it.

    The cost of carrying points grows with the interval, so a new surface at rest bounds it. Intervals follow
    from frame numbers, so that a run resumed at any frame has the same ones.

    end   the frame whose surface is the next one at rest
    next  returns the interval that begins there
    """

    def __init__(self, motion: Motion, resampling: Resampling, flow: Flow, number: int) -> None:
        first, length = motion.frames.first, resampling.rest_interval
        start = first + (number - first) // length * length
        self.end = start + length
        self.history = FlowMap()
        for frame in range(start + 1, number + 1):
            self.history.add(step_into(motion, flow, frame))
        project = motion.analytic_surface() if start == first else None
        self.placement = Exact(self.history.carry, project, tags_creases=False)
        self.next = partial(RestInterval, motion, resampling, flow, self.end)


R = TypeVar("R", Resampler, PolyhedralResampler)

MOVED_TOGETHER = 1 << 17
"""Vertices that the flow moves together: more take memory for copies, and fewer take more calls."""


def blocks_of(count: int) -> Iterator[slice]:
    """Yield slices of MOVED_TOGETHER that cover so many vertices; the last one is shorter."""
    for first in range(0, count, MOVED_TOGETHER):
        yield slice(first, min(first + MOVED_TOGETHER, count))


def thresholds_at(motion: Motion, resampling: Resampling, frame: int) -> Thresholds:
    """Return the thresholds of a frame."""
    return resampling.thresholds.at(frame, motion.clock.time(frame))


class MovingSurface:
    """A surface, point cloud or control net whose vertices only move."""

    def __init__(self, motion: Motion, mesh: TriangleMesh, lattice: Lattice | None = None) -> None:
        self._motion, self._mesh, self._register, self._lattice = motion, mesh, Register.of(mesh), lattice

    def move(self, step: FrameStep) -> None:
        """Move the vertices by one step of the flow."""
        points = np.array(self._mesh.vertices)
        for block in blocks_of(len(points)):
            points[block] = step.apply(points[block], block.start)
        points.flags.writeable = False  # so that the mesh takes the array itself
        self._mesh = self._mesh.with_vertices(points)

    def frame(self, number: int, ready: Callable[[], None] = lambda: None) -> MeshFrame:
        """Return the surface as frame `number`; `ready` is called before its arrays are copied."""
        ready()
        report = _report(self._motion, number, self._mesh, None)
        frame = MeshFrame(number, self._mesh, report, lattice=self._lattice)
        if self._register is None:
            return frame
        return replace(frame, births=self._register.births, identities=self._register.given)


class _ResampledSurface(MovingSurface, Generic[R]):
    """A surface that is resampled when its frame is taken."""

    def __init__(
        self, motion: Motion, resampling: Resampling, resampler: R, start_vertices: int | None = None
    ) -> None:
        self._motion, self._resampling, self._start_vertices = motion, resampling, start_vertices
        self._resampler: R = resampler

    def move(self, step: FrameStep) -> None:
        points = self._resampler.vertices
        for block in blocks_of(len(points)):
            points[block] = step.apply(points[block], block.start)

    def _resample(self, number: int) -> Report:
        """Resample once; errors name the frame."""
        try:
            thresholds = thresholds_at(self._motion, self._resampling, number)
            most = self._most_vertices
            if most is not None and most < thresholds.max_vertices:
                thresholds = replace(thresholds, max_vertices=most)
            self._resampler.thresholds = thresholds
            return self._resampler.resample()
        except VertexBudgetError as error:
            if thresholds.max_vertices == most:
                raise self._grown(error.fact, number) from error
            extent = float(np.ptp(self._resampler.vertices, axis=0).max())
            fit = fit_remedy(self._motion, extent)
            if not fit or is_usual_size(extent):
                raise error.of(number) from error
            raise error.with_remedy(fit, number) from error
        except FrameError as error:
            raise error.of(number) from error
        except FlowsculptError as error:
            raise FrameError(str(error), number) from error

    @property
    def _most_vertices(self) -> int | None:
        """The vertices that `max_growth` allows; None where it limits nothing."""
        growth, start = self._resampling.max_growth, self._start_vertices
        return None if growth is None or start is None else max(4, int(growth * start))

    def _grown(self, fact: str, number: int) -> FrameError:
        """Return the error of a frame that needs more vertices than `max_growth` allows."""
        return FrameError(
            f"{fact}: max_growth {self._resampling.max_growth:g} times the {self._start_vertices} of frame "
            f"{self._motion.frames.first}; slow the flows down, or raise max_growth or max_edge_length",
            number,
        )

    def _report(self, number: int, mesh: TriangleMesh, resampling: Report) -> FrameReport:
        """Return the report of a frame. The first one starts the count of growth."""
        if number == self._motion.frames.first:
            self._start_vertices = len(mesh.vertices)
        return replace(_report(self._motion, number, mesh, resampling), start_vertices=self._start_vertices)


class PolygonSurface(_ResampledSurface[PolyhedralResampler]):
    """A surface of polygons (P16); frames show it as triangles."""

    def frame(self, number: int, ready: Callable[[], None] = lambda: None) -> MeshFrame:
        report = self._resample(number)
        ready()
        polygons = self._resampler.mesh
        mesh = polygons.triangulated()
        return MeshFrame(number, mesh, self._report(number, mesh, report), polygons)


class TriangleSurface(_ResampledSurface[Resampler]):
    """A surface of triangles."""

    def frame(self, number: int, ready: Callable[[], None] = lambda: None) -> MeshFrame:
        report, resampler = self._resample(number), self._resampler
        ready()
        self._renew_rest(number)
        mesh = resampler.mesh
        frame_report = self._report(number, mesh, report)
        given, unsorted = resampler.identities, resampler.unsorted
        return MeshFrame(
            number, mesh, frame_report, births=resampler.births, identities=given, unsorted=unsorted
        )

    def _renew_rest(self, number: int) -> None:
        """Make the present surface the one at rest, where a rest interval ends; others have none."""


class ExactSurface(TriangleSurface):
    """A surface with rest positions, whose normals are carried by the flow."""

    def __init__(
        self,
        motion: Motion,
        resampling: Resampling,
        resampler: Resampler,
        interval: RestInterval,
        start_vertices: int | None = None,
    ) -> None:
        super().__init__(motion, resampling, resampler, start_vertices)
        self._interval = interval

    def move(self, step: FrameStep) -> None:
        points, normals = self._resampler.vertices, self._resampler.vectors(NORMAL)
        if normals is None:
            super().move(step)
        else:
            distance = tangent_distance(points)
            for block in blocks_of(len(points)):
                before, apart = points[block].copy(), np.full(block.stop - block.start, distance)
                points[block] = step.apply(before, block.start)
                move = partial(step.apply, first=block.start)
                normals[block] = carried_normals(move, before, points[block], normals[block], apart)
        self._interval.history.add(step)

    def _renew_rest(self, number: int) -> None:
        if number != self._interval.end:
            return
        self._interval, resampler = self._interval.next(), self._resampler
        rest = resampler.vectors(REST)
        if rest is not None and resampler.vectors(MATERIAL) is None:
            resampler.set_attributes(**{MATERIAL: rest})
        normals = vertex_normals(resampler.bare_mesh)
        resampler.set_attributes(**{REST: resampler.vertices, REST_NORMAL: normals})
        resampler.placement = self._interval.placement


def _report(motion: Motion, number: int, mesh: TriangleMesh, resampling: Report | None) -> FrameReport:
    """Return the report of a frame: its number alone decides whether crossings are counted."""
    is_counted = (number - motion.frames.first) % COUNTED_FRAMES == 0
    return FrameReport(resampling, partial(_statistics, mesh, is_counted))


def _statistics(mesh: TriangleMesh, count_crossings: bool) -> MeshStatistics | None:
    return mesh_statistics(mesh, count_crossings) if len(mesh.faces) else None
