"""The frame loop: displace, resample, yield; resumable from any frame. And the surface that it moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from pipeline.animation.fit_remedy import fit_remedy, is_usual_size
from pipeline.animation.frame import MATERIAL, FrameReport, Mesh, MeshFrame, with_material
from pipeline.arrays import AnyArray, Floats, Vectors
from pipeline.errors import FlowsculptError, FrameError, UsageError, VertexBudgetError
from pipeline.flow import Displacement, Flow, as_flow
from pipeline.flow.flow_map import FlowMap, FrameStep
from pipeline.mesh import PolygonMesh, TriangleMesh
from pipeline.mesh.control_net import Lattice
from pipeline.mesh.identity import Register, with_identities
from pipeline.mesh.normals import NORMAL, carried_normals, tangent_distance, vertex_normals
from pipeline.resample import Exact, PolyhedralResampler, Report, Resampler, Thresholds, edges_by_angle
from pipeline.resample.creases import edges_in_region
from pipeline.resample.resampler import STATELESS
from pipeline.resample.rest_surface import REST, REST_NORMAL
from pipeline.shot import Motion, Resampling, Shot
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

    def __init__(self, motion: Motion, resampling: Resampling, resampler: R) -> None:
        self._motion, self._thresholds = motion, partial(thresholds_at, motion, resampling)
        self._resampler: R = resampler

    def move(self, step: FrameStep) -> None:
        points = self._resampler.vertices
        for block in blocks_of(len(points)):
            points[block] = step.apply(points[block], block.start)

    def _resample(self, number: int) -> Report:
        """Resample once; errors name the frame."""
        try:
            self._resampler.thresholds = self._thresholds(number)
            return self._resampler.resample()
        except VertexBudgetError as error:
            extent = float(np.ptp(self._resampler.vertices, axis=0).max())
            fit = fit_remedy(self._motion, extent)
            if not fit or is_usual_size(extent):
                raise error.of(number) from error
            raise error.with_remedy(fit, number) from error
        except FrameError as error:
            raise error.of(number) from error
        except FlowsculptError as error:
            raise FrameError(str(error), number) from error


class PolygonSurface(_ResampledSurface[PolyhedralResampler]):
    """A surface of polygons (P16); frames show it as triangles."""

    def frame(self, number: int, ready: Callable[[], None] = lambda: None) -> MeshFrame:
        report = self._resample(number)
        ready()
        polygons = self._resampler.mesh
        mesh = polygons.triangulated()
        return MeshFrame(number, mesh, _report(self._motion, number, mesh, report), polygons)


class TriangleSurface(_ResampledSurface[Resampler]):
    """A surface of triangles."""

    def frame(self, number: int, ready: Callable[[], None] = lambda: None) -> MeshFrame:
        report, resampler = self._resample(number), self._resampler
        ready()
        self._renew_rest(number)
        mesh = resampler.mesh
        frame_report = _report(self._motion, number, mesh, report)
        given, unsorted = resampler.identities, resampler.unsorted
        return MeshFrame(
            number, mesh, frame_report, births=resampler.births, identities=given, unsorted=unsorted
        )

    def _renew_rest(self, number: int) -> None:
        """Make the present surface the one at rest, where a rest interval ends; others have none."""


class ExactSurface(TriangleSurface):
    """A surface with rest positions, whose normals are carried by the flow."""

    def __init__(
        self, motion: Motion, resampling: Resampling, resampler: Resampler, interval: RestInterval
    ) -> None:
        super().__init__(motion, resampling, resampler)
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


def animate(
    shot: Shot | Motion,
    resume: MeshFrame | None = None,
    flow: Flow | Displacement | None = None,
    ready: Callable[[], None] = lambda: None,
) -> Iterator[MeshFrame]:
    """Yield the shot's frames in order: each moved by the flow for one frame, then resampled once (P6).

    The first frame is the subject at rest, resampled only. With `resume`, yields the frames after that one,
    with the same bits as an uninterrupted run. `flow` replaces the shot's own: any callable `points, time, dt
    -> points` (P1). `ready` is called before the arrays of each frame are copied: who still holds those of
    the frame before may free them first.

    Raises FrameError, with its `frame`, where the flow fails or the surface cannot be resampled; the frames
    before it have been yielded. MeshError and MissingInputError for an unusable subject.
    """
    motion = shot.motion if isinstance(shot, Shot) else shot
    acting = motion.flow if flow is None else as_flow(flow)
    if resume is None:
        number = motion.frames.first
        surface = at_rest(motion, acting)
        yield surface.frame(number, ready)
    else:
        number = resume.number
        surface = resumed(motion, acting, resume)
        del resume  # its arrays are copied, and take memory while frames are computed
    for frame in range(number + 1, motion.frames.last + 1):
        surface.move(step_into(motion, acting, frame))
        yield surface.frame(frame, ready)


def at_rest(motion: Motion, flow: Flow) -> MovingSurface:
    """Return the subject before anything has moved it, not resampled yet.

    Raises UsageError where points are to be resampled.
    """
    resampling, first = motion.resampling, motion.frames.first
    if resampling is None:
        mesh = with_material(with_identities(motion.mesh_at_rest()))
        return MovingSurface(motion, mesh, motion.subject.lattice)
    if not motion.subject.is_surface:
        raise UsageError("points and control nets are not resampled; take resampling out of the motion")
    thresholds = thresholds_at(motion, resampling, first)
    if resampling.method == "polyhedra":
        polygons = with_material(motion.polygons_at_rest())
        polygons = _creased(polygons, resampling, _hard_angles(polygons, thresholds))
        polyhedral = PolyhedralResampler(polygons, thresholds, resampling.cutting, resampling.collapse)
        return PolygonSurface(motion, resampling, polyhedral)
    mesh = with_identities(motion.mesh_at_rest())
    mesh = _creased(mesh, resampling, thresholds.hard_angles(mesh))
    if resampling.placement != "exact":
        mesh = with_material(mesh)
    elif resampling.normals == "carried":
        mesh = mesh.with_attributes(**{NORMAL: _normals_at_rest(motion, mesh)})
    return _triangle_surface(motion, resampling, flow, first, partial(Resampler, mesh, thresholds))


def _triangle_surface(
    motion: Motion, resampling: Resampling, flow: Flow, frame: int, resampler: Callable[..., Resampler]
) -> TriangleSurface:
    """Return the surface of a resampler, made with the placement that the shot names."""
    options = resampling.min_roundness, resampling.splits
    if resampling.placement != "exact":
        return TriangleSurface(motion, resampling, resampler(STATELESS[resampling.placement], *options))
    interval = RestInterval(motion, resampling, flow, frame)
    return ExactSurface(motion, resampling, resampler(interval.placement, *options), interval)


def _creased(mesh: Mesh, resampling: Resampling, hard_angles: float | Floats) -> Mesh:
    """Return the mesh at rest with the edges tagged that are to stay hard (P31)."""
    if resampling.creases == "model":
        return mesh
    if resampling.creases == "none":
        return mesh.with_creases([])
    if resampling.creases == "rest":
        return mesh.with_creases(edges_by_angle(mesh, hard_angles))
    return mesh.with_creases(edges_in_region(mesh, resampling.creases))


def _hard_angles(polygons: PolygonMesh, thresholds: Thresholds) -> float | Floats:
    """Return hard angles, radians; functions are evaluated on the triangulated polygons."""
    angles = thresholds.hard_angles(polygons.triangulated())
    return angles if isinstance(angles, float) else angles[: len(polygons.vertices)]


def _normals_at_rest(motion: Motion, mesh: TriangleMesh) -> Vectors:
    """Return normals (V, 3) of the analytic surface if it is known, else of the mesh; zero at creases."""
    truth = motion.analytic_surface()
    normals = vertex_normals(mesh) if truth is None else truth.normals(mesh.vertices)
    normals[mesh.creases.ravel()] = 0.0
    return normals


def resumed(motion: Motion, flow: Flow, frame: MeshFrame) -> MovingSurface:
    """Return the surface as it was at a frame; vertices and faces keep their order.

    Raises UsageError where the frame lacks what the shot's resampling resumes from.
    """
    resampling = motion.resampling
    if resampling is None:
        return MovingSurface(motion, frame.mesh, frame.lattice)
    thresholds = thresholds_at(motion, resampling, frame.number)
    if resampling.method == "polyhedra":
        polygons = frame.polygons
        if polygons is None:
            raise UsageError(
                f"frame {frame.number} has no polygons, which method polyhedra goes on from; "
                "resume from a frame that was made with it"
            )
        state = _state(polygons, offsets=polygons.offsets, corners=polygons.corners)
        polyhedral = PolyhedralResampler.from_state(
            state, thresholds, resampling.cutting, resampling.collapse
        )
        return PolygonSurface(motion, resampling, polyhedral)
    numbers = {"identities": np.array(frame.identities), "unsorted": np.array(frame.unsorted)}
    state = _state(frame.mesh, faces=frame.mesh.faces, **numbers)
    if resampling.placement == "exact" and REST not in frame.mesh.attributes:
        raise UsageError(
            f"frame {frame.number} has no vertex attribute {REST!r}, which exact placement goes on from; "
            "resume from a frame that was made with exact placement"
        )
    resume = partial(Resampler.from_state, state, thresholds)
    return _triangle_surface(motion, resampling, flow, frame.number, resume)


def _state(mesh: TriangleMesh | PolygonMesh, **others: AnyArray) -> dict[str, AnyArray]:
    """Return the state of a resampler with this mesh."""
    attributes = {f"attribute.{name}": values for name, values in mesh.attributes.items()}
    return {"vertices": mesh.vertices, **others, **attributes, "creases": mesh.creases}
