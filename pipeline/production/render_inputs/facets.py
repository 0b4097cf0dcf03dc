"""Facets of outlines, hidden by cutting the curved patches over the triangles as finely as a picture needs.

A picture shows a straight edge where the patch over it curves (P37). Half-way along an edge the two are
farthest apart. Where that is less than LEAST pixels no corner shows, and nothing is cut.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pipeline.arrays import AnyArray, Floats
from pipeline.mesh.normals import ShadedMesh, spread, tessellate
from pipeline.production.render_inputs.view_geometry import rotate_y
from render.scene.render_camera import Camera
from render.scene.render_quality import Quality

LEAST = 0.2
"""Pixels between an edge and the patch over it that no one sees."""

SHARE = 0.99
"""Share of the edges that must be so close: a few noisy normals do not justify cutting all."""

MOST_PIECES, MOST_FACES = 8, 1_000_000
"""The most pieces of an edge, and the most faces, that are cut for this reason."""

_EDGE = 1.1
"""Edges count up to here from the middle of the picture, in halves of its sides."""


def pieces_without_facets(
    arrays: Mapping[str, AnyArray],
    camera: Camera,
    quality: Quality,
    spin: float,
    around: AnyArray | None = None,
) -> int:
    """Return into how many pieces every edge of a surface is cut, so that its outline has no corners.

    arrays  as `Shading.arrays` returns them
    spin    turn of the subject, radians
    around  points about the axis of whose bounds it turns; by default its own
    """
    faces = arrays["faces"]
    most = min(MOST_PIECES, math.isqrt(MOST_FACES // max(1, len(faces))))
    if most < 2:
        return 1
    points = rotate_y(arrays["vertices"], spin, around=around)
    seen = camera.project(points, quality.aspect)
    visible = (seen[:, 2] > camera.near) & (np.abs(seen[:, :2]) <= _EDGE).all(axis=1)
    distances = []
    for corner in range(3):
        a, b = faces[:, corner], faces[:, (corner + 1) % 3]
        counted = (a < b) & visible[a] & visible[b]
        a, b = a[counted], b[counted]
        distances.append(_patch_distance(points, rotate_y(arrays["normals"], spin, True), a, b) / seen[a, 2])
    found = np.concatenate(distances)
    if not len(found):
        return 1
    pixels = float(np.quantile(found, SHARE)) / camera.pixel_size(quality.width)
    return max(1, min(most, math.ceil(math.sqrt(pixels / LEAST) - 1e-6)))


def _patch_distance(points: AnyArray, normals: AnyArray, a: AnyArray, b: AnyArray) -> Floats:
    """Return the distance (N,) of patches from the middle of their edges between vertices a and b (N,)."""
    along = points[b] - points[a]
    out, back = (np.einsum("ij,ij->i", along, normals[v])[:, None] * normals[v] for v in (a, b))
    return np.asarray(np.linalg.norm(out - back, axis=1) / 8.0)


def diced(arrays: Mapping[str, AnyArray], pieces: int) -> dict[str, AnyArray]:
    """Return the arrays of a surface whose edges are cut into pieces, on curved patches."""
    if pieces == 1:
        return dict(arrays)
    vertices, normals = (arrays[name].astype(np.float64) for name in ("vertices", "normals"))
    shaded = ShadedMesh(vertices, normals, arrays["faces"], arrays["source_vertex"])
    fine = tessellate(shaded, pieces)
    itself = shaded._replace(source_vertex=np.arange(len(vertices), dtype=np.int32))
    return {
        **arrays,
        "vertices": fine.vertices.astype(np.float32),
        "normals": fine.normals.astype(np.float32),
        "faces": fine.faces,
        "source_vertex": fine.source_vertex,
        "material": spread(arrays["material"], itself, fine).astype(np.float32),
    }
