"""One resampling of a surface: the work lists, the steps and the counts of a frame."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Floats, Indices
from pipeline.errors import FrameError
from pipeline.mesh.halfedge_mesh import WORTH_SHARING, HalfedgeMesh
from pipeline.resample._kernels_collapse import collapse_due
from pipeline.resample._kernels_flip import MOST_AGAIN
from pipeline.resample._kernels_judge import REASONS, TOO_LONG
from pipeline.resample._kernels_lists import DUE, REFUSED, Changes
from pipeline.resample._kernels_place import MOST_AROUND, long_around
from pipeline.resample._kernels_ring import MOST_SPOKES, new_ring
from pipeline.resample._kernels_scan import (
    BLOCK,
    CHUNK,
    extent,
    find_odd,
    find_odd_together,
    list_long,
    list_odd,
)
from pipeline.resample._kernels_shape import list_poor
from pipeline.resample._kernels_split import BIRTH, LEAVING, longest_first, split_pass
from pipeline.resample._kernels_tidy import tidy
from pipeline.resample.placement.base import Placement
from pipeline.resample.report import Report
from pipeline.resample.thresholds import Thresholds
from pipeline.resample.triangle_shape import Shape

_MOST_PLACED = 16  # passes; an edge halved that often has been stretched 65,000-fold in one frame
_ALLOWANCE = 1.2  # times the maximum: how long an edge may be for a moment, so that a short one can go
_RINGS = (new_ring(), new_ring())
_AGAIN: Indices = np.empty(MOST_AGAIN + 1, np.int32)


class Frame:
    """A surface while its edges are brought into the bracket, step after step."""

    def __init__(
        self, mesh: HalfedgeMesh, thresholds: Thresholds, placement: Placement, shape: Shape
    ) -> None:
        self.mesh, self.thresholds, self.placement, self.shape = mesh, thresholds, placement, shape
        self.limits = _limits(mesh, thresholds, placement, shape)
        self.splits = self.collapses = self.flips = self.passes = self.relaxed = self.on_chord = 0
        self.changes = changes_of(mesh)
        wipe(self.changes)
        self.faces = int(mesh.sizes[1])  # how many there were

    def scan(self) -> None:
        """Find the edges out of the bracket, and those of clearly obtuse triangles."""
        faces, mesh = self.faces, self.mesh
        chunks, blocks = -(-faces // CHUNK), -(-faces // BLOCK)
        odd, counts = mesh.scratch("odd", faces + chunks), np.empty(chunks, np.int32)
        self.extents = mesh.scratch("extents", 2 * blocks, np.float64)[: 2 * blocks].reshape(-1, 2)
        look = find_odd_together if 3 * faces > WORTH_SHARING else find_odd
        total = look(mesh.surface, faces, self.limits, odd, counts, self.extents)
        if not math.isfinite(total):
            size = np.abs(mesh.vertices).max(axis=1)
            wild = int(np.argmax(np.where(np.isnan(size), math.inf, size)))
            raise FrameError(
                f"vertex {wild} has left the numbers: {mesh.vertices[wild]}; calm the flow there"
            )
        many = int(counts.sum())
        self.longs, self.obtuse = _work_list(3 * many), _work_list(many)
        list_odd(mesh.surface, self.limits, odd, counts, self.longs, self.obtuse, self.changes)

    def split_long_edges(self) -> None:
        """Pass after pass until none is too long; every pass takes the longest first (P25)."""
        while self.longs[0]:
            room, first = int(self.longs[0]), int(self.mesh.sizes[0])
            self._keep_to_budget(room)
            self.mesh.reserve(room, 2 * room)
            self.changes = changes_of(self.mesh)
            later, births = _work_list(10 * room), _work_list(BIRTH * room)
            order = longest_first(self.mesh.surface, self.longs, self.limits, later)
            split_pass(self.mesh.surface, self.mesh.sizes, self.limits, order, later, births, self.changes)
            self.splits += int(self.mesh.sizes[0]) - first
            self.passes += 1
            born = _items(births).reshape(-1, BIRTH)
            self.mesh.enter_births(born[:, :LEAVING])
            self.longs = self._placed(born, later)

    def _placed(self, births: Indices, later: Indices) -> Indices:
        """Let the placement have the new vertices; answers which edges are then too long."""
        if not self.placement.leaves_chord or not len(births) or self.passes > _MOST_PLACED:
            return later
        self.on_chord += self.placement.place(self.mesh, births, self.limits)
        around = _work_list(int(later[0]) + MOST_AROUND * len(births))
        long_around(self.mesh.surface, births, self.limits, later, around, self.changes)
        return around

    def collapse_short_edges(self) -> None:
        """Collapse, flip and mend, until every edge that is still short has a reason to be (P9)."""
        self.dead = (
            _emptied(self.mesh.scratch("dead faces", 1 + int(self.mesh.sizes[1]))),
            _emptied(self.mesh.scratch("dead vertices", 1 + int(self.mesh.sizes[0]))),
        )
        self._tidy()
        self._mend()
        if self._refused(TOO_LONG).any():
            self._make_room()
            self._mend()
        low, high = extent(self.mesh.surface, self.faces, self.changes, self.extents)
        self.shortest, self.longest = math.sqrt(low), math.sqrt(high)
        self.mesh.fill_holes(_items(self.dead[1]), _items(self.dead[0]))

    def _tidy(self) -> None:
        """Collapse and flip until nothing more can be done."""
        surface = self.mesh.surface
        collapses, flips = tidy(surface, self.limits, _RINGS, self.changes, self.dead, self.obtuse, _AGAIN)
        self.collapses += collapses
        self.flips += flips

    def _mend(self) -> None:
        """Move the vertices of badly shaped triangles within the surface (P36), where that is possible."""
        for _ in range(self.shape.rounds if self.placement.knows_surroundings else 0):
            spokes, seen = (
                _work_list(3 * int(self.changes.changed[0])),
                np.zeros(self.mesh.sizes[0], np.uint8),
            )
            list_poor(self.mesh.surface, self.shape.roundness, self.changes, seen, spokes)
            if not spokes[0]:
                return
            moved = self.placement.relax(self.mesh, spokes, self.limits, self.changes)
            self.relaxed += moved
            if not moved:
                return
            self._tidy()

    def _make_room(self) -> None:
        """Let go short edges that only a too long one keeps, and split that one instead."""
        self.changes.notes[self._refused(TOO_LONG)] = DUE
        self.limits[6] = _ALLOWANCE**2
        self.collapses += collapse_due(self.mesh.surface, self.limits, _RINGS, self.changes, *self.dead)
        self.limits[6] = 1.0
        self.longs = _work_list(3 * int(self.changes.fresh[0]))
        list_long(self.mesh.surface, self.limits, self.changes, self.longs)
        self.split_long_edges()
        more_faces, more_vertices = (int(size) for size in self.mesh.sizes[::-1])
        self.dead = (
            self.mesh.scratch("dead faces", 1 + more_faces),
            self.mesh.scratch("dead vertices", 1 + more_vertices),
        )
        self._tidy()

    def _refused(self, reason: int) -> Indices:
        """The short edges that were refused for that reason, each by a half-edge."""
        waiting = _items(self.changes.shorts)
        chosen: Indices = waiting[self.changes.notes[waiting] == REFUSED + reason]
        return chosen

    def _keep_to_budget(self, more: int) -> None:
        vertices, budget = int(self.mesh.sizes[0]), self.thresholds.max_vertices
        if vertices + more > budget:
            corners = self.mesh.vertices[self.mesh.faces]
            longest = float(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max())
            raise FrameError(
                f"{vertices} vertices and {more} edges to split exceed the budget of {budget} vertices "
                f"(longest edge {longest:g}, allowed {math.sqrt(self.limits[0]):g}); "
                "raise max_vertices or max_edge_length"
            )

    def report(self) -> Report:
        waiting = self.changes.notes[_items(self.changes.shorts)]
        refused = np.bincount(waiting, minlength=REFUSED + len(REASONS))[REFUSED:]
        return Report(
            splits=self.splits,
            collapses=self.collapses,
            flips=self.flips,
            passes=self.passes,
            vertices=int(self.mesh.sizes[0]),
            faces=int(self.mesh.sizes[1]),
            edges=self.mesh.edges,
            too_long=int(self.longs[0]),
            too_short=len(waiting),
            relaxed=self.relaxed,
            on_chord=self.on_chord,
            shortest=self.shortest,
            longest=self.longest,
            refused={reason: int(n) for reason, n in zip(REASONS, refused, strict=True) if n},
        )


def changes_of(mesh: HalfedgeMesh) -> Changes:
    """The notes of a frame, with room for all faces that the mesh has room for."""
    halfedges = len(mesh.surface.vert)
    faces = halfedges // 3
    return Changes(
        mesh.scratch("marks", faces, np.uint8),
        mesh.scratch("changed", faces + 1),
        mesh.scratch("fresh", faces + 1),
        mesh.scratch("notes", halfedges, np.uint8),
        mesh.scratch("shorts", halfedges + 8 * MOST_SPOKES),
    )


def wipe(changes: Changes) -> None:
    """Begin anew: no face has changed, and no edge is listed."""
    for work_list in (changes.changed, changes.fresh, changes.shorts):
        work_list[0] = 0
    changes.marks.fill(0)
    changes.notes.fill(0)


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
    at_rest = placement.at_rest(mesh)
    return np.array([longest * longest, shortest * shortest, cosine, midpoint, column, obtuse, 1.0, *at_rest])


def _work_list(room: int) -> Indices:
    """An empty list for kernels: the first entry counts those that follow."""
    items = np.empty(room + 1, np.int32)
    items[0] = 0
    return items


def _emptied(work_list: Indices) -> Indices:
    work_list[0] = 0
    return work_list


def _items(work_list: Indices) -> Indices:
    return work_list[1 : 1 + work_list[0]]
