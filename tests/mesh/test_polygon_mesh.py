"""Polygons as values, and cut into triangles without losing a vertex (P23)."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import PolygonMesh, box, icosphere, rod, sheet, torus, validate
from flowsculpt.pipeline.mesh.kernels.triangulation import FORBIDDEN, triangulate_polygon

POINTS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
CUBE = PolygonMesh(
    POINTS, [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
)


def test_a_cube_has_six_faces_of_four_sides() -> None:
    assert (len(CUBE), CUBE.average_sides, len(CUBE.edges)) == (6, 4.0, 12)
    assert CUBE.areas.tolist() == [1.0] * 6
    assert CUBE.extents.tolist() == [1.0] * 6
    assert CUBE.normals.tolist() == [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]]
    assert CUBE.face(1).tolist() == [4, 6, 7, 5]
    assert CUBE.heads[4:8].tolist() == [6, 7, 5, 4]


@pytest.mark.parametrize(
    ("faces", "fault"),
    [
        ([(0, 1)], "face 0 has 2 corners"),
        ([(0, 1, 2), (0, 1, 8)], "faces name vertex 8"),
        ([(0, -1, 2)], "and -1"),
    ],
)
def test_arrays_that_are_no_polygons_are_refused(faces: list[tuple[int, ...]], fault: str) -> None:
    with pytest.raises(MeshError, match=fault):
        PolygonMesh(POINTS, faces)


def test_attributes_and_creases_follow_the_rules_of_triangles() -> None:
    with pytest.raises(MeshError, match="needs 8 rows"):
        PolygonMesh(POINTS, [(0, 1, 2)], {"heat": [1, 2]})
    with pytest.raises(MeshError, match="creases name vertex 9"):
        PolygonMesh(POINTS, [(0, 1, 2)], creases=[(0, 9)])
    mesh = PolygonMesh(POINTS, [(0, 1, 3, 2)], {"heat": range(8)}, [(3, 1), (0, 1)])
    cut = mesh.triangulated()
    assert cut.creases.tolist() == [[0, 1], [1, 3]]
    assert cut.attributes["heat"].tolist() == list(range(8))


@pytest.mark.parametrize("mesh", [icosphere(5), torus(), rod(), sheet(edge_length=0.4), box()])
def test_triangles_are_judged_alike_as_triangles_and_as_polygons(mesh) -> None:  # type: ignore[no-untyped-def]
    polygons = PolygonMesh.from_triangles(mesh)
    assert validate(polygons) == validate(mesh)
    assert np.array_equal(polygons.triangulated().faces, mesh.faces)


def outline(rng: np.random.Generator, corners: int, on_sides: int) -> Points:
    """A star-shaped polygon in a random plane, with further points on its sides."""
    turns = (np.arange(corners) + rng.uniform(0, 0.8, corners)) * 2 * math.pi / corners
    reach = rng.uniform(0.3, 1.0, corners)
    flat = np.column_stack([reach * np.cos(turns), reach * np.sin(turns)])
    points = []
    for here, there in zip(flat, np.roll(flat, -1, axis=0), strict=True):
        shares = np.sort(rng.uniform(0.05, 0.95, rng.integers(0, on_sides + 1)))
        points += [here, *(here + share * (there - here) for share in shares)]
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.array(points) @ frame[:2] + rng.normal(size=3)


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), corners=st.integers(4, 12), on_sides=st.integers(0, 3))
def test_polygons_are_cut_whole_concave_or_not_and_with_points_on_their_sides(
    seed: int, corners: int, on_sides: int
) -> None:
    points = outline(np.random.default_rng(seed), corners, on_sides)
    mesh = PolygonMesh(points, [range(len(points))])
    cut = mesh.triangulated()
    assert cut.vertices.shape == mesh.vertices.shape
    assert validate(cut).sound
    vectors = PolygonMesh.from_triangles(cut).area_vectors @ mesh.normals[0]
    assert (vectors > 0).all(), "no triangle is turned over or without area"
    assert vectors.sum() == pytest.approx(mesh.areas[0])


def test_the_triangulation_is_the_best_of_all() -> None:
    """Against a readable twin that tries every way there is."""
    rng = np.random.default_rng(3)
    for corners in (4, 5, 6, 7):
        points = np.column_stack([outline(rng, corners, 0) @ np.eye(3)[:, :2], np.zeros(corners)])
        points = (
            points if PolygonMesh(points, [range(corners)]).area_vectors[0, 2] > 0 else points[::-1].copy()
        )
        triangles = np.empty((corners - 2, 3), np.int32)
        cost = triangulate_polygon(points, np.zeros((corners, corners), np.uint8), triangles)
        assert cost == pytest.approx(min(_costs(points, tuple(range(corners)))))
        assert cost == pytest.approx(sum(_cotangents(points, tuple(t)) for t in triangles.tolist()))


def _costs(points: Points, part: tuple[int, ...]) -> list[float]:
    """Return the cost of every triangulation of a part of a polygon."""
    if len(part) < 3:
        return [0.0]
    found = []
    for k in range(1, len(part) - 1):
        tip = _cotangents(points, (part[0], part[k], part[-1]))
        for low in _costs(points, part[: k + 1]):
            found += [tip + low + high for high in _costs(points, part[k:])]
    return found


def _cotangents(points: Points, corners: tuple[int, ...]) -> float:
    a, b, c = points[list(corners)]
    area = np.cross(b - a, c - a)[2]
    squares = sum(float((side * side).sum()) for side in (b - a, c - b, a - c))
    if area > 1e-9 * squares:
        return float(squares / (2 * area))
    return 1e9 if area >= -1e-9 * squares else 1e13


def test_two_faces_never_share_a_diagonal() -> None:
    """The two caps of a lens meet in all four corners; each must take the other diagonal."""
    points = [(1, 0, 0), (0, 0, 1), (-1, 0, 0), (0, 0, -1), (0, 1, 0)]
    lens = PolygonMesh(points, [(0, 1, 2, 3), (1, 0, 4), (2, 1, 4), (3, 2, 4), (0, 3, 4)])
    assert validate(lens.triangulated()).require(closed=True).euler == 2
    pillow = PolygonMesh(points[:4], [(0, 1, 2, 3), (3, 2, 1, 0)])
    edges = [frozenset(edge) for face in pillow.triangulated().faces.tolist() for edge in _pairs(face)]
    assert max(edges.count(edge) for edge in edges) == 2


def _pairs(face: list[int]) -> list[tuple[int, int]]:
    return list(zip(face, [*face[1:], face[0]], strict=True))


def test_a_face_without_a_free_diagonal_takes_a_vertex_in_its_middle() -> None:
    """Both diagonals of the ground are edges of the roof already."""
    points = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]
    taken = np.ones((4, 4), np.uint8)
    taken[0, 1] = taken[1, 2] = taken[2, 3] = taken[0, 3] = 0
    triangles = np.empty((2, 3), np.int32)
    assert triangulate_polygon(np.array(points, float), taken, triangles) >= FORBIDDEN
    crossed = PolygonMesh(
        [*points, (0.5, 1, 0.2), (0.5, 1, 0.8), (0.5, -1, 0.2), (0.5, -1, 0.8)],
        [(0, 1, 2, 3), (0, 2, 4), (2, 0, 5), (1, 3, 6), (3, 1, 7)],
        {"heat": [0.0, 1, 2, 3, 4, 5, 6, 7]},
    )
    cut = crossed.triangulated()
    assert (len(cut.vertices), len(cut.faces)) == (9, 8)
    assert cut.vertices[8].tolist() == [0.5, 0, 0.5]
    assert cut.attributes["heat"][8] == 1.5


def test_a_closed_surface_is_required_where_it_is_asked_for() -> None:
    assert validate(CUBE).require(closed=True).euler == 2
    with pytest.raises(MeshError, match="4 edges have a face on one side only"):
        validate(PolygonMesh(POINTS, [CUBE.face(f) for f in range(5)])).require(closed=True)


def test_a_polygon_is_not_cut_along_the_last_side_of_another() -> None:
    points = np.array([[0, 0, 0], [0.5, -2, 0], [1, 0, 0], [0.5, 2, 0], [0.5, 0, 1]], np.float64)
    cut = PolygonMesh(points, [[0, 1, 2, 3], [2, 4, 0]]).triangulated()
    assert sum({0, 2} <= set(face) for face in cut.faces.tolist()) == 1
