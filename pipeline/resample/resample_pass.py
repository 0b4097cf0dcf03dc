"""One resample pass over a surface: find edges, split, collapse, flip, relax, compact; and its report.

Lengths of edges are compared with the limits of their ends, `length_limits` in `kernels/pass_state.py`: the
maximum and the minimum are the `Thresholds`, and where these vary, the geometric means of the values at both
ends.

An edge is split while it is longer than its maximum (`ResamplePass.split_long_edges`); the `Placement` moves
the new vertex from the middle of the edge. An edge collapses if it is shorter than its minimum (`is_short`),
and if `can_collapse` in `kernels/collapse.py` finds a place for the merged vertex that breaks none of the
rules in `Report.refused`. Edges between the two limits stay, with two exceptions: where a vertex of valence
three keeps a short edge from collapsing, an edge of that vertex collapses first; and `make_room` lets a
collapse lengthen an edge by a fifth over the maximum, and splits it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from flowsculpt.pipeline.arrays import Faces, Indices, Points
from flowsculpt.pipeline.errors import FlowsculptError, FrameError, VertexBudgetError
from flowsculpt.pipeline.long_computations import Progress, interruptible
from flowsculpt.pipeline.mesh.halfedge_mesh import WORTH_SHARING, HalfedgeMesh
from flowsculpt.pipeline.resample.kernels.collapse import REASONS, TOO_LONG, collapse_and_flip
from flowsculpt.pipeline.resample.kernels.edge_scans import (
    BLOCK,
    CHUNK,
    flag_faces,
    flag_faces_parallel,
    length_range,
    list_flagged_edges,
    list_long_edges,
)
from flowsculpt.pipeline.resample.kernels.flip import MAX_STACK, count_tangled, untangle
from flowsculpt.pipeline.resample.kernels.pass_state import (
    MAX_SPOKES,
    QUEUED,
    REFUSED,
    Changes,
    Limits,
    items_of,
    new_ring,
    work_list,
)
from flowsculpt.pipeline.resample.kernels.rest_surface import list_poor_vertices
from flowsculpt.pipeline.resample.kernels.split import (
    BIRTH_HALFEDGE,
    BIRTH_SIZE,
    MAX_SPOKES_OF_NEW,
    classify_around,
    longest_edges_first,
    split_edges,
)
from flowsculpt.pipeline.resample.placement import Placement
from flowsculpt.pipeline.resample.thresholds import Thresholds, TriangleShape
from flowsculpt.render.base.plural import plural


@dataclass(frozen=True)
class Report:
    """Counts of one frame.

    splits, collapses, flips   operations done
    passes                     rounds of splitting until no edge was too long
    refused                    edges still too short, by the reason why they may not collapse:
                               link       the surface would no longer be a manifold
                               boundary   two boundaries would meet, or a boundary triangle vanish
                               feature    two corners or two creases would become one
                               too_long   an edge over the maximum would appear
                               fold       a face would turn over or become a sliver
                               shape      a tendril would lose over 5% of the maximum edge at its tip
                               crowded    an end has more than 511 neighbours
    vertices, faces, edges     counts after the pass
    too_long, too_short        edges outside their limits; too_long is 0, too_short the sum of `refused`
    shortest, longest          edge lengths, scene units
    relaxed                    vertices moved within the surface for the shape of their triangles
    on_chord                   new vertices left at the middle of their edge, because the surface would have
                               folded at their proper place
    """

    splits: int
    collapses: int
    flips: int
    passes: int
    vertices: int
    faces: int
    edges: int
    too_long: int
    too_short: int
    shortest: float
    longest: float
    relaxed: int = 0
    on_chord: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)

    @property
    def within_limits(self) -> float:
        """Share of the edges within their length limits, 0 to 1."""
        return 1.0 - (self.too_long + self.too_short) / self.edges


@dataclass(frozen=True)
class PolygonReport(Report):
    """Counts of one frame of polygons.

    splits           vertices inserted into edges
    cuts             faces cut in two
    average_sides    mean number of sides a face: the drift towards triangles (P21)
    widest           the longest side of any face's bounding box, scene units
    refused          besides the reasons of `Report`, `area`: where faces collapse instead of edges, an edge
                     whose faces are large enough
    """

    cuts: int = 0
    average_sides: float = 3.0
    widest: float = 0.0


_SHARE_OF_BOUND = 1.01  # a surface of equilateral triangles takes a little fewer vertices than faces / 2


def require_room(vertices: int, more: int, budget: int, lengths: str = "") -> None:
    """Raise VertexBudgetError where that many splits would exceed the budget.

    vertices  those of the surface, without collapsed ones
    lengths   a clause on edge lengths, for the message
    """
    if vertices + more > budget:
        raise VertexBudgetError(
            f"{vertices} vertices and {plural(more, 'edge')} to split exceed the budget of {budget} "
            f"vertices{lengths}"
        )


def require_room_for_area(points: Points, faces: Faces, longest: float, budget: int) -> None:
    """Raise VertexBudgetError where even the largest triangles allowed, equilateral ones, are too many."""
    a, b, c = (points[corners] for corners in faces.T)
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    needed = 0.5 * area / (math.sqrt(3.0) / 4.0 * longest**2)  # half as many vertices as faces
    if needed > _SHARE_OF_BOUND * budget:
        raise VertexBudgetError(
            f"a surface of {area:.3g} square units takes at least {needed:,.0f} vertices where edges are "
            f"{longest:g} units long at most, which exceeds the budget of {budget}"
        )


_MANY_FACES = 200_000  # from which on one compiled call may take over a second
_ALL_UPRIGHT = "all upright"  # name of the mesh's mark
_SLACK = 1.2  # times the maximum: the length an edge may have until `make_room` splits it


class ResamplePass:
    """A surface while one pass brings its edges within their length limits.

    most_placed  rounds of splits whose vertices are placed; an edge that is halved 16 times has been
                 stretched 65,000-fold in one frame
    """

    most_placed: ClassVar[int] = 16

    def __init__(
        self, mesh: HalfedgeMesh, thresholds: Thresholds, placement: Placement, shape: TriangleShape
    ) -> None:
        self.mesh, self.thresholds, self.placement, self.shape = mesh, thresholds, placement, shape
        self.limits = _limits(mesh, thresholds, placement, shape)
        self.splits = self.collapses = self.flips = self.passes = self.relaxed = self.on_chord = 0
        self.changes = changes_of(mesh)
        reset(self.changes)
        self.vertices, self.faces = (int(size) for size in mesh.sizes)  # before this pass
        self._scratch = (new_ring(), new_ring()), np.empty(MAX_STACK + 1, np.int32)
        self._dead = work_list(0), work_list(0)  # removed faces and vertices, still in the arrays
        # 1 if no face looked inwards at rest after the last pass: then only changed ones can
        self._all_upright, self._tangled = mesh.scratch(_ALL_UPRIGHT, 1), 0

    def find_edges(self) -> None:
        """Find the edges outside their limits, and those opposite clearly obtuse corners."""
        faces, mesh = self.faces, self.mesh
        chunks, blocks = -(-faces // CHUNK), -(-faces // BLOCK)
        flagged, counts = mesh.scratch("flagged", faces + chunks), np.empty(chunks, np.int32)
        self.block_ranges = mesh.scratch("ranges", 2 * blocks, np.float64)[: 2 * blocks].reshape(-1, 2)
        flag = flag_faces_parallel if 3 * faces > WORTH_SHARING else flag_faces
        total = flag(mesh.arrays, faces, self.limits, flagged, counts, self.block_ranges)
        if not math.isfinite(total):
            raise not_finite(mesh.vertices)
        count = int(counts.sum())
        self.long_edges, self.obtuse_edges = work_list(3 * count), work_list(count)
        list_flagged_edges(
            mesh.arrays, self.limits, flagged, counts, self.long_edges, self.obtuse_edges, self.changes
        )

    def run(self) -> Report:
        """Bring the edges found by `find_edges` within their limits.

        Raises FrameError where the vertices would exceed the budget or a placement fails; the surface is then
        sound, with the changes made so far.
        """
        try:
            self.split_long_edges()
            for step in (
                self.collapse_short_edges,
                self.untangle,
                self.relax_vertices,
                self.make_room,
            ):
                self._call(step)
            if self.limits.normal_column >= 0:  # steps since then may have made faces that oppose them
                self._call(self.untangle)
        except FlowsculptError:
            self._close_gaps()
            raise
        self._call(self.compact)
        return self._report()

    def _call(self, step: Callable[[], None]) -> None:
        """Call a step; Ctrl-C ends it at once on a surface for which it may take seconds."""
        if self.mesh.sizes[1] > _MANY_FACES:
            interruptible(step)
        else:
            step()

    def split_long_edges(self) -> None:
        """Split, longest edges first, until no edge is too long (P25)."""
        while self.long_edges[0]:
            self._call(self._split_round)

    def _split_round(self) -> None:
        room, first = int(self.long_edges[0]), int(self.mesh.sizes[0])
        remaining, births = work_list(10 * room), work_list(BIRTH_SIZE * room)
        order = longest_edges_first(self.mesh.arrays, self.long_edges, self.limits, remaining)
        self._keep_to_budget(order)
        self.mesh.reserve(len(order), 2 * len(order))
        self.changes = changes_of(self.mesh)
        arrays = self.mesh.arrays
        split_edges(arrays, self.mesh.sizes, self.limits, order, remaining, births, self.changes)
        self.splits += int(self.mesh.sizes[0]) - first
        self.passes += 1
        born = items_of(births).reshape(-1, BIRTH_SIZE)
        self.mesh.enter_births(born[:, :BIRTH_HALFEDGE])
        self.long_edges = self._place(born, remaining)
        Progress("resampling", int(self.mesh.sizes[0]), 0).report()

    def _place(self, births: Indices, remaining: Indices) -> Indices:
        """Move the new vertices to where the placement has them; return the edges that are then too long."""
        most = max(self.most_placed, self.placement.most_rounds)
        if not self.placement.leaves_chord or not len(births) or self.passes > most:
            return remaining
        self.on_chord += self.placement.place(self.mesh, births, self.limits)
        long_edges = work_list(int(remaining[0]) + MAX_SPOKES_OF_NEW * len(births))
        classify_around(self.mesh.arrays, births, self.limits, remaining, long_edges, self.changes)
        return long_edges

    def collapse_short_edges(self) -> None:
        """Collapse short edges and flip badly shaped ones, until no short edge can collapse (P9)."""
        self._dead = self._dead_lists()
        self._dead[0][0] = self._dead[1][0] = 0
        self._collapse_and_flip()

    def _dead_lists(self) -> tuple[Indices, Indices]:
        """Return the work lists of removed faces and vertices, as they are, with room for all."""
        vertices, faces = (int(size) for size in self.mesh.sizes)
        return self.mesh.scratch("dead faces", 1 + faces), self.mesh.scratch("dead vertices", 1 + vertices)

    def _collapse_and_flip(self, limits: Limits | None = None, flips_too: bool = True) -> None:
        rings, stack = self._scratch
        collapses, flips = collapse_and_flip(
            self.mesh.arrays,
            limits or self.limits,
            rings,
            self.changes,
            self._dead,
            self.obtuse_edges,
            stack,
            flips_too,
        )
        self.collapses += collapses
        self.flips += flips

    def untangle(self) -> None:
        """Flip edges of faces that look inwards at rest or oppose their normals, where fewer then do."""
        if self.limits.rest_column < 0:
            return
        if self._all_upright[0] and self.limits.normal_column < 0:
            faces = np.sort(items_of(self.changes.changed))
        else:  # a face that has not changed may by now be able to
            faces = np.arange(self.mesh.sizes[1], dtype=np.int32)
        flips, self._tangled = untangle(self.mesh.arrays, faces, self.limits, self.changes)
        self._all_upright[0] = 0
        self.flips += flips
        if flips:
            self._collapse_and_flip()

    def relax_vertices(self) -> None:
        """Move the vertices of badly shaped triangles within the surface (P36), if the placement can."""
        for _ in range(self.shape.rounds if self.placement.can_relax else 0):
            spokes = work_list(3 * int(self.changes.changed[0]))
            seen = np.zeros(self.mesh.sizes[0], np.uint8)
            list_poor_vertices(self.mesh.arrays, self.shape.min_roundness, self.changes, seen, spokes)
            if not spokes[0]:
                return
            moved = self.placement.relax(self.mesh, spokes, self.limits, self.changes)
            self.relaxed += moved
            if not moved:
                return
            self._collapse_and_flip()

    def make_room(self) -> None:
        """Collapse short edges that only a long edge would forbid, then split that one."""
        waiting = items_of(self.changes.short_edges)
        refused = waiting[self.changes.edge_states[waiting] == REFUSED + TOO_LONG]
        if not refused.any():
            return
        self.changes.edge_states[refused] = QUEUED
        self._collapse_and_flip(self.limits._replace(squared_slack=_SLACK**2), flips_too=False)
        self.long_edges = work_list(3 * int(self.changes.fresh[0]))
        list_long_edges(self.mesh.arrays, self.limits, self.changes, self.long_edges)
        self.split_long_edges()
        self._dead = self._dead_lists()
        self._collapse_and_flip()
        self.relax_vertices()

    def compact(self) -> None:
        """Measure the edges and close the gaps that removed faces and vertices left in the arrays."""
        low, high = length_range(self.mesh.arrays, self.faces, self.changes, self.block_ranges)
        self.shortest, self.longest = math.sqrt(low), math.sqrt(high)
        if self.limits.rest_column >= 0 and not self._tangled:
            self._all_upright[0] = not count_tangled(self.mesh.arrays, self.limits, self.changes)
        self._close_gaps()

    def _close_gaps(self) -> None:
        changed = items_of(self.changes.changed)
        self.mesh.compact(items_of(self._dead[1]), items_of(self._dead[0]), changed, self.vertices)

    def _keep_to_budget(self, splits: Indices) -> None:
        """Raise VertexBudgetError where splits at these half-edges exceed the budget; edges may recur.

        Vertices that have collapsed do not count: `make_room` splits while they are still in the arrays.
        """
        vertices, budget = int(self.mesh.sizes[0] - self._dead[1][0]), self.thresholds.max_vertices
        longest = self.limits.max_edge_length
        if not self.passes and 4 * len(splits) > vertices:
            require_room_for_area(self.mesh.vertices, self.mesh.faces, longest, budget)
        if vertices + len(splits) > budget:
            more = len(np.unique(np.maximum(splits, self.mesh.arrays.twin[splits])))
            corners = self.mesh.vertices[self.mesh.faces]
            sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
            require_room(vertices, more, budget, f" (longest edge {sides.max():g}, allowed {longest:g})")

    def _report(self) -> Report:
        waiting = self.changes.edge_states[items_of(self.changes.short_edges)]
        refused = np.bincount(waiting, minlength=REFUSED + len(REASONS))[REFUSED:]
        return Report(
            splits=self.splits,
            collapses=self.collapses,
            flips=self.flips,
            passes=self.passes,
            vertices=int(self.mesh.sizes[0]),
            faces=int(self.mesh.sizes[1]),
            edges=self.mesh.edges,
            too_long=int(self.long_edges[0]),
            too_short=len(waiting),
            relaxed=self.relaxed,
            on_chord=self.on_chord,
            shortest=self.shortest,
            longest=self.longest,
            refused={reason: int(n) for reason, n in zip(REASONS, refused, strict=True) if n},
        )


def changes_of(mesh: HalfedgeMesh) -> Changes:
    """Return the mesh's record of changes, with room for all faces that the mesh has room for."""
    halfedges = len(mesh.arrays.vert)
    faces = halfedges // 3
    return Changes(
        mesh.scratch("face states", faces, np.uint8),
        mesh.scratch("changed", faces + 1),
        mesh.scratch("fresh", faces + 1),
        mesh.scratch("edge states", halfedges, np.uint8),
        mesh.scratch("short edges", halfedges + 8 * MAX_SPOKES),
    )


def reset(changes: Changes) -> None:
    """Clear the record: no face has changed, and no edge is listed."""
    for items in (changes.changed, changes.fresh, changes.short_edges):
        items[0] = 0
    changes.face_states.fill(0)
    changes.edge_states.fill(0)


def forget_rest(mesh: HalfedgeMesh) -> None:
    """Forget that no face looked inwards at rest: the surface at rest is another now."""
    mesh.scratch(_ALL_UPRIGHT, 1)[0] = 0


def not_finite(vertices: Points) -> FrameError:
    """Return the error for the first vertex that is NaN or infinite, or the one farthest out."""
    size = np.abs(vertices).max(axis=1)
    worst = int(np.argmax(np.where(np.isnan(size), math.inf, size)))
    return FrameError(
        f"vertex {worst} is at {vertices[worst]}, which is not finite or too far away; lower the flow's "
        "strength there or raise its substeps"
    )


def _limits(mesh: HalfedgeMesh, thresholds: Thresholds, placement: Placement, shape: TriangleShape) -> Limits:
    column = -1
    if thresholds.active:
        fields = thresholds.fields(mesh.snapshot())
        max_edge_length, min_edge_length = float(fields[:, 0].max()), float(fields[:, 1].min())
        hard_angle = float(np.median(fields[:, 2]))
        fields[:, 2] = np.cos(fields[:, 2])
        column = mesh.set_fields(fields)
    else:
        max_edge_length, min_edge_length, hard_angle = thresholds.numbers
    return Limits(
        max_edge_length,
        min_edge_length,
        math.cos(hard_angle),
        placement.merges_at_midpoint,
        column,
        shape.longest_share,
        *placement.columns(mesh),
        placement.hard_by_angle,
        thresholds.bends is not None,
    )
