"""Normals are carried by points beside them: by the kernels as by the formulas, whatever arrays they get."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Points, Vectors
from flowsculpt.pipeline.mesh.normals import STEP, carried_normals, tangents


def surface(seed: int, many: int) -> tuple[Points, Vectors]:
    """Points, and unit normals of which some are zero and some point straight up, down or sideways."""
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(many, 3)), rng.normal(size=(many, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = [(0.0, 0.0, 0.0), (-0.0, 0.0, -0.0), (0, 0, 1), (0, 0, -1), (1, 0, 0.0), (0, 1, -0.0)]
    some = rng.random(many) < 0.4
    normals[some] = np.array(rows)[rng.integers(len(rows), size=some.sum())]
    return points, normals


def bent(points: Points) -> Points:
    """A map that folds the plane x = 0 onto a line, and is smooth elsewhere."""
    x, y, z = points.T
    return np.column_stack([x + 0.3 * np.sin(y), x * y, z + x * x])


def slowly(points: Points, normals: Vectors) -> Vectors:
    """Carry normals by numpy, a vertex at a time."""
    apart, carried = STEP * np.ptp(points, axis=0).max(), np.zeros_like(normals)
    for v in np.flatnonzero(normals.any(axis=1)):
        one, two = (t[0] for t in tangents(normals[[v]]))
        here, ahead, beside = bent(points[v] + apart * np.array([[0, 0, 0], one, two]))
        cross = np.cross(ahead - here, beside - here)
        carried[v] = cross / np.linalg.norm(cross) if cross.any() else 0.0
    return carried


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
def test_normals_are_those_of_the_formulas_vertex_by_vertex(seed: int, many: int) -> None:
    points, normals = surface(seed, many)
    carried = carried_normals(bent, points, bent(points), normals)
    np.testing.assert_allclose(carried, slowly(points, normals), atol=1e-14)
    assert np.array_equal(carried.any(axis=1), normals.any(axis=1)), "zero stays zero, and nothing else is"


def test_the_flow_is_asked_once_and_only_about_vertices_with_a_normal() -> None:
    points, normals = surface(3, 30)
    asked: list[Points] = []

    def move(these: Points) -> Points:
        asked.append(these)
        return these

    np.testing.assert_allclose(carried_normals(move, points, points, normals), normals, atol=1e-6)
    carried_normals(move, points, points, np.zeros_like(normals))
    carried_normals(move, points[:0], points[:0], normals[:0])
    known = normals.any(axis=1)
    (beside,) = asked
    assert 0 < known.sum() < 30 and len(beside) == 2 * known.sum()
    distance = np.linalg.norm(beside - np.tile(points[known], (2, 1)), axis=1)
    np.testing.assert_allclose(distance, STEP * np.ptp(points, axis=0).max(), rtol=1e-6)


def test_each_vertex_may_have_a_distance_of_its_own() -> None:
    points, normals = surface(4, 20)
    apart = np.linspace(1e-3, 1e-1, 20)
    scaled = carried_normals(lambda beside: 2.0 * beside, points, 2.0 * points, normals, apart)
    np.testing.assert_allclose(scaled, normals, atol=1e-12)


@pytest.mark.parametrize("kind", ["read-only", "a column of others", "every second row", "float32"])
def test_arrays_need_not_be_of_the_kernels_own_kind(kind: str) -> None:
    points, normals = surface(5, 12)
    normals = normals.astype(np.float32).astype(np.float64)
    plain = carried_normals(bent, points, bent(points), normals)
    given = {
        "read-only": normals.copy(),
        "a column of others": np.hstack([points, normals, points])[:, 3:6],
        "every second row": np.repeat(normals, 2, axis=0)[::2],
        "float32": normals.astype(np.float32),
    }[kind]
    given.flags.writeable = kind != "read-only"
    assert np.array_equal(carried_normals(bent, points, bent(points), given), plain)


def test_points_that_leave_the_numbers_or_fall_together_have_no_normal() -> None:
    points, normals = surface(6, 12)
    for factor in (0.0, 1e200, np.nan):
        with np.errstate(over="ignore"):
            carried = carried_normals(lambda beside, f=factor: f * beside, points, factor * points, normals)
        assert not carried.any(), factor
