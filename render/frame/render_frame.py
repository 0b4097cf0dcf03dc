"""Render one frame: the mean of sample batches, with all AOVs.

Batches give progress and checkpoints. The box film and the fixed order of sums make a
frame the same to the last bit however often, and with however many threads, it is rendered.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import InitVar, dataclass, field
from itertools import groupby, pairwise
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.work_clock import Timing, WorkClock
from flowsculpt.render.frame.accumulator import Accumulator
from flowsculpt.render.frame.batch_schedule import (
    SampleBatch,
    affordable_motion_samples,
    batch_schedule,
    chosen_pixels,
    multijitter_rounds,
    seed_of,
    traced_rounds,
)
from flowsculpt.render.frame.checkpoint import Checkpoint
from flowsculpt.render.frame.tiles import Picture, PixelNumbers
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.mitsuba_scene import FrameScenes, build_scene, has_path_tracer
from flowsculpt.render.scene.aovs import Pixels, RenderedFrame, stage_motion, vertex_attributes
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.rgb_spaces import LUMA
from flowsculpt.render.scene.scene import MotionSample, Scene
from flowsculpt.render.scene.surface import Surface


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
    own, is_traced = scene.motion_sample, has_path_tracer(scene, quality)
    ends: Sequence[MotionSample | None] = following.each() if following else [None] * len(own.subjects)
    attributes = [
        vertex_attributes(now, then, aovs, quality.size) for now, then in zip(own.each(), ends, strict=True)
    ]
    motion = 0.0 if shutter is None else shutter.longest_motion(quality.size)
    if is_traced:
        affordable = affordable_motion_samples(quality, own.vertex_count)
        rounds = traced_rounds(quality, motion, affordable, seed)
    else:
        rounds = multijitter_rounds(quality, motion)
    motion_samples = len({time for each in rounds for time in each.times})
    groups = [group.name for group in scene.lights.groups]
    schedule = batch_schedule(quality, rounds)
    batches = SampleBatches(quality, schedule, aovs, seed, on_batch, checkpoint, groups)
    stopwatch.lap("preparing")
    moved: MotionSample | None = None
    scenes: FrameScenes | None = None

    def sample_at(time: float) -> MotionSample:
        offset = 0.0 if shutter is None else shutter.offset(time)
        sample = own if shutter is None or offset == 0.0 else shutter.at(offset)
        return sample.with_surfaces(quality.width, attributes)

    for moment, its_batches in groupby(batches.remaining(), attrgetter("time")):
        moved, scenes = sample_at(moment), None  # frees the earlier one, whose shapes would be in the code
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
        arrays["motion"] = _add_stage_motion(arrays, own, following, quality.size)
    facts = {
        "seed": seed,
        **batches.accumulator.facts(),
        "auxiliary_samples": quality.auxiliary_samples,
        "depth": quality.depth,
        "lens_radius": scene.camera.lens_radius,
        **({} if is_traced else {"features_apart": True}),
        "working_space": scene.working_space.name,
        "surface_vertices": sum(len(surface.vertices) for surface in surfaces),
        "surface_faces": sum(len(surface.faces) for surface in surfaces),
        **({} if shutter is None else _shutter_facts(shutter, motion, motion_samples)),
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


def _shutter_facts(shutter: ShutterInterval, motion: float, motion_samples: int) -> dict[str, Any]:
    return {
        "shutter": [shutter.opens, shutter.closes],
        "motion_samples": motion_samples,
        "pixels_between_motion_samples": round(motion / motion_samples, 3),
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


_MOMENT_CHANNELS = [0, 1, 2, 4, 7]
"""Channels of Mitsuba's moments that are radiance, luminance and its square."""

_SEED_WORDS = {"auxiliary": "guides", "beauty": "beauty"}
"""Words that seeds are made from. They never change, or all noise would."""


@dataclass(frozen=True, eq=False)
class ShutterInterval:
    """The time while the shutter is open.

    opens, closes  frames from the frame's own time; opens < closes
    at             returns the motion sample at such an offset; always with the same points
    """

    opens: float
    closes: float
    at: Callable[[float], MotionSample]

    def offset(self, time: float) -> float:
        """Return the offset after a share of the time has passed."""
        return self.opens + time * (self.closes - self.opens)

    def longest_motion(self, size: tuple[int, int]) -> float:
        """Return the pixels that the fastest point moves, twice those in the faster half of the time."""
        opens, closes = self.opens, self.closes
        samples = [self.at(offset) for offset in (opens, 0.5 * (opens + closes), closes)]
        points, projection = [sample.pixels(size) for sample in samples], samples[0].camera.projection
        reach = 0.55 * np.array(size)  # a little more than the picture
        seen = [(np.abs(point[:, :2]) < reach).all(axis=1) & (point[:, 2] > 0.0) for point in points]
        moved = [projection.motion(b[:, :2] - a[:, :2], size[0]) for a, b in pairwise(points)]
        steps = [np.linalg.norm(step, axis=1) for step in moved]
        in_picture = seen[0] | seen[1] | seen[2]
        in_front = np.all([point[:, 2] > 0.0 for point in points], axis=0)
        return 2.0 * float(np.max(np.where(in_picture & in_front, np.maximum(*steps), 0.0), initial=0.0))


@dataclass
class SampleBatches:
    """The sample batches of one frame, and the sums of those rendered so far.

    batches     in order
    seed        of the frame
    on_batch    is called after each batch with how many are done, and how many there are at most
    checkpoint  where the sums are stored for another process; if it has any, rendering resumes from them
    groups      names of light groups
    """

    quality: Quality
    batches: Sequence[SampleBatch]
    aovs: InitVar[Collection[str]]
    seed: int
    on_batch: Callable[[int, int], None] | None = None
    checkpoint: Checkpoint | None = None
    groups: InitVar[Sequence[str]] = ()
    accumulator: Accumulator = field(init=False)
    _done: int = field(default=0, init=False)

    def __post_init__(self, aovs: Collection[str], groups: Sequence[str]) -> None:
        self.accumulator = Accumulator(self.quality, aovs, groups)
        if self.checkpoint is not None and (state := self.checkpoint.load()) is not None:
            self._done = int(state["done"])
            self.accumulator.restore(state)

    def remaining(self) -> Iterator[SampleBatch]:
        """Yield the batches to render, until all are done or the frame has converged."""
        while self._done < len(self.batches) and not self.accumulator.has_converged:
            yield self.batches[self._done]

    def render(self, batch: SampleBatch, scenes: FrameScenes) -> None:
        """Render the next of `remaining`."""
        seed = seed_of(self.seed, self._done, _SEED_WORDS[batch.kind])
        if batch.kind == "beauty":
            self._render_beauty(batch, scenes, seed)
        else:
            self._render_features(batch, scenes.features, seed)
        self._done += 1
        if self.checkpoint is not None:
            self.checkpoint.save_if_due(self._state)
        if self.on_batch is not None:
            self.on_batch(self._done, len(self.batches))

    def _state(self) -> Mapping[str, NDArray[Any]]:
        return {"done": np.array(self._done), **self.accumulator.state()}

    def _render_beauty(self, batch: SampleBatch, scenes: FrameScenes, seed: int) -> None:
        """Render with our path tracer, whose batches continue one sequence, or with Mitsuba's integrator."""
        beauty = scenes.beauty
        if beauty.path_tracer is not None:
            self._trace_beauty(batch, beauty.path_tracer, scenes.copies)
        else:
            picture = _with_moments(beauty.render(batch.samples, seed))
            groups = beauty.render_groups(batch.samples, seed, picture[..., :3])
            picture = np.concatenate([picture, *groups], axis=2)
            self.accumulator.add("beauty", picture, _multijitter_count(batch.samples))
        if batch.ends_round:
            self.accumulator.end_round(by_tile=beauty.path_tracer is not None)

    def _trace_beauty(self, batch: SampleBatch, tracer: Any, copies: Any) -> None:
        """Render the pixels that are still noisy and choose this motion sample.

        copies  a `CopyTracer`, or None where copies are not told apart
        """
        pixels = chosen_pixels(self.quality, batch, self.seed, self.accumulator.active_pixels)
        if not len(pixels):
            return
        seed = seed_of(self.seed, _SEED_WORDS[batch.kind])
        picture = np.asarray(tracer.render(batch.samples, batch.first, seed, pixels))
        light = picture.shape[-1] - tracer.coverage_channels
        self.accumulator.add("beauty", picture[..., :light], batch.samples, pixels)
        self.accumulator.add("coverage", picture[..., light:], batch.samples, pixels)
        if copies is not None:
            self.accumulator.add_copies(copies.render(batch.samples, batch.first, seed, pixels), pixels)

    def _render_features(self, batch: SampleBatch, tracer: Any, seed: int) -> None:
        """Render with the rays of the path tracer, or with Mitsuba's integrator."""
        pixels: PixelNumbers | None = None
        if tracer.continues_sequence:
            seed = seed_of(self.seed, _SEED_WORDS["beauty"])
            of_batch = self.accumulator.edge_pixels if batch.at_edges else self.accumulator.all_pixels
            pixels = chosen_pixels(self.quality, batch, self.seed, of_batch)
            if not len(pixels):
                return
        for name, means in tracer.render(batch.samples, batch.first, seed, pixels).items():
            self.accumulator.add(name, means, batch.samples, pixels)


def _with_moments(picture: Picture) -> Picture:
    """Return radiance, luminance and its square of a batch by one of Mitsuba's integrators.

    A material that brings its own light is rendered without moments: its samples differ only at edges.
    """
    if picture.shape[2] > 3:
        return picture[..., _MOMENT_CHANNELS]
    luminance = picture @ LUMA[:, None]
    return np.concatenate([picture, luminance, luminance * luminance], axis=2)


def _multijitter_count(samples: int) -> int:
    """Return how many samples multijitter takes when asked for so many."""
    rows = math.isqrt(samples)
    return rows * -(-samples // rows)
