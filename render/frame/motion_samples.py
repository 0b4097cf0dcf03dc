"""Motion blur: the shutter, and how many motion samples and sample batches a frame takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from render.scene.quality import BATCH_SAMPLES
from render.scene.scene import MotionSample

MAX_STEP = 1.0
"""Pixels that a point of the subject may move between two motion samples."""

MAX_MOTION_SAMPLES = 16

MIN_SAMPLES = 4
"""Least samples per pixel of a motion sample, where the frame has at least twice as many. Multijitter spreads
the samples of a batch evenly, which several emitters need: batches of one or two have three times the
noise."""

EVEN_COUNTS = (1, 2, 3, 4, 6, 8, 9, 12, 15, 16)
"""Samples per batch that Mitsuba's multijitter takes exactly; it rounds others up to a rectangle."""


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


def interleaved_batch_sizes(samples: int, motion_samples: int) -> list[int]:
    """Return the sizes of the batches of one motion sample for adaptive sampling.

    Batches of all motion samples take turns. Those of one round have about BATCH_SAMPLES together, so that a
    frame may stop between rounds.
    """
    size = batch_sizes(samples, motion_samples)[0]
    least = max(MIN_SAMPLES, -(-BATCH_SAMPLES // motion_samples))
    size = min((n for n in EVEN_COUNTS if size % n == 0 and n >= least), default=size)
    return [size] * (-(-samples // motion_samples) // size)


def combined_batches(batches: int, samples: int) -> int:
    """Return how many batches of so many samples make one of about BATCH_SAMPLES, with none left over."""
    most = max(1, BATCH_SAMPLES // samples)
    return max(n for n in range(1, most + 1) if batches % n == 0)


def _even_divisor(samples: int) -> int:
    return max(n for n in EVEN_COUNTS if samples % n == 0)
