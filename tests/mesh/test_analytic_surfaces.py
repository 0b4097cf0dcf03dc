"""Solids know their true surface: the nearest point on it, the normal there, and texture coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray, Floats
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, rod, sheet, torus, vertex_normals
from flowsculpt.pipeline.mesh.analytic_surfaces import (
    RIM,
    BoxSurface,
    CapsuleSurface,
    CylinderSurface,
    SheetSurface,
    SolidSurface,
    SphereSurface,
    TorusSurface,
)
from flowsculpt.pipeline.shot import Solid

SOLIDS: dict[str, tuple[TriangleMesh, SolidSurface]] = {
    "sphere": (icosphere(12, 1.3), SphereSurface(1.3)),
    "torus": (torus(1.0, 0.4, 0.1), TorusSurface(1.0, 0.4)),
    "capsule": (rod(3.0, 0.5, 0.1), CapsuleSurface(3.0, 0.5)),
    "ball of a capsule": (rod(1.0, 0.5, 0.1), CapsuleSurface(1.0, 0.5)),
    "cylinder": (rod(2.0, 0.5, 0.1, "flat"), CylinderSurface(2.0, 0.5)),
    "disc": (rod(0.2, 1.0, 0.1, "flat"), CylinderSurface(0.2, 1.0)),
    "box": (box((2.0, 1.0, 0.3), 0.1), BoxSurface((2.0, 1.0, 0.3))),
    "sheet": (sheet((2.0, 1.0), 0.1), SheetSurface((2.0, 1.0))),
}
each_solid = pytest.mark.parametrize(("mesh", "surface"), SOLIDS.values(), ids=SOLIDS)
seeds = st.integers(0, 2**32 - 1)


@each_solid
def test_vertices_of_the_mesh_lie_on_the_surface_and_stay(mesh: TriangleMesh, surface: SolidSurface) -> None:
    np.testing.assert_allclose(surface(mesh.vertices), mesh.vertices, atol=1e-15)


@each_solid
@settings(max_examples=15, deadline=None)
@given(seed=seeds)
def test_no_point_of_the_mesh_is_nearer_than_the_nearest(
    mesh: TriangleMesh, surface: SolidSurface, seed: int
) -> None:
    points = np.random.default_rng(seed).uniform(-2, 2, (20, 3))
    distance = np.linalg.norm(surface(points) - points, axis=1)
    to_mesh = np.linalg.norm(mesh.vertices[None] - points[:, None], axis=2).min(axis=1)
    assert (distance <= to_mesh + 1e-4).all()
    assert (to_mesh - distance < 0.1).all()


@each_solid
@settings(max_examples=15, deadline=None)
@given(seed=seeds)
def test_what_lies_on_the_surface_stays_and_finds_itself_along_its_normal(
    mesh: TriangleMesh, surface: SolidSurface, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    on = surface(rng.uniform(-2, 2, (40, 3)))
    moved = np.linalg.norm(surface(on) - on, axis=1)
    assert (
        (moved < 1e-14) | ((moved < 1.5 * RIM) & isinstance(surface, CylinderSurface))
    ).all()  # or onto a rim
    normals = surface.normals(on)
    known = normals.any(axis=1)
    np.testing.assert_allclose(np.linalg.norm(normals[known], axis=1), 1.0, atol=1e-15)
    for step in (0.01, -0.01):
        found = surface(on + step * normals)
        deep = np.linalg.norm(found - on, axis=1) > 1e-12  # below a side, near an edge of a thin solid
        assert not deep.any() or (step < 0 and isinstance(surface, BoxSurface | CylinderSurface))


@each_solid
def test_normals_point_outwards_like_the_meshes_and_vanish_at_creases(
    mesh: TriangleMesh, surface: SolidSurface
) -> None:
    normals, smooth = surface.normals(mesh.vertices), vertex_normals(mesh)
    known = normals.any(axis=1)
    assert (np.einsum("ij,ij->i", normals, smooth)[known] > 0.98).all()
    creased = isinstance(surface, BoxSurface | CylinderSurface)
    assert bool((~known).any()) == creased


def test_a_box_is_met_exactly() -> None:
    surface, rng = BoxSurface((2.0, 1.0, 0.3)), np.random.default_rng(1)
    on_side = np.column_stack([np.full(50, -1.0), rng.uniform(-0.5, 0.5, 50), rng.uniform(-0.15, 0.15, 50)])
    assert surface(on_side).tobytes() == on_side.tobytes()
    on_edge = np.column_stack([np.full(50, 1.0), np.full(50, -0.5), rng.uniform(-0.15, 0.15, 50)])
    assert surface(on_edge).tobytes() == on_edge.tobytes()
    assert not surface.normals(on_edge).any()
    assert surface(np.array([[3.0, 2.0, 1.0]])).tolist() == [[1.0, 0.5, 0.15]]


def test_a_rim_bent_by_interpolation_is_put_on_the_rim() -> None:
    """The middle of a cubic through two of its points with its tangents lies a little within."""
    turn = np.radians(20)
    a, b = (0.5 * np.array([np.cos(t), 0.0, np.sin(t)]) for t in (0.0, turn))
    chord = np.linalg.norm(b - a)
    tangents = np.array([[0.0, 0.0, 1.0], [-np.sin(turn), 0.0, np.cos(turn)]])
    middle = 0.5 * (a + b) + 0.125 * chord * (tangents[0] - tangents[1]) + [0.0, 1.0, 0.0]
    assert np.hypot(middle[0], middle[2]) < 0.5 - 1e-8
    (on,) = CylinderSurface(2.0, 0.5)(middle[None])
    assert np.hypot(on[0], on[2]) == pytest.approx(0.5, abs=1e-15) and on[1] == 1.0


@each_solid
def test_even_the_centre_has_a_nearest_point(mesh: TriangleMesh, surface: SolidSurface) -> None:
    on = surface(np.zeros((1, 3)))
    assert np.isfinite(on).all() and np.isfinite(surface.normals(np.zeros((1, 3)))).all()
    moved = np.linalg.norm(surface(on) - on, axis=1)
    assert (
        (moved < 1e-14) | ((moved < 1.5 * RIM) & isinstance(surface, CylinderSurface))
    ).all()  # or onto a rim
    assert surface(np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("solid", Solid.KINDS)
def test_every_solid_that_a_shot_can_name_knows_its_surface(solid: str) -> None:
    subject = Solid.of(solid, {})
    vertices = subject.build(0.2).vertices
    np.testing.assert_allclose(subject.project(vertices), vertices, atol=1e-15)


def test_a_rod_with_flat_caps_is_a_cylinder_and_a_box_may_have_one_measure() -> None:
    assert Solid.of("rod", {"caps": "flat"}).project == CylinderSurface(3.0, 0.5)
    assert Solid.of("box", {"size": 2.0}).project == BoxSurface((2.0, 2.0, 2.0))


def place_of(surface: SolidSurface, coordinates: Floats) -> Floats:
    """The points (..., 3) of a surface that texture coordinates (..., 2) name."""
    u, v = np.moveaxis(coordinates, -1, 0)
    around, right, ahead = 2 * np.pi * (u - 0.5), 0.0, 0.0
    if isinstance(surface, SphereSurface):
        away, y = surface.radius * np.cos(np.pi * (v - 0.5)), surface.radius * np.sin(np.pi * (v - 0.5))
    elif isinstance(surface, TorusSurface):
        tube = 2 * np.pi * (v - 0.5)
        away, y = surface.radius + surface.tube_radius * np.cos(tube), surface.tube_radius * np.sin(tube)
    elif isinstance(surface, CapsuleSurface):
        straight = surface.length - 2 * surface.radius
        along = (v - 0.5) * (straight + np.pi * surface.radius)
        core = np.clip(along, -straight / 2, straight / 2)
        angle = (along - core) / surface.radius
        away, y = surface.radius * np.cos(angle), core + surface.radius * np.sin(angle)
    elif isinstance(surface, CylinderSurface):
        width, height = 2 * np.pi * surface.radius, surface.length + 2 * surface.radius
        upper = u > 0.5
        on_side = v >= 2 * surface.radius / height - 1e-9
        right = np.where(on_side, 0.0, (u - 0.5 - np.where(upper, 0.25, -0.25)) * width)
        ahead = np.where(on_side, 0.0, (v * height - surface.radius) * np.where(upper, -1, 1))
        away = np.where(on_side, surface.radius, 0.0)
        end = np.where(upper, 0.5, -0.5) * surface.length
        y = np.where(on_side, v * height - 2 * surface.radius - surface.length / 2, end)
    else:
        assert isinstance(surface, SheetSurface)
        return np.stack([u - 0.5, np.zeros_like(u), 0.5 - v], axis=-1) * [surface.size[0], 1, surface.size[1]]
    return np.stack([away * np.sin(around) + right, y, away * np.cos(around) + ahead], axis=-1)


@pytest.mark.parametrize("name", [name for name in SOLIDS if name != "box"])
def test_texture_coordinates_name_the_place_of_each_corner(name: str) -> None:
    mesh, surface = SOLIDS[name]
    coordinates, charts = surface.texture(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(place_of(surface, coordinates), mesh.vertices[mesh.faces], atol=1e-9)
    assert is_alike_in_charts(mesh, coordinates, charts)


@each_solid
def test_textures_are_not_mirrored_and_no_face_spans_the_seam(
    mesh: TriangleMesh, surface: SolidSurface
) -> None:
    coordinates, charts = surface.texture(mesh.vertices, mesh.faces)
    across, up = np.moveaxis(coordinates[:, 1:] - coordinates[:, :1], 1, 0)
    assert (across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0] > 0.0).all()
    assert np.ptp(coordinates, axis=1).max() < 0.26 and is_alike_in_charts(mesh, coordinates, charts)


def is_alike_in_charts(mesh: TriangleMesh, coordinates: Floats, charts: AnyArray) -> bool:
    corners = np.column_stack([np.repeat(charts, 3), mesh.faces.reshape(-1)])
    both = np.column_stack([corners, coordinates.reshape(-1, 2)])
    return len(np.unique(corners, axis=0)) == len(np.unique(both, axis=0))


def test_the_sides_of_a_box_are_a_cross_without_overlaps() -> None:
    mesh, surface = SOLIDS["box"]  # 2 wide, 1 high, 0.3 deep
    coordinates, _ = surface.texture(mesh.vertices, mesh.faces)
    size = np.array([2 * (2.0 + 0.3), 1.0 + 2 * 0.3])
    points, places = mesh.vertices[mesh.faces], coordinates * size
    front = np.isclose(points[..., 2], 0.15).all(axis=1)
    np.testing.assert_allclose(places[front], points[front][..., :2] + (1.3, 0.8), atol=1e-12)
    top = np.isclose(points[..., 1], 0.5).all(axis=1)
    np.testing.assert_allclose(places[top], points[top][..., (0, 2)] * (1, -1) + (1.3, 1.45), atol=1e-12)
    lengths = [np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2) for x in (points, places)]
    np.testing.assert_allclose(*lengths, atol=1e-12)
    cells = {tuple(cell) for cell in np.floor(places.mean(axis=1) / 0.05).astype(int).tolist()}
    assert len(cells) >= 0.9 * (2 * (2 * 1 + 2 * 0.3 + 1 * 0.3) / 0.1**2)
    assert places.min() >= 0.0 and (places <= size + 1e-12).all()


def test_a_face_around_a_pole_takes_no_more_of_the_picture_than_its_neighbours() -> None:
    angles = 2 * np.pi * np.array([0.1, 0.45, 0.8])
    ring = np.column_stack([0.1 * np.cos(angles), np.ones(3), 0.1 * np.sin(angles)])
    ring[0, [0, 2]] *= 0.5
    coordinates, _ = SphereSurface(1.0).texture(ring, np.int32([[0, 2, 1]]))
    assert np.ptp(coordinates[0, :, 0]) < 0.36
