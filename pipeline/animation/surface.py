"""The surface of a shot on its way through the frames: moved, resampled, and carried along from its rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from pipeline.animation.frame import FrameReport, MeshFrame
from pipeline.arrays import AnyArray, Vectors
from pipeline.errors import FlowsculptError, FrameError, UsageError
from pipeline.flow import Flow
from pipeline.flow.history import History, Step
from pipeline.flow.tangents import carried_normals
from pipeline.mesh import TriangleMesh, vertex_normals
from pipeline.mesh.normals import NORMAL
from pipeline.resample import Chord, Curved, Exact, Placement, Resampler, Thresholds, edges_by_angle
from pipeline.resample.exact import REST
from pipeline.resample.hardness import edges_in_region
from pipeline.shot import Motion, Resampling
from pipeline.statistics import mesh_statistics


def step_into(motion: Motion, flow: Flow, frame: int) -> Step:
    """What moves the surface into `frame`."""
    return Step(flow, *motion.clock.step(frame), frame)


def at_rest(motion: Motion, flow: Flow) -> Surface:
    """The subject before anything has moved it, not resampled yet."""
    resampling, first = motion.resampling, motion.frames.first
    if resampling is None:
        return Surface(motion.mesh_at_rest())
    thresholds = _thresholds(motion, resampling, first)
    mesh = motion.mesh_at_rest()
    if resampling.creases == "rest":
        mesh = mesh.with_creases(edges_by_angle(mesh, thresholds.hard_angles(mesh)))
    elif resampling.creases == "none":
        mesh = mesh.with_creases([])
    elif resampling.creases != "model":
        mesh = mesh.with_creases(edges_in_region(mesh, resampling.creases))
    if resampling.placement != "exact":
        return _Resampled(
            motion,
            resampling,
            Resampler(mesh, thresholds, _UNCARRIED[resampling.placement], resampling.shape),
        )
    if resampling.normals == "carried":
        mesh = mesh.with_attributes(**{NORMAL: _normals_at_rest(motion, mesh)})
    epoch = _Epoch(motion, resampling, flow, first)
    return _Carried(motion, resampling, Resampler(mesh, thresholds, epoch.placement, resampling.shape), epoch)


def _thresholds(motion: Motion, resampling: Resampling, frame: int) -> Thresholds:
    return resampling.thresholds.at(frame, motion.clock.time(frame))


def _normals_at_rest(motion: Motion, mesh: TriangleMesh) -> Vectors:
    """(V, 3): of the true surface where it is known, else of the mesh; zero at creases."""
    truth = motion.subject.project
    normals = vertex_normals(mesh) if truth is None else truth.normals(mesh.vertices)
    normals[mesh.creases.ravel()] = 0.0
    return normals


def resumed(motion: Motion, flow: Flow, frame: MeshFrame) -> Surface:
    """The surface as it was when its frame was taken: vertices and faces keep their order."""
    mesh, resampling = frame.mesh, motion.resampling
    if resampling is None:
        return Surface(mesh)
    thresholds = _thresholds(motion, resampling, frame.number)
    attributes = {f"attribute.{name}": values for name, values in mesh.attributes.items()}
    state: dict[str, AnyArray] = {"vertices": mesh.vertices, "faces": mesh.faces, **attributes}
    state["creases"] = mesh.creases
    if resampling.placement != "exact":
        resampler = Resampler.from_state(
            state, thresholds, _UNCARRIED[resampling.placement], resampling.shape
        )
        return _Resampled(motion, resampling, resampler)
    if REST not in mesh.attributes:
        raise UsageError(
            f"frame {frame.number} has no vertex attribute {REST!r}, which exact placement goes on from; "
            "resume from a frame that was made with exact placement"
        )
    epoch = _Epoch(motion, resampling, flow, frame.number)
    resampler = Resampler.from_state(state, thresholds, epoch.placement, resampling.shape)
    return _Carried(motion, resampling, resampler, epoch)


_UNCARRIED: Mapping[str, Placement] = {"chord": Chord(), "curved": Curved()}


class _Epoch:
    """The frames that share a surface at rest: that of the first frame, or of every `renew`-th after it.

    Carrying would cost ever more as a film goes on; a new surface at rest bounds it. Which epoch it is
    follows from the number of the frame, so that a run that goes on from any frame knows.
    """

    def __init__(self, motion: Motion, resampling: Resampling, flow: Flow, number: int) -> None:
        first, length = motion.frames.first, resampling.renew
        self.rest = first + (number - first) // length * length
        self.over = self.rest + length
        self.history = History()
        for frame in range(self.rest + 1, number + 1):
            self.history.add(step_into(motion, flow, frame))
        project = motion.subject.project if self.rest == first else None
        self.placement = Exact(self.history.carry, project, tags_creases=False)
        self._next = partial(_Epoch, motion, resampling, flow, self.over)

    def next(self) -> _Epoch:
        """The one that begins when this is over."""
        return self._next()


class Surface:
    """A surface whose vertices only move."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self._mesh = mesh

    def move(self, step: Step) -> None:
        self._mesh = self._mesh.with_vertices(step.apply(self._mesh.vertices))

    def frame(self, number: int) -> MeshFrame:
        return MeshFrame(number, self._mesh, FrameReport(None, mesh_statistics(self._mesh)))


class _Resampled(Surface):
    """A surface that is resampled when its frame is taken."""

    def __init__(self, motion: Motion, resampling: Resampling, resampler: Resampler) -> None:
        self._thresholds = partial(_thresholds, motion, resampling)
        self._resampler = resampler

    def move(self, step: Step) -> None:
        self._resampler.vertices[:] = step.apply(self._resampler.vertices)

    def frame(self, number: int) -> MeshFrame:
        try:
            self._resampler.thresholds = self._thresholds(number)
            done = self._resampler.resample()
        except FrameError as error:
            raise error.of(number) from error
        except FlowsculptError as error:
            raise FrameError(str(error), number) from error
        mesh = self._resampler.mesh
        return MeshFrame(number, mesh, FrameReport(done, mesh_statistics(mesh)))


class _Carried(_Resampled):
    """A resampled surface that knows where its vertices were at rest, and whose normals go with the flow."""

    def __init__(self, motion: Motion, resampling: Resampling, resampler: Resampler, epoch: _Epoch) -> None:
        super().__init__(motion, resampling, resampler)
        self._epoch = epoch

    def move(self, step: Step) -> None:
        before = self._resampler.vertices.copy()
        super().move(step)
        normals = self._resampler.vectors(NORMAL)
        if normals is not None:
            normals[:] = carried_normals(step.apply, before, self._resampler.vertices, normals)
        self._epoch.history.add(step)

    def frame(self, number: int) -> MeshFrame:
        frame = super().frame(number)
        return self._renewed(frame) if number == self._epoch.over else frame

    def _renewed(self, frame: MeshFrame) -> MeshFrame:
        """The same frame, from here on the surface at rest."""
        self._epoch = self._epoch.next()
        state = {**self._resampler.state(), f"attribute.{REST}": frame.mesh.vertices}
        self._resampler = Resampler.from_state(
            state, self._resampler.thresholds, self._epoch.placement, self._resampler.shape.roundness
        )
        return replace(frame, mesh=self._resampler.mesh)
