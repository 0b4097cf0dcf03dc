"""Counting self-intersections, against a loop over all pairs."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.mesh import TriangleMesh, box, icosphere, torus
from pipeline.statistics import self_intersections


def pierces(p: np.ndarray, q: np.ndarray, face: np.ndarray) -> bool:
    """Möller & Trumbore (1997): where the line through p and q meets the plane, in barycentric terms."""
    (a, b, c), direction = face, q - p
    matrix = np.column_stack([b - a, c - a, -direction])
    if abs(np.linalg.det(matrix)) < 1e-15:
        return False
    u, v, t = np.linalg.solve(matrix, p - a)
    return bool(u > 0 and v > 0 and u + v < 1 and 0 < t < 1)


def crossings(mesh: TriangleMesh) -> int:
    count = 0
    for i, f in enumerate(mesh.faces):
        for g in mesh.faces[i + 1 :]:
            if len(set(f.tolist()) & set(g.tolist())) > 1:
                continue
            count += any(
                pierces(mesh.vertices[one[k]], mesh.vertices[one[(k + 1) % 3]], mesh.vertices[other])
                for one, other in ((f, g), (g, f))
                for k in range(3)
                if not {int(one[k]), int(one[(k + 1) % 3])} & set(other.tolist())
            )
    return count


def joined(one: TriangleMesh, other: TriangleMesh) -> TriangleMesh:
    vertices = np.concatenate([one.vertices, other.vertices])
    return TriangleMesh(vertices, np.concatenate([one.faces, other.faces + len(one.vertices)]))


def test_solids_do_not_cross_themselves() -> None:
    for mesh in (box(edge_length=0.5), icosphere(8), torus(1.0, 0.4, 0.2)):
        assert self_intersections(mesh) == 0


def test_a_surface_without_faces_crosses_nothing() -> None:
    assert self_intersections(TriangleMesh(np.empty((0, 3)), [])) == 0


@given(st.tuples(*[st.floats(-1.5, 1.5)] * 3), st.floats(0.2, 3.0))
@settings(max_examples=20, deadline=None)
def test_pairs_are_those_of_a_loop_over_all(shift: tuple[float, ...], scale: float) -> None:
    small = icosphere(1)
    mesh = joined(icosphere(1), small.with_vertices(scale * small.vertices + np.array(shift)))
    assert self_intersections(mesh) == crossings(mesh)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_crumpled_surfaces_are_counted_too(seed: int) -> None:
    ball = icosphere(1)
    crumpled = ball.with_vertices(
        ball.vertices + np.random.default_rng(seed).normal(0, 0.3, ball.vertices.shape)
    )
    assert self_intersections(crumpled) == crossings(crumpled)
