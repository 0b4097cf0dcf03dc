"""From surfaces to raw pictures."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.production.render_inputs.facets import diced, pieces_without_facets
from pipeline.production.render_inputs.framing import Framing
from pipeline.production.render_inputs.view_geometry import rotate_y
from pipeline.production.request.keys import FrameKeys, raw_header
from pipeline.production.store import readers
from pipeline.production.store.store import Key
from pipeline.production.store.unfinished import checkpoint_of
from pipeline.production.tasks.finished_frames import raw_attributes
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.supervisor import MemoryGuard, StopRequest, deferred_signals
from render.frame.checkpoint import Checkpoint
from render.frame.render_frame import render_frame
from render.frame.sample_batches import ShutterInterval
from render.mitsuba.engine import Engine, choose
from render.post.image import write_exr
from render.scene.aovs import RenderedFrame
from render.scene.measure import SPEED
from render.scene.scene import MotionSample, Scene
from render.scene.spheres import Spheres
from render.scene.surface import Surface, outlines

if TYPE_CHECKING:  # what only some pictures need takes half a second
    from pipeline.production.render_inputs.shading import Shading, Shown, SurfaceMotion


def render(context: Context) -> bool:
    """Render the raw pictures of a batch: sample batches averaged, AOVs beside the beauty.

    Raises KeyboardInterrupt where the process is to end, and MemoryLimitError where it has grown too
    large; both leave the pictures not yet made to another process.
    """
    request = context.request
    engine = choose([request.variant], threads=context.job.threads)
    framings: Mapping[int, Framing] = request.framings(context.store) or {}
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
        context, request, begun = self.context, self.context.request, time.perf_counter()
        picture = request.picture(number)
        sample, shutter, following = ShownFrame(context, number, self.framings).moments()
        lights = picture.lights.turned(request.angles[number].lights)
        placed = sample.placement, sample.camera
        layers = render_frame(
            Scene(sample.subject, picture.look, lights, picture.stage, *placed, picture.working_space),
            request.quality_of(number),
            request.seed(number),
            self.engine,
            partial(self._passed, number),
            aovs=request.aovs.extra,
            shutter=shutter,
            following=following,
            checkpoint=checkpoint,
        )
        if checkpoint.resumed:
            context.write("resumed", number, passes=checkpoint.resumed)
        header = raw_header(request, number, self.framings[number], self.keys[number])
        attributes = raw_attributes(request, self.framings[number])
        write_exr(path, layers, header, dict(request.aovs.precision), attributes=attributes)
        seconds = time.perf_counter() - begun
        _write_statistics(context, number, self.keys[number].raw, layers, seconds, checkpoint.resumed)

    def _passed(self, number: int, done: int, most: int) -> None:
        """Report a sample batch of a picture, unless the process is to end."""
        self.stop.check()
        self.context.write("pass", number, done=done, most=most)


@dataclass(frozen=True)
class ShownFrame:
    """The subject, camera and stage of one picture, at the picture and around it."""

    context: Context
    number: int
    framings: Mapping[int, Framing]

    def moments(self) -> tuple[MotionSample, ShutterInterval | None, MotionSample | None]:
        """Return the picture's moment, its shutter, and the next picture's moment; None for what it lacks."""
        request, number, framing = self.context.request, self.number, self.framings[self.number]
        spin, vertices, normals = self._spin, self._arrays["vertices"], self._arrays.get("normals")
        turned_normals = None if normals is None else rotate_y(normals, spin, about_origin=True)
        shown = rotate_y(vertices, spin), turned_normals
        speeds = self._speeds()
        if not request.offsets(number):
            return MotionSample(self._subject(shown, speeds), framing.placement, framing.camera), None, None
        from pipeline.production.render_inputs.shading import framing_at

        motion = self._motion()
        attributes = {**self._motion_attributes(motion), **speeds}

        def at(offset: float) -> MotionSample:
            there = framing_at(self.framings, number, offset)
            return MotionSample(self._subject(motion.at(offset), attributes), there.placement, there.camera)

        sample = MotionSample(self._subject(shown, attributes), framing.placement, framing.camera)
        opened = request.open_at(number)
        following = at(1.0) if "motion" in request.aovs.extra else None
        return sample, None if opened is None else ShutterInterval(*opened, at), following

    @property
    def _mesh(self) -> int:
        return self.context.request.angles[self.number].mesh

    @property
    def _spin(self) -> float:
        return self.context.request.angles[self.number].spin

    @cached_property
    def _shading(self) -> Shading:
        """The shading of the mesh, diced for this picture where the shot asks for that."""
        from pipeline.production.tasks.meshes import shading_of

        request = self.context.request
        shading, pixels = shading_of(self.context, self._mesh), request.shot.picture.dicing
        if pixels is None:
            return replace(shading, pieces=self._pieces)
        return shading.cut_for(self.framings[self.number].camera, request.quality, pixels, self._spin)

    @cached_property
    def _stored_arrays(self) -> Mapping[str, AnyArray]:
        """The arrays of the surface as `smooth_normals` stored them."""
        request = self.context.request
        key, place = request.normals_key(self._mesh), request.place("normals", self._mesh)
        return self.context.read("normals", key, place, readers.arrays(key))

    @cached_property
    def _pieces(self) -> int:
        """The pieces of each edge, where the shot does not ask for dicing."""
        request, arrays = self.context.request, self._stored_arrays
        picture = request.shot.picture
        if not picture.hide_facets or "faces" not in arrays:
            return picture.tessellate
        camera = self.framings[self.number].camera
        return pieces_without_facets(arrays, camera, request.quality, self._spin)

    @cached_property
    def _arrays(self) -> Mapping[str, AnyArray]:
        """The arrays of the surface, with the edges of the resampled mesh where a wireframe shows them."""
        request = self.context.request
        picture = request.picture(self.number)
        if picture.dicing is None:
            arrays, pieces = self._stored_arrays, self._pieces
            if picture.hide_facets and "faces" in arrays:
                arrays = diced(arrays, pieces)
        else:
            arrays, pieces = self._shading.arrays(), self._shading.pieces
        if picture.look.wireframe is None or "faces" not in arrays:
            return arrays
        from pipeline.shot.point_subjects import ControlNet

        if isinstance(request.shot.motion.subject, ControlNet):
            return arrays  # all edges of a net are drawn
        return {**arrays, "edges": outlines(arrays["faces"], pieces)}

    def _motion(self) -> SurfaceMotion:
        from pipeline.production.render_inputs.shading import flow_motion, turntable_motion

        request = self.context.request
        motion = request.shot.motion
        if request.turntable is None:
            return flow_motion(motion, self._shading)
        vertices, normals = self._arrays["vertices"], self._arrays.get("normals")
        turn = request.turntable.step(self.number)
        return turntable_motion(vertices, normals, self._spin, turn, float(motion.rate.fps))

    def _speeds(self) -> dict[str, AnyArray]:
        """Return the vertex attribute of a look that shows speeds."""
        request = self.context.request
        if not request.measures_speed:
            return {}
        from pipeline.production.render_inputs.shading import speeds

        return {SPEED: speeds(request.shot.motion, self._shading)}

    def _motion_attributes(self, motion: SurfaceMotion) -> dict[str, AnyArray]:
        """Return the vertex attributes that the AOVs need."""
        attributes: dict[str, Callable[[], AnyArray]] = {
            "velocity": motion.velocity,
            "before": partial(motion.displacement, -1.0),
            "after": partial(motion.displacement, 1.0),
        }
        names = self.context.request.aovs.extra
        return {name: attributes[name]().astype(np.float32) for name in names if name in attributes}

    def _subject(self, shown: Shown, attributes: Mapping[str, AnyArray]) -> Surface | Spheres:
        """Return the surface, or the spheres, with these vertices and normals."""
        arrays, (points, normals) = self._arrays, shown
        vertices, material = points.astype(np.float32), arrays["material"]
        if normals is None:
            return Spheres(vertices, arrays["radii"], attributes, material)
        edges = arrays.get("edges")
        return Surface(vertices, normals.astype(np.float32), arrays["faces"], attributes, material, edges)


def _write_statistics(
    context: Context, number: int, key: Key, layers: RenderedFrame, seconds: float, resumed: int
) -> None:
    """Write the statistics of a picture beside it: they differ from run to run, and pictures do not.

    resumed  how many of its batches an earlier process had rendered, whose seconds are not known
    """
    stages = {name: round(value, 4) for name, value in layers.seconds.items()}
    statistics = {
        "key": key,
        "seconds": {**stages, "reading and writing": round(seconds - sum(layers.seconds.values()), 4)},
        "vertices": layers.facts["surface_vertices"],
        "faces": layers.facts["surface_faces"],
        "motion_samples": layers.facts.get("motion_samples", 1),
        "samples": layers.facts["samples"],
        "light_spread": layers.facts["light_spread"],
        "light_left": layers.facts["light_left"],
        "light_removed": layers.facts["light_removed"],
        **({"noise": layers.facts["noise"]} if "noise" in layers.facts else {}),
        **({"resumed_batches": resumed} if resumed else {}),
        "threads": context.job.threads,
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }
    text = json.dumps(statistics, indent=1) + "\n"
    path = context.root / context.request.place("statistics", number)
    context.store.write(path, lambda draft: draft.write_text(text), flush=False)
