"""Split faces with a long edge into four, all at once (P26); the alternative to splitting edges.

After Miller, Breen, Lorensen, O'Bara and Wozny, *Geometrically deformed models: a method for extracting
closed geometric models from volume data* (1991), and Miller's thesis of 1990, as the paper compares them.
Splitting edges makes fewer vertices (P25); this method keeps the shapes of the faces that it cuts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Faces, Floats, Indices, Points
from pipeline.mesh.meshes import TriangleMesh, edge_keys
from pipeline.resample.thresholds import Thresholds
from pipeline.resample.vertex_budget import require_room

_NONE = np.empty((0, 2), np.int32)
_NO_GRADATION = 1e12  # changes nothing: the fields have been graded before


class Quadrisected(NamedTuple):
    """A surface whose faces have been cut.

    mesh        old vertices first; faces in the order of the faces they are parts of
    thresholds  the thresholds used, with functions replaced by their values; new vertices have mixed values
    parents     (N, 2) the two parents of each new vertex, in order; may name earlier new vertices
    passes      rounds of cutting
    """

    mesh: TriangleMesh
    thresholds: Thresholds
    parents: Indices
    passes: int


def quadrisect(mesh: TriangleMesh, thresholds: Thresholds) -> Quadrisected:
    """Cut every face with a long edge into four at the midpoints of its edges, until no edge is too long.

    Neighbours are cut into two, three or four at the same midpoints, so that the surface stays conforming.
    Attributes mix; integers and flags are those of the parent with the lower number; the two halves of a
    crease are creases. Active thresholds are evaluated once and mix like attributes.

    Raises FrameError where the vertices would exceed the budget, and UsageError like `Thresholds.fields`.
    """
    fields = thresholds.fields(mesh) if thresholds.active else None
    longest = None if fields is None else fields[:, 0]
    parents: list[Indices] = []
    while True:
        edges = _Edges.of(mesh.faces)
        cut = _to_cut(mesh, edges, thresholds.numbers[0] if longest is None else longest)
        if not cut.any():
            fixed = thresholds if fields is None else _fixed(fields, thresholds)
            return Quadrisected(mesh, fixed, np.concatenate([_NONE, *parents]), len(parents))
        require_room(len(mesh.vertices), int(cut.sum()), thresholds.max_vertices)
        ends = edges.ends[cut]
        mesh = _cut(mesh, edges, cut)
        if fields is not None:
            fields = _mixed(fields, ends)
            longest = fields[:, 0]
        parents.append(ends)


class _Edges(NamedTuple):
    """Every edge once, and the edges of each face.

    ends   (E, 2) their vertices, the lower first, sorted
    sides  (F, 3) int64 of each face: the edges from its corners 0, 1 and 2 to the next
    """

    ends: Indices
    sides: AnyArray

    @classmethod
    def of(cls, faces: Faces) -> _Edges:
        pairs = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
        keys, sides = np.unique(edge_keys(pairs), return_inverse=True)
        ends = np.column_stack(np.divmod(keys, np.int64(1) << 32)).astype(np.int32)
        return cls(ends, sides.reshape(-1, 3))


def _to_cut(mesh: TriangleMesh, edges: _Edges, longest: float | Floats) -> AnyArray:
    """Return flags (E,): True for edges of a face with a long edge."""
    a, b = edges.ends.T
    allowed = longest * longest if isinstance(longest, float) else longest[a] * longest[b]
    apart = mesh.vertices[a] - mesh.vertices[b]
    long = (apart**2).sum(axis=1) > allowed
    cut = np.zeros(len(edges.ends), np.bool_)
    cut[edges.sides[long[edges.sides].any(axis=1)]] = True
    return cut


def _cut(mesh: TriangleMesh, edges: _Edges, cut: AnyArray) -> TriangleMesh:
    """Insert a vertex in the middle of each edge to cut, and replace the faces."""
    ends, first = edges.ends[cut], len(mesh.vertices)
    middles = np.full(len(edges.ends), -1, np.int32)
    middles[cut] = np.arange(first, first + len(ends), dtype=np.int32)
    vertices = _mixed(mesh.vertices, ends)
    faces = _pieces(vertices, mesh.faces, middles[edges.sides])
    attributes = {name: _mixed(values, ends) for name, values in mesh.attributes.items()}
    return TriangleMesh(vertices, faces, attributes, _halved(mesh.creases, edges, middles))


def _mixed(values: AnyArray, ends: Indices) -> AnyArray:
    """Append one value for each pair of `ends` (N, 2) to values (V, …)."""
    low, high = values[ends[:, 0]], values[ends[:, 1]]
    between = (0.5 * (low + high)).astype(values.dtype) if values.dtype.kind == "f" else low
    return np.concatenate([values, between])


def _halved(creases: Indices, edges: _Edges, middles: Indices) -> Indices:
    """Return creases (K, 2) with cut edges replaced by their halves."""
    if not len(creases):
        return creases
    middle = middles[np.searchsorted(edge_keys(edges.ends), edge_keys(creases))]
    whole, two = creases[middle < 0], middle >= 0
    halves = [np.column_stack([end, middle[two]]) for end in creases[two].T]
    return np.concatenate([whole, *halves])


_TURNED = [[0, 1, 2, 3, 4, 5], [1, 2, 0, 4, 5, 3], [2, 0, 1, 5, 3, 4]]
"""Slots of a face, its corners and the midpoints of its sides, as seen from each of its corners."""


def _patterns() -> tuple[AnyArray, AnyArray]:
    """Return the pieces of a face by case, (16, 4, 3) slots, and their number (16,).

    A case is the sum of 1, 2 and 4 for the sides 0, 1 and 2 that are cut, and of 8 where two are and the
    piece between them is cut along its second diagonal.
    """
    table, count = np.zeros((16, 4, 3), np.int64), np.zeros(16, np.int64)
    cases = {0: [(0, 1, 2)], 7: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]}
    for turn, slots in enumerate(_TURNED):
        one, two = 1 << turn, (1 << turn) + (1 << (turn + 1) % 3)
        cases[one] = _seen([(0, 3, 2), (3, 1, 2)], slots)
        cases[two] = _seen([(3, 1, 4), (0, 3, 4), (0, 4, 2)], slots)
        cases[two + 8] = _seen([(3, 1, 4), (0, 3, 2), (3, 4, 2)], slots)
    for case, pieces in cases.items():
        table[case, : len(pieces)], count[case] = pieces, len(pieces)
    return table, count


def _seen(pieces: list[tuple[int, int, int]], slots: list[int]) -> list[tuple[int, int, int]]:
    return [(slots[a], slots[b], slots[c]) for a, b, c in pieces]


_PIECES, _COUNTS = _patterns()


def _pieces(points: Points, faces: Faces, middles: Indices) -> Faces:
    """Return faces (F', 3) cut at the midpoints (F, 3) of their sides, -1 where a side is whole."""
    slots = np.concatenate([faces, middles], axis=1)
    case = (middles >= 0) @ np.array([1, 2, 4])
    for turn, turned in enumerate(_TURNED):
        where = np.flatnonzero(case == (1 << turn) + (1 << (turn + 1) % 3))
        a, _, c, p, q, _ = slots[where][:, turned].T
        second = _distances(points, p, c) < _distances(points, a, q)
        case[where[second]] += 8
    pieces = np.take_along_axis(slots[:, None, :], _PIECES[case].reshape(len(faces), 1, -1), axis=2)
    used = np.arange(4) < _COUNTS[case][:, None]
    return pieces.reshape(len(faces), 4, 3)[used]


def _distances(points: Points, a: Indices, b: Indices) -> Floats:
    """Return squared distances (N,)."""
    return ((points[a] - points[b]) ** 2).sum(axis=1)


def _fixed(fields: Floats, thresholds: Thresholds) -> Thresholds:
    """Return thresholds with these (V, 3) fields on any mesh."""
    longest, shortest, angle = (lambda mesh, values=values: values for values in fields.T)
    return Thresholds(longest, shortest, angle, thresholds.max_vertices, _NO_GRADATION)
