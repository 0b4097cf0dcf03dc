"""A surface at rest that is refined where a flow stretches it: edges are split, and none collapses or flips.

The resampler keeps the edges of one frame within their limits; this keeps one mesh good for many frames. Its
splits are births: each has two parents, the ends of an edge, and they can be replayed on the surface at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple

import numba
import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Floats, Indices, Points
from flowsculpt.pipeline.errors import FrameError, VertexBudgetError
from flowsculpt.pipeline.kernels import kernel
from flowsculpt.pipeline.mesh.halfedge_mesh import CREASE, SEAM, HalfedgeMesh
from flowsculpt.pipeline.mesh.kernels.halfedge import LEAN, MESH_ARRAYS, MeshArrays, following, preceding
from flowsculpt.pipeline.mesh.meshes import TriangleMesh
from flowsculpt.pipeline.mesh.normals import vertex_normals
from flowsculpt.pipeline.resample.kernels.pass_state import Limits
from flowsculpt.pipeline.resample.kernels.split import BIRTH_HALFEDGE, split_edge
from flowsculpt.pipeline.resample.placement import REST, REST_NORMAL, Exact, column_of
from flowsculpt.pipeline.resample.resample_pass import ResamplePass
from flowsculpt.pipeline.resample.thresholds import Thresholds, TriangleShape

_TABLE = numba.int32[:, ::1]


@kernel(numba.int64(MESH_ARRAYS, numba.int64, numba.int64), **LEAN)
def _between(mesh: MeshArrays, start: int, b: int) -> int:
    """Return the half-edge to vertex b from the start of half-edge `start`; -1 where there is none."""
    vert, twin = mesh.vert, mesh.twin
    k = start
    while True:
        if vert[following(k)] == b:
            return k
        k = twin[preceding(k)]
        if k < 0 or k == start:
            break
    k = start
    while k >= 0 and twin[k] >= 0:  # the fan is open: on to its other side
        k = following(twin[k])
        if k == start:
            break
        if vert[following(k)] == b:
            return k
    return -1


@kernel(numba.int64(MESH_ARRAYS, numba.int64[::1], _TABLE, _TABLE))
def replay_births(mesh: MeshArrays, sizes: AnyArray, births: Indices, opposite: Indices) -> int:
    """Split the edges of births (N, 2), parents a and b of each; return how many of them were edges.

    opposite  (N, 2) receives the corners opposite each edge, c left of a→b and d right of it; -1 at a
              boundary

    The arrays must have room. Positions and attributes of the new vertices are left to the caller. It ends at
    the first birth whose parents are not the ends of an edge.
    """
    vert, twin = mesh.vert, mesh.twin
    leaving = np.full(sizes[0] + len(births), -1, np.int32)  # a half-edge of each vertex
    for h in range(3 * sizes[1]):
        leaving[vert[h]] = h
    for i in range(len(births)):
        a, b = births[i, 0], births[i, 1]
        h, left = _between(mesh, leaving[a], b), 0
        if h < 0:  # of an edge of the boundary there is one half-edge
            h, left = _between(mesh, leaving[b], a), 1
        if h < 0:
            return i
        middle, first, back = sizes[0], sizes[1], twin[h]
        opposite[i, left], opposite[i, 1 - left] = vert[preceding(h)], -1
        if back >= 0:
            opposite[i, 1] = vert[preceding(back)]
        sizes[0] = middle + 1
        sizes[1] = split_edge(mesh, h, middle, first)
        for k in range(3 * (h // 3), 3 * (h // 3) + 3):
            leaving[vert[k]] = k
        if back >= 0:
            for k in range(3 * (back // 3), 3 * (back // 3) + 3):
                leaving[vert[k]] = k
        for k in range(3 * first, 3 * sizes[1]):
            leaving[vert[k]] = k
    return len(births)


_TESTED = 8  # rounds of splits in one frame after which the longest edge is tested for a tear, and again
_SHORTEST = 1e-12  # of the largest coordinate: an edge as short at rest that is still too long shows a tear


class Births(NamedTuple):
    """Vertices that splits of edges have made, in their order.

    parents  int32 (N, 2): the ends of the edge that each splits
    rest     float64 (N, 6): their positions and unit normals at rest
    longest  float64 (V,): the maximum edge lengths at all vertices, where they vary; otherwise None
    """

    parents: Indices
    rest: Floats
    longest: Floats | None = None


class RefinableSurface:
    """A surface that only gains vertices. It keeps where they are at rest, and moves as its user says.

    start  the surface at rest, with its creases
    """

    def __init__(self, start: TriangleMesh) -> None:
        normals = vertex_normals(start)
        self._mesh = HalfedgeMesh(replace(start, attributes={REST: start.vertices, REST_NORMAL: normals}))

    @property
    def points(self) -> Points:
        """The present positions (V, 3), which may be written."""
        return self._mesh.vertices

    def mesh(self) -> TriangleMesh:
        """Return the present surface with its tagged creases and seams."""
        tagged = (self._mesh.tagged_edges(tag) for tag in (CREASE, SEAM))
        return TriangleMesh(self._mesh.vertices, self._mesh.faces, {}, *tagged)

    def replay(self, parents: Indices, rest: Floats) -> Indices:
        """Split edges again, as `Births` have them; return the corners (N, 2) opposite each, -1 for none.

        The new vertices are at their positions at rest. Raises FrameError where parents are not the ends of
        an edge.
        """
        mesh, first = self._mesh, int(self._mesh.sizes[0])
        opposite = np.empty((len(parents), 2), np.int32)
        mesh.reserve(len(parents), 2 * len(parents))
        done = replay_births(mesh.arrays, mesh.sizes, np.ascontiguousarray(parents, np.int32), opposite)
        if done < len(parents):
            a, b = parents[done]
            raise FrameError(f"birth {done} splits {a}-{b}, but the refined surface has no such edge")
        self._rest_of(first)[:] = rest
        mesh.vertices[first:] = rest[:, :3]
        return opposite

    def split(
        self,
        thresholds: Thresholds | None,
        carry: Callable[[Points], Points],
        project: Callable[[Points], Points] | None,
    ) -> Births:
        """Split the present edges that are too long, longest first, and return the births.

        thresholds      None where no edge is
        carry, project  as in `Exact`: the flow from rest to the present, and onto the analytic surface

        Raises FrameError where the flow fails, or tears the surface so that no splits end it, and
        VertexBudgetError where it needs too many vertices for another reason.
        """
        if thresholds is None:
            return Births(np.empty((0, 2), np.int32), np.empty((0, 6)))
        first = int(self._mesh.sizes[0])
        placement = _OnSurface(carry, project, tags_creases=False)
        splits = _Splits(self._mesh, thresholds, placement, TriangleShape())
        try:
            longest = splits.run_splits()
        except VertexBudgetError:
            placement.require_whole(self._mesh, splits.limits)
            raise
        parents = np.concatenate([np.empty((0, 2), np.int32), *placement.born])
        return Births(parents, self._rest_of(first).copy(), longest)

    def _rest_of(self, first: int) -> Floats:
        """Return positions and normals at rest (N, 6) of the vertices from `first` on, which may be written.

        Attributes are columns of one array in the order that they were given.
        """
        mesh, start = self._mesh, column_of(self._mesh, REST)
        assert column_of(mesh, REST_NORMAL) == start + 3, "the normal at rest follows the position"
        return mesh.arrays.attributes[first : mesh.sizes[0], start : start + 6]


class _Splits(ResamplePass):
    """A pass that only splits, and places all new vertices: a frame may stretch an edge by any factor."""

    most_placed: ClassVar[int] = 1 << 30

    def run_splits(self) -> Floats | None:
        """Split; return the maximum edge lengths (V,) where they vary, and None where they do not."""
        self.find_edges()
        self.split_long_edges()
        column, mesh = self.limits.field_column, self.mesh
        return None if column < 0 else mesh.arrays.attributes[: mesh.sizes[0], column].copy()


@dataclass(frozen=True)
class _OnSurface(Exact):
    """New vertices on the surface at rest and where the flow carries it, whether faces fold there or not.

    born  the parents (N, 2) of those of each round
    """

    born: list[Indices] = field(default_factory=list)

    def place(self, mesh: HalfedgeMesh, births: Indices, limits: Limits) -> int:
        last = int(mesh.sizes[0])
        middles, _, _ = self._midpoints_at_rest(mesh, births)
        column, born = column_of(mesh, REST), slice(last - len(births), last)
        goals = self._project(middles)
        mesh.arrays.attributes[born, column : column + 3] = goals
        mesh.arrays.points[born] = self._carry(goals)
        self.born.append(births[:, :BIRTH_HALFEDGE].copy())
        if len(self.born) % _TESTED == 0:
            self.require_whole(mesh, limits)
        return 0

    def require_whole(self, mesh: HalfedgeMesh, limits: Limits) -> None:
        """Raise FrameError where the flow tears the longest edge: no part of it at rest is short enough."""
        a, b = _longest_edge(mesh)
        column = column_of(mesh, REST)
        rest = mesh.arrays.attributes[: mesh.sizes[0], column : column + 3]
        ends, shortest = rest[[a, b]], _SHORTEST * float(np.abs(rest).max())
        while np.linalg.norm(ends[1] - ends[0]) > shortest:
            three = np.stack([ends[0], 0.5 * (ends[0] + ends[1]), ends[1]])
            lengths = np.linalg.norm(np.diff(self._carry(three), axis=0), axis=1)
            if lengths.max() <= 0.5 * limits.max_edge_length:
                return
            ends = three[:2] if lengths[0] > lengths[1] else three[1:]
        x, y, z = ends[0]
        raise FrameError(
            f"the flow tears the surface at ({x:.4g}, {y:.4g}, {z:.4g}) at rest, so no mesh follows it; "
            "choose frames before, or export each frame's own mesh"
        )


def _longest_edge(mesh: HalfedgeMesh) -> tuple[int, int]:
    """Return the vertices of the longest edge."""
    corners = mesh.vertices[mesh.faces]
    side = int(np.argmax(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)))
    face, corner = divmod(side, 3)
    return int(mesh.faces[face, corner]), int(mesh.faces[face, (corner + 1) % 3])
