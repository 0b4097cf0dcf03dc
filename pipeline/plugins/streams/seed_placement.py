"""Exact places of new vertices on surfaces from seeds.

The middle of an edge in coordinates, of seed and time, is not near the middle of the edge where the flow
stretches the surface by some e-fold per second: at a saddle two neighbours may have left the seeds a second
apart, and the straight line between their coordinates leads far away and back. A split there makes no edge
shorter, however often it is repeated. So the coordinates of a new vertex are found by its place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from flowsculpt import Exact, TriangleMesh
from flowsculpt.api.meshes import Floats

REST, ASTRAY = "rest", "astray"
"""Vertex attributes: coordinates (V, 3), and 1 for vertices that could not be placed exactly."""

_NEAR = 0.2  # of an edge: how far from its middle a new vertex may be without a search for a better place
_FARTHEST = 0.35  # of an edge, from its middle: both halves are then at most 0.85 times as long
_BEHIND = 0.7  # of an edge that a moving row draws out: what a split leaves behind, where it stays as it is
_UNEVEN = 0.3  # difference of both halves over their sum, on the rim
_HALVINGS = 50  # of an edge of the rim: about the precision of coordinates
_MOST_STEPS = 20  # towards the middle of an edge, from each start
_SHORTEST = 0.005  # share of a step to which it is shortened before a search ends
_ASIDE = 1e-4  # for derivatives, over the difference of the ends' coordinates
_INSIDE = 0.05  # of the difference of times along an edge: what new vertices keep from the first and last row
_LEAST = 0.1  # of an edge: the difference of times that a search takes an edge within one row to have
_HALFEDGE = 2  # column of births after both parents: the half-edge from the new vertex to the second parent


class Strip(Protocol):
    """The flat strip, or tube, of coordinates."""

    def nearest(self, points: Floats) -> Floats: ...

    def tangents(self, coordinates: Floats) -> Floats: ...

    def within(self, coordinates: Floats, low: float, high: float, inside: Floats) -> Floats: ...


@dataclass(frozen=True, kw_only=True)
class SeedPlacement(Exact):
    """New vertices exactly where a seed is at a time, near the middle of their edge.

    strip  the coordinates
    times  returns the first and the last time that vertices may have
    moves  returns flags (N,) of the coordinates (N, 3) in the row that moves on

    A row that moves on draws out the edges beside it until they are split. Halves would stay half as long as
    edges may be: so the new vertex is nearer to the row, and what is behind it longer.

    On the rim the new vertex is on the line between both ends, since a row of one time moves on as a whole:
    it is halved towards the longer part of the edge, until the parts are about as long as they should be.
    Elsewhere it is that point in coordinates, or where it is far from the point of the edge, what Gauss and
    Newton's steps towards that find, with Broyden's derivatives. A vertex for which they find nothing stays
    on the edge.
    """

    strip: Strip
    times: Callable[[], tuple[float, float]]
    moves: Callable[[Floats], np.ndarray]
    can_relax: ClassVar[bool] = False
    most_rounds: ClassVar[int] = 40

    def prepare(self, mesh: TriangleMesh, hard_angle: float | Floats) -> TriangleMesh:
        return mesh.with_attributes(**{ASTRAY: np.zeros(len(mesh.vertices), np.uint8)})

    def columns(self, mesh: Any) -> tuple[int, int, int]:
        return -1, -1, -1  # faces may look any way in coordinates

    def restore(self, mesh: Any, limits: Any) -> None:
        """Leave vertices where they are."""

    def place(self, mesh: Any, births: np.ndarray, limits: Any) -> int:
        born = mesh.arrays.vert[births[:, _HALFEDGE]]
        rest, astray = mesh.column(REST), mesh.column(ASTRAY)
        coordinates = mesh.arrays.attributes[:, rest : rest + 3]
        on_rim = mesh.arrays.twin[births[:, _HALFEDGE]] < 0
        ends = births[:, :_HALFEDGE]
        edges = _Edges(coordinates[ends], mesh.arrays.points[ends], on_rim)
        moves = self.moves(coordinates[ends].reshape(-1, 3)).reshape(-1, 2)
        edges.aim(moves, mesh.arrays.points[_corners(mesh, births[:, _HALFEDGE])])
        found, places = edges.middles(self)
        kept = on_rim | (np.linalg.norm(places - edges.goals, axis=1) <= edges.farthest * edges.lengths)
        mesh.arrays.points[born[kept]] = places[kept]
        coordinates[born] = found
        mesh.arrays.attributes[born, astray] = ~kept
        return int(len(born) - kept.sum())

    def carried(self, coordinates: Floats) -> Floats:
        """Return where points (N, 3) of these coordinates are now."""
        return self._carry(coordinates)


def _corners(mesh: Any, halfedges: np.ndarray) -> np.ndarray:
    """Return the corners (N, 2) opposite half-edges (N,) and their twins; on the rim one of them twice."""
    twins = mesh.arrays.twin[halfedges]
    both = np.column_stack([halfedges, np.where(twins < 0, halfedges, twins)])
    return np.asarray(mesh.arrays.vert[both - both % 3 + (both + 2) % 3])


class _Edges:
    """Edges that are split.

    coordinates  (N, 2, 3) of their ends
    places       (N, 2, 3) of these
    on_rim       (N,) True for edges of one face, along which coordinates are on a line

    `shares` (N,) of an edge are before its new vertex.
    """

    def __init__(self, coordinates: Floats, places: Floats, on_rim: np.ndarray) -> None:
        self.coordinates, self.places, self.on_rim = coordinates, places, on_rim
        self.shares = np.full(len(places), 0.5)
        self._set_goals()
        self.lengths = np.linalg.norm(places[:, 1] - places[:, 0], axis=1)
        apart = np.abs(coordinates[:, 1] - coordinates[:, 0])
        times = np.maximum(apart[:, 2], _LEAST * self.lengths)
        self.scale = np.column_stack([np.maximum(np.linalg.norm(apart[:, :2], axis=1), 1e-12), times])

    def aim(self, moves: np.ndarray, corners: Floats) -> None:
        """Aim at points nearer to the row that moves on, where all edges that this makes are shorter.

        moves    (N, 2) True for ends in that row
        corners  (N, 2, 3) the places of the other corners of the faces beside the edges
        """
        one = moves[:, 0] != moves[:, 1]
        self.shares[one] = np.where(moves[one, 1], _BEHIND, 1.0 - _BEHIND)
        self._set_goals()
        new = np.linalg.norm(corners - self.goals[:, None], axis=2).max(axis=1)
        self.shares[new >= self.lengths] = 0.5
        self._set_goals()

    def _set_goals(self) -> None:
        """Set where new vertices should be, and from how far away (N,) a search begins and they are left."""
        self.goals = self.places[:, 0] + self.shares[:, None] * (self.places[:, 1] - self.places[:, 0])
        self.farthest = _FARTHEST - np.abs(self.shares - 0.5)
        self.near = np.minimum(_NEAR, self.farthest)

    def middles(self, placement: SeedPlacement) -> tuple[Floats, Floats]:
        """Return coordinates (N, 3) and places (N, 3) of new vertices."""
        found = np.empty_like(self.goals)
        places, rows = found.copy(), np.arange(len(found))
        self._start(placement, rows, found, places)
        self._divide_rim(placement, found, places)
        left = self._search(placement, rows[~self.on_rim], found, places)
        uneven = left[self.shares[left] != 0.5]
        if len(uneven):  # the middle may be in reach
            self.shares[uneven] = 0.5
            self._set_goals()
            self._start(placement, uneven, found, places)
            self._search(placement, uneven, found, places)
        return found, places

    def _start(self, placement: SeedPlacement, rows: np.ndarray, found: Floats, places: Floats) -> None:
        """Set new vertices of some edges to their shares in coordinates."""
        found[rows] = placement.strip.nearest(self._between(self.shares[rows], rows))
        inner = rows[~self.on_rim[rows]]
        inside = _INSIDE * self.scale[inner, 1]
        found[inner] = placement.strip.within(found[inner], *placement.times(), inside)
        places[rows] = placement.carried(found[rows])

    def _search(
        self, placement: SeedPlacement, rows: np.ndarray, found: Floats, places: Floats
    ) -> np.ndarray:
        """Bring new vertices of some edges near to their goals; return the rows of those that stay far."""
        rows = rows[
            np.linalg.norm(places[rows] - self.goals[rows], axis=1) > self.near[rows] * self.lengths[rows]
        ]
        first = found.copy()
        for start in (None, 0, 1):
            if not len(rows):
                break
            search = _Search(self, rows, placement)
            search.run(
                found[rows] if start is None else self.coordinates[rows, start],
                places[rows] if start is None else self.places[rows, start],
            )
            nearer = search.away < np.linalg.norm(places[rows] - self.goals[rows], axis=1)
            found[rows[nearer]], places[rows[nearer]] = search.at[nearer], search.places[nearer]
            rows = rows[search.away > self.farthest[rows] * self.lengths[rows]]
        found[rows] = first[rows]  # never those of an end: they may be in a row that moves on
        return rows

    def _between(self, shares: Floats, rows: np.ndarray) -> Floats:
        """Return coordinates (N, 3) at shares (N,) of some edges."""
        first, last = self.coordinates[rows, 0], self.coordinates[rows, 1]
        return np.asarray(first + shares[:, None] * (last - first))

    def _divide_rim(self, placement: SeedPlacement, found: Floats, places: Floats) -> None:
        """Move new vertices along the rim until they have about their shares of their edges before them."""
        rows, at = np.flatnonzero(self.on_rim), self.shares.copy()
        low, high = np.zeros(len(found)), np.ones(len(found))
        for _ in range(_HALVINGS):
            before, after = (np.linalg.norm(places[rows] - self.places[rows, end], axis=1) for end in (0, 1))
            before, after = before * (1.0 - self.shares[rows]), after * self.shares[rows]
            uneven = np.abs(before - after) > _UNEVEN * (before + after)
            if not uneven.any():
                return
            rows, is_far = rows[uneven], (before > after)[uneven]
            high[rows[is_far]], low[rows[~is_far]] = at[rows[is_far]], at[rows[~is_far]]
            at[rows] = 0.5 * (low[rows] + high[rows])
            found[rows] = placement.strip.nearest(self._between(at[rows], rows))
            places[rows] = placement.carried(found[rows])


class _Search:
    """Gauss and Newton's steps of many points towards the middles of their edges."""

    def __init__(self, edges: _Edges, rows: np.ndarray, placement: SeedPlacement) -> None:
        self._placement, self._goals = placement, edges.goals[rows]
        self._near = edges.near[rows] * edges.lengths[rows]
        self._scale = edges.scale[rows]

    def run(self, start: Floats, places: Floats) -> None:
        """Search from coordinates (N, 3) and their places on.

        Sets `at`, `places`, and how far these are `away` from the goals.
        """
        self.at, self.places = start.copy(), places.copy()
        self.away = np.linalg.norm(places - self._goals, axis=1)
        slopes, reach = self._slopes(np.arange(len(start))), np.ones(len(start))
        is_fresh = np.ones(len(start), bool)
        for _ in range(_MOST_STEPS):
            rows = np.flatnonzero((self.away > self._near) & (reach > _SHORTEST))
            if not len(rows):
                return
            step = reach[rows, None] * _solved(slopes[rows], self._goals[rows] - self.places[rows])
            new = self._moved(rows, step)
            there = self._placement.carried(new)
            slopes[rows] = _updated(slopes[rows], step, there - self.places[rows])
            away = np.linalg.norm(there - self._goals[rows], axis=1)
            better = away < (1.0 - 0.2 * reach[rows]) * self.away[rows]
            reach[rows] = np.where(better, np.minimum(1.0, 2.0 * reach[rows]), reach[rows])
            on = rows[away < self.away[rows]]
            nearer = away < self.away[rows]
            self.at[on], self.places[on], self.away[on] = new[nearer], there[nearer], away[nearer]
            stale, short = rows[~better & ~is_fresh[rows]], rows[~better & is_fresh[rows]]
            reach[short] *= 0.3
            is_fresh[rows] = False
            again = np.concatenate([stale, short])
            if len(again):
                slopes[again], is_fresh[again] = self._slopes(again), True

    def _moved(self, rows: np.ndarray, step: Floats) -> Floats:
        """Return coordinates (N, 3) moved by steps (N, 2), in shares of the edges."""
        strip, (low, high) = self._placement.strip, self._placement.times()
        inside = _INSIDE * self._scale[rows, 1]
        new = self.at[rows] + (step[:, :1] * self._scale[rows, :1]) * strip.tangents(self.at[rows])
        new[:, 2] += step[:, 1] * self._scale[rows, 1]
        return strip.within(new, low, high, inside)

    def _slopes(self, rows: np.ndarray) -> Floats:
        """Return derivatives (N, 3, 2) of places by shares of the edges, by differences."""
        out = np.empty((len(rows), 3, 2))
        beside = []
        for axis in (0, 1):
            step = np.zeros((len(rows), 2))
            step[:, axis] = _ASIDE
            new = self._moved(rows, step)
            stuck = (new == self.at[rows]).all(axis=1)
            new[stuck] = self._moved(rows[stuck], -step[stuck])
            beside.append((new, np.where(stuck, -_ASIDE, _ASIDE)))
        there = self._placement.carried(np.concatenate([new for new, _ in beside]))
        for axis, (_, step) in enumerate(beside):
            part = there[axis * len(rows) : (axis + 1) * len(rows)]
            out[:, :, axis] = (part - self.places[rows]) / step[:, None]
        return out


def _solved(slopes: Floats, gaps: Floats) -> Floats:
    """Return steps (N, 2) of least squares that close gaps (N, 3), none much longer than an edge."""
    squares = np.einsum("nik,nil->nkl", slopes, slopes)
    size = np.einsum("nkk->n", squares)[:, None, None]
    squares += 1e-9 * size * np.eye(2) + np.finfo(float).tiny * np.eye(2)
    step = np.linalg.solve(squares, np.einsum("nik,ni->nk", slopes, gaps)[:, :, None])[:, :, 0]
    most = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, 0.5 / np.maximum(most, 0.5)))


def _updated(slopes: Floats, step: Floats, went: Floats) -> Floats:
    """Return derivatives (N, 3, 2) that agree with how far a step (N, 2) went (Broyden 1965)."""
    square = np.maximum((step * step).sum(axis=1), np.finfo(float).tiny)[:, None, None]
    miss = went - np.einsum("nik,nk->ni", slopes, step)
    return np.asarray(slopes + miss[:, :, None] * step[:, None, :] / square)
