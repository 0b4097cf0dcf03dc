"""Fits of a path that carries one closed surface onto another: correspondences, from coarse to fine.

Nobody knows which point goes where. A fit finds out as iterative closest points do (Besl, McKay, *A method
for registration of 3-D shapes*, PAMI 14, 1992), with planes in place of points (Chen, Medioni, *Object
modelling by registration of multiple range images*, Image and Vision Computing 10, 1992): it takes the
nearest point for granted, fits a path, and looks again. Nearest points are right only where the surfaces are
near each other, so the target grows (ours):

1. The surface is fitted to the ball in the target's thickest place.
2. That part grows through the target, step by step: to all that is at most u away from there, through the
   solid. Limbs leave the body at their tips, as thick as they will be, and what is between them is never
   filled, so that no web has to be torn. Every step begins with the path of the one before, all of which
   changes: at its end nothing of the growth is seen, and the path is near the shortest one.
3. Rounds on finer grids, with both surfaces whole.

In 2 and 3 half of the data are points of the surface, each with the nearest plane of the target, and half are
points of the target, each with the nearest point of the carried surface in position and normal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points
from pipeline.plugins.become import fit_kernels as kernels
from pipeline.plugins.become.target import FittedSurface, SolidGrowth, lengths
from pipeline.plugins.become.velocity_path import Data, PathSpace, carried, energy, minimised, padded

Detail = Literal["coarse", "medium", "fine"]


class FitRound(NamedTuple):
    """A round of a fit.

    space    of the path
    weight   λ
    samples  points of each surface that are fitted
    edge     the longest edge of the carried surface
    until    u to which the target has grown; None where it is whole
    begins   True where only the ball in the thickest place is fitted
    along    weight of distances along planes over those across
    """

    space: PathSpace
    weight: float
    samples: int
    edge: float
    until: float | None = None
    begins: bool = False
    along: float = 0.05


ITERATIONS, GROWING, BEGINNING = 20, 9, 30
"""Of L-BFGS in a round of whole surfaces, of growth, and of the beginning."""

START = PathSpace(16, 0.08)
"""The space of the first rounds."""

STEP = 0.04
"""How far the target grows at once, in sides of the cube."""

NORMAL = 0.045
"""The distance, in diagonals of the target, that counts as much as normals that differ by one radian."""

_FINISH: Mapping[Detail, tuple[tuple[int, float, float, int, float], ...]] = {
    "coarse": ((24, 0.05, 1e-5, 4000, 0.02), (32, 0.04, 1e-6, 5000, 0.016)),
    "medium": (
        (24, 0.05, 1e-5, 4000, 0.02),
        (40, 0.04, 1e-6, 6000, 0.014),
        (40, 0.03, 3e-7, 7000, 0.011),
        (48, 0.026, 1e-7, 8000, 0.009),
        (48, 0.024, 1e-7, 9000, 0.008),
    ),
    "fine": (
        (24, 0.05, 1e-5, 4000, 0.02),
        (40, 0.04, 1e-6, 6000, 0.014),
        (40, 0.03, 3e-7, 7000, 0.011),
        (48, 0.026, 1e-7, 8000, 0.009),
        (64, 0.022, 1e-7, 12_000, 0.007),
        (64, 0.02, 3e-8, 14_000, 0.006),
        (64, 0.018, 3e-8, 16_000, 0.006),
        (64, 0.016, 1e-8, 16_000, 0.006),
    ),
}
"""Cells, ℓ, λ, samples and longest edge of the last rounds."""


def rounds_of(growth: SolidGrowth, detail: Detail) -> list[FitRound]:
    """Return the rounds of a fit to a target."""
    coarse = PathSpace(24, 0.06)
    first = [FitRound(START, weight, 6000, 0.03, growth.start, True) for weight in (1e-2, 1e-3, 1e-4)]
    steps = int(np.ceil((growth.end - growth.start) / STEP))
    grown = np.linspace(growth.start, growth.end, steps + 1)[1:].tolist()
    growing = [FitRound(coarse, 1e-5, 6000, 0.03, until, along=0.1) for until in grown for _ in range(2)]
    finish = [
        FitRound(PathSpace(n, length), weight, samples, edge)
        for n, length, weight, samples, edge in _FINISH[detail]
    ]
    return [*first, *growing, *finish]


@dataclass(frozen=True)
class State:
    """What a round begins with.

    done    number of rounds before it
    space   of the path
    z       the path
    rest    the surface, with more vertices where it is stretched
    """

    done: int
    space: PathSpace
    z: Floats
    rest: FittedSurface

    @classmethod
    def at_rest(cls, surface: FittedSurface) -> State:
        return cls(0, START, np.zeros(START.size), surface)

    def carry(self, points: Points) -> Points:
        """Return where the path carries points (P, 3)."""
        return carried(padded(self.space.knots(self.z)), self.space.n, points)


MOST_VERTICES = 16_000
"""Vertices of a carried surface up to which more are added."""


def next_round(state: State, one: FitRound, target: FittedSurface, growth: SolidGrowth) -> State:
    """Return the state after a round."""
    state = _refined(replace(state, z=state.space.converted(state.z, one.space), space=one.space), one.edge)
    x, faces = state.carry(state.rest.points), state.rest.faces
    now = FittedSurface(x, faces)
    normals, areas = now.vertex_normals
    some = _spread(len(x), one.samples)
    share = areas[some] / areas[some].sum()
    data: Data
    if one.begins:
        assert one.until is not None
        data, points, iterations = Front(growth, one.until, share), state.rest.points[some], BEGINNING
    else:
        if one.until is None:
            (places, facing), there, iterations = (
                target.nearest(x[some]),
                target.samples(one.samples),
                ITERATIONS,
            )
        else:
            places, facing = growth.places(x[some], normals[some], one.until)
            samples, sample_normals = target.samples(one.samples // 2)
            grown = growth.reached(samples) <= one.until
            there, iterations = (samples[grown], sample_normals[grown]), GROWING
        scale = NORMAL * target.diagonal
        here = _nearest(np.hstack([x, scale * normals]), np.hstack([there[0], scale * there[1]]))
        even = np.full(len(here), 1.0 / len(here))
        points = state.rest.points[np.concatenate([some, here])]
        onto = Planes(places, facing, share, 0.3 * one.along)
        data = joined((0.5, onto, len(some)), (0.5, Planes(*there, even, one.along), len(here)))
    z = minimised(lambda z: energy(one.space, z, points, data, one.weight), state.z, iterations)
    return replace(state, z=z, done=state.done + 1)


def _spread(count: int, most: int) -> AnyArray:
    """Return at most `most` of the numbers below `count`, evenly."""
    return np.arange(count) if count <= most else np.arange(most) * count // most


def _nearest(rows: Floats, queries: Floats) -> AnyArray:
    """Return the index of the nearest of rows (R, 6) to each of queries (Q, 6)."""
    order = np.argsort(rows[:, 0], kind="stable")
    found = np.empty(len(queries), np.int64)
    kernels.nearest_rows(np.ascontiguousarray(rows[order]), np.ascontiguousarray(queries), found)
    return order[found]


def _refined(state: State, longest: float) -> State:
    """Return the state with edges cut in two that are longer than `longest` where they are carried to.

    Faces on both sides of an edge are not cut together: the vertices are samples.
    """
    points, faces = state.rest.points, state.rest.faces
    now = state.carry(points)
    for _ in range(6):
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
        edges = lengths((now[ends[..., 0]] - now[ends[..., 1]]).reshape(-1, 3)).reshape(-1, 3)
        side = np.argmax(edges, axis=1)
        rows = np.flatnonzero(edges[np.arange(len(faces)), side] > longest)
        pairs, middles = np.unique(np.sort(ends[rows, side[rows]], axis=1), axis=0, return_inverse=True)
        if not len(rows) or len(points) + len(pairs) > MOST_VERTICES:
            break
        a, b, c = (faces[rows, (side[rows] + k) % 3] for k in range(3))
        middle, faces = len(points) + middles.ravel(), faces.copy()
        faces[rows] = np.stack([a, middle, c], axis=1)
        faces = np.concatenate([faces, np.stack([middle, b, c], axis=1)])
        added = 0.5 * (points[pairs[:, 0]] + points[pairs[:, 1]])
        points, now = np.concatenate([points, added]), np.concatenate([now, state.carry(added)])
    return replace(state, rest=FittedSurface(points, faces))


@dataclass(frozen=True)
class Planes:
    """Where points should be: on planes through `points` (P, 3) with `normals`, and a little at the points.

    weights  (P,), which add up to 1
    along    weight of squared distances along the plane over those across
    """

    points: Points
    normals: Points
    weights: Floats
    along: float

    def __call__(self, x: Points) -> tuple[float, Floats]:
        away = x - self.points
        across = np.einsum("ij,ij->i", away, self.normals)
        squares = (1.0 - self.along) * across**2 + self.along * np.einsum("ij,ij->i", away, away)
        force = (1.0 - self.along) * across[:, None] * self.normals + self.along * away
        return float(np.sum(self.weights * squares)), 2.0 * self.weights[:, None] * force


@dataclass(frozen=True)
class Front:
    """Points should be on the surface of what has grown until some u. weights: (P,), which add up to 1."""

    growth: SolidGrowth
    until: float
    weights: Floats

    def __call__(self, x: Points) -> tuple[float, Floats]:
        distance, gradient = self.growth.residual(x, self.until)
        force = 2.0 * (self.weights * distance)[:, None] * gradient
        return float(np.sum(self.weights * distance**2)), force


def joined(*terms: tuple[float, Data, int]) -> Data:
    """Return the sum of data, each with a factor and how many of the points are its own, in order."""

    def data(x: Points) -> tuple[float, Floats]:
        total, force, first = 0.0, np.empty_like(x), 0
        for factor, term, count in terms:
            value, part = term(x[first : first + count])
            total += factor * value
            force[first : first + count] = factor * part
            first += count
        return total, force

    return data


class Residual(NamedTuple):
    """Distances between a carried surface and its target, over the target's diagonal.

    mean, most    from the carried surface to the target, by area; `most` is 95 % of it within
    back, far     from the target to the carried surface
    least         the least determinant of the mapping's gradient on the surface
    """

    mean: float
    most: float
    back: float
    far: float
    least: float

    @property
    def worst(self) -> float:
        """The larger of both 95 %."""
        return max(self.most, self.far)


Watch = Callable[[State, int], None]
"""Called after each round with the state and the number of all rounds."""


def fitted(
    rest: FittedSurface, target: FittedSurface, detail: Detail, state: State | None, watch: Watch
) -> State:
    """Return the state after all rounds of a fit that carries one surface onto another.

    rest, target  closed surfaces of one part and the same genus, in the unit cube, away from its sides
    state         that of an earlier call, to go on from; None to begin
    """
    growth = SolidGrowth.of(target)
    rounds = rounds_of(growth, detail)
    state = State.at_rest(rest) if state is None else state
    for one in rounds[state.done :]:
        state = next_round(state, one, target, growth)
        watch(state, len(rounds))
    return state
