"""The adaptive resampler: split what is too long, collapse what is too short, once a frame.

Reynolds, *Adaptive Polyhedral Resampling for Vertex Flow Animation* (1991), the deltahedral version.
It looks at the geometry of one moment only and knows nothing of what moved it (P2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points, Vectors
from pipeline.errors import FrameError, UsageError
from pipeline.mesh.halfedge import HalfedgeMesh
from pipeline.mesh.triangles import TriangleMesh
from pipeline.resample._kernels_collapse import REASONS, collapse_all
from pipeline.resample._kernels_flip import flip_marked
from pipeline.resample._kernels_place import BIRTH, MOST_AROUND, long_around
from pipeline.resample._kernels_ring import new_ring
from pipeline.resample._kernels_scan import BLOCK, extent, look_again, scan
from pipeline.resample._kernels_split import longest_first, split_pass
from pipeline.resample.locality import in_memory_order
from pipeline.resample.placement import Chord, Placement
from pipeline.resample.report import Report
from pipeline.resample.thresholds import Thresholds

_CHORD = Chord()
_ATTRIBUTE = "attribute."
_MOST_PLACED = 16  # passes; an edge halved that often has been stretched 65,000-fold in one frame


class Resampler:
    """A surface in flow: move `vertices`, then `resample()`, frame after frame.

    mesh         what to begin with: finite, oriented, manifold; open or closed (MeshError otherwise)
    thresholds   the bracket; may be replaced between frames
    placement    where new vertices go

    Vertex attributes go along: a new vertex gets the mean of its parents', a merged one the survivor's
    (integers and flags are never mixed).
    """

    def __init__(self, mesh: TriangleMesh, thresholds: Thresholds, placement: Placement = _CHORD) -> None:
        self.thresholds = thresholds
        self.placement = placement
        self._mesh = HalfedgeMesh(in_memory_order(placement.prepare(mesh, thresholds.hard_angles(mesh))))

    @property
    def vertices(self) -> Points:
        """(V, 3) float64 view: write the moved positions into it. `resample` makes it another array."""
        return self._mesh.vertices

    def vectors(self, name: str) -> Vectors | None:
        """(V, 3) float64 view of a vertex attribute of vectors, to write into like `vertices`; None without."""
        column = self._mesh.column(name)
        return (
            None if column is None else self._mesh.surface.carried[: self._mesh.sizes[0], column : column + 3]
        )

    @property
    def mesh(self) -> TriangleMesh:
        """The surface as a value, vertices in the order of `vertices`; that of faces is ours."""
        return self._mesh.snapshot()

    def state(self) -> dict[str, AnyArray]:
        """Copies of all that the next frames depend on, by name: ``numpy.savez(file, **state)`` keeps it."""
        mesh = self.mesh
        named = {_ATTRIBUTE + name: values for name, values in mesh.attributes.items()}
        return {"vertices": mesh.vertices, "faces": mesh.faces, "creases": mesh.creases, **named}

    @classmethod
    def from_state(
        cls, state: Mapping[str, AnyArray], thresholds: Thresholds, placement: Placement = _CHORD
    ) -> Resampler:
        """Go on from a `state`, bit for bit as if never stopped. Names it does not know are left alone."""
        missing = {"vertices", "faces"} - set(state)
        if missing:
            raise UsageError(
                f"the state holds no {' and no '.join(sorted(missing))}; it cannot be resumed from"
            )
        attributes = {n.removeprefix(_ATTRIBUTE): state[n] for n in state if n.startswith(_ATTRIBUTE)}
        resumed = cls.__new__(cls)  # not by __init__, which may order faces anew
        resumed.thresholds, resumed.placement = thresholds, placement
        creases = state.get("creases")
        resumed._mesh = HalfedgeMesh(TriangleMesh(state["vertices"], state["faces"], attributes, creases))
        return resumed

    def resample(self) -> Report:
        """Bring the edges into the bracket again, in place.

        Raises FrameError where a vertex is not finite or the budget of vertices does not suffice; the
        surface is then still a sound one.
        """
        frame = _Frame(self._mesh, self.thresholds, self.placement)
        frame.scan()
        frame.split_long_edges()
        frame.collapse_short_edges()
        return frame.report()


def resample(
    mesh: TriangleMesh, thresholds: Thresholds, placement: Placement = _CHORD
) -> tuple[TriangleMesh, Report]:
    """One resampling of one mesh; for a film keep a `Resampler`, which keeps the connectivity."""
    resampler = Resampler(mesh, thresholds, placement)
    report = resampler.resample()
    return resampler.mesh, report


class _Frame:
    """One resampling: its work lists, counters and steps."""

    def __init__(self, mesh: HalfedgeMesh, thresholds: Thresholds, placement: Placement) -> None:
        self.mesh, self.thresholds, self.placement = mesh, thresholds, placement
        self.limits = _limits(mesh, thresholds, placement)
        self.splits = self.collapses = self.flips = self.passes = self.on_chord = 0
        self.refused: Indices = np.zeros(len(REASONS), np.int64)
        faces = int(mesh.sizes[1])
        self.marks = np.zeros(faces, np.uint8)
        self.extents: Points = np.empty((-(-faces // BLOCK), 2))

    def scan(self) -> None:
        """Find the edges out of the bracket."""
        self.longs, self.shorts = _work_list(self.mesh.edges), _work_list(2 * self.mesh.edges)
        faces = self.mesh.sizes[1]
        total = scan(self.mesh.surface, faces, self.limits, self.longs, self.shorts, self.extents)
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
        if isinstance(self.placement, Chord) or self.passes > _MOST_PLACED:
            return later
        self.on_chord += self.placement.place(self.mesh, births, self.limits[2])
        around = _work_list(later[0] + MOST_AROUND * len(births))
        long_around(self.mesh.surface, births, self.limits, later, around)
        return around

    def collapse_short_edges(self) -> None:
        """Collapse, flip and look again, until every edge that is still short has a reason to be (P9)."""
        self.dead_faces = _work_list(int(self.mesh.sizes[1]))
        self.dead_vertices = _work_list(int(self.mesh.sizes[0]))
        changed = self._collapse() or self.splits
        while changed:
            self._flip()
            if self._all_settled():
                break
            self._look_again()
            changed = self._collapse()
        self.mesh.fill_holes(_items(self.dead_vertices), _items(self.dead_faces))

    def _all_settled(self) -> bool:
        """Whether nothing can be left to do: every edge that became short was listed, and has collapsed."""
        overflow = self.shorts[0] + 1 == len(self.shorts)
        settled = not (overflow or self.refused.any()) and isinstance(self.placement, Chord)
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
        self.flips += flip_marked(self.mesh.surface, faces, self.limits, self.marks, edges)

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
            on_chord=self.on_chord,
            shortest=low,
            longest=high,
            refused=refused,
        )


def _limits(mesh: HalfedgeMesh, thresholds: Thresholds, placement: Placement) -> Floats:
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
    return np.array([longest * longest, shortest * shortest, math.cos(hard_angle), midpoint, column])


def _work_list(room: int) -> Indices:
    """An empty list for kernels: the first entry counts those that follow."""
    items = np.empty(room + 1, np.int32)
    items[0] = 0
    return items


def _items(work_list: Indices) -> Indices:
    return work_list[1 : 1 + work_list[0]]
