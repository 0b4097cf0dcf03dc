"""Surfaces while their frames are made: moved by the flow, and resampled when a frame is taken.

`at_rest` begins one with the subject of a motion, `resumed` with a stored frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import Generic, TypeVar

import numpy as np

from flowsculpt.pipeline.animation.animated_map import AnimatedMap
from flowsculpt.pipeline.animation.frame import MATERIAL, FrameReport, MeshFrame, with_material
from flowsculpt.pipeline.animation.motion_forecast import MotionForecast
from flowsculpt.pipeline.arrays import AnyArray, Floats, Points, Vectors
from flowsculpt.pipeline.errors import FlowsculptError, FrameError, UsageError, VertexBudgetError
from flowsculpt.pipeline.flow import Flow
from flowsculpt.pipeline.flow.flow_map import FlowMap, FrameStep, blocks_of
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.mesh.control_net import Lattice
from flowsculpt.pipeline.mesh.halfedge_mesh import Register, with_identities
from flowsculpt.pipeline.mesh.normals import NORMAL, carried_normals, tangent_distance, vertex_normals
from flowsculpt.pipeline.mesh.placed_copies import Placements, extremes
from flowsculpt.pipeline.resample import Exact, PolygonResampler, Report, Resampler, Thresholds
from flowsculpt.pipeline.resample.placement import FACE, REST, REST_NORMAL
from flowsculpt.pipeline.resample.resampler import STATELESS
from flowsculpt.pipeline.shot import Motion, Resampling
from flowsculpt.pipeline.shot.animated_models import VELOCITY
from flowsculpt.pipeline.shot.motion import AnimatedSubject, given_subject
from flowsculpt.pipeline.statistics import COUNTED_FRAMES, MeshStatistics, mesh_statistics


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
        given = None if motion.animated is None else AnimatedMap(motion.animated)
        self.history = FlowMap() if given is None else given
        for frame in range(start + 1, number + 1):
            self.history.add(motion.step_into(flow, frame))
        project = motion.analytic_surface() if start == first else None
        follow = any(step.flow.faces_follow_normals for step in flow.steps(*motion.step(number)))
        self.placement = Exact(self.history.carry, project, False, follow, given)
        self.next = partial(RestInterval, motion, resampling, flow, self.end)


R = TypeVar("R", Resampler, PolygonResampler)

MOST_SHOWN = 20_000_000
"""Vertices of all rigid copies of a subject: renders and exports take about 0.4 kB for each."""


class SimulatedSurface:
    """A surface, point cloud or control net whose vertices only move."""

    def __init__(self, motion: Motion, mesh: TriangleMesh, lattice: Lattice | None = None) -> None:
        self._motion, self._mesh, self._register, self._lattice = motion, mesh, Register.of(mesh), lattice

    def move(self, step: FrameStep) -> None:
        """Move the vertices by one step of the flow."""
        points = np.array(self._mesh.vertices)
        step.move(points)
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


class RigidCopies(SimulatedSurface):
    """Copies that the flow carries and turns, and whose shape is that of the first frame."""

    def __init__(self, frame: MeshFrame) -> None:
        self._frame = frame

    @classmethod
    def at_rest(cls, motion: Motion, flow: Flow) -> RigidCopies:
        """Return the copies of the subject as it is resampled alone in the first frame."""
        alone, placements = motion.of_shape()
        frame = at_rest(alone, flow).frame(motion.frames.first)
        mesh, numbers = frame.mesh, len(placements) * len(frame.mesh.vertices)
        if numbers > MOST_SHOWN:
            raise FrameError(
                f"{len(placements)} copies of {len(mesh.vertices):,} vertices are {numbers:,}, and "
                f"{MOST_SHOWN:,} are the most that is drawn; raise max_edge_length, or lower count",
                frame.number,
            )
        normals = {name: values for name, values in mesh.attributes.items() if name == NORMAL}
        own = TriangleMesh(mesh.vertices, mesh.faces, normals, **mesh.tagged_edges)
        none = np.empty((0, 3), np.int64)
        copies = MeshFrame(frame.number, own, frame.report, births=none, identities=numbers)
        return cls(replace(copies, copies=placements, starts=placements))

    def move(self, step: FrameStep) -> None:
        """Carry and turn the copies by one step of the flow."""
        self._frame = replace(self._frame.with_moved_copies(step.apply), number=step.frame)

    def frame(self, number: int, ready: Callable[[], None] = lambda: None) -> MeshFrame:
        """Return the copies as frame `number`."""
        ready()
        frame, copies = self._frame, self._frame.copies
        assert copies is not None, "rigid copies have placements"
        return replace(frame, report=FrameReport(None, partial(_statistics_of_copies, frame.own, copies)))


@lru_cache(1)
def _statistics_of_shape(mesh: TriangleMesh) -> tuple[MeshStatistics, Points]:
    """Return the statistics of the shape of copies, the same in all frames, and its extremes (V, 3)."""
    return mesh_statistics(mesh, count_crossings=False), extremes(mesh.vertices)


def _statistics_of_copies(one: TriangleMesh, copies: Placements) -> MeshStatistics:
    """Return the statistics of rigid copies of a mesh; crossings of two copies are not counted."""
    (of_one, farthest), sizes = _statistics_of_shape(one), copies.sizes
    return MeshStatistics(
        mean_edge=of_one.mean_edge * float(sizes.mean()),
        diameter=copies.diameter(farthest),
        median_dihedral=of_one.median_dihedral,
        area=of_one.area * float((sizes**2).sum()),
        crossings=None,
    )


class _ResampledSurface(SimulatedSurface, Generic[R]):
    """A surface that is resampled when its frame is taken."""

    def __init__(
        self, motion: Motion, resampling: Resampling, resampler: R, start_vertices: int | None = None
    ) -> None:
        self._motion, self._resampling, self._start_vertices = motion, resampling, start_vertices
        self._resampler: R = resampler

    def move(self, step: FrameStep) -> None:
        step.move(self._resampler.vertices)

    def _resample(self, number: int) -> Report:
        """Resample once; errors name the frame."""
        try:
            now = self._motion.resampling_at(number)
            assert now is not None, "this surface is resampled"
            thresholds = now.thresholds
            most = self._most_vertices
            if most is not None and most < thresholds.max_vertices:
                thresholds = replace(thresholds, max_vertices=most)
            self._resampler.thresholds = thresholds
            return self._resampler.resample()
        except VertexBudgetError as error:
            if thresholds.max_vertices == most:
                raise self._grown(error.fact, number) from error
            extent = float(np.ptp(self._resampler.vertices, axis=0).max())
            remedy = MotionForecast(self._motion).size_remedy(extent)
            if not remedy or MotionForecast.is_usual(extent):
                raise error.of(number) from error
            raise error.with_remedy(remedy, number) from error
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


class PolygonSurface(_ResampledSurface[PolygonResampler]):
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
        resampled, resampler = self._resample(number), self._resampler
        ready()
        self._renew_rest(number)
        mesh = self._shown(resampler.mesh)
        report, kept = self._report(number, mesh, resampled), (resampler.identities, resampler.unsorted)
        return MeshFrame(number, mesh, report, None, resampler.births, *kept)

    def _renew_rest(self, number: int) -> None:
        """Make the present surface the one at rest, where a rest interval ends; others have none."""

    def _shown(self, mesh: TriangleMesh) -> TriangleMesh:
        """Return the mesh of the frame, with what only frames have."""
        return mesh


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


class AnimatedSurface(ExactSurface):
    """The surface of an animated model, resampled: its vertices stay at their places on the file's faces."""

    def move(self, step: FrameStep) -> None:
        self._interval.history.add(step)
        self._resampler.vertices[:] = self._history.carried(*_places(self._resampler.mesh))

    def _shown(self, mesh: TriangleMesh) -> TriangleMesh:
        subject = self._motion.animated
        assert subject is not None, "so it is with animated models"
        velocities = self._history.carry_given(partial(subject.points, *_places(mesh)))[1]
        return mesh.with_attributes(**{VELOCITY: velocities})

    @property
    def _history(self) -> AnimatedMap:
        history = self._interval.history
        assert isinstance(history, AnimatedMap), "so it is with animated models"
        return history


def _places(mesh: TriangleMesh) -> tuple[Points, AnyArray]:
    """Return where vertices are at rest (V, 3), and the faces (V,) that they are on."""
    return mesh.attributes[REST], mesh.attributes[FACE]


class GivenSurface(SimulatedSurface):
    """The surface of an animated model with the faces that its files have at each frame."""

    def __init__(self, subject: AnimatedSubject, flow: Flow, number: int) -> None:
        motion = subject.motion
        self._subject, self._history = subject, AnimatedMap(subject)
        for frame in range(motion.frames.first + 1, number + 1):
            self.move(motion.step_into(flow, frame))
        self._mesh, self._register = TriangleMesh(np.empty((0, 3)), []), None
        if subject.model.keeps_faces:
            self._mesh = with_material(with_identities(motion.mesh_at_rest()))
            self._register = Register.of(self._mesh)

    def move(self, step: FrameStep) -> None:
        self._history.add(step)

    def frame(self, number: int, ready: Callable[[], None] = lambda: None) -> MeshFrame:
        """Return the surface as frame `number`. Raises FrameError where the file of the frame is at fault."""
        try:
            mesh = self._mesh_at(number)
        except FrameError:
            raise
        except FlowsculptError as error:
            raise FrameError(str(error), number) from error
        ready()
        frame = MeshFrame(number, mesh, FrameReport(None, partial(mesh_statistics, mesh, False)))
        if self._register is None:
            return frame
        return replace(frame, births=self._register.births, identities=self._register.given)

    def _mesh_at(self, number: int) -> TriangleMesh:
        if self._register is None:
            mesh = self._subject.mesh(number)
            return mesh if MATERIAL in mesh.attributes else with_material(mesh)
        points, velocities = self._history.carry_given(self._subject.vertices)
        mesh = self._mesh.with_vertices(points).with_attributes(**{VELOCITY: velocities})
        normals = self._history.carry_normals(points)
        if normals is None:
            return mesh
        is_smooth = (normals != 0.0).any(axis=1)[mesh.creases].any(axis=1)
        return mesh.with_creases(mesh.creases[~is_smooth]).with_attributes(**{NORMAL: normals})


def _report(motion: Motion, number: int, mesh: TriangleMesh, resampling: Report | None) -> FrameReport:
    """Return the report of a frame: its number alone decides whether crossings are counted."""
    is_counted = (number - motion.frames.first) % COUNTED_FRAMES == 0
    return FrameReport(resampling, partial(mesh_statistics, mesh, is_counted) if len(mesh.faces) else None)


def at_rest(motion: Motion, flow: Flow) -> SimulatedSurface:
    """Return the subject before anything has moved it, not resampled yet.

    Raises UsageError where points are to be resampled.
    """
    if motion.is_rigid:
        return RigidCopies.at_rest(motion, flow)
    first = motion.frames.first
    if (subject := given_subject(motion)) is not None:
        return GivenSurface(subject, flow, first)
    resampling = motion.resampling_at(first)
    if resampling is None:
        mesh = with_material(with_identities(motion.mesh_at_rest()))
        return SimulatedSurface(motion, mesh, motion.subject.lattice)
    if not motion.subject.is_surface:
        raise UsageError("points and control nets are not resampled; leave out resampling")
    thresholds = resampling.thresholds
    if not resampling.cuts_triangles:
        polygons = with_material(motion.polygons_at_rest())
        from flowsculpt.pipeline.resample import polygon_method  # pydantic, which meshes alone do without

        polygons = resampling.tag_creases(polygons, _hard_angles(polygons, thresholds))
        method = polygon_method(resampling.method, resampling.options)
        return PolygonSurface(motion, resampling, method.begin(polygons, thresholds))
    mesh = with_identities(motion.mesh_at_rest())
    mesh = resampling.tag_creases(mesh, thresholds.hard_angles(mesh))
    if motion.animated is not None:
        mesh = mesh.with_attributes(**{FACE: motion.animated.faces_at_rest(len(mesh.vertices))})
    elif resampling.placement != "exact":
        mesh = with_material(mesh)
    elif resampling.normals == "carried":
        mesh = mesh.with_attributes(**{NORMAL: _normals_at_rest(motion, mesh)})
    return _triangle_surface(motion, resampling, flow, first, partial(Resampler, mesh, thresholds))


def _triangle_surface(
    motion: Motion,
    resampling: Resampling,
    flow: Flow,
    frame: int,
    resampler: Callable[..., Resampler],
    start_vertices: int | None = None,
) -> TriangleSurface:
    """Return the surface of a resampler, made with the placement that the shot names."""
    options = resampling.min_roundness, resampling.splits
    if resampling.placement != "exact":
        placed = resampler(STATELESS[resampling.placement], *options)
        return TriangleSurface(motion, resampling, placed, start_vertices)
    interval = RestInterval(motion, resampling, flow, frame)
    placed = resampler(interval.placement, *options)
    kind = ExactSurface if motion.animated is None else AnimatedSurface
    return kind(motion, resampling, placed, interval, start_vertices)


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


def resumed(motion: Motion, flow: Flow, frame: MeshFrame) -> SimulatedSurface:
    """Return the surface as it was at a frame; vertices and faces keep their order.

    Raises UsageError where the frame lacks what the shot's resampling resumes from.
    """
    if motion.is_rigid:
        return RigidCopies(frame)
    if (subject := given_subject(motion)) is not None:
        return GivenSurface(subject, flow, frame.number)
    resampling = motion.resampling_at(frame.number)
    if resampling is None:
        return SimulatedSurface(motion, frame.mesh, frame.lattice)
    thresholds = resampling.thresholds
    if not resampling.cuts_triangles:
        polygons = frame.polygons
        if polygons is None:
            raise UsageError(
                f"frame {frame.number} has no polygons to continue with method {resampling.method}; resume "
                "from a frame made with it"
            )
        others = {"creases": polygons.creases, "offsets": polygons.offsets, "corners": polygons.corners}
        state = _state(polygons, **others)
        from flowsculpt.pipeline.resample import polygon_method

        polygonal = polygon_method(resampling.method, resampling.options).resume(state, thresholds)
        return PolygonSurface(motion, resampling, polygonal, _start_vertices(motion, flow, frame))
    numbers = {"identities": np.array(frame.identities), "unsorted": np.array(frame.unsorted)}
    state = _state(frame.mesh, faces=frame.mesh.faces, **frame.mesh.tagged_edges, **numbers)
    if resampling.placement == "exact" and REST not in frame.mesh.attributes:
        raise UsageError(
            f"frame {frame.number} has no vertex attribute {REST!r}, which exact placement needs; resume "
            "from a frame made with exact placement"
        )
    resume = partial(Resampler.from_state, state, thresholds)
    start_vertices = _start_vertices(motion, flow, frame)
    return _triangle_surface(motion, resampling, flow, frame.number, resume, start_vertices)


def _start_vertices(motion: Motion, flow: Flow, frame: MeshFrame) -> int | None:
    """Return the number of vertices of the first frame, by which `max_growth` is measured.

    Frames of earlier versions do not state it; the first frame is then computed again where a limit is set.
    """
    known = frame.report.start_vertices
    if known is not None or motion.resampling is None or motion.resampling.max_growth is None:
        return known
    start = at_rest(motion, flow).frame(motion.frames.first, lambda: None)
    return len(start.mesh.vertices)


def _state(mesh: TriangleMesh | PolygonMesh, **others: AnyArray) -> dict[str, AnyArray]:
    """Return the state of a resampler with this mesh."""
    kept = {name: values for name, values in mesh.attributes.items() if name != VELOCITY}
    attributes = {f"attribute.{name}": values for name, values in kept.items()}
    return {"vertices": mesh.vertices, **others, **attributes}
