"""From surfaces to raw pictures."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.production.render_inputs.framing import Framing, rotate_y
from pipeline.production.request.keys import FrameKeys, raw_header
from pipeline.production.store import readers
from pipeline.production.store.store import Key
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.memory_guard import MemoryGuard
from pipeline.production.tasks.signals import StopRequest, deferred_signals
from render.base.atomic_write import disk_errors
from render.frame.accumulator import Checkpoint
from render.frame.render_frame import render_frame
from render.frame.sample_batches import ShutterInterval
from render.mitsuba.engine import Engine, choose
from render.post.image import write_exr
from render.scene.aovs import RenderedFrame
from render.scene.camera import Camera
from render.scene.measure import SPEED
from render.scene.scene import MotionSample, Scene
from render.scene.spheres import Spheres
from render.scene.surface import Surface
from render.scene.wireframe import outlines

if TYPE_CHECKING:  # what only some pictures need takes half a second
    from pipeline.production.render_inputs.motion import Shown, SurfaceMotion
    from pipeline.production.render_inputs.shading import Shading
    from pipeline.shot import Shot


def render(context: Context) -> bool:
    """Render the raw pictures of a batch: passes averaged, AOVs beside the beauty.

    Raises KeyboardInterrupt where the process is to end, and RestartWorker where it has grown too large; both
    leave the pictures not yet made to another process.
    """
    request = context.request
    engine = choose([request.variant], threads=context.job.threads)
    framings: Mapping[int, Framing] = request.framings(context.store) or {}
    keys = context.picture_keys(request)
    with deferred_signals() as stop:
        renderer = _Renderer(context, engine, framings, keys, stop, MemoryGuard())
        return context.each(context.job.frames, renderer.make)


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
        """Have a picture rendered that the store lacks; whether it was there."""
        self.stop.check()
        self.memory.check()
        context, key = self.context, self.keys[number].raw
        target = context.request.place("raw", number)
        keep = context.store.checkpoint(
            target, key, partial(context.warn, number), lambda: self.stop.received
        )
        found = context.make("raw", key, target, partial(self._write, number, keep))
        keep.remove()
        if not found:
            self.memory.measure()
        return found

    def _write(self, number: int, keep: Checkpoint, path: Path) -> None:
        context, request, begun = self.context, self.context.request, time.perf_counter()
        picture = request.shot.picture
        own, shutter, following = _moments(context, number, self.framings)
        lights = picture.lights.turned(request.angles[number].lights)
        layers = render_frame(
            Scene(own.subject, picture.look, lights, picture.stage, own.placement, own.camera),
            request.quality,
            request.seed(number),
            self.engine,
            partial(self._passed, number),
            aovs=request.aovs.extra,
            shutter=shutter,
            following=following,
            checkpoint=keep,
        )
        if keep.resumed:
            context.resumed(number, keep.resumed)
        header = raw_header(context.request, number, self.framings[number], self.keys[number])
        write_exr(path, layers, header, dict(request.aovs.precision))
        seconds = time.perf_counter() - begun
        _tell_statistics(context, number, self.keys[number].raw, layers, seconds, keep.resumed)

    def _passed(self, number: int, done: int, most: int) -> None:
        self.stop.check()
        self.context.passed(number, done, most)


def _moments(
    context: Context, number: int, framings: Mapping[int, Framing]
) -> tuple[MotionSample, ShutterInterval | None, MotionSample | None]:
    """Return the moment of a picture, its shutter, and the next picture's moment; None for what it lacks."""
    request = context.request
    angle, framing = request.angles[number], framings[number]
    arrays, shading = _drawn(context, number, framing.camera)
    normals = arrays.get("normals")
    shown = (
        rotate_y(arrays["vertices"], angle.spin),
        None if normals is None else rotate_y(normals, angle.spin, about_origin=True),
    )
    measured = _measured(context, number, shading)
    if not request.offsets(number):
        return MotionSample(_subject(arrays, shown, measured), framing.placement, framing.camera), None, None
    from pipeline.production.render_inputs.motion import framing_at

    movement = _movement(context, number, arrays, shading)
    attributes = {**_attributes(movement, request.aovs.extra), **measured}

    def at(offset: float) -> MotionSample:
        there = framing_at(framings, number, offset)
        return MotionSample(_subject(arrays, movement.at(offset), attributes), there.placement, there.camera)

    own = MotionSample(_subject(arrays, shown, attributes), framing.placement, framing.camera)
    opened = request.open_at(number)
    following = at(1.0) if "motion" in request.aovs.extra else None
    return own, None if opened is None else ShutterInterval(*opened, at), following


def _drawn(context: Context, number: int, camera: Camera) -> tuple[Mapping[str, AnyArray], Shading | None]:
    """The arrays of what a picture shows; and how they were cut, where that goes by the picture."""
    request = context.request
    angle, picture = request.angles[number], request.shot.picture
    if picture.dicing is None:
        path = request.place("normals", angle.mesh)
        key = request.normals_key(angle.mesh)
        arrays = context.read("normals", key, path, readers.arrays(key))
        return _with_edges(request.shot, arrays, picture.tessellate), None
    from pipeline.production.tasks.meshes import shading_of

    uncut = shading_of(context, angle.mesh)
    shading = uncut.cut_for(camera, request.quality, picture.dicing, angle.spin)
    return _with_edges(request.shot, shading.arrays(), shading.pieces), shading


def _movement(
    context: Context, number: int, arrays: Mapping[str, AnyArray], shading: Shading | None
) -> SurfaceMotion:
    from pipeline.production.render_inputs.motion import flow_motion, turntable_motion
    from pipeline.production.tasks.meshes import shading_of

    request = context.request
    angle, motion = request.angles[number], request.shot.motion
    if request.turntable is not None:
        turn = request.turntable.step(number)
        return turntable_motion(
            arrays["vertices"], arrays.get("normals"), angle.spin, turn, float(motion.rate.fps)
        )
    return flow_motion(motion, shading or shading_of(context, angle.mesh))


def _measured(context: Context, number: int, shading: Shading | None) -> dict[str, AnyArray]:
    """Return the vertex attributes that the look needs."""
    request = context.request
    if not request.measures_speed:
        return {}
    from pipeline.production.render_inputs.motion import speeds
    from pipeline.production.tasks.meshes import shading_of

    return {SPEED: speeds(request.shot.motion, shading or shading_of(context, request.angles[number].mesh))}


def _attributes(movement: SurfaceMotion, layers: Iterable[str]) -> dict[str, AnyArray]:
    """Return the vertex attributes that the AOVs need."""
    ways: dict[str, Callable[[], AnyArray]] = {
        "velocity": movement.velocity,
        "before": partial(movement.displacement, -1.0),
        "after": partial(movement.displacement, 1.0),
    }
    return {name: ways[name]().astype(np.float32) for name in layers if name in ways}


def _subject(
    arrays: Mapping[str, AnyArray], shown: Shown, attributes: Mapping[str, AnyArray]
) -> Surface | Spheres:
    """Return the surface, or the spheres, of a frame's arrays with these vertices and normals."""
    points, normals = shown
    vertices, material = points.astype(np.float32), arrays["material"]
    if normals is None:
        return Spheres(vertices, arrays["radii"], attributes, material)
    return Surface(
        vertices, normals.astype(np.float32), arrays["faces"], attributes, material, arrays.get("edges")
    )


def _tell_statistics(
    context: Context, number: int, key: Key, layers: RenderedFrame, seconds: float, resumed: int
) -> None:
    """Write the statistics of a picture beside it: they differ from run to run, and pictures do not.

    resumed  how many of its batches an earlier process had rendered, whose seconds are not known
    """
    stages = {name: round(value, 4) for name, value in layers.seconds.items()}
    told = {
        "key": key,
        "seconds": {**stages, "reading and writing": round(seconds - sum(layers.seconds.values()), 4)},
        "vertices": layers.facts["surface_vertices"],
        "faces": layers.facts["surface_faces"],
        "motion_samples": layers.facts.get("motion_samples", 1),
        "samples": layers.facts["samples"],
        **({"noise": layers.facts["noise"]} if "noise" in layers.facts else {}),
        **({"resumed_batches": resumed} if resumed else {}),
        "threads": context.job.threads,
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }
    path = context.root / context.request.place("statistics", number)
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(told, indent=1) + "\n")


def _with_edges(shot: Shot, arrays: Mapping[str, AnyArray], pieces: int) -> Mapping[str, AnyArray]:
    """With the edges of the mesh that was resampled, where they are drawn, however finely it is cut now;
    of a net all are drawn."""
    from pipeline.shot.point_subjects import ControlNet

    is_net = isinstance(shot.motion.subject, ControlNet)
    if shot.picture.look.wireframe is None or is_net or "faces" not in arrays:
        return arrays
    return {**arrays, "edges": outlines(arrays["faces"], pieces)}
