"""Is this a surface one can work on? Proved once on the way in, and by the tests after every operation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import AnyArray, Indices
from pipeline.errors import MeshError
from pipeline.mesh.kernels.halfedge import CROWDED, SOUND, find_nonmanifold_vertex, match_twins
from pipeline.mesh.polygon_mesh import PolygonMesh
from pipeline.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True)
class Soundness:
    """What `validate` found. Where `problem` is set, edges are not counted.

    euler is V - E + F: 2 for each closed piece of the kind of a sphere, 0 for a torus.
    """

    vertices: int
    faces: int
    edges: int = 0
    boundary_edges: int = 0
    problem: str | None = None

    @property
    def sound(self) -> bool:
        return self.problem is None

    @property
    def closed(self) -> bool:
        return self.sound and self.boundary_edges == 0

    @property
    def euler(self) -> int:
        return self.vertices - self.edges + self.faces


def validate(mesh: TriangleMesh) -> Soundness:
    """Prove a mesh finite, oriented and manifold at every edge and vertex, or name the first fault.

    The rules, in order: at least one face; finite vertices; no face that names a vertex twice; every
    vertex used; no edge with more than two faces; neighbours turn the same way; no face twice; one fan
    of faces at every vertex. An open surface is sound; `closed` tells them apart.
    """
    vertices, faces = len(mesh.vertices), len(mesh.faces)
    twin = np.empty(3 * faces, np.int32)
    problem = _points_problem(mesh) or _edges_problem(mesh, twin) or _fans_problem(mesh, twin)
    if problem is not None:
        return Soundness(vertices, faces, problem=problem)
    boundary = int(np.count_nonzero(twin < 0))
    return Soundness(vertices, faces, (3 * faces + boundary) // 2, boundary)


def require(mesh: TriangleMesh, closed: bool = False, name: str = "mesh") -> Soundness:
    """Like `validate`, but raises MeshError, in one sentence that begins with `name`, at a broken rule."""
    found = validate(mesh)
    if found.problem is not None:
        raise MeshError(f"{name}: {found.problem}")
    if closed and not found.closed:
        raise MeshError(
            f"{name}: {found.boundary_edges} edges have a face on one side only; "
            "a closed surface is needed: fill the holes"
        )
    return found


def _points_problem(mesh: TriangleMesh) -> str | None:
    if len(mesh.faces) == 0:
        return "there are no faces; a surface needs at least one triangle"
    wild = np.logical_not(np.isfinite(mesh.vertices).all(axis=1))
    if wild.any():
        more = int(wild.sum()) - 1
        return f"vertex {_first(wild)} is not finite (and {more} more); coordinates must be numbers"
    a, b, c = mesh.faces.T
    collapsed = (a == b) | (b == c) | (c == a)
    if collapsed.any():
        f = _first(collapsed)
        return f"face {f} {_names(mesh, f)} names a vertex twice; remove such degenerate faces"
    unused = np.bincount(mesh.faces.reshape(-1), minlength=len(mesh.vertices)) == 0
    if unused.any():
        more = int(unused.sum()) - 1
        return f"vertex {_first(unused)} belongs to no face (and {more} more); remove unused vertices"
    return None


def _edges_problem(mesh: TriangleMesh, twin: Indices) -> str | None:
    vert = mesh.faces.reshape(-1)
    fault, h = match_twins(vert, len(mesh.vertices), twin)
    if fault == SOUND:
        return _doubled_problem(mesh, twin)
    a, b = vert[h], vert[h - 2 if h % 3 == 2 else h + 1]
    around = np.flatnonzero((mesh.faces == a).any(axis=1) & (mesh.faces == b).any(axis=1))
    corners = np.sort(mesh.faces[around], axis=1)
    if len(np.unique(corners, axis=0)) < len(corners):
        return f"among faces {_listed(around)}, at edge {a}-{b}, one stands twice; remove duplicates"
    if fault == CROWDED:
        return (
            f"edge {a}-{b} has {len(around)} faces ({_listed(around)}); it may have two at most: "
            "split the mesh there"
        )
    return (
        f"faces {_listed(around)} run along edge {a}-{b} the same way; neighbours must agree: turn one round"
    )


def _doubled_problem(mesh: TriangleMesh, twin: Indices) -> str | None:
    """Two faces back to back share all edges; they are a manifold only on paper."""
    a, b, c = (twin // 3).reshape(-1, 3).T  # the faces across; -1 where there is none
    doubled = ((a == b) | (a == c)) & (a >= 0) | (b == c) & (b >= 0)
    if not doubled.any():
        return None
    f = _first(doubled)
    return f"face {f} {_names(mesh, f)} has a face with the same vertices on its back; remove one of the two"


def _fans_problem(mesh: TriangleMesh, twin: Indices) -> str | None:
    v = find_nonmanifold_vertex(mesh.faces.reshape(-1).copy(), twin, len(mesh.vertices))
    if v < 0:
        return None
    return f"vertex {v} joins two parts of the surface by a point only; give each part a vertex of its own"


def _first(flags: AnyArray) -> int:
    return int(np.argmax(flags))


def _names(mesh: TriangleMesh, face: int) -> str:
    return "(" + ", ".join(str(v) for v in mesh.faces[face]) + ")"


def _listed(faces: AnyArray) -> str:
    shown = ", ".join(str(f) for f in faces[:4])
    return shown + (", …" if len(faces) > 4 else "")


def validate_polygons(mesh: PolygonMesh) -> Soundness:
    """Prove a polyhedron finite, oriented and manifold at every edge and vertex, or name the first fault.

    The rules, in order: at least one face; finite vertices; no face that names a vertex twice; every
    vertex used; no edge with more than two faces; neighbours turn the same way; no two faces that are
    each other's back; one fan of faces at every vertex. Faces may be concave, bent, or meet in several
    edges; a vertex may have two edges only.
    """
    vertices, faces = len(mesh.vertices), len(mesh)
    problem = _polygon_points_problem(mesh)
    twin = np.empty(0, np.int64)
    if problem is None:
        twin = twin_corners(mesh)
        problem = (
            _polygon_edges_problem(mesh)
            or _polygon_doubled_problem(mesh, twin)
            or _polygon_fans_problem(mesh, twin)
        )
    if problem is not None:
        return Soundness(vertices, faces, problem=problem)
    boundary = int(np.count_nonzero(twin < 0))
    return Soundness(vertices, faces, (len(twin) + boundary) // 2, boundary)


def require_polygons(mesh: PolygonMesh, closed: bool = False, name: str = "mesh") -> Soundness:
    """Like `validate_polygons`, but raises MeshError, in one sentence that begins with `name`."""
    found = validate_polygons(mesh)
    if found.problem is not None:
        raise MeshError(f"{name}: {found.problem}")
    if closed and not found.closed:
        raise MeshError(
            f"{name}: {found.boundary_edges} edges have a face on one side only; "
            "a closed surface is needed: fill the holes"
        )
    return found


def twin_corners(mesh: PolygonMesh) -> AnyArray:
    """(C,) int64: for the side that begins at each corner, the one that runs back along it; -1 on a boundary.

    Where more than two sides run between two vertices, one of them is taken.
    """
    there, back = _keys(mesh)
    order = np.argsort(there, kind="stable")
    place = np.searchsorted(there[order], back)
    found = np.append(there[order], -1)[place] == back
    return np.where(found, np.append(order, -1)[place], -1)


def _keys(mesh: PolygonMesh) -> tuple[AnyArray, AnyArray]:
    tails, heads = mesh.corners.astype(np.int64), mesh.heads.astype(np.int64)
    return tails * len(mesh.vertices) + heads, heads * len(mesh.vertices) + tails


def _polygon_points_problem(mesh: PolygonMesh) -> str | None:
    if not len(mesh):
        return "there are no faces; a surface needs at least one"
    wild = np.logical_not(np.isfinite(mesh.vertices).all(axis=1))
    if wild.any():
        more = int(wild.sum()) - 1
        return f"vertex {int(np.argmax(wild))} is not finite (and {more} more); coordinates must be numbers"
    order = np.lexsort([mesh.corners, mesh.owners])
    again = (np.diff(mesh.corners[order]) == 0) & (np.diff(mesh.owners[order]) == 0)
    if again.any():
        f = int(mesh.owners[order][int(np.argmax(again))])
        return (
            f"face {f} names vertex {mesh.corners[order][int(np.argmax(again))]} twice; cut it in two there"
        )
    unused = np.bincount(mesh.corners, minlength=len(mesh.vertices)) == 0
    if unused.any():
        more = int(unused.sum()) - 1
        return f"vertex {int(np.argmax(unused))} belongs to no face (and {more} more); remove unused vertices"
    return None


def _polygon_edges_problem(mesh: PolygonMesh) -> str | None:
    there, _ = _keys(mesh)
    order = np.argsort(there, kind="stable")
    again = np.flatnonzero(np.diff(there[order]) == 0)
    if not len(again):
        return None
    c = int(order[again[0]])
    a, b = int(mesh.corners[c]), int(mesh.heads[c])
    along = ((mesh.corners == a) & (mesh.heads == b)) | ((mesh.corners == b) & (mesh.heads == a))
    around = mesh.owners[along]
    listed = ", ".join(str(f) for f in around[:4]) + (", …" if len(around) > 4 else "")
    if len(around) > 2:
        return (
            f"edge {a}-{b} has {len(around)} faces ({listed}); it may have two at most: split the mesh there"
        )
    return f"faces {listed} run along edge {a}-{b} the same way; neighbours must agree: turn one round"


def _polygon_doubled_problem(mesh: PolygonMesh, twin: AnyArray) -> str | None:
    """A face all of whose sides have the same face on their other side is a sheet without thickness."""
    across = np.where(twin < 0, -1, mesh.owners[twin])
    low = np.minimum.reduceat(across, mesh.offsets[:-1])
    high = np.maximum.reduceat(across, mesh.offsets[:-1])
    doubled = (low == high) & (low >= 0)
    if not doubled.any():
        return None
    f = int(np.argmax(doubled))
    return f"face {f} has face {low[f]} with the same vertices on its back; remove one of the two"


def _polygon_fans_problem(mesh: PolygonMesh, twin: AnyArray) -> str | None:
    """Walking round a vertex from one of its sides must reach them all."""
    count = len(twin)
    before = np.arange(count) - 1
    before[mesh.offsets[:-1]] = mesh.offsets[1:] - 1
    onwards = twin[before]
    ends, starts = np.flatnonzero(onwards < 0), np.flatnonzero(twin < 0)
    most = np.bincount(mesh.corners[ends], minlength=len(mesh.vertices))
    if (most > 1).any():
        return _two_parts(int(np.argmax(most > 1)))
    first = np.full(len(mesh.vertices), -1)
    first[mesh.corners[starts]] = starts
    onwards[ends] = first[mesh.corners[ends]]  # an open fan is closed across its gap
    label, jump = np.arange(count), onwards
    while True:
        lower = np.minimum(label, label[jump])
        if np.array_equal(lower, label):
            break
        label, jump = lower, jump[jump]
    split = label != label[_any_corner(mesh)][mesh.corners]
    return _two_parts(int(mesh.corners[int(np.argmax(split))])) if split.any() else None


def _any_corner(mesh: PolygonMesh) -> AnyArray:
    corner = np.empty(len(mesh.vertices), np.int64)
    corner[mesh.corners] = np.arange(len(mesh.corners))
    return corner


def _two_parts(vertex: int) -> str:
    return (
        f"vertex {vertex} joins two parts of the surface by a point only; give each part a vertex of its own"
    )
