"""A closed mesh as a region: distances to the last digit, whatever the surface and the falloff."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError, MeshError
from flowsculpt.pipeline.flow import Streamlines, keyed
from flowsculpt.pipeline.flow.catalogue.basic import Translation
from flowsculpt.pipeline.flow.composition import RegionField
from flowsculpt.pipeline.flow.regions import BoxRegion, ClosedSurface, MeshRegion, TriangleTree
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, sheet, torus

POINTS = np.random.default_rng(8).uniform(-2, 2, size=(600, 3))


def bumpy(turns: int = 6) -> TriangleMesh:
    """A ball with dents that are concave, and thin between."""
    mesh = icosphere(turns, 1.0)
    x, y, z = mesh.vertices.T
    return mesh.with_vertices(mesh.vertices * (1 + 0.35 * np.sin(5 * x) * np.cos(4 * y + z))[:, None])


def joined(*meshes: TriangleMesh) -> TriangleMesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return TriangleMesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def turned(mesh: TriangleMesh) -> TriangleMesh:
    """Inside out."""
    return TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])


def shifted(mesh: TriangleMesh, along: float) -> TriangleMesh:
    return mesh.with_vertices(mesh.vertices + along * np.array([1.0, 0.125, 0.0]))


def region(mesh: TriangleMesh, **how: object) -> MeshRegion:
    return MeshRegion(ClosedSurface.of(mesh), **how)  # type: ignore[arg-type]


def outside(mesh: TriangleMesh, points: Points) -> Floats:
    """The slow twin: how far points lie outside, by every triangle, and by the sum of all solid angles."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    nearest = np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        share = np.clip(((points[:, None] - p) * (q - p)).sum(-1) / ((q - p) ** 2).sum(-1), 0, 1)
        on = p + share[..., None] * (q - p)
        nearest = np.minimum(nearest, np.linalg.norm(points[:, None] - on, axis=-1).min(axis=1))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    height = ((points[:, None] - a) * normal).sum(-1)
    foot = points[:, None] - height[..., None] * normal
    sides = [(np.cross(q - p, foot - p) * normal).sum(-1) >= 0 for p, q in ((a, b), (b, c), (c, a))]
    over = np.where(np.logical_and.reduce(sides), np.abs(height), np.inf).min(axis=1)
    u, v, w = (corner - points[:, None] for corner in (a, b, c))
    lu, lv, lw = (np.linalg.norm(side, axis=-1) for side in (u, v, w))
    below = lu * lv * lw + (u * v).sum(-1) * lw + (v * w).sum(-1) * lu + (w * u).sum(-1) * lv
    winding = 2 * np.arctan2((u * np.cross(v, w)).sum(-1), below).sum(axis=1) / (4 * np.pi)
    return np.where(np.abs(winding) > 0.5, 0.0, np.minimum(nearest, over))


def fallen(distance: Floats, falloff: float) -> Floats:
    t = np.clip(distance / falloff, 0, 1)
    return 1 - t**3 * (10 - 15 * t + 6 * t * t)


@pytest.mark.parametrize("falloff", [0.0, 0.01, 0.3, 2.0])
def test_a_mesh_of_a_box_is_the_box(falloff: float) -> None:
    size = (2.0, 1.0, 0.5)
    found = region(box(size, 0.2), falloff=falloff).weight(POINTS, 0.0)
    np.testing.assert_allclose(found, BoxRegion(size=size, falloff=falloff).weight(POINTS, 0.0), atol=1e-12)


SHAPES = {
    "a bumpy ball": bumpy(),
    "inside out": turned(bumpy()),
    "a torus": torus(1.0, 0.3, 0.25),
    "two that reach into each other": joined(icosphere(3, 0.9), shifted(icosphere(4, 0.7), 0.8)),
    "a hollow": joined(icosphere(5, 1.2), turned(icosphere(3, 0.8))),
    "apart": joined(icosphere(3, 0.5), torus(1.6, 0.2, 0.2)),
    "a leaf": box((1.5, 0.002, 1.0), 0.3),
}


@pytest.mark.slow
@pytest.mark.parametrize("mesh", SHAPES.values(), ids=SHAPES)
def test_distances_are_those_to_the_nearest_of_all_triangles(mesh: TriangleMesh) -> None:
    rng = np.random.default_rng(2)
    near = mesh.vertices[rng.integers(0, len(mesh.vertices), 200)] + rng.normal(0, 0.02, (200, 3))
    points = np.concatenate([POINTS[:300], near])
    wanted = outside(mesh, points)
    for falloff in (0.05, 0.4, 3.0):
        found = region(mesh, falloff=falloff).weight(points, 0.0)
        np.testing.assert_allclose(found, fallen(wanted, falloff), atol=1e-11)
    assert (region(mesh).weight(points, 0.0) == (wanted == 0)).all()


def test_far_off_the_falloff_is_as_it_should_be() -> None:
    mesh, points = bumpy(), 60 * POINTS
    found = region(mesh, falloff=200.0, falloff_type="linear").weight(points, 0.0)
    np.testing.assert_allclose(found, 1 - outside(mesh, points) / 200, atol=1e-12)


@settings(max_examples=15, deadline=None)
@given(
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.floats(0.05, 20),
    st.floats(0, 2),
)
def test_it_is_placed_and_scaled(centre: tuple[float, float, float], scale: float, falloff: float) -> None:
    plain = region(SHAPES["a torus"], falloff=falloff)
    moved = region(SHAPES["a torus"], falloff=scale * falloff, centre=centre, scale=scale)
    np.testing.assert_allclose(
        moved.weight(np.array(centre) + scale * POINTS, 0.0), plain.weight(POINTS, 0.0), atol=1e-9
    )
    middle, half = moved.bounds(0.0)
    low, high = SHAPES["a torus"].bounds
    np.testing.assert_allclose(middle, np.array(centre) + 0.5 * scale * (low + high), atol=1e-9)
    np.testing.assert_allclose(half, scale * (0.5 * (high - low) + falloff), rtol=1e-12)


def test_it_may_move_and_grow_and_may_not_vanish() -> None:
    centre = keyed((0, 1), ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0)), "linear")
    ball = region(icosphere(4, 1.0), centre=centre, scale=keyed((0, 1, 2), (1, 3, 0), "linear"))
    place = np.array([[2.5, 0.0, 0.0]])
    assert [float(ball.weight(place, time)[0]) for time in (0.0, 0.5, 1.0)] == [0.0, 1.0, 1.0]
    with pytest.raises(FrameError, match=r"a mesh has the scale 0 at 2 s and is empty"):
        ball.weight(place, 2.0)


@pytest.mark.parametrize("invert", [False, True])
def test_a_velocity_field_and_a_map_are_weighed_alike(invert: bool) -> None:
    shape = region(bumpy(), falloff=0.5, invert=invert)
    velocity = RegionField(Translation((1.0, 0.0, -2.0)), shape).velocity(POINTS, 0.0)
    np.testing.assert_allclose(velocity, shape.weight(POINTS, 0.0)[:, None] * [1.0, 0.0, -2.0], atol=1e-15)


def test_it_is_known_by_its_triangles_and_not_by_where_they_lie() -> None:
    one, same, other = region(bumpy()), region(bumpy()), region(icosphere(6, 1.0))
    assert one.cache_data(0.0) == same.cache_data(0.0) != other.cache_data(0.0)
    flows = [Streamlines(RegionField(Translation(), shape)) for shape in (one, same, other)]
    assert flows[0].cache_data(0.0, 0.1) == flows[1].cache_data(0.0, 0.1) != flows[2].cache_data(0.0, 0.1)


def test_what_is_at_no_place_is_outside_and_harms_nobody() -> None:
    bad, shape = POINTS.copy(), region(bumpy(), falloff=0.5)
    bad[3], bad[40] = np.nan, np.inf
    found = shape.weight(bad, 0.0)
    assert found[[3, 40]].tolist() == [0.0, 0.0]
    others = np.delete(np.arange(len(bad)), [3, 40])
    assert found[others].tobytes() == shape.weight(POINTS, 0.0)[others].tobytes()


def test_a_surface_that_holds_nothing_is_refused() -> None:
    with pytest.raises(MeshError, match=r"^leaf: 16 edges have a face on one side only; a closed .*fill the"):
        ClosedSurface.of(sheet((1.0, 1.0), 0.25), "leaf")
    crossed = joined(icosphere(1, 1.0), icosphere(1, 1.0))
    pinched = TriangleMesh(crossed.vertices[: len(crossed.vertices) // 2], crossed.faces % 12)
    with pytest.raises(MeshError, match="one is there twice; remove duplicates"):
        ClosedSurface.of(pinched)


@pytest.mark.parametrize("least", [-0.4, 0.0, 0.7])
def test_the_nearest_triangle_that_faces_a_direction_is_that_of_the_tree_of_those_alone(least: float) -> None:
    mesh = bumpy()
    corners, directions = mesh.vertices[mesh.faces], np.roll(POINTS[:80], 1, axis=1)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found, shares = TriangleTree.of(corners).nearest(POINTS[:80], directions, least)
    for point, direction, face, share in zip(POINTS[:80], directions, found, shares, strict=True):
        facing = corners[mesh.face_normals @ direction >= least]
        alone, there = TriangleTree.of(facing).nearest(point[None])
        (a, b, c), (p, q, r) = corners[face], facing[alone[0]]
        away = a + share @ [b - a, c - a] - point
        np.testing.assert_allclose(
            np.linalg.norm(away), np.linalg.norm(p + there[0] @ [q - p, r - p] - point), rtol=1e-12
        )
        assert mesh.face_normals[face] @ direction >= least


def test_without_a_triangle_that_faces_a_direction_there_is_none() -> None:
    flat = sheet()
    found, _ = TriangleTree.of(flat.vertices[flat.faces]).nearest(
        POINTS[:3], np.tile([0.0, -1.0, 0.0], (3, 1))
    )
    assert found.tolist() == [-1, -1, -1]
