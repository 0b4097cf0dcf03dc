"""HalfedgeMesh: connectivity that stays valid while a surface is split, collapsed and flipped.

Vertices have identities, never given twice, and recorded births give their ancestry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points
from flowsculpt.pipeline.errors import MeshError, UsageError
from flowsculpt.pipeline.mesh.kernels.halfedge import (
    SOUND,
    MeshArrays,
    close_face_gaps,
    close_vertex_gaps,
    match_twins,
    renumber,
    renumber_listed,
    renumber_parallel,
    reordered,
)
from flowsculpt.pipeline.mesh.meshes import TriangleMesh, edge_keys, stable_order
from flowsculpt.pipeline.mesh.normals import tagged_halfedges
from flowsculpt.pipeline.mesh.validation import validate

IDENTITY = "identity"  # vertex attribute (V,), int64, that tells the vertices of a film apart
_LARGEST = 1 << 53  # attributes are stored as float64, which has no larger odd integers
_NO_BIRTHS = np.empty((0, 3), np.int64)

CREASE, SEAM = 1, 2
"""Bits of the tags of half-edges. Kernels keep both alike; they bend the surface at creases alone."""


def with_identities(mesh: TriangleMesh) -> TriangleMesh:
    """Return the mesh with its vertices numbered from 0: the start of a film."""
    return mesh.with_attributes(**{IDENTITY: np.arange(len(mesh.vertices), dtype=np.int64)})


class Register:
    """The births of one frame, and the number of identities ever given.

    given   number of identities given: the next vertex gets this one
    births  int64 (N, 3), in order of birth: identities of a vertex and its two parents; includes vertices
            that died within the frame
    """

    def __init__(self, given: int) -> None:
        self.given = given
        self._records: list[AnyArray] = []

    @classmethod
    def of(cls, mesh: TriangleMesh, given: int = 0) -> Register | None:
        """Return the register of a mesh after that many identities; None if it has none.

        Raises MeshError where identities are not different numbers, int64 and from 0 on.
        """
        if IDENTITY not in mesh.attributes:
            return None
        numbers = mesh.attributes[IDENTITY]
        if numbers.ndim != 1 or numbers.dtype != np.int64:
            fault = f"{numbers.dtype} of shape {numbers.shape}; it must be one int64 for each vertex"
            raise MeshError(f"attribute {IDENTITY!r} holds {fault}. Rename it if it means something else")
        ordered = np.sort(numbers)
        low, high = int(ordered.min(initial=0)), int(ordered.max(initial=-1))
        if (np.diff(ordered) == 0).any() or low < 0 or high >= _LARGEST:
            fault = "a number twice, or one below 0 or over 2**53; it must tell all vertices apart"
            raise MeshError(f"attribute {IDENTITY!r} holds {fault}. Rename it if it means something else")
        return cls(max(given, high + 1))

    @property
    def births(self) -> AnyArray:
        return np.concatenate([_NO_BIRTHS, *self._records])

    def begin(self) -> None:
        """Start a new frame without births."""
        self._records.clear()

    def enter(self, identities: Floats, parents: Indices) -> None:
        """Number the last vertices of a surface, which are new.

        identities  (V,) of the whole surface, to be written into
        parents     (N, 2) the parents of each of the last N vertices, which may be among these N
        """
        first, more = len(identities) - len(parents), self.given + len(parents)
        identities[first:] = np.arange(self.given, more)
        births = np.column_stack([identities[first:], identities[parents]])
        self._records.append(births.astype(np.int64).reshape(-1, 3))
        self.given = more


@dataclass(frozen=True, eq=False)
class Ancestry:
    """A sparse matrix (V, U) with the shares of earlier vertices in the present ones, row after row.

    heirs      int64 (K,) present vertices, ascending
    ancestors  int64 (K,) earlier vertices, ascending for each heir
    weights    float64 (K,) above 0; those of an heir add up to 1
    """

    heirs: AnyArray
    ancestors: AnyArray
    weights: Floats

    @property
    def survives(self) -> AnyArray:
        """(V,) flags of the vertices that existed earlier; a vertex born since has at least two ancestors."""
        return np.bincount(self.heirs) == 1

    def mixed(self, values: AnyArray) -> Floats:
        """Return weighted means (V, …) of earlier values (U, …); a survivor keeps its own."""
        flat = np.asarray(values, np.float64).reshape(len(values), -1)
        mixed = np.empty((len(self.survives), flat.shape[1]))
        for k, column in enumerate(flat.T):
            mixed[:, k] = np.bincount(self.heirs, self.weights * column[self.ancestors])
        return mixed.reshape(-1, *np.shape(values)[1:])


def ancestry(now: AnyArray, then: AnyArray, births: AnyArray) -> Ancestry:
    """Return how the present vertices descend from earlier ones: each birth is the mean of its two parents.

    now     (V,) the attribute `identity` of the later surface
    then    (U,) that of the earlier one
    births  (N, 3) the records of all births after `then`, up to `now`, in order; earlier ones are ignored

    Weights are sums of powers of one half, exact over fifty generations. A survivor is its own only ancestor,
    even where a collapse has moved it to the middle of its edge.

    Raises UsageError where the births are out of order, or those of a vertex are missing.
    """
    if not (np.diff(births[:, 0]) > 0).all():
        raise UsageError("births are not in order; give those of all frames in between, one after the other")
    heirs, names, weights = np.arange(len(now)), np.asarray(now, np.int64), np.ones(len(now))
    by_name = np.argsort(then)
    settled = [(heirs[:0], by_name[:0], weights[:0])]
    while len(heirs):
        place = _index_of(names, then[by_name])
        old = place >= 0
        settled.append((heirs[old], by_name[place[old]], weights[old]))
        heirs, names, weights = heirs[~old], names[~old], weights[~old]
        birth = _index_of(names, births[:, 0])
        if (birth < 0).any():
            raise UsageError(
                f"vertex {names[birth < 0][0]} is neither of the earlier surface nor among the births; give "
                "those of all frames in between"
            )
        heirs, weights = np.tile(heirs, 2), np.tile(0.5 * weights, 2)
        heirs, names, weights = _merge(heirs, births[birth, 1:].T.reshape(-1), weights)
    heirs, ancestors, weights = (np.concatenate(part) for part in zip(*settled, strict=True))
    return Ancestry(*_merge(heirs, ancestors, weights))


def _index_of(wanted: AnyArray, ascending: AnyArray) -> AnyArray:
    """Return the index (N,) of each wanted number in an ascending row; -1 if it is missing."""
    place = np.searchsorted(ascending, wanted)
    exists = place < len(ascending)
    exists[exists] = ascending[place[exists]] == wanted[exists]
    return np.where(exists, place, -1)


def _merge(heirs: AnyArray, names: AnyArray, weights: Floats) -> tuple[AnyArray, AnyArray, Floats]:
    """Return each pair of an heir and a name once, in order, with the sum of its weights."""
    order = np.lexsort((names, heirs))
    heirs, names, weights = heirs[order], names[order], weights[order]
    begins = np.flatnonzero(np.append(True, np.diff(heirs) | np.diff(names))[: len(heirs)])
    return heirs[begins], names[begins], np.add.reduceat(weights, begins) if len(begins) else weights


_HEADROOM_AT_FIRST, _HEADROOM = 1.25, 1.5
WORTH_SHARING = 1 << 19  # number of half-edges above which a pass over all of them is worth starting threads


class HalfedgeMesh:
    """A corner table over arrays with room to grow; the only mutable mesh.

    Half-edge ``3f + i`` leaves corner i of face f. `docs/halfedge.md` states the invariants. `sizes` holds
    the numbers of vertices and faces; the arrays of `arrays` are longer, so that `reserve` can make room for
    a round of splits in advance.

    register  records births if the mesh's identities are to be kept; without it identities are an attribute
              like others

    Raises MeshError where the mesh is not a finite, oriented manifold, with or without boundary.
    """

    def __init__(self, mesh: TriangleMesh, register: Register | None = None) -> None:
        self.euler = validate(mesh).require().euler
        self.register = register
        self._scratch: dict[str, AnyArray] = {}
        self._columns = _Columns.of(mesh.attributes)
        self.sizes: AnyArray = np.array([len(mesh.vertices), len(mesh.faces)], np.int64)
        points, corners = (int(_HEADROOM_AT_FIRST * size) for size in (len(mesh.vertices), mesh.faces.size))
        self.arrays = MeshArrays(
            _grown(mesh.vertices, points),
            self._columns.pack(mesh.attributes, points),
            self._columns.blends,
            _grown(mesh.faces.reshape(-1), corners),
            _grown(np.empty(0, np.int32), corners),
            _grown(_tags_of(mesh), corners),
        )
        problem, _ = match_twins(mesh.faces.reshape(-1), len(mesh.vertices), self.twins)
        assert problem == SOUND, "require() has already shown the mesh to be manifold"

    @property
    def vertices(self) -> Points:
        """(V, 3) live view of the positions; write into it to move the surface."""
        return self.arrays.points[: self.sizes[0]]

    @property
    def faces(self) -> Faces:
        """(F, 3) live view of the faces; for reading."""
        return self.arrays.vert[: 3 * self.sizes[1]].reshape(-1, 3)

    @property
    def twins(self) -> Indices:
        """(3F,) live view: the half-edge that runs back along the same edge, -1 on a boundary."""
        return self.arrays.twin[: 3 * self.sizes[1]]

    @property
    def edges(self) -> int:
        """Number of edges: V + F - the Euler number, which no operation changes."""
        return int(self.sizes.sum()) - self.euler

    def reserve(self, vertices: int, faces: int) -> None:
        """Make room for that many more; the arrays grow geometrically and keep their contents."""
        points, carried, blends, vert, twin, tagged = self.arrays
        if self.sizes[0] + vertices > len(points):
            room = max(int(self.sizes[0]) + vertices, int(len(points) * _HEADROOM))
            points, carried = _grown(points, room), _grown(carried, room)
        if 3 * (self.sizes[1] + faces) > len(vert):
            room = 3 * max(int(self.sizes[1]) + faces, int(len(vert) * _HEADROOM) // 3)
            vert, twin, tagged = _grown(vert, room), _grown(twin, room), _grown(tagged, room)
        self.arrays = MeshArrays(points, carried, blends, vert, twin, tagged)

    def enter_births(self, parents: Indices) -> None:
        """Register the last vertices as births, if there is a register; `parents` (N, 2) are vertices."""
        column = self.column(IDENTITY)
        if self.register is not None and column is not None:
            self.register.enter(self.arrays.attributes[: self.sizes[0], column], parents)

    def compact(
        self, dead_vertices: Indices, dead_faces: Indices, changed: Indices | None = None, older: int = 0
    ) -> None:
        """Close the gaps that removed elements left in the arrays.

        changed  int32 faces, removed ones included: among them are all faces of the vertices from number
                 `older` on, and if no others move, only these faces are looked at
        """
        if not len(dead_vertices) and not len(dead_faces):
            return
        vertices = int(self.sizes[0]) - len(dead_vertices)
        new_numbers = np.empty(len(dead_vertices), np.int32)
        outdated = close_vertex_gaps(self.arrays, self.sizes, np.sort(dead_vertices), new_numbers)
        if changed is not None and vertices >= older:
            renumber_listed(self.arrays.vert, changed, vertices, new_numbers)
            outdated = False  # the faces tell the new numbers
        close_face_gaps(self.arrays, self.sizes, np.sort(dead_faces))
        if outdated:
            halfedges = int(3 * self.sizes[1])
            everywhere = renumber_parallel if halfedges > WORTH_SHARING else renumber
            everywhere(self.arrays.vert, halfedges, vertices, new_numbers)

    def reorder(self, vertex_order: AnyArray) -> None:
        """Renumber the vertices in the given order (V,), and the faces by their lowest vertex."""
        vertices, faces = (int(size) for size in self.sizes)
        points, attributes, _, vert, twin, tagged = self.arrays
        points[:vertices] = points[:vertices][vertex_order]
        attributes[:vertices] = attributes[:vertices][vertex_order]
        numbers = np.empty(vertices, np.int32)
        numbers[vertex_order] = np.arange(vertices, dtype=np.int32)
        a, b, c = numbers[self.faces].T
        face_order = stable_order(np.minimum(np.minimum(a, b), c))
        halfedges = slice(0, 3 * faces)
        vert[halfedges], twin[halfedges], tagged[halfedges] = reordered(self.arrays, numbers, face_order)

    def scratch(self, name: str, room: int, kind: type = np.int32) -> AnyArray:
        """Return an array of at least that many entries, kept for the next call with this name.

        It holds what was left in it, zero at first, so that later passes need not wait for memory. No result
        may depend on its contents.
        """
        kept = self._scratch.get(name, np.empty(0, kind))
        if len(kept) < room:
            kept = self._scratch[name] = _grown(kept, max(room, int(len(kept) * _HEADROOM)))
        return kept

    def attributes(self) -> dict[str, AnyArray]:
        """Return read-only copies of the vertex attributes, in their own shapes and types."""
        return self._columns.unpack(self.arrays.attributes[: self.sizes[0]])

    def set_attributes(self, named: Mapping[str, AnyArray]) -> None:
        """Replace vertex attributes by others of the same shape and type, or add them behind the rest."""
        vertices = int(self.sizes[0])
        if missing := {name: named[name] for name in named if self.column(name) is None}:
            points, carried, _, *table = self.arrays
            self._columns = self._columns.with_more(missing)
            wider = np.zeros((len(carried), self._columns.width))
            shared = min(carried.shape[1], wider.shape[1])  # fields behind the attributes are set anew
            wider[:vertices, :shared] = carried[:vertices, :shared]
            self.arrays = MeshArrays(points, wider, self._columns.blends, *table)
        self._columns.fill(self.arrays.attributes[:vertices], named)

    def column(self, name: str) -> int | None:
        """Return the first column of an attribute in `arrays.attributes`; None if it is missing."""
        return self._columns.start(name)

    def set_fields(self, fields: Floats) -> int:
        """Store (V, k) numbers beside the attributes and return their first column.

        They mix like attributes but are not part of the snapshot.
        """
        start = self._columns.width
        if self.arrays.attributes.shape[1] != start + fields.shape[1]:
            points, carried, blends, *table = self.arrays
            wider, more = np.zeros((len(carried), start + fields.shape[1])), np.ones(fields.shape[1])
            wider[: self.sizes[0], :start] = carried[: self.sizes[0], :start]
            self.arrays = MeshArrays(points, wider, np.append(blends[:start], more), *table)
        self.arrays.attributes[: self.sizes[0], start:] = fields
        return start

    def tagged_edges(self, tag: int) -> Indices:
        """Return the edges (K, 2) with a tag, by their vertices; each may appear twice."""
        tagged = np.flatnonzero(self.arrays.tagged[: 3 * self.sizes[1]] & tag)
        after = np.where(tagged % 3 == 2, tagged - 2, tagged + 1)
        return np.column_stack([self.arrays.vert[tagged], self.arrays.vert[after]])

    def snapshot(self) -> TriangleMesh:
        """Return the surface as a value, vertices and faces in the order of the arrays."""
        creases, seams = (self.tagged_edges(tag) for tag in (CREASE, SEAM))
        return TriangleMesh(self.vertices, self.faces, self.attributes(), creases, seams)


class _Columns:
    """Layout of named attributes of any shape and type in one float64 matrix."""

    def __init__(self, layout: Mapping[str, tuple[tuple[int, ...], np.dtype[Any]]]) -> None:
        self._layout, self._starts, self.width = dict(layout), dict[str, int](), 0
        for name, (shape, _) in self._layout.items():
            self._starts[name] = self.width
            self.width += _width(shape)
        mixes = [np.full(_width(shape), float(kind.kind == "f")) for shape, kind in self._layout.values()]
        self.blends: Floats = np.concatenate([*mixes, np.empty(0)])

    def start(self, name: str) -> int | None:
        return self._starts.get(name)

    @classmethod
    def of(cls, attributes: Mapping[str, AnyArray]) -> _Columns:
        for name, values in attributes.items():
            if values.dtype.kind not in "fiub" or values.dtype.itemsize > 8:
                raise MeshError(
                    f"attribute {name!r} holds {values.dtype}; resampling supports only real numbers"
                )
            if not np.isfinite(values).all():
                raise MeshError(f"attribute {name!r} holds values that are not finite; replace them")
        return cls({name: (values.shape[1:], values.dtype) for name, values in attributes.items()})

    def with_more(self, attributes: Mapping[str, AnyArray]) -> _Columns:
        """Return the layout with further attributes behind its own."""
        return _Columns(self._layout | _Columns.of(attributes)._layout)

    def pack(self, attributes: Mapping[str, AnyArray], rows: int) -> Floats:
        """Return a matrix with room for so many rows, the attributes of the vertices in its first ones."""
        matrix = np.zeros((rows, self.width))
        self.fill(matrix, attributes)
        return matrix

    def fill(self, matrix: Floats, attributes: Mapping[str, AnyArray]) -> None:
        """Write attributes into their columns of the first rows."""
        for name, values in attributes.items():
            first, width = self._starts[name], _width(self._layout[name][0])
            matrix[: len(values), first : first + width] = values.reshape(len(values), -1)

    def unpack(self, matrix: Floats) -> dict[str, AnyArray]:
        named = {}
        for name, (shape, kind) in self._layout.items():
            part = matrix[:, self._starts[name] : self._starts[name] + _width(shape)]
            named[name] = part.reshape(len(matrix), *shape).astype(kind)
            named[name].flags.writeable = False
        return named


def _tags_of(mesh: TriangleMesh) -> AnyArray:
    """Return the tags (3F,) uint8 of half-edges. Raises MeshError for a crease or seam off the edges."""
    tags = np.zeros(mesh.faces.size, np.uint8)
    for tag, edges, name in ((CREASE, mesh.creases, "crease"), (SEAM, mesh.seams, "seam")):
        tagged = tagged_halfedges(mesh, edges)
        missing = ~np.isin(edge_keys(edges), edge_keys(mesh.ends_of(np.flatnonzero(tagged))))
        if missing.any():
            a, b = edges[missing][0]
            raise MeshError(
                f"{name} {a}-{b} is not an edge of the mesh; {name}s name two vertices of one edge"
            )
        tags[tagged] |= tag
    return tags


def _width(shape: tuple[int, ...]) -> int:
    return int(np.prod(shape, dtype=int))


def _grown(array: AnyArray, rows: int) -> AnyArray:
    larger = np.zeros((rows, *array.shape[1:]), array.dtype)  # takes no memory for rows without values
    larger[: len(array)] = array
    return larger
