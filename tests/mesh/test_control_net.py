"""The surface of a control net: a convex, affine blend of its points, smooth, with exact normals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MeshError, UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, vertex_normals
from flowsculpt.pipeline.mesh.control_net import (
    Lattice,
    bspline_surface,
    bspline_values,
)

lattices = st.builds(Lattice, st.integers(4, 7), st.integers(4, 7), st.tuples(st.booleans(), st.booleans()))


def points_of(lattice: Lattice, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(len(lattice), 3))


def flat(rows: int, columns: int) -> np.ndarray:
    """Control points on a plane, a unit apart."""
    z, x = np.meshgrid(np.arange(rows, dtype=float), np.arange(columns), indexing="ij")
    return np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)


def basis(t: float) -> np.ndarray:
    """The four weights as the textbook has them: a matrix on the powers of t, divided by 6."""
    matrix = np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]]) / 6
    return np.array([t**3, t**2, t, 1]) @ matrix


@settings(max_examples=20, deadline=None)
@given(lattices, st.integers(1, 5))
def test_the_weights_of_the_points_are_a_partition_of_one(lattice: Lattice, pieces: int) -> None:
    ones = bspline_values(np.ones((len(lattice), 1)), lattice, pieces)
    assert np.abs(ones - 1).max() < 1e-14


@settings(max_examples=20, deadline=None)
@given(lattices, st.integers(0, 999), st.integers(1, 4))
def test_moving_the_points_by_an_affine_map_moves_the_surface_by_it(
    lattice: Lattice, seed: int, pieces: int
) -> None:
    points, random = points_of(lattice, seed), np.random.default_rng(seed + 1)
    linear, shift = random.normal(size=(3, 3)), random.normal(size=3)
    before = bspline_surface(points, lattice, pieces).vertices
    after = bspline_surface(points @ linear.T + shift, lattice, pieces).vertices
    assert np.allclose(after, before @ linear.T + shift, atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(lattices, st.integers(0, 999))
def test_the_surface_stays_within_the_bounds_of_its_points(lattice: Lattice, seed: int) -> None:
    points = points_of(lattice, seed)
    vertices = bspline_surface(points, lattice, 3).vertices
    assert (vertices >= points.min(axis=0) - 1e-12).all()
    assert (vertices <= points.max(axis=0) + 1e-12).all()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 999), st.integers(1, 6), st.data())
def test_one_patch_is_what_the_textbook_says(seed: int, pieces: int, data: st.DataObject) -> None:
    lattice = Lattice(4, 4)
    points = points_of(lattice, seed)
    i, j = (data.draw(st.integers(0, pieces)) for _ in range(2))
    vertex = bspline_surface(points, lattice, pieces).vertices[i * (pieces + 1) + j]
    grid = points.reshape(4, 4, 3)
    expected = np.einsum("i,j,ijk->k", basis(i / pieces), basis(j / pieces), grid)
    assert vertex == pytest.approx(expected, abs=1e-13)


@settings(max_examples=15, deadline=None)
@given(lattices, st.integers(0, 999))
def test_normals_are_those_of_ever_finer_triangles(lattice: Lattice, seed: int) -> None:
    """A smooth bump on a flat net, so that no normal is near to vanishing."""
    i, j = np.divmod(np.arange(len(lattice)), lattice.columns)
    around = 2 * math.pi * np.stack([i / lattice.rows, j / lattice.columns])
    bump = 0.3 * np.sin(around[0] + seed) * np.cos(around[1])
    open_lattice = Lattice(lattice.rows, lattice.columns)
    surface = bspline_surface(np.column_stack([j, bump, i]), open_lattice, 16)
    mesh = TriangleMesh(surface.vertices, surface.faces)
    cosine = np.einsum("ij,ij->i", vertex_normals(mesh), surface.normals)
    assert np.abs(np.linalg.norm(surface.normals, axis=1) - 1).max() < 1e-12
    assert cosine.min() > math.cos(math.radians(2.5))
    assert surface.normals[:, 1].min() > 0


def test_where_derivatives_vanish_normals_are_those_of_the_triangles_around() -> None:
    grid, lattice = flat(4, 6).reshape(4, 6, 3), Lattice(4, 6)
    grid[:3] = grid[1, 2]  # the surface runs into one point there
    surface = bspline_surface(grid.reshape(-1, 3), lattice, 4)
    assert np.abs(np.linalg.norm(surface.normals, axis=1) - 1).max() < 1e-9


def test_a_vertex_names_the_point_that_weighs_most() -> None:
    points, lattice = flat(5, 6), Lattice(5, 6)
    surface = bspline_surface(points, lattice, 4)
    distances = np.linalg.norm(surface.vertices[:, None] - points, axis=2)
    chosen = distances[np.arange(len(distances)), surface.source_vertex]
    assert chosen == pytest.approx(distances.min(axis=1))


def test_nets_that_are_too_small_or_surfaces_that_are_too_large_are_refused() -> None:
    with pytest.raises(MeshError, match="3 × 9 points is too small; a bicubic patch needs 4 × 4"):
        Lattice(3, 9)
    with pytest.raises(UsageError, match="16000000 are the most"):
        bspline_surface(np.zeros((10**6, 3)), Lattice(1000, 1000), 16)


def test_a_layout_survives_being_written() -> None:
    lattice = Lattice(5, 7, (False, True))
    assert Lattice.from_array(lattice.as_array()) == lattice
    with pytest.raises(MeshError, match="it must be 4 numbers"):
        Lattice.from_array(np.arange(3))
