"""From surfaces to raw pictures."""

from __future__ import annotations

import json
import resource
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from pipeline.production.render_inputs.framing import Framing
from pipeline.production.request.keys import FrameKeys
from pipeline.production.request.picture_header import raw_header
from pipeline.production.store.store import Key
from pipeline.production.store.unfinished import checkpoint_of
from pipeline.production.tasks.finished_frames import raw_attributes
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.shown_frame import ShownFrame, subject_looks
from pipeline.production.tasks.supervisor import MemoryGuard, StopRequest, deferred_signals
from render.base.work_clock import Timing, WorkClock
from render.frame.checkpoint import Checkpoint
from render.frame.render_frame import render_frame
from render.mitsuba.engine import Engine, choose
from render.post.image import write_exr
from render.scene.aovs import RenderedFrame
from render.scene.scene import Scene


def render(context: Context) -> bool:
    """Render the raw pictures of a batch: sample batches averaged, with AOVs.

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
        context, request, clock = self.context, self.context.request, WorkClock()
        picture = request.picture(number)
        sample, shutter, following = ShownFrame(context, number, self.framings).moments()
        lights = picture.lights.turned(request.angles[number].lights)
        placed = sample.placement, sample.camera
        first, *others = subject_looks(request, number, sample)
        scene = Scene(first.geometry, first.material, lights, picture.stage, *placed, picture.working_space)
        layers = render_frame(
            replace(scene, others=tuple(others), name=first.name),
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
    width, height = context.request.quality.rendered_size
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
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }
    text = json.dumps(statistics, indent=1) + "\n"
    path = context.root / context.request.place("statistics", number)
    context.store.write(path, lambda draft: draft.write_text(text, encoding="utf-8"), flush=False)
