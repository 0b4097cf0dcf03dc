"""The sample batches of a frame: their order, and rendering them into an accumulator."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.frame.accumulator import Accumulator, Picture
from render.frame.checkpoint import Checkpoint
from render.frame.motion_samples import batch_sizes, combined_batches, interleaved_batch_sizes
from render.frame.vertex_aovs import Attributes, render_attributes
from render.mitsuba.scene import VERTEX_AOV, FrameScenes, SceneRenderer
from render.scene.quality import Quality

_MOMENT_CHANNELS = [0, 1, 2, 4, 7]
"""Channels of Mitsuba's moments that are radiance, luminance and its square."""

_SEED_WORDS = {"auxiliary": "guides", "beauty": "beauty"}
"""Words that seeds are made from. They never change, or all noise would."""


def seed_of(*parts: str | int) -> int:
    """Return a 32-bit seed from a shot's name, a frame, a batch. Mitsuba repeats neighbouring plain seeds."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")


@dataclass(frozen=True)
class SampleBatch:
    """A few samples per pixel of one motion sample.

    motion_sample  its index
    kind           "auxiliary" or "beauty"
    samples        samples per pixel
    has_vertex_aovs  True if vertex AOVs are rendered with the same samples
    first          samples per pixel of the beauty in all batches before
    """

    motion_sample: int
    kind: str
    samples: int
    has_vertex_aovs: bool = False
    first: int = 0


class SampleBatches:
    """The sample batches of one frame, and the sums of those rendered so far.

    on_batch    is called after each batch with how many are done, and how many there are at most
    checkpoint  where the sums are stored for another process; if it has any, rendering resumes from them
    """

    def __init__(
        self,
        quality: Quality,
        motion_samples: int,
        aovs: Collection[str],
        seed: int,
        on_batch: Callable[[int, int], None] | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self._seed, self._on_batch, self._checkpoint = seed, on_batch, checkpoint
        self._batches = batch_schedule(quality, motion_samples)
        self._has_noise_aov = "noise" in aovs
        self._done = 0
        is_adaptive = quality.noise_threshold is not None
        sizes = [b.samples for b in self._batches if b.kind == "beauty" and b.motion_sample == 0]
        in_mean = motion_samples if is_adaptive else motion_samples * len(sizes)
        combined = combined_batches(in_mean, sizes[0])
        self.accumulator = Accumulator(quality, aovs, combined, motion_samples)
        if checkpoint is not None and (state := checkpoint.load()) is not None:
            self._done = int(state["done"])
            self.accumulator.restore(state)

    def remaining(self) -> Iterator[SampleBatch]:
        """Yield the batches to render, until all are done or the frame has converged."""
        while self._done < len(self._batches) and not self.accumulator.has_converged:
            yield self._batches[self._done]

    def render(self, batch: SampleBatch, scenes: FrameScenes, attributes: Attributes) -> None:
        """Render the next of `remaining`. attributes: values (V, 3) that vertex AOVs show, by name"""
        seed = seed_of(self._seed, self._done, _SEED_WORDS[batch.kind])
        if batch.kind == "beauty":
            self._render_beauty(batch, scenes.beauty, seed)
        else:
            self.accumulator.add("auxiliary", scenes.auxiliary.render(batch.samples, seed))
            if batch.has_vertex_aovs and scenes.vertex_aov is not None:
                self._render_attributes(scenes.vertex_aov, attributes, batch.samples, seed)
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
            picture = np.asarray(beauty.path_tracer.render(batch.samples, batch.first, one_seed))
            self.accumulator.add_beauty(picture, batch.samples)
            return
        picture = beauty.render(batch.samples, seed)
        picture = picture[..., _MOMENT_CHANNELS] if self._has_noise_aov else picture
        self.accumulator.add_beauty(picture, _multijitter_count(batch.samples))

    def _render_attributes(
        self, renderer: SceneRenderer, attributes: Attributes, samples: int, seed: int
    ) -> None:
        """Render vertex AOVs with the samples of the auxiliary AOVs, so that coverage is the same."""

        def render(values: NDArray[np.float32]) -> Picture:
            renderer.set_attribute("subject", VERTEX_AOV, values)
            return renderer.render(samples, seed)[..., :3]

        for name, picture in render_attributes(attributes, render).items():
            self.accumulator.add(name, picture)


def batch_schedule(quality: Quality, motion_samples: int) -> list[SampleBatch]:
    """Return the batches of a frame in order.

    Motion sample by motion sample. With adaptive sampling, beauty batches of all motion samples take turns,
    so that all have the same samples when the frame converges.
    """
    is_adaptive = quality.noise_threshold is not None
    sizes = (interleaved_batch_sizes if is_adaptive else batch_sizes)(quality.samples, motion_samples)
    auxiliary_sizes = batch_sizes(quality.auxiliary_samples, motion_samples)
    auxiliary = [
        [
            # Vertex AOVs are smooth: one batch of them is enough.
            SampleBatch(i, "auxiliary", samples, has_vertex_aovs=index == 0)
            for index, samples in enumerate(auxiliary_sizes)
        ]
        for i in range(motion_samples)
    ]
    beauty = [[SampleBatch(i, "beauty", samples) for samples in sizes] for i in range(motion_samples)]
    if not is_adaptive:
        batches = [batch for i in range(motion_samples) for batch in (*auxiliary[i], *beauty[i])]
    else:
        first_round = [batch for i in range(motion_samples) for batch in (*auxiliary[i], beauty[i][0])]
        rounds = [batch for turn in zip(*beauty, strict=True) for batch in turn]
        batches = first_round + rounds[motion_samples:]
    samples = [batch.samples if batch.kind == "beauty" else 0 for batch in batches]
    before = accumulate(samples, initial=0)
    return [replace(batch, first=first) for batch, first in zip(batches, before, strict=False)]


def _multijitter_count(samples: int) -> int:
    """Return how many samples multijitter takes when asked for so many."""
    rows = math.isqrt(samples)
    return rows * -(-samples // rows)
