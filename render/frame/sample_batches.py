"""The sample batches of a frame: the motion samples they belong to, their sizes and order, and rendering them
into an accumulator.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.frame.accumulator import MIN_ROUNDS, Accumulator
from render.frame.checkpoint import Checkpoint
from render.frame.tiles import Picture
from render.mitsuba.scene import FrameScenes, SceneRenderer
from render.scene.quality import BATCH_SAMPLES, Quality
from render.scene.scene import MotionSample

_MOMENT_CHANNELS = [0, 1, 2, 4, 7]
"""Channels of Mitsuba's moments that are radiance, luminance and its square."""

_SEED_WORDS = {"auxiliary": "guides", "beauty": "beauty"}
"""Words that seeds are made from. They never change, or all noise would."""

MAX_STEP = 1.0
"""Pixels that a point of the subject may move between two motion samples."""

MAX_MOTION_SAMPLES = 16

FIRST_ROUND = 4
"""Samples per pixel of each of the first two rounds, which adaptive sampling by tile compares first."""

MIN_SAMPLES = 4
"""Least samples per pixel of a motion sample, where the frame has at least twice as many. Multijitter spreads
the samples of a batch evenly, which several emitters need: batches of one or two have three times the
noise."""

EVEN_COUNTS = (1, 2, 3, 4, 6, 8, 9, 12, 15, 16)
"""Samples per batch that Mitsuba's multijitter takes exactly; it rounds others up to a rectangle."""


def seed_of(*parts: str | int) -> int:
    """Return a 32-bit seed from a shot's name, a frame, a batch. Mitsuba repeats neighbouring plain seeds."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")


@dataclass(frozen=True, eq=False)
class ShutterInterval:
    """The time while the shutter is open.

    opens, closes  frames from the frame's own time; opens < closes
    at             returns the motion sample at such an offset; always with the same points
    """

    opens: float
    closes: float
    at: Callable[[float], MotionSample]

    def offsets(self, count: int) -> list[float]:
        """Return the middles of `count` equal parts of the time."""
        return [self.opens + (i + 0.5) / count * (self.closes - self.opens) for i in range(count)]

    def longest_motion(self, size: tuple[int, int]) -> float:
        """Return the pixels that the fastest point moves, at the speed of its faster half."""
        opens, closes = self.opens, self.closes
        points = [self.at(offset).pixels(size) for offset in (opens, 0.5 * (opens + closes), closes)]
        reach = 0.55 * np.array(size)  # a little more than the picture
        seen = [(np.abs(point[:, :2]) < reach).all(axis=1) & (point[:, 2] > 0.0) for point in points]
        steps = [np.linalg.norm(b[:, :2] - a[:, :2], axis=1) for a, b in pairwise(points)]
        in_picture = seen[0] | seen[1] | seen[2]
        in_front = np.all([point[:, 2] > 0.0 for point in points], axis=0)
        return 2.0 * float(np.max(np.where(in_picture & in_front, np.maximum(*steps), 0.0), initial=0.0))


@dataclass(frozen=True)
class SampleBatch:
    """A few samples per pixel of one motion sample.

    motion_sample    its index
    kind             "auxiliary" or "beauty"
    samples          samples per pixel
    first            samples per pixel in all batches of this kind before
    ends_round       True if all motion samples have had equally many samples of the beauty since the last
                     batch that did
    """

    motion_sample: int
    kind: str
    samples: int
    first: int = 0
    ends_round: bool = False


class SampleBatches:
    """The sample batches of one frame, and the sums of those rendered so far.

    on_batch    is called after each batch with how many are done, and how many there are at most
    checkpoint  where the sums are stored for another process; if it has any, rendering resumes from them
    groups      names of light groups
    by_tile     True if adaptive sampling stops tiles, False if it stops the whole frame
    """

    def __init__(
        self,
        quality: Quality,
        motion_samples: int,
        aovs: Collection[str],
        seed: int,
        on_batch: Callable[[int, int], None] | None = None,
        checkpoint: Checkpoint | None = None,
        groups: Sequence[str] = (),
        by_tile: bool = False,
    ) -> None:
        self._seed, self._on_batch, self._checkpoint = seed, on_batch, checkpoint
        self._batches = batch_schedule(quality, motion_samples, by_tile)
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
            self._render_beauty(batch, scenes.beauty, seed)
        else:
            self._render_features(batch, scenes.features, seed)
        self._done += 1
        if self._checkpoint is not None:
            self._checkpoint.save_if_due(self._state)
        if self._on_batch is not None:
            self._on_batch(self._done, len(self._batches))

    def _state(self) -> Mapping[str, NDArray[Any]]:
        return {"done": np.array(self._done), **self.accumulator.state()}

    def _render_beauty(self, batch: SampleBatch, beauty: SceneRenderer, seed: int) -> None:
        """Render with our path tracer, whose batches continue one sequence, or with Mitsuba's integrator."""
        if beauty.path_tracer is not None:
            one_seed = seed_of(self._seed, _SEED_WORDS[batch.kind])
            pixels = self.accumulator.active_pixels
            picture = np.asarray(beauty.path_tracer.render(batch.samples, batch.first, one_seed, pixels))
            light = picture.shape[-1] - beauty.path_tracer.coverage_channels
            self.accumulator.add("beauty", picture[..., :light], batch.samples, pixels)
            self.accumulator.add("coverage", picture[..., light:], batch.samples, pixels)
        else:
            picture = _with_moments(beauty.render(batch.samples, seed))
            groups = beauty.render_groups(batch.samples, seed)
            picture = np.concatenate([picture, *groups], axis=2)
            self.accumulator.add("beauty", picture, _multijitter_count(batch.samples))
        if batch.ends_round:
            self.accumulator.end_round(by_tile=beauty.path_tracer is not None)

    def _render_features(self, batch: SampleBatch, tracer: Any, seed: int) -> None:
        """Render with the rays of the path tracer, or with Mitsuba's integrator."""
        if tracer.continues_sequence:
            seed = seed_of(self._seed, _SEED_WORDS["beauty"])
        for name, means in tracer.render(batch.samples, batch.first, seed).items():
            self.accumulator.add(name, means, batch.samples)


def batch_schedule(quality: Quality, motion_samples: int, by_tile: bool = False) -> list[SampleBatch]:
    """Return the batches of a frame in order; `by_tile` as in `SampleBatches`.

    Motion sample by motion sample. With adaptive sampling, beauty batches of all motion samples take turns,
    so that all have the same samples when the frame converges.
    """
    is_adaptive = quality.noise_threshold is not None
    if is_adaptive and by_tile and motion_samples == 1:
        sizes = round_sizes(quality.samples)
    else:
        sizes = (interleaved_batch_sizes if is_adaptive else batch_sizes)(quality.samples, motion_samples)
    auxiliary_sizes = batch_sizes(quality.auxiliary_samples, motion_samples)
    auxiliary = [
        [SampleBatch(i, "auxiliary", samples) for samples in auxiliary_sizes] for i in range(motion_samples)
    ]
    last = motion_samples - 1
    beauty = [
        [SampleBatch(i, "beauty", samples, ends_round=is_adaptive and i == last) for samples in sizes]
        for i in range(motion_samples)
    ]
    if not is_adaptive:
        batches = [batch for i in range(motion_samples) for batch in (*auxiliary[i], *beauty[i])]
    else:
        first_round = [batch for i in range(motion_samples) for batch in (*auxiliary[i], beauty[i][0])]
        rounds = [batch for turn in zip(*beauty, strict=True) for batch in turn]
        batches = first_round + rounds[motion_samples:]
    taken = {"auxiliary": 0, "beauty": 0}
    numbered = []
    for batch in batches:
        numbered.append(replace(batch, first=taken[batch.kind]))
        taken[batch.kind] += batch.samples
    return numbered


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


def motion_sample_count(motion: float, samples: int) -> int:
    """Return how many motion samples a frame takes.

    motion   pixels that its fastest point moves
    samples  samples per pixel

    The fewest that keep steps within MAX_STEP, of the counts that divide the samples equally into batches
    that are not tiny; the largest such count where none is enough.
    """
    least = MIN_SAMPLES if samples >= 2 * MIN_SAMPLES else 1
    divisors = [n for n in range(1, min(MAX_MOTION_SAMPLES, samples // least) + 1) if samples % n == 0]
    possible = [n for n in divisors if n == 1 or _even_divisor(samples // n) >= least]
    return next((n for n in possible if n * MAX_STEP >= motion), possible[-1])


def batch_sizes(samples: int, motion_samples: int) -> list[int]:
    """Return the sizes of the batches of one motion sample: equal, and `samples` in total if possible.

    Samples that do not divide are rounded up.
    """
    share = -(-samples // motion_samples)
    if motion_samples == 1:
        size = min(share, BATCH_SAMPLES)
        return [size] * (share // size)
    size = _even_divisor(share)
    return [size] * (share // size)


def round_sizes(samples: int) -> list[int]:
    """Return the sizes of the rounds after which tiles may stop: 4, 4, and then 8, up to `samples`.

    Our sampler is most even after powers of two.
    """
    sizes: list[int] = []
    while (left := samples - sum(sizes)) > 0:
        sizes.append(min(left, FIRST_ROUND if len(sizes) < MIN_ROUNDS else MIN_ROUNDS * FIRST_ROUND))
    return sizes


def interleaved_batch_sizes(samples: int, motion_samples: int) -> list[int]:
    """Return the sizes of the batches of one motion sample for adaptive sampling.

    Batches of all motion samples take turns. Those of one round have about BATCH_SAMPLES together, so that a
    frame may stop between rounds.
    """
    size = batch_sizes(samples, motion_samples)[0]
    least = max(MIN_SAMPLES, -(-BATCH_SAMPLES // motion_samples))
    size = min((n for n in EVEN_COUNTS if size % n == 0 and n >= least), default=size)
    return [size] * (-(-samples // motion_samples) // size)


def _even_divisor(samples: int) -> int:
    return max(n for n in EVEN_COUNTS if samples % n == 0)
