"""Surfaces of a sequence whose faces change, frame by frame: one mesh is carried along them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flowsculpt import Thresholds, TriangleMesh, vertex_normals
from flowsculpt.api.flows import TriangleTree
from flowsculpt.api.meshes import (
    Floats,
    Indices,
    connected_components,
    edge_keys,
    split_at_creases,
)

AGREEING = 0.3
"""The cosine of the angle of two normals from which on they agree: the back of a thin wall does not."""

FOLLOWED, REACH = 0.5, 0.2
"""Distances, in median edges, over which points are drawn to faces that agree, and to creases."""

_VELOCITY = "velocity"  # the attribute of vertices, units per second of the flow


class Places(NamedTuple):
    """Places on the faces of a surface.

    points   (N, 3)
    face     (N,) faces; -1 where the surface has no face whose normal agrees
    shares   (N, 3) of the corners of each
    normals  (N, 3) of the surface, unit, smooth everywhere
    """

    points: Floats
    face: np.ndarray
    shares: Floats
    normals: Floats

    def put(self, rows: np.ndarray, places: Places) -> None:
        """Put other places at rows of these: numbers, or flags (N,)."""
        for values, own in zip(self, places, strict=True):
            values[rows] = own

    def joined(self, others: Places) -> Places:
        """Return these places and then others."""
        return Places(*(np.concatenate(both) for both in zip(self, others, strict=True)))

    def values(self, faces: Indices, values: Floats) -> Floats:
        """Return values (N, 3) at the places, of values (V, 3) at the vertices."""
        return np.asarray(np.einsum("nk,nkj->nj", self.shares, values[faces[self.face]]))


class Topology(NamedTuple):
    """What a mesh keeps while its vertices move.

    parts    connected ones
    handles  of all parts
    rims     boundaries of all parts
    """

    parts: int
    handles: int
    rims: int

    @classmethod
    def of(cls, mesh: TriangleMesh, least: float) -> Topology:
        """Return the topology of the parts whose bounding boxes have a diagonal of at least `least`."""
        edges, counts = edges_of(mesh.faces)
        part = connected_components(len(mesh.vertices), *edges.T)
        low, high = np.full((len(part), 3), np.inf), np.full((len(part), 3), -np.inf)
        np.minimum.at(low, part, mesh.vertices)
        np.maximum.at(high, part, mesh.vertices)
        used = np.zeros(len(part), bool)
        used[mesh.faces] = True
        is_large = (np.linalg.norm(high - low, axis=1) >= least)[part] & used
        rim = edges[(counts == 1) & is_large[edges[:, 0]]]
        parts = len(np.unique(part[is_large]))
        rims = len(np.unique(connected_components(len(part), *rim.T)[rim])) if len(rim) else 0
        euler = int(is_large.sum() - is_large[edges[:, 0]].sum() + is_large[mesh.faces[:, 0]].sum())
        return cls(parts, (2 * parts - rims - euler) // 2, rims)


def edges_of(faces: Indices) -> tuple[Indices, np.ndarray]:
    """Return each edge once (E, 2), and the number (E,) of its faces."""
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    keys, counts = np.unique(edge_keys(sides), return_counts=True)
    return ends_of_keys(keys), counts


def rims_of(faces: Indices) -> Indices:
    """Return the edges (K, 2) of boundaries."""
    edges, counts = edges_of(faces)
    return edges[counts == 1]


@dataclass(frozen=True, eq=False)
class CarriedFaces:
    """The faces of the mesh that is carried, and what follows from them in every frame."""

    mesh: TriangleMesh

    @cached_property
    def edges(self) -> Indices:
        """Each edge once (E, 2)."""
        return edges_of(self.mesh.faces)[0]

    @cached_property
    def is_bound(self) -> np.ndarray:
        """Whether vertices (V,) are those of creases and rims."""
        flags = np.zeros(len(self.mesh.vertices), bool)
        flags[self.mesh.creases] = flags[rims_of(self.mesh.faces)] = True
        return flags


def ends_of_keys(keys: np.ndarray) -> Indices:
    """Return the vertices (E, 2) of edges by their `edge_keys`."""
    return np.column_stack(np.divmod(keys, np.int64(1) << 32)).astype(np.int32)


@dataclass(frozen=True, eq=False)
class ShownSurface:
    """The surface of a frame.

    number      of the frame
    seconds     its time, of the flow
    mesh        with the attribute `velocity` where it is known
    hard_angle  radians: edges that turn by more are creases
    """

    number: int
    seconds: float
    mesh: TriangleMesh
    hard_angle: float

    @cached_property
    def tree(self) -> TriangleTree:
        return TriangleTree.of(self.mesh.vertices[self.mesh.faces])

    @cached_property
    def edge(self) -> float:
        """The median length of the edges."""
        return float(np.median(self._edges[1]))

    @cached_property
    def normals(self) -> Floats:
        """Unit normals (V, 3), smooth everywhere."""
        return vertex_normals(self.mesh)

    @cached_property
    def lengths(self) -> Floats:
        """The mean lengths (V, 1) of the edges at each vertex."""
        (a, b), lengths = self._edges[0].T, self._edges[1]
        count = len(self.mesh.vertices)
        sums = np.bincount(a, lengths, count) + np.bincount(b, lengths, count)
        return (sums / np.maximum(np.bincount(a, None, count) + np.bincount(b, None, count), 1))[:, None]

    @cached_property
    def _edges(self) -> tuple[Indices, Floats]:
        edges = edges_of(self.mesh.faces)[0]
        a, b = edges.T
        return edges, np.linalg.norm(self.mesh.vertices[a] - self.mesh.vertices[b], axis=1)

    def with_creases(self) -> TriangleMesh:
        """Return the bare mesh with its creases."""
        mesh = TriangleMesh(self.mesh.vertices, self.mesh.faces)
        return Thresholds(self.edge, hard_angle=self.hard_angle).with_hard_edges(mesh)

    def vertices_places(self) -> Places:
        """Return the places of its own vertices."""
        corner = np.zeros(len(self.mesh.vertices), np.int64)
        corner[self.mesh.faces.ravel()] = np.arange(self.mesh.faces.size)
        return Places(self.mesh.vertices, corner // 3, np.eye(3)[corner % 3], self.normals)

    def nearest(self, points: Floats, normals: Floats, least: float = AGREEING) -> Places:
        """Return the nearest places to points (N, 3) on faces whose normals agree with normals (N, 3).

        least  the cosine of their angle, at least
        """
        on, face, shares = nearest_points(self.tree, self.mesh, points, normals, least)
        found = Places(on, face, shares, self.normals[:0])
        return found._replace(normals=unit(found.values(self.mesh.faces, self.normals)))

    def followed(self, points: Floats, normals: Floats) -> Places:
        """Return the places to which points (N, 3) that are nearly on the surface belong.

        Where no face within FOLLOWED agrees with the normal, as at the tips of spires, the nearest one counts
        that is not a back.
        """
        places = self.nearest(points, normals)
        far = np.linalg.norm(places.points - points, axis=1) > FOLLOWED * self.edge
        rows = (places.face < 0) | far
        for least in (-AGREEING, -1.0):
            if rows.any():
                places.put(rows, self.nearest(points[rows], normals[rows], least))
            rows = places.face < 0
        return places

    def on_faces(self, places: Places) -> Places:
        """Return the places at the same shares of the same faces as those of a surface with these faces."""
        points = places.values(self.mesh.faces, self.mesh.vertices)
        return places._replace(points=points, normals=unit(places.values(self.mesh.faces, self.normals)))

    def on_bounds(self, points: Floats) -> Floats:
        """Return the nearest points (N, 3) on creases and rims; points that are far from any stay."""
        tree, ends = self._bounds
        if tree is None or not len(points):
            return points
        segment, shares = tree.nearest(points)
        a, b = ends[segment].swapaxes(0, 1)
        on = a + shares.sum(axis=1, keepdims=True) * (b - a)
        is_near = np.linalg.norm(on - points, axis=1) < REACH * self.edge
        return np.where(is_near[:, None], on, points)

    @cached_property
    def _bounds(self) -> tuple[TriangleTree | None, Floats]:
        """Creases and rims as a tree of segments, None without any; and their ends (K, 2, 3)."""
        rims, creases = rims_of(self.mesh.faces), self.with_creases().creases
        ends = self.mesh.vertices[np.concatenate([creases, rims])]
        return TriangleTree.of(ends[:, [0, 1, 1]]) if len(ends) else None, ends

    def shading(self, places: Places) -> Floats:
        """Return unit normals (N, 3) at places, smooth up to creases."""
        shaded = split_at_creases(self.mesh, self.hard_angle)
        return unit(places.values(shaded.faces, shaded.normals))

    def velocities(self, places: Places) -> Floats:
        """Return the velocities (N, 3) at places; zero where they are not known."""
        known = self.mesh.attributes.get(_VELOCITY)
        return np.zeros_like(places.points) if known is None else places.values(self.mesh.faces, known)

    def topology(self, tolerance: float) -> Topology:
        """Return its topology; parts smaller than `tolerance`, in median edges, are left out."""
        return Topology.of(self.mesh, tolerance * self.edge)


def nearest_points(
    tree: TriangleTree, mesh: TriangleMesh, points: Floats, facing: Floats, least: float = 0.0
) -> tuple[Floats, np.ndarray, Floats]:
    """Return the nearest points (N, 3) on faces of a mesh that face directions (N, 3).

    Returns their faces (N,), and the shares (N, 3) of the corners, too. Where no face does, the face is -1,
    and the point the given one.
    """
    face, two = tree.nearest(points, facing, least)
    shares = np.column_stack([1.0 - two.sum(axis=1), two])
    on = np.einsum("nk,nkj->nj", shares, mesh.vertices[mesh.faces[face]])
    return np.where((face < 0)[:, None], points, on), face, shares


def unit(vectors: Floats) -> Floats:
    """Return unit vectors (N, 3), and zero for zero."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0.0, lengths, 1.0))
