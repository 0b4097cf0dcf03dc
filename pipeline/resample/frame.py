"""One resampling of a surface: the work lists, the steps and the counts of a frame."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.errors import FrameError
from pipeline.mesh.halfedge import HalfedgeMesh
from pipeline.resample._kernels_collapse import REASONS, TOO_LONG, collapse_all
from pipeline.resample._kernels_flip import flip_marked
from pipeline.resample._kernels_place import BIRTH, MOST_AROUND, long_around
from pipeline.resample._kernels_ring import new_ring
from pipeline.resample._kernels_scan import BLOCK, extent, look_again, scan
from pipeline.resample._kernels_shape import list_poor
from pipeline.resample._kernels_split import longest_first, split_pass
from pipeline.resample.placement import Placement
from pipeline.resample.report import Report
from pipeline.resample.shape import Shape
from pipeline.resample.thresholds import Thresholds

_MOST_PLACED = 16  # passes; an edge halved that often has been stretched 65,000-fold in one frame
_ALLOWANCE = 1.2  # times the maximum: how long an edge may be for a moment, so that a short one can go


class Frame:
    """A surface while its edges are brought into the bracket, step after step."""

    def __init__(
        self, mesh: HalfedgeMesh, thresholds: Thresholds, placement: Placement, shape: Shape
    ) -> None:
        self.mesh, self.thresholds, self.placement, self.shape = mesh, thresholds, placement, shape
        self.limits = _limits(mesh, thresholds, placement, shape)
        self.splits = self.collapses = self.flips = self.passes = self.relaxed = self.on_chord = 0
        self.refused: Indices = np.zeros(len(REASONS), np.int64)
        faces = int(mesh.sizes[1])
        self.marks = np.zeros(faces, np.uint8)
        self.extents: Points = np.empty((-(-faces // BLOCK), 2))
        self.dead_faces, self.dead_vertices = _work_list(0), _work_list(0)

    def scan(self) -> None:
        """Find the edges out of the bracket, and those of clearly obtuse triangles."""
        faces = int(self.mesh.sizes[1])
        self.longs, self.shorts = _work_list(self.mesh.edges), _work_list(2 * self.mesh.edges)
        self.obtuse = _work_list(faces)
        total = scan(
            self.mesh.surface, faces, self.limits, self.longs, self.shorts, self.obtuse, self.extents
        )
        if not math.isfinite(total):
            size = np.abs(self.mesh.vertices).max(axis=1)
            wild = int(np.argmax(np.where(np.isnan(size), math.inf, size)))
            raise FrameError(
                f"vertex {wild} has left the numbers: {self.mesh.vertices[wild]}; calm the flow there"
            )

    def split_long_edges(self) -> None:
        """Pass after pass until none is too long; every pass takes the longest first (P25)."""
        while self.longs[0]:
            room, first = int(self.longs[0]), int(self.mesh.sizes[0])
            self._keep_to_budget(room)
            self.mesh.reserve(room, 2 * room)
            self.marks = np.concatenate([self.marks, np.zeros(2 * room, np.uint8)])
            later, births = _work_list(10 * room), _work_list(BIRTH * room)
            order = longest_first(self.mesh.surface, self.longs, self.limits, later)
            split_pass(
                self.mesh.surface,
                self.mesh.sizes,
                self.limits,
                order,
                later,
                births,
                self.shorts,
                self.marks,
            )
            self.splits += int(self.mesh.sizes[0]) - first
            self.passes += 1
            self.longs = self._placed(_items(births).reshape(-1, BIRTH), later)

    def _placed(self, births: Indices, later: Indices) -> Indices:
        """Let the placement have the new vertices; answers which edges are then too long."""
        if not self.placement.leaves_chord or not len(births) or self.passes > _MOST_PLACED:
            return later
        self.on_chord += self.placement.place(self.mesh, births, self.limits[2])
        around = _work_list(int(later[0]) + MOST_AROUND * len(births))
        long_around(self.mesh.surface, births, self.limits, later, around)
        return around

    def collapse_short_edges(self) -> None:
        """Collapse, flip and mend, until every edge that is still short has a reason to be (P9)."""
        self._tidy(self._collapse() + self.splits + int(self.obtuse[0]))
        self._mend()
        if self.refused[TOO_LONG]:
            self._make_room()
            self._mend()
        self.mesh.fill_holes(np.sort(_items(self.dead_vertices)), np.sort(_items(self.dead_faces)))

    def _tidy(self, changed: int) -> None:
        """Flip and look again until nothing more can be done."""
        while changed:
            self._flip()
            if self._all_settled():
                break
            self._look_again()
            changed = self._collapse()

    def _mend(self) -> None:
        """Move the vertices of badly shaped triangles within the surface (P36), where that is possible."""
        for _ in range(self.shape.rounds if self.placement.knows_surroundings else 0):
            vertices, faces = (int(size) for size in self.mesh.sizes)
            spokes, seen = _work_list(vertices), np.zeros(vertices, np.uint8)
            list_poor(self.mesh.surface, faces, self.shape.roundness, self.marks, seen, spokes)
            if not spokes[0]:
                return
            moved = self.placement.relax(self.mesh, spokes, self.limits, self.marks)
            self.relaxed += moved
            if not moved:
                return
            self._tidy(moved)

    def _make_room(self) -> None:
        """Let go short edges that only a too long one keeps, and split that one instead."""
        self.limits[6] = _ALLOWANCE**2
        self._collapse()
        self.limits[6] = 1.0
        self._look_again()
        self.split_long_edges()
        self._tidy(1)

    def _all_settled(self) -> bool:
        """Whether nothing can be left to do: every edge that became short was listed, and has collapsed."""
        overflow = self.shorts[0] + 1 == len(self.shorts)
        settled = not (overflow or self.refused.any() or self.placement.leaves_chord)
        if settled:
            self.shorts[0] = 0
        return settled

    def _look_again(self) -> None:
        before = self.shorts
        self.longs, self.shorts = _work_list(self.mesh.edges), _work_list(2 * self.mesh.edges)
        look_again(
            self.mesh.surface, self.mesh.sizes[1], self.limits, self.marks, before, self.longs, self.shorts
        )

    def _collapse(self) -> int:
        self.refused[:] = 0
        self.dead_faces = _with_room(self.dead_faces, int(self.mesh.sizes[1]))
        self.dead_vertices = _with_room(self.dead_vertices, int(self.mesh.sizes[0]))
        done = collapse_all(
            self.mesh.surface,
            self.limits,
            (new_ring(), new_ring()),
            self.shorts,
            self.dead_faces,
            self.dead_vertices,
            self.marks,
            self.refused,
        )
        self.collapses += done
        return int(done)

    def _flip(self) -> None:
        faces = self.mesh.sizes[1]
        edges = _work_list(8 * self.mesh.edges)
        self.flips += flip_marked(self.mesh.surface, faces, self.limits, self.marks, self.obtuse, edges)

    def _keep_to_budget(self, more: int) -> None:
        vertices, budget = int(self.mesh.sizes[0]), self.thresholds.max_vertices
        if vertices + more > budget:
            longest = self._extent(np.ones_like(self.marks))[1]
            raise FrameError(
                f"{vertices} vertices and {more} edges to split exceed the budget of {budget} vertices "
                f"(longest edge {longest:g}, allowed {math.sqrt(self.limits[0]):g}); "
                "raise max_vertices or max_edge_length"
            )

    def _extent(self, marks: AnyArray) -> tuple[float, float]:
        """The shortest and longest edge, where marks tell what has changed since the scan."""
        low, high = extent(self.mesh.surface, self.mesh.sizes[1], marks, self.shorts, self.extents)
        return math.sqrt(low), math.sqrt(high)

    def report(self) -> Report:
        low, high = self._extent(self.marks)
        refused = {reason: int(n) for reason, n in zip(REASONS, self.refused, strict=True) if n}
        return Report(
            splits=self.splits,
            collapses=self.collapses,
            flips=self.flips,
            passes=self.passes,
            vertices=int(self.mesh.sizes[0]),
            faces=int(self.mesh.sizes[1]),
            edges=self.mesh.edges,
            too_long=int(self.longs[0]),
            too_short=int(self.shorts[0]),
            relaxed=self.relaxed,
            on_chord=self.on_chord,
            shortest=low,
            longest=high,
            refused=refused,
        )


def _limits(mesh: HalfedgeMesh, thresholds: Thresholds, placement: Placement, shape: Shape) -> Floats:
    """The numbers that kernels go by (see `_kernels_lists`)."""
    midpoint, column = float(placement.merges_at_midpoint), -1
    if thresholds.active:
        fields = thresholds.fields(mesh.snapshot())
        longest, shortest = float(fields[:, 0].max()), float(fields[:, 1].min())
        hard_angle = float(np.median(fields[:, 2]))
        fields[:, 2] = np.cos(fields[:, 2])
        column = mesh.steer(fields)
    else:
        longest, shortest, hard_angle = thresholds.numbers
    cosine, obtuse = math.cos(hard_angle), shape.longest_share
    return np.array([longest * longest, shortest * shortest, cosine, midpoint, column, obtuse, 1.0])


def _work_list(room: int) -> Indices:
    """An empty list for kernels: the first entry counts those that follow."""
    items = np.empty(room + 1, np.int32)
    items[0] = 0
    return items


def _with_room(work_list: Indices, room: int) -> Indices:
    """The list, able to hold that many."""
    if len(work_list) > room:
        return work_list
    larger = _work_list(room)
    larger[: len(work_list)] = work_list
    return larger


def _items(work_list: Indices) -> Indices:
    return work_list[1 : 1 + work_list[0]]
