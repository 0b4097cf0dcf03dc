"""Open surfaces made thick."""

from __future__ import annotations

import numpy as np

from flowsculpt import TriangleMesh, vertex_normals


def shell(mesh: TriangleMesh, thickness: float) -> TriangleMesh:
    """Return the closed surface around a surface: both its sides, half the thickness away, and its rims.

    The vertices of the front come first, then in the same order those of the back. The attribute `material`
    gets half the thickness added along y in front, and taken off behind.
    """
    count, normals = len(mesh.vertices), vertex_normals(mesh)
    half = 0.5 * thickness * normals
    ends = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]).astype(
        np.int64
    )
    there = ends[:, 0] * count + ends[:, 1]
    rims = ends[~np.isin(there, ends[:, 1] * count + ends[:, 0])]
    a, b = rims.T
    back = mesh.faces[:, ::-1] + count
    sides = np.concatenate([np.column_stack([b, a, a + count]), np.column_stack([b, a + count, b + count])])
    vertices = np.concatenate([mesh.vertices + half, mesh.vertices - half])
    attributes = {name: np.concatenate([values, values]) for name, values in mesh.attributes.items()}
    if "material" in attributes:
        attributes["material"][:, 1] += np.repeat([0.5 * thickness, -0.5 * thickness], count)
    return TriangleMesh(vertices, np.concatenate([mesh.faces, back, sides]), attributes)
