"""One mesh for all frames: its triangles never change, and its normals are those of each frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere
from flowsculpt.pipeline.mesh.normals import split_at_creases, vertex_normals
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh


def twisted(surface: TriangleMesh, frames: int = 24) -> OneMesh:
    """Return the one mesh of a surface that twists about y by 90 degrees a unit of length."""

    def points_at(number: int) -> Points:
        x, y, z = surface.vertices.T
        angle = 0.5 * math.pi * y * (number - 1) / (frames - 1)
        return np.stack(
            [x * np.cos(angle) + z * np.sin(angle), y, z * np.cos(angle) - x * np.sin(angle)], axis=1
        )

    def velocities_at(number: int) -> Points:
        return 12.0 * (points_at(number + 1) - points_at(number - 1))

    numbers = tuple(range(1, frames + 1))
    return OneMesh.of("twisted", numbers, FrameRate.of(24), surface, "0" * 32, points_at, velocities_at)


def test_each_vertex_of_a_smooth_surface_has_one_normal_which_is_that_of_its_frame() -> None:
    mesh = twisted(icosphere(3))
    frame = mesh.frame(17)
    assert np.array_equal(mesh.corner_normals, mesh.faces)
    assert np.allclose(frame.normals, vertex_normals(TriangleMesh(frame.points, mesh.faces)))


def test_corners_at_creases_keep_the_normals_of_their_sides_however_far_the_surface_bends() -> None:
    cube = box(4)
    creased = cube.with_creases(_sharp_edges(cube))
    mesh = twisted(creased)
    rows = int(mesh.corner_normals.max()) + 1
    assert rows == len(split_at_creases(cube).vertices) > len(cube.vertices)
    for number in mesh.frames:
        assert len(mesh.frame(number).normals) == rows


def test_known_normals_are_taken_where_the_triangles_agree_with_them() -> None:
    mesh = twisted(icosphere(3))
    exact = mesh.frame(1).points / np.linalg.norm(mesh.frame(1).points, axis=1, keepdims=True)
    wrong = exact.copy()
    wrong[7], wrong[8] = -exact[7], 0.0
    found = replace(mesh, normals_at=lambda number: wrong).frame(1).normals
    of_triangles = mesh.frame(1).normals
    assert np.array_equal(np.delete(found, (7, 8), axis=0), np.delete(exact, (7, 8), axis=0))
    assert np.array_equal(found[[7, 8]], of_triangles[[7, 8]])


def test_velocities_are_those_of_the_points() -> None:
    mesh = twisted(icosphere(2))
    step = mesh.frame(12).points - mesh.frame(11).points
    assert np.allclose(mesh.frame(11).velocities / 24.0, step, atol=0.01)


def _sharp_edges(mesh: TriangleMesh) -> np.ndarray:
    from flowsculpt.pipeline.resample import edges_by_angle

    return edges_by_angle(mesh, math.radians(40.0))


@pytest.mark.parametrize(("least", "is_taken"), [(None, False), (0.5, True), (0.9, False)])
def test_a_normal_of_a_file_is_taken_in_a_fold_where_it_agrees_with_the_mean(
    least: float | None, is_taken: bool
) -> None:
    """Both faces of a roof turn by 60 degrees from its ridge."""
    high = np.sqrt(3.0)
    points = np.array([[0, high, 0], [0, high, 1], [1, 0, 0], [-1, 0, 0]], float)
    faces = np.array([[0, 1, 2], [1, 0, 3]], np.int32)
    known = np.tile([np.sin(0.6), np.cos(0.6), 0.0], (4, 1))
    mesh = OneMesh.of(
        "roof", (1,), FrameRate.of(24), TriangleMesh(points, faces), "", lambda n: points, lambda n: points
    )
    mesh = replace(mesh, normals_at=lambda number: known, least_agreement=least)
    normals = mesh.frame(1).normals
    expected = known[0] if is_taken else [0.0, 1.0, 0.0]
    np.testing.assert_allclose(normals[:2], [expected, expected], atol=1e-9)
