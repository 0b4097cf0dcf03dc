"""Validation: prove a mesh finite, oriented and manifold, or name its first fault."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Indices, Points
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh.face_soup import connected_components
from flowsculpt.pipeline.mesh.kernels.halfedge import CROWDED, SOUND, find_nonmanifold_vertex, match_twins
from flowsculpt.pipeline.mesh.meshes import PolygonMesh, TriangleMesh


@dataclass(frozen=True)
class Soundness:
    """The result of `validate`. If `problem` is set, edges are not counted.

    euler is V - E + F: 2 for each closed piece with the topology of a sphere, 0 for a torus.
    twins (3F,) are the half-edges across those of sound triangles.
    """

    vertices: int
    faces: int
    edges: int = 0
    boundary_edges: int = 0
    problem: str | None = None
    twins: Indices | None = field(default=None, repr=False, compare=False)

    @property
    def sound(self) -> bool:
        return self.problem is None

    @property
    def closed(self) -> bool:
        return self.sound and self.boundary_edges == 0

    @property
    def euler(self) -> int:
        return self.vertices - self.edges + self.faces

    def require(self, closed: bool = False, name: str = "mesh") -> Soundness:
        """Return the result. Raises MeshError, a sentence that begins with `name`, at a broken rule."""
        if self.problem is not None:
            raise MeshError(f"{name}: {self.problem}")
        if closed and not self.closed:
            raise MeshError(
                f"{name}: {self.boundary_edges} edges have a face on one side only; "
                "a closed surface is needed: fill the holes"
            )
        return self


def validate(mesh: TriangleMesh | PolygonMesh) -> Soundness:
    """Prove a mesh finite, oriented and manifold at every edge and vertex, or name the first fault.

    The rules, in order: at least one face; finite vertices; no face that names a vertex twice; every vertex
    used; no edge with more than two faces; neighbours with the same orientation; no two faces that are each
    other's back; one fan of faces at every vertex. An open surface is sound; see `closed`. Polygons may be
    concave, bent, or share several edges, and a vertex may have two edges only.
    """
    if isinstance(mesh, PolygonMesh):
        faces, corners = len(mesh), len(mesh.corners)
        problem, twin = _polygon_problem(mesh)
    else:
        faces, corners = len(mesh.faces), mesh.faces.size
        twin = np.empty(corners, np.int32)
        problem = _points_problem(mesh) or _edges_problem(mesh, twin) or _fans_problem(mesh, twin)
    if problem is not None:
        return Soundness(len(mesh.vertices), faces, problem=problem)
    boundary = int(np.count_nonzero(twin < 0))
    twins = twin if isinstance(mesh, TriangleMesh) else None
    return Soundness(len(mesh.vertices), faces, (corners + boundary) // 2, boundary, twins=twins)


def _points_problem(mesh: TriangleMesh) -> str | None:
    if problem := _vertices_problem(mesh.vertices, len(mesh.faces)):
        return problem
    a, b, c = mesh.faces.T
    collapsed = (a == b) | (b == c) | (c == a)
    if collapsed.any():
        f = _first(collapsed)
        return f"face {f} {_names(mesh, f)} names a vertex twice; remove such degenerate faces"
    return _unused_problem(mesh.vertices, mesh.faces.reshape(-1))


def _vertices_problem(vertices: Points, faces: int) -> str | None:
    if not faces:
        return "the mesh has no faces; a surface needs at least one"
    wrong = np.logical_not(np.isfinite(vertices).all(axis=1))
    if not wrong.any():
        return None
    more = int(wrong.sum()) - 1
    return f"vertex {_first(wrong)} is not finite (and {more} more); coordinates must be numbers"


def _unused_problem(vertices: Points, corners: Indices) -> str | None:
    unused = np.ones(len(vertices), bool)
    unused[corners] = False
    if not unused.any():
        return None
    more = int(unused.sum()) - 1
    return f"vertex {_first(unused)} belongs to no face (and {more} more); remove unused vertices"


def _edges_problem(mesh: TriangleMesh, twin: Indices) -> str | None:
    vert = mesh.faces.reshape(-1)
    fault, h = match_twins(vert, len(mesh.vertices), twin)
    if fault == SOUND:
        return _doubled_problem(mesh, twin)
    a, b = vert[h], vert[h - 2 if h % 3 == 2 else h + 1]
    faces = np.flatnonzero((mesh.faces == a).any(axis=1) & (mesh.faces == b).any(axis=1))
    corners = np.sort(mesh.faces[faces], axis=1)
    if len(np.unique(corners, axis=0)) < len(corners):
        return f"among faces {_listed(faces)}, at edge {a}-{b}, one is there twice; remove duplicates"
    return _edge_problem(a, b, faces, crowded=fault == CROWDED)


def _edge_problem(a: int, b: int, faces: AnyArray, crowded: bool) -> str:
    if crowded:
        count = f"{len(faces)} faces ({_listed(faces)})"
        return f"edge {a}-{b} has {count}; it may have at most two: split the mesh there"
    return f"faces {_listed(faces)} run along edge {a}-{b} the same way; reverse one of them"


def _doubled_problem(mesh: TriangleMesh, twin: Indices) -> str | None:
    """Two faces back to back share all edges, which no solid has."""
    a, b, c = (twin // 3).reshape(-1, 3).T  # the faces across; -1 where there is none
    doubled = ((a == b) | (a == c)) & (a >= 0) | (b == c) & (b >= 0)
    if not doubled.any():
        return None
    f = _first(doubled)
    return f"face {f} {_names(mesh, f)} has a face with the same vertices on its back; remove one of the two"


def _fans_problem(mesh: TriangleMesh, twin: Indices) -> str | None:
    v = find_nonmanifold_vertex(mesh.faces.reshape(-1).copy(), twin, len(mesh.vertices))
    return None if v < 0 else _two_parts(v)


def _polygon_problem(mesh: PolygonMesh) -> tuple[str | None, AnyArray]:
    """Return the first fault of a polyhedron, or None, and its `twins` if they are known."""
    problem = _vertices_problem(mesh.vertices, len(mesh)) or _polygon_repeats_problem(mesh)
    problem = problem or _unused_problem(mesh.vertices, mesh.corners)
    if problem is not None:
        return problem, np.empty(0, np.int64)
    twin = mesh.twins
    problem = _polygon_edges_problem(mesh) or _polygon_doubled_problem(mesh, twin)
    return problem or _polygon_fans_problem(mesh, twin), twin


def _polygon_repeats_problem(mesh: PolygonMesh) -> str | None:
    order = np.lexsort([mesh.corners, mesh.owners])
    corners, owners = mesh.corners[order], mesh.owners[order]
    repeated = (np.diff(corners) == 0) & (np.diff(owners) == 0)
    if not repeated.any():
        return None
    c = _first(repeated)
    return f"face {owners[c]} names vertex {corners[c]} twice; split it in two there"


def _polygon_edges_problem(mesh: PolygonMesh) -> str | None:
    sides = mesh.corners.astype(np.int64) * len(mesh.vertices) + mesh.heads
    order = np.argsort(sides, kind="stable")
    repeated = np.flatnonzero(np.diff(sides[order]) == 0)
    if not len(repeated):
        return None
    c = int(order[repeated[0]])
    a, b = int(mesh.corners[c]), int(mesh.heads[c])
    along = ((mesh.corners == a) & (mesh.heads == b)) | ((mesh.corners == b) & (mesh.heads == a))
    faces = mesh.owners[along]
    return _edge_problem(a, b, faces, crowded=len(faces) > 2)


def _polygon_doubled_problem(mesh: PolygonMesh, twin: AnyArray) -> str | None:
    """A face all of whose sides have the same face on their other side is a sheet without thickness."""
    across = np.where(twin < 0, -1, mesh.owners[twin])
    low = np.minimum.reduceat(across, mesh.offsets[:-1])
    high = np.maximum.reduceat(across, mesh.offsets[:-1])
    doubled = (low == high) & (low >= 0)
    if not doubled.any():
        return None
    f = _first(doubled)
    return f"face {f} has face {low[f]} with the same vertices on its back; remove one of the two"


def _polygon_fans_problem(mesh: PolygonMesh, twin: AnyArray) -> str | None:
    """A walk around a vertex from one of its sides must reach them all."""
    count = len(twin)
    onwards = twin[mesh.previous_side]
    ends, starts = np.flatnonzero(onwards < 0), np.flatnonzero(twin < 0)
    fans = np.bincount(mesh.corners[ends], minlength=len(mesh.vertices))
    if (fans > 1).any():
        return _two_parts(_first(fans > 1))
    first = np.full(len(mesh.vertices), -1)
    first[mesh.corners[starts]] = starts
    onwards[ends] = first[mesh.corners[ends]]  # close open fans across their gaps
    fan, any_fan = (
        connected_components(count, np.arange(count), onwards),
        np.empty(len(mesh.vertices), np.int64),
    )
    any_fan[mesh.corners] = fan
    split = fan != any_fan[mesh.corners]
    return _two_parts(int(mesh.corners[_first(split)])) if split.any() else None


def _two_parts(vertex: int) -> str:
    return f"vertex {vertex} joins two parts of the surface at a single point; give each part its own vertex"


def _first(flags: AnyArray) -> int:
    return int(np.argmax(flags))


def _names(mesh: TriangleMesh, face: int) -> str:
    return "(" + ", ".join(str(v) for v in mesh.faces[face]) + ")"


def _listed(faces: AnyArray) -> str:
    shown = ", ".join(str(f) for f in faces[:4])
    return shown + (", …" if len(faces) > 4 else "")
