"""Smoothing along a surface: vertices of poor triangles move towards the middle of their neighbours."""

from __future__ import annotations

import numpy as np

from flowsculpt.api.meshes import Floats, Indices
from flowsculpt.pipeline.plugins.interchange.shown_surfaces import CarriedFaces, Places, ShownSurface, unit

POOR = 0.2
"""The shape of a triangle below which its corners are moved: 1 if its sides are equal, 0 if it is flat."""

PASSES = 3

SHARE = 0.5
"""How far vertices go towards the middle of their neighbours in a pass."""

FLAT = 0.85
"""The cosine of the angle of a vertex's normal and its neighbours' from which on it moves: rims stay."""

FOLDED = 0.2
"""The same for a vertex of a face that lies backwards."""


def smoothed(shown: ShownSurface, carried: CarriedFaces, places: Places, poor: float = POOR) -> Places:
    """Return places (V,) on a surface, with corners of poor triangles moved along it.

    A vertex moves where the poorest of its triangles gets better. Those of creases and boundaries stay.
    """
    mesh = carried.mesh
    for _ in range(PASSES):
        normals = places.normals
        shapes = _shapes(places.points, mesh.faces, normals)
        flat = np.full(len(mesh.vertices), np.inf)
        flat[mesh.faces[shapes < poor]] = FLAT
        flat[mesh.faces[shapes < 0.0]] = FOLDED
        rows = np.flatnonzero((flat < 1.0) & ~carried.is_bound)
        if not len(rows):
            break
        rows, goals = _goals(places.points, normals, carried.edges, rows, flat[rows])
        there = shown.followed(goals, normals[rows])
        points = places.points.copy()
        points[rows] = there.points
        around = np.isin(mesh.faces, rows).any(axis=1)
        worst = [
            _worst(mesh.faces[around], values, len(points))
            for values in (shapes[around], _shapes(points, mesh.faces[around], normals))
        ]
        is_better = worst[1][rows] > worst[0][rows]
        if not is_better.any():
            break
        places = Places(*(np.array(values) for values in places))
        places.put(rows[is_better], Places(*(values[is_better] for values in there)))
    return places


def _goals(
    points: Floats, normals: Floats, edges: Indices, rows: np.ndarray, flat: Floats
) -> tuple[np.ndarray, Floats]:
    """Return which of the vertices move, and where to (N, 3) in their tangent planes.

    flat  (N,) as FLAT, of each vertex
    """
    number = np.full(len(points), -1)
    number[rows] = np.arange(len(rows))
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[number[both[:, 0]] >= 0]
    here, other = number[both[:, 0]], both[:, 1]
    counts = np.bincount(here, minlength=len(rows))
    sums = np.stack([np.bincount(here, points[other, k], len(rows)) for k in range(3)], axis=1)
    way = SHARE * (sums / counts[:, None] - points[rows])
    way -= np.einsum("ij,ij->i", way, normals[rows])[:, None] * normals[rows]
    bend = np.ones(len(rows))
    np.minimum.at(bend, here, np.einsum("ij,ij->i", normals[both[:, 0]], normals[other]))
    moving = bend > flat
    return rows[moving], points[rows[moving]] + way[moving]


def _shapes(points: Floats, faces: Indices, normals: Floats) -> Floats:
    """Return the shapes (F,) of triangles, below 0 where they lie backwards: area over squares of sides."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    across = np.einsum("ij,ij->i", np.cross(b - a, c - a), unit(normals[faces].sum(axis=1)))
    squares = sum(np.einsum("ij,ij->i", side, side) for side in (b - a, c - b, a - c))
    return np.asarray(2.0 * np.sqrt(3.0) * across / np.where(squares > 0.0, squares, 1.0))


def _worst(faces: Indices, shapes: Floats, count: int) -> Floats:
    """Return the poorest shape (V,) of the triangles at each vertex."""
    worst = np.full(count, np.inf)
    for corners in faces.T:
        np.minimum.at(worst, corners, shapes)
    return worst
