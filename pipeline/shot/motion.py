"""Motion: all that decides the meshes of a shot, and what of it decides one of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from pipeline.errors import FrameError, UsageError
from pipeline.flow import Flow
from pipeline.flow.checked_displacement import checked_cache_data
from pipeline.flow.keyframes import Number
from pipeline.frames import FrameRange, FrameRate
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.triangle_mesh import TriangleMesh
from pipeline.resample import Curvature, DistanceToCamera, Thresholds
from pipeline.resample.creases import Region
from pipeline.resample.triangle_shape import DEFAULT_ROUNDNESS
from pipeline.shot.clock import Clock
from pipeline.shot.data import as_data
from pipeline.shot.subject import Solid, Subject


@dataclass(frozen=True)
class Resampling:
    """How a surface is resampled, once a frame.

    thresholds  the bracket for edge lengths and the angle that makes an edge hard
    method      triangles: split and collapse edges (P23–P30); polyhedra: slice arbitrary faces (P16–P21)
    placement   where new vertices go: chord, the middle of the edge (P25); curved, on a surface that is
                smooth except at creases (P37); exact, on the undeformed surface, carried through the flow
    splits      edges: one long edge at a time (P25); faces: one triangle into four (P26)
    min_roundness  0 to 1: the roundness of triangles below which they are mended (P36; see `Shape`)
    normals     carried through the flow, where the placement is exact; or of the geometry of each frame
    rest_interval  frames after which the present surface becomes the undeformed one, where placement is exact
    creases     edges that stay hard whatever becomes of their angle (P31): rest, those that are hard in the
                undeformed surface; model, those that the model's file names; a region, those with
                both ends in it at rest; none
    cutting     of polyhedra: slice, by all parallel planes at once; recurse, in two and again (P18)
    collapse    of polyhedra: edges, those that are short (P9); areas, faces that are small (P22)
    """

    thresholds: Thresholds
    method: Literal["triangles", "polyhedra"] = "triangles"
    placement: Literal["chord", "curved", "exact"] = "exact"
    splits: Literal["edges", "faces"] = "edges"
    min_roundness: float = DEFAULT_ROUNDNESS
    normals: Literal["carried", "geometric"] = "carried"
    rest_interval: int = 240
    creases: Literal["rest", "model", "none"] | Region = "rest"
    cutting: Literal["slice", "recurse"] = "slice"
    collapse: Literal["edges", "areas"] = "edges"

    def settings(self) -> dict[str, Any]:
        """Every setting that acts by its name in the shot file, JSON-able; functions as their parameters."""
        settings = self._without(as_data(self), self._idle)
        every = {**settings.pop("thresholds"), **settings}
        del every["is"]
        return every

    def data(self) -> dict[str, Any]:
        """What decides meshes, as JSON-able data: thresholds, and the settings that the others let matter.

        When the surface at rest is renewed is said by the frames in which it is: see `Motion.step_data`.
        """
        settings = {**as_data(self), "thresholds": thresholds_data(self.thresholds)}
        return self._without(settings, (*self._idle, "rest_interval"))

    @property
    def _idle(self) -> tuple[str, ...]:
        """Names of the settings that cannot act beside the others."""
        if self.method == "polyhedra":
            return ("placement", "splits", "min_roundness", "normals", "rest_interval")
        if self.placement == "exact":
            return ("cutting", "collapse")
        return ("cutting", "collapse", "normals", "rest_interval")

    @staticmethod
    def _without(settings: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
        return {name: value for name, value in settings.items() if name not in names}


def thresholds_data(thresholds: Thresholds) -> dict[str, Any]:
    """Thresholds as JSON-able data, without what changes no mesh.

    The budget of vertices moves none of them, and raising it goes on from the last frame that fitted;
    gradation is for lengths that are functions.
    """
    data: dict[str, Any] = as_data(thresholds)
    del data["max_vertices"]
    if isinstance(thresholds.max_edge_length, float) and isinstance(thresholds.min_edge_length, float):
        del data["gradation"]
    return data


DEFAULT_MAX_STEP = 0.5
"""Of an edge: what lies between two ends of it is not stepped over."""


@dataclass(frozen=True)
class Motion:
    """All that decides the mesh of every frame.

    resampling  None: it is off, and vertices only move
    speed       at which time runs for the flow, over the time of the frames
    max_step    how far a sub-step along velocities may take a vertex, in edges of the maximum length
    """

    frames: FrameRange
    rate: FrameRate
    subject: Subject
    flow: Flow
    resampling: Resampling | None
    speed: Number = 1.0
    max_step: float = DEFAULT_MAX_STEP

    @property
    def clock(self) -> Clock:
        return Clock(self.frames, self.rate, self.speed)

    def step(self, frame: int) -> tuple[float, float]:
        """When the step that leads into `frame` starts for the flow, and how long it lasts, in seconds.

        Raises FrameError where the speed is no number on the way.
        """
        try:
            return self.clock.step(frame)
        except UsageError as error:
            raise FrameError(f"speed has a value that is none: {error}", frame) from error

    def resampling_at(self, frame: int) -> Resampling | None:
        """How the surface is resampled in that frame: what depends on time is settled."""
        if self.resampling is None:
            return None
        now = self.resampling.thresholds.at(frame, self.clock.time(frame))
        return (
            self.resampling if now is self.resampling.thresholds else replace(self.resampling, thresholds=now)
        )

    def bounded(self, flow: Flow, frame: int) -> Flow:
        """A flow as it moves the surface into that frame: its sub-steps are no longer than `max_step`.

        The maximum length is that of the frame; where it depends on curvature or the camera, the coarsest. Of
        a formula none is known: it bounds nothing, and nothing does without resampling.
        """
        resampling = self.resampling_at(frame)
        longest = None if resampling is None else resampling.thresholds.max_edge_length
        if isinstance(longest, Curvature | DistanceToCamera):
            longest = longest.coarsest
        return flow.with_max_step(self.max_step * longest) if isinstance(longest, float) else flow

    def mesh_at_rest(self) -> TriangleMesh:
        """The subject's mesh, as fine as the first frame is to be.

        Where edge lengths vary, solids are meshed for the finest, which the first resampling thins out; but
        not for lengths below a third of the usual one, which it splits.
        """
        resampling = self.resampling_at(self.frames.first)
        if resampling is None:
            return self.subject.build()
        longest = resampling.thresholds.max_edge_length
        if isinstance(longest, float):
            return self.subject.build(longest)
        coarse = self.subject.build()
        if not isinstance(self.subject, Solid):
            return coarse  # a model is as its file says
        lengths = resampling.thresholds.fields(coarse)[:, 0]
        return self.subject.build(max(float(lengths.min()), float(np.median(lengths)) / 3.0))

    def polygons_at_rest(self) -> PolygonMesh:
        """The subject's polygons. Where lengths are functions, a solid is as `mesh_at_rest` has it, for a
        few corners could not tell them how it is between."""
        resampling = self.resampling_at(self.frames.first)
        longest = None if resampling is None else resampling.thresholds.max_edge_length
        if longest is None or isinstance(longest, float) or not isinstance(self.subject, Solid):
            return self.subject.polygons(longest if isinstance(longest, float) else None)
        return PolygonMesh.from_triangles(self.mesh_at_rest())

    def renews_rest(self, frame: int) -> bool:
        """Whether the surface of that frame becomes the undeformed one."""
        resampling, since = self.resampling, frame - self.frames.first
        if resampling is None or resampling.method != "triangles" or resampling.placement != "exact":
            return False
        return since > 0 and since % resampling.rest_interval == 0

    def start_data(self) -> dict[str, Any]:
        """What decides the first frame, as JSON-able data: equal data, equal mesh."""
        return {
            "subject": as_data(self.subject),
            "resampling": now.data() if (now := self.resampling_at(self.frames.first)) else None,
        }

    def step_data(self, frame: int) -> Any:
        """What acts on the way into `frame`, JSON-able. A changed key tells from the key before it on."""
        try:
            data = checked_cache_data(self.bounded(self.flow, frame), *self.step(frame))
        except FrameError as error:  # of the speed
            data = {"fails": str(error)}
        now = self.resampling_at(frame)
        changes: dict[str, Any] = {}
        if now is not None and now is not self.resampling:
            changes["thresholds"] = thresholds_data(now.thresholds)
        if self.renews_rest(frame):
            changes["renewed"] = True
        return {"flow": data, **changes} if changes else data
