"""The schedule of a frame: the times of the open shutter at which samples are taken, and in which pixels.

Our path tracer continues one sequence of samples from batch to batch, so a motion sample may have a single
sample per pixel. Where motion asks for more motion samples than a pixel has samples, each pixel is sampled
in some of them: the time is cut into as many strata as there are samples, and a pixel chooses one motion
sample in each (Cook, Porter and Carpenter 1984: distribution in time, by pixel). Steps between motion samples
become noise in place of ghosts. Mitsuba's multijitter spreads the samples of a batch, not those of several,
and keeps batches of 4 samples or more.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import attrgetter

import numpy as np

from flowsculpt.render.frame.tiles import PixelNumbers
from flowsculpt.render.scene.render_quality import BATCH_SAMPLES, Quality

MAX_STEP = 1.0
"""Pixels that a point of the subject may move between two motion samples of all pixels."""

MAX_CHOSEN_STEP = 1.5
"""Pixels between two motion samples if each pixel chooses one of them."""

MAX_MOTION_SAMPLES = 16
"""Most motion samples with multijitter, and the number that is always affordable."""

MIN_SAMPLES = 4
"""Least samples per pixel of a motion sample with multijitter, where the frame has at least twice as many.
Several emitters need evenly spread samples: batches of one or two have three times the noise."""

EVEN_COUNTS = (1, 2, 3, 4, 6, 8, 9, 12, 15, 16)
"""Samples per batch that Mitsuba's multijitter takes exactly; it rounds others up to a rectangle."""

FIRST_ROUND, STILL_ROUND, MOVING_ROUND = 4, 8, 32
"""Samples per pixel of each of the first two rounds, which adaptive sampling compares first; most of a round;
and most with motion, where each round builds scenes."""

FIRST_AUXILIARY, FIRST_MOVING_AUXILIARY = 4, 16
"""Auxiliary samples of each pixel of a still picture, and of one with motion whose sampling is adaptive. Only
pixels at edges of features take more: 3 to 15% of them."""

_SAMPLE_SECONDS, _SCENE_SECONDS, _VERTEX_SECONDS = 0.8e-6, 0.06, 3e-6
"""CPU seconds of a path of clay, and of a motion sample: for itself, and for each vertex of the subject. They
are constants, and not measured, so that a frame is the same on every machine."""


def seed_of(*parts: str | int) -> int:
    """Return a 32-bit seed from a shot's name, a frame, a batch. Mitsuba repeats neighbouring plain seeds."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")


_MIXING = ((32, 0x9E3779B97F4A7C15), (30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB))
"""Shifts and factors of a hash (splitmix64 by Steele, Lea and Flood, 2014)."""


@dataclass(frozen=True)
class SampleBatch:
    """A few samples per pixel at one time.

    time             share of the open shutter's time that has passed, 0 to 1
    kind             "auxiliary" or "beauty"
    samples          samples per pixel
    first            samples per pixel of this kind before
    choice           (i, n): the pixels that choose the i-th of the n motion samples of a stratum. n is 1 for
                     all pixels
    at_edges         True if pixels without edges of features are left out
    ends_round       True if the samples of the beauty since the last batch that ended a round are spread over
                     the whole time
    """

    time: float
    kind: str
    samples: int
    first: int = 0
    choice: tuple[int, int] = (0, 1)
    at_edges: bool = False
    ends_round: bool = False


def affordable_motion_samples(quality: Quality, vertices: int) -> int:
    """Return how many motion samples take 1.5 times as long to build as the frame's samples take to trace.

    vertices  of the subject
    """
    sampling = 1.5 * quality.samples * quality.width * quality.height * _SAMPLE_SECONDS
    return int(sampling / (_SCENE_SECONDS + vertices * _VERTEX_SECONDS))


def motion_sample_count(motion: float, samples: int, affordable: int) -> int:
    """Return how many motion samples our path tracer takes.

    motion      pixels that the fastest point moves
    samples     samples per pixel
    affordable  most of them, if there are more than samples or MAX_MOTION_SAMPLES

    The fewest that keep steps within MAX_STEP, of the counts that divide the samples; then within
    MAX_CHOSEN_STEP, of the samples times a power of two; the largest such count where none is enough.
    """
    most = max(affordable, min(samples, MAX_MOTION_SAMPLES))
    divisors = [(n, MAX_STEP) for n in range(1, samples + 1) if samples % n == 0]
    multiples = [(samples << n, MAX_CHOSEN_STEP) for n in range(1, most.bit_length())]
    counts = [(n, step) for n, step in divisors + multiples if n <= most]
    return next((n for n, step in counts if n * step >= motion), counts[-1][0])


def multijitter_motion_samples(motion: float, samples: int) -> int:
    """Return how many motion samples a frame takes with multijitter.

    motion   pixels that its fastest point moves
    samples  samples per pixel

    The fewest that keep steps within MAX_STEP, of the counts that divide the samples equally into batches
    that are not tiny; the largest such count where none is enough.
    """
    least = MIN_SAMPLES if samples >= 2 * MIN_SAMPLES else 1
    divisors = [n for n in range(1, min(MAX_MOTION_SAMPLES, samples // least) + 1) if samples % n == 0]
    possible = [n for n in divisors if n == 1 or _even_divisor(samples // n) >= least]
    return next((n for n in possible if n * MAX_STEP >= motion), possible[-1])


@dataclass(frozen=True)
class Round:
    """Samples of the beauty, spread over the whole time of the shutter.

    samples    for each pixel
    times      of the motion samples, in rising order
    is_chosen  True if a pixel with fewer samples than there are motion samples chooses among them
    """

    samples: int
    times: list[float]
    is_chosen: bool


def round_sizes(samples: int, most: int) -> list[int]:
    """Return the samples of the rounds after which tiles may stop: 4, 4, 8, and so on to `most`, as many as
    in all rounds before.

    Our sampler is most even after powers of two.
    """
    sizes: list[int] = []
    while (left := samples - sum(sizes)) > 0:
        sizes.append(min(left, most, max(FIRST_ROUND, sum(sizes))))
    return sizes


def traced_rounds(quality: Quality, motion: float, affordable: int, seed: int) -> list[Round]:
    """Return the rounds of a frame for our path tracer.

    motion      pixels that the fastest point moves
    affordable  motion samples, as `affordable_motion_samples`
    seed        of the frame, for the times of motion samples that are further apart than MAX_STEP

    Each round of adaptive sampling is spread over the whole time. Their times interleave, so a round alone
    may have longer steps. Without motion there are rounds for edges, which take up to twice the samples.
    """
    if quality.noise_threshold is None:
        count = motion_sample_count(motion, quality.samples, affordable)
        return [Round(quality.samples, _times(count, motion, seed), is_chosen=True)]
    sizes = round_sizes(quality.samples, MOVING_ROUND if motion > MAX_STEP else STILL_ROUND)
    if motion <= MAX_STEP and quality.is_adaptive:
        sizes += [min(STILL_ROUND, quality.samples - n) for n in range(0, quality.samples, STILL_ROUND)]
    needed = max(motion / 4.0, min(motion / 2.0, 8.0))
    rounds = []
    for index, size in enumerate(sizes):
        count = motion_sample_count(needed, size, affordable // len(sizes))
        phase = (seed_of(seed, "phase") / 2**32 + _van_der_corput(index)) % 1.0 if motion > MAX_STEP else 0.5
        rounds.append(Round(size, [(i + phase) / count for i in range(count)], is_chosen=True))
    return rounds


def multijitter_rounds(quality: Quality, motion: float) -> list[Round]:
    """Return the rounds of a frame for Mitsuba's multijitter: at the same times each, in even batches."""
    count = multijitter_motion_samples(motion, quality.samples)
    times = _middles(count)
    if quality.noise_threshold is None:
        return [Round(quality.samples, times, is_chosen=False)]
    share = -(-quality.samples // count)
    size = min(share, BATCH_SAMPLES) if count == 1 else _even_divisor(share)
    least = max(MIN_SAMPLES, -(-BATCH_SAMPLES // count))
    size = min((n for n in EVEN_COUNTS if size % n == 0 and n >= least), default=size)
    return [Round(size * count, times, is_chosen=False)] * (share // size)


def batch_schedule(quality: Quality, rounds: Sequence[Round]) -> list[SampleBatch]:
    """Return the batches of a frame in order: round by round, in each by time.

    Auxiliary samples are taken in the first round. With motion and adaptive sampling by tiles, those beyond
    FIRST_MOVING_AUXILIARY are taken in the second.
    """
    batches: list[SampleBatch] = []
    first = 0
    auxiliary = _auxiliary_batches(quality, rounds)
    for index, part in enumerate(rounds):
        beauty = _spread("beauty", part, part.samples, first)
        ordered = sorted(
            [*beauty, *(auxiliary[index] if index < len(auxiliary) else [])], key=attrgetter("time", "kind")
        )
        if quality.noise_threshold is not None:
            ordered[-1] = replace(ordered[-1], ends_round=True)
        batches += ordered
        first += part.samples
    return batches


def _auxiliary_batches(quality: Quality, rounds: Sequence[Round]) -> list[list[SampleBatch]]:
    """Return the batches of auxiliary samples of the first round, and of the second if it has any."""
    whole, first = quality.auxiliary_samples, rounds[0]
    if first.is_chosen and len({time for each in rounds for time in each.times}) == 1:
        cuts = [0, *(n for n in (FIRST_AUXILIARY, BATCH_SAMPLES) if n < whole), whole]
        parts = [_spread("auxiliary", first, end - start, start) for start, end in pairwise(cuts)]
        return [[*parts[0], *_at_edges(batch for part in parts[1:] for batch in part)]]
    if not first.is_chosen or quality.noise_threshold is None or len(rounds) < 2:
        return [_spread("auxiliary", first, whole)]
    batches = _spread("auxiliary", first, min(whole, FIRST_MOVING_AUXILIARY))
    taken = max(batch.first + batch.samples for batch in batches)
    if taken >= whole:
        return [batches]
    return [batches, _at_edges(_spread("auxiliary", rounds[1], whole - taken, taken))]


def _at_edges(batches: Iterable[SampleBatch]) -> list[SampleBatch]:
    return [replace(batch, at_edges=True) for batch in batches]


def _middles(count: int) -> list[float]:
    return [(i + 0.5) / count for i in range(count)]


def _times(count: int, motion: float, seed: int) -> list[float]:
    """Return the middles of equal parts or random times in them if they are far apart."""
    if motion <= MAX_STEP * count:
        return _middles(count)
    return [(i + seed_of(seed, "time", i) / 2**32) / count for i in range(count)]


def _van_der_corput(index: int) -> float:
    """Return 0, 1/2, 1/4, 3/4 and so on: each number is far from those before."""
    return int(f"{index:032b}"[::-1], 2) / 2**32


def _spread(kind: str, part: Round, samples: int, first: int = 0) -> list[SampleBatch]:
    """Return batches of `samples` samples, spread over the motion samples of a round.

    With fewer samples than motion samples, pixels choose among them. Else samples that do not divide are
    rounded up.
    """
    times, count = part.times, len(part.times)
    if samples < count and part.is_chosen:
        strata = [i * samples // count for i in range(count)]
        choices = [(i - strata.index(stratum), strata.count(stratum)) for i, stratum in enumerate(strata)]
        return [
            SampleBatch(time, kind, 1, first + stratum, choice)
            for time, stratum, choice in zip(times, strata, choices, strict=True)
        ]
    share = -(-samples // count)
    size = min(share, BATCH_SAMPLES) if count == 1 else _even_divisor(share)
    return [
        SampleBatch(time, kind, size, first + i * share + part_index * size)
        for i, time in enumerate(times)
        for part_index in range(share // size)
    ]


def chosen_pixels(quality: Quality, batch: SampleBatch, seed: int, pixels: PixelNumbers) -> PixelNumbers:
    """Return those of `pixels` that choose the batch's motion sample.

    A pixel's choice depends on its place in the whole picture, on the stratum and on the seed.
    """
    member, members = batch.choice
    if members == 1:
        return pixels
    left, top = (quality.crop or (0, 0))[:2]
    rows, columns = np.divmod(pixels, quality.rendered_size[0])
    places = ((rows + top) * quality.width + columns + left).astype(np.uint64)
    mixed = places + np.uint64(seed_of(seed, "choice", batch.first) << 32)
    for shift, factor in _MIXING:
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    choice = ((mixed >> np.uint64(40)) * np.uint64(members)) >> np.uint64(24)
    return np.asarray(pixels[choice == member])


def _even_divisor(samples: int) -> int:
    return max(n for n in EVEN_COUNTS if samples % n == 0)
