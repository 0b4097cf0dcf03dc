"""Normals shade a polyhedron smooth where it is smooth, and split it where it is not (P29, P39)."""

import math
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray, Vectors
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import (
    TriangleMesh,
    box,
    dihedral_angles,
    icosphere,
    sheet,
    split_at_creases,
    vertex_normals,
)
from flowsculpt.pipeline.mesh.kernels.normal_kernels import AGREEMENT
from flowsculpt.pipeline.mesh.normals import ShadedMesh, trusted_normals


def unit(normals: Vectors) -> bool:
    return bool(np.isfinite(normals).all() and np.allclose(np.linalg.norm(normals, axis=1), 1))


def test_a_smooth_ball_is_not_split_and_its_normals_are_radial() -> None:
    ball = icosphere(16)
    shaded = split_at_creases(ball)
    assert len(shaded.vertices) == len(ball.vertices)
    assert np.array_equal(shaded.faces, ball.faces)
    assert (np.einsum("ij,ij->i", shaded.normals, ball.vertices) > math.cos(math.radians(0.2))).all()


def test_a_box_gets_the_normals_of_its_six_sides() -> None:
    cube = box(edge_length=0.5)
    shaded = split_at_creases(cube)
    assert len(shaded.vertices) == 6 * 25
    assert np.allclose(shaded.normals[shaded.faces], cube.face_normals[:, None])
    assert np.array_equal(cube.vertices[shaded.source_vertex], shaded.vertices)
    assert np.array_equal(shaded.source_vertex[shaded.faces], cube.faces)


def test_a_wide_hard_angle_leaves_a_box_whole() -> None:
    assert len(split_at_creases(box(edge_length=0.5), math.pi / 2 + 0.01).vertices) == 98


def test_a_crease_that_fades_out_leaves_no_seam() -> None:
    """A sheet folded along a line that ends at its middle: the last vertex of the crease has one normal."""
    flat = sheet((4, 4), 0.5)
    x, z = flat.vertices[:, 0], flat.vertices[:, 2]
    ridge = np.clip(z, 0, None) * 0.5 * np.clip(1 - np.abs(x), 0, None)
    folded = flat.with_vertices(flat.vertices + np.column_stack([0 * x, ridge, 0 * x]))
    shaded = split_at_creases(folded, math.radians(20))
    split = np.flatnonzero(np.bincount(shaded.source_vertex) > 1)
    assert len(split), "the crease is one"
    angles = dihedral_angles(folded)
    hard = np.nan_to_num(angles, nan=9.0) > math.radians(20)
    spokes = np.bincount(folded.faces.reshape(-1)[hard], minlength=len(flat.vertices))
    rim = np.bincount(folded.faces.reshape(-1)[np.isnan(angles)], minlength=len(flat.vertices)) > 0
    assert not np.isin(np.flatnonzero((spokes == 1) & ~rim), split).any()
    assert unit(shaded.normals)


def test_normals_do_not_depend_on_how_a_side_is_triangulated() -> None:
    corner = box()
    diagonal = vertex_normals(corner)
    assert np.allclose(np.abs(diagonal), 1 / math.sqrt(3)), "weighted by angle, not by number of faces"


def test_faces_without_area_do_not_spoil_normals() -> None:
    points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 0, -1), (1, 0, 0)]
    mesh = TriangleMesh(points, [(0, 1, 2), (0, 2, 3), (1, 0, 4)])
    shaded = split_at_creases(mesh)
    assert unit(shaded.normals)
    assert np.allclose(shaded.normals[shaded.faces[1]], (0, 1, 0))
    assert unit(vertex_normals(TriangleMesh(np.zeros((3, 3)), [(0, 1, 2)])))


def test_dihedral_angles_are_those_of_the_geometry() -> None:
    angles = dihedral_angles(box())
    assert np.allclose(np.sort(np.unique(angles.round(9))), [0, math.pi / 2])
    assert np.isnan(dihedral_angles(sheet(edge_length=1.0))).sum() == 8


def test_a_surface_that_is_no_manifold_is_refused() -> None:
    with pytest.raises(MeshError, match="3 faces"):
        split_at_creases(TriangleMesh(np.eye(5, 3), [(0, 1, 2), (1, 0, 3), (0, 1, 4)]))


def test_twenty_five_thousand_vertices_take_as_many_calls_as_ninety() -> None:
    split_at_creases(icosphere(3))  # loads what is compiled
    assert _calls(icosphere(50)) == _calls(icosphere(3))


def _calls(mesh: TriangleMesh) -> int:
    """Return how many functions Python calls to split a mesh at its creases."""
    events: list[str] = []
    sys.setprofile(lambda frame, event, argument: events.append(event))
    try:
        split_at_creases(mesh)
    finally:
        sys.setprofile(None)
    return len(events)


def test_a_vertex_with_a_normal_of_its_own_is_shaded_with_it() -> None:
    """Though the icosahedron turns by 42° at every edge, it stands for a ball."""
    ball = icosphere(1)
    shaded = split_at_creases(ball.with_attributes(normal=3.0 * ball.vertices))
    assert len(split_at_creases(ball).vertices) == 60
    assert len(shaded.vertices) == 12
    np.testing.assert_allclose(shaded.normals, ball.vertices, atol=1e-15)


def test_where_there_is_no_normal_the_geometry_decides() -> None:
    cube = box(edge_length=0.5)
    inside = (np.abs(np.abs(cube.vertices) - 1) < 1e-12).sum(axis=1) == 1
    tilted = cube.face_normals[0] + np.zeros_like(cube.vertices)
    tilted[inside] = vertex_normals(cube)[inside] + 0.1
    tilted[~inside] = 0.0
    shaded, plain = split_at_creases(cube.with_attributes(normal=tilted)), split_at_creases(cube)
    assert np.array_equal(shaded.faces, plain.faces)
    changed = np.abs(shaded.normals - plain.normals).max(axis=1) > 1e-12
    assert np.array_equal(changed, np.isin(shaded.source_vertex, np.flatnonzero(inside)))
    assert unit(shaded.normals)


def test_the_rim_of_a_thin_sheet_is_not_smeared_over_its_triangles() -> None:
    """The normals along the rim of a coin point sideways, those of its two sides up and down."""
    coin = icosphere(8)
    flat = coin.with_vertices(coin.vertices * [1.0, 1.0, 0.02])
    normal = coin.vertices / [1.0, 1.0, 0.02]
    shaded = split_at_creases(flat.with_attributes(normal=normal))
    corners = shaded.normals[shaded.faces]
    assert np.einsum("fik,fk->fi", corners, flat.face_normals).min() > AGREEMENT - 0.1
    assert len(shaded.vertices) > len(flat.vertices), "the rim is a crease"


def test_a_normal_that_points_into_the_surface_is_not_trusted() -> None:
    ball = icosphere(8)
    normal = ball.vertices.copy()
    normal[:5] *= -1
    normal[5:7] = math.nan, 0.0, 0.0
    normal[7] = 0.0
    mesh = ball.with_attributes(normal=normal)
    assert np.flatnonzero(~trusted_normals(mesh)).tolist() == list(range(8))
    shaded = split_at_creases(mesh)
    assert unit(shaded.normals)
    assert np.array_equal(shaded.normals[:8], split_at_creases(ball).normals[:8])


def test_tagged_edges_are_creases_however_flat_they_are() -> None:
    """P31. Also where the vertices have normals."""
    flat = sheet(edge_length=0.5)
    on_line = np.flatnonzero(flat.vertices[:, 0] == 0.0)
    line = on_line[np.argsort(flat.vertices[on_line, 2])]
    pairs = np.column_stack([line[:-1], line[1:]])
    upwards = np.tile([0.0, 1.0, 0.0], (len(flat.vertices), 1))
    for mesh in (flat.with_creases(pairs), flat.with_attributes(normal=upwards).with_creases(pairs)):
        shaded = split_at_creases(mesh)
        assert sorted(shaded.source_vertex[len(flat.vertices) :]) == sorted(line)
        left = flat.vertices[flat.faces].mean(axis=1)[:, 0] < 0
        assert not set(shaded.faces[left].ravel()) & set(shaded.faces[~left].ravel())


def test_a_mesh_without_creases_or_normals_trusts_none() -> None:
    assert not trusted_normals(icosphere(2)).any()


def test_the_hard_angle_may_differ_from_vertex_to_vertex() -> None:
    cube = box(edge_length=0.5)
    angles = np.where(cube.vertices[:, 1] > 0, math.radians(40), math.radians(120))
    shaded = split_at_creases(cube, angles)
    split = shaded.source_vertex[len(cube.vertices) :]
    assert len(split) and (cube.vertices[split, 1] >= 0).all()
    even = split_at_creases(cube, np.full(len(cube.vertices), math.radians(40)))
    assert np.array_equal(even.faces, split_at_creases(cube).faces)


def slowly_trusted(mesh: TriangleMesh, own: Vectors) -> AnyArray:
    face = mesh.face_normals
    behind = (np.einsum("fik,fk->fi", own[mesh.faces], face) <= AGREEMENT) & face.any(axis=1, keepdims=True)
    trusted: AnyArray = own.any(axis=1)
    trusted[mesh.faces[behind]] = False
    return trusted


def slowly_smooth(mesh: TriangleMesh, shaded: ShadedMesh) -> Vectors:
    """Return the mean of the faces' normals of each fan, weighted by angle."""
    corners = mesh.vertices[mesh.faces]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    angles = np.arctan2(np.linalg.norm(np.cross(ahead, behind), axis=2), np.sum(ahead * behind, axis=2))
    smooth = np.zeros_like(shaded.vertices)
    np.add.at(smooth, shaded.faces, angles[:, :, None] * mesh.face_normals[:, None])
    return smooth / np.linalg.norm(smooth, axis=1, keepdims=True)


SHAPES = [box(edge_length=0.5), icosphere(4), sheet(edge_length=0.5), sheet(edge_length=1.0)]


@settings(deadline=None)
@given(st.sampled_from(SHAPES), st.integers(0, 2**32 - 1), st.booleans())
def test_shading_is_that_of_the_formulas(mesh: TriangleMesh, seed: int, tagged: bool) -> None:
    """With normals that point anywhere, nowhere, or are no numbers, on a surface that is bent anyhow."""
    rng = np.random.default_rng(seed)
    mesh = mesh.with_vertices(mesh.vertices + rng.normal(scale=0.1, size=mesh.vertices.shape))
    normal = vertex_normals(mesh) + rng.normal(scale=0.5, size=mesh.vertices.shape)
    rubbish = rng.integers(8, size=len(normal))
    own = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    normal[rubbish == 0], normal[rubbish == 1] = 0.0, (math.nan, 1.0, 0.0)
    own[rubbish < 2] = 0.0
    if tagged:
        mesh = mesh.with_creases(mesh.faces[:3, :2])
    own[mesh.creases] = 0.0
    mesh = mesh.with_attributes(normal=normal)
    shaded, trusted = split_at_creases(mesh), trusted_normals(mesh)
    assert np.array_equal(trusted, slowly_trusted(mesh, own))
    assert not trusted[shaded.source_vertex[len(mesh.vertices) :]].any(), "what is trusted is not divided"
    expected, brought = slowly_smooth(mesh, shaded), own[shaded.source_vertex]
    agreeing = trusted[shaded.source_vertex] | (np.einsum("ij,ij->i", brought, expected) > AGREEMENT)
    expected[agreeing] = brought[agreeing]
    np.testing.assert_allclose(shaded.normals, expected, atol=1e-12)


def test_a_normal_is_kept_where_no_face_has_an_area() -> None:
    """Faces without area contradict no normal."""
    down = TriangleMesh(np.zeros((3, 3)), [(0, 1, 2)], {"normal": np.tile([0.0, -2.0, 0.0], (3, 1))})
    assert trusted_normals(down).all()
    assert np.array_equal(split_at_creases(down).normals, np.tile([0.0, -1.0, 0.0], (3, 1)))


def test_normals_of_another_shape_are_refused() -> None:
    with pytest.raises(MeshError, match=r"'normal' has shape \(12, 2\)"):
        split_at_creases(icosphere(1).with_attributes(normal=np.ones((12, 2))))


def test_points_that_are_no_numbers_do_not_spoil_normals() -> None:
    points = sheet(edge_length=0.5).vertices.copy()
    points[3], points[7] = math.nan, 1e300
    mesh = sheet(edge_length=0.5).with_vertices(points)
    assert unit(split_at_creases(mesh).normals) and unit(vertex_normals(mesh))
    assert np.isfinite(mesh.face_normals).all()
