"""Measures of a surface: edges, triangles, volume, and its distance from the exact surface."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Faces, Floats, Indices, Points, Vectors
from flowsculpt.pipeline.mesh import TriangleMesh

if TYPE_CHECKING:
    from benchmarks.works import Film

SAMPLES = 4000
"""Vertices, and faces, whose distance is measured; all if there are fewer."""

_HARD = math.radians(30)
_NEAR = 0.1  # maximum edges: how far a crease may be from where it belongs


def edges_of(faces: Faces) -> Indices:
    """Return the edges (E, 2), each once."""
    pairs = np.sort(np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    return np.unique(pairs.astype(np.int64) @ (1 << 32, 1)).view(np.int32).reshape(-1, 2)[:, ::-1].copy()


def lengths_of(points: Points, edges: Indices) -> Floats:
    lengths: Floats = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    return lengths


def volume(mesh: TriangleMesh) -> float:
    points = mesh.vertices - mesh.vertices.mean(axis=0)
    a, b, c = (points[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def quality(mesh: TriangleMesh) -> Floats:
    """Return twice the inradius over the circumradius (F,): 1 for an equilateral triangle, 0 for a needle."""
    ends = mesh.vertices[mesh.faces]
    a, b, c = np.linalg.norm(np.roll(ends, 1, axis=1) - ends, axis=2).T
    shape: Floats = (b + c - a) * (c + a - b) * (a + b - c) / np.maximum(a * b * c, 1e-300)
    return np.clip(shape, 0, 1)


def facets(mesh: TriangleMesh) -> Vectors:
    """Return unit normals (F, 3); zero if a face has no area."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    normals: Vectors = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    return normals


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def exactness(film: Film, mesh: TriangleMesh, frame: int, samples: int = SAMPLES) -> dict[str, float]:
    """Return distances of vertices and face centres from the exact surface, and angles of the faces.

    Distances are in maximum edge lengths. A point is followed back to rest, where its height above the true
    surface is known; the height over its gradient at the point is the distance, to first order.
    """
    rng = np.random.default_rng(1)
    few = rng.permutation(len(mesh.vertices))[:samples]
    faces = rng.permutation(len(mesh.faces))[:samples]
    points = np.concatenate([mesh.vertices[few], mesh.vertices[mesh.faces[faces]].mean(axis=1)])
    h = 1e-4 * film.max_edge_length
    around = np.concatenate([np.zeros((1, 3)), h * np.eye(3), -h * np.eye(3)])
    asked = (points[None] + around[:, None]).reshape(-1, 3)
    heights = film.height(film.follow(asked, frame, 0)).reshape(7, -1)
    gradient = (heights[1:4] - heights[4:7]).T / (2 * h)
    steepness = np.maximum(np.linalg.norm(gradient, axis=1), 1e-12)
    off = np.abs(heights[0]) / steepness / film.max_edge_length
    told = np.einsum("ij,ij->i", facets(mesh)[faces], gradient[len(few) :]) / steepness[len(few) :]
    angles = np.degrees(np.arccos(np.clip(told, -1, 1)))
    return {
        "vertices rms": rms(off[: len(few)]),
        "surface rms": rms(off),
        "normal 95%": float(np.quantile(angles, 0.95)),
        "% flipped": 100 * float(np.mean(told < 0)),
    }


def creases_kept(film: Film, mesh: TriangleMesh, frame: int) -> float:
    """Return the share of the cube's edges that the mesh still has as creases.

    Points of the twelve edges are carried exactly; each needs a crease within 0.1 maximum edge lengths.
    """
    ends = mesh.vertices[_hard_edges(mesh)]
    if not len(ends):
        return 0.0
    along = np.linspace(-1, 1, 150)
    lines = []
    for axis in range(3):
        for one in (-1.0, 1.0):
            for two in (-1.0, 1.0):
                line = np.empty((len(along), 3))
                line[:, axis], line[:, (axis + 1) % 3], line[:, (axis + 2) % 3] = along, one, two
                lines.append(line)
    truth = film.follow(np.concatenate(lines), 0, frame)
    start, side = ends[:, 0], ends[:, 1] - ends[:, 0]
    near = [_to_segments(point, start, side) for point in truth]
    return float(np.mean(np.array(near) < _NEAR * film.max_edge_length))


def _to_segments(point: Points, start: Points, side: Vectors) -> float:
    """Return the distance of one point from the nearest line segment."""
    away = point - start
    share = np.clip(np.einsum("ij,ij->i", away, side) / np.einsum("ij,ij->i", side, side), 0, 1)
    return float(np.linalg.norm(away - share[:, None] * side, axis=1).min())


def _hard_edges(mesh: TriangleMesh) -> Indices:
    """Return the edges (K, 2) that turn by more than 30 degrees."""
    ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    keys = np.sort(ends, axis=1).astype(np.int64) @ (1 << 32, 1)
    order = np.argsort(keys, kind="stable")
    pairs = np.flatnonzero(keys[order][1:] == keys[order][:-1])
    one, two = order[pairs], order[pairs + 1]
    normals = facets(mesh)
    turned = np.einsum("ij,ij->i", normals[one // 3], normals[two // 3]) < math.cos(_HARD)
    hard: Indices = ends[one[turned]]
    return hard


Nearest = Callable[[Points, Points, Faces], AnyArray]
"""(points (N, 3), vertices, faces) -> (N,) the nearest face of each point."""


def pop(before: TriangleMesh, after: TriangleMesh, nearest: Nearest, samples: int = 3000) -> float:
    """Return the rms angle, degrees, by which facets at random points turn when a surface is resampled."""
    rng = np.random.default_rng(2)
    faces = rng.integers(0, len(after.faces), samples)
    weights = rng.dirichlet([1, 1, 1], samples)
    points = np.einsum("ijk,ij->ik", after.vertices[after.faces[faces]], weights)
    same = nearest(points, before.vertices, before.faces)
    cosine = np.einsum("ij,ij->i", facets(after)[faces], facets(before)[same])
    return rms(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def told(row: Mapping[str, float | str], name: str) -> float:
    """Return a number of a row."""
    value = row[name]
    assert isinstance(value, int | float)
    return float(value)
