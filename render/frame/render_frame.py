"""Render one frame: the mean of sample batches, with all AOVs.

Batches give progress and checkpoints. The box film and the fixed order of sums make a
frame the same to the last bit however often, and with however many threads, it is rendered.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np

from render.base.work_clock import Timing, WorkClock
from render.frame.batch_schedule import (
    Round,
    affordable_motion_samples,
    batch_schedule,
    multijitter_rounds,
    seed_of,
    traced_rounds,
)
from render.frame.checkpoint import Checkpoint
from render.frame.sample_batches import SampleBatches, ShutterInterval
from render.mitsuba.engine import Engine
from render.mitsuba.mitsuba_scene import build_scene
from render.mitsuba.tracers import has_path_tracer
from render.scene.aovs import Pixels, RenderedFrame, stage_motion, vertex_attributes
from render.scene.render_quality import Quality
from render.scene.scene import MotionSample, Scene
from render.scene.surface import Surface


def render_frame(
    scene: Scene,
    quality: Quality,
    seed: int,
    engine: Engine,
    on_batch: Callable[[int, int], None] | None = None,
    *,
    aovs: Collection[str] = (),
    shutter: ShutterInterval | None = None,
    following: MotionSample | None = None,
    checkpoint: Checkpoint | None = None,
) -> RenderedFrame:
    """Render one frame with `engine`, which is started here if it was not yet.

    on_batch    called after each sample batch with how many are done and how many there are at most; what it
                raises ends the frame
    aovs        AOVs beyond those of all frames: names of `scene.aovs.EXTRA`. `velocity` shows the vertex
                attribute of that name, `rest` the rest positions
    shutter     with motion blur, the time while it is open; the frame is the mean of motion samples
    following   the same points at the next frame, for the AOV `motion`
    checkpoint  where the sums of batches are stored, to resume a frame that was interrupted

    Raises BadInputError for a surface that is empty, not finite or badly indexed, and for an AOV without the
    data it shows.
    """
    engine.start()
    stopwatch = Stopwatch()
    size = quality.width, quality.height
    own = scene.motion_sample
    ends: Sequence[MotionSample | None] = (
        [None] * len(own.subjects) if following is None else following.each()
    )
    attributes = [
        vertex_attributes(now, then, aovs, size) for now, then in zip(own.each(), ends, strict=True)
    ]
    motion = 0.0 if shutter is None else shutter.longest_motion(size)
    if has_path_tracer(scene, quality):
        affordable = affordable_motion_samples(quality, own.vertex_count)
        rounds = traced_rounds(quality, motion, affordable, seed)
    else:
        rounds = multijitter_rounds(quality, motion)
    groups = [group.name for group in scene.lights.groups]
    schedule = batch_schedule(quality, rounds)
    motion_samples = _motion_sample_count(rounds)
    batches = SampleBatches(quality, schedule, aovs, seed, on_batch, checkpoint, groups)
    stopwatch.lap("preparing")
    moved: MotionSample | None = None

    def sample_at(time: float) -> MotionSample:
        offset = 0.0 if shutter is None else shutter.offset(time)
        sample = own if shutter is None or offset == 0.0 else shutter.at(offset)
        return sample.with_surfaces(quality.width, attributes)

    for moment, its_batches in groupby(batches.remaining(), attrgetter("time")):
        moved = sample_at(moment)
        scenes = build_scene(
            scene.at(moved), quality, aovs, motion_samples, seed_of(seed, "photons", str(moment))
        )
        stopwatch.lap("building")
        for batch in its_batches:
            batches.render(batch, scenes)
        stopwatch.lap("rendering")
    moved = moved or sample_at(schedule[-1].time)  # the checkpoint held all batches
    surfaces = [surface for surface in moved.subjects if isinstance(surface, Surface)]
    arrays = batches.accumulator.frame_aovs(list(scene.objects))
    if "alpha" not in arrays:
        arrays["alpha"] = _alpha(arrays, scene)
    if "motion" in arrays and following is not None and scene.stage.kind != "none":
        arrays["motion"] = _add_stage_motion(arrays, own, following, size)
    facts = {
        "seed": seed,
        **batches.accumulator.facts(),
        "auxiliary_samples": quality.auxiliary_samples,
        "depth": quality.depth,
        "lens_radius": scene.camera.lens_radius,
        **({} if has_path_tracer(scene, quality) else {"features_apart": True}),
        "working_space": scene.working_space.name,
        "surface_vertices": sum(len(surface.vertices) for surface in surfaces),
        "surface_faces": sum(len(surface.faces) for surface in surfaces),
        **({} if shutter is None else _shutter_facts(shutter, motion, rounds)),
        **engine.facts(),
    }
    return RenderedFrame(arrays, facts, stopwatch.timings)


class Stopwatch:
    """The time since it was made, by what it was spent on."""

    def __init__(self) -> None:
        self.timings: dict[str, Timing] = {}
        self._clock = WorkClock()

    def lap(self, name: str) -> None:
        """Add the time since the last call to `name`."""
        taken, known = self._clock.lap(), self.timings.get(name, Timing(0.0, 0.0))
        self.timings[name] = Timing(known.seconds + taken.seconds, known.cpu + taken.cpu)


def _motion_sample_count(rounds: Sequence[Round]) -> int:
    return len({time for each in rounds for time in each.times})


def _shutter_facts(shutter: ShutterInterval, motion: float, rounds: Sequence[Round]) -> dict[str, Any]:
    count = _motion_sample_count(rounds)
    return {
        "shutter": [shutter.opens, shutter.closes],
        "motion_samples": count,
        "pixels_between_motion_samples": round(motion / count, 3),
    }


def _alpha(arrays: Mapping[str, Pixels], scene: Scene) -> Pixels:
    """Return the coverage (H, W) of the pixel by all that the lens sees, by AOVs of Mitsuba's integrators."""
    is_opaque = scene.lights.shows_sky or not scene.is_lit
    background = 1.0 if is_opaque else arrays["depth"] > 0.0 if scene.stage.objects else 0.0
    return np.maximum(arrays["matte"], np.float32(background))


def _add_stage_motion(
    arrays: Mapping[str, Pixels], own: MotionSample, following: MotionSample, size: tuple[int, int]
) -> Pixels:
    """Return the motion of the subject, plus that of the stage where it is visible."""
    visible = np.clip(1.0 - arrays["matte"], 0.0, 1.0) * (arrays["depth"] > 0.0)
    motion = stage_motion(arrays["position"].astype(np.float64), own, following, size)
    return np.asarray(arrays["motion"] + visible[..., None] * motion, dtype=np.float32)
