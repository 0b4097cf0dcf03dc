"""Parts of surfaces that are left out: what is stretched too far, and what is too old."""

from __future__ import annotations

import numpy as np

from flowsculpt import TriangleMesh
from flowsculpt.api.meshes import Floats, connected_components


def stretches(points: Floats, flat: Floats, faces: np.ndarray) -> Floats:
    """Return how many times as long each face (F,) makes a length along the first coordinate.

    points  (V, 3)
    flat    (F, 3, 2) coordinates of the corners of each face
    """
    corners = points[faces]
    (a, b), (c, d) = (flat[:, 1] - flat[:, 0]).T, (flat[:, 2] - flat[:, 0]).T
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = a * d - b * c
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (d[:, None] * one - b[:, None] * other) / area[:, None]
    return np.nan_to_num(np.linalg.norm(along, axis=1), nan=0.0, posinf=0.0)


def with_faces(mesh: TriangleMesh, kept: np.ndarray) -> TriangleMesh:
    """Return a mesh with some of its faces, flags (F,); vertices where it falls apart become several."""
    faces = mesh.faces[kept]
    corners = np.arange(3 * len(faces)).reshape(-1, 3)
    ends = np.concatenate([np.column_stack([faces[:, k], faces[:, (k + 1) % 3]]) for k in range(3)])
    at = np.concatenate([np.column_stack([corners[:, k], corners[:, (k + 1) % 3]]) for k in range(3)])
    low = ends[:, 0] < ends[:, 1]
    ends[~low], at[~low] = ends[~low, ::-1], at[~low, ::-1]
    order = np.lexsort(ends.T)
    pairs = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    joined = np.concatenate([np.column_stack([at[order[pairs], k], at[order[pairs + 1], k]]) for k in (0, 1)])
    component = connected_components(3 * len(faces), *joined.T)
    _, first, number = np.unique(component, return_index=True, return_inverse=True)
    source = faces.ravel()[first]
    attributes = {name: values[source] for name, values in mesh.attributes.items()}
    return TriangleMesh(mesh.vertices[source], number.reshape(-1, 3), attributes)


def cut_below(mesh: TriangleMesh, heights: Floats, limit: float) -> TriangleMesh:
    """Return the part of a mesh where heights (V,) are at least a limit.

    Faces across it are cut. A new vertex, with its attributes, is the mean of the ends of its edge, by its
    place between them.
    """
    below, faces = heights < limit, mesh.faces
    count = below[faces].sum(axis=1)
    crossing = faces[(count == 1) | (count == 2)]
    ends = np.concatenate([crossing[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]).astype(np.int64)
    ends = np.unique(np.sort(ends[below[ends[:, 0]] != below[ends[:, 1]]], axis=1), axis=0)
    low, high = ends.T
    share = ((limit - heights[low]) / (heights[high] - heights[low]))[:, None]
    keys = low * len(heights) + high

    def with_new(values: Floats) -> Floats:
        flat = values.reshape(len(values), -1)
        between = ((1.0 - share) * flat[low] + share * flat[high]).astype(values.dtype)
        return np.concatenate([values, between.reshape(-1, *values.shape[1:])])

    def cut(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        first, last = np.minimum(one, other).astype(np.int64), np.maximum(one, other)
        return np.asarray(len(heights) + np.searchsorted(keys, first * len(heights) + last))

    kept = [faces[count == 0]]
    for many in (1, 2):  # corners below
        some = faces[count == many]
        alone = np.argmax(below[some] == (many == 1), axis=1)  # on its side
        a, b, c = (some[np.arange(len(some)), (alone + k) % 3] for k in range(3))
        ab, ca = cut(a, b), cut(a, c)
        above = ((ab, b, c), (ab, c, ca)) if many == 1 else ((a, ab, ca),)
        kept += [np.stack(corners, 1) for corners in above]
    every = np.concatenate(kept)
    attributes = {name: with_new(values) for name, values in mesh.attributes.items()}
    return with_faces(TriangleMesh(with_new(mesh.vertices), every, attributes), np.ones(len(every), bool))
