"""Statistics of meshes: crossings against a loop over all pairs, and the flicker of a resampling (P38)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.normals import sizzle, surviving
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.flow.catalogue.basic import Enright
from flowsculpt.pipeline.flow.flow_map import FrameStep
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, split_at_creases, torus
from flowsculpt.pipeline.mesh.normals import carried_normals, dihedral_angles, tangents
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Motion, Resampling, Solid
from flowsculpt.pipeline.statistics import mesh_statistics, self_intersections


@pytest.fixture(scope="module")
def motion() -> Motion:
    flow = Streamlines(Enright((0.4, 0.4, 0.4), scale=8.0, period=3.0))
    resampling = Resampling(Thresholds(max_edge_length=0.3))
    return Motion(FrameRange.parse("0-12"), FrameRate.of(24), Solid.of("icosphere", {}), flow, resampling)


def test_a_carried_normal_does_not_jump_at_a_resample_and_a_geometric_one_does(motion: Motion) -> None:
    last, jumps = None, []
    for frame in animate(motion):
        if last is not None:
            step = FrameStep(motion.flow, *motion.clock.step(frame.number), frame.number)
            moved = step.apply(last.vertices)
            normals = carried_normals(step.apply, last.vertices, moved, last.attributes["normal"])
            before = last.with_vertices(moved).with_attributes(normal=normals)
            jumps.append(sizzle(before, split_at_creases(before), frame.mesh, split_at_creases(frame.mesh)))
            bare = [TriangleMesh(m.vertices, m.faces) for m in (before, frame.mesh)]
            smooth = [split_at_creases(mesh, math.pi) for mesh in bare]
            plain = sizzle(bare[0], smooth[0], bare[1], smooth[1])
            assert plain.shading == pytest.approx(plain.surface)
        last = frame.mesh
    assert max(jump.shading for jump in jumps) == 0.0
    assert max(jump.surface for jump in jumps) > math.radians(0.3)
    assert all(jump.share > 0.9 for jump in jumps)


def test_vertices_are_known_again_by_their_very_place() -> None:
    ball = icosphere(3)
    order = np.random.default_rng(2).permutation(len(ball.vertices))
    moved = ball.vertices[order].copy()
    moved[:4] *= 1 + 1e-15
    shuffled = TriangleMesh(moved, np.argsort(order)[ball.faces])
    old, new = surviving(ball, shuffled)
    assert len(old) == len(ball.vertices) - 4
    assert np.array_equal(ball.vertices[old], shuffled.vertices[new]) and new.min() >= 4


def test_nothing_jumps_where_nothing_happens() -> None:
    ball = icosphere(4)
    told = sizzle(ball, split_at_creases(ball), ball, split_at_creases(ball))
    assert (told.shading, told.surface, told.share) == (0.0, 0.0, 1.0)


def test_tangents_are_right_handed_and_perpendicular() -> None:
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:3] = [[0, 0, 1], [0, 0, -1], [0, 1, 0]]
    one, two = tangents(normals)
    np.testing.assert_allclose(np.cross(one, two), normals, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(one, axis=1), 1.0, atol=1e-15)


def test_normals_are_those_of_the_map_that_moves_the_points() -> None:
    """A linear map: n goes along cof(J) n. Zero stays zero, and a map onto a line leaves none."""
    rng = np.random.default_rng(6)
    points, normals = rng.normal(size=(50, 3)), rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[7] = 0.0
    matrix = np.array([[2.0, 0.3, 0.0], [0.0, 0.5, 0.1], [0.4, 0.0, 1.5]])
    carried = carried_normals(lambda p: p @ matrix.T, points, points @ matrix.T, normals)
    exact = normals @ np.linalg.inv(matrix)
    exact /= np.maximum(np.linalg.norm(exact, axis=1, keepdims=True), 1e-300)
    np.testing.assert_allclose(carried, exact, atol=1e-7)
    line = np.diag([1.0, 0.0, 0.0])
    assert not carried_normals(lambda p: p @ line, points, points @ line, normals).any()


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


def test_statistics_are_those_of_numpy_and_name_what_was_not_counted() -> None:
    rng = np.random.default_rng(3)
    mesh = torus(1.0, 0.4, 0.2)
    mesh = mesh.with_vertices(mesh.vertices + rng.normal(0, 0.02, mesh.vertices.shape))
    found = mesh_statistics(mesh, count_crossings=False)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    lengths = [np.linalg.norm(one - other, axis=1) for one, other in ((a, b), (b, c), (c, a))]
    assert found.mean_edge == pytest.approx(np.mean(lengths))
    assert found.area == pytest.approx(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    assert found.median_dihedral == pytest.approx(math.pi - np.median(dihedral_angles(mesh)))
    assert found.crossings is None and mesh_statistics(mesh).crossings == self_intersections(mesh)


def test_a_large_mesh_is_measured_in_parts_with_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    mesh = torus(1.0, 0.4, 0.1)
    mesh = mesh.with_vertices(mesh.vertices + rng.normal(0, 0.03, mesh.vertices.shape))
    whole = mesh_statistics(mesh)
    assert whole.crossings
    monkeypatch.setattr("flowsculpt.pipeline.statistics._MATCHED_TOGETHER", 1)
    monkeypatch.setattr("flowsculpt.pipeline.statistics._BUCKETS", 1)
    assert mesh_statistics(mesh) == whole


def test_crossings_are_counted_far_from_the_origin_too() -> None:
    ball, beside = icosphere(1), np.array([0.7, 0.1, 0.0])
    mesh = joined(ball, ball.with_vertices(ball.vertices + beside))
    far = mesh.with_vertices(mesh.vertices + np.array([3e6, -2e6, 1e6]))
    assert self_intersections(far) == crossings(far) > 0


def test_a_surface_without_faces_crosses_nothing() -> None:
    assert self_intersections(TriangleMesh(np.empty((0, 3)), [])) == 0


@pytest.mark.slow
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
