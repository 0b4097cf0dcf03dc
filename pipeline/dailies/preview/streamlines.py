"""StreamlineSet of a shot's flow at one frame, around its subject."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Floats, Points, Vectors
from pipeline.flow import checked_displacement
from pipeline.shot import Motion

STEP = 1 / 16
"""Frames over which points are moved to measure velocity, which flows that are maps do not have."""

SEEDS, PIECES = 420, 48
AROUND = 1.35
"""Half-size of the box where streamlines begin, over that of the subject."""

LONG = 0.6
"""Length of streamlines of median speed, over the subject's half-size; none is FASTEST times as long."""
FASTEST = 2.5

STILL = 0.02
"""Fraction of the 95th percentile of speed below which no streamline begins."""


class StreamlineSet(NamedTuple):
    """N polylines: points (N, PIECES + 1, 3) and speeds (N, PIECES + 1), units per second."""

    points: Floats
    speeds: Floats


def streamlines(motion: Motion, frame: int, around: Points, seeds: int = SEEDS) -> StreamlineSet:
    """Trace streamlines of all flows of a shot together, held still at a frame, around points (V, 3).

    Raises FrameError where the flow fails.
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
    forth, back = (_traced(motion, frame, begin, side * step, FASTEST * usual) for side in (1, -1))
    points = np.concatenate([back[:0:-1], forth]).swapaxes(0, 1)
    points = points[np.isfinite(points).all(axis=(1, 2))]
    speeds = np.linalg.norm(np.diff(points, axis=1), axis=2) / step
    return StreamlineSet(points, np.concatenate([speeds[:, :1], speeds], axis=1))


def _velocity(motion: Motion, frame: int, points: Points) -> Vectors:
    """Return velocities (N, 3), units per second of the film's time."""
    time, dt = motion.clock.between(frame, frame + STEP)
    moved = checked_displacement(motion.flow, points, time, dt, frame)
    found: Vectors = (moved - points) / motion.rate.seconds(STEP)
    return found


def _traced(motion: Motion, frame: int, points: Points, step: float, limit: float) -> Floats:
    """Trace points by the midpoint method at most at speed `limit`; returns (PIECES / 2 + 1, N, 3)."""
    places = [points]
    for _ in range(PIECES // 2):
        start = places[-1]
        middle = start + step / 2 * _clipped(_velocity(motion, frame, start), limit)
        places.append(start + step * _clipped(_velocity(motion, frame, middle), limit))
    return np.stack(places)


def _clipped(velocity: Vectors, limit: float) -> Vectors:
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    clipped: Vectors = velocity * np.minimum(1.0, limit / np.maximum(speed, 1e-300))
    return clipped


def _spread(count: int) -> Floats:
    """Return points (N, 3) spread evenly over the unit cube: the additive recurrence of Roberts (2018)."""
    root = 1.2207440846057596  # of x⁴ = x + 1
    steps = root ** -np.arange(1.0, 4.0)
    spread: Floats = (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
    return spread
