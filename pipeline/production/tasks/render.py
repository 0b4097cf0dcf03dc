"""Render raw pictures in Mitsuba, from meshes with normals, cameras and looks."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.mesh.placed_copies import all_copies
from flowsculpt.pipeline.production.request.framing import Framing, rotate_y
from flowsculpt.pipeline.production.request.keys import FrameKeys
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shading import dice, pieces_without_facets
from flowsculpt.pipeline.production.store import readers
from flowsculpt.pipeline.production.store.store import Key, checkpoint_of
from flowsculpt.pipeline.production.tasks.finish import raw_attributes
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.worker_end import MemoryGuard, StopRequest, deferred_signals
from flowsculpt.render.base.work_clock import Timing, WorkClock, peak_memory
from flowsculpt.render.frame.checkpoint import Checkpoint
from flowsculpt.render.frame.render_frame import ShutterInterval, render_frame
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.post.image import write_exr
from flowsculpt.render.scene.aovs import COPY, RenderedFrame
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.scene import SUBJECT, Geometry, MotionSample, Scene, SceneSubject
from flowsculpt.render.scene.surface import Spheres, Surface, outlines

if TYPE_CHECKING:
    from flowsculpt.pipeline.production.request.shading import Shading, Shown, SurfaceMotion


def subject_looks(request: RenderRequest, number: int, sample: MotionSample) -> list[SceneSubject]:
    """Return the subjects of a sample with the names and looks that they have in a frame."""
    subjects = zip(request.parts, sample.subjects, strict=True)
    return [
        SceneSubject(part.source.subject or SUBJECT, shown, part.pictures.of(number).look)
        for part, shown in subjects
    ]


@dataclass(frozen=True)
class ShownFrame:
    """The subjects, camera and stage of one picture, at the picture and around it."""

    context: Context
    number: int
    framings: Mapping[int, Framing]

    def moments(self) -> tuple[MotionSample, ShutterInterval | None, MotionSample | None]:
        """Return the picture's moment, its shutter, and the next picture's moment; None for what it lacks."""
        request, number, framing = self.context.request, self.number, self.framings[self.number]
        firsts = _first_copies(request)
        subjects = [
            _ShownSubject(self.context, part, number, framing, first_copy=firsts.get(part.source.subject, 0))
            for part in request.parts
        ]
        if request.frame_source.turn(number) is not None and len(subjects) > 1:
            around = np.concatenate([subject.bounds() for subject in subjects])
            subjects = [replace(subject, around=around) for subject in subjects]
        sample = _sample(framing, [subject.now() for subject in subjects])
        if not request.pictures.offsets(number):
            return sample, None, None
        from flowsculpt.pipeline.production.request.shading import framing_at

        def at(offset: float) -> MotionSample:
            there = framing_at(self.framings, number, offset)
            return _sample(there, [subject.at(offset) for subject in subjects])

        opened = request.pictures.open_at(number)
        following = at(1.0) if "motion" in request.pictures.aovs.extra else None
        return sample, None if opened is None else ShutterInterval(*opened, at), following


def _sample(framing: Framing, subjects: list[Geometry]) -> MotionSample:
    return MotionSample(subjects[0], framing.placement, framing.camera, tuple(subjects[1:]))


def _first_copies(request: RenderRequest) -> dict[str | None, int]:
    """Return the number of the first copy of each subject with numbered copies, from 1 on."""
    counts = np.cumsum([1, *request.pictures.copies.values()])
    return dict(zip(request.pictures.copies, counts.tolist(), strict=False))


@dataclass(frozen=True)
class _ShownSubject:
    """One subject of a picture.

    request  of the subject alone
    framing  of the picture
    around   points of all subjects, which turn together about the axis of their bounds; None for one alone
    first_copy  number of its first copy if copies are numbered; else 0
    """

    context: Context
    request: RenderRequest
    number: int
    framing: Framing
    around: AnyArray | None = None
    first_copy: int = 0

    def bounds(self) -> AnyArray:
        """Return the lowest and the highest coordinates (2, 3) of its vertices, not turned."""
        points = all_copies(self._stored_arrays)["vertices"]
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def now(self) -> Geometry:
        """Return the subject at the moment of the picture."""
        spin, vertices, normals = self._spin, self._arrays["vertices"], self._arrays.get("normals")
        turned_normals = None if normals is None else rotate_y(normals, spin, about_origin=True)
        return self._subject((rotate_y(vertices, spin, around=self.around), turned_normals))

    def at(self, offset: float) -> Geometry:
        """Return the subject so many frames from the picture."""
        return self._subject(self._motion.at(offset))

    @property
    def _mesh(self) -> int:
        return self.request.angles[self.number].mesh

    @property
    def _spin(self) -> float:
        return self.request.angles[self.number].spin

    @cached_property
    def _shading(self) -> Shading:
        """The shading of the mesh, diced for this picture where the shot asks for that."""
        from flowsculpt.pipeline.production.tasks.surfaces import shading_of

        request = self.request
        shading, pixels = shading_of(self.context, request, self._mesh), request.shot.picture.dicing
        shading = replace(shading, has_pigment=self._has_pigment)
        if pixels is None:
            return replace(shading, pieces=self._pieces)
        return shading.cut_for(self.framing.camera, request.pictures.quality, pixels, self._spin, self.around)

    @property
    def _has_pigment(self) -> bool:
        return isinstance(self.request.pictures.of(self.number).look.pattern, Pigment)

    @cached_property
    def _stored_arrays(self) -> Mapping[str, AnyArray]:
        """The arrays of the surface as `smooth_normals` stored them."""
        request = self.request
        key, place = request.keys.normals(self._mesh), request.place("normals", self._mesh)
        return self.context.read("normals", key, place, readers.arrays(key))

    @cached_property
    def _pieces(self) -> int:
        """The pieces of each edge, where the shot does not ask for dicing."""
        request, arrays = self.request, self._stored_arrays
        picture = request.shot.picture
        if not picture.hide_facets or "faces" not in arrays:
            return picture.tessellate
        camera, quality = self.framing.camera, request.pictures.quality
        return pieces_without_facets(all_copies(arrays), camera, quality, self._spin, self.around)

    @cached_property
    def _arrays(self) -> Mapping[str, AnyArray]:
        """The arrays of the surface, with the edges of the resampled mesh where a wireframe shows them."""
        request = self.request
        picture = request.pictures.of(self.number)
        if picture.dicing is None:
            arrays, pieces = self._stored_arrays, self._pieces
            if picture.hide_facets and "faces" in arrays:
                arrays = dice(arrays, pieces, self._has_pigment)
            arrays = all_copies(arrays)
        else:
            arrays, pieces = self._shading.arrays(), self._shading.pieces
        if picture.look.wireframe is None or "faces" not in arrays:
            return arrays
        if request.shot.motion.subject.is_net:
            return arrays  # all edges of a net are drawn
        return {**arrays, "edges": outlines(arrays["faces"], pieces)}

    @cached_property
    def _motion(self) -> SurfaceMotion:
        from flowsculpt.pipeline.production.request.shading import turning_motion

        request = self.request
        motion = request.shot.motion
        turn = request.frame_source.turn(self.number)
        if turn is None:
            return self._shading.moved_by(motion)
        vertices, normals = self._arrays["vertices"], self._arrays.get("normals")
        return turning_motion(vertices, normals, self._spin, turn, float(motion.rate.fps), self.around)

    @cached_property
    def _attributes(self) -> dict[str, AnyArray]:
        """The vertex attributes that AOVs need, mattes of copies, and a look that shows speeds."""
        request, attributes = self.request, {}
        if request.pictures.offsets(self.number):
            motion = self._motion
            values: dict[str, Callable[[], AnyArray]] = {
                "velocity": motion.velocity,
                "before": partial(motion.displacement, -1.0),
                "after": partial(motion.displacement, 1.0),
            }
            names = [name for name in request.pictures.aovs.extra if name in values]
            attributes = {name: values[name]().astype(np.float32) for name in names}
        rest, shot = self._arrays["material"].astype(np.float64), request.shot
        attributes |= shot.motion.copy_places(request.pictures.of(self.number).look.pattern, rest)
        if self.first_copy:
            indices = shot.motion.copy_indices(rest)
            attributes[COPY] = (indices[:, None] + self.first_copy).astype(np.float32)
        if Surface.VALUES in self._arrays:
            attributes[Surface.VALUES] = self._arrays[Surface.VALUES]
        if not request.pictures.measures_speed:
            return attributes
        return {**attributes, Surface.SPEED: self._shading.speeds(request.shot.motion)}

    @cached_property
    def _paint(self) -> PaintedFaces | None:
        """The paint of the subject on its faces, where the look shows it."""
        request, arrays = self.request, self._arrays
        if not request.pictures.of(self.number).look.shows_paint:
            return None
        return request.shot.motion.painted(arrays["material"].astype(np.float64), arrays["faces"])

    def _subject(self, shown: Shown) -> Geometry:
        """Return the surface, or the spheres, with these vertices and normals."""
        arrays, (points, normals) = self._arrays, shown
        vertices, material = points.astype(np.float32), arrays["material"]
        if normals is None:
            return Spheres(vertices, arrays["radii"], self._attributes, material)
        edges, faces = arrays.get("edges"), arrays["faces"]
        more = self._attributes, material, edges, self._paint
        return Surface(vertices, normals.astype(np.float32), faces, *more)


def flow_facts(request: RenderRequest, number: int) -> dict[str, Any]:
    """Return what the flows of a picture say of themselves, by their places in the shot file.

    Of several subjects that have a flow of the shot, each has a place of its own: `flows.0 of ball`.
    """
    mesh, facts = request.angles[number].mesh, {}
    for part in request.parts:
        motion, subject = part.shot.motion, part.source.subject
        for k, flow in enumerate(motion.flow.members):
            if said := dict(flow.facts(motion.clock.flow_time(mesh))):
                place = motion.place_of_flow(k)
                facts[f"{place} of {subject}" if subject and place.startswith("flows") else place] = said
    return facts


def render(context: Context) -> bool:
    """Render the raw pictures of a batch: sample batches averaged, with AOVs.

    Raises StoppedError where the process is to end, and MemoryLimitError where it has grown too
    large; both leave the pictures not yet made to another process.
    """
    request = context.request
    engine = choose([request.variant], threads=context.job.threads)
    framings: Mapping[int, Framing] = request.pictures.framings(context.store) or {}
    keys = context.picture_keys(request)
    with deferred_signals() as stop:
        renderer = _Renderer(context, engine, framings, keys, stop, MemoryGuard())
        return context.for_each(context.job.frames, renderer.make)


@dataclass(frozen=True)
class _Renderer:
    """Renders the pictures of a batch."""

    context: Context
    engine: Engine
    framings: Mapping[int, Framing]
    keys: Mapping[int, FrameKeys]
    stop: StopRequest
    memory: MemoryGuard

    def make(self, number: int) -> bool:
        """Render a picture unless the store holds it; return whether it did."""
        self.stop.check()
        self.memory.check()
        context, key = self.context, self.keys[number].raw
        target = context.request.place("raw", number)
        checkpoint = checkpoint_of(
            context.store, target, key, partial(context.warn, number), lambda: self.stop.received
        )
        found = context.make("raw", key, target, partial(self._write, number, checkpoint))
        checkpoint.remove()
        if not found:
            self.memory.measure()
        return found

    def _write(self, number: int, checkpoint: Checkpoint, path: Path) -> None:
        context, request, clock = self.context, self.context.request, WorkClock()
        picture, aovs = request.pictures.of(number), request.pictures.aovs
        sample, shutter, following = ShownFrame(context, number, self.framings).moments()
        lights = picture.lights.turned(request.angles[number].lights)
        placed = sample.placement, sample.camera
        first, *others = subject_looks(request, number, sample)
        scene = Scene(first.geometry, first.material, lights, picture.stage, *placed, picture.working_space)
        layers = render_frame(
            replace(scene, others=tuple(others), name=first.name),
            request.pictures.quality_of(number),
            request.seed(number),
            self.engine,
            partial(self._passed, number),
            aovs=aovs.extra,
            shutter=shutter,
            following=following,
            checkpoint=checkpoint,
        )
        if checkpoint.resumed:
            context.write("resumed", number, passes=checkpoint.resumed)
        header = request.keys.header(number, self.framings[number], self.keys[number])
        header |= flow_facts(request, number)
        attributes = raw_attributes(request, self.framings[number])
        write_exr(path, layers, header, dict(aovs.precision), attributes=attributes, compression="rle")
        _write_statistics(context, number, self.keys[number].raw, layers, clock.lap(), checkpoint.resumed)

    def _passed(self, number: int, done: int, most: int) -> None:
        """Report a sample batch of a picture, unless the process is to end."""
        self.stop.check()
        self.context.write("pass", number, done=done, most=most)


def _write_statistics(
    context: Context, number: int, key: Key, layers: RenderedFrame, taken: Timing, resumed: int
) -> None:
    """Write the statistics of a picture to a separate file: they differ from run to run, pictures do not.

    taken    the time of the whole picture
    resumed  how many of its batches an earlier process had rendered, whose seconds are not known
    """
    inside = layers.timings.values()
    rest = Timing(taken.seconds - sum(t.seconds for t in inside), taken.cpu - sum(t.cpu for t in inside))
    timings = {**layers.timings, "reading and writing": rest}
    width, height = context.request.pictures.quality.rendered_size
    statistics = {
        "key": key,
        "seconds": {part: round(timing.seconds, 4) for part, timing in timings.items()},
        "cpu_seconds": {part: round(timing.cpu, 4) for part, timing in timings.items()},
        "vertices": layers.facts["surface_vertices"],
        "faces": layers.facts["surface_faces"],
        "motion_samples": layers.facts.get("motion_samples", 1),
        "samples": layers.facts["samples"],
        "light_spread": layers.facts["light_spread"],
        "light_left": layers.facts["light_left"],
        "light_removed": layers.facts["light_removed"],
        **({"noise": layers.facts["noise"]} if "noise" in layers.facts else {}),
        **({"resumed_batches": resumed} if resumed else {}),
        "pixels": width * height,
        "threads": context.job.threads,
        "peak_memory_mib": peak_memory(),
    }
    text = json.dumps(statistics, indent=1) + "\n"
    path = context.root / context.request.place("statistics", number)
    context.store.write(path, lambda draft: draft.write_text(text, encoding="utf-8"), flush=False)
