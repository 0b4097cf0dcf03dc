"""Triangle shape, length limits and the scan, against twins in plain numpy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Indices
from flowsculpt.pipeline.mesh import HalfedgeMesh, TriangleMesh, box, icosphere, sheet, torus
from flowsculpt.pipeline.mesh.kernels.halfedge import following
from flowsculpt.pipeline.mesh.normals import vertex_normals
from flowsculpt.pipeline.resample.kernels.pass_state import (
    UNCHANGED,
    Changes,
    Limits,
    length_limits,
    new_ring,
    touch,
)
from flowsculpt.pipeline.resample.kernels.rest_surface import (
    list_poor_vertices,
    relax_goals,
    relax_vertices,
    roundness,
)
from flowsculpt.pipeline.resample.placement import Chord
from flowsculpt.pipeline.resample.resample_pass import ResamplePass, changes_of, reset
from flowsculpt.pipeline.resample.thresholds import Thresholds, TriangleShape

HARD = math.cos(math.radians(40))
BALL, CUBE, RING, CLOTH = icosphere(5), box(edge_length=0.5), torus(1.0, 0.4, 0.3), sheet((2, 2), 0.25)


def work_list(room: int) -> Indices:
    items = np.empty(room + 1, np.int32)
    items[0] = 0
    return items


def items(work: Indices) -> list[int]:
    return [int(i) for i in work[1 : 1 + work[0]]]


def nothing_changed(live: HalfedgeMesh) -> Changes:
    """Return the record of a pass that has changed nothing yet."""
    changes = changes_of(live)
    reset(changes)
    return changes


def jittered(mesh: TriangleMesh, seed: int, reach: float) -> TriangleMesh:
    """Inner vertices of a sheet move within its plane, those of a solid anywhere."""
    rng = np.random.default_rng(seed)
    steps = reach * rng.normal(size=mesh.vertices.shape)
    if mesh is CLOTH:
        steps[:, 1] = 0
        steps[np.abs(mesh.vertices).max(axis=1) == 1] = 0
    return mesh.with_vertices(mesh.vertices + steps)


def slow_roundness(corners: Floats) -> float:
    """2 r / R by the area: r = 2 A / perimeter, R = a b c / 4 A."""
    a, b, c = (float(np.linalg.norm(corners[i] - corners[i - 1])) for i in range(3))
    area = float(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))) / 2
    return 2 * (2 * area / (a + b + c)) / (a * b * c / (4 * area)) if area else 0.0


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_roundness_is_twice_the_inradius_over_the_circumradius(seed: int) -> None:
    corners = np.random.default_rng(seed).normal(size=(3, 3))
    a, b, c = (float(np.sum((corners[i] - corners[(i + 1) % 3]) ** 2)) for i in range(3))
    assert roundness(a, b, c) == pytest.approx(slow_roundness(corners), rel=1e-6, abs=1e-9)
    assert roundness(1.0, 1.0, 1.0) == pytest.approx(1)
    assert roundness(0.0, 1.0, 1.0) == 0


@pytest.mark.parametrize("mesh", [BALL, RING, CLOTH])
def test_poor_triangles_of_changed_faces_list_each_of_their_vertices_once(mesh: TriangleMesh) -> None:
    mesh = jittered(mesh, 1, 0.06)
    live = HalfedgeMesh(mesh)
    changes = nothing_changed(live)
    for f in range(0, len(mesh.faces), 2):
        touch(changes, f)
    seen, spokes = np.zeros(len(mesh.vertices), np.uint8), work_list(len(mesh.vertices))
    list_poor_vertices(live.arrays, 0.7, changes, seen, spokes)
    poor = [
        f for f, face in enumerate(mesh.faces) if f % 2 == 0 and slow_roundness(mesh.vertices[face]) < 0.7
    ]
    listed = [int(mesh.faces[h // 3, h % 3]) for h in items(spokes)]
    assert len(listed) == len(set(listed))
    assert set(listed) == set(mesh.faces[poor].ravel().tolist())


def neighbours(mesh: TriangleMesh, v: int) -> list[int]:
    around = mesh.faces[(mesh.faces == v).any(axis=1)]
    return sorted(set(around.ravel().tolist()) - {v})


def worst(mesh: TriangleMesh, points: Floats, v: int) -> float:
    return min(slow_roundness(points[face]) for face in mesh.faces if v in face)


def at_rest(mesh: TriangleMesh) -> HalfedgeMesh:
    return HalfedgeMesh(mesh.with_attributes(rest=mesh.vertices, rest_normal=vertex_normals(mesh)))


def at_rest_limits(live: HalfedgeMesh) -> Limits:
    return Limits(
        2.0, 0.0, HARD, rest_column=live.column("rest"), rest_normal_column=live.column("rest_normal")
    )


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_inner_vertices_of_a_plane_go_to_the_mean_of_their_neighbours_at_rest_if_the_worst_triangle_gains(
    seed: int,
) -> None:
    """The flow so far is affine, so that it is predicted exactly which vertices gain."""
    resting = jittered(CLOTH, seed, 0.02)
    drawn = np.eye(3) + 0.3 * np.random.default_rng(seed).uniform(-1, 1, (3, 3))
    mesh = resting.with_vertices(resting.vertices @ drawn)
    live, ring = HalfedgeMesh(mesh.with_attributes(**at_rest(resting).attributes())), new_ring()
    spokes = work_list(len(mesh.vertices))
    first = {int(v): h for h, v in reversed(list(enumerate(mesh.faces.ravel())))}
    spokes[0] = len(first)
    spokes[1:] = list(first.values())
    limits = at_rest_limits(live)
    goals, normals, sizes = np.empty((spokes[0], 3)), np.empty((spokes[0], 3)), np.empty(spokes[0])
    many = relax_goals(live.arrays, spokes, limits, ring, False, goals, normals, sizes)
    goals = goals[:many]
    places, points = goals @ drawn, np.array(mesh.vertices)
    left = [int(mesh.faces[h // 3, h % 3]) for h in items(spokes)]
    for v in np.flatnonzero(np.abs(CLOTH.vertices).max(axis=1) < 1):
        goal = resting.vertices[neighbours(mesh, int(v))].mean(axis=0)
        moved = np.array(points)
        moved[v] = goal @ drawn
        gain = worst(mesh, moved, int(v)) - worst(mesh, points, int(v))
        assert abs(gain - 1e-3) < 1e-6 or (v in left) == (gain > 1e-3)
        if v in left:
            i = left.index(int(v))
            assert np.allclose(goals[i], goal)
            assert np.allclose(np.abs(normals[i]), (0, 1, 0))
            spoke = np.diff(resting.vertices[[v, mesh.faces.ravel()[following(spokes[1 + i])]]], axis=0)
            assert np.isclose(sizes[i], np.linalg.norm(spoke))
    changes, went = nothing_changed(live), np.zeros(many, np.uint8)
    rest = np.array(resting.vertices)
    relax_vertices(live.arrays, spokes, places, goals, limits, ring, changes, went)
    for i, v in enumerate(left):
        before, moved = worst(mesh, points, v), np.array(points)
        moved[v] = places[i]
        if went[i]:
            assert worst(mesh, moved, v) > before
            points, rest[v] = moved, goals[i]
    assert np.array_equal(live.vertices, points)
    assert np.array_equal(live.attributes()["rest"], rest), "a flat face cannot turn over"
    touched = np.isin(mesh.faces, [v for i, v in enumerate(left) if went[i]]).any(axis=1)
    assert np.array_equal(changes.face_states[: len(touched)] != UNCHANGED, touched)


def test_where_the_surface_at_rest_is_not_flat_nothing_moves_unless_it_is_known() -> None:
    live, ring = at_rest(jittered(BALL, 3, 0.04)), new_ring()
    limits = at_rest_limits(live)
    for known in (False, True):
        spokes = work_list(20)
        spokes[:21] = [20, *range(0, 60, 3)]
        room, sizes = np.empty((20, 3)), np.empty(20)
        many = relax_goals(live.arrays, spokes, limits, ring, known, room, room.copy(), sizes)
        assert many == spokes[0]
        assert (many > 0) == known


@pytest.mark.parametrize("mesh", [BALL, CUBE, RING, CLOTH])
@pytest.mark.parametrize("active", [False, True])
def test_the_scan_lists_what_a_loop_over_edges_finds(mesh: TriangleMesh, active: bool) -> None:
    mesh = jittered(mesh, 2, 0.05)
    longest = np.full(len(mesh.vertices), 0.3) + (0.2 * np.abs(mesh.vertices[:, 0]) if active else 0)
    shortest, blunt = 0.45 * longest, TriangleShape(0.6).longest_share
    given = (lambda m: longest, lambda m: shortest) if active else (0.3, 0.135)
    frame = ResamplePass(HalfedgeMesh(mesh), Thresholds(*given, gradation=100.0), Chord(), TriangleShape(0.6))
    frame.find_edges()
    long_edges, short_edges, obtuse_edges = frame.long_edges, frame.changes.short_edges, frame.obtuse_edges
    ends = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    squares = np.sum((mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]]) ** 2, axis=1)
    most, least = (bound[ends].prod(axis=1) for bound in (longest, shortest))
    for listed, expected in ((long_edges, squares > most), (short_edges, squares < least)):
        found = [frozenset(ends[h].tolist()) for h in items(listed)]
        assert len(found) == len(set(found)), "each once"
        assert set(found) == {frozenset(pair) for pair in ends[expected].tolist()}
    shares = squares.reshape(-1, 3).max(axis=1) / squares.reshape(-1, 3).sum(axis=1)
    assert sorted(h // 3 for h in items(obtuse_edges)) == np.flatnonzero(shares > blunt).tolist()
    assert all(squares[h] == squares.reshape(-1, 3)[h // 3].max() for h in items(obtuse_edges))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_length_limits_of_an_edge_are_the_geometric_mean_of_its_ends(seed: int) -> None:
    live, rng = HalfedgeMesh(BALL), np.random.default_rng(seed)
    fields = rng.uniform(0.1, 1.0, size=(len(BALL.vertices), 3))
    limits = Limits(3.0, 1.0, HARD)
    assert length_limits(live.arrays, limits, 0, 1) == (9.0, 1.0)
    limits = limits._replace(field_column=live.set_fields(fields))
    a, b = rng.integers(len(fields), size=2)
    most, least = length_limits(live.arrays, limits, int(a), int(b))
    assert math.sqrt(most) == pytest.approx(math.sqrt(fields[a, 0] * fields[b, 0]))
    assert math.sqrt(least) == pytest.approx(math.sqrt(fields[a, 1] * fields[b, 1]))
    assert set(live.snapshot().attributes) == set(), "limits are no attribute"


def test_a_face_counts_as_obtuse_where_it_is_less_round_than_the_demand() -> None:
    for least in (0.3, 0.6, 0.85):
        angle = 1.2
        while True:
            half = angle / 2
            corners = np.array(
                [(0, 0, 0), (math.sin(half), math.cos(half), 0), (-math.sin(half), math.cos(half), 0)]
            )
            if angle > math.pi / 2 and slow_roundness(corners) < least:
                break
            angle += 1e-3
        squares = [float(np.sum((corners[i] - corners[i - 1]) ** 2)) for i in range(3)]
        assert TriangleShape(least).longest_share == pytest.approx(max(squares) / sum(squares), abs=2e-3)
