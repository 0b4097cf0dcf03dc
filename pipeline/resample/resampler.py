"""The adaptive resampler: split long edges and collapse short ones, once a frame.

Reynolds, *Adaptive Polyhedral Resampling for Vertex Flow Animation* (1991), the deltahedral version. It
reads the geometry of one frame only and knows nothing of the flow (P2).

Faces with a long edge can be split into four instead, all at once (P26), after Miller, Breen, Lorensen,
O'Bara and Wozny, *Geometrically deformed models: a method for extracting closed geometric models from volume
data* (1991), and Miller's thesis of 1990, as the paper compares them. Splitting edges makes fewer vertices
(P25); quadrisection keeps the shapes of the faces that it cuts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh.halfedge_mesh import HalfedgeMesh, Register
from flowsculpt.pipeline.mesh.meshes import TriangleMesh, edge_keys, morton_order
from flowsculpt.pipeline.resample.placement import Chord, Curved, Placement
from flowsculpt.pipeline.resample.resample_pass import (
    Report,
    ResamplePass,
    changes_of,
    forget_rest,
    require_room,
    reset,
)
from flowsculpt.pipeline.resample.thresholds import DEFAULT_ROUNDNESS, Thresholds, TriangleShape

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
    parents: list[Indices] = []
    while True:
        edges = _Edges.of(mesh.faces)
        cut = _to_cut(mesh, edges, thresholds.numbers[0] if fields is None else fields[:, 0])
        if not cut.any():
            fixed = thresholds if fields is None else _fixed(fields, thresholds)
            return Quadrisected(mesh, fixed, np.concatenate([_NONE, *parents]), len(parents))
        require_room(len(mesh.vertices), int(cut.sum()), thresholds.max_vertices)
        ends = edges.ends[cut]
        mesh = _cut(mesh, edges, cut)
        fields = None if fields is None else _mix(fields, ends)
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
    long = _distances(mesh.vertices, a, b) > allowed
    cut = np.zeros(len(edges.ends), np.bool_)
    cut[edges.sides[long[edges.sides].any(axis=1)]] = True
    return cut


def _cut(mesh: TriangleMesh, edges: _Edges, cut: AnyArray) -> TriangleMesh:
    """Insert a vertex in the middle of each edge to cut, and replace the faces."""
    ends, first = edges.ends[cut], len(mesh.vertices)
    middles = np.full(len(edges.ends), -1, np.int32)
    middles[cut] = np.arange(first, first + len(ends), dtype=np.int32)
    vertices = _mix(mesh.vertices, ends)
    faces = _pieces(vertices, mesh.faces, middles[edges.sides])
    attributes = {name: _mix(values, ends) for name, values in mesh.attributes.items()}
    tagged = (_halve(pairs, edges, middles) for pairs in (mesh.creases, mesh.seams))
    return TriangleMesh(vertices, faces, attributes, *tagged)


def _mix(values: AnyArray, ends: Indices) -> AnyArray:
    """Append one value for each pair of `ends` (N, 2) to values (V, …)."""
    low, high = values[ends[:, 0]], values[ends[:, 1]]
    between = (0.5 * (low + high)).astype(values.dtype) if values.dtype.kind == "f" else low
    return np.concatenate([values, between])


def _halve(pairs: Indices, edges: _Edges, middles: Indices) -> Indices:
    """Return creases or seams (K, 2) with cut edges replaced by their halves."""
    if not len(pairs):
        return pairs
    middle = middles[np.searchsorted(edge_keys(edges.ends), edge_keys(pairs))]
    whole, two = pairs[middle < 0], middle >= 0
    halves = [np.column_stack([end, middle[two]]) for end in pairs[two].T]
    return np.concatenate([whole, *halves])


_TURNED = np.array([[0, 1, 2, 3, 4, 5], [1, 2, 0, 4, 5, 3], [2, 0, 1, 5, 3, 4]])
"""Slots of a face, its corners and the midpoints of its sides, as seen from each of its corners."""


def _patterns() -> tuple[AnyArray, AnyArray]:
    """Return the pieces of a face by case, (16, 4, 3) slots, and their number (16,).

    A case is the sum of 1, 2 and 4 for the sides 0, 1 and 2 that are cut, and of 8 where two are and the
    piece between them is cut along its second diagonal.
    """
    table, count = np.zeros((16, 4, 3), np.int64), np.zeros(16, np.int64)
    cases = [(0, _TURNED[0], [[0, 1, 2]]), (7, _TURNED[0], [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])]
    for turn, slots in enumerate(_TURNED):
        one, two = 1 << turn, (1 << turn) + (1 << (turn + 1) % 3)
        cases.append((one, slots, [[0, 3, 2], [3, 1, 2]]))
        cases.append((two, slots, [[3, 1, 4], [0, 3, 4], [0, 4, 2]]))
        cases.append((two + 8, slots, [[3, 1, 4], [0, 3, 2], [3, 4, 2]]))
    for case, slots, pieces in cases:
        table[case, : len(pieces)], count[case] = slots[pieces], len(pieces)
    return table, count


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
    """Return thresholds with these (V, 3) or (V, 6) fields on any mesh."""
    longest, shortest, angle = (lambda mesh, values=values: values for values in fields[:, :3].T)
    bends = None if thresholds.bends is None else lambda mesh: fields[:, 3:]
    return Thresholds(longest, shortest, angle, thresholds.max_vertices, _NO_GRADATION, bends)


Splits = Literal["edges", "faces"]

_CHORD = Chord()

STATELESS: Mapping[str, Placement] = {"chord": _CHORD, "curved": Curved()}
"""Placements that keep nothing at the vertices, by name."""

_ATTRIBUTE = "attribute."
_GIVEN, _UNSORTED = "identities", "unsorted"
_CACHED = 50_000  # faces that fit into a core's own cache, where order does not matter
_NEW_SHARE = 1 / 3  # of the vertices of a large surface: with more new ones all are sorted again


class Resampler:
    """A surface in flow: move `vertices`, then call `resample()`, frame after frame.

    mesh           the first surface: finite, oriented, manifold; open or closed (MeshError otherwise)
    thresholds     length limits and hard angle; may be replaced between frames
    placement      where new vertices go
    min_roundness  triangles below it are improved (see `TriangleShape`)
    splits         "edges": cut long edges in two (P25); "faces": cut faces with a long edge into four (P26),
                   for new vertices on the chord only (UsageError otherwise)

    Vertex attributes are carried along: a new vertex gets the mean of its parents' values, a merged one those
    of its place (integers and flags are never mixed). If the mesh has an attribute `identity`, a different
    int64 for every vertex, a new vertex gets a number never used before, and `births` names its parents.
    `unsorted` counts the vertices born since the vertices were last sorted; at first all.

    Threads may each have a resampler of their own.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        thresholds: Thresholds,
        placement: Placement = _CHORD,
        min_roundness: float = DEFAULT_ROUNDNESS,
        splits: Splits = "edges",
    ) -> None:
        self._configure(thresholds, placement, min_roundness, splits)
        mesh = in_memory_order(placement.prepare(mesh, thresholds.hard_angles(mesh)))
        self._mesh = HalfedgeMesh(mesh, Register.of(mesh))
        self.unsorted = len(mesh.vertices)
        reset(changes_of(self._mesh))  # allocates the memory now, so that no frame waits for it

    def _configure(
        self, thresholds: Thresholds, placement: Placement, min_roundness: float, splits: Splits
    ) -> None:
        if splits not in ("edges", "faces"):
            raise UsageError(f"splits {splits!r} is not known; use 'edges' or 'faces'")
        if splits == "faces" and placement.leaves_chord:
            raise UsageError(
                "splits 'faces' puts new vertices in the middle of their edges, and "
                f"{type(placement).__name__} elsewhere; use Chord(), or split edges"
            )
        self.thresholds, self.placement, self.shape = thresholds, placement, TriangleShape(min_roundness)
        self.splits: Splits = splits

    @property
    def vertices(self) -> Points:
        """(V, 3) float64 view: write the moved positions into it. `resample` replaces the array."""
        return self._mesh.vertices

    def vectors(self, name: str) -> Vectors | None:
        """Return a (V, 3) float64 view of a vector attribute, to write into like `vertices`, or None."""
        column = self._mesh.column(name)
        attributes = self._mesh.arrays.attributes[: self._mesh.sizes[0]]
        return None if column is None else attributes[:, column : column + 3]

    def set_attributes(self, **named: AnyArray) -> None:
        """Replace vertex attributes by others of the same shape and type, or add them behind the rest."""
        self._mesh.set_attributes(named)
        forget_rest(self._mesh)

    @property
    def mesh(self) -> TriangleMesh:
        """The surface as a value: vertices in the order of `vertices`, faces in the resampler's own order."""
        return self._mesh.snapshot()

    @property
    def bare_mesh(self) -> TriangleMesh:
        """The surface as a value without its attributes and creases, which takes less memory."""
        return TriangleMesh(self._mesh.vertices, self._mesh.faces)

    @property
    def births(self) -> AnyArray | None:
        """int64 (N, 3) of the last `resample`, in order: the identities of each new vertex and its parents.

        Includes vertices that have collapsed again. None if the mesh has no identities.
        """
        return None if self._mesh.register is None else self._mesh.register.births

    @property
    def identities(self) -> int:
        """The number of identities given since the first frame; the next new vertex gets this number."""
        return 0 if self._mesh.register is None else self._mesh.register.given

    def state(self) -> dict[str, AnyArray]:
        """Return copies of all that later frames depend on; keep them by ``numpy.savez(file, **state)``."""
        mesh = self.mesh
        named = {_ATTRIBUTE + name: values for name, values in mesh.attributes.items()}
        given = {} if self._mesh.register is None else {_GIVEN: np.array(self.identities)}
        surface = {"vertices": mesh.vertices, "faces": mesh.faces, **mesh.tagged_edges}
        return {**surface, **named, **given, _UNSORTED: np.array(self.unsorted)}

    @classmethod
    def from_state(
        cls,
        state: Mapping[str, AnyArray],
        thresholds: Thresholds,
        placement: Placement = _CHORD,
        min_roundness: float = DEFAULT_ROUNDNESS,
        splits: Splits = "edges",
    ) -> Resampler:
        """Resume from a `state`, with the same bits as without a stop. Unknown names are ignored."""
        missing = {"vertices", "faces"} - set(state)
        if missing:
            raise UsageError(
                f"the state has no {' and no '.join(sorted(missing))}; a run cannot resume from it"
            )
        attributes = {n.removeprefix(_ATTRIBUTE): state[n] for n in state if n.startswith(_ATTRIBUTE)}
        resumed = cls.__new__(cls)  # without __init__, which may reorder faces
        resumed._configure(thresholds, placement, min_roundness, splits)
        tagged = state.get("creases"), state.get("seams")
        mesh = TriangleMesh(state["vertices"], state["faces"], attributes, *tagged)
        resumed._mesh = HalfedgeMesh(mesh, Register.of(mesh, int(state.get(_GIVEN, 0))))
        resumed.unsorted = int(state.get(_UNSORTED, 0))
        reset(changes_of(resumed._mesh))
        return resumed

    def resample(self) -> Report:
        """Bring the edges within their length limits, in place.

        Raises FrameError where a vertex is not finite or the vertices would exceed the budget; the surface is
        then still sound. Ctrl-C ends it at once and leaves the surface unusable.
        """
        report = self._resample()
        self.unsorted += report.splits
        if report.faces > _CACHED and self.unsorted > _NEW_SHARE * report.vertices:
            self._mesh.reorder(morton_order(self.vertices))
            self.unsorted = 0
        return report

    def _resample(self) -> Report:
        if self._mesh.register is not None:
            self._mesh.register.begin()
        this_pass = self._pass(self.thresholds)
        self.placement.restore(self._mesh, this_pass.limits)
        this_pass.find_edges()
        if self.splits == "edges" or not this_pass.long_edges[0]:
            return this_pass.run()
        mesh, thresholds, parents, rounds = quadrisect(self._mesh.snapshot(), self.thresholds)
        self._mesh = HalfedgeMesh(mesh, self._mesh.register)
        self._mesh.enter_births(parents)
        this_pass = self._pass(thresholds)
        this_pass.find_edges()
        report = this_pass.run()
        return replace(report, splits=report.splits + len(parents), passes=report.passes + rounds)

    def _pass(self, thresholds: Thresholds) -> ResamplePass:
        return ResamplePass(self._mesh, thresholds, self.placement, self.shape)


def resample(
    mesh: TriangleMesh,
    thresholds: Thresholds,
    placement: Placement = _CHORD,
    min_roundness: float = DEFAULT_ROUNDNESS,
    splits: Splits = "edges",
) -> tuple[TriangleMesh, Report]:
    """Return a mesh resampled once, and the report. For a film keep a `Resampler`: it keeps the connectivity.

    mesh           finite, oriented, manifold; open or closed (MeshError otherwise)
    thresholds     length limits and hard angle
    placement      where new vertices go: `Chord()`, `Curved()` or an `Exact`
    min_roundness  triangles below it are improved: 1 is equilateral, 0 leaves them as they are
    splits         "edges" or "faces", as of a `Resampler`

    Attributes, creases and seams come along. Raises FrameError where `max_vertices` would be exceeded.
    """
    resampler = Resampler(mesh, thresholds, placement, min_roundness, splits)
    report = resampler.resample()
    return resampler.mesh, report


def in_memory_order(mesh: TriangleMesh) -> TriangleMesh:
    """Return the same surface; faces of a large one are sorted by their lowest vertex.

    Vertices keep their numbers until they are resampled, since the caller may know them by number. A pass
    over a million faces in random order takes several times as long as one in memory order.
    """
    if len(mesh.faces) <= _CACHED:
        return mesh
    order = np.argsort(mesh.faces.min(axis=1), kind="stable")
    return replace(mesh, faces=mesh.faces[order])
