"""Curved patches over triangles: rounder than the triangles, and without cracks (P37)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import (
    ShadedMesh,
    TriangleMesh,
    box,
    icosphere,
    rod,
    sheet,
    split_at_creases,
    torus,
    validate,
)
from flowsculpt.pipeline.mesh.normals import tessellate, twins_of

MESHES: dict[str, TriangleMesh] = {
    "ball": icosphere(3),
    "torus": torus(1.0, 0.4, 0.3),
    "cylinder": rod(2.0, 0.5, 0.25, "flat"),
    "box": box((2.0, 1.0, 1.0), 0.5),
    "sheet": sheet((2.0, 1.0), 0.5),
}
each_mesh = pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)


def bent(mesh: TriangleMesh, seed: int = 1) -> ShadedMesh:
    """A mesh that has lost all symmetry, shaded."""
    points = mesh.vertices + 0.2 * np.sin(2.0 * mesh.vertices[:, (1, 2, 0)] + seed)
    return split_at_creases(mesh.with_vertices(points))


def welded(shaded: ShadedMesh) -> TriangleMesh:
    """Vertices at the very same place made one."""
    rows = np.ascontiguousarray(shaded.vertices + 0.0).view([("", np.float64)] * 3).ravel()
    _, first, joined = np.unique(rows, return_index=True, return_inverse=True)
    return TriangleMesh(shaded.vertices[first], joined.reshape(-1)[shaded.faces])


def patch(points: Points, normals: Points, weights: Floats) -> tuple[Floats, Floats]:
    """A point-normal triangle at barycentric weights, as the paper writes it: the readable twin."""
    (p1, p2, p3), (n1, n2, n3) = points, normals

    def near(p: Floats, q: Floats, n: Floats) -> Floats:
        return (2 * p + q - ((q - p) @ n) * n) / 3

    def half_way(p: Floats, q: Floats, m: Floats, n: Floats) -> Floats:
        v = 2 * ((q - p) @ (m + n)) / ((q - p) @ (q - p))
        h = m + n - v * (q - p)
        return h / np.linalg.norm(h)

    b210, b120 = near(p1, p2, n1), near(p2, p1, n2)
    b021, b012 = near(p2, p3, n2), near(p3, p2, n3)
    b102, b201 = near(p3, p1, n3), near(p1, p3, n1)
    e, v = (b210 + b120 + b021 + b012 + b102 + b201) / 6, (p1 + p2 + p3) / 3
    b111 = e + (e - v) / 2
    x, y, z = weights
    place = x**3 * p1 + y**3 * p2 + z**3 * p3
    place = place + 3 * (x * x * y * b210 + x * y * y * b120 + y * y * z * b021)
    place = place + 3 * (y * z * z * b012 + x * z * z * b102 + x * x * z * b201) + 6 * x * y * z * b111
    n = x * x * n1 + y * y * n2 + z * z * n3
    n = n + 2 * (x * y * half_way(p1, p2, n1, n2) + y * z * half_way(p2, p3, n2, n3))
    n = n + 2 * z * x * half_way(p3, p1, n3, n1)
    return place, n / np.linalg.norm(n)


@pytest.mark.parametrize("pieces", [2, 3, 5])
def test_patches_are_those_of_the_paper(pieces: int) -> None:
    shaded = bent(icosphere(2))
    fine = tessellate(shaded, pieces)
    cells = [(i, j) for i in range(pieces) for j in range(pieces - i)]
    for f in range(0, len(shaded.faces), 7):
        upright = fine.faces[pieces**2 * f : pieces**2 * (f + 1)]
        firsts, at = [], 0
        for i, j in cells:  # the triangles that stand like their face begin at a cell
            firsts.append(upright[at][0])
            at += 2 if i + j < pieces - 1 else 1
        corners = shaded.faces[f]
        for (i, j), vertex in zip(cells, firsts, strict=True):
            weights = np.array([pieces - i - j, i, j]) / pieces
            place, normal = patch(shaded.vertices[corners], shaded.normals[corners], weights)
            np.testing.assert_allclose(fine.vertices[vertex], place, atol=1e-13)
            np.testing.assert_allclose(fine.normals[vertex], normal, atol=1e-13)


@each_mesh
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10_000), pieces=st.integers(2, 5))
def test_there_are_no_cracks_not_even_at_creases(mesh: TriangleMesh, seed: int, pieces: int) -> None:
    shaded = bent(mesh, seed)
    fine, same = tessellate(shaded, pieces), tessellate(shaded, pieces, twins_of(mesh))
    assert all(np.array_equal(one, other) for one, other in zip(fine, same, strict=True))
    before, after = validate(mesh), validate(welded(fine))
    assert (after.closed, after.euler) == (before.closed, before.euler)
    assert len(fine.faces) == pieces**2 * len(mesh.faces)
    assert np.allclose(np.linalg.norm(fine.normals, axis=1), 1.0)
    assert np.array_equal(fine.vertices[: len(shaded.vertices)], shaded.vertices)
    assert np.array_equal(fine.source_vertex[: len(shaded.vertices)], shaded.source_vertex)
    edge = np.linalg.norm(np.diff(mesh.vertices[mesh.faces], axis=1), axis=2).max()
    assert (
        np.linalg.norm(mesh.vertices[fine.source_vertex] - fine.vertices, axis=1) < 0.2 * 3**0.5 + edge
    ).all()


def test_one_piece_leaves_the_surface_as_it_is() -> None:
    shaded = split_at_creases(MESHES["cylinder"])
    assert tessellate(shaded, 1) is shaded
    for wrong in (0, 17):
        with pytest.raises(UsageError, match=f"tessellate {wrong} must be from 1"):
            tessellate(shaded, wrong)


def test_a_ball_becomes_twenty_times_rounder_and_its_normals_too() -> None:
    ball = icosphere(4)
    shaded = split_at_creases(ball.with_attributes(normal=ball.vertices))
    middles = ball.vertices[ball.faces].mean(axis=1)
    flat = 1 - np.linalg.norm(middles, axis=1).min()
    fine = tessellate(shaded, 3)
    assert np.abs(np.linalg.norm(fine.vertices, axis=1) - 1).max() < flat / 20
    radial = fine.vertices / np.linalg.norm(fine.vertices, axis=1, keepdims=True)
    assert np.linalg.norm(np.cross(radial, fine.normals), axis=1).max() < math.radians(0.3)


def test_flat_sides_stay_flat_and_straight_edges_straight() -> None:
    fine = tessellate(split_at_creases(box(2.0, 0.5)), 3)
    sides = np.abs(np.abs(fine.vertices) - 1) < 1e-15
    assert (sides.sum(axis=1) >= 1).all()
    of_side = np.where(np.abs(fine.normals) > 0.999999, np.sign(fine.normals), 0.0)
    assert (np.abs(of_side).sum(axis=1) == 1).all()
    assert (sides | (of_side == 0)).all()


def test_the_rim_of_a_cylinder_becomes_round() -> None:
    fine = tessellate(split_at_creases(rod(2.0, 0.5, 0.25, "flat")), 4)
    caps = np.abs(np.abs(fine.vertices[:, 1]) - 1) < 1e-12
    rim = caps & (np.abs(fine.normals[:, 1]) < 0.5)  # seen from the side
    away = np.hypot(fine.vertices[rim, 0], fine.vertices[rim, 2])
    sagitta = 0.5 * (1 - math.cos(math.pi / round(math.pi / 0.25)))
    assert np.abs(away - 0.5).max() < sagitta / 10
    assert (np.abs(fine.normals[caps][:, 1]) > 0.999).any()


def test_two_sides_of_a_crease_keep_their_own_normals() -> None:
    shaded = split_at_creases(box(2.0, 1.0))
    fine = tessellate(shaded, 2)
    edge = (np.abs(np.abs(fine.vertices) - 1) < 1e-12).sum(axis=1) == 2
    places = np.unique(fine.vertices[edge], axis=0)
    assert edge.sum() == 2 * len(places)
