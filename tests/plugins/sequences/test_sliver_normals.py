"""Slivers in files without normals do not count as creases, and creases beside them stay."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.mesh.normals import split_at_creases
from tests.needed_plugins import needs_plugins

pytestmark = needs_plugins("sequences")


def strip(turn: float, width: float = 0.02, lift: float = 0.03) -> TriangleMesh:
    """Return two flat sides that turn by an angle (degrees) at z, with slivers that stand up between them."""
    angle, z = np.radians(turn), np.arange(4.0)
    side = np.array([np.cos(angle), -np.sin(angle), 0.0])
    along = np.array([0.0, 0.0, 1.0])
    rows = [
        [np.array([-1.0, 0.0, 0.0]) + k * along for k in z],
        [k * along for k in z],
        [width * side + lift * np.array([0.0, 1.0, 0.0]) * (k == 1) + k * along for k in z],
        [side + k * along for k in z],
    ]
    points = np.concatenate(rows)
    faces = []
    for row in range(3):
        for k in range(3):
            a, b = 4 * row + k, 4 * (row + 1) + k
            faces += [[a, a + 1, b], [b, a + 1, b + 1]]
    return TriangleMesh(points, np.array(faces, np.int32))


def test_a_sliver_that_stands_up_leaves_a_flat_surface_smooth() -> None:
    from flowsculpt.pipeline.plugins.sequences.sliver_normals import sliver_normals

    mesh = strip(0.0)
    assert len(split_at_creases(mesh).vertices) > len(mesh.vertices), "by the angle its edges are creases"
    normals = sliver_normals(PolygonMesh.from_triangles(mesh))
    assert normals is not None
    assert (normals[4:12, 1] > 0.999).all() and not normals[[0, 15]].any()
    shaded = split_at_creases(mesh.with_attributes(normal=normals))
    large = mesh.face_normals[:, 1] > 0.99
    assert (shaded.normals[shaded.faces[large]][..., 1] > 0.999).all()


def test_a_small_face_that_stands_up_leaves_a_flat_surface_smooth() -> None:
    """A small triangle, not a sliver, stands in the middle of a large one."""
    from flowsculpt.pipeline.plugins.sequences.sliver_normals import sliver_normals

    points = [[-1, 0, -1], [1, 0, -1], [0, 0, 1], [-0.04, 0, 0], [0.04, 0, 0], [0, 0.06, 0.06]]
    faces = [[3, 5, 4], [0, 3, 1], [1, 3, 4], [1, 4, 2], [2, 4, 5], [2, 5, 0], [0, 5, 3]]
    mesh = TriangleMesh(np.array(points, float), np.array(faces, np.int32))
    assert len(split_at_creases(mesh).vertices) > len(points), "by the angle its edges are creases"
    normals = sliver_normals(PolygonMesh.from_triangles(mesh))
    assert normals is not None
    assert (normals[3:, 1] > 0.97).all()


@pytest.mark.parametrize("turn", [60.0, 90.0])
def test_a_crease_along_slivers_stays_one(turn: float) -> None:
    from flowsculpt.pipeline.plugins.sequences.sliver_normals import sliver_normals

    normals = sliver_normals(PolygonMesh.from_triangles(strip(turn, lift=0.0)))
    assert normals is not None and not normals.any()


def test_a_surface_without_slivers_and_one_of_quads_have_no_such_normals() -> None:
    from flowsculpt.pipeline.plugins.sequences.sliver_normals import sliver_normals

    assert sliver_normals(PolygonMesh.from_triangles(strip(0.0, width=0.5))) is None
    quads = PolygonMesh([[0, 0, 0], [1, 0, 0], [1, 0.01, 0], [0, 0.01, 0]], [[0, 1, 2, 3]])
    assert sliver_normals(quads) is None
