"""Bevels: the rings of an outline moved inwards, by its straight skeleton as far as edges collapse.

Each edge of a ring moves inwards at unit speed, and vertices along the bisectors. An edge that shrinks to a
point leaves the ring (the edge events of Aichholzer et al., *A novel type of skeleton for polygons*, 1995).
Rings that would meet each other or themselves are refused: the bevel is wider than the strokes allow.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from flowsculpt import UsageError


class TooWideError(UsageError):
    """Raised where a bevel is wider than the strokes of an outline allow."""


@dataclass
class Bevel:
    """The faces between a ring and the same ring moved inwards, seen from the front.

    count   vertices of the ring
    points  (x, y) of vertices: those of the ring first
    moved   distance of each vertex's edges from where they began
    faces   corners of each face, counter-clockwise
    pieces  the number of the level that each face leads to
    levels  the ring at each distance asked for, as vertex numbers
    """

    count: int
    points: list[tuple[float, float]]
    moved: list[float]
    faces: list[list[int]] = field(default_factory=list)
    pieces: list[int] = field(default_factory=list)
    levels: list[list[int]] = field(default_factory=list)

    def add_face(self, corners: list[int]) -> None:
        self.faces.append(corners)
        self.pieces.append(len(self.levels))

    @property
    def rim(self) -> list[int]:
        """The last level, or the ring itself where there is none."""
        return self.levels[-1] if self.levels else list(range(self.count))


def bevelled(ring: np.ndarray, distances: Sequence[float]) -> Bevel:
    """Return the bevel of a ring (N, 2), whose inside is on the left, with a level at each distance.

    Raises TooWideError where the ring vanishes before the last.
    """
    return _Wavefront(ring).run(distances)


NOTCH, PIECE = math.radians(100.0), math.radians(45.0)
"""A vertex where the outline turns outwards by more than NOTCH moves as several, which turn by PIECE at most:
a mitre would reach far into the strokes."""


def _with_notches_cut(ring: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return tails and directions (M, 2) of a ring's edges, with edges of no length in its notches."""
    along = np.roll(ring, -1, axis=0) - ring
    angles = np.arctan2(along[:, 1], along[:, 0])
    turns = (np.roll(angles, 1) - angles) % (2.0 * math.pi)  # outwards
    pieces = np.where((turns > NOTCH) & (turns < math.pi), np.ceil(turns / PIECE), 1.0).astype(int)
    owner = np.repeat(np.arange(len(ring)), pieces)
    left = (
        np.repeat(np.cumsum(pieces), pieces) - np.arange(len(owner)) - 1
    )  # pieces that follow at the vertex
    angle = angles[owner] + left / pieces[owner] * turns[owner]
    return ring[owner], np.column_stack([np.cos(angle), np.sin(angle)])


class _Wavefront:
    """The ring as it moves. Edge e starts at vertex `tail[e]`, and `after[e]` follows it."""

    def __init__(self, ring: np.ndarray) -> None:
        ring, self.direction = _with_notches_cut(ring)
        count = len(ring)
        self.bevel = Bevel(count, [(float(x), float(y)) for x, y in ring], [0.0] * count)
        self.after = [(e + 1) % count for e in range(count)]
        self.before = [(e - 1) % count for e in range(count)]
        self.tail = list(range(count))
        self.alive = [True] * count
        self.speed = [self._speed(e) for e in range(count)]  # of the tail of each edge
        self.left: list[list[int]] = [[e] for e in range(count)]  # what each edge's ends went through
        self.right: list[list[int]] = [[(e + 1) % count] for e in range(count)]
        self.round = [0] * count  # of each edge: an event of an earlier round has been replaced
        self.events: list[tuple[float, int, int]] = []
        for e in range(count):
            self._expect(e, 0.0)

    def run(self, distances: Sequence[float]) -> Bevel:
        for distance in distances:
            while self.events and self.events[0][0] <= distance:
                moved, e, number = heapq.heappop(self.events)
                if self.alive[e] and number == self.round[e]:
                    self._collapse(e, moved)
            self._level(distance)
        return self.bevel

    def _speed(self, e: int) -> np.ndarray:
        """Return the velocity (2,) of the vertex between an edge and the one before it."""
        (ux, uy), (vx, vy) = self.direction[self.before[e]], self.direction[e]
        cosine = 1.0 + ux * vx + uy * vy
        if cosine < 1e-6:
            raise TooWideError("its strokes are narrower than the bevel on both sides")
        return np.array([-(uy + vy), ux + vx]) / cosine

    def _at(self, e: int, moved: float) -> np.ndarray:
        """Return where the tail of an edge is by then."""
        tail = self.tail[e]
        return np.array(self.bevel.points[tail]) + (moved - self.bevel.moved[tail]) * self.speed[e]

    def _expect(self, e: int, now: float) -> None:
        """Find when an edge collapses, if it does."""
        following = self.after[e]
        closing = float((self.speed[e] - self.speed[following]) @ self.direction[e])
        self.round[e] += 1
        if closing > 1e-12:
            length = float((self._at(following, now) - self._at(e, now)) @ self.direction[e])
            heapq.heappush(self.events, (now + max(length, 0.0) / closing, e, self.round[e]))

    def _add(self, point: np.ndarray, moved: float) -> int:
        self.bevel.points.append((float(point[0]), float(point[1])))
        self.bevel.moved.append(moved)
        return len(self.bevel.points) - 1

    def _collapse(self, e: int, moved: float) -> None:
        """Take an edge out of the ring: the vertices at its ends become one."""
        before, following = self.before[e], self.after[e]
        if self.after[following] == before or following == before:
            raise TooWideError("it vanishes within the bevel")
        vertex = self._add(0.5 * (self._at(e, moved) + self._at(following, moved)), moved)
        self.bevel.add_face([*self.left[e][::-1], *self.right[e], vertex])
        self.alive[e] = False
        self.after[before], self.before[following] = following, before
        self.tail[following] = vertex
        self.right[before].append(vertex)
        self.left[following].append(vertex)
        self.speed[following] = self._speed(following)
        for edge in (before, following):
            self._expect(edge, moved)

    def _level(self, moved: float) -> None:
        """End the faces of all edges at a distance, and begin the next ones there."""
        edges = list(self._ring())
        vertex = {e: self._add(self._at(e, moved), moved) for e in edges}
        for e in edges:
            following = self.after[e]
            self.bevel.add_face([*self.left[e][::-1], *self.right[e], vertex[following], vertex[e]])
            self.left[e], self.right[e] = [vertex[e]], [vertex[following]]
        for e in edges:
            self.tail[e] = vertex[e]
        self.bevel.levels.append([vertex[e] for e in edges])

    def _ring(self) -> Iterator[int]:
        first = e = next(e for e, alive in enumerate(self.alive) if alive)
        while True:
            yield e
            e = self.after[e]
            if e == first:
                return
