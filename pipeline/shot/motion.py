"""Motion: the clock of a shot, everything that decides its meshes, and the part that decides one of them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Points, Vectors
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow import Flow, Sequence
from flowsculpt.pipeline.flow.flow_map import FrameStep, cache_data_or_failure, checked_cache_data
from flowsculpt.pipeline.flow.keyframes import elapsed
from flowsculpt.pipeline.flow.parameters import ORIGIN, Curve, Number, Vector
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.mesh.analytic_surfaces import AnalyticSurface, RepeatedSurface, nearest_middles
from flowsculpt.pipeline.mesh.meshes import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.mesh.placed_copies import Mesh, Placements
from flowsculpt.pipeline.resample import Curvature, DistanceToCamera, Thresholds
from flowsculpt.pipeline.resample.thresholds import DEFAULT_ROUNDNESS, Region, edges_by_angle, edges_in_region
from flowsculpt.pipeline.shot.animated_models import AnimatedFlow, AnimatedModel
from flowsculpt.pipeline.shot.copies import Copies, bounding_sphere
from flowsculpt.pipeline.shot.subjects import PluginSurface, Solid, Subject, as_data
from flowsculpt.render.base.serialise import NOT_PLAIN, OMIT_DEFAULT
from flowsculpt.render.scene.measured_colours import Measure
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.patterns import COPY_PLACE, Pigment

_SECONDS = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*s\s*")

SECONDS_PATTERN = r"^\s*[+-]?(\d+\.?\d*|\.\d+)\s*s\s*$"
"""JSON Schema pattern of seconds in a shot file; plain numbers are frames."""

TIME_PATTERN = rf"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|{SECONDS_PATTERN}"
"""JSON Schema pattern of a key's time: frames or seconds, both as text since names of a mapping are text."""

FURTHEST = 10**12
"""Frames beyond this number count as infinite; the flow's time may reach as many seconds."""


VELOCITY_STEP = 1.0 / 64.0
"""Frames to either side for a velocity by differences: short against bends, long against rounding."""

MOST_CHECKED = 1000
"""First frames at which a changing speed is checked while a shot is read: each takes integrals."""


@dataclass(frozen=True)
class Loop:
    """The transition from a shot's last frame to its first.

    kind   back: the flow's time runs to half of the loop and back; turns: flows and camera return by
           themselves in the frame after the last; dissolve: the last frames dissolve into the first
    count  frames of the dissolve
    """

    kind: Literal["back", "turns", "dissolve"]
    count: int = 0

    @classmethod
    def of(cls, written: Any) -> Loop | None:
        """Return the loop of a shot file; None for none, and for values that its document refuses."""
        if isinstance(written, dict):
            count = written.get("dissolve")
            return cls("dissolve", count) if type(count) is int and count > 0 else None
        return cls("back") if written is True else cls("turns") if written == "turns" else None


@dataclass(frozen=True)
class Clock:
    """Frames and their rate. The first frame of the shot is at 0 seconds.

    speed  rate of the flow's time; all keys but those of flows go by the time of the frames
    loop   the frame after the last is the first again, except of a dissolve; None for no loop
    """

    frames: FrameRange
    rate: FrameRate
    speed: Number = 1.0
    loop: Loop | None = None

    def time(self, frame: float) -> float:
        """Return seconds from the start of the shot; frames may have fractions."""
        return self.rate.seconds(frame - self.frames.first)

    def flow_time(self, frame: float) -> float:
        """Return the flow's time at a frame, in seconds: the integral of the speed."""
        time = self.time(frame)
        if self.loop is not None and self.loop.kind == "back":
            period = self.rate.seconds(len(self.frames))
            time = period / 4.0 * (1.0 - math.cos(2.0 * math.pi * time / period))
        return elapsed(self.speed, time)

    def step(self, frame: int) -> tuple[float, float]:
        """Return start and duration, in seconds of the flow, of the step that leads into `frame`."""
        return self.between(frame - 1, frame)

    def between(self, frame: float, other: float) -> tuple[float, float]:
        """Return start and duration, in seconds of the flow, of a step between frames, maybe backwards."""
        start = self.flow_time(frame)
        return start, self.flow_time(other) - start

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return self.time(self.frames.last)

    def seconds(self, key: object) -> float | None:
        """Return the time of a key of a shot file: numbers are frames, "0.5s" is seconds.

        None for anything else; frames beyond FURTHEST are infinite.
        """
        length = self.length(key)
        if isinstance(key, int | float) and length is not None and math.isfinite(length):
            return self.time(key)
        return length

    def length(self, value: object) -> float | None:
        """Return a duration of a shot file in seconds: numbers are frames, "0.5s" is seconds; else None."""
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            return self.rate.seconds(value) if abs(value) < FURTHEST else math.copysign(math.inf, value)
        match = _SECONDS.fullmatch(value) if isinstance(value, str) else None
        return float(match[1]) if match else None

    def speed_fault(self) -> str | None:
        """Return the message about a speed that fails before the last frame; None if it is good."""
        for frame in self._checked_frames:
            try:
                reached = self.flow_time(frame)
            except UsageError as error:
                return f"speed is not finite: {error}"
            if not abs(reached) <= FURTHEST:
                return (
                    f"speed takes the flow to {reached:.3g} s by frame {frame}; its time goes up to 1e12 s. "
                    "Lower it."
                )
        return None

    def holds(self, seconds: float) -> bool:
        """Tell whether a time lies within the shot; the first frame of the next round of a loop does."""
        is_round = self.loop is not None and self.loop.kind != "dissolve"
        return _is_within(seconds, self.rate.seconds(len(self.frames)) if is_round else self.duration)

    def flow_holds(self, seconds: float) -> bool:
        """Tell whether a time of the flow lies within the shot, at its speed or at a speed of 1."""
        is_checked = len(self.frames) <= MOST_CHECKED or not isinstance(self.speed, Curve)
        return _is_within(seconds, max(self.duration, self._furthest) if is_checked else math.inf)

    @cached_property
    def _furthest(self) -> float:
        """The latest time that the flow reaches."""
        return max(map(self.flow_time, self._checked_frames))

    @property
    def _checked_frames(self) -> tuple[int, ...]:
        numbers = self.frames.numbers
        return numbers[:MOST_CHECKED] if isinstance(self.speed, Curve) else (numbers[0], numbers[-1])


def parse_frames(text: str, rate: FrameRate | None = None) -> FrameRange:
    """Parse the frames of a shot, such as 1-96. Raises UsageError where they have gaps or no form.

    rate  by which the message says how many frames a duration has
    """
    if (
        rate
        and (match := _SECONDS.fullmatch(text))
        and 1 <= (count := round(float(match[1]) * rate.fps)) < FURTHEST
    ):
        raise UsageError(
            f"{text} is a duration, and frames is a range. At {rate} frames a second, write 1-{count}."
        )
    frames = FrameRange.parse(text, such_as="1-48")
    if frames.numbers != tuple(range(frames.first, frames.last + 1)):
        ends = [abs(int(number)) for number in re.findall(r"(?<![x:y\d])\d+", text)]
        raise UsageError(f"frames {text} skip or turn back; a shot plays all. Write {min(ends)}-{max(ends)}.")
    return frames


def parse_rate(value: object) -> FrameRate:
    """Parse a frame rate, 24 for None. Raises UsageError where it is none."""
    return FrameRate.of(24 if value is None else value)


def _is_within(seconds: float, duration: float) -> bool:
    slack = 1e-9
    return -slack <= seconds <= duration + slack and math.isfinite(seconds)


@dataclass(frozen=True)
class Resampling:
    """The resampling of a surface, once a frame.

    thresholds     limits of edge lengths, and the angle that makes an edge hard
    method         triangles: split and collapse edges (P23–P30); or one of a plug-in, for polygons
    placement      position of new vertices: chord, the middle of the edge (P25); curved, on a surface that is
                   smooth except at creases (P37); exact, on the undeformed surface, carried through the flow
    splits         edges: one long edge at a time (P25); faces: one triangle into four (P26)
    min_roundness  0 to 1: the roundness of triangles below which they are repaired (P36)
    normals        carried through the flow, where the placement is exact; or of the geometry of each frame
    rest_interval  frames after which the present surface becomes the undeformed one, where placement is exact
    creases        edges that stay hard at any angle (P31): rest, edges hard in the undeformed surface; model,
                   edges that the model's file names; a region, edges with both ends in it at rest; none
    options        names and values of the settings of a plug-in's method
    max_growth     a frame that needs more than this times the vertices of the first frame stops with an
                   error; None: `max_vertices` alone bounds frames
    """

    thresholds: Thresholds
    method: str = "triangles"
    placement: Literal["chord", "curved", "exact"] = "exact"
    splits: Literal["edges", "faces"] = "edges"
    min_roundness: float = DEFAULT_ROUNDNESS
    normals: Literal["carried", "geometric"] = "carried"
    rest_interval: int = 240
    creases: Literal["rest", "model", "none"] | Region = "rest"
    options: tuple[tuple[str, Any], ...] = field(default=(), metadata=NOT_PLAIN)
    max_growth: float | None = field(default=None, metadata=OMIT_DEFAULT)

    @property
    def cuts_triangles(self) -> bool:
        """True of triangles; False of polygons, which a plug-in's method resamples."""
        return self.method == "triangles"

    def tag_creases(self, mesh: Mesh, hard_angles: float | Floats) -> Mesh:
        """Return the mesh at rest with the edges tagged that are to stay hard (P31)."""
        if self.creases == "model":
            return mesh
        if self.creases == "none":
            return mesh.with_creases([])
        if self.creases == "rest":
            return mesh.with_creases(edges_by_angle(mesh, hard_angles))
        return mesh.with_creases(edges_in_region(mesh, self.creases))

    def settings(self) -> dict[str, Any]:
        """Return the settings in effect by their names in the shot file, as JSON-able data."""
        settings = as_data(self)
        every = self._without({**settings.pop("thresholds"), **settings, **dict(self.options)}, self._idle)
        del every["is"]
        return every

    def data(self) -> dict[str, Any]:
        """Return thresholds and the settings in effect, which decide meshes, as JSON-able data.

        The rest interval stands in the data of the frames that begin one: see `Motion.step_data`.
        """
        settings = {**as_data(self), **dict(self.options), "thresholds": self.thresholds_data()}
        return self._without(settings, (*self._idle, "rest_interval", "max_growth"))

    def thresholds_data(self) -> dict[str, Any]:
        """Return the thresholds that change meshes as JSON-able data.

        The budget of vertices and the limit of growth move none of them: raised ones resume at the last frame
        that fitted.
        Gradation acts on lengths that are functions only.
        """
        thresholds = self.thresholds
        data = self._without(as_data(thresholds), (*self._idle, "max_vertices"))
        if isinstance(thresholds.max_edge_length, float) and isinstance(thresholds.min_edge_length, float):
            del data["gradation"]
        return data

    @property
    def _idle(self) -> tuple[str, ...]:
        """Names of the settings that have no effect beside the others."""
        if not self.cuts_triangles:
            return ("placement", "splits", "min_roundness", "normals", "rest_interval")
        if self.placement == "exact":
            return () if self.creases == "rest" else ("hard_angle",)
        return ("normals", "rest_interval")

    @staticmethod
    def _without(settings: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
        return {name: value for name, value in settings.items() if name not in names}


@dataclass(frozen=True)
class Motion:
    """Everything that decides the mesh of every frame.

    resampling  None is off: vertices only move
    speed       rate of the flow's time over the time of the frames
    max_step    longest move of a vertex in a sub-step along velocities, in edges of the maximum length; None
                is as far as the length scale of the flow allows, whatever the edges
    place       where the origin of the subject is before it moves, scene units
    copies      where copies of the subject are instead
    shape       how the shape of rigid copies is resampled, once, in the first frame; then nothing is
    flow_places places of its flows in the shot file, for messages; by default flows.0, flows.1, …
    loop        how it goes on after the last frame
    """

    frames: FrameRange
    rate: FrameRate
    subject: Subject
    flow: Flow
    resampling: Resampling | None
    speed: Number = 1.0
    max_step: float | None = None
    place: Vector = ORIGIN
    copies: Copies | None = None
    shape: Resampling | None = None
    flow_places: tuple[str, ...] = ()
    loop: Loop | None = None

    @cached_property
    def clock(self) -> Clock:
        return Clock(self.frames, self.rate, self.speed, self.loop)

    @cached_property
    def _latest(self) -> dict[str, Any]:
        """The latest answers of `resampling_at` and `bounded`: callers ask several times about one frame."""
        return {}

    def step(self, frame: int) -> tuple[float, float]:
        """Return start and duration, in seconds of the flow, of the step that leads into `frame`.

        Raises FrameError where the speed is not finite.
        """
        try:
            return self.clock.step(frame)
        except UsageError as error:
            raise FrameError(f"speed is not finite: {error}", frame) from error

    def resampling_at(self, frame: int) -> Resampling | None:
        """Return the resampling of that frame: keyed and formula thresholds are evaluated."""
        if self.resampling is None:
            return None
        latest: Resampling | None
        at, latest = self._latest.get("resampling", (None, None))
        if at != frame:
            now = self.resampling.thresholds.at(frame, self.clock.time(frame))
            same = now is self.resampling.thresholds
            latest = self.resampling if same else replace(self.resampling, thresholds=now)
            self._latest["resampling"] = frame, latest
        return latest

    def thresholds_at(self, frame: int) -> Thresholds:
        """Return the thresholds of a frame, or of the shape of rigid copies.

        Without resampling they are the default, whose hard angle makes creases; of animated models that keep
        their faces those of the first frame, which are tagged, are the only ones, so that none come and go.
        """
        resampling = self.resampling_at(frame) or self.shape
        is_tagged = self.animated is not None and self.animated.model.keeps_faces
        default = Thresholds(1.0, hard_angle=math.pi) if is_tagged else Thresholds(1.0)
        return resampling.thresholds if resampling else default

    def place_of_flow(self, index: int) -> str:
        """Return the place in the shot file of one of its flows, such as `flows.0`."""
        if isinstance(self.flow.members[0], AnimatedFlow):
            if not index:
                return "subject"
            index -= 1
        return self.flow_places[index] if self.flow_places else f"flows.{index}"

    def step_into(self, flow: Flow, frame: int) -> FrameStep:
        """Return the step of a flow that leads into `frame`."""
        return FrameStep(self.limit_steps(flow, frame), *self.step(frame), frame)

    def carry(self, points: Points, start: float, end: float) -> Points:
        """Return points (N, 3) of one frame moved to another, where frames may have fractions.

        Raises FrameError where the flow fails or the result is not finite.
        """
        return FrameStep(self.flow, *self.clock.between(start, end), int(end)).apply(points)

    @cached_property
    def animated(self) -> AnimatedSubject | None:
        """The subject, if its files move it."""
        return AnimatedSubject(self, self.subject) if isinstance(self.subject, AnimatedModel) else None

    @cached_property
    def without_animation(self) -> Motion:
        """The motion with the flows that act after the files of an animated model."""
        flow = without_animation(self.flow)
        return self if flow is self.flow else replace(self, flow=flow)

    def flow_data(self, frame: int, offsets: tuple[float, ...]) -> list[Any]:
        """Return the cache data of the flow between a frame and offsets near it: equal data, equal paths.

        Beyond the ends of the shot, the flow at that end counts. Frames of animated models have velocities.
        """
        if self is not self.without_animation:
            return self.without_animation.flow_data(frame, offsets)
        first, last = self.frames.first, self.frames.last
        found = []
        for offset in offsets:
            if not first <= frame + offset <= last:
                if first == last:
                    continue
                offset = 2.0 * VELOCITY_STEP if frame == first else -2.0 * VELOCITY_STEP
            flow = self.limit_steps(self.flow, frame + (offset > 0.0))
            found.append(checked_cache_data(flow, *self.clock.between(*sorted((frame, frame + offset)))))
        return found

    def velocity_data(self, frame: int) -> list[Any]:
        """Return the cache data of the flow around a frame, which decide velocities and speeds there."""
        return self.flow_data(frame, (-VELOCITY_STEP, VELOCITY_STEP))

    def limit_steps(self, flow: Flow, frame: int) -> Flow:
        """Return a flow whose sub-steps into that frame are no longer than `max_step`, if there is one.

        The maximum length is that of the frame; the coarsest where it depends on curvature or the camera. A
        formula bounds nothing, and so does a motion without resampling.
        """
        longest = self.longest_edge(frame)
        if self.max_step is None or longest is None:
            return flow
        bounded: Flow
        unbounded, length, bounded = self._latest.get("bounded", (None, None, flow))
        if unbounded is not flow or length != longest:
            bounded = flow.with_max_step(self.max_step * longest)
            self._latest["bounded"] = flow, longest, bounded
        return bounded

    def longest_edge(self, frame: int) -> float | None:
        """Return the maximum edge length of a frame, the coarsest of several; None where there is none."""
        resampling = self.resampling_at(frame)
        longest = None if resampling is None else resampling.thresholds.max_edge_length
        if isinstance(longest, Curvature | DistanceToCamera):
            longest = longest.coarsest
        return longest if isinstance(longest, float) else None

    def mesh_at_rest(self, longest: float | None = None) -> TriangleMesh:
        """Return the subject's mesh with edges of a length at most, or as fine as the first frame needs it.

        Where edge lengths vary, solids are meshed for the finest, and the first resampling collapses edges.
        Lengths below a third of the median are left to its splits.
        """
        if longest is not None:
            return self._placed(self.subject.build(longest))
        resampling = self.resampling_at(self.frames.first) or self.shape
        if resampling is None:
            mesh = self._placed(self.subject.build())
            return mesh if self.animated is None else Thresholds(1.0).with_hard_edges(mesh)
        limit = resampling.thresholds.max_edge_length
        if isinstance(limit, float):
            return self._placed(self.subject.build(limit))
        coarse = self._placed(self.subject.build())
        if not isinstance(self.subject, Solid | PluginSurface):
            return coarse  # a model is as its file says
        lengths = resampling.thresholds.fields(coarse)[:, 0]
        finest = max(float(lengths.min()), float(np.median(lengths)) / 3.0)
        return self._placed(self.subject.build(finest))

    def polygons_at_rest(self) -> PolygonMesh:
        """Return the subject's polygons.

        Where lengths are functions, a solid is its mesh at rest: a few corners sample them too coarsely.
        """
        resampling = self.resampling_at(self.frames.first)
        longest = None if resampling is None else resampling.thresholds.max_edge_length
        if longest is None or isinstance(longest, float) or not isinstance(self.subject, Solid):
            return self._placed(self.subject.polygons(longest if isinstance(longest, float) else None))
        return PolygonMesh.from_triangles(self.mesh_at_rest())

    def analytic_surface(self) -> AnalyticSurface | None:
        """Return the analytic surface of the mesh at rest, or None."""
        surface = self.subject.project
        if surface is None or self._is_at_origin:
            return surface
        return RepeatedSurface(surface, *self._standing)

    def copy_indices(self, rest: Points) -> AnyArray:
        """Return the index (V,) of the copy that vertices belong to, by their rest positions (V, 3).

        The spheres around copies do not touch, and a copy at rest lies in its own. Rigid copies may touch,
        and have equally many vertices, one after another.
        """
        if self.is_rigid:
            return np.repeat(np.arange(len(self._standing[0])), len(rest) // len(self._standing[0]))
        return nearest_middles(rest, self._standing[0])

    def copy_places(self, pattern: Pigment | Measure | None, rest: Points) -> dict[str, AnyArray]:
        """Return the vertex attribute that a pattern of whole copies reads, by rest positions (V, 3)."""
        if not isinstance(pattern, Pigment) or not pattern.is_of_copies:
            return {}
        places = pattern.copy_places(self._standing[0])
        return {COPY_PLACE: places[self.copy_indices(rest)].astype(np.float32)}

    def painted(self, rest: Points, faces: Faces) -> PaintedFaces | None:
        """Return what is painted on faces (F, 3) of vertices by their rest positions (V, 3), or None."""
        if not self._is_at_origin:
            rest = self._standing[1].local(rest, self.copy_indices(rest))
        return self.subject.painted(rest, faces)

    @property
    def is_rigid(self) -> bool:
        """True if its subject has copies that keep their shape."""
        return self.copies is not None and self.copies.rigid

    def of_shape(self) -> tuple[Motion, Placements]:
        """Return the motion of one copy alone, around its middle, and the placements of the copies of it."""
        (x, y, z), (middles, standing) = -self._sphere[0], self._standing
        alone = replace(self, copies=None, place=(x, y, z), resampling=self.shape, shape=None)
        return alone, Placements(np.concatenate([standing.matrices[:, :, :3], middles[:, :, None]], axis=2))

    @property
    def _is_at_origin(self) -> bool:
        return self.copies is None and self.place == ORIGIN

    def _placed(self, mesh: Mesh) -> Mesh:
        """Return the mesh of the subject where it stands, or that of its copies."""
        return mesh if self._is_at_origin else self._standing[1].repeated(mesh)

    @cached_property
    def _sphere(self) -> tuple[Points, float]:
        """Middle (3,) and radius of the sphere around the subject, by a mesh that fits any edge lengths."""
        return bounding_sphere(self.subject.build().vertices)

    @cached_property
    def _standing(self) -> tuple[Points, Placements]:
        """The middles (N, 3) of the subject's copies, and their placements from where it is built.

        Raises UsageError where the copies find no room.
        """
        middle, radius = self._sphere
        placements = Placements.of(np.array([self.place]))
        if self.copies is not None:
            placements = self.copies.placements(middle, radius)
        return placements.points(middle[None]), placements

    def begins_rest_interval(self, frame: int) -> bool:
        """Tell whether a rest interval begins: the surface of that frame becomes the one at rest."""
        resampling, since = self.resampling, frame - self.frames.first
        if resampling is None or resampling.method != "triangles" or resampling.placement != "exact":
            return False
        return since > 0 and since % resampling.rest_interval == 0

    def start_data(self) -> dict[str, Any]:
        """Return what decides the first frame as JSON-able data: equal data, equal mesh."""
        data: dict[str, Any] = {
            "subject": self.subject.data(),
            "resampling": now.data() if (now := self.resampling_at(self.frames.first)) else None,
        }
        if self.place != ORIGIN:
            data["place"] = list(self.place)
        if (copies := self.copies) is not None:
            region = {} if copies.region is None else {"region": copies.region.cache_data(0.0)}
            data["copies"] = {**as_data(copies), **region}
            del data["copies"]["is"]
        if self.shape is not None:
            data["shape"] = self.shape.data()
        if self.animated is not None:
            data["given"] = self.animated.data(self.frames.first)
            if self.resampling is not None:
                data["placed"] = PLACED_BY
        return data

    def acting_data(self, frame: int, is_checked: bool = True) -> Any:
        """Return what the flow does on the way into `frame` as JSON-able data; `is_checked` as below."""
        find = checked_cache_data if is_checked else cache_data_or_failure
        try:
            return find(self.limit_steps(self.flow, frame), *self.step(frame))
        except FrameError as error:  # of the speed
            return {"fails": str(error)}

    def step_data(self, frame: int, is_checked: bool = True) -> Any:
        """Return what acts on the way into `frame` as JSON-able data.

        A changed key of a curve changes the data from the key before it on.

        is_checked  False spares a look at every number, and the data may then hold NaN and infinities
        """
        data = self.acting_data(frame, is_checked)
        now = self.resampling_at(frame)
        changes: dict[str, Any] = {}
        if now is not None and now is not self.resampling:
            changes["thresholds"] = now.thresholds_data()
        if self.begins_rest_interval(frame):
            changes["renewed"] = True
        if self.animated is not None:
            changes["given"] = self.animated.data(frame)
        return {"flow": data, **changes} if changes else data


PLACED_BY = "faces"
"""How vertices keep their places on animated models that are resampled: part of the keys of their frames."""


def without_animation(flow: Flow) -> Flow:
    """Return a flow without the motion of an animated model."""
    others = tuple(each for each in flow.members if not isinstance(each, AnimatedFlow))
    return flow if len(others) == len(flow.members) else Sequence(others)


def given_subject(motion: Motion) -> AnimatedSubject | None:
    """Return the animated model of a motion if that alone gives each frame: it is not resampled."""
    return motion.animated if motion.resampling is None else None


@dataclass(frozen=True, eq=False)
class AnimatedSubject:
    """An animated model where a motion has it. Times are seconds of the flow."""

    motion: Motion
    model: AnimatedModel

    def points(self, rest: Points, faces: AnyArray, seconds: float) -> Points:
        """Return where points (V, 3) of the surface at rest, on faces (V,), are at a time."""
        if self.motion._is_at_origin:
            return self.model.carried(rest, faces, seconds)
        copy, placements = self.motion.copy_indices(rest), self.motion._standing[1]
        return placements.placed(self.model.carried(placements.local(rest, copy), faces, seconds), copy)

    def nearest(self, points: Points, ends: Points, starts: AnyArray) -> tuple[Points, AnyArray]:
        """Return the places (N, 3) at rest that `FaceSurface.walked_to` leads points to, and their faces."""
        surface = self.model.faces
        if self.motion._is_at_origin:
            faces = surface.walked_to(points, ends, starts)
            return surface.on(faces, points, surface.vertices), faces
        copy, placements = self.motion.copy_indices(ends[:, 0]), self.motion._standing[1]
        local = placements.local(points, copy)
        near = np.stack([placements.local(ends[:, end], copy) for end in range(2)], axis=1)
        faces = surface.walked_to(local, near, starts)
        return placements.placed(surface.on(faces, local, surface.vertices), copy), faces

    def faces_at_rest(self, vertices: int) -> AnyArray:
        """Return a face (V,) at each of that many vertices of `Motion.mesh_at_rest`, copy by copy."""
        faces = self.model.faces.of_vertices
        return np.tile(faces, vertices // len(faces))

    def vertices(self, seconds: float) -> Points:
        """Return where the vertices (V, 3) of `Motion.mesh_at_rest` are at a time."""
        points = self.model.vertices(seconds)
        return points if self.motion._is_at_origin else self.motion._standing[1].points(points)

    def normals(self, seconds: float) -> Vectors | None:
        """Return unit normals (V, 3) at `vertices`, 0 where unknown; None where the files have none."""
        normals = self.model.normals(seconds)
        return None if normals is None else self.motion._standing[1].directions(normals)

    def mesh(self, frame: int) -> TriangleMesh:
        """Return the surface of a frame."""
        return self.motion._placed(self.model.surface(self.motion.clock.flow_time(frame)))

    def data(self, frame: int) -> Any:
        """Return what decides the surface of a frame, and its velocities; JSON-able."""
        data = self.model.sequence.data(self.motion.clock.flow_time(frame))
        after = self.motion.without_animation
        return [data, after.velocity_data(frame)] if after.flow.members else data
