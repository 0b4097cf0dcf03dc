"""The frame loop: displace, resample, yield; resumable from any frame."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipeline.arrays import AnyArray, Points
from pipeline.errors import FlowsculptError, FrameError, UsageError
from pipeline.flow import Displacement, Flow, as_flow, displaced
from pipeline.mesh import TriangleMesh
from pipeline.resample import Report, Resampler
from pipeline.shot import Motion, Resampling, Shot
from pipeline.statistics import MeshStatistics, mesh_statistics

_ATTRIBUTE = "attribute:"


@dataclass(frozen=True)
class FrameReport:
    """What happened on the way into a frame, and how its mesh is.

    resampling  what the resampler did; None where resampling is off
    statistics  how mesh-like the result is (P7)
    """

    resampling: Report | None
    statistics: MeshStatistics

    def as_data(self) -> dict[str, Any]:
        """JSON-able."""
        resampling = None
        if self.resampling is not None:
            resampling = {**vars(self.resampling), "refused": dict(self.resampling.refused)}
        return {"resampling": resampling, "statistics": asdict(self.statistics)}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> FrameReport:
        resampling = data["resampling"]
        return cls(
            resampling=None if resampling is None else Report(**resampling),
            statistics=MeshStatistics(**data["statistics"]),
        )


@dataclass(frozen=True)
class MeshFrame:
    """One frame of a shot's surface. With the shot, it is all that later frames depend on."""

    number: int
    mesh: TriangleMesh
    report: FrameReport

    def to_arrays(self) -> dict[str, AnyArray]:
        """The frame as named arrays, as ``numpy.savez(file, **arrays)`` takes them.

        vertices float64 (V, 3), faces int32 (F, 3), `attribute:<name>` (V, …), number () and report ():
        a string of JSON.
        """
        attributes = {_ATTRIBUTE + name: values for name, values in self.mesh.attributes.items()}
        return {
            "vertices": self.mesh.vertices,
            "faces": self.mesh.faces,
            **attributes,
            "number": np.array(self.number),
            "report": np.array(json.dumps(self.report.as_data())),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, AnyArray]) -> MeshFrame:
        """The frame that `to_arrays` was called on, bit for bit. Raises UsageError for a missing name."""
        missing = sorted({"vertices", "faces", "number", "report"} - set(arrays))
        if missing:
            raise UsageError(f"the arrays hold no {' and no '.join(missing)}; they are no frame of ours")
        names = [name for name in arrays if name.startswith(_ATTRIBUTE)]
        attributes = {name.removeprefix(_ATTRIBUTE): arrays[name] for name in names}
        return cls(
            number=int(arrays["number"]),
            mesh=TriangleMesh(arrays["vertices"], arrays["faces"], attributes),
            report=FrameReport.from_data(json.loads(str(arrays["report"]))),
        )


def animate(
    shot: Shot | Motion, resume: MeshFrame | None = None, flow: Flow | Displacement | None = None
) -> Iterator[MeshFrame]:
    """The shot's frames in order: each moved by the flow for one frame, then resampled once (P6).

    The first frame is the subject at rest, resampled only. With `resume`, the frames after that one,
    with the same bits as if the run had never stopped. `flow` takes the place of the shot's own:
    any callable `points, time, dt -> points` will do (P1).

    Raises FrameError, with its `frame`, where the flow fails or the surface cannot be resampled;
    the frames before it have been yielded. MeshError and MissingInputError where the subject is no good.
    """
    motion = shot.motion if isinstance(shot, Shot) else shot
    moving = motion.flow if flow is None else as_flow(flow)
    surface: _Surface
    if resume is None:
        number = motion.frames.first
        surface = _at_rest(motion)
        yield surface.frame(number)
    else:
        number = resume.number
        surface = _resumed(resume.mesh, motion.resampling)
    for frame in range(number + 1, motion.frames.last + 1):
        surface.move(displaced(moving, surface.vertices, *motion.clock.step(frame), frame))
        yield surface.frame(frame)


def _at_rest(motion: Motion) -> _Surface:
    if motion.resampling is None:
        return _Surface(motion.subject.build())
    thresholds = motion.resampling.thresholds
    return _Resampled(Resampler(motion.subject.build(thresholds.max_edge_length), thresholds))


def _resumed(mesh: TriangleMesh, resampling: Resampling | None) -> _Surface:
    """The surface as it was when its frame was taken: vertices and faces keep their order."""
    if resampling is None:
        return _Surface(mesh)
    attributes = {f"attribute.{name}": values for name, values in mesh.attributes.items()}
    state: dict[str, AnyArray] = {"vertices": mesh.vertices, "faces": mesh.faces, **attributes}
    return _Resampled(Resampler.from_state(state, resampling.thresholds))


class _Surface:
    """A surface whose vertices only move."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self._mesh = mesh

    @property
    def vertices(self) -> Points:
        return self._mesh.vertices

    def move(self, vertices: Points) -> None:
        self._mesh = self._mesh.with_vertices(vertices)

    def frame(self, number: int) -> MeshFrame:
        return MeshFrame(number, self._mesh, FrameReport(None, mesh_statistics(self._mesh)))


class _Resampled(_Surface):
    """A surface that is resampled when its frame is taken."""

    def __init__(self, resampler: Resampler) -> None:
        self._resampler = resampler

    @property
    def vertices(self) -> Points:
        return self._resampler.vertices

    def move(self, vertices: Points) -> None:
        self._resampler.vertices[:] = vertices

    def frame(self, number: int) -> MeshFrame:
        try:
            done = self._resampler.resample()
        except FlowsculptError as error:
            raise FrameError(str(error), number) from error
        mesh = self._resampler.mesh
        return MeshFrame(number, mesh, FrameReport(done, mesh_statistics(mesh)))
