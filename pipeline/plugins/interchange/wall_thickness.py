"""The thinnest wall of a closed surface, estimated by rays from its faces into the body.

A ray starts at the middle of a face and goes against its normal, up to where it leaves the body again. Rays
are intersected with triangles as by T. Möller and B. Trumbore, "Fast, minimum storage ray-triangle
intersection", Journal of Graphics Tools 2(1), 1997.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats, Points, Vectors
from pipeline.flow.regions import TriangleTree
from pipeline.mesh import TriangleMesh, face_normals

RAYS = 4000
"""The most faces that rays start from, chosen evenly."""


class Rays(NamedTuple):
    """Rays from origins (R, 3) in unit directions (R, 3)."""

    origins: Points
    directions: Vectors


def wall_thickness(mesh: TriangleMesh, rays: int = RAYS) -> Floats:
    """Return distances through the body of a closed mesh, (R,), in its units, from R of its faces.

    Infinite where a ray does not meet the surface again. No wall is thicker than the distances at its faces.
    """
    normals, corners = face_normals(mesh), mesh.vertices[mesh.faces]
    sound = np.flatnonzero(np.linalg.norm(normals, axis=1) > 0.5)  # a face without area has no normal
    starts = sound[np.linspace(0, len(sound) - 1, min(rays, len(sound))).astype(int)]
    return distances(TriangleTree.of(corners), Rays(corners[starts].mean(axis=1), -normals[starts]), starts)


def distances(tree: TriangleTree, rays: Rays, starts: AnyArray) -> Floats:
    """Return how far rays go until they meet a triangle, (R,), infinite where they meet none.

    starts  (R,) the triangle that each starts on, which does not count

    All rays go down the tree together, a level at a time.
    """
    boxes = tree.memory[: tree.triangles].reshape(-1, 8)
    corners = tree.memory[tree.triangles :].reshape(-1, 3, 3)
    nearest = np.full(len(starts), np.inf)
    ray, box = np.arange(len(starts)), np.zeros(len(starts), np.int64)
    while len(ray):
        entry = _entries(rays.origins[ray], rays.directions[ray], boxes[box])
        kept = entry < nearest[ray]
        ray, box = ray[kept], box[kept]
        is_leaf = boxes[box, 7] > 0
        _meet(tree, corners, rays, ray[is_leaf], box[is_leaf], starts, nearest)
        ray, parent = ray[~is_leaf], box[~is_leaf]
        second = boxes[parent, 6].astype(np.int64)
        ray, box = np.concatenate([ray, ray]), np.concatenate([parent + 1, second])
    return nearest


def _entries(origins: Points, directions: Vectors, boxes: Floats) -> Floats:
    """Return where rays (N,) enter their boxes, infinite where they miss them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (boxes[:, :3] - origins) / directions
        high = (boxes[:, 3:6] - origins) / directions
    first = np.nanmax(np.minimum(low, high), axis=1)
    last = np.nanmin(np.maximum(low, high), axis=1)
    return np.where((last >= first) & (last >= 0.0), first, np.inf)


def _meet(
    tree: TriangleTree,
    corners: Floats,
    rays: Rays,
    ray: AnyArray,
    box: AnyArray,
    starts: AnyArray,
    nearest: Floats,
) -> None:
    """Intersect rays with the triangles of leaves; lower `nearest` in place."""
    counts = tree.ranges[box, 1] - tree.ranges[box, 0]
    ray = np.repeat(ray, counts)
    within = np.arange(len(ray)) - np.repeat(np.cumsum(counts) - counts, counts)
    triangle = np.repeat(tree.ranges[box, 0], counts) + within
    other = tree.order[triangle] != starts[ray]
    ray, triangle = ray[other], triangle[other]
    a, b, c = corners[triangle].transpose(1, 0, 2)
    direction, from_corner = rays.directions[ray], rays.origins[ray] - a
    across = np.cross(direction, c - a)
    determinant = np.einsum("ij,ij->i", b - a, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", from_corner, across) / determinant
        along = np.cross(from_corner, b - a)
        v = np.einsum("ij,ij->i", direction, along) / determinant
        distance = np.einsum("ij,ij->i", c - a, along) / determinant
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
    np.minimum.at(nearest, ray[inside], distance[inside])
