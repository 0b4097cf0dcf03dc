"""Fits of paths that carry one closed surface onto another: correspondences, from coarse to fine.

Nobody knows which point goes where. A fit finds out as iterative closest points do (Besl, McKay, *A method
for registration of 3-D shapes*, PAMI 14, 1992), with planes in place of points (Chen, Medioni, *Object
modelling by registration of multiple range images*, Image and Vision Computing 10, 1992): it takes the
nearest point for granted, fits a path, and looks again. Nearest points are right only where the surfaces are
near each other, so the target grows (ours):

1. The surface is fitted to what is near the target's core: a thick place in its middle or, with holes, loops
   around them.
2. That part grows through the target, step by step: to all that is at most u away from there, through the
   solid. Limbs leave the body at their tips, as thick as they will be, and what is between them is never
   filled, so that no web has to be torn. A step is repeated until the surface has followed. Every step begins
   with the path of the one before, all of which changes: at its end nothing of the growth is seen.
3. Rounds on finer grids, with both surfaces whole.
4. Where parts are left that are thinner than a cell, a box around them with a grid of its own, in which they
   grow as in 2. Velocities fade to 0 at its sides.

In 2 and 3 half of the data are points of the surface, each with the nearest plane of the target, and half are
points of the target, each with the nearest point of the carried surface: in position, in normal, and in
distances through the solid from landmarks, which differ across a bay.

A long limb stretches the surface so much that a change where it begins moves its tip far, and a fit stalls.
So a long growth is a sequence of paths, legs: each begins with the surface as the one before has left it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.become import fit_kernels as kernels
from flowsculpt.pipeline.plugins.become.target import (
    PATCH,
    FittedSurface,
    GrownPart,
    SolidGrowth,
    SurfaceInBox,
    lengths,
    within_cube,
)
from flowsculpt.pipeline.plugins.become.velocity_path import (
    STEPS,
    Data,
    Pair,
    PathSpace,
    carried,
    carried_with_jacobians,
    energy,
    minimised,
    padded,
)

Detail = Literal["coarse", "medium", "fine"]


class FitRound(NamedTuple):
    """A round of a fit.

    space    of the path
    weight   λ
    samples  points of each surface that are fitted
    edge     the longest edge of the carried surface
    until    u to which the target has grown; None where it is whole
    begins   True where only what is near the core is fitted
    along    weight of distances along planes over those across
    is_leg   True where another leg begins
    """

    space: PathSpace
    weight: float
    samples: int
    edge: float
    until: float | None = None
    begins: bool = False
    along: float = 0.05
    is_leg: bool = False


ITERATIONS, GROWING, BEGINNING = 20, 10, 30
"""Of L-BFGS in a round of whole surfaces, in a pass of growth, and at the beginning."""

START = PathSpace(16, 0.08)
"""The space of the first rounds."""

GROWTH, THIN_GROWTH = PathSpace(32, 0.05), PathSpace(48, 0.035)
"""The spaces of growth: the second where much of the target is thinner than two cells of the first."""

THIN = 0.1
"""The share of a target that may be thinner than two cells."""

STEP = 0.04
"""How far the target grows at once, in sides of the cube."""

LEG = 0.2
"""How far it grows in one leg, about."""

LAG, PASSES = 0.01, 4
"""Distance, in sides of the cube, within which 98 % of the grown part must be reached, and passes at most."""

URGENT = 4.0
"""The weight at most, over that of others, of what is not reached yet."""

NORMAL = 0.045
"""The distance, in diagonals of the target, that counts as much as normals that differ by one radian."""

APART = 0.7
"""How much a difference of distances through the solid counts over a distance in space. Where much of a
target is thinner than two cells of THIN_GROWTH, its grid does not resolve them, and they count nothing."""

_FINISH: Mapping[Detail, tuple[tuple[int, float, float, int, float], ...]] = {
    "coarse": ((24, 0.05, 1e-5, 4000, 0.02), (32, 0.04, 1e-6, 5000, 0.016)),
    "medium": (
        (32, 0.05, 1e-5, 4000, 0.02),
        (40, 0.04, 1e-6, 6000, 0.014),
        (40, 0.03, 3e-7, 7000, 0.011),
        (48, 0.026, 1e-7, 8000, 0.009),
        (48, 0.024, 1e-7, 9000, 0.008),
    ),
    "fine": (
        (32, 0.05, 1e-5, 4000, 0.02),
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


def rounds_of(target: FittedSurface, detail: Detail) -> list[FitRound]:
    """Return the rounds of a fit to a target."""
    growth = target.growth
    first = [FitRound(START, weight, 6000, 0.03, growth.start, True) for weight in (1e-2, 1e-3, 1e-4)]
    space = THIN_GROWTH if target.thin_share(GROWTH.n) > THIN else GROWTH
    finish = [
        FitRound(PathSpace(n, length), weight, samples, edge)
        for n, length, weight, samples, edge in _FINISH[detail]
    ]
    return [*first, *_growing(growth, space, 3000, LEG), *finish]


@dataclass(frozen=True)
class Leg:
    """A path, one of those that follow each other.

    low, side  corner and side of where it acts: the unit cube, or a box in it with a windowed space
    """

    space: PathSpace
    z: Floats
    low: tuple[float, float, float] = (0.0, 0.0, 0.0)
    side: float = 1.0

    @cached_property
    def _grids(self) -> Floats:
        return padded(self.space.knots(self.z))

    def carry(self, points: Floats, steps: int = STEPS, backwards: bool = False) -> Floats:
        """Return where the path carries points (P, 3)."""
        x, here = self._local(points)
        out = points.copy()
        arrived = carried(self._grids, self.space.n, x[here], steps, backwards)
        out[here] = self.low + self.side * arrived
        return out

    def carry_with_jacobians(self, points: Floats) -> tuple[Floats, Floats]:
        """Return where points (P, 3) are carried, and the determinants (P,) of the mapping's gradient."""
        x, here = self._local(points)
        out, determinants = points.copy(), np.ones(len(points))
        arrived, determinants[here] = carried_with_jacobians(self._grids, self.space.n, x[here])
        out[here] = self.low + self.side * arrived
        return out, determinants

    def _local(self, points: Floats) -> tuple[Floats, np.ndarray]:
        """Return points (P, 3) in the coordinates of the cube, and which of them the path can move."""
        x = (points - self.low) / self.side
        if not self.space.is_windowed:
            return x, np.ones(len(x), np.bool_)
        return x, within_cube(x)


@dataclass(frozen=True)
class State:
    """What a round begins with.

    done  number of rounds before it
    legs  the paths so far; rounds change the last
    rest  the surface where the last begins, with more vertices where it is stretched
    """

    done: int
    legs: tuple[Leg, ...]
    rest: FittedSurface

    @classmethod
    def at_rest(cls, surface: FittedSurface) -> State:
        return cls(0, (Leg(START, np.zeros(START.size)),), surface)

    def with_leg(self, leg: Leg) -> State:
        """Return the state with another last leg."""
        return replace(self, legs=(*self.legs[:-1], leg))

    def after_leg(self) -> State:
        """Return the state where one more leg begins."""
        arrived = FittedSurface(self.legs[-1].carry(self.rest.points), self.rest.faces)
        fresh = Leg(START, np.zeros(START.size))
        return State(self.done, (*self.legs, fresh), arrived)


MOST_VERTICES = 40_000
"""Vertices of a carried surface up to which more are added."""


def next_round(state: State, one: FitRound, target: FittedSurface) -> State:
    """Return the state after a round."""
    if one.is_leg:
        state = state.after_leg()
    part = None if one.until is None else target.growth.part(one.until)
    pairs: list[Pair] = []
    if one.begins or part is None:
        state, _ = _after_pass(state, one, target, part, pairs)
    else:
        for number in range(PASSES):
            state, lag = _after_pass(state, one, target, part, pairs)
            if number and lag <= LAG:
                break
    return replace(state, done=state.done + 1)


def _after_pass(
    state: State, one: FitRound, target: FittedSurface, part: GrownPart | None, pairs: list[Pair]
) -> tuple[State, float]:
    """Return the state after a search for correspondences and a fit, and how far it lagged before.

    part   what the surface is fitted to; None for the whole target
    pairs  of L-BFGS, which are replaced
    """
    space, last = one.space, state.legs[-1]
    state = _refine(state.with_leg(Leg(space, last.space.converted(last.z, space))), one.edge)
    z, rest = state.legs[-1].z, state.rest
    x = state.legs[-1].carry(rest.points)
    normals, areas = FittedSurface(x, rest.faces).vertex_normals
    some = _spread(areas, one.samples)
    share = np.full(len(some), 1.0 / len(some))
    data: Data
    lag = 0.0
    if one.begins:
        assert part is not None
        data, points, iterations = Front(part, share), rest.points[some], BEGINNING
    else:
        there = target.samples(one.samples)
        if part is None:
            (places, facing), iterations = target.nearest(x[some]), ITERATIONS
        else:
            (places, facing), iterations = part.places(x[some], normals[some]), GROWING
            grown = part.holds(there[0])
            there = there[0][grown], there[1][grown]
        here = _match((x, normals), there, target)
        behind = lengths(x[here] - there[0])
        lag = float(np.quantile(behind, 0.98))
        weights = np.ones(len(here)) if part is None else 1.0 + np.minimum(behind / LAG, URGENT)
        points = rest.points[np.concatenate([some, here])]
        onto = Planes(places, facing, share, 0.3 * one.along)
        back = Planes(*there, weights / weights.sum(), one.along)
        data = joined((0.5, onto, len(some)), (0.5, back, len(here)))
    steps = STEPS if part is None or one.begins else STEPS // 2  # legs are short
    z = minimised(lambda z: energy(space, z, points, data, one.weight, steps), z, iterations, pairs)
    return state.with_leg(Leg(space, z)), lag


def _match(
    carried_points: tuple[Floats, Floats], there: tuple[Floats, Floats], target: FittedSurface
) -> np.ndarray:
    """Return the indices of carried points (P, 3) that belong to those of the target (Q, 3), with normals."""
    scale = NORMAL * target.diagonal
    apart = APART if target.thin_share(THIN_GROWTH.n) <= THIN else 0.0
    rows, queries = (
        np.hstack([points, scale * normals, apart * target.growth.landmarks_at(points)])
        for points, normals in (carried_points, there)
    )
    return _nearest(rows, queries)


def _spread(areas: Floats, most: int) -> np.ndarray:
    """Return at most `most` of vertices with these shares of the area, evenly by area."""
    reached = np.cumsum(areas)
    return np.unique(np.searchsorted(reached, (np.arange(most) + 0.5) / most * reached[-1]))


def _nearest(rows: Floats, queries: Floats) -> np.ndarray:
    """Return the index of the nearest of rows (R, C) to each of queries (Q, C)."""
    order = np.argsort(rows[:, 0], kind="stable")
    found = np.empty(len(queries), np.int64)
    kernels.nearest_rows(np.ascontiguousarray(rows[order]), np.ascontiguousarray(queries), found)
    return order[found]


def _refine(state: State, longest: float) -> State:
    """Return the state with edges cut in two that are longer than `longest` where they are carried to.

    The longest are cut first, until there are MOST_VERTICES. Faces on both sides of an edge are not cut
    together: the vertices are samples.
    """
    points, faces = state.rest.points, state.rest.faces
    leg = state.legs[-1]
    now = leg.carry(points)
    for bound in longest * 2.0 ** np.arange(5, -1, -1):
        for _ in range(6):
            ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
            edges = lengths((now[ends[..., 0]] - now[ends[..., 1]]).reshape(-1, 3)).reshape(-1, 3)
            side = np.argmax(edges, axis=1)
            rows = np.flatnonzero(edges[np.arange(len(faces)), side] > bound)
            low, high = np.sort(ends[rows, side[rows]], axis=1).astype(np.int64).T
            cut, middles = np.unique(low * len(points) + high, return_inverse=True)
            if not len(rows) or len(points) + len(cut) > MOST_VERTICES:
                break
            a, b, c = (faces[rows, (side[rows] + k) % 3] for k in range(3))
            middle, faces = len(points) + middles.ravel(), faces.copy()
            faces[rows] = np.stack([a, middle, c], axis=1)
            faces = np.concatenate([faces, np.stack([middle, b, c], axis=1)])
            low, high = np.divmod(cut, len(points))
            added = 0.5 * (points[low] + points[high])
            points, now = np.concatenate([points, added]), np.concatenate([now, leg.carry(added)])
    return replace(state, rest=FittedSurface(points, faces))


@dataclass(frozen=True)
class Planes:
    """Where points should be: on planes through `points` (P, 3) with `normals`, and a little at the points.

    weights  (P,), which add up to 1
    along    weight of squared distances along the plane over those across
    """

    points: Floats
    normals: Floats
    weights: Floats
    along: float

    def __call__(self, x: Floats) -> tuple[float, Floats]:
        away = x - self.points
        across = np.einsum("ij,ij->i", away, self.normals)
        squares = (1.0 - self.along) * across**2 + self.along * np.einsum("ij,ij->i", away, away)
        force = (1.0 - self.along) * across[:, None] * self.normals + self.along * away
        return float(np.sum(self.weights * squares)), 2.0 * self.weights[:, None] * force


@dataclass(frozen=True)
class Front:
    """Points should be on the surface of a part. weights: (P,), which add up to 1."""

    part: GrownPart
    weights: Floats

    def __call__(self, x: Floats) -> tuple[float, Floats]:
        distance, gradient = self.part.residual(x)
        force = 2.0 * (self.weights * distance)[:, None] * gradient
        return float(np.sum(self.weights * distance**2)), force


def joined(*terms: tuple[float, Data, int]) -> Data:
    """Return the sum of data, each with a factor and how many of the points are its own, in order."""

    def data(x: Floats) -> tuple[float, Floats]:
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
    patch         the largest mean over a patch of 0.5 % of either surface: what a tear or a lost limb is
    least         the least determinant of the mapping's gradient on the surface
    """

    mean: float
    most: float
    back: float
    far: float
    patch: float
    least: float

    @property
    def worst(self) -> float:
        """The largest of both 95 % and half of that of the worst patch."""
        return max(self.most, self.far, 0.5 * self.patch)


Watch = Callable[[State, int], None]
"""Called after each round with the state and the number of all rounds."""


def fitted(
    rest: FittedSurface, target: FittedSurface, detail: Detail, state: State | None, watch: Watch
) -> State:
    """Return the state after all rounds of a fit that carries one surface onto another.

    rest, target  closed surfaces of one part and the same genus, in the unit cube, away from its sides
    state         that of an earlier call, to go on from; None to begin
    """
    rounds = rounds_of(target, detail)
    total = len(rounds) + BOXES[detail]
    state = State.at_rest(rest) if state is None else state
    for one in rounds[state.done :]:
        state = next_round(state, one, target)
        watch(state, total)
    while state.done < total:
        box = lost_box(state, target)
        state = replace(state, done=total) if box is None else fitted_in_box(state, target, *box)
        watch(state, total)
    return state


BOXES: Mapping[Detail, int] = {"coarse": 0, "medium": 1, "fine": 3}
"""How many boxes a fit has at most."""

LOST, LOST_PATCH = 0.01, 0.005
"""Distance, in diagonals of the target, above which a point is lost, and a patch calls for a box."""

LEG_IN_BOX = 0.4
"""How far a part grows in a box before another leg begins, in sides of the box."""

REACH, ROOM = 0.15, 0.06
"""How far from the farthest point others in its box may be, and room around them, in sides of the cube."""

_IN_BOX = (
    (32, 0.04, 1e-6, 4000, 0.02),
    (40, 0.03, 3e-7, 5000, 0.014),
    (40, 0.026, 1e-7, 6000, 0.011),
)
"""Cells, ℓ, λ, samples and longest edge of the last rounds in a box."""


def lost_box(state: State, target: FittedSurface) -> tuple[Floats, float] | None:
    """Return the corner (3,) and side of a box around a lost part of the target; None if none is lost."""
    now = FittedSurface(state.legs[-1].carry(state.rest.points), state.rest.faces)
    points, away = target.distances(now, 200 * PATCH)
    if away.reshape(-1, PATCH).mean(axis=1).max() < LOST_PATCH * target.diagonal:
        return None
    lost = points[away > min(LOST * target.diagonal, 0.5 * away.max())]
    near = lost[(np.abs(lost - points[np.argmax(away)]) < REACH).all(axis=1)]
    low, high = near.min(axis=0) - ROOM, near.max(axis=0) + ROOM
    side = float((high - low).max())
    return 0.5 * (low + high - side), side


def fitted_in_box(state: State, target: FittedSurface, low: Floats, side: float) -> State:
    """Return the state with more legs, which only move points in a box."""
    rest = state.after_leg().rest
    reached = FittedSurface((rest.points - low) / side, rest.faces)
    inside = within_cube(reached.points)[rest.faces].all(axis=1)
    kept, corners = np.unique(rest.faces[inside], return_inverse=True)
    clipped = FittedSurface(reached.points[kept], np.asarray(corners, rest.faces.dtype).reshape(-1, 3))
    goal = SurfaceInBox((target.points - low) / side, target.faces, reached)
    here = State.at_rest(clipped)
    for one in _rounds_in_box(goal.growth):
        here = next_round(here, one, goal)
    x, y, z = low.tolist()
    legs = [replace(leg, low=(x, y, z), side=side) for leg in here.legs]
    points = rest.points
    for leg in legs[:-1]:
        points = leg.carry(points)
    added = low + side * here.rest.points[len(kept) :]
    numbers = np.concatenate([kept, len(points) + np.arange(len(added))])
    faces = np.concatenate([rest.faces[~inside], numbers[here.rest.faces]])
    whole = FittedSurface(np.concatenate([points, added]), faces)
    return State(state.done + 1, (*state.legs, *legs), whole)


def _rounds_in_box(growth: SolidGrowth) -> list[FitRound]:
    finish = [
        FitRound(PathSpace(n, length, True), weight, samples, edge)
        for n, length, weight, samples, edge in _IN_BOX
    ]
    return [*_growing(growth, PathSpace(32, 0.05, True), 2000, LEG_IN_BOX), *finish]


def _growing(growth: SolidGrowth, space: PathSpace, samples: int, leg: float) -> list[FitRound]:
    """Return the rounds in which a target grows, and another leg begins after about `leg`."""
    way = growth.end - growth.start
    steps = int(np.ceil(way / STEP))
    each = int(np.ceil(steps / max(1, round(way / leg))))
    return [
        FitRound(space, 1e-5, samples, 0.02, until, along=0.1, is_leg=step > 0 and step % each == 0)
        for step, until in enumerate(np.linspace(growth.start, growth.end, steps + 1)[1:].tolist())
    ]
