"""What surfaces and lines from seeds measure: of the flow, and of the way of their points through it.

Points of paths keep their places, and what they measure is that of the time when they were there. Points of
streaks measure what is where they are now, those of streamlines what is there in the frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from flowsculpt import VelocityField
from flowsculpt.api.meshes import Floats

NAMES = {
    "speed": ("speed", "units/s"),
    "vorticity": ("vorticity", "1/s"),
    "age": ("age", "s"),
    "stretching": ("stretching", ""),
    "ftle": ("finite-time Lyapunov exponent", "1/s"),
}
"""What is measured by name: what legends call it, and its unit.

vorticity   length of the curl of the velocities
age         since a point was released; below 0 backwards
stretching  largest factor by which a short length at the seed has become longer at the point
ftle        logarithm of the stretching over the age (G. Haller, *Physica D* 149, 2001)
"""

KNOTS = 96
"""Times between which velocities that change are interpolated, where points have times of their own."""

YOUNG = 1e-9
"""Seconds up to which the exponent is that of the velocity gradient, which it tends to."""

_APART = 1e-4  # points that are compared, in longest edges


class Parcels(NamedTuple):
    """Points at which something is measured.

    points  (N, 3)
    seeds   (N, 3) where they were released
    ages    (N,) seconds that they have travelled, below 0 backwards
    times   (N,) seconds when they are at `points`
    rows    (V,) which of them each vertex of the mesh shows
    """

    points: Floats
    seeds: Floats
    ages: Floats
    times: Floats
    rows: np.ndarray


class Displaces(Protocol):
    """What has released parcels."""

    def parcels(self) -> Parcels: ...

    def displaced(self, seeds: Floats, ages: Floats) -> Floats: ...


@dataclass(frozen=True, eq=False)
class StreamValues:
    """What is measured.

    of       one of NAMES, or the name of a variable
    label    what legends call it
    unit     of its numbers
    longest  edge of the surface, units; short lengths are a part of it
    numbers  of a variable, the field whose z is 1 inside the grid, y the fraction that is known, and x this
             times the value
    least_known  of that fraction, for a point to have a value
    factor   on what is measured in units and seconds of the shot
    """

    of: str
    label: str
    unit: str
    longest: float
    numbers: VelocityField | None = None
    least_known: float = 0.5
    factor: float = 1.0

    def at(self, parcels: Parcels, velocity: VelocityField, released: Displaces) -> Floats:
        """Return the values (N,) of points, NaN where there is none; `velocity` has moved them."""
        if self.numbers is not None:
            found = evaluated(self.numbers.velocity, parcels.points, parcels.times)
            return _known(found, self.least_known)
        measured = {
            "speed": self._speed,
            "vorticity": self._vorticity,
            "age": lambda parcels, _, __: parcels.ages,
            "stretching": lambda parcels, _, released: self._stretching(parcels, released),
            "ftle": self._exponent,
        }
        return self.factor * np.asarray(measured[self.of](parcels, velocity, released))

    def _speed(self, parcels: Parcels, velocity: VelocityField, _: Displaces) -> Floats:
        return np.linalg.norm(evaluated(velocity.velocity, parcels.points, parcels.times), axis=1)

    def _vorticity(self, parcels: Parcels, velocity: VelocityField, _: Displaces) -> Floats:
        slopes = self._gradients(velocity, parcels.points, parcels.times)
        turned = slopes - slopes.transpose(0, 2, 1)
        return np.linalg.norm(turned[:, [2, 0, 1], [1, 2, 0]], axis=1)

    def _stretching(self, parcels: Parcels, released: Displaces) -> Floats:
        apart, count = _APART * self.longest, len(parcels.points)
        steps = apart * np.concatenate([np.eye(3), -np.eye(3)])
        seeds = (parcels.seeds[None] + steps[:, None]).reshape(-1, 3)
        ends = released.displaced(seeds, np.tile(parcels.ages, 6)).reshape(6, count, 3)
        gradients = ((ends[:3] - ends[3:]) / (2.0 * apart)).transpose(1, 2, 0)
        return np.asarray(np.linalg.svd(gradients, compute_uv=False)[:, 0])

    def _exponent(self, parcels: Parcels, velocity: VelocityField, released: Displaces) -> Floats:
        young = np.abs(parcels.ages) <= YOUNG
        found = np.log(self._stretching(parcels, released)) / np.where(young, 1.0, np.abs(parcels.ages))
        if young.any():
            slopes = self._gradients(velocity, parcels.points[young], parcels.times[young])
            rates = np.linalg.eigvalsh(0.5 * (slopes + slopes.transpose(0, 2, 1)))
            found[young] = np.abs(rates).max(axis=1)
        return found

    def _gradients(self, velocity: VelocityField, points: Floats, times: Floats) -> Floats:
        """Return derivatives (N, 3, 3): row i has those of component i along x, y and z."""
        apart = _APART * self.longest
        sides = [
            evaluated(velocity.velocity, points + sign * apart * axis, times)
            for axis in np.eye(3)
            for sign in (1, -1)
        ]
        return np.stack([(sides[2 * k] - sides[2 * k + 1]) / (2.0 * apart) for k in range(3)], axis=2)


def _known(found: Floats, least: float) -> Floats:
    """Return values (N,) of what `StreamValues.numbers` is at points, (N, 3); NaN where they are missing."""
    summed, known, inside = found.T
    there = known > least * np.maximum(inside, 1e-300)
    return np.where(there, summed / np.where(there, known, 1.0), np.nan)


def evaluated(velocity: Callable[[Floats, float], Floats], points: Floats, times: Floats) -> Floats:
    """Return vectors (N, 3) at points (N, 3) and times (N,), between KNOTS times by straight lines."""
    distinct = np.unique(times)
    if len(distinct) > KNOTS:
        distinct = np.linspace(distinct[0], distinct[-1], KNOTS)
    before = np.clip(np.searchsorted(distinct, times, side="right") - 1, 0, max(0, len(distinct) - 2))
    after = np.minimum(before + 1, len(distinct) - 1)
    length = distinct[after] - distinct[before]
    share = np.where(length > 0.0, (times - distinct[before]) / np.where(length > 0.0, length, 1.0), 0.0)
    out = np.zeros_like(points)
    for knot, time in enumerate(distinct.tolist()):
        for places, weight in ((before, 1.0 - share), (after, share)):
            rows = np.flatnonzero((places == knot) & (weight > 0.0))
            if len(rows):
                out[rows] += weight[rows, None] * velocity(points[rows], time)
    return out


@dataclass(eq=False)
class Measured:
    """What a growing surface has measured: points that stay where they are keep their values.

    values  what is measured
    keeps   True if points keep their places and times, as on paths
    """

    values: StreamValues
    keeps: bool
    _known: dict[bytes, float] = field(default_factory=dict)

    def of(self, released: Displaces, velocity: VelocityField) -> Floats:
        """Return the values (V,) of the vertices of the last mesh."""
        parcels = released.parcels()
        if not self.keeps:
            return self.values.at(parcels, velocity, released)[parcels.rows]
        names = [row.tobytes() for row in np.column_stack([parcels.seeds, parcels.ages])]
        new = np.array([n for n, name in enumerate(names) if name not in self._known], np.int64)
        if len(new):
            part = parcels._replace(**{n: getattr(parcels, n)[new] for n in parcels._fields if n != "rows"})
            found = self.values.at(part, velocity, released)
            self._known.update(zip((names[n] for n in new), found.tolist(), strict=True))
        return np.array([self._known[name] for name in names])[parcels.rows]
