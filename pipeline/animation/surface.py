"""The surface of a shot on its way through the frames: moved, and resampled when a frame is taken."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from pipeline.animation.fit_remedy import fit_remedy, is_usual_size
from pipeline.animation.frame import MATERIAL, FrameReport, MeshFrame, material_of
from pipeline.errors import FlowsculptError, FrameError, VertexBudgetError
from pipeline.flow import Flow
from pipeline.flow.flow_map import FlowMap, FrameStep
from pipeline.mesh import TriangleMesh
from pipeline.mesh.control_net import Lattice
from pipeline.mesh.identity import Register
from pipeline.mesh.normals import NORMAL, carried_normals, vertex_normals
from pipeline.resample import Exact, PolyhedralResampler, Report, Resampler, Thresholds
from pipeline.resample.rest_surface import REST, REST_NORMAL
from pipeline.shot import Motion, Resampling
from pipeline.statistics import MeshStatistics, mesh_statistics


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
        project = motion.subject.project if start == first else None
        self.placement = Exact(self.history.carry, project, tags_creases=False)
        self.next = partial(RestInterval, motion, resampling, flow, self.end)


R = TypeVar("R", Resampler, PolyhedralResampler)


def thresholds_at(motion: Motion, resampling: Resampling, frame: int) -> Thresholds:
    """Return the thresholds of a frame."""
    return resampling.thresholds.at(frame, motion.clock.time(frame))


class MovingSurface:
    """A surface, point cloud or control net whose vertices only move."""

    def __init__(self, mesh: TriangleMesh, lattice: Lattice | None = None) -> None:
        self._mesh, self._register, self._lattice = mesh, Register.of(mesh), lattice

    def move(self, step: FrameStep) -> None:
        """Move the vertices by one step of the flow."""
        self._mesh = self._mesh.with_vertices(step.apply(self._mesh.vertices))

    def frame(self, number: int) -> MeshFrame:
        """Return the surface as frame `number`."""
        report = FrameReport(None, partial(_statistics, self._mesh))
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
        self._resampler.vertices[:] = step.apply(self._resampler.vertices)

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

    def frame(self, number: int) -> MeshFrame:
        report, polygons = self._resample(number), self._resampler.mesh
        mesh = polygons.triangulated()
        return MeshFrame(number, mesh, FrameReport(report, partial(_statistics, mesh)), polygons)


class TriangleSurface(_ResampledSurface[Resampler]):
    """A surface of triangles."""

    def frame(self, number: int) -> MeshFrame:
        report, resampler = self._resample(number), self._resampler
        mesh = resampler.mesh
        frame_report = FrameReport(report, partial(_statistics, mesh))
        return MeshFrame(number, mesh, frame_report, births=resampler.births, identities=resampler.identities)


class ExactSurface(TriangleSurface):
    """A surface with rest positions, whose normals are carried by the flow."""

    def __init__(
        self, motion: Motion, resampling: Resampling, resampler: Resampler, interval: RestInterval
    ) -> None:
        super().__init__(motion, resampling, resampler)
        self._interval = interval

    def move(self, step: FrameStep) -> None:
        before = self._resampler.vertices.copy()
        super().move(step)
        normals = self._resampler.vectors(NORMAL)
        if normals is not None:
            normals[:] = carried_normals(step.apply, before, self._resampler.vertices, normals)
        self._interval.history.add(step)

    def frame(self, number: int) -> MeshFrame:
        frame = super().frame(number)
        return self._renewed(frame) if number == self._interval.end else frame

    def _renewed(self, frame: MeshFrame) -> MeshFrame:
        """Return the frame with its surface as the new surface at rest."""
        self._interval = self._interval.next()
        mesh = frame.mesh
        renewed = {REST: mesh.vertices, REST_NORMAL: vertex_normals(mesh), MATERIAL: material_of(mesh)}
        state = self._resampler.state() | {f"attribute.{name}": values for name, values in renewed.items()}
        self._resampler = Resampler.from_state(
            state, self._resampler.thresholds, self._interval.placement, self._resampler.shape.min_roundness
        )
        return replace(frame, mesh=self._resampler.mesh)


def _statistics(mesh: TriangleMesh) -> MeshStatistics | None:
    return mesh_statistics(mesh) if len(mesh.faces) else None
