"""Render the sample batches of a frame into an accumulator."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.frame.accumulator import Accumulator
from render.frame.batch_schedule import SampleBatch, chosen_pixels, seed_of
from render.frame.checkpoint import Checkpoint
from render.frame.tiles import Picture, PixelNumbers
from render.mitsuba.mitsuba_scene import FrameScenes
from render.scene.render_quality import Quality
from render.scene.scene import MotionSample

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
        """Return the pixels that the fastest point moves, at the speed of its faster half."""
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


class SampleBatches:
    """The sample batches of one frame, and the sums of those rendered so far.

    batches     in order
    on_batch    is called after each batch with how many are done, and how many there are at most
    checkpoint  where the sums are stored for another process; if it has any, rendering resumes from them
    groups      names of light groups
    """

    def __init__(
        self,
        quality: Quality,
        batches: Sequence[SampleBatch],
        aovs: Collection[str],
        seed: int,
        on_batch: Callable[[int, int], None] | None = None,
        checkpoint: Checkpoint | None = None,
        groups: Sequence[str] = (),
    ) -> None:
        self._seed, self._on_batch, self._checkpoint = seed, on_batch, checkpoint
        self._quality, self._batches = quality, batches
        self._done = 0
        self.accumulator = Accumulator(quality, aovs, groups)
        if checkpoint is not None and (state := checkpoint.load()) is not None:
            self._done = int(state["done"])
            self.accumulator.restore(state)

    def remaining(self) -> Iterator[SampleBatch]:
        """Yield the batches to render, until all are done or the frame has converged."""
        while self._done < len(self._batches) and not self.accumulator.has_converged:
            yield self._batches[self._done]

    def render(self, batch: SampleBatch, scenes: FrameScenes) -> None:
        """Render the next of `remaining`."""
        seed = seed_of(self._seed, self._done, _SEED_WORDS[batch.kind])
        if batch.kind == "beauty":
            self._render_beauty(batch, scenes, seed)
        else:
            self._render_features(batch, scenes.features, seed)
        self._done += 1
        if self._checkpoint is not None:
            self._checkpoint.save_if_due(self._state)
        if self._on_batch is not None:
            self._on_batch(self._done, len(self._batches))

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
        pixels = chosen_pixels(self._quality, batch, self._seed, self.accumulator.active_pixels)
        if pixels is not None and not len(pixels):
            return
        seed = seed_of(self._seed, _SEED_WORDS[batch.kind])
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
            seed = seed_of(self._seed, _SEED_WORDS["beauty"])
            of_batch = self.accumulator.edge_pixels if batch.at_edges else self.accumulator.all_pixels
            pixels = chosen_pixels(self._quality, batch, self._seed, of_batch)
            if pixels is not None and not len(pixels):
                return
            features = tracer.render(batch.samples, batch.first, seed, pixels)
        else:
            features = tracer.render(batch.samples, batch.first, seed)
        for name, means in features.items():
            self.accumulator.add(name, means, batch.samples, pixels)


def _with_moments(picture: Picture) -> Picture:
    """Return radiance, luminance and its square of a batch by one of Mitsuba's integrators.

    A material that brings its own light is rendered without moments: its samples differ only at edges.
    """
    if picture.shape[2] > 3:
        return picture[..., _MOMENT_CHANNELS]
    luminance = picture @ np.array([[0.2126], [0.7152], [0.0722]])
    return np.concatenate([picture, luminance, luminance * luminance], axis=2)


def _multijitter_count(samples: int) -> int:
    """Return how many samples multijitter takes when asked for so many."""
    rows = math.isqrt(samples)
    return rows * -(-samples // rows)
