"""The surface of a control net: a convex, affine blend of its points, smooth, with exact normals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MeshError, UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, validate, vertex_normals
from flowsculpt.pipeline.mesh.control_net import (
    Lattice,
    Net,
    bspline_surface,
    bspline_values,
    sheet_net,
    torus_net,
    tube_net,
)

lattices = st.builds(Lattice, st.integers(4, 7), st.integers(4, 7), st.tuples(st.booleans(), st.booleans()))


def points_of(lattice: Lattice, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(len(lattice), 3))


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


@pytest.mark.parametrize(
    ("net", "euler", "open_edges"),
    [
        (sheet_net((2.0, 3.0), 6, 5), 1, True),
        (tube_net(3.0, 0.5, 6, 8), 0, True),
        (torus_net(1.0, 0.4, 8, 12), 0, False),
    ],
)
def test_nets_and_their_surfaces_are_sound_and_close_where_they_say_so(
    net: Net, euler: int, open_edges: bool
) -> None:
    points, lattice = net
    surface = bspline_surface(points, lattice, 4)
    for mesh in (TriangleMesh(points, lattice.faces()), TriangleMesh(surface.vertices, surface.faces)):
        found = validate(mesh)
        assert found.problem is None
        assert found.euler == euler
        assert (found.boundary_edges > 0) == open_edges


def test_the_net_of_a_sheet_is_the_sheet_and_faces_up() -> None:
    surface = bspline_surface(*sheet_net((2.0, 3.0), 6, 5), 4)
    assert np.abs(surface.vertices[:, 1]).max() == 0
    assert np.ptp(surface.vertices, axis=0) == pytest.approx([2, 0, 3])
    assert surface.normals == pytest.approx(np.tile((0.0, 1.0, 0.0), (len(surface.normals), 1)))


def test_the_net_of_a_tube_has_its_radius_and_faces_outwards() -> None:
    surface = bspline_surface(*tube_net(3.0, 0.5, 8, 12), 4)
    away = np.hypot(surface.vertices[:, 0], surface.vertices[:, 2])
    assert away == pytest.approx(0.5, rel=2e-3)
    assert np.ptp(surface.vertices[:, 1]) == pytest.approx(3)
    outwards = (surface.vertices * (1, 0, 1) * surface.normals).sum(axis=1)
    assert outwards.min() > 0.49


def test_the_net_of_a_torus_has_its_radii_and_faces_outwards() -> None:
    surface = bspline_surface(*torus_net(1.0, 0.4, 12, 24), 4)
    across = surface.vertices * (1, 0, 1)
    middle = across / np.linalg.norm(across, axis=1, keepdims=True)
    away = surface.vertices - middle
    assert np.linalg.norm(away, axis=1) == pytest.approx(0.4, rel=5e-3)
    assert (away * surface.normals).sum(axis=1).min() > 0.39


def test_where_derivatives_vanish_normals_are_those_of_the_triangles_around() -> None:
    points, lattice = sheet_net((2.0, 2.0), 4, 6)
    grid = points.reshape(4, 6, 3).copy()
    grid[:3] = grid[1, 2]  # the surface runs into one point there
    surface = bspline_surface(grid.reshape(-1, 3), lattice, 4)
    assert np.abs(np.linalg.norm(surface.normals, axis=1) - 1).max() < 1e-9


def test_a_vertex_names_the_point_that_weighs_most() -> None:
    points, lattice = sheet_net((2.0, 2.0), 5, 6)
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
