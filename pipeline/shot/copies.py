"""Copies of a subject: where they are in the first frame, how each is turned, and how large it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.flow.regions import Region
from flowsculpt.pipeline.mesh.placed_copies import Placements, nearest_rotations
from flowsculpt.render.base.plural import plural
from flowsculpt.render.base.serialise import NOT_PLAIN, OMIT_DEFAULT

MOST_COPIES = 5000

GAP = 1.02
"""Distance between the middles of two copies, in sums of their radii, at least: at rest they do not touch."""

TRIES, MIN_TRIES, MAX_TRIES = 200, 20_480, 200_000
"""Places that are tried for each copy, and for all of them at least and at most."""

BATCH = 512
"""Places that are tried together."""

_SIDES = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z])
DIRECTIONS: Floats = _SIDES / np.linalg.norm(_SIDES, axis=1, keepdims=True)
"""(26, 3): the points of a copy's bounding sphere that must lie in the region."""

Turn = Literal["none", "upright", "random"]


@dataclass(frozen=True)
class OrderedPlaces:
    """Places in an order, each with axes of its own: x ahead or outwards, y up.

    digest  of all that decides them
    places  `places(count, seed)`: places (count, 3), and the rotation (count, 3, 3) of each
    """

    digest: str
    places: Callable[[int, int], tuple[Points, Floats]] = field(metadata=NOT_PLAIN, compare=False)


@dataclass(frozen=True)
class Copies:
    """The number of copies of a subject, and their places.

    seed    another one scatters the copies differently
    region  holds the bounding spheres of all copies in the first frame; None where a layout places them
    rigid   True keeps their shape: the flow carries and turns each as a whole
    size    the smallest and the largest, in sizes of the subject, evenly by their ratios
    turn    "upright" turns each about its own y axis at random, "random" in any way
    """

    count: int
    seed: int
    region: Region | None = field(metadata=NOT_PLAIN)
    layout: OrderedPlaces | None = field(default=None, metadata=OMIT_DEFAULT)
    rigid: bool = field(default=False, metadata=OMIT_DEFAULT)
    size: tuple[float, float] = field(default=(1.0, 1.0), metadata=OMIT_DEFAULT)
    turn: Turn = field(default="none", metadata=OMIT_DEFAULT)

    def placements(self, middle: Points, radius: float) -> Placements:
        """Return the placements of the copies of a surface within `radius` of its middle (3,).

        Raises UsageError where they find no room, or where copies that are not rigid touch.
        """
        sizes = self._sizes()
        if self.layout is None:
            middles, turns = self.middles(radius), np.tile(np.eye(3), (self.count, 1, 1))
        else:
            middles, turns = self.layout.places(self.count, self.seed)
            if not self.rigid:
                self._require_apart(middles, radius * sizes)
        if self.turn != "none":
            turns = turns @ self._random_turns()
        linear = turns * sizes[:, None, None]
        return Placements.of(middles - (linear @ middle), turns, sizes)

    def middles(self, radius: float) -> Points:
        """Return the middles (count, 3) of spheres in the region, none of which touch.

        radius  of the spheres of copies of size 1

        Places are tried at random in the box around the region (dart throwing: Cook, *Stochastic sampling in
        computer graphics*, 1986). Raises UsageError where fewer than `count` find room.
        """
        radii, found, number = radius * self._sizes(), np.empty((self.count, 3)), 0
        for places in self._places(float(radii.max())):
            if number:
                least = GAP * (radii[:number] + radii[number:].min())
                places = _without_near(places, found[:number], least)
            for place in places:
                least = GAP * (radii[:number] + radii[number])
                if not number or (np.linalg.norm(found[:number] - place, axis=1) > least).all():
                    found[number] = place
                    number += 1
                if number == self.count:
                    return found
        room = plural(number, "copy", "copies") if number else "no copy"
        raise UsageError(
            f"the region has room for {room} of this subject, and count is {self.count}; copies lie whole in "
            f"the region, and their bounding spheres of radius {radii.max():.3g} do not touch. Enlarge the "
            f"region, or make the subject smaller{', or lower count' if number else ''}."
        )

    def _places(self, radius: float) -> Iterator[Points]:
        """Yield places (N, 3) at random around which a sphere lies in the region; the same ones each time."""
        assert self.region is not None, "a layout has places of its own"
        random = np.random.default_rng(self.seed)
        centre, half = (np.array(side) for side in self.region.bounds(0.0))
        for _ in range(max(MIN_TRIES, min(TRIES * self.count, MAX_TRIES)) // BATCH):
            places = centre + half * random.uniform(-1.0, 1.0, (BATCH, 3))
            ends = (places[:, None] + radius * DIRECTIONS).reshape(-1, 3)
            inside = (self.region.weight(ends, 0.0) == 1.0).reshape(-1, len(DIRECTIONS)).all(axis=1)
            yield places[inside]

    def _require_apart(self, middles: Points, radii: Floats) -> None:
        """Raise UsageError where the bounding spheres of two copies touch."""
        for number in range(1, self.count):
            away = np.linalg.norm(middles[:number] - middles[number], axis=1)
            touching = np.flatnonzero(away <= radii[:number] + radii[number])
            if len(touching):
                raise UsageError(
                    f"copies {touching[0] + 1} and {number + 1} touch; those of a shape that deforms lie "
                    "apart, by their bounding spheres. Write rigid: true, or lower size or count."
                )

    def _sizes(self) -> Floats:
        """Return the size (count,) of each copy."""
        low, high = self.size
        if low == high:
            return np.full(self.count, low)
        return low * (high / low) ** np.random.default_rng([self.seed, 1]).random(self.count)

    def _random_turns(self) -> Floats:
        """Return a rotation (count, 3, 3) for each copy, all equally likely."""
        random = np.random.default_rng([self.seed, 2])
        if self.turn == "random":  # a normal distribution has no direction
            return nearest_rotations(random.standard_normal((self.count, 3, 3)))
        angles = 2.0 * math.pi * random.random(self.count)
        c, s, zero, one = np.cos(angles), np.sin(angles), np.zeros(self.count), np.ones(self.count)
        return np.moveaxis(np.array([[c, zero, s], [zero, one, zero], [-s, zero, c]]), 2, 0)


def _without_near(places: Points, found: Points, least: Floats) -> Points:
    """Return places (N, 3) without most of those nearer to a found one (M, 3) than `least` (M,).

    Products of matrices are so small that they start no threads, which took most of the time.
    """
    sums, twice = (found**2).sum(axis=1) - (0.999 * least) ** 2, -2.0 * found.T
    size = 1 + 80_000 // len(found)
    blocks = [places[start : start + size] for start in range(0, len(places), size)]
    return np.concatenate(
        [places[:0], *(part[(part @ twice + sums).min(axis=1) > -(part**2).sum(axis=1)] for part in blocks)]
    )


def bounding_sphere(points: Points) -> tuple[Points, float]:
    """Return the middle (3,) of the bounds of points (V, 3), and the radius of the sphere around it."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle, float(np.linalg.norm(points - middle, axis=1).max())
