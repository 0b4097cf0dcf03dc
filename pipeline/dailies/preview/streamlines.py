"""The ways of points through the flow of a moment: its streamlines, around what it moves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Floats, Points, Vectors
from pipeline.flow import checked_displacement
from pipeline.shot import Motion

STEP = 1 / 16
"""Frames over which points are moved to find how fast they go: so do maps, which have no velocity."""

SEEDS, PIECES = 420, 48
AROUND = 1.35
"""How far ways begin from the middle of the subject, over its half-size."""

LONG = 0.6
"""How far ways of ordinary speed go, over the subject's half-size; none goes FASTEST times as far."""
FASTEST = 2.5

STILL = 0.02
"""Below that share of the usual speed of the fast points nothing is drawn."""


class StreamlineSet(NamedTuple):
    """points (N, PIECES + 1, 3), and how fast they go there (N, PIECES + 1), units per second."""

    points: Floats
    speeds: Floats


def streamlines(motion: Motion, frame: int, around: Points, seeds: int = SEEDS) -> StreamlineSet:
    """Streamlines of all flows of a motion together, as they are at a frame, about points (V, 3).

    The flow is held still while they are drawn. Raises FrameError where the flow fails there.
    """
    low, high = around.min(axis=0), around.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.15 * float((high - low).max()))
    begin = middle + AROUND * half * (2.0 * _spread(seeds) - 1.0)
    speeds = np.linalg.norm(_velocity(motion, frame, begin), axis=1)
    fast = float(np.quantile(speeds, 0.95))
    begin = begin[speeds > STILL * fast]
    if not len(begin) or fast == 0.0:
        return StreamlineSet(np.empty((0, PIECES + 1, 3)), np.empty((0, PIECES + 1)))
    usual = float(np.median(speeds[speeds > STILL * fast]))
    step = LONG * float(half.max()) / usual / PIECES
    forth, back = (_followed(motion, frame, begin, side * step, FASTEST * usual) for side in (1, -1))
    points = np.concatenate([back[:0:-1], forth]).swapaxes(0, 1)
    points = points[np.isfinite(points).all(axis=(1, 2))]
    speeds = np.linalg.norm(np.diff(points, axis=1), axis=2) / step
    return StreamlineSet(points, np.concatenate([speeds[:, :1], speeds], axis=1))


def _velocity(motion: Motion, frame: int, points: Points) -> Vectors:
    """(N, 3) units per second of the film's time."""
    time, dt = motion.clock.between(frame, frame + STEP)
    moved = checked_displacement(motion.flow, points, time, dt, frame)
    found: Vectors = (moved - points) / motion.rate.seconds(STEP)
    return found


def _followed(motion: Motion, frame: int, points: Points, step: float, limit: float) -> Floats:
    """(PIECES / 2 + 1, N, 3): by the midpoint method; what is faster than the limit is held back to it."""
    places = [points]
    for _ in range(PIECES // 2):
        here = places[-1]
        there = here + step / 2 * _held(_velocity(motion, frame, here), limit)
        places.append(here + step * _held(_velocity(motion, frame, there), limit))
    return np.stack(places)


def _held(velocity: Vectors, limit: float) -> Vectors:
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    held: Vectors = velocity * np.minimum(1.0, limit / np.maximum(speed, 1e-300))
    return held


def _spread(count: int) -> Floats:
    """(N, 3) evenly in a unit cube without rows: the additive recurrence of Roberts (2018)."""
    root = 1.2207440846057596  # of x⁴ = x + 1
    steps = root ** -np.arange(1.0, 4.0)
    spread: Floats = (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
    return spread
